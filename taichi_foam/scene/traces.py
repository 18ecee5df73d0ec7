"""Measured pulses in CSV files: time, and acceleration or force."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from taichi_foam.errors import UserError
from taichi_foam.scene.csv_file import Kind, Rows, column, named, plain_unit, read_rows, unit_in
from taichi_foam.scene.messages import shown
from taichi_foam.units import ACCELERATION_UNITS, FORCE_UNITS, TIME_UNITS

Array = NDArray[np.float64]

FEWEST = 10
"""Least number of samples; fewer do not show the form of a pulse."""

TIME = Kind("time", TIME_UNITS, "s")
ACCELERATION = Kind("acceleration", ACCELERATION_UNITS, "m/s2")
FORCE = Kind("force", FORCE_UNITS, "N")

_UNITS = {"", *TIME_UNITS, *ACCELERATION_UNITS, *FORCE_UNITS}


@dataclass(frozen=True)
class Trace:
    """A measured pulse, signs and zero as in its file.

    time    (n,) s, increasing
    values  (n,) m/s2 or N
    kind    "acceleration" or "force"
    head    header of the column of values
    """

    time: Array
    values: Array
    kind: str
    head: str


def read_trace(path: Path, channel: str | None = None) -> Trace:
    """A measured pulse in a CSV file whose header has units in brackets, `time [ms], accel [g]`.

    The column of time is the first one with a unit of time, that of values the one with a unit of
    acceleration or force; `channel` is its header, or a part of it, if there are several. Raises
    UserError with file, line and value: unreadable, no units, text or NaN in place of a number,
    fewer than FEWEST samples, times that do not rise, values that are all the same, or a largest
    value that is the first or the last.
    """
    rows = read_rows(path, "time, and acceleration or force")
    heads, _ = rows.header(_UNITS)
    units = [plain_unit(unit_in(head) or "") for head in heads or ()]
    if heads is None or not any(unit in TIME_UNITS for unit in units):
        raise UserError(
            f"{path}: no column with a unit of time in its header; needs a header with units in "
            f"brackets, such as time [ms], acceleration [g]; units of time are "
            f"{', '.join(TIME_UNITS)}"
        )
    clock = next(n for n, unit in enumerate(units) if unit in TIME_UNITS)
    at = _channel(path, heads, units, channel)
    kind = ACCELERATION if units[at] in ACCELERATION_UNITS else FORCE
    time = column(path, rows, TIME, clock, units[clock]).values
    values = column(path, rows, kind, at, units[at]).values
    _check(path, rows, time, values)
    return Trace(time, values, kind.name, heads[at])


def _channel(path: Path, heads: list[str], units: list[str], channel: str | None) -> int:
    """The index of the column of values, from 0. Raises UserError: there is none, or several."""
    found = [n for n, unit in enumerate(units) if unit in ACCELERATION_UNITS or unit in FORCE_UNITS]
    listed = ", ".join(shown(head) for head in heads)
    if channel is not None:
        found = named(heads, channel, among=found)
    if len(found) == 1:
        return found[0]
    what = "column with a unit of acceleration or force" + (
        "" if channel is None else f" and {shown(channel)} in its header"
    )
    if not found:
        raise UserError(
            f"{path}: no {what} ({listed}); needs a header with units in brackets, such as "
            "time [ms], acceleration [g]; units of values are "
            f"{', '.join((*ACCELERATION_UNITS, *FORCE_UNITS))}"
        )
    raise UserError(
        f"{path}: {len(found)} columns with a unit of acceleration or force ({listed}); name one "
        "with channel"
    )


def _check(path: Path, rows: Rows, time: Array, values: Array) -> None:
    lines = [line for line, _ in rows.body]
    if time.size < FEWEST:
        raise UserError(f"{path}: {time.size} samples; a pulse needs at least {FEWEST}")
    if not (np.diff(time) > 0.0).all():
        at = int(np.argmax(np.diff(time) <= 0.0)) + 1
        raise UserError(
            f"{path}, line {lines[at]}: the time {time[at]:g} s is not above that of the line "
            f"before, {time[at - 1]:g} s; times must rise from line to line; sort the lines, or "
            "write times with more digits"
        )
    top = int(np.argmax(np.abs(values)))
    if values.max() == values.min():
        raise UserError(f"{path}: no peak: all values are the same, {values[0]:g}")
    if top in (0, values.size - 1):
        raise UserError(
            f"{path}, line {lines[top]}: the {'last' if top else 'first'} value is the largest; a "
            "trace must begin before its pulse and end after it"
        )
