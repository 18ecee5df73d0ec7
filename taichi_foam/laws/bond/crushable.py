"""Crushable foam (Eq. 26, Figs 19-20): plateau, densification, unloading, weak re-tension, failure.

A bond that has met the strain e_min unloads from there elastically, and is weak in tension. Foam
that heeds the rate lags behind: its e_min follows the strain by a flow rule, and how far it lags is
the stress beyond the static one.
"""

from dataclasses import dataclass
from typing import Annotated, Any, Literal

import numpy as np
import taichi as ti
from numpy.typing import NDArray
from pydantic import Field, model_validator

from taichi_foam.laws import elementary
from taichi_foam.laws.bond.base import OPENING, SLIDING, BondFoam, BondLaw, Landmarks, Limit
from taichi_foam.parts import choice, quantity

# The densification law is singular at the locking strain. Within this part of the way from
# locking back to densification it goes on as its tangent, so that a trial stage that oversteps
# still meets a finite, rising stress. For Table 6's constants that stress is 1.9 GPa, far above any
# that a run reaches.
GUARD = 0.05

# Of the rule for the energy that densification stores, on [-1, 1].
GAUSS_POINTS, GAUSS_WEIGHTS = (each.tolist() for each in np.polynomial.legendre.leggauss(8))

# Slope of packed pieces beyond the densification strain, in Young's moduli.
PACKED = 4.0

# What a cell may lack of its room without pressure, over its area at rest: straight cells have just
# what their bonds leave them, but for rounding.
ROUNDING = 1e-9


# Limits in strain belong to a lattice of the paper's cells [m] whose bonds break at once: what a
# crack costs there it costs in any lattice, unless a scene says otherwise.
CELL = 0.005


class Foam(BondFoam):
    """Parameters of crushable foam (paper, Table 1 and Eq. 26). Strains: tension positive."""

    law: Literal["crushable"] = "crushable"
    yield_strain: float = quantity(
        -0.05, "compression", "strain at which the plateau begins", at_least=-0.5, below=0
    )
    tensile_strain: float = quantity(
        0.05, "tension", "tensile strain at which a bond breaks", above=0, at_most=2
    )
    shear_strain: float = quantity(
        0.10,
        "tension",
        "shear strain at which a bond breaks, either way",
        above=0,
        at_most=2,
        fix="strains are fractions (10 % is 0.10)",
    )
    fracture_energy: Annotated[float, Field(gt=0, le=1e6)] | None = quantity(
        None,
        "J/m2",
        "energy that a crack takes as it opens, over its area; none: as in cells of 5 mm whose "
        "bonds break at tensile_strain, 2 * youngs_modulus * tensile_strain^2 * 5 mm",
        allowed="none, or above 0 and at most 1e6 J/m2",
    )
    shear_fracture_energy: Annotated[float, Field(gt=0, le=1e6)] | None = quantity(
        None,
        "J/m2",
        "energy that a crack takes as its faces slide without pressure, over its area; none: as in "
        "cells of 5 mm whose bonds break at shear_strain, "
        "shear_modulus * shear_strain^2 * 5 mm",
        allowed="none, or above 0 and at most 1e6 J/m2",
    )
    softening: bool = choice(
        True,
        "beyond its limit in tension or shear a bond loses its stress gradually; false: it breaks "
        "at once, and a crack costs about as much",
    )
    densification_strain: float = quantity(
        -0.80,
        "compression",
        "strain at which densification begins",
        above=-1,
        below=0,
        fix="strains are fractions (80 % is 0.80), negative in compression: -0.80",
    )
    locking_strain: float = quantity(
        -0.95,
        "compression",
        "strain at which the stress becomes infinite",
        above=-1,
        below=0,
        fix="strains are fractions (95 % is 0.95), negative in compression: -0.95",
    )
    densification_a: float = quantity(
        0.5, "-", "constant a of Eq. 26: how steeply the stress rises", above=0, at_most=10
    )
    densification_b: float = quantity(
        1.0, "-", "constant b of Eq. 26: the power of the distance to locking", above=0, at_most=5
    )
    crushed_tensile_fraction: float = quantity(
        0.5,
        "-",
        "a crushed bond breaks at this fraction of tensile_strain",
        above=0,
        at_most=1,
    )
    crushed_tensile_stress: Annotated[float, Field(ge=0, le=1e9)] | None = quantity(
        None,
        "Pa",
        "stress at which a crushed bond breaks; none: that of the virgin elastic line, "
        "youngs_modulus * crushed_tensile_fraction * tensile_strain",
        allowed="none, or at least 0 and at most 1e9 Pa",
    )
    crushed_strength: float = quantity(
        1.0,
        "-",
        "tensile strength of a bond between two cells that have been crushed across it, over "
        "that of whole foam; 1: only crush along a bond weakens it",
        at_least=0,
        at_most=1,
    )
    rate: Annotated[float, Field(ge=1, le=1e9)] | None = quantity(
        None,
        "1/s",
        "strain rate D at which the plateau's stress is twice its static one (Cowper & Symonds); "
        "none: the foam does not heed the rate",
        allowed="none, or at least 1 and at most 1e9 1/s",
    )
    rate_exponent: float = quantity(
        1.0,
        "-",
        "exponent q: the plateau's stress grows by the part (rate / D)^(1/q)",
        at_least=1,
        at_most=20,
    )

    @model_validator(mode="after")
    def _check_order(self) -> "Foam":
        problems = []
        if self.densification_strain >= self.yield_strain:
            problems.append(
                f"foam.densification_strain = {self.densification_strain:g}: must be below "
                f"foam.yield_strain = {self.yield_strain:g}; the paper uses -0.80 and -0.05"
            )
        if self.locking_strain >= self.densification_strain:
            problems.append(
                f"foam.locking_strain = {self.locking_strain:g}: must be below "
                f"foam.densification_strain = {self.densification_strain:g} (more compressive, "
                "nearer to -1); the paper uses -0.95 and -0.80"
            )
        if problems:
            raise ValueError("\n".join(problems))
        return self

    @property
    def plateau_stress(self) -> float:
        """Magnitude of the plateau's stress [Pa], K |e_y| (Eq. 26)."""
        return self.youngs_modulus * -self.yield_strain

    @property
    def landmarks(self) -> Landmarks:
        return Landmarks(
            crush_start=self.yield_strain,
            crush_end=self.densification_strain,
            limit=self.locking_strain,
            tensile=self.tensile_strain,
            crushed_tensile=self.crushed_tension[0],
            shear=self.shear_strain,
            plateau_stress=self.plateau_stress,
        )

    def limits(self, length: float) -> tuple[Limit, Limit]:
        """By what a crack costs over what a bond holds at its limit (Bazant & Oh 1983)."""
        in_tension = 0.5 * self.youngs_modulus * self.tensile_strain**2
        in_shear = 0.5 * self.shear_modulus * self.shear_strain**2
        opening, sliding = self.fracture_energy, self.shear_fracture_energy
        if opening is None:
            opening = OPENING * in_tension * CELL
        if sliding is None:
            sliding = SLIDING * in_shear * CELL
        return (
            Limit.for_crack(opening / (in_tension * length), OPENING, self.softening),
            Limit.for_crack(sliding / (in_shear * length), SLIDING, self.softening),
        )

    def permanent_strain(self, worst: NDArray[np.float64]) -> NDArray[np.float64]:
        """Unloading from the plateau has the slope K; densification retraces itself (Fig. 19)."""
        return np.clip(worst, self.densification_strain, self.yield_strain) - self.yield_strain

    def law_for(self, model: Any) -> "Crushable":
        return Crushable(
            heeds_rate=self.rate is not None,
            linear_flow=self.rate_exponent == 1.0,
            linear_room=self.densification_b == 1.0,
            weakens_across=self.crushed_strength < 1.0,
            broken_contact=model.broken_contact,
            shear_failure=model.shear_failure,
        )

    def constants(self, model: Any) -> dict[str, float]:
        strain, stress = self.crushed_tension
        return {
            "youngs_modulus": self.youngs_modulus,
            "shear_modulus": self.shear_modulus,
            "yield_strain": self.yield_strain,
            "tensile_strain": self.tensile_strain,
            "shear_strain": self.shear_strain,
            "densification_strain": self.densification_strain,
            "locking_strain": self.locking_strain,
            "densification_a": self.densification_a,
            "densification_b": self.densification_b,
            "crushed_tensile_strain": strain,
            "crushed_tensile_stress": stress,
            "crushed_strength": self.crushed_strength,
            "shear_pressure_coefficient": model.shear_pressure_coefficient,
            "rate": self.rate or 0.0,
            "rate_exponent": self.rate_exponent,
        }

    @property
    def crushed_tension(self) -> tuple[float, float]:
        """Strain and stress [Pa] at which a crushed bond breaks."""
        strain = self.crushed_tensile_fraction * self.tensile_strain
        stress = self.crushed_tensile_stress
        return strain, self.youngs_modulus * strain if stress is None else stress


@ti.dataclass
class Constants:
    """Constants of one foam: strains without unit, stresses in Pa."""

    youngs_modulus: ti.f64
    shear_modulus: ti.f64
    yield_strain: ti.f64
    tensile_strain: ti.f64
    shear_strain: ti.f64
    densification_strain: ti.f64
    locking_strain: ti.f64
    densification_a: ti.f64
    densification_b: ti.f64
    crushed_tensile_strain: ti.f64
    crushed_tensile_stress: ti.f64
    crushed_strength: ti.f64  # in tension when crushed across, over that of whole foam
    shear_pressure_coefficient: ti.f64
    rate: ti.f64  # D of Cowper & Symonds [1/s], or 0: the foam does not heed the rate
    rate_exponent: ti.f64


@dataclass(frozen=True)
class Crushable(BondLaw):
    """The law's functions, for one set of options.

    heeds_rate      Cowper & Symonds' overstress
    linear_flow     its exponent is 1
    linear_room     the constant b of Eq. 26 is 1: a power costs as much as the exponential
    weakens_across  foam that is crushed across a bond is weaker in tension
    broken_contact  how a broken bond takes compression up again (Model.broken_contact)
    shear_failure   when shear may break a bond (Model.shear_failure)
    """

    heeds_rate: bool = False
    linear_flow: bool = True
    linear_room: bool = True
    weakens_across: bool = False
    broken_contact: str = "reload"
    shear_failure: str = "always"

    Constants = Constants
    stiffens = True

    @ti.func
    def stiffens_below(self, c: ti.template()):
        return c.densification_strain

    @ti.func
    def keeps_room_below(self, c: ti.template()) -> ti.f64:
        return 1.0 + c.yield_strain

    @ti.func
    def room_stress(self, c: ti.template(), area, room):
        """Foam that is crushed through resists with the slope of packed pieces.

        Until then it gives way at its plateau, in whatever direction: foam that is crushed at 45
        degrees to its bonds has four tenths of the area that their strains would leave it. Whole
        foam folds; nothing springs up at once as it yields.
        """
        yielded = (room - 1.0 - c.yield_strain) / c.yield_strain
        yielded = elementary.smaller(elementary.larger(yielded, 0.0), 1.0)
        least = elementary.smaller(room, 1.0 + c.densification_strain)
        lacks = elementary.larger(least - area - ROUNDING, 0.0)
        return PACKED * c.youngs_modulus * yielded * lacks

    @ti.func
    def room_stiffness(self, c: ti.template()) -> ti.f64:
        return PACKED * c.youngs_modulus

    @ti.func
    def contact_stiffness(self, c: ti.template()) -> ti.f64:
        return PACKED * c.youngs_modulus

    @ti.func
    def _densified(self, c: ti.template(), e):
        """Stress of the densification branch and its slope (Eq. 26c, both brackets positive).

        For e < e_d; beyond the guard strain it goes on as the tangent there.
        """
        guard = c.locking_strain + GUARD * (c.densification_strain - c.locking_strain)
        inside = elementary.larger(e, guard)
        room = inside - c.locking_strain
        power = room
        if ti.static(not self.linear_room):  # a power costs as much as the exponential
            power = elementary.power(room, c.densification_b)
        steepness = c.densification_a / power
        exponent = steepness * (c.densification_strain - inside)
        stress = c.youngs_modulus * c.yield_strain * elementary.exp(exponent)
        slope = -stress * (steepness + c.densification_b * exponent / room)
        return stress + slope * (e - inside), slope

    @ti.func
    def permanent_strain(self, c: ti.template(), e_min):
        """Strain at which a bond that has met `e_min` is without stress.

        It unloads from the plateau with the slope K; densification retraces itself, so that the
        turning point is never beyond e_d.
        """
        turn = elementary.larger(e_min, c.densification_strain)
        turn = elementary.smaller(turn, c.yield_strain)
        return turn - c.yield_strain

    @ti.func
    def flowed(self, c: ti.template(), e, e_min, time):
        """The e_min of rate-sensitive foam that has been at strain `e` for `time` [s].

        In flow at the rate r the plateau's stress is K e_y (1 + (r / D)^(1/q)) (Cowper & Symonds
        1957, as Perzyna's overstress): while e_min is short of e by y, its rate is D (y / |e_y|)^q.
        At a constant strain that has a closed form, whatever the time.
        """
        elastic = elementary.larger(e, c.yield_strain)
        start = elementary.smaller(elastic, e_min)
        short = elementary.larger(start - e, 0.0)
        times = c.rate * time / -c.yield_strain
        left = short * elementary.exp(-times)
        if ti.static(not self.linear_flow):
            power = c.rate_exponent - 1.0
            # a power's base must be above 0, and what is so little short does not flow in any time
            share = elementary.larger(short / -c.yield_strain, 1e-30)
            slowed = 1.0 + power * times * elementary.power(share, power)
            left = short * elementary.power(slowed, -1.0 / power)
        return start - (short - left)

    @ti.func
    def elastic_strain(self, c: ti.template(), e, e_min):
        """What of a compressive strain unloading gives back, as if the plateau went on for ever.

        At most the yield strain, but for what e_min is short of e: rate-sensitive foam only.
        """
        strain = elementary.larger(e - self.permanent_strain(c, e_min), c.yield_strain)
        if ti.static(self.heeds_rate):
            flows_from = elementary.smaller(e_min, c.yield_strain)
            strain += elementary.smaller(e - flows_from, 0.0)
        return strain

    @ti.func
    def stress_fraction(self, c: ti.template(), e, e_min, broken):
        """The stress as if the plateau went on for ever, as (numerator, divisor > 0)."""
        permanent = self.permanent_strain(c, e_min)
        stretch = e - permanent
        elastic = c.youngs_modulus * self.elastic_strain(c, e, e_min)
        crushed = e_min < c.yield_strain
        weak = ti.select(crushed, c.crushed_tensile_stress * stretch, elastic)
        reach = ti.select(crushed, c.crushed_tensile_strain - permanent, 1.0)
        numerator = ti.select(stretch > 0.0, weak, elastic)
        divisor = ti.select(stretch > 0.0, reach, 1.0)
        kept = elementary.smaller(numerator, 0.0)
        if ti.static(self.broken_contact == "jump"):
            kept = ti.select(e > e_min, 0.0, kept)
        return ti.select(broken, kept, numerator), divisor

    @ti.func
    def stiffening(self, c: ti.template(), e, e_min, broken):
        """What densification adds to the yielding stress, and the slope there [Pa]; 0 above e_d."""
        stress, slope = self._densified(c, elementary.smaller(e, c.densification_strain))
        acts = e < c.densification_strain
        if ti.static(self.broken_contact == "jump"):
            acts = ti.select(broken, acts & (e <= e_min), acts)
        added = stress - c.youngs_modulus * c.yield_strain
        return ti.select(acts, added, 0.0), ti.select(acts, slope, 0.0)

    @ti.func
    def stored_energy(self, c: ti.template(), e: ti.f64, e_min: ti.f64, broken: ti.i32) -> ti.f64:
        """Energy per reference volume [J/m3] that unloading from `e` to zero stress gives back.

        Under the jump reading a broken bond gives nothing back: its stress drops at once.
        """
        permanent = self.permanent_strain(c, e_min)
        energy = 0.0
        if e > permanent:
            if not broken:
                numerator, divisor = self.stress_fraction(c, e, e_min, broken)
                energy = 0.5 * (e - permanent) * numerator / divisor
        elif not (broken and ti.static(self.broken_contact == "jump")):
            energy = 0.5 * c.youngs_modulus * self.elastic_strain(c, e, e_min) ** 2
            if e < c.densification_strain:
                energy += self._densified_energy(c, e)
                if ti.static(self.heeds_rate):
                    # over what e_min is short of e here, the overstress holds the plateau too
                    short = ti.max(ti.min(e_min, c.densification_strain) - e, 0.0)
                    energy += c.youngs_modulus * c.yield_strain * short
        return energy

    @ti.func
    def _densified_energy(self, c: ti.template(), e: ti.f64) -> ti.f64:
        """Area under the densification branch between `e` and e_d [J/m3], by Gauss's rule.

        It is an exponential integral without a closed form for every b. Taken over the logarithm of
        e - e_l, eight points are good to 1e-5 of it down to 0.93 of crush for Table 6's constants.
        """
        room = c.densification_strain - c.locking_strain
        ratio = ti.max(e - c.locking_strain, GUARD * room) / room
        half = -0.5 * elementary.log(ratio)
        points = ti.Vector(ti.static(GAUSS_POINTS))
        weights = ti.Vector(ti.static(GAUSS_WEIGHTS))
        area = 0.0
        for k in range(ti.static(len(GAUSS_POINTS))):
            here = room * elementary.exp(-half * (1.0 + points[k]))
            stress, _ = self._densified(c, c.locking_strain + here)
            area += weights[k] * here * stress
        return -half * area

    @ti.func
    def largest_stiffness(self, c: ti.template()) -> ti.f64:
        """The steepest d(sigma_e)/de before densification [Pa]: elastic, or in re-tension."""
        return ti.max(c.youngs_modulus, c.crushed_tensile_stress / c.crushed_tensile_strain)

    @ti.func
    def shear_stress(self, c: ti.template(), gamma):
        """tau = G gamma (Eq. 25)."""
        return c.shear_modulus * gamma

    @ti.func
    def contact_stress(
        self, c: ti.template(), gap: ti.f64, touch: ti.f64, length: ti.f64
    ) -> ti.f64:
        """Stress [Pa] between two pieces at a distance `gap` [m] that touch at `touch`.

        They are foam: elastic, then a plateau. Packed to the densification strain they stiffen, by
        a fixed slope instead of Eq. 26c: the step size then does not depend on powder.
        """
        packed = ti.min(gap - (1.0 + c.densification_strain) * touch, 0.0) / length
        return c.youngs_modulus * (ti.max((gap - touch) / length, c.yield_strain) + PACKED * packed)

    @ti.func
    def energy_lost_by_breaking(self, c: ti.template(), e: ti.f64, e_min: ti.f64) -> ti.f64:
        """Stored energy per reference volume [J/m3] that a bond can no longer give back.

        Reloading keeps what is stored in compression; the jump reading keeps nothing.
        """
        lost = self.stored_energy(c, e, e_min, 0)
        if ti.static(self.broken_contact == "reload") and e <= self.permanent_strain(c, e_min):
            lost = 0.0
        return lost

    @ti.func
    def strength_left(self, c: ti.template(), e_min):
        """Tensile strength over that of whole foam, crushed across the bond to `e_min`.

        It falls in proportion to the crush, from yield to densification, where the foam is powder.
        """
        crush = (e_min - c.yield_strain) / (c.densification_strain - c.yield_strain)
        crush = elementary.smaller(elementary.larger(crush, 0.0), 1.0)
        return 1.0 - (1.0 - c.crushed_strength) * crush

    @ti.func
    def tensile_limit(self, c: ti.template(), e_min):
        """Strain at which a bond breaks in tension: less for crushed foam (Section 4.5)."""
        return ti.select(e_min < c.yield_strain, c.crushed_tensile_strain, c.tensile_strain)

    @ti.func
    def shear_strength(self, c: ti.template(), e, sigma_e, size):
        """Shear stress at which a bond breaks [Pa], by the chosen reading of compression.

        `size` is the product of the lengths of F's two columns at the bond: the shear strain is
        this times the sine of the angle through which its foam has sheared.
        """
        pulled = c.shear_modulus * c.shear_strain
        pressed = pulled + 0.0 * sigma_e
        if ti.static(self.shear_failure == "tension-only"):
            pressed += ti.math.inf
        elif ti.static(self.shear_failure == "pressure-dependent"):
            pressed += c.shear_pressure_coefficient * ti.abs(sigma_e)
        elif ti.static(self.shear_failure == "angle"):
            pressed *= size
        return ti.select(e < 0.0, pressed, pulled)

    @ti.func
    def fails(self, c: ti.template(), e, sigma_e, tau, e_min, size, tensile, strength):
        """Whether an intact bond in this state breaks, in tension or in shear (Section 4.6).

        `tensile` is what the bond's own strength in tension is over the mean of whole ones, and
        `strength` that in shear; `size` as in `shear_strength`.
        """
        in_tension = e > tensile * self.tensile_limit(c, e_min)
        return in_tension | (ti.abs(tau) > strength * self.shear_strength(c, e, sigma_e, size))

    @ti.func
    def overload(self, c: ti.template(), e, sigma_e, tau, e_min, size, tensile, strength):
        """How far beyond `fails` a bond is: strain and shear stress over their limits."""
        in_tension = e / (tensile * self.tensile_limit(c, e_min))
        return in_tension, ti.abs(tau) / (strength * self.shear_strength(c, e, sigma_e, size))
