"""Kernels that come with the package, compiled ahead of time as any extension is.

`kernels/make.py` makes them. What Taichi keeps of a kernel on disk is LLVM's intermediate code as
text, and goes by what the kernel says, not by machine or place. So it serves wherever platform and
version of Taichi are the same; a kernel that is not among them is compiled as ever.
"""

import contextlib
import hashlib
import lzma
import platform
import re
import shutil
import sys
import tarfile
import tempfile
from pathlib import Path

from taichi_foam import backend

# A processor that Taichi's LLVM does not know counts as one without wide vectors. These families of
# AMD's, and what they have in any case; 25 is the last that LLVM 15 knows.
LAST_KNOWN_FAMILY = 25
WIDE = "haswell"
WIDE_NEEDS = {"avx2", "fma", "bmi1", "bmi2", "f16c", "movbe"}

KERNEL, LIST = ".tic", ".tcb"  # endings of a kernel's file, and of that of Taichi's list

ERRORS = (OSError, EOFError, tarfile.TarError, lzma.LZMAError)
"""What is raised where kernels cannot be unpacked."""

_ATTRIBUTES = re.compile(rb'^(attributes #\d+ = \{ )(?!.*"target-cpu")', re.MULTILINE)


def archive_name() -> str:
    """What kernels for this platform and version of Taichi are called."""
    return f"kernels-{backend.version()}-{sys.platform}-{platform.machine()}.tar.xz"


def archive() -> Path | None:
    """The kernels that there are, if any."""
    found = Path(__file__).with_name(archive_name())
    return found if found.is_file() else None


def digest() -> str:
    """Short name of the kernels that come with the package, for a folder of their own."""
    found = archive()
    return "none" if found is None else hashlib.sha256(found.read_bytes()).hexdigest()[:12]


def unpack(folder: Path) -> None:
    """Put the kernels into a folder, if there are any: Taichi's list of them last.

    Raises ERRORS: nothing is in the folder then that a process would take for a kernel.
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
                if widens and member.name.endswith(KERNEL):
                    content = widened(content)
                (beside / member.name).write_bytes(content)
        for path in sorted(beside.iterdir(), key=lambda path: path.suffix == LIST):
            path.replace(folder / path.name)
    finally:
        shutil.rmtree(beside, ignore_errors=True)


def cpuinfo() -> str:
    """What Linux tells of the processors; empty elsewhere."""
    with contextlib.suppress(OSError):
        return Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace")
    return ""


def is_wider_than_known(told_by_linux: str) -> bool:
    """Whether the processor has wide vectors that LLVM 15 does not know of, by /proc/cpuinfo."""
    told = dict(re.findall(r"^(vendor_id|cpu family|flags)\s*: (.*)$", told_by_linux, re.MULTILINE))
    return (
        told.get("vendor_id") == "AuthenticAMD"
        and int(told.get("cpu family", "0")) > LAST_KNOWN_FAMILY
        and set(told.get("flags", "").split()) >= WIDE_NEEDS
    )


def widened(kernel: bytes) -> bytes:
    """A kernel's file, its functions for a processor with wide vectors.

    It is 8 bytes of mark, the lengths of two parts, the parts, and their SHA-256.
    """
    length = int.from_bytes(kernel[8:16], "little")
    told, code = kernel[24 : 24 + length], kernel[24 + length : -64]
    code = _ATTRIBUTES.sub(rb'\1"target-cpu"="%s" ' % WIDE.encode(), code)
    parts = told + code
    lengths = length.to_bytes(8, "little") + len(code).to_bytes(8, "little")
    return kernel[:8] + lengths + parts + hashlib.sha256(parts).hexdigest().encode()
