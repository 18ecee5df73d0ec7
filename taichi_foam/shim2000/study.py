"""One of the tests as a study has computed it: a run, or an ensemble and its run to be shown."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from taichi_foam.analysis.impact import impact
from taichi_foam.results.result import Result
from taichi_foam.scene import Scene
from taichi_foam.shim2000.tests import PaperTest, test_of

if TYPE_CHECKING:
    from taichi_foam.shim2000.criteria import Criterion

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Member:
    """What is kept of one run of an ensemble.

    scene         what ran
    figures       its measures, as in its summary.json
    criteria      what the paper says of the crushed foam, and whether it agrees
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
        assert self.scene.impactor is not None  # every test has one
        return self.scene.impactor.velocity


@dataclass(frozen=True)
class Case:
    """A test and what it gave.

    scene    the test itself
    result   its run; of an ensemble the one nearest to the medians
    members  of an ensemble, in order of velocity
    """

    scene: Scene
    result: Result
    members: Sequence[Member] = ()

    @property
    def name(self) -> str:
        """Name of the test, as in `tests.NAMES`."""
        return self.scene.name

    @cached_property
    def test(self) -> PaperTest | None:
        """Which test it is; None if settings have made it another impact."""
        return test_of(self.scene)

    @property
    def velocity(self) -> float:
        """Impact velocity of the test itself [m/s]; those of an ensemble's members are near it."""
        assert self.scene.impactor is not None  # every test has one
        return self.scene.impactor.velocity

    @cached_property
    def figures(self) -> dict[str, Any]:
        """The measures of the run itself, as in its summary.json."""
        return self.result.summary


@dataclass(frozen=True)
class Computed:
    """What computing a study gave.

    cases        with at least one finished run
    cut          names of tests that Ctrl-C left without a finished run
    failed       runs that went wrong and are to be kept for a look at them
    failure      what went wrong, in words
    interrupted  Ctrl-C came
    """

    cases: list[Case]
    cut: list[str]
    failed: list[Result]
    failure: str | None
    interrupted: bool


def has_failed(result: Result) -> bool:
    """Whether a run has ended before its time, and not by Ctrl-C."""
    return result.ending is not None and result.ending.failed


def from_contact(result: Result) -> dict[str, Array]:
    """The history with time and displacement counted from first contact."""
    found = impact(result)
    if found is None:
        return dict(result.history)
    h = result.history
    kept = h["time_s"] >= found.contact
    shifted = {name: column[kept] for name, column in h.items()}
    shifted["time_s"] = shifted["time_s"] - found.contact
    shifted["displacement_m"] = shifted["displacement_m"] - found.depth_0
    return shifted
