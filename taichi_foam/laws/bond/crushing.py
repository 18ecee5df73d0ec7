"""Common base of foams that crush permanently and break: unloading, re-tension, failure, packing.

A bond that has reached the strain e_min unloads from there elastically, and is weak in tension. A
law of this kind gives the slope of unloading and the strain at zero stress (`unloading`).
"""

from dataclasses import dataclass
from typing import Any, ClassVar

from taichi_foam.backend import ti
from taichi_foam.laws import elementary
from taichi_foam.laws.bond.base import OPENING, SLIDING, BondFoam, BondLaw, Limit
from taichi_foam.parts import Control, choice, quantity

# Slope of packed foam beyond the densification strain, in Young's moduli.
PACKED = 4.0

# Tolerance on a cell's room, over its area at rest: the area of a rectangular cell equals its room,
# except for rounding.
ROUNDING = 1e-9

# Limits in strain refer to a lattice of the paper's cells [m] whose bonds break at once: a crack
# takes the same energy in any lattice as in that one, unless a scene gives another.
CELL = 0.005

UNLESS_GIVEN = {
    "fracture_energy": "its value in 5 mm cells whose bonds break at once",
    "shear_fracture_energy": "its value in 5 mm cells whose bonds break at once",
    "crush_band": "dashpots use strain rates over one cell, whatever its size",
}
"""See `BondFoam.unless_given`."""


class CrushingFoam(BondFoam):
    """Failure of crushable foam (paper, Table 1, Sections 4.5, 4.6). Strains: tension positive."""

    controls: ClassVar[tuple[Control, ...]] = (
        Control("youngs_modulus", "Young's modulus", 0.3, 30, 0.01, "MPa", 1e6, log=True),
        Control("shear_modulus", "shear modulus", 0.1, 10, 0.01, "MPa", 1e6, log=True),
        Control("tensile_strain", "tensile limit", 0.01, 0.3, 0.001),
        Control("shear_strain", "shear limit", 0.01, 0.5, 0.005),
    )

    tensile_strain: float = quantity(
        0.05, "tension", "tensile strain at which a bond breaks", above=0, at_most=2
    )
    shear_strain: float = quantity(
        0.10,
        "tension",
        "shear strain at which a bond breaks, in either direction",
        above=0,
        at_most=2,
        fix="strains are fractions (10 % is 0.10)",
    )
    fracture_energy: float | None = quantity(
        None,
        "J/m2",
        "energy per area that an opening crack absorbs; none: as in 5 mm cells whose bonds break "
        "at once at tensile_strain, 2 * youngs_modulus * tensile_strain^2 * 5 mm",
        above=0,
        at_most=1e6,
    )
    shear_fracture_energy: float | None = quantity(
        None,
        "J/m2",
        "energy per area that a crack absorbs as its faces slide without pressure; none: as in 5 "
        "mm cells whose bonds break at once at shear_strain, shear_modulus * shear_strain^2 * 5 "
        "mm",
        above=0,
        at_most=1e6,
    )
    softening: bool = choice(
        True,
        "true: a bond beyond its limit in tension or shear loses its stress gradually; false: it "
        "breaks at once, and a crack takes about as much energy",
    )
    crushed_tensile_fraction: float = quantity(
        0.5,
        "-",
        "fraction of tensile_strain at which a crushed bond breaks",
        above=0,
        at_most=1,
    )
    crushed_tensile_stress: float | None = quantity(
        None,
        "Pa",
        "stress at which a crushed bond breaks; none: that of the virgin elastic line, "
        "youngs_modulus * crushed_tensile_fraction * tensile_strain",
        at_least=0,
        at_most=1e9,
    )

    def limits(self, length: float) -> tuple[Limit, Limit]:
        """By a crack's energy over the energy stored in a bond at its limit (Bazant & Oh 1983)."""
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

    def options(self, model: Any) -> dict[str, Any]:
        """The options of `Crushing` for this foam and a scene's `model`."""
        return {
            "broken_contact": model.broken_contact,
            "shear_failure": model.shear_failure,
        }

    def constants(self, model: Any) -> dict[str, float]:
        strain, stress = self.crushed_tension
        marks = self.landmarks
        return {
            "youngs_modulus": self.youngs_modulus,
            "shear_modulus": self.shear_modulus,
            "yield_strain": marks.crush_start,
            "tensile_strain": self.tensile_strain,
            "shear_strain": self.shear_strain,
            "densification_strain": marks.crush_end,
            "crushed_tensile_strain": strain,
            "crushed_tensile_stress": stress,
            "shear_pressure_coefficient": model.shear_pressure_coefficient,
        }

    @property
    def crushed_tension(self) -> tuple[float, float]:
        """Strain and stress [Pa] at which a crushed bond breaks."""
        strain = self.crushed_tensile_fraction * self.tensile_strain
        stress = self.crushed_tensile_stress
        return strain, self.youngs_modulus * strain if stress is None else stress


@dataclass(frozen=True)
class Crushing(BondLaw):
    """The functions that laws of this kind share. Their `Constants` have those of `CrushingFoam`.

    broken_contact  how a broken bond carries compression again (Model.broken_contact)
    shear_failure   when shear may break a bond (Model.shear_failure)
    """

    broken_contact: str = "reload"
    shear_failure: str = "always"

    stiffens = True

    @ti.func
    def turn_at(self, e, history: ti.template()):
        """The e_min from which a bond now at strain `e` unloads.

        For a level plateau an earlier one gives the same stress.
        """
        return history.worst

    @ti.func
    def unloading(self, c: ti.template(), e_min):
        """Strain at zero stress of a bond with this `e_min`, and the slope of unloading [Pa]."""
        raise NotImplementedError

    @ti.func
    def elastic_strain(self, c: ti.template(), e, e_min, permanent):
        """Elastic part of a compressive strain, without that due to `stiffening`."""
        raise NotImplementedError

    @ti.func
    def elastic_stress(self, c: ti.template(), e, e_min, permanent, slope):
        """Stress [Pa] of a bond with this `e_min`, without `stiffening`: compressed, or whole.

        `permanent` and `slope` are those of `unloading`.
        """
        return slope * self.elastic_strain(c, e, e_min, permanent)

    @ti.func
    def elastic_energy(
        self, c: ti.template(), e: ti.f64, e_min: ti.f64, permanent: ti.f64, slope: ti.f64
    ) -> ti.f64:
        """Energy stored by `elastic_stress` in compression [J/m3]."""
        return 0.5 * slope * self.elastic_strain(c, e, e_min, permanent) ** 2

    @ti.func
    def stiffening_energy(self, c: ti.template(), e: ti.f64, e_min: ti.f64) -> ti.f64:
        """Energy stored by `stiffening` at strain `e` [J/m3]."""
        return 0.0

    @ti.func
    def stiffens_below(self, c: ti.template()):
        return c.densification_strain

    @ti.func
    def keeps_room_below(self, c: ti.template()) -> ti.f64:
        return 1.0 + c.densification_strain

    @ti.func
    def room_stress(self, c: ti.template(), area, room):
        """Densified foam resists with the slope of packed foam.

        Until then it yields at its plateau, in any direction: foam crushed at 45 degrees to its
        bonds has 0.4 of the area that their strains would leave it.
        """
        least = elementary.smaller(room, 1.0 + c.densification_strain)
        lacks = elementary.larger(least - area - ROUNDING, 0.0)
        return PACKED * c.youngs_modulus * lacks

    @ti.func
    def room_energy(self, c: ti.template(), area, room):
        """Quadratic in the missing area, see `room_stress`."""
        least = elementary.smaller(room, 1.0 + c.densification_strain)
        lacks = elementary.larger(least - area - ROUNDING, 0.0)
        return 0.5 * PACKED * c.youngs_modulus * lacks * lacks

    @ti.func
    def room_stiffness(self, c: ti.template()) -> ti.f64:
        return PACKED * c.youngs_modulus

    @ti.func
    def skeleton_stress(self, c: ti.template(), e, history: ti.template(), broken):
        """The stress as if the plateau had no end, as (numerator, divisor > 0)."""
        turn = self.turn_at(e, history)
        permanent, slope = self.unloading(c, turn)
        stretch = e - permanent
        elastic = self.elastic_stress(c, e, turn, permanent, slope)
        crushed = turn < c.yield_strain
        weak = ti.select(crushed, c.crushed_tensile_stress * stretch, elastic)
        reach = ti.select(crushed, c.crushed_tensile_strain - permanent, 1.0)
        numerator = ti.select(stretch > 0.0, weak, elastic)
        divisor = ti.select(stretch > 0.0, reach, 1.0)
        kept = elementary.smaller(numerator, 0.0)
        if ti.static(self.broken_contact == "jump"):
            kept = ti.select(e > history.worst, 0.0, kept)
        return ti.select(broken, kept, numerator), divisor

    stress_fraction = skeleton_stress

    @ti.func
    def skeleton_energy(
        self, c: ti.template(), e: ti.f64, history: ti.template(), broken: ti.i32
    ) -> ti.f64:
        """Energy per reference volume [J/m3] released on unloading from `e` to zero stress.

        With broken_contact = "jump" a broken bond releases none: its stress drops at once.
        """
        turn = self.turn_at(e, history)
        permanent, slope = self.unloading(c, turn)
        energy = 0.0
        if e > permanent:
            if not broken:
                numerator, divisor = self.skeleton_stress(c, e, history, broken)
                energy = 0.5 * (e - permanent) * numerator / divisor
        elif not (broken and ti.static(self.broken_contact == "jump")):
            energy = self.elastic_energy(c, e, turn, permanent, slope)
            energy += self.stiffening_energy(c, e, history.worst)
        return energy

    stored_energy = skeleton_energy

    @ti.func
    def largest_stiffness(self, c: ti.template()) -> ti.f64:
        """The largest d(sigma_e)/de before densification [Pa]: elastic, or in re-tension."""
        return ti.max(c.youngs_modulus, c.crushed_tensile_stress / c.crushed_tensile_strain)

    @ti.func
    def contact_stress(
        self, c: ti.template(), gap: ti.f64, touch: ti.f64, length: ti.f64
    ) -> ti.f64:
        """Stress [Pa] of the foam between a node and its support: elastic, then on its plateau.

        Beyond the densification strain it stiffens with a fixed slope instead of Eq. 26c, so that
        the step size does not depend on foam powder.
        """
        packed = ti.min(gap - (1.0 + c.densification_strain) * touch, 0.0) / length
        return c.youngs_modulus * (ti.max((gap - touch) / length, c.yield_strain) + PACKED * packed)

    @ti.func
    def contact_energy(
        self, c: ti.template(), gap: ti.f64, touch: ti.f64, length: ti.f64
    ) -> ti.f64:
        """Integral of `contact_stress` over gap / length."""
        packed = ti.min(gap - (1.0 + c.densification_strain) * touch, 0.0) / length
        closed = ti.min((gap - touch) / length, 0.0)
        elastic = ti.max(closed, c.yield_strain)
        yielded = c.yield_strain * (closed - elastic)
        return c.youngs_modulus * (
            0.5 * elastic * elastic + yielded + 0.5 * PACKED * packed * packed
        )

    @ti.func
    def energy_lost_by_breaking(
        self, c: ti.template(), e: ti.f64, history: ti.template()
    ) -> ti.f64:
        """Stored energy per reference volume [J/m3] that is lost when a bond breaks.

        With broken_contact = "reload" the energy stored in compression is kept, with "jump" none.
        """
        lost = self.stored_energy(c, e, history, 0)
        if ti.static(self.broken_contact == "reload"):
            permanent, _ = self.unloading(c, self.turn_at(e, history))
            if e <= permanent:
                lost = 0.0
        return lost

    @ti.func
    def tensile_limit(self, c: ti.template(), e_min):
        """Strain at which a bond breaks in tension: less for crushed foam (Section 4.5)."""
        return ti.select(e_min < c.yield_strain, c.crushed_tensile_strain, c.tensile_strain)

    @ti.func
    def shear_strength(self, c: ti.template(), e, sigma_e, size):
        """Shear stress at which a bond breaks [Pa]; in compression by the option `shear_failure`.

        `size` is the product of the lengths of F's two columns at the bond: the shear strain is
        `size` times the sine of the foam's shear angle.
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
    def fails(
        self, c: ti.template(), e, sigma_e, tau, history: ti.template(), size, tensile, strength
    ):
        """Whether an intact bond in this state breaks, in tension or in shear (Section 4.6).

        `tensile` and `strength` are the bond's limits in tension and shear over the law's; `size`
        as in `shear_strength`.
        """
        in_tension = e > tensile * self.tensile_limit(c, history.worst)
        return in_tension | (ti.abs(tau) > strength * self.shear_strength(c, e, sigma_e, size))

    @ti.func
    def overload(
        self, c: ti.template(), e, sigma_e, tau, history: ti.template(), size, tensile, strength
    ):
        """Strain and shear stress over the limits of `fails`."""
        in_tension = e / (tensile * self.tensile_limit(c, history.worst))
        return in_tension, ti.abs(tau) / (strength * self.shear_strength(c, e, sigma_e, size))
