"""Every test run many times, with variations that no measurement could tell apart.

Broken foam is chaotic: a figure of a single run is partly chance. What the model says is the median
over runs whose impact velocities differ by less than they were measured, and whose foam, where its
strength scatters, is another piece each time.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from taichi_foam.analysis.measures import summary
from taichi_foam.errors import UserError
from taichi_foam.results.folders import Claim
from taichi_foam.results.result import Result
from taichi_foam.scene import Scene
from taichi_foam.shim2000.bands import nearest
from taichi_foam.shim2000.compare import JUDGED, at_rest
from taichi_foam.shim2000.criteria import criteria
from taichi_foam.shim2000.study import Case, Computed, Member, from_contact, has_failed
from taichi_foam.simulation import simulate
from taichi_foam.simulation.progress import Bars

WITHIN = 0.005
"""Velocities of an ensemble differ from the test's own by at most this part."""

FEWEST, MOST = 2, 100
"""Members of an ensemble. Full runs are held until all of a test have ended, about 5 MB each."""

# Seeds are 32 bits wide.
_SEEDS = 2**32


def check(count: int) -> None:
    """Refuse a number of members that makes no ensemble.

    Raises:
        UserError: fewer than `FEWEST` or more than `MOST`.
    """
    if not FEWEST <= count <= MOST:
        fix = (
            "16 are a good number; leave the option out for single runs"
            if count < FEWEST
            else "16 are a good number, and 100 tell the quantiles well"
        )
        raise UserError(
            f"ensemble = {count}: must be at least {FEWEST} and at most {MOST} runs of each "
            f"test; {fix}"
        )


def factors(count: int) -> list[float]:
    """Velocities of an ensemble over the test's own: evenly spread, from end to end.

    A single one is the test's own.
    """
    if count == 1:
        return [1.0]
    return [float(f) for f in 1.0 + WITHIN * np.linspace(-1.0, 1.0, count)]


def faster(scene: Scene, factor: float) -> Scene:
    """The scene with another impact velocity, by a factor."""
    assert scene.impactor is not None  # every test has one
    return scene.with_values(impactor__velocity=factor * scene.impactor.velocity)


def members_of(scene: Scene, count: int) -> list[Scene]:
    """The scenes of an ensemble, by rising velocity.

    Where the foam's strength scatters, each has a seed of its own: the scene's, and those after.
    """
    members = [faster(scene, factor) for factor in factors(count)]
    if scene.foam.strength_scatter == 0.0:
        return members
    seeds = [(scene.foam.strength_seed + place) % _SEEDS for place in range(count)]
    return [
        member.with_values(foam__strength_seed=seed)
        for member, seed in zip(members, seeds, strict=True)
    ]


@dataclass
class _Test:
    """What one test's ensemble has given so far, by place in it.

    Which run lies nearest to the medians is known when all have ended: until then all are held.
    """

    scene: Scene
    of: int
    members: dict[int, Member] = field(default_factory=dict)
    held: dict[int, Result] = field(default_factory=dict)
    failures: list[str] = field(default_factory=list)

    def take(self, place: int, result: Result) -> None:
        if has_failed(result):
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
    scenes: Sequence[Scene], count: int, bars: Bars, claim: Claim | None = None
) -> Computed:
    """Run every test `count` times, all side by side. Ctrl-C keeps what has finished.

    With a claim they leave checkpoints in its folder, and go on from those that are there.

    A run that fails is left out of its ensemble, and told in `failure`.

    Raises:
        KeyboardInterrupt: Ctrl-C before any run had finished.
    """
    tests = [_Test(scene, count) for scene in scenes]
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
        raise KeyboardInterrupt("no run had finished; the same command goes on from there")
    return Computed(
        cases=cases,
        cut=[test.scene.name for test in tests if interrupted and not test.members],
        failed=[],
        failure="\n".join(failures) or None,
        interrupted=interrupted,
    )


def write_members(path: Path, cases: Sequence[Case]) -> None:
    """Write members.csv: what varied and every figure of every run, in SI units."""
    figures = list(cases[0].members[0].figures) if cases else []
    figures = [key for key in figures if key != "scene"]
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["case", "velocity_m_s", "strength_seed", *figures])
        for case in cases:
            for member in case.members:
                assert member.scene.impactor is not None  # every test has one
                varied = [repr(member.scene.impactor.velocity), member.scene.foam.strength_seed]
                values = [member.figures[key] for key in figures]
                writer.writerow([case.name, *varied, *map(_cell, values)])


def _member(result: Result) -> Member:
    history = from_contact(result)
    time, smoothed = history["time_s"], history["deceleration_smoothed_m_s2"]
    return Member(result.scene, summary(result), criteria(result), time, smoothed)


def _failure(result: Result) -> str:
    scene = result.scene
    assert scene.impactor is not None  # every test has one
    changed = [f"impactor.velocity={scene.impactor.velocity!r}"]
    if scene.foam.strength_scatter > 0.0:
        changed.append(f"foam.strength_seed={scene.foam.strength_seed}")
    return (
        f"{scene.name} at {scene.impactor.velocity:.4f} m/s: {result.ending} and left out; "
        f"to look at it, run {scene.name} with {', '.join(changed)}"
    )


def _cell(value: float | bool | str | list[str] | None) -> str:
    if value is None or (isinstance(value, float) and not math.isfinite(value)):
        return ""
    if isinstance(value, (str, list)):
        return value if isinstance(value, str) else " | ".join(value)
    return f"{value:.6g}" if isinstance(value, float) else str(int(value))
