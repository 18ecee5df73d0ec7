"""Files into a folder that may hold others: each appears whole or not at all."""

from __future__ import annotations

import contextlib
import os
import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from taichi_foam.errors import UserError
from taichi_foam.results import manifest
from taichi_foam.results.folders import check_output_folder
from taichi_foam.simulation.progress import Bars


@dataclass(frozen=True)
class Job:
    """Something to draw.

    names   what it writes: files, or folders, whose names end with /
    pieces  how many pictures that takes
    write   writes it into a folder, each file whole, calling back after each picture
    """

    names: tuple[str, ...]
    pieces: int
    write: Callable[[Path, Callable[[], None]], object]


def deliver(jobs: Sequence[Job], folder: str, overwrite: bool, bars: Bars) -> list[str]:
    """Draw `jobs` into `folder`, which is made where it is absent; return the names written.

    Raises:
        UserError: a name that is taken, a folder that cannot be written to; before anything is
            drawn.
        KeyboardInterrupt: on Ctrl-C, with a message that names what had been completed.
    """
    if not folder.strip() or "\0" in folder:
        raise UserError(f"output folder {folder!r}: not a path. Fix: give the name of a folder.")
    with _explained(folder):
        _check(Path(folder), [name for job in jobs for name in job.names], overwrite)
    done: list[str] = []
    with _made(folder) as place, _explained(folder):
        total = sum(job.pieces for job in jobs)
        try:
            with bars.counting("pictures", "drawing pictures", total, "pictures") as on_piece:
                for job in jobs:
                    job.write(place, on_piece)
                    manifest.add(place, [name.rstrip("/") for name in job.names])
                    done += job.names
        except KeyboardInterrupt:
            kept = f"what was complete is in {folder}: {', '.join(done)}"
            raise KeyboardInterrupt(kept if done else "nothing was written") from None
    return done


def _check(folder: Path, names: Sequence[str], overwrite: bool) -> None:
    """Refuse a folder that is a file, and names that are taken. Raises OSError too."""
    if folder.exists() and not folder.is_dir():
        raise UserError(f"output folder {folder}: that is a file. Fix: choose another --out.")
    for name in names:
        path = folder / name
        if not os.path.lexists(path):
            continue
        if path.is_dir() != name.endswith("/"):
            kind = "a folder" if path.is_dir() else "a file"
            raise UserError(f"{path}: that is {kind}. Fix: move it, or choose another --out.")
        if not overwrite:
            raise UserError(
                f"{path}: it is there already. "
                "Fix: pass --overwrite to replace it, or choose another folder with --out."
            )
        if path.is_dir():
            check_output_folder(path, overwrite)


@contextlib.contextmanager
def _made(folder: str) -> Iterator[Path]:
    """Make a folder with its parents and try it; those made that are empty at the end go again."""
    place = Path(os.path.realpath(folder))
    missing = [path for path in (*reversed(place.parents), place) if not path.exists()]
    try:
        with _explained(folder):
            place.mkdir(parents=True, exist_ok=True)
            # Permission bits do not tell all: root, /proc, read-only disks.
            tempfile.TemporaryDirectory(prefix=".taichi-foam-", dir=place).cleanup()
        yield place
    finally:
        for path in reversed(missing):
            with contextlib.suppress(OSError):  # it has content
                path.rmdir()


@contextlib.contextmanager
def _explained(folder: str) -> Iterator[None]:
    """Turn a system error into a UserError about `folder`."""
    try:
        yield
    except OSError as error:
        raise UserError(
            f"output folder {folder}: cannot be written ({error.strerror or error}). "
            "Fix: free some space, or choose a folder that you may write to with --out."
        ) from error
