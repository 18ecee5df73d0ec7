"""Output folders: claimed before anything is computed, and never overwriting other files.

A claimed folder contains a folder `unfinished`. It holds the lock, the request (`request.json`),
and everything that is not complete yet. When the result is complete, its files move up, the
manifest last, and `unfinished` is removed. If a process is killed at any point, the same request
continues from what is there; an older result in the folder stays until the new one is complete.

Folders of sweeps and of pictures work differently, but use the same functions: `made`, `locked`,
`check_writable`, `remove_leftovers`, `explained`.
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
"""Name of the subfolder of a result's folder for everything that is not complete yet."""

LOCK = "lock"
"""Name of the file that a process holds locked while it works in the folder."""

# key of a request under which the version is stored
_MARK = "taichi_foam"

_REQUEST, _MOVING, _STAGING = "request.json", "moving.json", "result"

# System errors: what they mean, and what to do.
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
# Errors that come from writing to the folder, whatever raised them.
_DISK_ERRORS = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS)


@dataclass
class Claim:
    """A folder that only this process may fill.

    folder  where the result will be
    work    folder for everything that is not complete yet; kept for the next process with the same
            request unless `finish` is called
    """

    folder: Path
    work: Path
    _finished: bool = field(default=False, init=False)
    _published: Manifest | None = field(default=None, init=False)

    @contextlib.contextmanager
    def publishing(self) -> Iterator[Path]:
        """Publish files of the result: files written into the yielded folder move into place.

        The first call replaces an older result, if there is one; later calls add to the new one.
        If the block fails, nothing changes.

        Raises UserError: a file of the same name has appeared meanwhile; nothing is lost.
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
        # if the process is killed from here on, this file lists the files without a manifest
        new.write(self.work, _MOVING)
        if not before.files and (older := Manifest.read(self.folder)) is not None:
            older.remove(self.folder)
            (self.folder / MANIFEST).unlink()
        _move(staging, self.folder, {self.folder / name for name in before.files})
        (self.work / _MOVING).unlink()

    def finish(self) -> None:
        """Declare the result complete: nothing remains to be continued."""
        self._finished = True

    def _clear(self) -> None:
        """Remove `work` if nobody will continue it: renamed first, so that its name marks it."""
        with contextlib.suppress(OSError):  # it has been removed already, or cannot be moved
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
    """Reserve a folder for one result, from before it is computed until it is complete.

    Args:
        path: the folder of the result; neither it nor its parents need to exist.
        request: everything that determines the result, by dotted key; another process with the
            same request continues from what this one leaves in `Claim.work`. None: nothing is
            continued.
        overwrite: replace the result of another request; its files stay until the new result is
            complete.
        needed_bytes: disk space (bytes) that result and unfinished work need.

    Raises:
        UserError: as `check_output_folder`; another process is at work in the folder; the disk
            is full or fails while the block writes. Other exceptions pass through.
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
            _check_target(target, overwrite, wanted)  # the folder may have changed meanwhile
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

    Yields an empty folder. If the block succeeds, the files written into it become the content of
    `path`, with a manifest. If it fails in any way (including Ctrl-C), `path` stays unchanged.

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
    a result or unfinished work of another request, and `overwrite` is false; it holds no result,
    but files that this program has not written; a file of the result has been changed since; the
    folder cannot be written to; there is too little disk space.
    """
    target = resolved(path)
    with explained(target):
        if is_locked(target / UNFINISHED):
            raise UserError(_busy(target))
        _check_target(target, overwrite, _marked(request))
        result = Manifest.read(target)
        if result is not None and (edited := result.edited(target)):
            raise UserError(
                f"output folder {target}: has changed since its result was written: "
                f"{', '.join(edited[:5])}. Fix: move these elsewhere, or choose another folder."
            )
        fix = (
            "make output.snapshot_interval and output.history_interval longer, or set "
            'output.snapshot_precision = "single"'
        )
        check_writable(target, needed_bytes, "the result", fix)


def check_writable(
    target: Path, needed_bytes: float = 0, what: str = "", fix: str = "", there: int = 0
) -> None:
    """Refuse a folder that is not writable, or has too little disk space; it need not exist.

    Args:
        target: the folder.
        needed_bytes: bytes to be written into it, of which `there` are there already.
        what, fix: for messages: what these bytes are, and how to make them fewer.

    Raises OSError; UserError: too little disk space.
    """
    parent = next((path for path in (target, *target.parents) if path.exists()), target)
    # Permission bits do not tell everything (root, /proc, read-only disks, quotas): try it.
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
    """Create a folder, with its parents, if it does not exist.

    Folders that were created and are empty when the block ends are removed. Raises OSError.
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
    """Lock `folder`, which must exist, against all other processes while the block runs.

    `shown` is the folder that messages name, by default `folder`. The system releases the lock
    however the process ends: a lock file that is left behind locks nobody out.

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
    """Whether a process is at work in `folder`; False if the folder does not exist."""
    if not (folder / LOCK).is_file():
        return False
    try:
        with locked(folder):
            return False
    except UserError:
        return True


def remove_leftovers(folders: Iterable[Path]) -> None:
    """Remove files that killed processes were writing into folders, as far as possible."""
    for path in [path for folder in folders if folder.is_dir() for path in folder.iterdir()]:
        if LEFTOVER.match(path.name):
            with contextlib.suppress(OSError):
                _remove(path)


def request_in(folder: Path) -> dict[str, Any] | None:
    """The request of the unfinished work in `folder`; None if none can be continued."""
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

    Raises UserError: it is malformed, or the path of a file.
    """
    text = os.fspath(path)
    if not text.strip() or "\0" in text:
        raise UserError(f"output folder {text!r}: not a path. Fix: give the name of a folder.")
    target = Path(os.path.realpath(text))
    with explained(target):
        if target.exists() and not target.is_dir():
            raise UserError(f"output folder {target}: is a file. Fix: choose another folder.")
    return target


def size_text(count: float) -> str:
    """A number of bytes with an SI prefix."""
    scale, prefix = si_scale(count, least=0, digits=3)
    return f"{count / scale:.3g} {prefix}B" if prefix else f"{count:.3g} bytes"


@contextlib.contextmanager
def explained(target: str | Path, how: str = "") -> Iterator[None]:
    """Turn every system error in the block into a UserError about `target`.

    `how` is appended to the proposed fix: it names the option that chooses another folder.
    """
    try:
        yield
    except OSError as error:
        raise _explain(error, target, how) from error


def is_disk_error(error: BaseException) -> bool:
    """Whether an error is due to a full or failing disk; such errors carry no file name."""
    return isinstance(error, OSError) and error.errno in _DISK_ERRORS


def _explain(error: OSError, target: str | Path, how: str = "") -> UserError:
    """The user message for a system error while writing to `target`."""
    default = (error.strerror or str(error), "choose another folder")
    reason, fix = _REASONS.get(error.errno or 0, default)
    return UserError(f"output folder {target}: cannot be written, {reason}. Fix: {fix}{how}.")


def _busy(folder: Path) -> str:
    """The message for a folder that another process is at work in."""
    return (
        f"{folder}: another process is working in it. Fix: wait until it has finished, or choose "
        "another folder."
    )


def _check_target(target: Path, overwrite: bool, request: Mapping[str, Any]) -> None:
    """Raise UserError if what is at `target` may not be replaced. Raises OSError."""
    if not target.exists():
        return
    result, before = Manifest.read(target), request_in(target)
    if before is not None and before != request and not overwrite:
        raise UserError(
            f"output folder {target}: holds the unfinished work of another command, with "
            f"{differences(before, request)[0]}. Fix: finish it with the command that began it "
            "(or, for a run, with taichi-foam resume), choose another folder, or pass "
            "overwrite=True to discard it.",
            argument="overwrite=True",
        )
    others = sorted(path.name for path in target.iterdir() if not _is_litter(path))
    if others and result is None and before is None:
        shown = ", ".join(others[:5]) + (", ..." if len(others) > 5 else "")
        raise UserError(
            f"output folder {target}: is not empty, but holds no result that could be replaced, "
            f"only {shown}. Fix: choose another folder."
        )
    if result is not None and before is None and not overwrite:
        raise UserError(
            f"output folder {target}: already holds a result. Fix: choose another folder, or pass "
            "overwrite=True to replace the result.",
            argument="overwrite=True",
        )


def _is_litter(path: Path) -> bool:
    """Whether a killed process of this program may have left the file or folder."""
    if path.name != UNFINISHED or not path.is_dir() or path.is_symlink():
        return LEFTOVER.match(path.name) is not None
    names = {inner.name for inner in path.iterdir() if not LEFTOVER.match(inner.name)}
    return names <= {LOCK} or _request(path.parent) is not None


def differences(before: Mapping[str, Any], now: Mapping[str, Any]) -> list[str]:
    """In what two tables of values by key differ: "KEY = 1 instead of 2"; long values are cut."""

    def word(table: Mapping[str, Any], key: str) -> str:
        text = repr(table.get(key))
        return text if len(text) <= 60 else f"{text[:57]}..."

    return [
        f"{key} = {word(before, key)} instead of {word(now, key)}"
        for key in {**before, **now}
        if before.get(key) != now.get(key)
    ]


def _tidy(target: Path, request: Mapping[str, Any]) -> None:
    """Remove what killed processes left, unless this request continues it. Raises OSError."""
    work = target / UNFINISHED
    moved = Manifest.read(work, _MOVING)
    if moved is not None and Manifest.read(target) is None:
        # it was killed while moving files up; without a manifest they are no result
        moved.remove(target)
    goes_on = request_in(target) == request
    remove_leftovers([*_written_into(work), *_written_into(target)])
    for path in list(work.iterdir()):
        if path.name in (_MOVING, _STAGING) or not (goes_on or path.name == LOCK):
            _remove(path)
    with whole_file(work / _REQUEST) as partial:
        write_json(partial, request)


def _remove_cleared(target: Path) -> None:
    """Remove what a process was removing when it was killed."""
    for path in target.glob(f".{UNFINISHED}.*.partial"):
        if LEFTOVER.match(path.name) and Manifest.read(target) is not None:
            shutil.rmtree(path, ignore_errors=True)


def _written_into(folder: Path) -> Iterator[Path]:
    """A folder, and the subfolders that its manifest lists, at any depth."""
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
    """Move the content of a folder into another, manifests last. Raises UserError, OSError."""
    for path in sorted(source.iterdir(), key=lambda path: path.name == MANIFEST):
        place = target / path.name
        if path.is_dir():
            place.mkdir(exist_ok=True)
            _move(path, place, replaceable)
        elif os.path.lexists(place) and place not in replaceable and path.name != MANIFEST:
            raise UserError(
                f"{place}: another program has put this here in the meantime. Fix: move it "
                f"elsewhere; until then, what was computed stays in {source}."
            )
        else:
            os.replace(path, place)
    source.rmdir()
