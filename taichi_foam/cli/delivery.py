"""Files into a folder that may hold others: each appears whole or not at all."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from taichi_foam.errors import UserError
from taichi_foam.results import folders, manifest
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
    place = folders.resolved(folder)
    done: list[str] = []
    with folders.explained(folder, " with --out"):
        _check(Path(folder), [name for job in jobs for name in job.names], overwrite)
        folders.check_writable(place)
    with folders.explained(folder, " with --out"), folders.made(place):
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
    """Refuse names that are taken. Raises OSError too."""
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
            folders.check_output_folder(path, overwrite)
