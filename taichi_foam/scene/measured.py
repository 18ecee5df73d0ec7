"""Compression tests in CSV files: columns of strain and stress, in the header's units."""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from taichi_foam.errors import UserError
from taichi_foam.laws.bond import Curve
from taichi_foam.scene.messages import shown

Array = NDArray[np.float64]

STRAIN_UNITS = {"-": 1.0, "1": 1.0, "mm/mm": 1.0, "m/m": 1.0, "%": 0.01, "percent": 0.01}
STRESS_UNITS = {
    "pa": 1.0, "n/m2": 1.0, "n/m^2": 1.0, "kpa": 1e3, "mpa": 1e6, "n/mm2": 1e6, "n/mm^2": 1e6,
    "gpa": 1e9, "bar": 1e5, "psi": 6894.757293168361,
}  # fmt: skip
"""What a number is multiplied by to be a fraction, or to be in Pa."""

MOST_BYTES = 20_000_000

COLUMN_KEYS = ("strain", "stress", "strain_unit", "stress_unit")
"""What a scene may say of a file, see `Columns`."""

FINEST = 500
"""A test of more points is read as means of so many equal parts of its strain."""

_WORDS = {"strain": ("strain", "epsilon", "eps", "ε"), "stress": ("stress", "sigma", "σ")}
IN_BRACKETS = re.compile(r"[\[(]\s*([^\])]+?)\s*[\])]")
_NUMBER = re.compile(r"[-+]?(\d+([.,]\d*)?|[.,]\d+)([eE][-+]?\d+)?$")


@dataclass(frozen=True)
class Columns:
    """Which columns of a file hold the test, by name or by number from 1, and their units.

    None: as the header says; without a header the first two, as fractions and in Pa.
    """

    strain: str | int | None = None
    stress: str | int | None = None
    strain_unit: str | None = None
    stress_unit: str | None = None


@dataclass(frozen=True)
class CompressionTest:
    """A test as its file has it, and the curve that is made of it.

    strain, stress  every point, compression positive, as fractions and in Pa (n,)
    units           as the file or `Columns` say them, by strain and stress; None: neither does
    curve           what a foam takes: thinned where there are many points, and never falling
    """

    strain: Array
    stress: Array
    units: Mapping[str, str | None]
    curve: Curve


def curve_of(curve: Any, key: str, folder: Path) -> Any:
    """Raw data of a curve under a key, read from its file if it names one.

    `folder` is where relative names begin. Raises ValueError, in whole sentences.
    """
    if isinstance(curve, str | Path):
        curve = {"file": curve}
    if "file" not in curve:
        return curve
    unknown = sorted(curve.keys() - {"file", *COLUMN_KEYS})
    if unknown:
        raise ValueError(
            f"{key}.{unknown[0]}: unknown key; beside a file there are {', '.join(COLUMN_KEYS)}"
        )
    if not isinstance(curve["file"], str | Path):
        raise ValueError(f"{key}.file = {shown(curve['file'])}: must be the name of a file")
    options = {name: curve[name] for name in COLUMN_KEYS if name in curve}
    for name, value in options.items():
        if not isinstance(value, str) and not (type(value) is int and "unit" not in name):
            raise ValueError(f"{key}.{name} = {shown(value)}: must be text")
    try:
        return read_curve(folder / curve["file"], Columns(**options))
    except UserError as error:
        raise ValueError(f"{key}: {error}") from None


def read_curve(path: Path, columns: Columns | None = None) -> Curve:
    """The curve of a compression test; arguments and errors as of `read_test`."""
    return read_test(path, columns).curve


def read_test(path: Path, columns: Columns | None = None, finest: int = FINEST) -> CompressionTest:
    """A compression test in a CSV file (comma, semicolon, tab or spaces between).

    Lines that begin with `#` are left out. A test of more than `finest` points is read as means of
    so many equal parts of its strain. Raises UserError with file, line and value: unreadable, text
    or NaN where a number should be, unknown units, and whatever a `Curve` refuses.
    """
    columns = columns or Columns()
    rows = read_rows(path)
    heads = None if all(is_number(cell) for cell in rows[0][1] if cell) else rows[0][1]
    body = rows if heads is None else rows[1:]
    if heads is not None and len(body) > 1 and not any(is_number(c) for c in body[0][1] if c):
        heads, body = [" ".join(pair) for pair in zip(heads, body[0][1], strict=False)], body[1:]
    if not body:
        raise UserError(f"{path}: no numbers; needs lines of strain and stress below the header")
    at = {key: _column(path, heads, key, getattr(columns, key)) for key in _WORDS}
    if at["strain"] == at["stress"]:
        raise UserError(
            f"{path}: strain and stress are both column {at['strain'] + 1}; name two columns"
        )
    units = {"strain": STRAIN_UNITS, "stress": STRESS_UNITS}
    values, said = {}, {}
    for key, known in units.items():
        given = getattr(columns, f"{key}_unit")
        unit = given if given is not None else _unit(heads, at[key])
        if unit is not None and unit.lower().replace("²", "2") not in known:
            where = f"{key}_unit" if given is not None else f"the header of column {at[key] + 1}"
            raise UserError(
                f"{path}: {where}: unit {shown(unit)}; must be one of {', '.join(known)}"
            )
        said[key] = unit
        factor = 1.0 if unit is None else known[unit.lower().replace("²", "2")]
        values[key] = factor * np.array([number_in(path, line, row, at[key]) for line, row in body])
    _check_order(path, body, values["strain"])
    strain, stress = _thinned(values["strain"], values["stress"], finest)
    try:
        curve = Curve(strain=tuple(strain.tolist()), stress=tuple(stress.tolist()))
    except ValidationError as error:
        told = str(error.errors()[0].get("ctx", {}).get("error", error))
        raise UserError(f"{path}: {told.removeprefix('foam.curve').lstrip(':. ')}") from None
    upright = {key: -all_ if -all_.min() > all_.max() else all_ for key, all_ in values.items()}
    return CompressionTest(upright["strain"], upright["stress"], said, curve)


def read_rows(path: Path, needs: str = "strain and stress") -> list[tuple[int, list[str]]]:
    """Number and cells of each line that says something. Raises UserError: it cannot be read."""
    try:
        if path.stat().st_size > MOST_BYTES:
            raise UserError(f"{path}: more than {MOST_BYTES:,} bytes; thin it out")
        text = path.read_text(encoding="utf-8-sig")
    except OSError as error:
        raise UserError(f"{path}: cannot be read: {error.strerror}") from None
    except ValueError as error:
        if not isinstance(error, UnicodeDecodeError):
            raise UserError(f"{shown(str(path))}: no file can have this name") from None
        raise UserError(
            f"{path}: not UTF-8 text (byte {error.start}); save it as CSV in UTF-8"
        ) from None
    lines = [
        (number, line.strip())
        for number, line in enumerate(text.splitlines(), 1)
        if line.strip() and not line.lstrip().startswith("#")
    ]
    if not lines:
        raise UserError(f"{path}: empty; needs lines of {needs}")
    between = _separator([line for _, line in lines[:20]])
    if between is None:
        return [(number, line.split()) for number, line in lines]
    return [(number, _cells(path, number, line, between)) for number, line in lines]


def _cells(path: Path, number: int, line: str, between: str) -> list[str]:
    """The cells of a line. A quote that is not closed ends with it."""
    try:
        (cells,) = csv.reader([line], delimiter=between, skipinitialspace=True)
    except csv.Error as error:
        raise UserError(f"{path}, line {number}: not CSV ({error}); remove the line") from None
    return [cell.strip() for cell in cells]


def _separator(lines: Sequence[str]) -> str | None:
    """What stands between the cells; None: spaces. A comma may be that of decimals."""
    for mark in (";", "\t"):
        if all(mark in line for line in lines):
            return mark
    return "," if all("," in line for line in lines) else None


def is_number(cell: str) -> bool:
    """Whether a cell holds a number, finite or not."""
    return _NUMBER.match(cell) is not None or cell.lower().lstrip("+-") in ("nan", "inf")


def _column(path: Path, heads: Sequence[str] | None, key: str, given: str | int | None) -> int:
    """The place of the column of strain or stress, from 0."""
    if isinstance(given, int):
        if not 1 <= given <= (len(heads) if heads else 1000):
            raise UserError(f"{path}: {key} = {given}: no such column; columns count from 1")
        return given - 1
    if heads is None:
        if given is not None:
            raise UserError(
                f"{path}: {key} = {shown(given)}: the file has no header; give the column's number"
            )
        return list(_WORDS).index(key)
    if given is not None:
        plain = [IN_BRACKETS.sub("", head).strip().lower() for head in heads]
        found = [n for n, head in enumerate(plain) if given.lower() == head]
        found = found or [n for n, head in enumerate(heads) if given.lower() in head.lower()]
    else:
        words = _WORDS[key]
        found = [n for n, head in enumerate(heads) if any(w in head.lower() for w in words)]
    if len(found) != 1:
        listed = ", ".join(shown(head) for head in heads)
        many = "no column" if not found else f"{len(found)} columns"
        raise UserError(
            f"{path}: {many} of {key} in the header ({listed}); name one, or give its number from 1"
        )
    return found[0]


def _unit(heads: Sequence[str] | None, at: int) -> str | None:
    """The unit in a header's brackets, or its last word; None where it says none."""
    if heads is None:
        return None
    bracketed = IN_BRACKETS.search(heads[at])
    if bracketed:
        return bracketed[1]
    *_, last = re.split(r"[\s_,/]+", heads[at].strip().lower()) or [""]
    return last if last in STRAIN_UNITS or last in STRESS_UNITS else None


def number_in(path: Path, line: int, cells: Sequence[str], at: int) -> float:
    """The number in a cell. Raises UserError: text, or not finite."""
    cell = cells[at] if at < len(cells) else ""
    try:
        value = float(cell.replace(",", "."))
    except ValueError:
        raise UserError(
            f"{path}, line {line}: {shown(cell)} in column {at + 1}: must be a number; remove the "
            "line, or begin it with #"
        ) from None
    if not math.isfinite(value):
        raise UserError(
            f"{path}, line {line}: {cell} in column {at + 1}: must be finite; remove the line"
        )
    return value


def _check_order(path: Path, body: Sequence[tuple[int, list[str]]], strain: Array) -> None:
    """That strains rise, or fall all the way where compression is negative."""
    falls = strain.size > 1 and strain[-1] < strain[0]
    steps = np.diff(-strain if falls else strain)
    if (steps > 0.0).all():
        return
    wrong = int(np.argmax(steps <= 0.0)) + 1
    word = "the same strain as" if steps[wrong - 1] == 0.0 else "a smaller strain than"
    raise UserError(
        f"{path}, line {body[wrong][0]}: {word} on the line before ({abs(strain[wrong]):g}); "
        "strains must rise from line to line; sort them, and cut the unloading off"
    )


def _thinned(strain: Array, stress: Array, finest: int) -> tuple[Array, Array]:
    """A test of many points as means over equal parts of its strain, first and last point kept."""
    if strain.size <= finest:
        return strain, stress
    part = np.clip(
        ((strain - strain[0]) / (strain[-1] - strain[0]) * finest).astype(int), 0, finest - 1
    )
    count = np.bincount(part, minlength=finest)
    there = count > 0
    means = [
        np.bincount(part, weights=values, minlength=finest)[there] / count[there]
        for values in (strain, stress)
    ]
    ends = strain[[0, -1]], stress[[0, -1]]
    return tuple(  # type: ignore[return-value]
        np.concatenate([end[:1], mean[1:-1], end[1:]])
        for mean, end in zip(means, ends, strict=True)
    )
