"""Foam by its measured curve: loading as tested, unloading, weak re-tension, failure.

Loading follows the table. From any strain that a bond has reached it unloads linearly: with the
slope K, as the paper's foam does, or with the steepest slope of the curve so far if that is larger.
"""

from dataclasses import dataclass
from typing import Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from taichi_foam.backend import ti
from taichi_foam.laws import elementary
from taichi_foam.laws.bond.base import TABLE_ROWS
from taichi_foam.laws.bond.by_curve import ByCurve, CurveFoam
from taichi_foam.laws.bond.curve import STRESS, UNLOADING


class TabulatedFoam(CurveFoam):
    """Parameters of a foam that stays crushed: it unloads with K or more steeply."""

    law: Literal["tabulated"] = "tabulated"
    implied_by: ClassVar[str | None] = "curve"

    def permanent_strain(self, worst: NDArray[np.float64]) -> NDArray[np.float64]:
        """Strain at which the unloading line from the curve at `worst` reaches zero stress."""
        turn, rows = np.minimum(worst, 0.0), np.linspace(0.0, 1.0, TABLE_ROWS)
        table = self.table
        stress, slope = (np.interp(-turn, rows, table[:, k]) for k in (STRESS, UNLOADING))
        return turn + stress / slope

    def law_for(self, model: Any) -> "Tabulated":
        return Tabulated(**self.options(model))


@dataclass(frozen=True)
class Tabulated(ByCurve):
    """The law's functions, for one set of options; see `Crushing`."""

    @ti.func
    def stiffening(self, c: ti.template(), e, history: ti.template(), broken):
        """No stress, since `unloading` includes all of it, and the slope of unloading."""
        _, slope = self.unloading(c, self.turn_at(e, history))
        return 0.0 * e, slope

    @ti.func
    def unloading(self, c: ti.template(), e_min):
        turn = elementary.smaller(e_min, 0.0)
        stress, _ = self._looked_up(c, turn, STRESS)
        slope, _ = self._looked_up(c, turn, UNLOADING)
        return turn + stress / slope, slope

    @ti.func
    def elastic_strain(self, c: ti.template(), e, e_min, permanent):
        return e - permanent
