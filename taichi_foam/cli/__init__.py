"""The command line: `taichi-foam run`, `serve`, `reproduce` ..., and `python scenes/wedge.py`.

Exit codes: 0 done; 1 a run failed (the data so far is saved); 2 the request cannot be met
(nothing was computed or written); 130 Ctrl-C (the data so far is saved).
Standard output and standard error may have any encoding, be closed, or be full.
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

    Ends the process like that command.
    """
    with _robust_streams():
        _app().run_script(scene)


def _app() -> Any:
    """The module of commands; Ctrl-C while it is loaded gives no traceback."""
    try:
        return import_module("taichi_foam.cli.app")
    except KeyboardInterrupt:
        sys.exit(130)


@contextlib.contextmanager
def _robust_streams() -> Iterator[None]:
    """Keep a command running despite unencodable characters and closed or full streams.

    Results matter more than messages. Text that cannot be written to standard error is dropped. A
    failure on standard output is reported at the end, with exit code 1.
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
    """Open the null device for a closed stream: a result file would else get its file number."""
    for number, name, mode in ((0, "stdin", "r"), (1, "stdout", "w"), (2, "stderr", "w")):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # takes the lowest free number
        if getattr(sys, name) is None:
            setattr(sys, name, open(number, mode, encoding="utf-8", closefd=False))  # noqa: SIM115


class _Patient:
    """A text stream on which writing never fails; `failure` is the first error.

    Characters that its encoding lacks become question marks. If the reader is gone, the process
    ends as usual, unless `gone_is_fine`.
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
