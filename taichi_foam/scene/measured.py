"""Compression tests in CSV files: strain and stress, or displacement and force of a specimen.

Units are taken from the header. The curve is the loading envelope; unloading and reloading are
separated from it.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from taichi_foam.errors import UserError
from taichi_foam.laws.bond import Curve
from taichi_foam.parts import is_number as is_finite
from taichi_foam.scene.csv_file import (
    Column,
    Kind,
    Row,
    Rows,
    column,
    named,
    plain_unit,
    read_rows,
    unit_in,
)
from taichi_foam.scene.messages import shown
from taichi_foam.units import FORCE_UNITS, LENGTH_UNITS, STRAIN_UNITS, STRESS_UNITS

Array = NDArray[np.float64]

FINEST = 500
"""A test with more points is averaged over this many equal intervals of strain."""

UNLOADING = 0.005
"""Smallest decrease of strain that counts as an unloading branch; smaller ones are noise."""

UNLOADED_WHOLLY = 0.1
"""A way back, which gives a foam's hysteresis, comes down to this part of its first stress."""

FEWEST = 5
"""Fewest points of a way back."""

UNLOADED = 0.75
"""On an unloading branch the stress falls at least to this fraction."""


STRAIN = Kind("strain", STRAIN_UNITS, "fractions", ("strain", "epsilon", "eps", "ε", "stauchung"))
STRESS = Kind("stress", STRESS_UNITS, "Pa", ("stress", "sigma", "σ", "spannung"))
DISPLACEMENT = Kind(
    "displacement",
    LENGTH_UNITS,
    "m",
    ("displacement", "extension", "crosshead", "stroke", "travel", "weg"),
)
FORCE = Kind("force", FORCE_UNITS, "N", ("force", "load", "kraft"))


_UNITS = {
    "", "s", "ms", "min",
    *STRAIN_UNITS, *STRESS_UNITS, *LENGTH_UNITS, *FORCE_UNITS,
}  # fmt: skip
"""Units that may occur in a line of units, including those of columns that are not read."""


@dataclass(frozen=True)
class Side:
    """One axis of a curve: a column of its values, or one to be divided by a specimen's size."""

    plain: Kind
    divided: Kind
    size: str
    unit: str
    least: float
    most: float
    example: str


_STRAINS = Side(STRAIN, DISPLACEMENT, "height", "m", 1e-4, 5.0, "lengths are in m (50 mm is 0.05)")
_STRESSES = Side(
    STRESS, FORCE, "area", "m2", 1e-6, 25.0, "areas are in m2 (50 mm x 50 mm is 2.5e-3)"
)


@dataclass(frozen=True)
class Columns:
    """The columns of a file that contain the test, by name or by number from 1, and their units.

    If the specimen's `height` [m] is given, the strain column contains displacement; if its `area`
    [m2] is given, the stress column contains force. None: from the header; without a header, the
    first two columns in SI units.
    """

    strain: str | int | None = None
    stress: str | int | None = None
    strain_unit: str | None = None
    stress_unit: str | None = None
    area: float | None = None
    height: float | None = None


COLUMN_KEYS = tuple(field.name for field in fields(Columns))
"""Keys by which a scene describes the columns of a file."""


@dataclass(frozen=True)
class Branch:
    """An unloading, with the reloading up to its start.

    start, lowest  its largest and smallest strain
    points         number of its points in the test
    """

    start: float
    lowest: float
    points: int


@dataclass(frozen=True)
class CompressionTest:
    """A test as in its file, and the curve made from it.

    strain, stress  all points (n,), compression positive, as fractions and in Pa
    loading         (n,) whether a point belongs to the curve: its strain exceeds all before it
    branches        unloading and reloading, which are not part of the curve
    columns         the columns of strain and stress
    encoding        the file's encoding
    skipped         number of lines of free text above the header
    curve           the foam's curve: thinned if there are many points, and never falling
    """

    strain: Array
    stress: Array
    loading: NDArray[np.bool_]
    branches: tuple[Branch, ...]
    columns: tuple[Column, Column]
    encoding: str
    skipped: int
    curve: Curve

    @property
    def way_back(self) -> tuple[Array, Array] | None:
        """Strain and stress of the unloading from the largest strain, down to its smallest strain.

        None if the test does not unload from there to a tenth of its stress.
        """
        at = int(np.flatnonzero(self.loading)[-1])
        strain, stress = self.strain[at:], self.stress[at:]
        end = int(np.argmin(strain)) + 1
        if end < FEWEST or stress[:end].min() > UNLOADED_WHOLLY * stress[0]:
            return None
        return strain[:end], stress[:end]


def curve_of(curve: Any, key: str, folder: Path) -> Any:
    """Raw data of a curve under a key, read from its file if it names one.

    Relative names are in `folder`. Raises ValueError, in whole sentences.
    """
    if isinstance(curve, str | Path):
        curve = {"file": curve}
    if "file" not in curve:
        return curve
    unknown = sorted(curve.keys() - {"file", *COLUMN_KEYS})
    if unknown:
        raise ValueError(
            f"{key}.{unknown[0]}: unknown key; the keys beside file are {', '.join(COLUMN_KEYS)}"
        )
    if not isinstance(curve["file"], str | Path):
        raise ValueError(f"{key}.file = {shown(curve['file'])}: must be the name of a file")
    options = {name: curve[name] for name in COLUMN_KEYS if name in curve}
    for name in options.keys() - {"area", "height"}:
        value = options[name]
        if not isinstance(value, str) and not (type(value) is int and "unit" not in name):
            raise ValueError(f"{key}.{name} = {shown(value)}: must be text")
    try:
        return read_curve(folder / curve["file"], Columns(**options))
    except UserError as error:
        raise ValueError(f"{key}: {error}") from None


def read_curve(path: Path, columns: Columns | None = None) -> Curve:
    """The curve of a compression test; arguments and errors as for `read_test`."""
    return read_test(path, columns).curve


def read_test(path: Path, columns: Columns | None = None, finest: int = FINEST) -> CompressionTest:
    """A compression test in a CSV file, with or without free text above its columns.

    Nominal strain is displacement over height, nominal stress is force over area. The curve is the
    loading envelope: the points whose strain exceeds all before. If it has more than `finest`
    points, it is averaged over that many equal intervals of strain. Raises UserError with file,
    line and value: unreadable, text or NaN in place of a number, unknown units, missing or invalid
    sizes, strains that decrease without unloading, and whatever a `Curve` refuses.
    """
    columns = columns or Columns()
    rows = read_rows(path, "strain and stress")
    heads, lines_of_header = rows.header(_UNITS)
    found = (
        _column(path, rows, heads, _STRAINS, columns.strain, columns.strain_unit, columns.height),
        _column(path, rows, heads, _STRESSES, columns.stress, columns.stress_unit, columns.area),
    )
    if found[0].number == found[1].number:
        raise UserError(
            f"{path}: strain and stress are both column {found[0].number}; name two columns"
        )
    strain, stress = (_upright(each.values) for each in found)
    loading = _loading(strain)
    branches = _branches(path, rows.body, strain, stress, loading)
    thinned = _thinned(strain[loading], stress[loading], finest)
    try:
        curve = Curve(strain=tuple(thinned[0].tolist()), stress=tuple(thinned[1].tolist()))
    except ValidationError as error:
        told = str(error.errors()[0].get("ctx", {}).get("error", error))
        told = told.removeprefix("foam.curve").lstrip(":. ")
        if heads is None:
            told += "; a first line such as strain [%],stress [kPa] names other units"
        raise UserError(f"{path}: {told}") from None
    skipped = len(rows.above) - lines_of_header
    return CompressionTest(strain, stress, loading, branches, found, rows.encoding, skipped, curve)


def _column(
    path: Path,
    rows: Rows,
    heads: Sequence[str] | None,
    side: Side,
    given: str | int | None,
    unit: str | None,
    size: float | None,
) -> Column:
    """The column of strain or displacement, or of stress or force. Raises UserError."""
    key, kind = side.plain.name, side.plain if size is None else side.divided
    if size is not None and not (is_finite(size) and side.least <= size <= side.most):
        raise UserError(
            f"{path}: {side.size} = {shown(size)}: must be a number from {side.least:g} to "
            f"{side.most:g} {side.unit}; {side.example}"
        )
    divided = [] if heads is None else side.divided.known_in(heads)
    if heads and divided and given is None and size is None and not kind.known_in(heads):
        raise UserError(
            f"{path}: column {divided[0] + 1} ({shown(heads[divided[0]])}) holds "
            f"{side.divided.name}; {key} also needs the specimen's {side.size} [{side.unit}]: give "
            f"--{side.size} to `foam import`, or foam.curve.{side.size} in a scene"
        )
    at = _place(path, heads, key, kind, given)
    head = None if heads is None else heads[at]
    where = None if unit is None else f"{key}_unit"
    said = _unit(head, kind) if unit is None else unit
    return column(path, rows, kind, at, said, where, head, size)


def _place(
    path: Path, heads: Sequence[str] | None, key: str, kind: Kind, given: str | int | None
) -> int:
    """The index of a column, from 0. Raises UserError: there is none, or there are several."""
    if isinstance(given, int):
        if not 1 <= given <= (len(heads) if heads else 1000):
            raise UserError(f"{path}: {key} = {given}: no such column; columns count from 1")
        return given - 1
    if heads is None:
        if given is not None:
            raise UserError(
                f"{path}: {key} = {shown(given)}: the file has no header; give the column's number"
            )
        return 0 if key == STRAIN.name else 1
    found = kind.known_in(heads) if given is None else named(heads, given)
    if len(found) != 1:
        listed = ", ".join(shown(head) for head in heads)
        many = "no column" if not found else f"{len(found)} columns"
        raise UserError(
            f"{path}: {many} of {kind.name} in the header ({listed}); name one with {key}, or give "
            "its number from 1"
        )
    return found[0]


def _unit(head: str | None, kind: Kind) -> str | None:
    """The unit in a header's brackets, or its last word; None if it has none."""
    if head is None:
        return None
    if unit := unit_in(head):
        return unit
    words = (re.split(between, head.strip())[-1] for between in (r"[\s_,]+", r"[\s_,/]+"))
    return next((word for word in words if plain_unit(word) in kind.units), None)


def _upright(values: Array) -> Array:
    """Values with compression positive, whatever the sign of noise."""
    return -values if -values.min() > values.max() else values


def _loading(strain: Array) -> NDArray[np.bool_]:
    """Which points have a larger strain than all before."""
    before = np.maximum.accumulate(strain)[:-1]
    return np.append(True, strain[1:] > before)


def _branches(
    path: Path, body: Sequence[Row], strain: Array, stress: Array, loading: NDArray[np.bool_]
) -> tuple[Branch, ...]:
    """The unloading branches of a test. Raises UserError: strains decrease without unloading."""
    starts = [int(n) for n in np.flatnonzero(loading)]
    ends = [*starts[1:], strain.size]
    found = []
    for start, end in zip(starts, ends, strict=True):
        inside = slice(start + 1, end)
        if end - start < 2 or strain[start] - strain[inside].min() < UNLOADING:
            continue
        if stress[inside].min() > UNLOADED * stress[start]:
            wrong = start + 1 + int(np.argmax(strain[inside] < strain[start]))
            raise UserError(
                f"{path}, line {body[wrong][0]}: the strain is smaller than on an earlier line "
                f"({strain[start]:g}), but the stress does not fall as in unloading; strains must "
                "rise from line to line except in unloading; sort the lines, or correct the strain"
            )
        found.append(Branch(float(strain[start]), float(strain[inside].min()), end - start - 1))
    if len(starts) < 2 <= strain.size:
        raise UserError(
            f"{path}, line {body[0][0]}: the largest strain is on the first line; strains must "
            "rise from line to line; sort the lines"
        )
    return tuple(found)


def _thinned(strain: Array, stress: Array, finest: int) -> tuple[Array, Array]:
    """A test of many points averaged over equal intervals of strain; both end points are kept."""
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
