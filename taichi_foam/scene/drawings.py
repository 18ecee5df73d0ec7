"""Outlines in CSV files: columns of x and y, in the header's unit."""

from __future__ import annotations

from pathlib import Path

from taichi_foam.errors import UserError
from taichi_foam.scene.csv_file import (
    IN_BRACKETS,
    number_in,
    read_rows,
    units_in_brackets,
)
from taichi_foam.scene.messages import shown
from taichi_foam.units import LENGTH_UNITS


def read_corners(path: Path) -> list[tuple[float, float]]:
    """The corners (x, y) [m] of an outline in a CSV file, in its order.

    The first two columns are x and y; a header may say their unit in brackets, without one it is
    metres. A last corner that repeats the first is left out. Lines that begin with `#` are too.
    Raises UserError with file, line and value: unreadable, no number, an unknown unit.
    """
    rows = read_rows(path, "x and y")
    factor = _factor(path, units_in_brackets(path, rows, LENGTH_UNITS))
    found = [
        (factor * number_in(path, line, cells, 0), factor * number_in(path, line, cells, 1))
        for line, cells in rows.body
    ]
    return found[:-1] if len(found) > 1 and found[0] == found[-1] else found


def _factor(path: Path, heads: list[str]) -> float:
    """Metres in the unit that a header says for both columns."""
    said = [IN_BRACKETS.search(head) for head in heads[:2]]
    units = {match[1].lower() for match in said if match}
    if not units:
        return 1.0
    if len(units) > 1 or None in said:
        raise UserError(
            f"{path}: the header must give x and y the same unit, such as x [mm],y [mm]"
        )
    (unit,) = units
    if unit not in LENGTH_UNITS:
        raise UserError(
            f"{path}: the header's unit {shown(unit)}: must be one of {', '.join(LENGTH_UNITS)}"
        )
    return LENGTH_UNITS[unit]
