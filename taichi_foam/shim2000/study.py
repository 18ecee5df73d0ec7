"""The tests as a study computes them: one run of each, or an ensemble with one run to show.

Broken foam is chaotic: a figure of a single run is partly chance. The model's prediction is the
median over runs whose impact velocities differ by less than the accuracy of their measurement, and
whose foam, if its strength scatters, is a different sample each time. They are spread like the
repeats of a sweep.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from taichi_foam.analysis.bands import nearest
from taichi_foam.analysis.impact import impact
from taichi_foam.errors import Interrupted, RunError, UserError
from taichi_foam.records.ending import Ending
from taichi_foam.results.files import write_csv
from taichi_foam.results.folders import Claim
from taichi_foam.results.result import Result
from taichi_foam.scene import Scene
from taichi_foam.shim2000.compare import JUDGED, at_rest
from taichi_foam.shim2000.criteria import Criterion, criteria
from taichi_foam.shim2000.impacts import PaperTest, test_of
from taichi_foam.simulation import simulate
from taichi_foam.simulation.progress import Bars
from taichi_foam.sweeps.sampling import factors, seed_of

Array = NDArray[np.float64]

WITHIN = 0.005
"""Largest relative difference of an ensemble's velocities from the test's own."""

FEWEST, MOST = 2, 100
"""Range of an ensemble's size. Complete runs, about 5 MB each, are kept in memory until all runs of
a test have ended."""


@dataclass(frozen=True)
class Member:
    """The data kept of one run of an ensemble.

    scene         the scene that was run
    figures       its measures, as in its summary.json
    criteria      the criteria of the crushed foam for this run
    time          (n,) since first contact [s]
    deceleration  (n,) smoothed [m/s2]
    """

    scene: Scene
    figures: dict[str, Any]
    criteria: Sequence[Criterion]
    time: Array
    deceleration: Array

    @property
    def velocity(self) -> float:
        """Impact velocity [m/s]."""
        return _velocity(self.scene)


@dataclass(frozen=True)
class Case:
    """A test and its results.

    scene    the test itself
    result   its run; for an ensemble, the run nearest to the medians
    members  the members of an ensemble, in order of velocity
    """

    scene: Scene
    result: Result
    members: Sequence[Member] = ()

    @property
    def name(self) -> str:
        """Name of the test, as in `impacts.NAMES`."""
        return self.scene.name

    @cached_property
    def test(self) -> PaperTest | None:
        """The paper's test; None if settings have made the scene another impact."""
        return test_of(self.scene)

    @property
    def velocity(self) -> float:
        """Impact velocity of the test itself [m/s]; members of an ensemble have similar ones."""
        return _velocity(self.scene)

    @property
    def figures(self) -> dict[str, Any]:
        """The measures of `result`, as in its summary.json."""
        return self.result.summary


@dataclass(frozen=True)
class Computed:
    """The results of computing a study.

    cases        cases with at least one finished run
    cut          names of tests that Ctrl-C left without a finished run
    failed       failed runs, kept for inspection
    failure      description of the failures
    interrupted  whether Ctrl-C was pressed
    """

    cases: list[Case]
    cut: list[str]
    failed: list[Result]
    failure: str | None
    interrupted: bool


def from_contact(result: Result) -> dict[str, Array]:
    """The history, with time and displacement from first contact."""
    found = impact(result)
    if found is None:
        return dict(result.history)
    h = result.history
    kept = h["time_s"] >= found.contact
    shifted = {name: column[kept] for name, column in h.items()}
    shifted["time_s"] = shifted["time_s"] - found.contact
    shifted["displacement_m"] = shifted["displacement_m"] - found.depth_0
    return shifted


def check(count: int) -> None:
    """Check the number of an ensemble's members.

    Raises:
        UserError: fewer than `FEWEST` or more than `MOST`.
    """
    if not FEWEST <= count <= MOST:
        fix = (
            "16 are a good number; leave the option out for single runs"
            if count < FEWEST
            else "16 are a good number, and 100 resolve the quantiles well"
        )
        raise UserError(
            f"ensemble = {count}: must be at least {FEWEST} and at most {MOST} runs of each "
            f"test; {fix}"
        )


def faster(scene: Scene, factor: float) -> Scene:
    """The scene with its impact velocity multiplied by a factor."""
    return scene.with_values(impactor__velocity=factor * _velocity(scene))


def members_of(scene: Scene, count: int) -> list[Scene]:
    """The scenes of an ensemble, in order of velocity.

    If the foam's strength scatters, each has its own seed: the scene's, and the numbers after it.
    """
    members = [faster(scene, factor) for factor in factors(count, WITHIN)]
    if scene.foam.strength_scatter == 0.0:
        return members
    first = scene.foam.strength_seed
    return [
        member.with_values(foam__strength_seed=seed_of(first, place))
        for place, member in enumerate(members)
    ]


@dataclass
class _Ensemble:
    """The results of one test's ensemble so far, by index.

    The run nearest to the medians is known only when all have ended: until then all are kept.
    """

    scene: Scene
    of: int
    members: dict[int, Member] = field(default_factory=dict)
    held: dict[int, Result] = field(default_factory=dict)
    failures: list[str] = field(default_factory=list)

    def take(self, place: int, result: Result) -> None:
        if result.failure:
            self.failures.append(_failure(result))
        else:
            member = _member(result)
            self.held[place] = result
            self.members[place] = member
        if len(self.members) + len(self.failures) == self.of and self.members:
            shown = self._nearest()
            self.held = {shown: self.held[shown]}

    def case(self) -> Case:
        places = sorted(self.members)
        members = [self.members[place] for place in places]
        return Case(self.scene, self.held[self._nearest()], members)

    def _nearest(self) -> int:
        places = sorted(self.members)
        figures = [at_rest(self.members[place].figures) for place in places]
        return places[nearest(figures, [quantity.key for quantity in JUDGED])]


def compute(
    scenes: Sequence[Scene], count: int | None, bars: Bars, claim: Claim | None = None
) -> Computed:
    """Run every test once, or `count` times, all side by side. Ctrl-C keeps finished runs.

    With a claim, runs write checkpoints into its folder, and continue from existing ones.

    Failures are described in `failure`; a failed run is left out of its ensemble.

    Raises:
        KeyboardInterrupt: Ctrl-C before any run had finished.
    """
    if count is None:
        return _single(scenes, bars, claim)
    tests = [_Ensemble(scene, count) for scene in scenes]
    asked = [member for scene in scenes for member in members_of(scene, count)]
    interrupted = False
    with bars.computing(f"{len(asked)} impacts") as on_progress:
        try:
            for place, result in simulate.simulate_many(asked, on_progress, checkpoint=claim):
                tests[place // count].take(place % count, result)
        except KeyboardInterrupt:
            interrupted = True
    failures = [text for test in tests for text in test.failures]
    cases = [test.case() for test in tests if test.members]
    if interrupted and not cases:
        raise KeyboardInterrupt("no run had finished; the same command continues from there")
    cut = [test.scene.name for test in tests if interrupted and not test.members]
    return Computed(cases, cut, [], "\n".join(failures) or None, interrupted)


def _single(scenes: Sequence[Scene], bars: Bars, claim: Claim | None) -> Computed:
    """Run each test once, all as one batch, and sort the results."""
    failure = None
    what = "1 impact" if len(scenes) == 1 else f"{len(scenes)} impacts"
    with bars.computing(what) as on_progress:
        try:
            results = simulate.run_many(scenes, on_progress, checkpoint=claim)
        except RunError as error:
            results, failure = error.results, str(error)
        except Interrupted as error:
            results = list(error.results.values())
    ended = [r for r in results if r.ending is not Ending.INTERRUPTED]
    if not ended:
        raise KeyboardInterrupt("no case had finished; the same command continues from there")
    names = {r.scene.name for r in ended}
    cut = [scene.name for scene in scenes if scene.name not in names]
    failed = [r for r in ended if r.failure]
    cases = [Case(r.scene, r) for r in ended if not r.failure]
    return Computed(cases, cut, failed, failure, interrupted=bool(cut))


def write_members(path: Path, cases: Sequence[Case]) -> None:
    """Write members.csv: the varied values and all figures of every run, in SI units."""
    members = [member for case in cases for member in case.members]
    columns: dict[str, list[Any]] = {
        "case": [case.name for case in cases for _ in case.members],
        "velocity_m_s": [member.velocity for member in members],
        "strength_seed": [member.scene.foam.strength_seed for member in members],
    }
    for key in members[0].figures if members else ():
        if key != "scene":
            columns[key] = [_cell(member.figures[key]) for member in members]
    write_csv(path, columns)


def _member(result: Result) -> Member:
    history = from_contact(result)
    time, smoothed = history["time_s"], history["deceleration_smoothed_m_s2"]
    return Member(result.scene, result.summary, criteria(result), time, smoothed)


def _failure(result: Result) -> str:
    scene, velocity = result.scene, _velocity(result.scene)
    changed = [f"impactor.velocity={velocity!r}"]
    if scene.foam.strength_scatter > 0.0:
        changed.append(f"foam.strength_seed={scene.foam.strength_seed}")
    return (
        f"{scene.name} at {velocity:.4f} m/s: {result.ending} and left out; "
        f"to look at it, run {scene.name} with {', '.join(changed)}"
    )


def _velocity(scene: Scene) -> float:
    """Impact velocity of a test's scene [m/s]."""
    assert scene.impactor is not None  # every test has one
    return scene.impactor.velocity


def _cell(value: float | bool | str | list[str] | None) -> str:
    if value is None or (isinstance(value, float) and not math.isfinite(value)):
        return ""
    if isinstance(value, (str, list)):
        return value if isinstance(value, str) else " | ".join(value)
    return f"{value:.6g}" if isinstance(value, float) else str(int(value))
