"""A copy of Taichi that compiles for one processor, whatever the maker's.

LLVM looks up the host in its table of processors: how many numbers a vector has, how far loops are
unrolled. So kernels that are made on two machines differ. In the copy, every processor in that
table is taken for Intel's Haswell, the first with AVX2.
"""

import ctypes
import os
import re
import shutil
import struct
from itertools import count
from pathlib import Path

PROCESSOR = b"haswell"

# An entry of LLVM 15's table (`SubtargetSubTypeKV`): pointer to the name, two sets of features of
# 256 bits each, pointer to the scheduling model.
ENTRY = struct.Struct("<Q32s32sQ")
RELATIVE = 8  # the kind of relocation that adds the load address (R_X86_64_RELATIVE)


def copy_for_one_processor(folder: Path) -> None:
    """Copy Taichi's package to `folder`, with PROCESSOR for every processor: Linux on x86-64 only.

    Raises LookupError if Taichi's library has no table as expected.
    """
    import taichi

    library, parts = _loaded()
    source = Path(taichi.__file__).parent
    copied = folder / source.name
    # links, since the package is large; only the library is changed
    shutil.copytree(source, copied, copy_function=os.symlink)
    target = copied / library.relative_to(source)
    target.unlink()
    target.write_bytes(_changed(library.read_bytes(), parts))


def _loaded() -> tuple[Path, list[tuple[int, int, int]]]:
    """Taichi's library, and its readable parts in memory: start, end, offset in the file."""
    lines = Path("/proc/self/maps").read_text().splitlines()
    found = [line.split(maxsplit=5) for line in lines if "/taichi_python" in line]
    parts = []
    for place, rights, offset, *_ in found:
        start, end = (int(each, 16) for each in place.split("-"))
        if rights.startswith("r"):
            parts.append((start, end, int(offset, 16)))
    return Path(found[0][5]), parts


def _changed(file: bytes, parts: list[tuple[int, int, int]]) -> bytes:
    """The library's file with the features and the model of PROCESSOR in every entry."""
    base = parts[0][0] - parts[0][2]
    places, own = _table(parts)
    _, features, tuned, model = ENTRY.unpack(ctypes.string_at(own, ENTRY.size))
    changed = bytearray(file)
    for address in places:
        start, _, offset = next(part for part in parts if part[0] <= address < part[1])
        at = address - start + offset
        changed[at + 8 : at + 72] = features + tuned
        # the pointer is written when the library is loaded, from a list of relocations
        entry = struct.pack("<QQ", address - base + 72, RELATIVE)
        where = file.find(entry)
        if where < 0:
            raise LookupError("the library has no such relocation")
        changed[where + 16 : where + 24] = struct.pack("<Q", model - base)
    return bytes(changed)


def _table(parts: list[tuple[int, int, int]]) -> tuple[list[int], int]:
    """Addresses of the table's entries, and that of PROCESSOR among them.

    The table is sorted by name. So it is where a pointer to the name of PROCESSOR is followed, at
    distances of an entry, by pointers to ever later names, and preceded by ever earlier ones.
    """
    memory = {start: ctypes.string_at(start, end - start) for start, end, _ in parts}
    names = [
        start + match.start() + 1
        for start, data in memory.items()
        for match in re.finditer(b"\0" + PROCESSOR + b"\0", data)
    ]

    def name_at(address: int) -> bytes | None:
        for start, data in memory.items():
            if start <= address < start + len(data) - 8:
                pointer = struct.unpack_from("<Q", data, address - start)[0]
                for begin, text in memory.items():
                    if begin <= pointer < begin + len(text):
                        word = text[pointer - begin : pointer - begin + 40].split(b"\0")[0]
                        return word if re.fullmatch(rb"[a-z0-9_\-]+", word) else None
        return None

    for name in names:
        for start, data in memory.items():
            for match in re.finditer(re.escape(struct.pack("<Q", name)), data):
                own = start + match.start()
                before: list[int] = []
                after: list[int] = []
                for found, sign in ((before, -1), (after, 1)):
                    last = PROCESSOR
                    for n in count(1):
                        here = name_at(own + sign * n * ENTRY.size)
                        if here is None or (here < last) != (sign < 0):
                            break
                        last = here
                        found.append(own + sign * n * ENTRY.size)
                if len(before) > 10 and len(after) > 10:
                    return [*before, own, *after], own
    raise LookupError("Taichi's library has no table of processors as expected")
