"""Pulses of the base in CSV files: columns of time and acceleration, in the header's units."""

from __future__ import annotations

from pathlib import Path

from pydantic import ValidationError

from taichi_foam.errors import UserError
from taichi_foam.scene.csv_file import (
    IN_BRACKETS,
    number_in,
    plain_unit,
    read_rows,
    units_in_brackets,
)
from taichi_foam.scene.messages import shown
from taichi_foam.scene.pulse import Pulse
from taichi_foam.units import STANDARD_GRAVITY

UNITS = (
    {"s": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6},
    {"m/s2": 1.0, "m/s^2": 1.0, "g": STANDARD_GRAVITY},
)
"""What a number is multiplied by to be in s, or in m/s2, by the unit that a header says."""


def read_pulse(path: Path) -> Pulse:
    """The pulse of a CSV file: its first two columns are time and acceleration.

    A header may say their units in brackets, such as time [ms],acceleration [g], or in a line of
    their own; without one they are s and m/s2. Raises UserError with file, line and value.
    """
    rows = read_rows(path, "time and acceleration")
    heads = units_in_brackets(path, rows, {unit for known in UNITS for unit in known})
    factors = [_factor(path, heads, column) for column in range(2)]
    values = [
        tuple(factors[column] * number_in(path, line, cells, column) for line, cells in rows.body)
        for column in range(2)
    ]
    try:
        return Pulse(time=values[0], acceleration=values[1])
    except ValidationError as error:
        first = error.errors()[0]
        told = first.get("ctx", {}).get("error")
        if told is None:
            key, place = str(first["loc"][0]), first["loc"][-1]
            told = (
                f"{key} = {first['input']:g} in row {place + 1 if isinstance(place, int) else 1}: "
                f"must be {'0 to 10 s' if key == 'time' else '-1e6 to 1e6 m/s2'}; "
                "give units in the header, such as time [ms],acceleration [g]"
            )
        raise UserError(f"{path}: {told}") from None


def _factor(path: Path, heads: list[str], column: int) -> float:
    said = IN_BRACKETS.search(heads[column]) if column < len(heads) else None
    if said is None:
        return 1.0
    unit, known = plain_unit(said[1]), UNITS[column]
    if unit not in known:
        raise UserError(
            f"{path}: the header's unit {shown(said[1])}: must be one of {', '.join(known)}"
        )
    return known[unit]
