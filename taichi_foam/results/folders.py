"""Output folders written as one transaction: the whole folder appears, or nothing changes.

Everything goes into a temporary sibling of the wanted folder, which is renamed into place at the
end. So a crash, a full disk or Ctrl-C leaves neither half a result nor a damaged earlier one.
"""

from __future__ import annotations

import contextlib
import errno
import os
import re
import secrets
import shutil
import warnings
from collections.abc import Collection, Iterator
from pathlib import Path

from taichi_foam.errors import UserError
from taichi_foam.units import si_scale

_PREFIX = ".taichi-foam-"

CHECKPOINT = "checkpoint.npz"
"""Name of the file that a run can be continued from."""

RUN_FILES = (
    "scene.toml", "history.csv", "snapshots.npz", "cracks.json", "summary.json",
    "film.mp4", "film.gif", "frames", CHECKPOINT,
)  # fmt: skip
"""Names in the folder of a run that the run itself has made."""

# A file that `whole_file` was writing when its process was killed.
_LEFTOVER = re.compile(r"\..+\.[0-9a-f]{8}\.partial(\..+)?$")

# What the system says, and what to do about it.
_REASONS = {
    errno.ENOSPC: ("the disk is full", "free some space or choose a folder on another disk"),
    errno.EDQUOT: ("the disk quota is used up", "free some space or choose another disk"),
    errno.EACCES: ("permission denied", "choose a folder that you may write to"),
    errno.EPERM: ("operation not permitted", "choose a folder that you may write to"),
    errno.EROFS: ("the file system is read-only", "choose a folder on a writable disk"),
    errno.ENOTDIR: ("part of the path is a file, not a folder", "choose another path"),
    errno.EEXIST: ("part of the path is a file, not a folder", "choose another path"),
    errno.ENAMETOOLONG: ("the name is too long", "choose a shorter name"),
    errno.ELOOP: ("the path runs through a loop of links", "choose another path"),
    errno.EFBIG: ("a file would exceed the size limit", "raise the limit or write fewer snapshots"),
}
# These come without a file name, and whatever raised them wrote to the folder.
_DISK_ERRORS = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS)


def check_output_folder(
    path: str | Path,
    overwrite: bool = False,
    needed_bytes: int = 0,
    own: Collection[str] = (),
) -> None:
    """Refuse, before anything is computed, an output folder that could not be written at the end.

    path          the folder that the result shall become; it need not exist, nor its parents
    overwrite     allow a folder with content, to be replaced as a whole
    needed_bytes  room (bytes) that the result needs; on overwriting, the old one is still there
    own           names in the folder that the run has made itself: they may be replaced anyway

    Raises UserError: the path is a file, a mount point or malformed; the folder has content and
    `overwrite` is false; the folder to replace is the current folder, a parent of it, the home
    folder or a git repository (whatever `overwrite` says); it cannot be created; too little room.
    """
    target = _resolve(path)
    with _explained(target):
        parent = _existing_parent(target)
        _check_target(target, overwrite, own)
        # The permission bits do not tell all (root, /proc, read-only disks, quotas): try it.
        probe = parent / f"{_PREFIX}{secrets.token_hex(6)}.probe"
        probe.mkdir()
        probe.rmdir()
        free = shutil.disk_usage(parent).free
    if free < needed_bytes:
        raise UserError(
            f"output folder {target}: the result needs about {_size(needed_bytes)}, but the disk "
            f"has {_size(free)} free. Fix: free some space, choose another disk, or make "
            "output.snapshot_interval and output.history_interval longer."
        )


@contextlib.contextmanager
def output_folder(
    path: str | Path, overwrite: bool = False, own: Collection[str] = ()
) -> Iterator[Path]:
    """Write a folder as a whole: `with output_folder("runs/a") as folder: ...`.

    Yields a new temporary folder beside `path`. When the block ends well, it is renamed to `path`:
    a folder already there must be empty, or hold nothing but `own`, or, with `overwrite`, is moved
    aside, replaced, then deleted. When the block fails in any way (Ctrl-C too), the temporary
    folder and the parents made for it are removed, and what was at `path` is as before.

    Raises UserError as `check_output_folder` does, and for a disk that fills up or refuses while
    the block writes; any other exception of the block passes through unchanged.
    """
    check_output_folder(path, overwrite, own=own)
    target = _resolve(path)
    token = secrets.token_hex(6)
    staging = target.parent / f"{_PREFIX}{token}.partial"
    made = _missing_parents(target)
    try:
        with _explained(target):
            for folder in made:
                folder.mkdir(exist_ok=True)
            staging.mkdir()
        try:
            yield staging
        except OSError as error:
            inside = staging in Path(str(error.filename)).parents
            if error.errno in _DISK_ERRORS or (inside and error.errno in _REASONS):
                raise _explain(error, target) from error
            raise
        with _explained(target):
            _check_target(target, overwrite, own)  # somebody may have filled it meanwhile
            _swap(staging, target, aside=target.parent / f"{_PREFIX}{token}.old")
    except BaseException:
        shutil.rmtree(staging, ignore_errors=True)
        for folder in reversed(made):
            with contextlib.suppress(OSError):  # not empty: in use by somebody else
                folder.rmdir()
        raise


def file_name(name: str) -> str:
    """A scene's name as that of a folder: letters, digits and .+- stay, all else becomes -."""
    return re.sub(r"[^\w.+-]+", "-", name).strip("-.") or "scene"


def next_numbered(stem: Path, suffix: str = "", digits: int = 3, first: int = 1) -> Path:
    """`STEM-001SUFFIX`, or with one more than the highest number there is: none is given twice."""
    names = [path.name for path in stem.parent.iterdir()] if stem.parent.is_dir() else []
    tails = (
        name[len(stem.name) + 1 : len(name) - len(suffix)]
        for name in names
        if name.startswith(f"{stem.name}-") and name.endswith(suffix)
    )
    number = max((int(tail) + 1 for tail in tails if tail.isdecimal()), default=first)
    return stem.with_name(f"{stem.name}-{max(number, first):0{digits}}{suffix}")


@contextlib.contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """Write one file as a whole: the block writes what is yielded, which is then renamed to `path`.

    When the block fails, nothing is left, and an older file is as before. Raises OSError.
    """
    partial = path.with_name(f".{path.stem}.{secrets.token_hex(4)}.partial{path.suffix}")
    try:
        yield partial
        os.replace(partial, path)
    finally:
        partial.unlink(missing_ok=True)


def _resolve(path: str | Path) -> Path:
    """The absolute path with links followed, so that the temporary folder is on the same disk."""
    text = os.fspath(path)
    if not text.strip() or "\0" in text:
        raise UserError(f"output folder {text!r}: not a path. Fix: give the name of a folder.")
    return Path(os.path.realpath(text))


def _existing_parent(target: Path) -> Path:
    """The nearest folder above `target` that exists. Raises OSError where a file is in the way."""
    for folder in target.parents:
        if folder.is_dir():
            return folder
        if folder.exists():
            raise NotADirectoryError(errno.ENOTDIR, os.strerror(errno.ENOTDIR), str(folder))
    return target  # the root of the file system, which _check_target refuses


def _missing_parents(target: Path) -> list[Path]:
    """The parents of `target` that do not exist, uppermost first."""
    return [folder for folder in reversed(target.parents) if not folder.exists()]


def _check_target(target: Path, overwrite: bool, own: Collection[str] = ()) -> None:
    """Refuse what is at `target` if it may not be replaced. Raises UserError, OSError."""
    if not target.exists():
        return
    if not target.is_dir():
        raise UserError(f"output folder {target}: that is a file. Fix: choose another path.")
    if os.path.ismount(target):
        raise UserError(
            f"output folder {target}: a mount point cannot be replaced as a whole. "
            f"Fix: choose a folder inside it, such as {target / 'run'}."
        )
    found = sorted(entry.name for entry in target.iterdir())
    if not found:
        return
    others = [name for name in found if name not in own and not (own and _LEFTOVER.match(name))]
    if others and own and not overwrite:
        raise UserError(
            f"output folder {target}: it holds what is not the run's: {', '.join(others)}. "
            "Fix: move that elsewhere."
        )
    if others and not overwrite:
        also = f"; resume continues the run of its {CHECKPOINT}" if CHECKPOINT in found else ""
        raise UserError(
            f"output folder {target}: it exists and is not empty{also}. "
            "Fix: choose another folder, or pass overwrite=True to replace it as a whole.",
            argument="overwrite=True",
        )
    here = Path.cwd()
    if target == here or target in here.parents or target == _home() or (target / ".git").exists():
        raise UserError(
            f"output folder {target}: overwriting would delete everything in it, and it is the "
            "current folder or a parent of it, your home folder, or a git repository. "
            "Fix: choose a folder of its own for the result."
        )
    if not os.access(target, os.W_OK | os.X_OK):
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(target))


def _home() -> Path | None:
    try:
        return Path(os.path.realpath(Path.home()))
    except RuntimeError:  # a user without a home folder
        return None


def _swap(staging: Path, target: Path, aside: Path) -> None:
    """Rename `staging` to `target`; what is at `target` goes to `aside`, and back on failure."""
    try:
        if target.exists():
            target.rename(aside)
        staging.rename(target)
    except BaseException:
        if aside.exists() and not target.exists():
            aside.rename(target)
        raise
    if aside.exists():
        try:
            shutil.rmtree(aside)
        except OSError as error:
            warnings.warn(f"the replaced folder is left in {aside}: {error}", stacklevel=4)


@contextlib.contextmanager
def _explained(target: Path) -> Iterator[None]:
    """Turn every system error of the block into a UserError about `target`."""
    try:
        yield
    except OSError as error:
        raise _explain(error, target) from error


def _explain(error: OSError, target: Path) -> UserError:
    """The user's message for a system error on the way to `target`."""
    default = (error.strerror or str(error), "choose another folder")
    reason, fix = _REASONS.get(error.errno or 0, default)
    return UserError(f"output folder {target}: cannot be written, {reason}. Fix: {fix}.")


def _size(count: float) -> str:
    """A number of bytes for people."""
    scale, prefix = si_scale(count, least=0, digits=3)
    return f"{count / scale:.3g} {prefix}B" if prefix else f"{count:.3g} bytes"
