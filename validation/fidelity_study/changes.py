"""One change at a time from the calibrated set: which changes, and what each gives."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from fidelity_study.members import Ensemble, Entry, Kept, entry, shares
from taichi_foam.analysis.measures import ENERGY_PER_VOLUME
from taichi_foam.catalogue import load_scene
from taichi_foam.shim2000.compare import hits
from taichi_foam.shim2000.impacts import NAMES
from taichi_foam.shim2000.scores import SHARE, score

VELOCITIES = 3

# Of an option in words all readings, of a number those worth a look; the calibrated one is skipped.
VALUES: Mapping[str, Sequence[str]] = {
    "impactor.friction": ("0", "0.1", "0.15", "0.25", "0.3"),
    "base.kind": ("gripped", "held", "floor"),
    "base.stops_impactor": ("true", "false"),
    "model.shear": ("cell", "face"),
    "model.shear_failure": ("pressure-dependent", "always", "tension-only", "angle"),
    "model.shear_pressure_coefficient": ("0", "1", "2", "4", "8", "18"),
    "model.broken_contact": ("reload", "jump"),
    "model.self_contact": ("true", "false"),
    "model.crushed_room": ("true", "false"),
    "model.shear_yield": ("true", "false"),
    "model.piece_size": ("0.8", "1"),
    "model.piece_friction": ("0.3",),
    "model.damping": ("stiffness", "absolute"),
    "foam.softening": ("true", "false"),
    "foam.crush_band": ("0.005", "0.01"),
    "foam.crushed_tensile_stress": ("10e3",),
    "foam.crushed_tensile_fraction": ("1",),
    "foam.yield_strain": ("-0.0432",),
    "foam.rate": ("none", "5", "10"),
    "foam.overshoot_strain": ("0.0105",),
    "foam.strength_scatter": ("0.05", "0.1", "0.2"),
}

RATES = (("3000", "1"), ("6000", "1"), ("20000", "2"), ("290000", "4"))
"""Cowper and Symonds' constants D [1/s] and q that are set together, without overshoot."""

CYLINDERS = tuple(name for name in NAMES if name.startswith("paper/cylinder-"))


@dataclass(frozen=True)
class Change:
    """Settings that are not the calibrated ones, in all tests or in some."""

    label: str
    overrides: tuple[str, ...]
    tests: tuple[str, ...] = NAMES

    @classmethod
    def of(cls, override: str, tests: tuple[str, ...] = NAMES) -> Change:
        """A single setting, which is its own label."""
        return cls(override.replace("=", " = "), (override,), tests)

    @property
    def is_one(self) -> bool:
        """Whether it differs from the calibrated set at all."""
        test = self.tests[0]
        return load_scene(test, "calibrated", self.overrides) != load_scene(test, "calibrated")

    def ensembles(self, tests: Sequence[str], velocities: int) -> list[Ensemble]:
        """Its runs of those of the tests that it concerns."""
        return [Ensemble(test, self.overrides, velocities) for test in tests if test in self.tests]


CALIBRATED = Change("calibrated", ())


@dataclass(frozen=True)
class Outcome:
    """What a change has given.

    entries  medians and errors, by test
    shares   of the runs that meet each criterion, by its key
    """

    change: Change
    entries: Mapping[str, Entry]
    shares: Mapping[str, float]

    @property
    def score(self) -> dict[str, Any]:
        """Hits among duration, displacement and plateau, and their median absolute error."""
        return score(list(self.entries.values()))

    @property
    def energy(self) -> dict[str, int]:
        """Hits among the energies."""
        return hits(list(self.entries.values()))[ENERGY_PER_VOLUME.key]

    @property
    def unmet(self) -> list[str]:
        """Criteria that too few runs meet."""
        return [key for key, share in self.shares.items() if share < SHARE]


def changes() -> list[Change]:
    """The calibrated set, and every change from it."""
    single = [Change.of(f"{key}={value}") for key, values in VALUES.items() for value in values]
    rates = [_rate(*constants) for constants in RATES]
    wide = Change.of("impactor.radius=0.05", tests=CYLINDERS)
    asked = [*single, _damping_time("half", 0.5), _damping_time("twice", 2.0), *rates, wide]
    return [CALIBRATED, *(change for change in asked if change.is_one)]


def outcomes(velocities: int, kept: Kept) -> list[Outcome]:
    """What there is, by change; those that have nothing are left out."""
    found = [_outcome(change, velocities, kept) for change in changes()]
    return [outcome for outcome in found if outcome.entries]


def _rate(constant: str, exponent: str) -> Change:
    overrides = (
        f"foam.rate={constant}", f"foam.rate_exponent={exponent}", "foam.overshoot_strain=none"
    )  # fmt: skip
    return Change(f"foam.rate = {constant}, exponent {exponent}", overrides)


def _damping_time(words: str, factor: float) -> Change:
    time = factor * load_scene(NAMES[0], "calibrated").numerics.damping_time
    return Change(f"numerics.damping_time: {words}", (f"numerics.damping_time={time!r}",))


def _outcome(change: Change, velocities: int, kept: Kept) -> Outcome:
    entries: dict[str, Entry] = {}
    met: dict[str, float] = {}
    for ensemble in change.ensembles(NAMES, velocities):
        found = entry(ensemble, kept)
        if found is not None:
            entries[ensemble.test] = found
            met.update(shares(ensemble, kept))
    return Outcome(change, entries, met)
