"""Single files, written as a whole, and names that are valid on every system."""

from __future__ import annotations

import contextlib
import csv
import json
import math
import os
import re
import secrets
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

LEFTOVER = re.compile(r"\..+\.[0-9a-f]{8}\.partial(\..+)?$")
"""Names from `partial_name`; such a file, if it remains, is left by a killed process."""


def drop_name(number: int) -> str:
    """Name of the folder of a drop in a series, counted from 1."""
    return f"drop-{number}"


def partial_name(path: Path) -> Path:
    """A name beside `path` for a file that is incomplete, or about to be removed."""
    return path.with_name(f".{path.stem}.{secrets.token_hex(4)}.partial{path.suffix}")


@contextlib.contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """Write a file as a whole: the block writes to the yielded path, which is renamed to `path`.

    If the block fails, nothing is left, and an older file stays unchanged. Raises OSError.
    """
    partial = partial_name(path)
    try:
        yield partial
        synced(partial)
        os.replace(partial, path)
    finally:
        partial.unlink(missing_ok=True)


def synced(path: Path) -> None:
    """Flush a file to disk, so that it survives a crash of the machine. Raises OSError."""
    with path.open("rb") as file:
        os.fsync(file.fileno())


def file_name(name: str) -> str:
    """A scene's name as a folder name: letters, digits and .+- stay, all else becomes -."""
    return re.sub(r"[^\w.+-]+", "-", name).strip("-.") or "scene"


def next_numbered(stem: Path, suffix: str = "", digits: int = 3, first: int = 1) -> Path:
    """`STEM-001SUFFIX`, or with the next number after the highest existing one."""
    names = [path.name for path in stem.parent.iterdir()] if stem.parent.is_dir() else []
    tails = (
        name[len(stem.name) + 1 : len(name) - len(suffix)]
        for name in names
        if name.startswith(f"{stem.name}-") and name.endswith(suffix)
    )
    number = max((int(tail) + 1 for tail in tails if tail.isdecimal()), default=first)
    return stem.with_name(f"{stem.name}-{max(number, first):0{digits}}{suffix}")


def write_json(path: Path, value: Any) -> None:
    """Write JSON, indented; NumPy values become plain ones, NaN and infinity become null."""
    text = json.dumps(plain(value), indent=2, allow_nan=False, ensure_ascii=False)
    path.write_text(text + "\n", encoding="utf-8")


def write_csv(path: Path, columns: Mapping[str, Iterable[Any]]) -> None:
    """Write named columns of equal length; floats read back exactly. Raises OSError."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(columns)
        writer.writerows(zip(*columns.values(), strict=True))


def write_rows(path: Path, rows: Sequence[Mapping[str, Any]]) -> None:
    """Write rows that have the same keys as a CSV. Raises OSError."""
    write_csv(path, {key: [row[key] for row in rows] for key in rows[0]})


def plain(value: Any, digits: int | None = None) -> Any:
    """A value that JSON can hold: NumPy values become Python's, non-finite ones None.

    Floats are rounded to `digits` significant digits; None: not rounded.
    """
    if isinstance(value, dict):
        return {str(key): plain(item, digits) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(item, digits) for item in value]
    if isinstance(value, (np.generic, np.ndarray)):
        return plain(value.tolist(), digits)
    if isinstance(value, float):
        if not math.isfinite(value):
            return None
        return value if digits is None else float(f"{value:.{digits}g}")
    return value
