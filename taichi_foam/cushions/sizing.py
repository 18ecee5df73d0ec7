"""Pads by the energy balance: which foam, how thick, how large, for a product that must survive.

On a cushion of the thickness T a product of the static stress sigma_st, which falls from the height
h, stops at the strain e where T W(e) = sigma_st (h + e T) (formulas/energy). Given the strain,
static stress and deceleration follow without solving anything:

    sigma_st = W / (h/T + e),    G + 1 = sigma (h/T + e) / W

A cushion curve is this pair over all strains of the foam's test, so that thousands of pads take
milliseconds.

A pad that is dropped on again starts where the drop before has left it, at the permanent strain p
of its worst strain d, and returns along the line on which it was unloaded:

    W(e) - W(d) + sigma(d) (d - p) / 2 = sigma_st (h/T + e - p)
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from taichi_foam.cushions.scenes import called, stress_over
from taichi_foam.formulas.energy import absorbed_energy
from taichi_foam.laws.bond import BondFoam, Curve
from taichi_foam.laws.bond.curve import PLATEAU
from taichi_foam.laws.bond.kinds.tabulated import TabulatedFoam
from taichi_foam.parts import Part, choice, quantity
from taichi_foam.scene import Block, library
from taichi_foam.units import STANDARD_GRAVITY, rounded

Array = NDArray[np.float64]

RESERVE = 0.1
"""Part of the fragility that a pad leaves unused by the formulas."""

HEAVIER = 0.05
"""Part by which a pad holds a heavier product, too, so that it is not about to bottom out."""

SLENDER = 1.33
"""Side of a square pad over its thickness below which it may buckle: A = (1.33 T)^2.

ETHAFOAM package design guide (Dow; Sealed Air), step four; ascribed to Kerstner.
"""

CREEP = 0.25
"""Static stress over the plateau's, up to which creep is negligible.

Assumed for all foams. EPS under 26 % of its stress at 5 % of strain crept by 0.3 % in eight weeks,
under 44 % by 1.6, under 69 % by 7.5 % (Negussey & Jahanandish 1993); polyethylene foam of 35 kg/m3
may carry 17 kPa (ETHAFOAM package design guide), a third of its plateau.
"""

_RIGID = (20, 30, 40, 60, 80, 100)
"""Densities of rigid polyurethane that are tried [kg/m3]."""

_POINTS = 801
_HALVINGS = 50


@dataclass(frozen=True)
class Cushioning:
    """A foam as the energy balance sees it, up to the end of its test.

    name      as it was asked for: in the library, or of a file
    title     what foam it is
    source    who measured it
    assumed   what is assumed of it, in words
    density   kg/m3
    foam      its constants
    to_limit  whether its curve goes on to the limit of its law, where the foam counts as used up
    """

    name: str
    title: str
    source: str
    assumed: tuple[str, ...]
    density: float
    foam: BondFoam
    to_limit: bool = False

    @property
    def label(self) -> str:
        """Its name in tables; of a file, the file's."""
        return called(self.name)

    @cached_property
    def strain(self) -> Array:
        """(n,) strains in compression, positive, from 0 to the end of the test."""
        limit = self.foam.landmarks.limit * (1.0 - 1e-3)
        end = limit if self.to_limit else self.foam.used_up_strain
        return np.linspace(0.0, -end, _POINTS)

    @cached_property
    def stress(self) -> Array:
        """(n,) static stress there [Pa], positive."""
        return stress_over(self.foam, self.strain, f"foam = {self.name}")

    @cached_property
    def energy(self) -> Array:
        """(n,) energy absorbed up to there [J/m3]."""
        return absorbed_energy(self.strain, self.stress)

    @cached_property
    def plateau(self) -> float:
        """Mean stress of the plateau, between 20 and 40 % of strain [Pa] (ISO 13314)."""
        low, high = np.interp(PLATEAU, self.strain, self.energy)
        return float((high - low) / (PLATEAU[1] - PLATEAU[0]))

    @cached_property
    def permanent(self) -> Array:
        """(n,) strains that remain after these strains, positive."""
        return -self.foam.permanent_strain(-self.strain)


@dataclass(frozen=True)
class Response:
    """A cushion curve: the last of a number of drops, over the static stress.

    static  (n,) static stress [Pa], rising
    g       (n,) largest deceleration [g]; inf where the foam is used up
    strain  (n,) strain of the cushion at the stop; its end where the foam is used up
    """

    static: Array
    g: Array
    strain: Array

    def at(self, static: float) -> tuple[float, float]:
        """Deceleration [g] and strain at a static stress [Pa]; inf beyond the curve."""
        if static > self.static[-1]:
            return math.inf, float(self.strain[-1])
        return (
            float(np.interp(static, self.static, self.g)),
            float(np.interp(static, self.static, self.strain)),
        )

    @property
    def best(self) -> int:
        """Index of the least deceleration."""
        return int(np.argmin(self.g))

    def range(self, most: float) -> tuple[float, float] | None:
        """Static stresses [Pa] between which no deceleration exceeds `most` [g]; None: nowhere."""
        best = self.best
        if not self.g[best] <= most:
            return None
        ends = []
        for way in (-1, 1):
            inside, beyond, share = passed(self.g, best, way, most)
            width = self.static[beyond] - self.static[inside]
            ends.append(float(self.static[inside] + share * width))
        return ends[0], ends[1]


def passed(y: Array, place: int, way: int, most: float) -> tuple[int, int, float]:
    """Where a curve of points passes `most`, from a place on to the left (-1) or right (1).

    The last point that does not exceed it, the next point, and the share of the way between them;
    0 if there is no next one, or it is not finite.
    """
    while 0 <= place + way < y.size and y[place + way] <= most:
        place += way
    beyond = place + way
    if not 0 <= beyond < y.size or not math.isfinite(y[beyond]):
        return place, place, 0.0
    return place, beyond, float((most - y[place]) / (y[beyond] - y[place]))


def response(foam: Cushioning, thickness: float, drop: float, drops: int = 1) -> Response:
    """The cushion curve of a foam, of a thickness [m] and a drop height [m], at the last drop."""
    fall, strain = drop / thickness, foam.strain[1:]
    static = foam.energy[1:] / (fall + strain)
    for _ in range(drops - 1):
        strain = _again(foam, static, strain, fall)
    peak = np.interp(strain, foam.strain, np.maximum.accumulate(foam.stress))
    if drops > 1:
        peak = np.where(strain >= foam.strain[-1], math.inf, peak)
    return Response(static, peak / static - 1.0, strain)


def _again(foam: Cushioning, static: Array, worst: Array, fall: float) -> Array:
    """Strains after one more drop on cushions that have been crushed to `worst` strains.

    The end of the test, if the energy that is left to it does not suffice.
    """
    left = np.interp(worst, foam.strain, foam.permanent)
    stored = 0.5 * np.interp(worst, foam.strain, foam.stress) * (worst - left)
    taken = np.interp(worst, foam.strain, foam.energy) - stored
    low, high = worst.copy(), np.full_like(worst, foam.strain[-1])
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        needed = static * (fall + middle - left)
        short = np.interp(middle, foam.strain, foam.energy) - taken < needed
        low, high = np.where(short, middle, low), np.where(short, high, middle)
    return high


class Wish(Part):
    """What a cushion is to do. SI units."""

    mass: float = quantity(..., "kg", "of the product", above=0)
    drop: float = quantity(..., "m", "drop height", above=0)
    fragility: float = quantity(
        ...,
        "g",
        "largest deceleration that the product survives",
        at_least=1,
        fix="it is in g, not in m/s2: 15 to 25 g for the most fragile products, 40 to 60 g for "
        "electronics; 1 g is what a product carries at rest",
    )
    drops: int = quantity(
        1, "-", "falls that it survives on one cushion", at_least=1, at_most=20, fix="1 is usual"
    )
    stock: tuple[Annotated[float, Field(gt=0)], ...] = Field(
        description="thicknesses to choose from [m]",
        json_schema_extra={"allowed": "above 0 m", "fix": "50 mm is 0.05"},
    )
    max_thickness: float | None = quantity(None, "m", "largest one that has room", above=0)
    max_area: float | None = quantity(
        None, "m2", "largest area of the pad", above=0, fix="115 cm2 is 0.0115"
    )
    braced: bool = choice(False, "pads are held at their sides, so that tall ones do not buckle")
    dv_critical: float | None = quantity(
        None, "m/s", "critical velocity change of the product", above=0, fix="2 to 8 are usual"
    )
    temperature: float | None = quantity(
        None, "C", "most extreme one of transport", at_least=-100, at_most=200, fix="0 C is 32 F"
    )

    @property
    def weight(self) -> float:
        """Weight of the product [N]."""
        return self.mass * STANDARD_GRAVITY

    @property
    def thicknesses(self) -> list[float]:
        """Those of the stock that have room, from thin to thick [m]."""
        most = math.inf if self.max_thickness is None else self.max_thickness * (1.0 + 1e-9)
        return [each for each in sorted(self.stock) if each <= most]


@dataclass(frozen=True)
class Pad:
    """A pad for a wish. SI units.

    foam       what it is made of
    thickness  m
    area       m2
    g, strain  largest deceleration [g] and strain of the last drop, by the formulas
    statics    least and largest static stress [Pa] that it protects at the same fragility
    wish       what it is for
    """

    foam: Cushioning
    thickness: float
    area: float
    g: float
    strain: float
    statics: tuple[float, float]
    wish: Wish

    @property
    def static_stress(self) -> float:
        """Weight over area [Pa]."""
        return self.wish.weight / self.area

    @property
    def masses(self) -> tuple[float, float]:
        """Least and largest mass [kg] that it protects at the same fragility."""
        least, largest = (each * self.area / STANDARD_GRAVITY for each in self.statics)
        return least, largest

    @property
    def volume(self) -> float:
        """Volume of the foam [m3]."""
        return self.area * self.thickness

    @property
    def reserve(self) -> float:
        """Part of the fragility that it leaves unused."""
        return 1.0 - self.g / self.wish.fragility


def pad(foam: Cushioning, wish: Wish, thickness: float) -> Pad | None:
    """The pad of a foam and a thickness [m]; None: it does not meet the wish.

    By the formulas it leaves a `RESERVE` of the fragility, and holds a product that is `HEAVIER`.
    Its static stress is the geometric middle of those that do, and that neither creep nor buckle.
    """
    curve = response(foam, thickness, wish.drop, wish.drops)
    safe, wanted = curve.range(wish.fragility), curve.range((1.0 - RESERVE) * wish.fragility)
    if safe is None or wanted is None:
        return None
    least = 0.0 if wish.max_area is None else wish.weight / wish.max_area
    largest = [safe[1] / (1.0 + HEAVIER), CREEP * foam.plateau]
    if not wish.braced:
        largest.append(wish.weight / (SLENDER * thickness) ** 2)
    low, high = max(wanted[0], least), min(wanted[1], *largest)
    if low > high:
        return None
    area = rounded(wish.weight / math.sqrt(low * high), 3)
    g, strain = curve.at(wish.weight / area)
    return Pad(foam, thickness, area, g, strain, safe, wish)


def candidates(foams: Sequence[Cushioning], wish: Wish) -> list[Pad]:
    """The thinnest pad of each foam that meets the wish: thinnest first, then the least foam."""
    found = (_thinnest(foam, wish, wish.thicknesses) for foam in foams)
    return sorted((each for each in found if each is not None), key=rank)


def thicker(pad_: Pad) -> Pad | None:
    """The next pad of the same foam that is thicker; None: there is none."""
    rest = [each for each in pad_.wish.thicknesses if each > pad_.thickness]
    return _thinnest(pad_.foam, pad_.wish, rest)


def _thinnest(foam: Cushioning, wish: Wish, thicknesses: Sequence[float]) -> Pad | None:
    """The first pad that meets the wish, of thicknesses from thin to thick; None: none does."""
    pads = (pad(foam, wish, each) for each in thicknesses)
    return next((each for each in pads if each is not None), None)


def rank(pad_: Pad) -> tuple[float, float]:
    """The order of pads: thinnest first, then the least foam."""
    return pad_.thickness, pad_.volume


@dataclass(frozen=True)
class Relaxed:
    """A wish that is met when one value is relaxed.

    key          which one
    value        the value that is needed, in its SI unit
    by           how much it differs, relative to the wish
    pad          the pad that then fits
    """

    key: str
    value: float
    by: float
    pad: Pad


def relaxed(foams: Sequence[Cushioning], wish: Wish) -> list[Relaxed]:
    """What to relax if nothing fits, and by how much: each value alone, the smallest change first.

    A value that helps at no amount is missing.
    """
    found = [
        _searched(foams, wish, "fragility", 10.0),
        _searched(foams, wish, "drop", 0.05),
    ]
    if wish.max_thickness is not None:
        for each in sorted(wish.stock):
            wider = wish.with_computed(max_thickness=each)
            if each > wish.max_thickness and (pads := candidates(foams, wider)):
                change = each / wish.max_thickness - 1.0
                found.append(Relaxed("max_thickness", each, change, pads[0]))
                break
    if wish.max_area is not None:
        found.append(_searched(foams, wish, "max_area", 100.0))
    if not wish.braced and (pads := candidates(foams, wish.with_computed(braced=True))):
        found.append(Relaxed("braced", 1.0, 1.0, pads[0]))
    return sorted((each for each in found if each is not None), key=lambda each: abs(each.by))


def _searched(foams: Sequence[Cushioning], wish: Wish, key: str, most: float) -> Relaxed | None:
    """The smallest change of a value at which something fits, up to the factor `most`."""
    value = getattr(wish, key)

    def fitting(power: float) -> list[Pad]:
        return candidates(foams, wish.with_computed(**{key: value * most**power}))

    pads, low, high = fitting(1.0), 0.0, 1.0
    if not pads:
        return None
    while high - low > 1e-3:
        middle = 0.5 * (low + high)
        if here := fitting(middle):
            pads, high = here, middle
        else:
            low = middle
    needed = float(getattr(pads[0].wish, key))
    return Relaxed(key, needed, needed / value - 1.0, pads[0])


def known() -> list[str]:
    """The foams that are tried if none is named: the library's, and rigid polyurethane."""
    return [*library.listed(), *(f"rigid-pu-{density}" for density in _RIGID)]


def cushioning(name: str) -> Cushioning:
    """A foam of the library, of a foam file (.toml) or of a compression test (.csv).

    Raises UserError: there is no such foam, its file is invalid, or its law states no stress.
    """
    found = library.foam_or_curve(name)
    if isinstance(found, Curve):
        made = TabulatedFoam(curve=found)
        file = Path(name).name
        said = tuple(f"foam.{key}: {why}" for key, why in made.unless_given.items())
        density = Block().density
        said = (f"block.density: {density:g} kg/m3, of the paper's foam", *said)
        return Cushioning(name, f"the test in {file}", file, said, density, made)
    stress_over(found.foam, np.zeros(1), f"foam = {name}")  # refused before anything is tried
    assumed = tuple(f"{each.key}: {each.why}" for each in found.assumed)
    return Cushioning(name, found.title, found.source, assumed, found.density, found.foam)
