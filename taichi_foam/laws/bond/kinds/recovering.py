"""Foam that springs back: its measured curve, a return with hysteresis, a set that recovers, gas.

Loading follows the curve. From its most compressive strain e_m a bond returns, and is loaded again
up to there, along the curve times a factor; gas in the cells acts beside that. The equations are in
docs/model.md, Foam that springs back:

    s = s_0(x) (1 - (1 - HU) (1 - (W(x) / W(e_m))^SHAPE)),    x = (e - S e_m) / (1 - S)

Kernels compute no power: the factor's one falls apart into s_0 W^SHAPE at the two strains, and the
gas's is one of the strain alone; both are columns of the table, with the areas under them.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import model_validator

from taichi_foam.backend import ti
from taichi_foam.formulas.energy import absorbed_energy
from taichi_foam.laws import elementary
from taichi_foam.laws.bond import by_curve
from taichi_foam.laws.bond.base import TABLE_COLUMNS, TABLE_ROWS, History
from taichi_foam.laws.bond.by_curve import ByCurve, CurveFoam
from taichi_foam.laws.bond.curve import STRESS, UNLOADING
from taichi_foam.parts import Control, quantity

Array = NDArray[np.float64]

BACK, TAKEN, BACK_TAKEN, DENSE, DENSE_TAKEN = range(TABLE_COLUMNS, TABLE_COLUMNS + 5)
"""Columns of the table after those of every curve: the curve times the area under it to the power
SHAPE, relative to the last row's; the area under the curve [J/m3]; that under BACK; the pressure of
the gas over that at rest, if none has leaked; the area under it."""

LEAST_PORES = 0.02
"""Below this part of its volume at rest the gas keeps its pressure, so that a trial stage which
goes too far stays finite."""

NOTHING = 1e-290
"""A positive number below any that counts."""


class RecoveringFoam(CurveFoam):
    """Parameters of a foam that springs back, from a measured compression curve."""

    law: Literal["recovering"] = "recovering"
    unless_given: ClassVar[Mapping[str, str]] = MappingProxyType(
        {
            **CurveFoam.unless_given,
            "hysteresis_factor": "with the shape of 2: half of the energy taken is given back",
            "hysteresis_shape": "with the factor of 0.25: half of the energy taken is given back",
            "permanent_set": "none: it comes back to its whole height",
            "recovery_time": "none: a set does not recover between drops",
        }
    )
    controls: ClassVar[tuple[Control, ...]] = (
        *CurveFoam.controls,
        Control("hysteresis_factor", "hysteresis factor", 0.01, 1, 0.01),
        Control("hysteresis_shape", "hysteresis shape", 0.1, 20, 0.1, log=True),
        Control("permanent_set", "permanent set", 0, 0.9, 0.01),
        Control("gas_pressure", "gas pressure", 0, 200, 1, "kPa", 1e3),
        Control("gas_leak_time", "gas leak time", 1, 1000, 1, "ms", 1e-3, log=True),
    )
    hysteresis_factor: float = quantity(
        0.25,
        "-",
        "HU: on the way back the stress tends to this part of the loading curve's; 1: no loss",
        at_least=0.001,
        at_most=1,
    )
    hysteresis_shape: float = quantity(
        2.0,
        "-",
        "SHAPE: how soon it does; (1 + SHAPE HU) / (1 + SHAPE) of the energy is given back",
        at_least=0.1,
        at_most=20,
    )
    permanent_set: float = quantity(
        0.0, "-", "part of the most compressive strain that remains as a set", at_least=0,
        at_most=0.9, fix="it is a part of the largest compression (10 % is 0.10)",
    )  # fmt: skip
    recovery_time: float | None = quantity(
        None,
        "s",
        "time in which, between drops, the set and the memory of the largest compression fall to "
        "1/e (start.wait is the time between drops); none: they do not",
        at_least=1e-3,
        at_most=1e9,
    )
    gas_pressure: float = quantity(
        0.0,
        "Pa",
        "absolute pressure of the gas in closed cells at rest; its rise under compression is added "
        "to the curve; 0: there is none, or the curve includes it (air: 101325)",
        at_least=0,
        at_most=1e7,
    )
    solid_fraction: float = quantity(
        0.03,
        "-",
        "of closed cells: volume of the solid over that of the foam, its relative density",
        above=0,
        at_most=0.5,
        fix="it is the density of the foam over that of its solid (3 % is 0.03)",
    )
    gas_exponent: float = quantity(
        1.4,
        "-",
        "of closed cells: power of the compression with which the gas's pressure rises; 1: "
        "isothermal, 1.4: adiabatic air",
        at_least=1,
        at_most=1.4,
    )
    gas_leak_time: float | None = quantity(
        None,
        "s",
        "of closed cells: time in which an excess of gas falls to 1/e through the walls; none: it "
        "does not leak",
        at_least=1e-4,
        at_most=1e9,
    )

    @model_validator(mode="after")
    def _check_gas(self) -> "RecoveringFoam":
        if self.gas_pressure and self.solid_fraction + self.curve.tested >= 1.0:
            raise ValueError(
                f"foam.solid_fraction = {self.solid_fraction:g}: must be below "
                f"{1.0 - self.curve.tested:.3g}, what foam.curve leaves of the foam at its end"
            )
        return self

    @property
    def given_back(self) -> float:
        """Energy returned over the energy taken, of the curve alone."""
        factor, shape = self.hysteresis_factor, self.hysteresis_shape
        return (1.0 - self.permanent_set) * (1.0 + shape * factor) / (1.0 + shape)

    @property
    def recovers(self) -> bool:
        return self.recovery_time is not None or self._leaks

    @property
    def _leaks(self) -> bool:
        return bool(self.gas_pressure) and self.gas_leak_time is not None

    def permanent_strain(self, worst: Array) -> Array:
        return self.permanent_set * np.minimum(worst, 0.0)

    def rested(self, worst: Array, own: Mapping[str, Array], time: float) -> dict[str, Array]:
        """The set and its memory fall exponentially, and gas flows to where it is lacking."""
        faded = worst
        if self.recovery_time is not None:
            faded = worst * np.exp(-time / self.recovery_time)
        found = {"worst": faded}
        if self._leaks and self.gas_leak_time is not None:
            dense = self._dense(-self.permanent_strain(faded))
            excess = 1.0 - own["lost"] - 1.0 / dense
            fading = np.exp(-time * dense / self.gas_leak_time)
            found["lost"] = 1.0 - 1.0 / dense - excess * fading
        return found

    def loading(self, strain: Array) -> Array:
        return super().loading(strain) + self.gas_stress(strain)

    def gas_stress(self, strain: Array) -> Array:
        """Stress [Pa] of the gas, none of which has leaked; compression positive.

        Isothermal it is p e / (1 - e - solid_fraction) (Gibson & Ashby 1997).
        """
        return self.gas_pressure * (self._dense(strain) - 1.0)

    def _dense(self, strain: Array) -> Array:
        """Pressure of the gas over that at rest, if none has leaked; compression positive."""
        pores = (1.0 - strain - self.solid_fraction) / (1.0 - self.solid_fraction)
        return np.maximum(pores, LEAST_PORES) ** -self.gas_exponent

    @property
    def table(self) -> Array:
        """The curve's table, and the columns from BACK on.

        The slope of unloading is a bound for all the way back from there: those of the curve and of
        BACK up to there, over 1 - S, plus that of the gas.
        """
        table = super().table
        strain = np.linspace(0.0, 1.0, TABLE_ROWS)
        stress, factor = table[:, STRESS], self.hysteresis_factor
        taken = absorbed_energy(strain, stress)
        back = stress * (taken / taken[-1]) ** self.hysteresis_shape
        dense = self._dense(strain)
        times = np.divide(stress, back, out=np.zeros_like(stress), where=back > 0.0)
        times[0] = times[1]  # both are straight lines from rest
        bound = factor * _steepest(strain, stress) + (1 - factor) * times * _steepest(strain, back)
        bound = np.maximum.accumulate(bound) / (1.0 - self.permanent_set)
        table[:, UNLOADING] = bound + self.gas_pressure * _steepest(strain, dense)
        more = (back, taken, absorbed_energy(strain, back), dense, absorbed_energy(strain, dense))
        return np.column_stack([table, *more])

    @property
    def unloads_with(self) -> float:
        return max(self.youngs_modulus, float(self.table[1, UNLOADING]))

    def law_for(self, model: Any) -> "Recovering":
        gas = self.gas_pressure > 0.0
        return Recovering(
            gas=gas, isothermal=self.gas_exponent == 1.0, heeds_rate=self._leaks,
            **self.options(model),
        )  # fmt: skip

    def constants(self, model: Any) -> dict[str, float]:
        own = {name: getattr(self, name) or 0.0 for name in _OWN}
        return super().constants(model) | own


_OWN = (
    "hysteresis_factor",
    "hysteresis_shape",
    "permanent_set",
    "unloads_with",
    "gas_pressure",
    "solid_fraction",
    "gas_exponent",
    "gas_leak_time",
)
_Constants = ti.types.struct(**by_curve.Constants.members, **dict.fromkeys(_OWN, ti.f64))


def _steepest(strain: Array, values: Array) -> Array:
    """The largest slope of a column up to the row after each."""
    slopes = np.diff(values) / np.diff(strain)
    return np.maximum.accumulate(np.append(slopes, slopes[-1]))


@ti.dataclass
class LeakyHistory:
    """What a bond remembers whose gas leaks: `lost` is the part of it that its cells lack."""

    worst: ti.f64
    lost: ti.f64


@dataclass(frozen=True)
class Recovering(ByCurve):
    """The law's functions, for one set of options.

    gas         there is gas in the cells
    isothermal  its exponent is 1
    heeds_rate  it leaks

    The other options are those of `Crushing`.
    """

    gas: bool = False
    isothermal: bool = False
    heeds_rate: bool = False

    Constants = _Constants
    table_columns = TABLE_COLUMNS + 5

    @property
    def History(self) -> Any:  # noqa: N802 - the record's name
        return LeakyHistory if self.heeds_rate else History

    @ti.func
    def unloading(self, c: ti.template(), e_min):
        """The set, and the slope in tension."""
        return c.permanent_set * elementary.smaller(e_min, 0.0), c.youngs_modulus

    @ti.func
    def stiffening(self, c: ti.template(), e, history: ti.template(), broken):
        """No stress, and a bound for the slope on the way back."""
        turn = elementary.smaller(self.turn_at(e, history), 0.0)
        slope, _ = self._looked_up(c, turn, UNLOADING)
        return 0.0 * e, slope

    @ti.func
    def largest_stiffness(self, c: ti.template()) -> ti.f64:
        return ti.max(c.unloads_with, c.crushed_tensile_stress / c.crushed_tensile_strain)

    @ti.func
    def _mapped(self, c: ti.template(), e, turn):
        """The strain of the curve that belongs to `e` on the way back from `turn`."""
        x = (e - c.permanent_set * turn) / (1.0 - c.permanent_set)
        return elementary.larger(elementary.smaller(x, 0.0), turn)

    @ti.func
    def _both(self, c: ti.template(), x):
        """The curve's stress [Pa] and BACK at a strain."""
        along = -x * (TABLE_ROWS - 1.0)
        row = self._row(along)
        along -= ti.cast(row, ti.f64)
        stress, next_stress = self._around(c, row, STRESS)
        back, next_back = self._around(c, row, BACK)
        return stress + along * (next_stress - stress), back + along * (next_back - back)

    @ti.func
    def _area(self, c: ti.template(), x, column: ti.template(), areas: ti.template()):
        """The area under a column up to a strain, by the column of areas: a parabola in a row."""
        along = -x * (TABLE_ROWS - 1.0)
        row = self._row(along)
        along -= ti.cast(row, ti.f64)
        here, following = self._around(c, row, column)
        area, _ = self._around(c, row, areas)
        width = ti.static(1.0 / (TABLE_ROWS - 1.0))
        return area + width * along * (here + 0.5 * along * (following - here))

    @ti.func
    def elastic_stress(self, c: ti.template(), e, e_min, permanent, slope):
        turn = elementary.smaller(e_min, 0.0)
        stress, back = self._both(c, self._mapped(c, e, turn))
        top, top_back = self._both(c, turn)
        returned = back * (top / elementary.larger(top_back, NOTHING))
        pressed = c.hysteresis_factor * stress + (1.0 - c.hysteresis_factor) * returned
        return ti.select(e > permanent, slope * (e - permanent), -pressed)

    @ti.func
    def elastic_energy(
        self, c: ti.template(), e: ti.f64, e_min: ti.f64, permanent: ti.f64, slope: ti.f64
    ) -> ti.f64:
        turn = elementary.smaller(e_min, 0.0)
        x = self._mapped(c, e, turn)
        top, top_back = self._both(c, turn)
        returned = self._area(c, x, BACK, BACK_TAKEN) * (top / ti.max(top_back, NOTHING))
        taken = self._area(c, x, STRESS, TAKEN)
        energy = c.hysteresis_factor * taken + (1.0 - c.hysteresis_factor) * returned
        return (1.0 - c.permanent_set) * energy

    @ti.func
    def stress_fraction(self, c: ti.template(), e, history: ti.template(), broken):
        numerator, divisor = self.skeleton_stress(c, e, history, broken)
        if ti.static(self.gas):
            dense, _ = self._looked_up(c, e, DENSE)
            inside = c.gas_pressure * (1.0 - self._amount(history) * dense)
            numerator += ti.select(broken, 0.0, inside) * divisor
        return numerator, divisor

    @ti.func
    def stored_energy(
        self, c: ti.template(), e: ti.f64, history: ti.template(), broken: ti.i32
    ) -> ti.f64:
        energy = self.skeleton_energy(c, e, history, broken)
        if ti.static(self.gas):  # noqa: SIM102 - the static test must stand alone
            if not broken:
                energy += self._gas_energy(c, e, history)
        return energy

    @ti.func
    def energy_lost_by_breaking(
        self, c: ti.template(), e: ti.f64, history: ti.template()
    ) -> ti.f64:
        return self.stored_energy(c, e, history, 0) - self.stored_energy(c, e, history, 1)

    # Gas: of the amount a over that at rest it has the pressure p a DENSE.

    @ti.func
    def _amount(self, history: ti.template()):
        amount = 1.0 + 0.0 * history.worst
        if ti.static(self.heeds_rate):
            amount -= history.lost
        return amount

    @ti.func
    def _gas_energy(self, c: ti.template(), e: ti.f64, history: ti.template()) -> ti.f64:
        """Work [J/m3] that the gas could do against the pressure at rest.

        It is least, 0, where its own pressure is that; so gas that leaks only loses energy.
        """
        amount = self._amount(history)
        work = amount * self._area(c, e, DENSE, DENSE_TAKEN) + e
        if ti.static(self.heeds_rate):
            least = 1.0 - amount + amount * elementary.log(amount)
            if ti.static(not self.isothermal):
                pores = elementary.power(amount, 1.0 / c.gas_exponent)
                least = 1.0 - pores + (amount - pores) / (c.gas_exponent - 1.0)
            work += (1.0 - c.solid_fraction) * least
        return c.gas_pressure * work

    @ti.func
    def flows(self, c: ti.template(), e, history: ti.template()):
        dense, _ = self._looked_up(c, e, DENSE)
        return ti.abs(self._amount(history) * dense - 1.0) > 1e-12

    @ti.func
    def flowed(self, c: ti.template(), e, history: ti.template(), time, slowed, around):
        """Gas leaks at the rate (pressure - 1) / leak time, at a constant strain to its end."""
        now = history
        dense, _ = self._looked_up(c, e, DENSE)
        excess = self._amount(history) - 1.0 / dense
        now.lost = 1.0 - 1.0 / dense - excess * elementary.exp(-time * dense / c.gas_leak_time)
        return now
