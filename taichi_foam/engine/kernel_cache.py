"""The cache of compiled kernels on disk, so that a later process need not compile them again.

Taichi keeps kernels in a list, `ticache.tcb`, and one `.tic` file per kernel. It writes them when
the process ends, while it holds the file `ticache.lock`. Taichi does not recover from three
problems: a folder that cannot be written crashes the process with a segmentation fault; a lock left
by a killed process, or a listed kernel whose file is damaged, makes every later process compile
everything again.

Kernels that come with the package lie beside this module, compiled ahead of time like an extension
(`kernels/make.py`). Taichi stores a kernel as LLVM's intermediate code in text form, under a key
that depends on the kernel's content, not on the machine or the path. So a kernel can be used
wherever the platform and Taichi's version are the same; others are compiled as usual.
"""

from __future__ import annotations

import contextlib
import hashlib
import lzma
import os
import platform
import re
import shutil
import sys
import tarfile
import tempfile
import time
from pathlib import Path

from taichi_foam import backend

LOCK, INDEX = "ticache.lock", "ticache.tcb"
LOCK_SECONDS = 60.0
"""A lock is held for about a second, while files are written: one this old was left behind."""

MOST_BYTES = 2**29
"""Size of a folder from which Taichi removes the kernels that have not been used for longest.

By Taichi's default, a fifth of this, those that come with the package would soon be among them.
"""

DAYS_KEPT = 90.0
"""A folder of another version's kernels that has not been used for so long is removed."""

_CHECKED = "checked"
"""Name of a file: kernels older than it have been verified completely."""

MARK = "marked-"  # prefix of the names of mark files

# Taichi's LLVM treats an unknown processor as one without wide vectors. That concerns AMD families
# after 25, the last that LLVM 15 knows; kernels are compiled for WIDE there, which has WIDE_NEEDS.
LAST_KNOWN_FAMILY = 25
WIDE = "haswell"
WIDE_NEEDS = {"avx2", "fma", "bmi1", "bmi2", "f16c", "movbe"}

_ERRORS = (OSError, EOFError, tarfile.TarError, lzma.LZMAError)
"""Exceptions raised if kernels cannot be unpacked."""

_ATTRIBUTES = re.compile(rb'^(attributes #\d+ = \{ )(?!.*"target-cpu")', re.MULTILINE)

_KERNEL = re.compile(rb"T[0-9a-f]{64}")

_prepared: Path | None = None


def prepared() -> Path | None:
    """The folder for compiled kernels, ready for use; None: no cache.

    It is TI_OFFLINE_CACHE_FILE_PATH, or by default a folder in `taichi_foam/kernels` in the user's
    cache, one for each set of packaged kernels. TI_OFFLINE_CACHE=0 turns the cache off. A line on
    stderr reports any problem with the folder.
    """
    global _prepared
    _prepared = _ready()
    return _prepared


def is_marked(name: str) -> bool:
    """Whether kernels of this name are marked, see `engine.effort`; False without a folder."""
    return _prepared is not None and (_prepared / f"{MARK}{name}").exists()


def mark(name: str) -> None:
    """Mark kernels of this name for later processes, if there is a folder."""
    if _prepared is not None and not is_marked(name):
        with contextlib.suppress(OSError):
            (_prepared / f"{MARK}{name}").touch()


def _ready() -> Path | None:
    if os.environ.get("TI_OFFLINE_CACHE") == "0":
        return None
    folder = _folder()
    if folder is None:
        return None
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile(dir=folder) as probe:
            probe.write(b"0")
            probe.flush()
            # by the file system's clock, which may differ from this machine's
            now = os.fstat(probe.fileno()).st_mtime
    except OSError as error:
        _say(
            f"{folder}: cannot be written ({error.strerror}); kernels are compiled for this "
            "process only; set TI_OFFLINE_CACHE_FILE_PATH to a writable folder"
        )
        return None
    if backend.keeps_ticache():
        with contextlib.suppress(OSError):  # another process may repair it at the same time
            _mend(folder, now)
    return folder


def _folder() -> Path | None:
    given = os.environ.get("TI_OFFLINE_CACHE_FILE_PATH")
    return Path(given) if given else _usual_folder()


def _usual_folder() -> Path | None:
    caches = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")
    # the path is relative if the user has no home
    folder = Path(caches) / "taichi_foam" / "kernels" / digest()
    return folder if os.path.isabs(caches) else None


def _mend(folder: Path, now: float) -> None:
    """Repair the folder.

    Unpack the packaged kernels if it is empty, remove a lock that was left behind, and replace all
    kernels if one of them is damaged.
    """
    lock = folder / LOCK
    if lock.exists() and now - lock.stat().st_mtime > LOCK_SECONDS:
        lock.unlink()
        _say(f"{lock}: left by a process that was killed; removed")
    if not (folder / INDEX).exists():
        _fill(folder)
        if folder == _usual_folder():
            _remove_unused(folder, now)
    if _is_whole(folder):
        checked = folder / _CHECKED
        checked.touch()
        os.utime(checked, (now, now))
        return
    if not _locked(lock):
        return
    try:
        if _is_whole(folder):
            return  # another process was writing it
        for file in (folder / INDEX, *folder.glob("T*.tic")):
            file.unlink(missing_ok=True)
        _fill(folder)
        _say(f"{folder}: some compiled kernels were damaged; they are discarded and compiled again")
    finally:
        lock.unlink(missing_ok=True)


def _remove_unused(folder: Path, now: float) -> None:
    """Remove the folders beside this one that no version has used for long."""
    for other in folder.parent.iterdir():
        with contextlib.suppress(OSError):  # not used yet, or removed by another process
            if other != folder and now - (other / _CHECKED).stat().st_mtime > 86400 * DAYS_KEPT:
                shutil.rmtree(other)


def _fill(folder: Path) -> None:
    """Unpack the packaged kernels; if that fails, all kernels are compiled when needed."""
    with contextlib.suppress(*_ERRORS):
        unpack(folder)


def _locked(lock: Path) -> bool:
    """Take Taichi's lock as Taichi does; returns whether that succeeded."""
    for _ in range(5):
        with contextlib.suppress(FileExistsError):
            lock.touch(exist_ok=False)
            return True
        time.sleep(0.05)
    return False


def _is_whole(folder: Path) -> bool:
    """Whether every listed kernel is present and undamaged."""
    index, checked = folder / INDEX, folder / _CHECKED
    if not index.is_file():
        return not any(folder.glob("T*.tic"))
    since = checked.stat().st_mtime if checked.is_file() else -1.0
    listed = index.read_bytes()
    if int.from_bytes(listed[:8], "little") != len(listed):
        return False
    return all(_is_sound(folder / f"{name.decode()}.tic", since) for name in _names(listed))


def _names(listed: bytes) -> set[bytes]:
    return set(_KERNEL.findall(listed))


def _is_sound(file: Path, since: float) -> bool:
    """Whether a kernel's file is undamaged; its checksum is tested if it is newer than `since`.

    The file has an 8-byte mark, the lengths of two parts, the parts, and their SHA-256.
    """
    try:
        with file.open("rb") as opened:
            stat = os.fstat(opened.fileno())
            head = opened.read(24)
            parts = sum(int.from_bytes(head[k : k + 8], "little") for k in (8, 16))
            if stat.st_size != 24 + parts + 64:
                return False
            if stat.st_mtime < since:
                return True
            rest = opened.read()
    except OSError:
        return False
    return hashlib.sha256(rest[:-64]).hexdigest().encode() == rest[-64:]


def _say(text: str) -> None:
    """Print a line on stderr, if there is one."""
    if sys.stderr is not None:
        with contextlib.suppress(OSError, ValueError):
            print(f"kernel cache: {text}", file=sys.stderr)


# Kernels that come with the package.


def archive_name() -> str:
    """File name of the packaged kernels for this platform and version of Taichi."""
    return f"kernels-{backend.version()}-{sys.platform}-{platform.machine()}.tar.xz"


def archive() -> Path | None:
    """The file of the packaged kernels, if there is one."""
    found = Path(__file__).with_name(archive_name())
    return found if found.is_file() else None


def digest() -> str:
    """Short digest of the packaged kernels, which names their folder."""
    found = archive()
    return "none" if found is None else hashlib.sha256(found.read_bytes()).hexdigest()[:12]


def unpack(folder: Path) -> None:
    """Unpack the packaged kernels, if any, into a folder, with Taichi's list of them last.

    Raises _ERRORS: the folder then contains nothing that a process would take for a kernel.
    """
    found = archive()
    if found is None:
        return
    folder.mkdir(parents=True, exist_ok=True)
    beside = Path(tempfile.mkdtemp(prefix=".unpacked-", dir=folder))
    try:
        widens = is_wider_than_known(cpuinfo())
        with tarfile.open(found) as packed:
            for member in packed:
                opened = packed.extractfile(member)
                assert opened is not None
                content = opened.read()
                if widens and member.name.endswith(".tic"):
                    content = widened(content)
                (beside / member.name).write_bytes(content)
        for path in sorted(beside.iterdir(), key=lambda path: path.name == INDEX):
            path.replace(folder / path.name)
    finally:
        shutil.rmtree(beside, ignore_errors=True)


def cpuinfo() -> str:
    """Linux's description of the processors; empty on other systems."""
    with contextlib.suppress(OSError):
        return Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace")
    return ""


def is_wider_than_known(told_by_linux: str) -> bool:
    """Whether the processor is unknown to LLVM 15 but has wide vectors, by /proc/cpuinfo."""
    told = dict(re.findall(r"^(vendor_id|cpu family|flags)\s*: (.*)$", told_by_linux, re.MULTILINE))
    return (
        told.get("vendor_id") == "AuthenticAMD"
        and int(told.get("cpu family", "0")) > LAST_KNOWN_FAMILY
        and set(told.get("flags", "").split()) >= WIDE_NEEDS
    )


def widened(kernel: bytes) -> bytes:
    """A kernel's file with its functions retargeted to a processor with wide vectors.

    The file has an 8-byte mark, the lengths of two parts, the parts, and their SHA-256.
    """
    length = int.from_bytes(kernel[8:16], "little")
    told, code = kernel[24 : 24 + length], kernel[24 + length : -64]
    code = _ATTRIBUTES.sub(rb'\1"target-cpu"="%s" ' % WIDE.encode(), code)
    parts = told + code
    lengths = length.to_bytes(8, "little") + len(code).to_bytes(8, "little")
    return kernel[:8] + lengths + parts + hashlib.sha256(parts).hexdigest().encode()
