"""Own cushion tests: peaks measured in drops, to draw beside computed curves and compare with them.

A CSV file or pasted text with a row for each drop: drop height, thickness, static stress, peak
deceleration.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from taichi_foam.errors import UserError
from taichi_foam.scene.csv_file import IN_BRACKETS, Kind, Rows, column, read_rows, rows_in, unit_in
from taichi_foam.units import ACCELERATION_UNITS, LENGTH_UNITS, STANDARD_GRAVITY, STRESS_UNITS

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Array = NDArray[np.float64]

_KINDS = (
    Kind("drop height", LENGTH_UNITS, "m", ("height", "drop", "fall")),
    Kind("thickness", LENGTH_UNITS, "m", ("thick",)),
    Kind("static stress", STRESS_UNITS, "Pa", ("static", "stress", "loading")),
    Kind("peak", ACCELERATION_UNITS, "m/s2", ("peak", "decel", "accel", "g-value", "g value")),
)

_NEEDS = "drop height, thickness, static stress and peak"
_EXAMPLE = "height [cm],thickness [mm],static stress [kPa],peak [g]"

PASTED = "own tests"
"""The name of pasted tests, with which messages about them begin."""


@dataclass(frozen=True)
class OwnTests:
    """Measured drops, one value for each (n,).

    name       the file's; of pasted tests, PASTED
    height     drop height [m]
    thickness  of the cushion [m]
    static     static stress [Pa]
    g          peak deceleration [g], with the filter with which it was measured
    """

    name: str
    height: Array
    thickness: Array
    static: Array
    g: Array

    @property
    def rows(self) -> list[list[float]]:
        """All numbers: a row of drop height, thickness, static stress and peak for each drop."""
        return np.stack([self.height, self.thickness, self.static, self.g], axis=1).tolist()

    def alike(self, height: float, thickness: float) -> NDArray[np.bool_]:
        """Which tests (n,) have this drop height and this thickness, within 2 % each."""
        return (abs(self.height / height - 1.0) < 0.02) & (
            abs(self.thickness / thickness - 1.0) < 0.02
        )

    def draw(
        self, axis: Axes, which: NDArray[np.bool_], unit: float, colour: str, **look: Any
    ) -> None:
        """Draw some of the tests as diamonds over static stress; the axis' unit is `unit` [Pa]."""
        x, y = self.static[which] / unit, self.g[which]
        axis.plot(x, y, "D", color=colour, zorder=6, **look)


def read(path: Path) -> OwnTests:
    """The tests in a CSV file. Its header names the columns, with units in brackets.

    Raises UserError with file, line and value: unreadable, a missing column or unit, not a number,
    a value that is not above 0.
    """
    return _tests(path, path.name, read_rows(path, _NEEDS))


def pasted(text: str) -> OwnTests:
    """The tests in a text, as in a file. Raises UserError as `read`."""
    return _tests(PASTED, PASTED, rows_in(text, PASTED, _NEEDS))


def _tests(path: Path | str, name: str, rows: Rows) -> OwnTests:
    known = {"", *(unit for kind in _KINDS for unit in kind.units)}
    heads, _ = rows.header(known)
    if heads is None:
        raise UserError(f"{path}: has no header; its first line must be such as {_EXAMPLE}")
    found = []
    for kind in _KINDS:
        places = kind.known_in(heads)
        if kind is _KINDS[-1] and not places:
            places = [n for n, head in enumerate(heads) if IN_BRACKETS.sub("", head).strip() == "G"]
        if len(places) != 1:
            which = "no column" if not places else f"{len(places)} columns"
            raise UserError(
                f"{path}: {which} for the {kind.name} (a name with {kind.words[0]!r}); its first "
                f"line must be such as {_EXAMPLE}"
            )
        unit = unit_in(heads[places[0]])
        if unit is None and heads[places[0]].strip() != "G":
            raise UserError(
                f"{path}: column {places[0] + 1}, {heads[places[0]]!r}, has no unit; write one in "
                f"brackets, such as {_EXAMPLE}"
            )
        values = column(path, rows, kind, places[0], unit or "g").values
        if not (values > 0.0).all():
            line = rows.body[int(np.argmax(values <= 0.0))][0]
            raise UserError(
                f"{path}, line {line}: the {kind.name} must be above 0; correct the line, or begin "
                "it with # to leave it out"
            )
        found.append(values)
    height, thickness, static, peak = found
    return OwnTests(name, height, thickness, static, peak / STANDARD_GRAVITY)
