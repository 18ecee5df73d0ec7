"""Base classes of bond laws: the parameters of a foam, and the functions that the engine calls.

A law is one module with two classes: a `BondFoam`, the values of a scene's `[foam]` table, and a
`BondLaw`, the law's functions for kernels. A foam's `law_for` gives the law of a scene. The engine
uses both only through these classes.
"""

import copy
import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from taichi_foam.backend import ti
from taichi_foam.laws import elementary
from taichi_foam.parts import Control, Part, quantity, text

TABLE_ROWS, TABLE_COLUMNS = 1001, 5
"""Size of the table that a law may have: one row each for strains of 0, -0.001 and so on to -1.

A law may have more columns, see `BondLaw.table_columns`.
"""

OPENING, SLIDING = 4.0, 2.0
"""Energy of a crack through brittle bonds over the energy stored in them: in opening, in sliding.

That of opening was measured in double cantilevers (docs/model.md, Cells). Sliding has not been
measured: the derivation there gives 2.3 pi (G / K) W = 2.2 W to its start, W = G gamma_t^2 L / 2.
"""


@dataclass(frozen=True)
class Limit:
    """How a bond's length changes a limit of its law, in tension or in shear.

    share  the bond's limit over the law's
    tail   overload (see `BondLaw.overload`) at which the bond breaks: beyond its limit the stress
           falls linearly to zero there; 1: it breaks at once
    """

    share: float = 1.0
    tail: float = 1.0

    @classmethod
    def for_crack(cls, cost: float, brittle: float, softening: bool) -> "Limit":
        """The limit that gives a crack its energy.

        `cost` is the energy of a crack over the energy stored in the bonds at the law's limit;
        through brittle bonds a crack takes `brittle` times the stored energy. The tail of softening
        bonds is at least `brittle`; in cells too large for it, the limit is lowered instead.
        """
        # a difference due to rounding only is removed: such cells match the law's exactly
        times = 1.0 if abs(cost / brittle - 1.0) < 1e-9 else cost / brittle
        if not softening:
            return cls(share=math.sqrt(times))
        return cls(share=math.sqrt(min(times, 1.0)), tail=brittle * max(times, 1.0))


@dataclass(frozen=True)
class Landmarks:
    """Strains and stresses of a foam that measures and pictures refer to; tension positive.

    crush_start      strain at which crushing begins, < 0
    crush_end        strain at which densification begins, < crush_start
    limit            most compressive strain that a picture's colour key must show, <= crush_end
    tensile          strain at which whole foam breaks in tension
    crushed_tensile  strain at which crushed foam breaks in tension
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
    """A key that only this law has: a table with this key and without `law` is of this law."""
    unless_given: ClassVar[Mapping[str, str]] = MappingProxyType({})
    """Keys that describe the foam itself, each with words for the value used if it is not given.

    For a user's foam, which gives some of these keys, the program reports the others with them.
    """
    controls: ClassVar[tuple[Control, ...]] = ()
    """Values that can be changed on a live page. A law lists those of its base classes, too."""
    source: str | None = text(
        None, "origin of its values: the name of a foam, a test, a publication", 1000
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
    crush_band: float | None = quantity(
        None,
        "m",
        "width of the bands in which foam crushes and shears: dashpots and rate dependence use "
        "strain rates, and the overshoot lasting strains, over this length, whatever the cell "
        "size; none: over one cell",
        at_least=1e-5,
        at_most=1,
    )
    strength_scatter: float = quantity(
        0.0,
        "-",
        "scatter of the bonds' strengths in tension and shear (Weibull), as standard deviation "
        "over mean; 0: all are equally strong",
        at_least=0,
        at_most=0.5,
    )
    strength_seed: int = quantity(
        0,
        "count",
        "seed of the random strengths",
        at_least=0,
        at_most=2**32 - 1,
        fix="each whole number gives other strengths",
    )

    def limits(self, length: float) -> tuple[Limit, Limit]:
        """The limits in tension and in shear of bonds of this length [m].

        A law without fracture energies has the same limits for every length.
        """
        return Limit(), Limit()

    @property
    def landmarks(self) -> Landmarks:
        """The foam's landmarks."""
        raise NotImplementedError

    def permanent_strain(self, worst: NDArray[np.float64]) -> NDArray[np.float64]:
        """Strain (<= 0) at zero stress of foam whose most compressive strain so far is `worst`."""
        raise NotImplementedError

    def loading(self, strain: NDArray[np.float64]) -> NDArray[np.float64] | None:
        """Static stress [Pa] on first loading, compression positive; None: unknown."""
        return None

    @property
    def recovers(self) -> bool:
        """Whether its bonds change while they rest between drops, see `rested`."""
        return False

    def rested(
        self, worst: NDArray[np.float64], own: Mapping[str, NDArray[np.float64]], time: float
    ) -> dict[str, NDArray[np.float64]]:
        """The histories of unloaded bonds after `time` [s], by the names of `BondLaw.History`.

        `worst` is their most compressive strain so far, `own` what else they remember.
        """
        return {"worst": worst, **own}

    @property
    def table(self) -> NDArray[np.float64] | None:
        """(TABLE_ROWS, `BondLaw.table_columns`) table of a `tabulated` law; None: it has none."""
        return None

    @property
    def most_damping(self) -> float | None:
        """Upper limit of the dashpot of a row of cells, per face area [Pa s/m]; None: no limit.

        The stress of dashpots is not part of a foam's measured curve.
        """
        return None

    @property
    def tested_strain(self) -> float | None:
        """The most compressive strain (< 0) that the foam was tested to; None: unknown."""
        return None

    @property
    def used_up_strain(self) -> float:
        """Strain (< 0) at which the foam counts as used up: the end of its test, or `crush_end`."""
        tested = self.tested_strain
        return self.landmarks.crush_end if tested is None else tested

    def law_for(self, model: Any) -> "BondLaw":
        """The law's functions, with the options of this foam and of a scene's `model` built in."""
        raise NotImplementedError

    def constants(self, model: Any) -> dict[str, float]:
        """Values for the members of the law's `Constants`."""
        raise NotImplementedError


@ti.dataclass
class History:
    """What a bond remembers: its most compressive strain so far, <= 0."""

    worst: ti.f64


class BondLaw:
    """A law's functions for kernels. Equal laws share compiled kernels.

    A subclass is a frozen dataclass whose fields are the options that its functions select by
    `ti.static`. Values that may change without recompiling are in `Constants`, a record that every
    function takes as its first argument (`c`). In a block of several foams its members are vectors,
    one component per bond, except in the functions that take scalars only.

    What a bond remembers is a `History`, of which functions get that of the last accepted state, or
    that which `met` makes of it at the present strain; so a function that must include the present
    strain calls `met`. Functions that a Runge-Kutta stage needs take scalars, or vectors with one
    component per bond, and have no branches on values.
    """

    Constants: ClassVar[Any]
    """Taichi dataclass of the law's constants, SI units."""
    History: ClassVar[Any] = History
    """Taichi dataclass of what a bond remembers, all in 64 bits. The first member is `worst`, the
    most compressive strain so far (deeper where foam in shear yielded sooner), which cells,
    contact, pictures and measures read; the others are the law's own. All are 0 in foam that has
    met nothing. The state, checkpoints, snapshots and the next impact on the same block keep
    them."""

    tabulated: bool = False
    """Whether its functions read `table`, at [c.place, row]."""
    table: Any = None
    """Field (foams, TABLE_ROWS) of `table_columns` numbers, set by `with_table`."""
    table_columns: int = TABLE_COLUMNS
    heeds_rate: bool = False
    """Whether a history also changes in time: `flowed` updates it before each step."""
    looks_around: bool = False
    """Whether `flowed` depends on the bonds around (`heeds_rate` only)."""
    only_flows: bool = False
    """Whether `met` changes nothing: a history changes in time alone (`heeds_rate` only). The
    engine then stores no history within a step."""
    yields_in_shear: bool = False
    """Whether shear and crush have one yield surface (Model.shear_yield)."""
    shears_stiffer: bool = False
    """Whether `shear_rise` adds to the shear modulus."""
    stiffens: bool = False
    """Whether `stiffening` must be called below `stiffens_below`."""

    def with_table(self, table: Any) -> "BondLaw":
        """This law, reading the field `table`."""
        law = copy.copy(self)
        object.__setattr__(law, "table", table)
        return law

    @ti.func
    def met(self, c: ti.template(), e, history: ti.template()):
        """The history of a bond that had `history` and is now at strain `e`; no time passes.

        Every stage of a step asks this of the history at its start. Twice must be as once.
        """
        now = history
        now.worst = elementary.smaller(e, history.worst)
        return now

    @ti.func
    def stress_fraction(self, c: ti.template(), e, history: ti.template(), broken):
        """Engineering stress [Pa] at strain `e`, without stiffening, as (numerator, divisor > 0).

        A caller that also divides by a length then needs only one division.
        """
        raise NotImplementedError

    @ti.func
    def stiffens_at(self, e, history: ti.template()):
        """The strain to compare with `stiffens_below`."""
        return e

    @ti.func
    def stiffens_below(self, c: ti.template()):
        """Strain below which a bond is stiffer than `largest_stiffness`: call `stiffening`."""
        return -1.0

    @ti.func
    def stiffening(self, c: ti.template(), e, history: ti.template(), broken):
        """Stress [Pa] that stiffening adds, and its slope [Pa]; zeros above `stiffens_below`."""
        return 0.0 * e, 0.0 * e

    @ti.func
    def normal_stress(self, c: ti.template(), e, history: ti.template(), broken):
        """Engineering stress [Pa] at strain `e`, intact or broken."""
        numerator, divisor = self.stress_fraction(c, e, history, broken)
        stress = numerator / divisor
        if ti.static(self.stiffens):
            added, _ = self.stiffening(c, e, history, broken)
            stress += added
        return stress

    @ti.func
    def flows(self, c: ti.template(), e, history: ti.template()):
        """Whether the history changes in time at strain `e` (`heeds_rate` only)."""
        return e < history.worst

    @ti.func
    def flowed(self, c: ti.template(), e, history: ti.template(), time, slowed, around):
        """The history after `time` [s] at strain `e` (`heeds_rate` only).

        `slowed` is a time over `time`: that in which foam flows if only part of the strain rate
        counts, see `BondFoam.crush_band`. `around` is the worst strain of the four bonds around
        this one along the same axis, two in line and two abreast, if the law `looks_around`, and 0
        if not.
        """
        return history

    @ti.func
    def stored_energy(
        self, c: ti.template(), e: ti.f64, history: ti.template(), broken: ti.i32
    ) -> ti.f64:
        """Energy per reference volume [J/m3] released on unloading from `e` to zero stress."""
        raise NotImplementedError

    @ti.func
    def energy_lost_by_breaking(
        self, c: ti.template(), e: ti.f64, history: ti.template()
    ) -> ti.f64:
        """Stored energy per reference volume [J/m3] that is lost when a bond breaks."""
        raise NotImplementedError

    @ti.func
    def lasting_crush(self, c: ti.template(), worst):
        """Crush that lasts of a bond that remembers `worst` (`yields_in_shear` only)."""
        raise NotImplementedError

    @ti.func
    def plateau_stress(self, c: ti.template()):
        """Stress of the plateau [Pa], above 0 (`yields_in_shear` only)."""
        raise NotImplementedError

    @ti.func
    def yields_as_at(self, c: ti.template(), e, share):
        """The strain at which a bond without shear would yield as one at `e` does with shear.

        Shear leaves `share` of the plateau's stress to the bond (`yields_in_shear` only).
        """
        raise NotImplementedError

    @ti.func
    def shear_rise(self, c: ti.template(), e):
        """Increase of the shear modulus [Pa] by compression to strain `e`, and its slope over e."""
        return 0.0 * e, 0.0 * e

    @ti.func
    def shear_modulus(self, c: ti.template()):
        """Shear modulus [Pa]: tau = G gamma (Eq. 25)."""
        return c.shear_modulus

    @ti.func
    def fails(
        self, c: ti.template(), e, sigma_e, tau, history: ti.template(), size, tensile, strength
    ):
        """Whether an intact bond in this state breaks, in tension or in shear.

        `sigma_e` is its engineering stress without stiffening, `size` the product of the lengths of
        F's two columns there. `tensile` and `strength` are the bond's limits in tension and shear
        over the law's.
        """
        raise NotImplementedError

    @ti.func
    def overload(
        self, c: ti.template(), e, sigma_e, tau, history: ti.template(), size, tensile, strength
    ):
        """Strain over the limit in tension, and shear stress over the strength; see `fails`.

        Called in addition to `fails` where bonds soften beyond their limits, see `BondFoam.limits`.
        The stresses are those of a bond without softening.
        """
        raise NotImplementedError

    @ti.func
    def largest_stiffness(self, c: ti.template()) -> ti.f64:
        """The largest d(sigma_e)/de [Pa], without `stiffening`."""
        raise NotImplementedError

    @ti.func
    def keeps_room_below(self, c: ti.template()) -> ti.f64:
        """Area, relative to that at rest, from which on a cell has no `room_stress`, see there."""
        return 0.0

    @ti.func
    def room_stress(self, c: ti.template(), area, room):
        """Pressure [Pa] of the foam in a cell that has less area than its bonds have left it.

        `area` and `room` are relative to the cell's area at rest; `area` is negative if the cell is
        inside out. The pressure is 0 unless `area` is below `room`. For the same area it must not
        rise as `room` falls: crushing bonds does no work on the cell.
        """
        return 0.0 * area

    @ti.func
    def room_energy(self, c: ti.template(), area, room):
        """Energy per reference volume [J/m3] that a cell stores.

        It is the integral of `room_stress` from `room` down to `area`.
        """
        return 0.0 * area

    @ti.func
    def room_stiffness(self, c: ti.template()) -> ti.f64:
        """The largest slope of `room_stress` over the area [Pa]."""
        return 0.0

    @ti.func
    def contact_stress(
        self, c: ti.template(), gap: ti.f64, touch: ti.f64, length: ti.f64
    ) -> ti.f64:
        """Stress [Pa] of the foam between a node and its support, at a distance `gap` [m].

        The foam is `length` thick at rest, and `touch` as crushing has left it [m]. By default it
        is elastic.
        """
        return c.youngs_modulus * (gap - touch) / length

    @ti.func
    def contact_energy(
        self, c: ti.template(), gap: ti.f64, touch: ti.f64, length: ti.f64
    ) -> ti.f64:
        """Energy that this foam stores, over face times length [J/m3]."""
        return 0.5 * c.youngs_modulus * (gap - touch) * (gap - touch) / (length * length)

    @ti.func
    def piece_stiffness(self, c: ti.template()) -> ti.f64:
        """Stress between two pieces over their overlap in cells [Pa], a constant of the foam.

        Pieces are elastic: the foam behind their faces crushes, by bonds that remember it.
        """
        return c.youngs_modulus
