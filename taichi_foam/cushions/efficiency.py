"""How much energy foams absorb, and at what stress: efficiency, ideality, and the best of several.

A cushion must stop a product without a larger stress than the product withstands. The energy W
that a foam has absorbed when it reaches the stress sigma is therefore judged by its efficiency
W / sigma, the stroke of an ideal absorber as a strain. It is largest where the foam begins to
densify, at the shoulder of its energy-absorption diagram. Formulas and sources: `formulas/energy`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from taichi_foam.cushions.scenes import stress_over
from taichi_foam.cushions.shown import units_named
from taichi_foam.errors import UserError
from taichi_foam.formulas import energy as formulas
from taichi_foam.formulas.envelope import Envelope, shoulder_envelope
from taichi_foam.laws.bond import BondFoam, Curve
from taichi_foam.scene.foam_file import FoamFile
from taichi_foam.scene.library import foam_or_curve

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

POINTS = 2001
"""Number of strains from 0 to locking at which a law without a measured curve is evaluated."""

FINE = 0.0025
"""Points are added to a measured curve, on its lines, at least at this distance in strain: between
them its energy is no straight line."""

STEEP = 20.0
"""Such a law is evaluated up to this many times its plateau stress: it has no test that ends."""

ENERGIES = 400
"""Number of energies at which the envelope is evaluated."""

LEAST, LARGEST = 0.02, 2.0
"""Its first and last energy, as fractions of the smallest and the largest one at a shoulder."""

MOST = 40
"""Most foams that are compared at a time: more curves are not told apart."""


@dataclass(frozen=True)
class Absorber:
    """A foam in compression, from rest to the end of what is known of it.

    name, title     as it was asked for, and what foam it is
    strain, stress  (n,) points of the curve, fractions and Pa, positive in compression
    plateau_stress  Pa, as its law or its test defines it
    source          where its curve is from
    density         kg/m3; None: not known
    known_to        strain up to which the curve is from its source, and assumed beyond; None: all
    onset_is_assumed  whether the law's densification strain is assumed
    """

    name: str
    title: str
    strain: Array
    stress: Array
    plateau_stress: float
    source: str = ""
    density: float | None = None
    known_to: float | None = None
    onset_is_assumed: bool = False

    @cached_property
    def energy(self) -> Array:
        """(n,) energy absorbed up to each point [J/m3]."""
        return formulas.absorbed_energy(self.strain, self.stress)

    @cached_property
    def efficiency(self) -> Array:
        """(n,) absorbed energy over stress."""
        return formulas.efficiency(self.strain, self.stress)

    @cached_property
    def ideality(self) -> Array:
        """(n,) absorbed energy over that of the stress from the start."""
        return formulas.ideality(self.strain, self.stress)

    @cached_property
    def shoulder(self) -> int:
        """Index of the point of the largest efficiency, where densification begins."""
        return int(np.argmax(self.efficiency))

    @property
    def densifies(self) -> bool:
        """Whether the efficiency has passed its largest value before the curve ends."""
        return self.shoulder < self.strain.size - 1

    @property
    def caveat(self) -> str | None:
        """What to know of its landmarks before they are used; None: nothing."""
        if not self.densifies:
            end = f"{100 * self.strain[-1]:.3g} % of strain, where the efficiency still rises"
            return f"the curve ends at {end}: the landmarks are those of its end"
        if self.known_to is not None and self.strain[self.shoulder] > self.known_to:
            beyond = f"{100 * self.known_to:.3g} % of strain"
            return f"the curve is assumed beyond {beyond}, and with it the landmarks"
        if self.onset_is_assumed:
            return "where it densifies is assumed, and with it the landmarks"
        return None

    @property
    def row(self) -> dict[str, Any]:
        """The landmarks, in SI units."""
        at = self.shoulder
        return {
            "foam": self.name,
            "title": self.title,
            "density_kg_m3": self.density,
            "plateau_stress_Pa": self.plateau_stress,
            "onset_strain": float(self.strain[at]),
            "densifies": self.densifies,
            "stress_Pa": float(self.stress[at]),
            "energy_J_m3": float(self.energy[at]),
            "efficiency": float(self.efficiency[at]),
            "ideality": float(self.ideality[at]),
            "janssen_factor": 1.0 / float(self.efficiency[at]),
        }


@dataclass(frozen=True)
class Efficiency:
    """The energy absorption of foams, side by side."""

    foams: tuple[Absorber, ...]

    @property
    def table(self) -> list[dict[str, Any]]:
        """The landmarks of each foam: a dictionary each, in SI units, units in the names.

        `onset_strain` is where densification begins, d(efficiency)/d(strain) = 0, and the entries
        after it hold there; `densifies` is False if the curve ends before. `janssen_factor` C is
        stress over energy: the thickness that is needed is T = C h / G if the way of crushing is
        short beside the fall h.
        """
        return [foam.row for foam in self.foams]

    @property
    def caveats(self) -> list[str]:
        """What to know of the landmarks before they are used, a sentence each, with the foams."""
        found: dict[str, list[str]] = {}
        for foam in self.foams:
            if foam.caveat:
                found.setdefault(foam.caveat, []).append(foam.name)
        return [f"{', '.join(names)}: {caveat}" for caveat, names in found.items()]

    @cached_property
    def envelope(self) -> Envelope:
        """The least stress of all foams at each energy (n,), and which foam that is.

        Of a family that is the envelope of its shoulders (Maiti, Gibson & Ashby 1984).
        """
        shoulders = [float(foam.energy[foam.shoulder]) for foam in self.foams]
        last = max(float(foam.energy[-1]) for foam in self.foams)
        most = min(LARGEST * max(shoulders), last)
        energies = np.geomspace(LEAST * min(shoulders), most, ENERGIES)
        return shoulder_envelope([(foam.strain, foam.stress) for foam in self.foams], energies)

    @property
    def choice(self) -> list[dict[str, Any]]:
        """Which foam takes an energy at the least stress: ranges of energy, in SI units.

        Each begins where the range before ends. It is empty for one foam.
        """
        found, foams = self.envelope, self.envelope.foam
        starts = np.flatnonzero(np.diff(foams, prepend=-1))
        ends = [*(starts[1:] - 1), foams.size - 1]
        return [
            {
                "foam": self.foams[foams[start]].name,
                "energy_J_m3": (float(found.energy[start]), float(found.energy[end])),
                "stress_Pa": (float(found.stress[start]), float(found.stress[end])),
            }
            for start, end in zip(starts, ends, strict=True)
            if len(self.foams) > 1
        ]

    @property
    def curves(self) -> dict[str, list[Any]]:
        """The curves of all foams as columns, in SI units, foam by foam."""
        return {
            "foam": [foam.name for foam in self.foams for _ in foam.strain],
            **{
                name: np.concatenate([getattr(foam, key) for foam in self.foams]).tolist()
                for name, key in (
                    ("strain", "strain"),
                    ("stress_Pa", "stress"),
                    ("energy_J_m3", "energy"),
                    ("efficiency", "efficiency"),
                    ("ideality", "ideality"),
                )
            },
        }

    def plot(self, units: str = "si") -> Figure:
        """Six panels: stress, energy, efficiency and ideality over strain; both over stress.

        Raises UserError: `units` is not "si" or "us".
        """
        from taichi_foam.cushions.efficiency_chart import chart

        return chart(self, units_named(units))

    def report(self, path: str | Path, units: str = "si") -> Path:
        """Write a report as one HTML file, and return its path. Raises UserError."""
        from taichi_foam.cushions.efficiency_chart import report

        return report(self, Path(path), units_named(units))


def efficiency(*foams: str | Path | FoamFile | BondFoam | Curve) -> Efficiency:
    """The energy absorption of one or more foams: efficiency, ideality, onset of densification.

    Args:
        foams: names in the library ("eps-20"), foam files (.toml) or compression tests (.csv); or
            a foam file, a bond law with its constants, or a curve. A list of these is taken, too.

    Raises:
        UserError: none or too many, a foam that is given twice, no such foam or file, a test that
            cannot be read, or a law that states no stress.
    """
    asked = [
        each
        for foam in foams
        for each in (foam if isinstance(foam, Sequence) and not isinstance(foam, str) else [foam])
    ]
    if not 1 <= len(asked) <= MOST:
        raise UserError(
            f"{len(asked)} foams: must be 1 to {MOST}; name foams of the library "
            "(`taichi-foam foam list`), foam files or compression tests in CSV files"
        )
    found = [absorber(foam, f"foam {n}") for n, foam in enumerate(asked, 1)]
    names = [each.name for each in found]
    for name in names:
        if names.count(name) > 1:
            raise UserError(f"foam {name!r}: given {names.count(name)} times; give each foam once")
    return Efficiency(tuple(found))


def absorber(foam: str | Path | FoamFile | BondFoam | Curve, called: str) -> Absorber:
    """A foam of the library, of a file or of a test; `called` names one that has no name.

    Raises UserError as `efficiency`.
    """
    if isinstance(foam, str | Path):
        short, found = Path(foam).name, foam_or_curve(foam, "foam ")
        if isinstance(found, Curve):
            return _of_curve(found, short, f"compression test in {short}")
        return _of_file(found, short)
    if isinstance(foam, FoamFile):
        return _of_file(foam, foam.title)
    if isinstance(foam, Curve):
        return _of_curve(foam, called, "a curve")
    return _of_law(foam, called, f"a foam of law {foam.law}")


def _of_file(file: FoamFile, name: str) -> Absorber:
    assumed = {each.key: each.why for each in file.assumed}
    words = f" Assumed of its curve: {assumed['foam.curve']}." if "foam.curve" in assumed else ""
    return replace(
        _of_law(file.foam, name, file.title),
        source=f"{file.source}.{words}",
        density=file.density,
        known_to=file.known_to,
        onset_is_assumed=file.foam.implied_by != "curve" and "foam.densification_strain" in assumed,
    )


def _of_law(foam: BondFoam, name: str, title: str) -> Absorber:
    curve = getattr(foam, "curve", None)
    if isinstance(curve, Curve):
        return _of_curve(curve, name, title)
    marks = foam.landmarks
    ends = [-marks.crush_start, -marks.crush_end]
    strain = np.union1d(np.linspace(0.0, -marks.limit, POINTS), ends)
    stress = stress_over(foam, strain, f"foam {name}")
    known = stress <= STEEP * marks.plateau_stress
    return Absorber(name, title, strain[known], stress[known], marks.plateau_stress)


def _of_curve(curve: Curve, name: str, title: str) -> Absorber:
    strain = np.union1d(curve.points[0], np.arange(0.0, curve.tested, FINE))
    return Absorber(name, title, strain, curve.stress_at(strain), curve.plateau_stress)
