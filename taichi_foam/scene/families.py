"""Foams of the library that come in any density of a range: rigid polyurethane, polystyrene.

A family has few measured or specified values. What follows from them, and what is assumed beyond
them, is said of each foam by its `FoamFile`.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from taichi_foam.laws.bond import Curve
from taichi_foam.laws.bond.by_curve import SHEAR_OVER_YOUNG
from taichi_foam.laws.bond.kinds.crushable import Foam
from taichi_foam.laws.bond.kinds.tabulated import TabulatedFoam
from taichi_foam.scene.assumed import Origin
from taichi_foam.scene.foam_file import FoamFile
from taichi_foam.units import STRESS_UNITS

Array = NDArray[np.float64]

ATMOSPHERE = 101_325.0
"""Pressure of the gas in closed cells before they are compressed [Pa]."""


@dataclass(frozen=True)
class Family:
    """Foams of one kind, named by their density: `eps-20`, `rigid-pu-40`.

    head     beginning of their names
    about    what they are, and how a density's values are found
    range    smallest and largest density [kg/m3]
    limit    why there are no others
    points   densities [kg/m3] of which there are values; the others follow from these
    make     the foam of a density [kg/m3]
    """

    head: str
    about: tuple[str, str]
    range: tuple[float, float]
    limit: str
    points: tuple[float, ...]
    make: Callable[[float], FoamFile]

    def density(self, name: str) -> float | None:
        """The density [kg/m3] in a name, in range or not; None: not a name of this family."""
        found = re.fullmatch(rf"{re.escape(self.head)}(\d+(?:\.\d+)?)", name)
        return float(found[1]) if found else None

    def names(self) -> list[str]:
        """The names of the densities of which there are values."""
        return [f"{self.head}{density:g}" for density in self.points]

    @property
    def words(self) -> str:
        """What can be named, in one line."""
        (low, high), (what, how) = self.range, self.about
        return f"{self.head}NN: {what} of NN kg/m3, {low:g} to {high:g}, {how}"

    def span(self) -> str:
        """The range in words: eps-14.4 to eps-38.4."""
        low, high = self.range
        return f"{self.head}{low:g} to {self.head}{high:g}"


# --- rigid polyurethane -------------------------------------------------------------------------

CELL_WALLS = 127e6
"""Yield stress of solid polyurethane [Pa] (Gibson & Ashby 1997)."""

POLYURETHANE = 1200.0
"""Density of solid polyurethane [kg/m3] (Gibson & Ashby 1997)."""


def rigid_pu(density: float) -> FoamFile:
    """Rigid polyurethane of a density [kg/m3]: the plateau is scaled, the rest assumed."""
    plateau = 0.3 * CELL_WALLS * (density / POLYURETHANE) ** 1.5
    paper = Foam()
    young = plateau / -paper.yield_strain
    shear = paper.shear_modulus / paper.youngs_modulus * young
    missed = (
        "that of the paper's foam, {}: the scaling does not reproduce it for that foam ({}), so "
        "it is not used here"
    )
    why = {
        "youngs_modulus": "plateau over the paper's yield strain of 0.05: the scaling for open "
        "cells does not reproduce the paper's modulus (0.73 against 2.78 MPa), so it is not "
        "used here",
        "shear_modulus": "the same fraction of Young's modulus as in the paper's foam, 0.30",
        "densification_strain": missed.format("-0.80", "-0.97"),
        **dict.fromkeys(
            ("yield_strain", "tensile_strain", "shear_strain", "locking_strain",
             "densification_a", "densification_b", "crushed_tensile_fraction"),
            "that of the paper's foam",
        ),
    }  # fmt: skip
    return FoamFile(
        title=f"Rigid polyurethane foam of {density:g} kg/m3, scaled",
        source="plateau 0.3 x 127 MPa x (density / 1200 kg/m3)^1.5 (Gibson & Ashby 1997): 0.119 "
        "MPa at 25.6 kg/m3, where 0.12 MPa was measured (Shim, Tu & Lim 2000)",
        licence="formula and figures as published",
        density=density,
        measured=(f"nothing at this density; plateau of {plateau / 1e3:.1f} kPa by the scaling",),
        assumed=tuple(Origin(key=f"foam.{key}", why=words) for key, words in why.items()),
        foam=Foam(
            youngs_modulus=young,
            shear_modulus=shear,
            **{key: getattr(paper, key) for key in why if not key.endswith("modulus")},
        ),
    )


# --- expanded polystyrene -----------------------------------------------------------------------

POLYSTYRENE = 1050.0
"""Density of solid polystyrene [kg/m3] (Gibson & Ashby 1997)."""

TYPES = ("EPS15", "EPS19", "EPS22", "EPS29", "EPS39")
"""Types of ASTM D6817 in the order of `DENSITIES`."""

DENSITIES = (14.4, 18.4, 21.6, 28.8, 38.4)
"""Least densities of these types [kg/m3]."""

SPECIFIED = (0.01, 0.05, 0.10)
"""Strains at which the standard specifies the least compressive resistance."""

RESISTANCES = (
    (25e3, 40e3, 50e3, 75e3, 103e3),
    (55e3, 90e3, 115e3, 170e3, 241e3),
    (70e3, 110e3, 135e3, 200e3, 276e3),
)
"""Least compressive resistance [Pa] at these strains, type by type (ASTM D6817, Table 1)."""

TENSION = ((16, 20), (17, 21), (18, 22), (23, 27))
SHEAR = ((18, 22), (23, 25), (26, 32), (33, 37))
"""Typical strengths [psi] of types I, VIII, II and IX of ASTM C578, which have the least densities
of the first four types; of the fifth there are none."""

LOCKING = 1.4
"""Closed cells lock at a strain of 1 - 1.4 times the relative density (Gibson & Ashby 1997)."""

RISE = 2.3
"""D of the densification of Maiti, Gibson & Ashby (1984), with the exponent 1."""

END = 0.9
"""Largest strain of the curve of polystyrene."""


def eps(density: float) -> FoamFile:
    """Expanded polystyrene of a density [kg/m3] from 14.4 to 38.4, by the minima of ASTM D6817.

    Between two types each value is a power of the density, a straight line in logarithms.
    """
    stresses = [round(_at(density, values), 1) for values in RESISTANCES]
    between = _types_around(density)
    strengths = [_at(density, [sum(pair) / 2 for pair in each]) for each in (TENSION, SHEAR)]
    tension, shear = (psi * STRESS_UNITS["psi"] for psi in strengths)
    relative = density / POLYSTYRENE
    young = stresses[0] / SPECIFIED[0]
    foam = TabulatedFoam(
        curve=eps_curve(stresses, relative),
        locking_strain=-(1.0 - LOCKING * relative),
        tensile_strain=tension / young,
        shear_strain=shear / (SHEAR_OVER_YOUNG * young),
    )
    resistances = ", ".join(
        f"{stress / 1e3:.3g} kPa at {100 * strain:g} %"
        for strain, stress in zip(SPECIFIED, stresses, strict=True)
    )
    typical = density <= DENSITIES[len(TENSION) - 1]
    strength = "typical {0} of its density, {1:.0f} kPa, over {2}"
    if not typical:
        strength = (
            "published up to 28.8 kg/m3 only, and continued as a power of the density: {0} of "
            "{1:.0f} kPa, over {2}"
        )
    strains = {
        "tensile_strain": strength.format("tension", tension / 1e3, "Young's modulus"),
        "shear_strain": strength.format("shear strength", shear / 1e3, "the shear modulus"),
    }
    reasons = {
        "law": "it crushes the foam for good; polystyrene springs back in part after the blow, so "
        "a second drop on the same foam is not in it",
        "curve": f"up to 10 % of strain the values of the standard, joined by lines; beyond, gas "
        "that is compressed in closed cells, p0 e / (1 - e - r), and cell walls with the rest of "
        f"the stress at 10 %, times eD / ({RISE:g} (eD - e)) where that is above 1 (Maiti, Gibson "
        f"& Ashby 1984), eD = 1 - {LOCKING:g} r, p0 = 101 kPa, r = {relative:.4f} the density over "
        "that of solid polystyrene",
        **TabulatedFoam.unless_given,
        "locking_strain": f"1 - {LOCKING:g} times the relative density (Gibson & Ashby 1997)",
    }
    derived = {
        "youngs_modulus": "the curve's first slope: the resistance at 1 % of strain over 1 %",
    }
    if typical:
        derived |= strains
    else:
        reasons |= strains
    assumed = {key: why for key, why in reasons.items() if key not in derived}
    return FoamFile(
        title=f"Expanded polystyrene of {density:g} kg/m3, by the minima of {between}",
        source="least compressive resistance: ASTM D6817, Table 1; tension and shear: typical "
        "values by density as makers publish them with ASTM C578",
        licence="figures as published",
        density=density,
        rate=round(0.1 / 60, 6),
        known_to=SPECIFIED[-1],
        measured=(
            f"least resistance, which most foam exceeds: {resistances} of strain"
            + ("" if density in DENSITIES else "; interpolated in density"),
            "tension 16-20, 17-21, 18-22, 23-27 psi and shear 18-22, 23-25, 26-32, 33-37 psi at "
            "14.4, 18.4, 21.6, 28.8 kg/m3, of which the means are used",
            "shear modulus 280 to 640 psi: not used, as an isotropic foam of this Young's modulus "
            "cannot have it",
        ),
        derived=tuple(Origin(key=f"foam.{key}", why=why) for key, why in derived.items()),
        assumed=tuple(Origin(key=f"foam.{key}", why=why) for key, why in assumed.items()),
        foam=foam,
    )


def eps_curve(stresses: Sequence[float], relative: float) -> Curve:
    """The curve of polystyrene: specified stresses [Pa] to 10 %, and a continuation to `END`.

    Beyond 10 % the gas in closed cells and the cell walls resist side by side (Gibson & Ashby
    1997, Eq. 5.23). The gas is compressed without a change of temperature; the walls keep their
    stress, and densify after Maiti, Gibson & Ashby (1984), m = 1.

    Args:
        relative: density over that of solid polystyrene.
    """

    def gas(strain: Array) -> Array:
        return ATMOSPHERE * strain / (1.0 - strain - relative)

    last, locking = SPECIFIED[-1], 1.0 - LOCKING * relative
    densifies = locking * (1.0 - 1.0 / RISE)
    strain = np.union1d(np.linspace(last, END, round((END - last) / 0.005) + 1)[1:], densifies)
    walls = stresses[-1] - gas(np.array(last))
    stress = gas(strain) + walls * np.maximum(locking / (RISE * (locking - strain)), 1.0)
    return Curve(
        strain=(0.0, *SPECIFIED, *np.round(strain, 6).tolist()),
        stress=(0.0, *stresses, *np.round(stress, 1).tolist()),
    )


def _at(density: float, values: Sequence[float]) -> float:
    """A value at a density [kg/m3] from those of the first types: a power between each two.

    Beyond the last value the power is that between the last two.
    """
    known = DENSITIES[: len(values)]
    upper = min(int(np.searchsorted(known, density, side="right")), len(known) - 1)
    low, high = upper - 1, upper
    power = np.log(values[high] / values[low]) / np.log(known[high] / known[low])
    return float(values[low] * (density / known[low]) ** power)


def _types_around(density: float) -> str:
    """The type of a density [kg/m3], or the two types between which it lies."""
    if density in DENSITIES:
        return TYPES[DENSITIES.index(density)]
    upper = int(np.searchsorted(DENSITIES, density))
    return f"{TYPES[upper - 1]} to {TYPES[upper]}"


FAMILIES = (
    Family(
        head="eps-",
        about=("expanded polystyrene", "interpolated"),
        range=(DENSITIES[0], DENSITIES[-1]),
        limit="resistances are specified for densities",
        points=DENSITIES,
        make=eps,
    ),
    Family(
        head="rigid-pu-",
        about=("rigid polyurethane", "scaled"),
        range=(20.0, 100.0),
        limit="the plateau is scaled for densities",
        points=(),
        make=rigid_pu,
    ),
)
