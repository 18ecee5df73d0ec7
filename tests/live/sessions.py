"""Drops that sessions compute, and what keeps their results."""

from __future__ import annotations

from collections.abc import Callable

from taichi_foam import load_scene
from taichi_foam.live.session import Outcome
from taichi_foam.results.result import Result
from taichi_foam.scene import Scene


def drop_of(end: float, *overrides: str) -> Scene:
    """A cylinder's impact on 50 mass points, `end` [s] long: some 65,000 steps in a second.

    Its kernels, and those of the shape that comes next, come with the package.
    """
    coarse = ("block.columns=10", "block.rows=5", f"numerics.end={end}")
    return load_scene("paper/cylinder-2.32", overrides=[*coarse, *overrides])


ENDLESS = drop_of(10.0)
PACE = 0.1  # leaves others time to compute


class Keeper:
    """Keeps results, after `first` has had a look."""

    def __init__(self) -> None:
        self.kept: list[Result] = []
        self.first: Callable[[], object] = lambda: None

    def __call__(self, outcome: Outcome) -> None:
        self.first()
        self.kept.append(outcome.result)
