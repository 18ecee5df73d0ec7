"""An honest split: choices are fitted to six tests, and judged by the three that were held out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from statistics import fmean

from fidelity_study.members import JUDGED, Ensemble, Entry, Kept, entry
from taichi_foam.analysis.measures import Quantity
from taichi_foam.shim2000.impacts import NAMES
from taichi_foam.shim2000.scores import HELD_OUT

GRID: Mapping[str, Sequence[object]] = {
    "impactor.friction": (0.22, 0.25),
    "model.shear_pressure_coefficient": (1.5, 2),
}
"""What is varied: every combination of these is a candidate; all else is as calibrated."""

VELOCITIES = 16
FITTED = tuple(name for name in NAMES if name not in HELD_OUT)

NO_ANSWER = 1.0
"""The error that a figure without an answer counts as."""


@dataclass(frozen=True)
class Candidate:
    """One combination of the grid: a value for each of its keys."""

    values: tuple[object, ...]

    @property
    def label(self) -> str:
        """As in `model.damping = stiffness, foam.rate = 2500`."""
        return ", ".join(f"{key} = {value}" for key, value in zip(GRID, self.values, strict=True))

    def ensembles(self, tests: Sequence[str], velocities: int) -> list[Ensemble]:
        """Its runs of some tests."""
        overrides = tuple(f"{key}={value}" for key, value in zip(GRID, self.values, strict=True))
        return [Ensemble(test, overrides, velocities) for test in tests]

    def entries(self, tests: Sequence[str], velocities: int, kept: Kept) -> list[Entry]:
        """Its medians in these tests; [] unless there are those of all."""
        found = [entry(each, kept) for each in self.ensembles(tests, velocities)]
        known = [each for each in found if each is not None]
        return known if len(known) == len(found) else []


@dataclass(frozen=True)
class Scored:
    """A candidate, its medians in the fitted tests and their score."""

    candidate: Candidate
    fitted: Sequence[Entry]

    @property
    def score(self) -> float:
        """Mean absolute error of all judged figures, the flat faces' initial peaks among them."""
        return mean_error(self.fitted, JUDGED)


def candidates() -> list[Candidate]:
    """All combinations, in the grid's order."""
    return [Candidate(values) for values in product(*GRID.values())]


def ranking(velocities: int, kept: Kept) -> list[Scored]:
    """The candidates that have run all fitted tests, the best first."""
    found = [Scored(each, each.entries(FITTED, velocities, kept)) for each in candidates()]
    return sorted((each for each in found if each.fitted), key=lambda each: each.score)


def winner(velocities: int, kept: Kept) -> Candidate | None:
    """The best candidate, once all have run: held-out tests must not be looked at before."""
    ranked = ranking(velocities, kept)
    return ranked[0].candidate if len(ranked) == len(candidates()) else None


def mean_error(entries: Sequence[Entry], quantities: Sequence[Quantity]) -> float:
    """Mean absolute error of those of the figures that were measured."""
    errors = [
        each["error"][quantity.key]
        for each in entries
        for quantity in quantities
        if each["measured"].get(quantity.key) is not None
    ]
    return fmean(NO_ANSWER if error is None else abs(error) for error in errors)
