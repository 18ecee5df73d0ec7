"""Output folders: claimed before anything is computed, filled by whole files, never anybody else's.

A folder that is claimed has a folder `unfinished` in it. There lie the lock, what was asked for
(`request.json`), and everything that is not complete yet. When the result is complete, its files
move up, the manifest last, and `unfinished` goes. Wherever a process is killed, the same request
finds what there is and goes on; an older result in the folder stays until the new one is complete.

Folders of sweeps and of pictures, which are no such results, are kept with the same pieces: `made`,
`locked`, `check_writable`, `remove_leftovers`, `explained`.
"""

from __future__ import annotations

import contextlib
import errno
import json
import os
import shutil
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import filelock

from taichi_foam.errors import UserError
from taichi_foam.interrupts import held_interrupts
from taichi_foam.results.files import LEFTOVER, partial_name, plain, synced, whole_file, write_json
from taichi_foam.results.manifest import MANIFEST, Manifest
from taichi_foam.units import si_scale
from taichi_foam.version import version

UNFINISHED = "unfinished"
"""Name of the folder, in that of a result, of what is not complete yet."""

LOCK = "lock"
"""Name of the file in a folder that whoever works in it holds locked."""

# what a request has beside what was asked for: the version
_MARK = "taichi_foam"

_REQUEST, _MOVING, _STAGING = "request.json", "moving.json", "result"

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
# Whatever raised these wrote to the folder.
_DISK_ERRORS = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS)


@dataclass
class Claim:
    """A folder that is this process's to fill.

    folder  where the result will be
    work    for what is not complete yet; kept for the next process of the same request unless
            `finish` is called
    """

    folder: Path
    work: Path
    _finished: bool = field(default=False, init=False)
    _published: Manifest | None = field(default=None, init=False)

    @contextlib.contextmanager
    def publishing(self) -> Iterator[Path]:
        """Files of the result: what the block writes into the folder yielded moves into place.

        The first time this replaces the older result, if there is one; later it adds to the new
        one. When the block fails, nothing has changed.

        Raises UserError: somebody has put a file of that name there meanwhile; nothing is lost.
        """
        staging = self.work / _STAGING
        shutil.rmtree(staging, ignore_errors=True)
        staging.mkdir()
        try:
            yield staging
            for path in staging.rglob("*"):
                if path.is_file():
                    synced(path)
            new = Manifest.of(staging)
        except BaseException:
            shutil.rmtree(staging, ignore_errors=True)
            raise
        with held_interrupts() as pressed:
            self._move_up(staging, new)
        if pressed.is_set():
            raise KeyboardInterrupt

    def _move_up(self, staging: Path, new: Manifest) -> None:
        before = self._published or Manifest()
        self._published = before | new
        self._published.write(staging)
        # a process that is killed from here on leaves files without a manifest: these
        new.write(self.work, _MOVING)
        if not before.files and (older := Manifest.read(self.folder)) is not None:
            older.remove(self.folder)
            (self.folder / MANIFEST).unlink()
        _move(staging, self.folder, {self.folder / name for name in before.files})
        (self.work / _MOVING).unlink()

    def finish(self) -> None:
        """Say that the result is complete, and nothing remains to be continued."""
        self._finished = True

    def _clear(self) -> None:
        """Take away what nobody will continue, at once: what is renamed is litter by its name."""
        with contextlib.suppress(OSError):  # somebody has taken it away, or it is not to be moved
            found = {path.name for path in self.work.iterdir()}
            if self._finished or found <= {LOCK, _REQUEST}:
                litter = partial_name(self.work)
                os.replace(self.work, litter)
                shutil.rmtree(litter, ignore_errors=True)


@contextlib.contextmanager
def claimed(
    path: str | Path,
    request: Mapping[str, Any] | None,
    overwrite: bool = False,
    needed_bytes: int = 0,
) -> Iterator[Claim]:
    """Keep a folder for one result, from before it is computed until it is complete.

    Args:
        path: the folder that the result shall become; it need not exist, nor its parents.
        request: everything that decides the result, by dotted key; another process with the same
            request goes on with what this one leaves in `Claim.work`. None: nothing is continued.
        overwrite: replace the result of another request; its files stay until then.
        needed_bytes: room (bytes) that result and unfinished work need.

    Raises:
        UserError: as `check_output_folder`; another process is at work in the folder; the disk
            fills up or refuses while the block writes. Other exceptions pass through.
    """
    wanted = _marked(request)
    target = resolved(path)
    _remove_cleared(target)
    check_output_folder(path, overwrite, needed_bytes, request)
    work = target / UNFINISHED
    with contextlib.ExitStack() as stack:
        with explained(target):
            stack.enter_context(made(target))
            work.mkdir(exist_ok=True)
            stack.enter_context(locked(work, shown=target))
            _check_target(target, overwrite, wanted)  # it may have been filled meanwhile
            _tidy(target, wanted)
        claim = Claim(target, work)
        try:
            yield claim
        except OSError as error:
            inside = target in Path(str(error.filename)).parents
            if is_disk_error(error) or (inside and error.errno in _REASONS):
                raise _explain(error, target) from error
            raise
        finally:
            claim._clear()


@contextlib.contextmanager
def output_folder(path: str | Path, overwrite: bool = False) -> Iterator[Path]:
    """Write a folder as a whole: `with output_folder("runs/a") as folder: ...`.

    Yields an empty folder; when the block ends well, what it has written is the content of `path`,
    with a manifest. When the block fails in any way (Ctrl-C too), what was at `path` is as before.

    Raises UserError as `claimed` does.
    """
    with claimed(path, None, overwrite) as claim:
        with claim.publishing() as staging:
            yield staging
        claim.finish()


def check_output_folder(
    path: str | Path,
    overwrite: bool = False,
    needed_bytes: int = 0,
    request: Mapping[str, Any] | None = None,
) -> None:
    """Refuse a folder that could not be claimed, before anything is computed.

    Arguments as for `claimed`. Raises UserError: the path is a file or malformed; the folder holds
    a result and `overwrite` is false; it holds unfinished work of another request, and `overwrite`
    is false; it holds what this program has not written, and no result of it; a file of the result
    has been changed since; the folder cannot be written to; too little room.
    """
    target = resolved(path)
    with explained(target):
        if is_locked(target / UNFINISHED):
            raise UserError(_busy(target))
        _check_target(target, overwrite, _marked(request))
        result = Manifest.read(target)
        if result is not None and (edited := result.edited(target)):
            raise UserError(
                f"output folder {target}: changed since the result in it was written: "
                f"{', '.join(edited[:5])}. Fix: move that elsewhere, or choose another folder."
            )
        fix = (
            "make output.snapshot_interval and output.history_interval longer, or set "
            'output.snapshot_precision = "single"'
        )
        check_writable(target, needed_bytes, "the result", fix)


def check_writable(
    target: Path, needed_bytes: float = 0, what: str = "", fix: str = "", there: int = 0
) -> None:
    """Refuse a folder, which need not exist, that nothing can be written to, or too little.

    Args:
        target: the folder.
        needed_bytes: what shall be written into it, of which `there` are there already.
        what, fix: how messages call that, and what makes it smaller.

    Raises OSError; UserError: too little room.
    """
    parent = next((path for path in (target, *target.parents) if path.exists()), target)
    # The permission bits do not tell all (root, /proc, read-only disks, quotas): try it.
    probe = partial_name(parent / "probe")
    probe.mkdir()
    probe.rmdir()
    free = shutil.disk_usage(parent).free + there
    if free < needed_bytes:
        raise UserError(
            f"output folder {target}: {what} needs about {size_text(needed_bytes)}, but the disk "
            f"has {size_text(free)} free. Fix: free some space, choose another disk, {fix}."
        )


@contextlib.contextmanager
def made(folder: Path) -> Iterator[None]:
    """A folder for as long as the block lasts, made with its parents where it is absent.

    Those that were made and are empty at the end go again. Raises OSError.
    """
    new = [path for path in (folder, *folder.parents) if not path.exists()]
    try:
        folder.mkdir(parents=True, exist_ok=True)
        yield
    finally:
        for path in new:
            with contextlib.suppress(OSError):  # not empty
                path.rmdir()


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
        raise UserError(_busy(shown or folder)) from error
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


def remove_leftovers(folders: Iterable[Path]) -> None:
    """Take away what killed processes were writing into folders, as far as that can be."""
    for path in [path for folder in folders if folder.is_dir() for path in folder.iterdir()]:
        if LEFTOVER.match(path.name):
            with contextlib.suppress(OSError):
                _remove(path)


def request_in(folder: Path) -> dict[str, Any] | None:
    """What the unfinished work in `folder` is of; None if there is none that could go on."""
    found = _request(folder)
    return found if found is not None and len(found) > 1 else None


def _request(folder: Path) -> dict[str, Any] | None:
    try:
        found = json.loads((folder / UNFINISHED / _REQUEST).read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return None
    return found if isinstance(found, dict) and _MARK in found else None


def _marked(request: Mapping[str, Any] | None) -> dict[str, Any]:
    return plain({**(request or {}), _MARK: version()})


def resolved(path: str | Path) -> Path:
    """The absolute path of an output folder, with links followed.

    Raises UserError: it is malformed, or that of a file.
    """
    text = os.fspath(path)
    if not text.strip() or "\0" in text:
        raise UserError(f"output folder {text!r}: not a path. Fix: give the name of a folder.")
    target = Path(os.path.realpath(text))
    with explained(target):
        if target.exists() and not target.is_dir():
            raise UserError(f"output folder {target}: that is a file. Fix: choose another folder.")
    return target


def size_text(count: float) -> str:
    """A number of bytes for people."""
    scale, prefix = si_scale(count, least=0, digits=3)
    return f"{count / scale:.3g} {prefix}B" if prefix else f"{count:.3g} bytes"


@contextlib.contextmanager
def explained(target: str | Path, how: str = "") -> Iterator[None]:
    """Turn every system error of the block into a UserError about `target`.

    `how` ends what there is to do about it: by which option one chooses another folder.
    """
    try:
        yield
    except OSError as error:
        raise _explain(error, target, how) from error


def is_disk_error(error: BaseException) -> bool:
    """Whether a disk is full or refuses: such errors come without a file name."""
    return isinstance(error, OSError) and error.errno in _DISK_ERRORS


def _explain(error: OSError, target: str | Path, how: str = "") -> UserError:
    """The user's message for a system error on the way to `target`."""
    default = (error.strerror or str(error), "choose another folder")
    reason, fix = _REASONS.get(error.errno or 0, default)
    return UserError(f"output folder {target}: cannot be written, {reason}. Fix: {fix}{how}.")


def _busy(folder: Path) -> str:
    """What to say of a folder that another process is at work in."""
    return (
        f"{folder}: another process is at work in it. Fix: wait until it has ended, or choose "
        "another folder."
    )


def _check_target(target: Path, overwrite: bool, request: Mapping[str, Any]) -> None:
    """Refuse what is at `target` if it may not be replaced. Raises UserError, OSError."""
    if not target.exists():
        return
    result, before = Manifest.read(target), request_in(target)
    if before is not None and before != request and not overwrite:
        raise UserError(
            f"output folder {target}: it holds unfinished work of another request, "
            f"{_difference(before, request)}. Fix: let the command that began it finish it (a run "
            "also: taichi-foam resume), choose another folder, or pass overwrite=True to drop it.",
            argument="overwrite=True",
        )
    others = sorted(path.name for path in target.iterdir() if not _is_litter(path))
    if others and result is None and before is None:
        shown = ", ".join(others[:5]) + (", ..." if len(others) > 5 else "")
        raise UserError(
            f"output folder {target}: it is not empty, and holds no result that could be replaced, "
            f"but {shown}. Fix: choose another folder."
        )
    if result is not None and before is None and not overwrite:
        raise UserError(
            f"output folder {target}: it exists and is not empty: it holds a result. "
            "Fix: choose another folder, or pass overwrite=True to replace the result.",
            argument="overwrite=True",
        )


def _is_litter(path: Path) -> bool:
    """Whether that is what a process of this program leaves when it is killed."""
    if path.name != UNFINISHED or not path.is_dir() or path.is_symlink():
        return LEFTOVER.match(path.name) is not None
    names = {inner.name for inner in path.iterdir() if not LEFTOVER.match(inner.name)}
    return names <= {LOCK} or _request(path.parent) is not None


def _difference(before: Mapping[str, Any], request: Mapping[str, Any]) -> str:
    """The first value by which a request differs from the one that was begun."""
    key = next(key for key in sorted({*before, *request}) if before.get(key) != request.get(key))
    return f"{key} = {before.get(key)!r} instead of {request.get(key)!r}"


def _tidy(target: Path, request: Mapping[str, Any]) -> None:
    """Take away what a killed process has left and nobody will continue. Raises OSError."""
    work = target / UNFINISHED
    moved = Manifest.read(work, _MOVING)
    if moved is not None and Manifest.read(target) is None:
        # it was killed while the files moved up; without a manifest they are no result
        moved.remove(target)
    goes_on = request_in(target) == request
    remove_leftovers([*_written_into(work), *_written_into(target)])
    for path in list(work.iterdir()):
        if path.name in (_MOVING, _STAGING) or not (goes_on or path.name == LOCK):
            _remove(path)
    with whole_file(work / _REQUEST) as partial:
        write_json(partial, request)


def _remove_cleared(target: Path) -> None:
    """Take away what a process was removing as its last act when it was killed."""
    for path in target.glob(f".{UNFINISHED}.*.partial"):
        if LEFTOVER.match(path.name) and Manifest.read(target) is not None:
            shutil.rmtree(path, ignore_errors=True)


def _written_into(folder: Path) -> Iterator[Path]:
    """A folder, and those in it that its manifest lists, at any depth."""
    if folder.is_dir() and not folder.is_symlink():
        yield folder
        for name in (Manifest.read(folder) or Manifest()).folders:
            yield from _written_into(folder / name)


def _remove(path: Path) -> None:
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink()


def _move(source: Path, target: Path, replaceable: Collection[Path]) -> None:
    """Move what lies in a folder into another, manifests last. Raises UserError, OSError."""
    for path in sorted(source.iterdir(), key=lambda path: path.name == MANIFEST):
        place = target / path.name
        if path.is_dir():
            place.mkdir(exist_ok=True)
            _move(path, place, replaceable)
        elif os.path.lexists(place) and place not in replaceable and path.name != MANIFEST:
            raise UserError(
                f"{place}: somebody has put that there meanwhile. Fix: move it elsewhere; what has "
                f"been computed is in {source} until then."
            )
        else:
            os.replace(path, place)
    source.rmdir()
