"""One process at a time in a folder."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from pathlib import Path

import filelock

from taichi_foam.errors import UserError

LOCK = "lock"
"""Name of the file in a folder that whoever works in it holds locked."""


@contextlib.contextmanager
def locked(folder: Path, shown: Path | None = None) -> Iterator[None]:
    """Keep all other processes out of `folder`, which must exist, for as long as the block lasts.

    `shown` is the folder that messages name, by default `folder`. The system itself gives the lock
    back when the process ends, however it ends: the file that is then left locks nobody out.

    Raises:
        UserError: another process is at work in the folder.
        OSError: the folder cannot be written to.
    """
    lock = filelock.FileLock(folder / LOCK, timeout=0, thread_local=False)
    try:
        lock.acquire()
    except filelock.Timeout as error:
        raise UserError(busy(shown or folder)) from error
    try:
        yield
    finally:
        lock.release()


def is_locked(folder: Path) -> bool:
    """Whether a process is at work in `folder`; one that does not exist is not."""
    if not (folder / LOCK).is_file():
        return False
    try:
        with locked(folder):
            return False
    except UserError:
        return True


def busy(folder: Path) -> str:
    """What to say of a folder that another process is at work in."""
    return (
        f"{folder}: another process is at work in it. Fix: wait until it has ended, or choose "
        "another folder."
    )
