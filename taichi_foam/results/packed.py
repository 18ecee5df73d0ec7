"""What a zip of NumPy arrays holds, told from its directory and headers before it is unpacked.

A few kilobytes can say that they unpack to terabytes, and an array of objects is a program.
"""

from __future__ import annotations

import math
import zipfile
from collections.abc import Mapping
from pathlib import Path

import numpy as np


def check_shapes(path: Path, shapes: Mapping[str, tuple[int, ...]], most: int) -> None:
    """Check arrays of numbers (n, *shape), with one n of at most `most` for all of them, and that
    `format` is one number.

    Raises ValueError: another shape, type or size than that. KeyError: an array is missing.
    zipfile.BadZipFile, OSError: no zip file, or an unreadable one.
    """
    counts = set()
    with zipfile.ZipFile(path) as archive:
        if _shape(archive, "format") != ():
            raise ValueError(f"format in {path.name} is no number")
        for name, shape in shapes.items():
            found = _shape(archive, name)
            if found[:1] == () or found[1:] != shape:
                raise ValueError(f"{name} in {path.name} has the shape {found}")
            counts.add(found[0])
    if len(counts) > 1:
        raise ValueError(f"arrays in {path.name} differ in length")
    if counts and max(counts) > most:
        raise ValueError(
            f"{path.name} holds {max(counts):,} instants; the scene gives {most:,} at most"
        )


def check_numbers(path: Path, shapes: Mapping[str, tuple[int, ...]]) -> None:
    """Check arrays of numbers of these shapes. Raises as `check_shapes`."""
    with zipfile.ZipFile(path) as archive:
        for name, shape in {"format": (), **shapes}.items():
            if (found := _shape(archive, name)) != shape:
                raise ValueError(f"{name} in {path.name} has the shape {found}")


def _shape(archive: zipfile.ZipFile, name: str) -> tuple[int, ...]:
    """Shape of an array of numbers, whose size in the zip must be what the shape takes."""
    entry = archive.getinfo(f"{name}.npy")
    with archive.open(entry) as file:
        version = np.lib.format.read_magic(file)
        read = {
            (1, 0): np.lib.format.read_array_header_1_0,
            (2, 0): np.lib.format.read_array_header_2_0,
        }.get(version)
        if read is None:
            raise ValueError(f"{name} has the unknown version {version} of NumPy's format")
        shape, _, dtype = read(file)
        header = file.tell()
    if dtype.kind not in "fi":
        raise ValueError(f"{name} has no numbers but {dtype}")
    if entry.file_size != header + math.prod(shape) * dtype.itemsize:
        raise ValueError(f"{name} is cut, or longer than its shape {shape}")
    return shape
