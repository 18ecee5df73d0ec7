"""The command line: `taichi-foam run`, `serve`, `reproduce` ..., and `python scenes/wedge.py`.

Exit codes: 0 done; 1 a run failed (what was computed is saved); 2 the request cannot be met
(nothing was computed or written); 130 Ctrl-C (what there is has been saved).
Standard output and standard error are taken as they are found: of any encoding, closed, or full.
"""

from __future__ import annotations

import contextlib
import io
import os
import sys
from collections.abc import Iterator
from importlib import import_module
from typing import TYPE_CHECKING, Any, cast

if TYPE_CHECKING:
    from taichi_foam.scene import Scene

__all__ = ["main", "run_script"]


def main() -> None:
    """Entry point of `taichi-foam`."""
    with _robust_streams():
        _app().main()


def run_script(scene: Scene) -> None:
    """Run a script's own scene, with the options of `taichi-foam run` from the command line.

    Ends the process as that command does.
    """
    with _robust_streams():
        _app().run_script(scene)


def _app() -> Any:
    """The commands; Ctrl-C while they are loaded is no traceback either."""
    try:
        return import_module("taichi_foam.cli.app")
    except KeyboardInterrupt:
        sys.exit(130)


@contextlib.contextmanager
def _robust_streams() -> Iterator[None]:
    """For the time of a command: no character and no closed or full stream ends it.

    Words are worth less than results. What cannot be written on standard error is left out. What
    cannot be written on standard output is told when all else is done, and makes the exit code 1.
    """
    _fill_closed()
    out, err = _Patient(sys.stdout), _Patient(sys.stderr, gone_is_fine=True)
    sys.stdout, sys.stderr = cast(Any, out), cast(Any, err)
    try:
        yield
    except SystemExit as end:
        if out.failure is None or end.code not in (None, 0):
            raise
    if out.failure is not None:
        print(f"error: standard output cannot be written: {out.failure.strerror}", file=err)
        sys.exit(1)


def _fill_closed() -> None:
    """Open the null device where a stream is closed: a file of a result would get its number."""
    for number, name, mode in ((0, "stdin", "r"), (1, "stdout", "w"), (2, "stderr", "w")):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # takes the lowest number that is free
        if getattr(sys, name) is None:
            setattr(sys, name, open(number, mode, encoding="utf-8", closefd=False))  # noqa: SIM115


class _Patient:
    """A text stream on which writing never fails; `failure` is the first thing that went wrong.

    Characters that its encoding lacks become question marks. A reader that has gone ends the
    process as it should, unless that is fine.
    """

    def __init__(self, stream: Any, gone_is_fine: bool = False) -> None:
        self._stream, self._gone_is_fine = stream, gone_is_fine
        self.failure: OSError | None = None
        if isinstance(stream, io.TextIOWrapper) and stream.errors == "strict":
            stream.reconfigure(errors="replace")

    def write(self, text: str) -> int:
        with self._noticed():
            self._stream.write(text)
        return len(text)

    def flush(self) -> None:
        with self._noticed():
            self._stream.flush()

    @contextlib.contextmanager
    def _noticed(self) -> Iterator[None]:
        try:
            yield
        except BrokenPipeError:
            if not self._gone_is_fine:
                raise
        except OSError as error:
            self.failure = self.failure or error

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)
