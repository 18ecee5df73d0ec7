"""An honest split: choices are fitted to six tests, and judged by the three that were held out.

The candidates, their scores, and the page's section.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from statistics import fmean

from ensembles import percent, short
from pages import table

from fidelity_study.members import JUDGED, TITLES, Ensemble, Entry, Kept, entry
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


def section(velocities: int, kept: Kept) -> list[str]:
    """The ranking, and the best candidate's held-out tests once they are there."""
    ranked = ranking(velocities, kept)
    if not ranked:
        return []
    return [
        "## Fitted to six tests, judged by three\n",
        _method(velocities),
        f"{len(ranked)} of {len(candidates())} candidates:\n",
        _ranking_table(ranked),
        *_held_out(ranked[0], velocities, kept),
    ]


def _method(velocities: int) -> str:
    return (
        "Every candidate has what the calibrated set has for all that is not listed; each test "
        f"is run at {velocities} velocities within 0.5 % and judged by its medians. The score is "
        f"the mean absolute error of duration, displacement, plateau and energy per volume in the "
        f"{len(FITTED)} fitted tests and of the initial peak in the flat ones among them; a figure "
        "without an answer counts as 100 %. The middle velocities are held out: they are computed "
        "for the best candidate alone, after all have their scores.\n"
    )


def _ranking_table(ranked: Sequence[Scored]) -> str:
    keys = [key.partition(".")[2].replace("_", " ") for key in GRID]
    header = ["score, %", *keys, *(f"{title}, %" for title in TITLES)]
    rows = [
        [
            f"{100 * each.score:.1f}",
            *map(str, each.candidate.values),
            *(f"{100 * mean_error(each.fitted, [quantity]):.1f}" for quantity in JUDGED),
        ]
        for each in ranked
    ]
    return table(header, rows)


def _held_out(best: Scored, velocities: int, kept: Kept) -> list[str]:
    held_out = best.candidate.entries(HELD_OUT, velocities, kept)
    if best.candidate != winner(velocities, kept) or not held_out:
        return []
    return [
        "### The held-out tests of the best\n",
        f"`{best.candidate.label}`; errors of medians in per cent.\n",
        _split_table(best.fitted, held_out),
    ]


def _split_table(fitted: Sequence[Entry], held_out: Sequence[Entry]) -> str:
    by_name = {each["name"]: each for each in (*fitted, *held_out)}
    rows = []
    for name in NAMES:
        known, errors = by_name[name]["measured"], by_name[name]["error"]
        cells = [percent(errors[q.key]) if known.get(q.key) else "" for q in JUDGED]
        rows.append([short(name), "held out" if name in HELD_OUT else "fitted", *cells])
    for group, entries in (("fitted", fitted), ("held out", held_out)):
        means = [f"{100 * mean_error(entries, [q]):.1f}" for q in JUDGED]
        rows.append(["mean absolute error", group, *means])
    return table(["test", "", *TITLES], rows)
