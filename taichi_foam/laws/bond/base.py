"""What every bond law is: the parameters of its foam, and what the engine asks of it.

A law is one module. It has two classes: a `BondFoam`, the values of a scene's `[foam]` table, and a
`BondLaw`, the law's functions for kernels. A foam's `law_for` gives the law of a scene; the engine
knows nothing else of either.
"""

import copy
import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Annotated, Any, ClassVar

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from taichi_foam.backend import ti
from taichi_foam.parts import Part, quantity

TABLE_ROWS, TABLE_COLUMNS = 1001, 5
"""Of the table that a law may have: a row for strains of 0, -0.001 and so on, to -1."""

OPENING, SLIDING = 4.0, 2.0
"""What a crack through brittle bonds costs over what they hold, as it opens and as its faces slide.

A bond of length L holds W = K e_t^2 L / 2, or G gamma_t^2 L / 2, per area. The stress half a cell
ahead of a crack's tip is K_I / sqrt(pi L), or K_II, and the crack releases 1.15 K_I^2 / K (an
orthotropic body without Poisson's effect, Sih, Paris & Irwin 1965). So it starts at 2.3 pi W = 7.2
W as it opens, and at 2.3 pi (G / K) W = 2.2 W as it slides; it runs on past where that pays, and
stops. In double cantilevers (validation/verify.py) an opening crack takes 4.9 to 6.4 W to start and
3.4 to 3.8 W to grow; what bonds do not hold is radiated. One through bonds that soften costs 1.1 to
1.3 of what they hold. A sliding one has not been measured.
"""


@dataclass(frozen=True)
class Limit:
    """What the length of a bond makes of a limit of its law, in tension or in shear.

    share  limit over that of the law
    tail   how far a bond holds beyond its limit, over the limit: its stress falls in a straight
           line, to nothing there; 1: it breaks at once
    """

    share: float = 1.0
    tail: float = 1.0

    @classmethod
    def for_crack(cls, cost: float, brittle: float, softening: bool) -> "Limit":
        """That of bonds through which a crack costs so much, over what they hold at the law's.

        Through brittle bonds it costs `brittle` times what they hold. Those that soften never
        have less of a tail than that, and in cells too large for it a limit that is lower.
        """
        # where only rounding differs: such cells are like the law's to the last bit
        times = 1.0 if abs(cost / brittle - 1.0) < 1e-9 else cost / brittle
        if not softening:
            return cls(share=math.sqrt(times))
        return cls(share=math.sqrt(min(times, 1.0)), tail=brittle * max(times, 1.0))


@dataclass(frozen=True)
class Landmarks:
    """Strains and stresses of a foam that measures and pictures refer to; tension positive.

    crush_start      strain at which crushing begins, < 0
    crush_end        strain at which the foam is crushed through, < crush_start
    limit            most compressive strain that a picture's key has to show, <= crush_end
    tensile          strain at which whole foam breaks in tension
    crushed_tensile  strain at which foam that was crushed breaks in tension
    shear            shear strain at which whole foam breaks
    plateau_stress   magnitude of the stress between crush_start and crush_end [Pa]
    """

    crush_start: float
    crush_end: float
    limit: float
    tensile: float
    crushed_tensile: float
    shear: float
    plateau_stress: float


class BondFoam(Part):
    """Parameters that the foam of every law has. A law's own class adds `law` and its constants."""

    law: str
    implied_by: ClassVar[str | None] = None
    """A key that only this law has: a table with it, and without a `law`, is of this law."""
    unless_given: ClassVar[Mapping[str, str]] = MappingProxyType({})
    """What describes the foam itself, by key, and in words what stands for it where nobody gave it.

    A foam of one's own, of which some of these were given, says of the others what they are.
    """
    source: Annotated[str, Field(min_length=1, max_length=1000)] | None = Field(
        default=None,
        description="where its values are from: a foam's name, a test, a publication",
        json_schema_extra={"allowed": "none, or 1 to 1,000 characters", "fix": "shorten it"},
    )

    youngs_modulus: float = quantity(2.78e6, "Pa", "Young's modulus K", at_least=1000, at_most=1e11)
    shear_modulus: float = quantity(
        0.84e6,
        "Pa",
        "shear modulus G",
        at_least=1000,
        at_most=1e11,
        fix="moduli and stresses are in pascals (0.84 MPa is 0.84e6)",
    )
    crush_band: Annotated[float, Field(ge=1e-5, le=1)] | None = quantity(
        None,
        "m",
        "width of the bands in which foam crushes and shears: dashpots and rate take strain rates "
        "over this length, whatever the cell; none: over a cell",
        allowed="none, or at least 1e-5 and at most 1 m",
    )
    strength_scatter: float = quantity(
        0.0,
        "-",
        "scatter of the bonds' strength in tension and shear, Weibull: standard deviation "
        "over mean; 0: all are equally strong",
        at_least=0,
        at_most=0.5,
    )
    strength_seed: int = quantity(
        0,
        "count",
        "which strengths the scatter draws",
        at_least=0,
        at_most=2**32 - 1,
        fix="any other whole number draws others",
    )

    def limits(self, length: float) -> tuple[Limit, Limit]:
        """What a length of bonds [m] makes of the law's limits, in tension and in shear.

        A law that knows nothing of cracks has the same ones for every length.
        """
        return Limit(), Limit()

    @property
    def landmarks(self) -> Landmarks:
        """What measures and pictures refer to."""
        raise NotImplementedError

    def permanent_strain(self, worst: NDArray[np.float64]) -> NDArray[np.float64]:
        """Strain (<= 0) at which foam that has met the strain `worst` is without stress."""
        raise NotImplementedError

    def loading(self, strain: NDArray[np.float64]) -> NDArray[np.float64] | None:
        """Static stress [Pa] on first loading, both positive in compression; None: not known."""
        return None

    @property
    def table(self) -> NDArray[np.float64] | None:
        """(TABLE_ROWS, TABLE_COLUMNS) what a law that is `tabulated` looks up."""
        return None

    @property
    def most_damping(self) -> float | None:
        """The most that a row of cells may have as dashpot, over its face [Pa s/m]; None: anything.

        What dashpots take is no part of a foam's curve.
        """
        return None

    @property
    def tested_strain(self) -> float | None:
        """The most compressive strain (< 0) that the foam was tested to; None: it is not known."""
        return None

    @property
    def used_up_strain(self) -> float:
        """Strain (< 0) at which nothing is known to be left to crush: where its test ends."""
        tested = self.tested_strain
        return self.landmarks.crush_end if tested is None else tested

    def law_for(self, model: Any) -> "BondLaw":
        """The law's functions, with the options of this foam and of a scene's `model` built in."""
        raise NotImplementedError

    def constants(self, model: Any) -> dict[str, float]:
        """Values for the members of the law's `Constants`."""
        raise NotImplementedError


class BondLaw:
    """A law's functions for kernels. Equal laws share compiled kernels.

    A subclass is a frozen dataclass whose fields are the options that its functions choose by
    `ti.static`. What may differ without compiling anything again stands in `Constants`, a record
    that every function takes first (`c`). In a block of several foams its members are vectors, too,
    one number for each of several bonds, but in the functions that take numbers only.

    A bond remembers one number: the most compressive strain that it has met (`worst`, <= 0).
    Functions that a Runge-Kutta stage needs take numbers or vectors of them, one for each of
    several bonds, and have no branches on values.
    """

    Constants: ClassVar[Any]
    """Taichi dataclass of the law's constants, SI units."""

    tabulated: bool = False
    """Whether its functions look something up in `table`, at [c.place, row]."""
    table: Any = None
    """Field (foams, TABLE_ROWS) of TABLE_COLUMNS numbers; a law is given one by `with_table`."""
    heeds_rate: bool = False
    """Whether the worst strain is frozen in a step; `flowed` brings it up to date before it."""
    shears_stiffer: bool = False
    """Whether `shear_rise` adds to the shear modulus."""
    stiffens: bool = False
    """Whether `stiffening` is to be asked below `stiffens_below`."""

    def with_table(self, table: Any) -> "BondLaw":
        """This law, to be called where `table` is on the device."""
        law = copy.copy(self)
        object.__setattr__(law, "table", table)
        return law

    @ti.func
    def stress_fraction(self, c: ti.template(), e, worst, broken):
        """Engineering stress [Pa] at strain `e`, without stiffening, as (numerator, divisor > 0).

        Who divides by a length besides needs only one division so.
        """
        raise NotImplementedError

    @ti.func
    def stiffens_at(self, e, worst):
        """The strain that is to be compared with `stiffens_below`."""
        return e

    @ti.func
    def stiffens_below(self, c: ti.template()):
        """Strain below which a bond is stiffer than `largest_stiffness`: ask `stiffening`."""
        return -1.0

    @ti.func
    def stiffening(self, c: ti.template(), e, worst, broken):
        """Stress [Pa] that stiffening adds, and its slope [Pa]; zeros above `stiffens_below`."""
        return 0.0 * e, 0.0 * e

    @ti.func
    def normal_stress(self, c: ti.template(), e, worst, broken):
        """Engineering stress [Pa] at strain `e` with the history `worst`, intact or broken."""
        numerator, divisor = self.stress_fraction(c, e, worst, broken)
        stress = numerator / divisor
        if ti.static(self.stiffens):
            added, _ = self.stiffening(c, e, worst, broken)
            stress += added
        return stress

    @ti.func
    def flowed(self, c: ti.template(), e, worst, time):
        """The worst strain after `time` [s] at strain `e` (`heeds_rate` only)."""
        return worst

    @ti.func
    def stored_energy(self, c: ti.template(), e: ti.f64, worst: ti.f64, broken: ti.i32) -> ti.f64:
        """Energy per reference volume [J/m3] that unloading from `e` to zero stress gives back."""
        raise NotImplementedError

    @ti.func
    def energy_lost_by_breaking(self, c: ti.template(), e: ti.f64, worst: ti.f64) -> ti.f64:
        """Stored energy per reference volume [J/m3] that a bond which breaks cannot give back."""
        raise NotImplementedError

    @ti.func
    def shear_rise(self, c: ti.template(), e):
        """What compression to strain `e` adds to the shear modulus [Pa], and its slope over e."""
        return 0.0 * e, 0.0 * e

    @ti.func
    def shear_modulus(self, c: ti.template()):
        """Shear modulus [Pa]."""
        raise NotImplementedError

    @ti.func
    def fails(self, c: ti.template(), e, sigma_e, tau, worst, size, tensile, strength):
        """Whether an intact bond in this state breaks, in tension or in shear.

        `sigma_e` is its engineering stress without stiffening, `size` the product of the lengths of
        F's two columns there. `tensile` and `strength` are the bond's own strengths in tension and
        shear over the mean of whole ones.
        """
        raise NotImplementedError

    @ti.func
    def overload(self, c: ti.template(), e, sigma_e, tau, worst, size, tensile, strength):
        """Strain over the limit in tension, and shear stress over the strength; as for `fails`.

        It is asked for besides `fails` where bonds hold beyond their limits, see
        `BondFoam.limits`. The stresses are those of a whole bond.
        """
        raise NotImplementedError

    @ti.func
    def largest_stiffness(self, c: ti.template()) -> ti.f64:
        """The steepest d(sigma_e)/de [Pa] of all but `stiffening`."""
        raise NotImplementedError

    @ti.func
    def keeps_room_below(self, c: ti.template()) -> ti.f64:
        """A cell whose room is not below this has no `room_stress`."""
        return 0.0

    @ti.func
    def room_stress(self, c: ti.template(), area, room):
        """Pressure [Pa] of the foam in a cell that has less area than its bonds have left it.

        Both are over the cell's area at rest; the area is negative inside out. It is 0 where
        `area` is not below `room`.
        """
        return 0.0 * area

    @ti.func
    def room_energy(self, c: ti.template(), area, room):
        """Energy per reference volume [J/m3] that a cell of this room stores: the area under
        `room_stress` from `room` down to `area`.
        """
        return 0.0 * area

    @ti.func
    def room_stiffness(self, c: ti.template()) -> ti.f64:
        """The steepest slope of `room_stress` over the area [Pa]."""
        return 0.0

    @ti.func
    def contact_stress(
        self, c: ti.template(), gap: ti.f64, touch: ti.f64, length: ti.f64
    ) -> ti.f64:
        """Stress [Pa] between two pieces at a distance `gap` [m] that touch at `touch`.

        `length` is that of a cell.
        """
        raise NotImplementedError

    @ti.func
    def contact_energy(
        self, c: ti.template(), gap: ti.f64, touch: ti.f64, length: ti.f64
    ) -> ti.f64:
        """Energy [J/m3] over face times length that two such pieces store in their contact."""
        raise NotImplementedError

    @ti.func
    def contact_stiffness(self, c: ti.template()) -> ti.f64:
        """The steepest slope of `contact_stress` over gap / length [Pa]."""
        raise NotImplementedError
