"""Common base of foams whose loading follows a measured curve, and defaults that follow from it."""

import contextlib
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from taichi_foam.backend import ti
from taichi_foam.laws import elementary
from taichi_foam.laws.bond.base import TABLE_ROWS, Landmarks
from taichi_foam.laws.bond.crushing import (
    PACKED,
    ROUNDING,
    UNLESS_GIVEN,
    Crushing,
    CrushingFoam,
)
from taichi_foam.laws.bond.curve import (
    CELLS_ENERGY,
    IN_CELLS,
    LOCKS,
    SHEAR,
    STRESS,
    UNLOADING,
    Curve,
)
from taichi_foam.parts import Control, completed, is_number, quantity

DAMPED = 0.005
"""Upper limit of dashpot stress over plateau stress per closing speed of a row of cells [s/m].

In a drop from one metre this is 2 % where one row crushes at a time, and zero at the peak.
"""

SHEAR_OVER_YOUNG = 3.0 / 8.0
"""Shear modulus over Young's modulus of cellular solids (Gibson & Ashby 1997)."""

SHEAR_OVER_PLATEAU = 0.6
"""Shear strength over plateau stress; the paper's foam: 84 over 139 kPa (Table 1)."""


LARGEST_LIMIT = 2.0
"""Largest allowed limit in strain."""

FROM_CURVE = "from the curve"


class CurveFoam(CrushingFoam):
    """Parameters of a foam with a measured compression curve, from which defaults follow."""

    unless_given: ClassVar[Mapping[str, str]] = MappingProxyType(
        {
            "youngs_modulus": "the steepest slope of the curve before densification",
            "shear_modulus": "3/8 of Young's modulus (Gibson & Ashby 1997)",
            "densification_strain": "where the energy efficiency of the curve is largest",
            "locking_strain": "three quarters of the way from the end of the curve to -1",
            "tensile_strain": "that of the plateau stress: as strong in tension as on the plateau",
            "shear_strain": "that of 0.6 times the plateau stress, as for the paper's foam",
            "crushed_tensile_fraction": "that of the paper's foam",
        }
        | UNLESS_GIVEN
    )
    controls: ClassVar[tuple[Control, ...]] = (
        *CrushingFoam.controls,
        Control("densification_strain", "densification", -0.94, -0.1, 0.01),
    )

    curve: Curve = Field(
        description="stress over strain in its compression test: a CSV file, with `strain_unit` "
        "and `stress_unit` if its header has no units, `strain` and `stress` to choose its "
        "columns, and the specimen's `area` [m2] and `height` [m] if these hold force and "
        "displacement; or lists",
        json_schema_extra={
            "allowed": 'a file name, { file = "...", strain_unit = "%", ... }, or '
            "{ strain = [...], stress = [...] } in Pa",
            "fix": "give a compression test of the foam",
        },
    )
    youngs_modulus: float = quantity(
        ...,
        "Pa",
        "Young's modulus K, at least the curve's steepest slope before densification",
        at_least=1000,
        at_most=1e11,
        unless=FROM_CURVE,
    )
    shear_modulus: float = quantity(
        ..., "Pa", "shear modulus G", at_least=1000, at_most=1e11, unless=FROM_CURVE
    )
    tensile_strain: float = quantity(
        ..., "tension", "tensile strain at which a bond breaks", above=0, at_most=LARGEST_LIMIT,
        unless=FROM_CURVE,
    )  # fmt: skip
    shear_strain: float = quantity(
        ..., "tension", "shear strain at which a bond breaks, either way", above=0,
        at_most=LARGEST_LIMIT, unless=FROM_CURVE,
    )  # fmt: skip
    densification_strain: float = quantity(
        ...,
        "compression",
        "strain at which densification begins",
        unless=FROM_CURVE,
        above=-1,
        below=0,
    )
    locking_strain: float = quantity(
        ...,
        "compression",
        "strain at which the stress would become infinite",
        unless=FROM_CURVE,
        above=-1,
        below=0,
    )

    @model_validator(mode="wrap")
    @classmethod
    def _complete(cls, data: Any, handler: Any) -> "CurveFoam":
        """Take missing values from the curve; record which keys were given."""
        if not isinstance(data, dict):
            return handler(data)
        given = {key: value for key, value in data.items() if value is not None}
        if isinstance(given.get("curve"), dict):
            # the later check of the curve reports its errors, and only those
            with contextlib.suppress(ValueError):
                given["curve"] = Curve.model_validate(given["curve"])
        return completed(given, derived(given), handler)

    @model_validator(mode="after")
    def _check_curve(self) -> "CurveFoam":
        problems = []
        steepest = self.curve.steepest(-self.densification_strain)
        if self.youngs_modulus < steepest * (1.0 - 1e-9):
            problems.append(
                f"foam.youngs_modulus = {self.youngs_modulus:g}: must be at least {steepest:g} Pa, "
                "the steepest slope of foam.curve before densification; leave it out to use that "
                "slope"
            )
        if not -self.curve.tested <= self.densification_strain:
            problems.append(
                f"foam.densification_strain = {self.densification_strain:g}: must be at least "
                f"{-self.curve.tested:g}, where foam.curve ends; leave it out to use the strain of "
                "the curve's largest energy efficiency"
            )
        if self.landmarks.crush_start <= self.densification_strain:
            problems.append(
                f"foam.densification_strain = {self.densification_strain:g}: must be below "
                f"{self.landmarks.crush_start:.4g}, where crushing begins on foam.curve"
            )
        if not self.locking_strain < -self.curve.tested:
            problems.append(
                f"foam.locking_strain = {self.locking_strain:g}: must be below "
                f"{-self.curve.tested:g}, where foam.curve ends (more compressive, nearer to -1)"
            )
        if problems:
            raise ValueError("\n".join(problems))
        return self

    @property
    def landmarks(self) -> Landmarks:
        plateau = self.curve.plateau_stress
        return Landmarks(
            crush_start=-plateau / self.youngs_modulus,
            crush_end=self.densification_strain,
            limit=self.locking_strain,
            tensile=self.tensile_strain,
            crushed_tensile=self.crushed_tension[0],
            shear=self.shear_strain,
            plateau_stress=plateau,
        )

    @property
    def table(self) -> NDArray[np.float64]:
        young = self.youngs_modulus
        return self.curve.table(-self.locking_strain, young, PACKED * young, self.shear_modulus)

    @property
    def most_damping(self) -> float:
        return DAMPED * self.curve.plateau_stress

    @property
    def tested_strain(self) -> float:
        return -self.curve.tested

    def loading(self, strain: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.interp(strain, np.linspace(0.0, 1.0, TABLE_ROWS), self.table[:, STRESS])

    def constants(self, model: Any) -> dict[str, float]:
        return super().constants(model) | {"stiffens_below": self._stiffens_below, "place": 0.0}

    @property
    def unloads_with(self) -> float:
        """Slope of unloading of foam that has not stiffened [Pa]."""
        return self.youngs_modulus

    @property
    def _stiffens_below(self) -> float:
        """Strain beyond which the slope of unloading exceeds that of whole foam."""
        steeper = self.table[:, UNLOADING] > self.unloads_with * (1.0 + 1e-9)
        first = int(np.argmax(steeper)) if steeper.any() else TABLE_ROWS - 1
        # slopes are interpolated between rows, so they already exceed K after the row before
        return -max(first - 1, 0) / (TABLE_ROWS - 1)


_STANDINS = {
    "youngs_modulus": 1e6,
    "shear_modulus": 1e6,
    "densification_strain": -0.8,
    "locking_strain": -0.95,
    "tensile_strain": 0.05,
    "shear_strain": 0.1,
}


def derived(data: dict[str, Any]) -> dict[str, float]:
    """Values derived from the curve in raw data of such a foam, by key; given keys are used."""
    curve = data.get("curve")
    if not isinstance(curve, Curve):
        return _STANDINS
    given = {key: value for key, value in data.items() if is_number(value)}
    densification = given.get("densification_strain", 0.0)
    if not -curve.tested <= densification < 0.0:  # not given, or invalid, which a check reports
        densification = -curve.densification
    young = given.get("youngs_modulus", curve.steepest(-densification))
    shear = given.get("shear_modulus", SHEAR_OVER_YOUNG * young)
    plateau = curve.plateau_stress
    return {
        "youngs_modulus": young,
        "shear_modulus": shear,
        "densification_strain": -curve.densification,
        "locking_strain": -(curve.tested + LOCKS * (1.0 - curve.tested)),
        # capped, so that an error in a modulus is not reported for a strain
        "tensile_strain": min(plateau / young, LARGEST_LIMIT),
        "shear_strain": min(SHEAR_OVER_PLATEAU * plateau / shear, LARGEST_LIMIT),
    }


@ti.dataclass
class Constants:
    """Constants of one foam: strains dimensionless, stresses in Pa."""

    youngs_modulus: ti.f64
    shear_modulus: ti.f64
    yield_strain: ti.f64
    tensile_strain: ti.f64
    shear_strain: ti.f64
    densification_strain: ti.f64
    stiffens_below: ti.f64  # strain beyond which the slope of unloading exceeds that of whole foam
    crushed_tensile_strain: ti.f64
    crushed_tensile_stress: ti.f64
    shear_pressure_coefficient: ti.f64
    place: ti.f64  # the foam's index in the table; a float, so that all members have one type


@dataclass(frozen=True)
class ByCurve(Crushing):
    """The functions that laws of this kind share, for one set of options; see `Crushing`."""

    Constants = Constants
    tabulated = True
    shears_stiffer = True

    @ti.func
    def _looked_up(self, c: ti.template(), e, column: ti.template()):
        """Value of a column of the table at strain `e`, and its slope over -e.

        Outside the table the first and the last segment are extrapolated.
        """
        along = -e * (TABLE_ROWS - 1.0)
        row = self._row(along)
        here, following = self._around(c, row, column)
        rise = following - here
        return here + (along - ti.cast(row, ti.f64)) * rise, rise * (TABLE_ROWS - 1.0)

    @ti.func
    def _row(self, along):
        """The row of the table before the place `along`, counted in rows."""
        last = ti.static(TABLE_ROWS - 2)
        return ti.cast(elementary.smaller(elementary.larger(along, 0.0), 1.0 * last), ti.i32)

    @ti.func
    def _around(self, c: ti.template(), row: ti.template(), column: ti.template()):
        """Values of a column in a row of the table and in the next one."""
        here, following = ti.cast(0 * row, ti.f64), ti.cast(0 * row, ti.f64)
        width = ti.static(elementary.width(row))
        if ti.static(width > 0):
            for lane in ti.static(range(width)):
                place = ti.cast(_of_lane(c.place, lane), ti.i32)
                here[lane] = self.table[place, row[lane]][column]
                following[lane] = self.table[place, row[lane] + 1][column]
        else:
            place = ti.cast(c.place, ti.i32)
            here = self.table[place, row][column]
            following = self.table[place, row + 1][column]
        return here, following

    @ti.func
    def turn_at(self, e, history: ti.template()):
        return elementary.smaller(e, history.worst)

    @ti.func
    def stiffens_at(self, e, history: ti.template()):
        """Foam keeps the stiffness of its most compressive strain when it unloads."""
        return self.turn_at(e, history)

    @ti.func
    def stiffens_below(self, c: ti.template()):
        return c.stiffens_below

    @ti.func
    def room_stress(self, c: ti.template(), area, room):
        """Rise of the curve from the crush of a cell's bonds to the crush of its area.

        Bonds that fold sideways do not get shorter: the cell carries the remaining stress. A level
        plateau does not rise, so that foam yields at it in any direction. Until its area is crushed
        by twice the yield strain whole foam has no such pressure.
        """
        least = self._pressed_from(c, room)
        now, _ = self._looked_up(c, elementary.smaller(area, least) - 1.0, IN_CELLS)
        met, _ = self._looked_up(c, least - 1.0, IN_CELLS)
        return now - met

    @ti.func
    def room_energy(self, c: ti.template(), area, room):
        """The area between the curve and the stress at the crush of the cell's bonds."""
        least = self._pressed_from(c, room)
        less = elementary.smaller(area, least)
        now, _ = self._looked_up(c, less - 1.0, CELLS_ENERGY)
        before, _ = self._looked_up(c, least - 1.0, CELLS_ENERGY)
        met, _ = self._looked_up(c, least - 1.0, IN_CELLS)
        return now - before - met * (least - less)

    @ti.func
    def _pressed_from(self, c: ti.template(), room):
        """The area below which a cell has pressure."""
        return elementary.smaller(room - ROUNDING, self.keeps_room_below(c))

    @ti.func
    def keeps_room_below(self, c: ti.template()) -> ti.f64:
        return 1.0 + 2.0 * c.yield_strain

    @ti.func
    def shear_rise(self, c: ti.template(), e):
        rise, slope = self._looked_up(c, elementary.smaller(e, 0.0), SHEAR)
        return rise, ti.select(e < 0.0, -slope, 0.0)


@ti.func
def _of_lane(value: ti.template(), lane: ti.template()):
    """A lane of a pack, or a scalar that all lanes share."""
    if ti.static(elementary.width(value) > 0):
        return value[lane]
    return value
