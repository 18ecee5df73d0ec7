"""Drops that are not computed: a solver whose figures are known, and plans for it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from taichi_foam.records.ending import Ending
from taichi_foam.records.history import HISTORY_COLUMNS, History
from taichi_foam.results.result import Result
from taichi_foam.scene import Scene


def axis(key: str = "impactor.velocity", low: float = 2.0, high: float = 4.0, count: int = 5):
    return {"key": key, "from": low, "to": high, "count": count}


def plan_of(*axes: dict[str, Any], **more: Any) -> dict[str, Any]:
    """A plan over the wedge in chunks of two drops."""
    return {"scene": "paper/wedge-2.86", "chunk": 2, "axes": list(axes or [axis()]), **more}


def ending(at: int, error: BaseException | None = None) -> Callable[[int], None]:
    """For `Solver.before`: raises an error, else Ctrl-C, before the drop of a number, from 0."""

    def before(asked: int) -> None:
        if asked == at:
            raise error or KeyboardInterrupt

    return before


class Known(Result):
    """A result with figures of every kind that a column can hold."""

    @property
    def summary(self) -> dict[str, Any]:
        impactor = self.scene.impactor
        if impactor.velocity == 3.0:
            raise ValueError("no figures")
        return {
            "scene": self.scene.name,
            "max_displacement_m": None if impactor.velocity > 3.9 else 0.01 * impactor.velocity,
            "pieces": 3,
            "warnings": ["slow", "odd"] if impactor.velocity > 2.4 else [],
            "bottomed": impactor.velocity > 3.4,
            "peak_deceleration_cfc180_g": 10 * impactor.velocity,
            "peak_deceleration_g": 12 * impactor.velocity,
            "peak_resultant_g": None,
            "mixed": 1 if impactor.velocity < 2.4 else 2.5,
            "wall_s": 0.1,
            "interrupted": False,
        }


@dataclass
class Solver:
    """Gives known results at once; remembers what it was asked for.

    Each says that it has taken so many `seconds`.
    """

    asked: list[float] = field(default_factory=list)
    before: Callable[[int], None] | None = None
    seconds: float = 0.0

    def __call__(self, scenes: Sequence[Scene]) -> Iterator[tuple[int, Result]]:
        history = History({name: np.arange(3.0) for name in HISTORY_COLUMNS})
        for place, scene in reversed(list(enumerate(scenes))):
            if self.before is not None:
                self.before(len(self.asked))
            self.asked.append(scene.impactor.velocity)
            failed = scene.impactor.velocity == 3.5
            ending = Ending.DIVERGED if failed else Ending.REBOUND
            told = {"ended_by": ending.value, "wall_s": self.seconds, "batch": 1}
            yield place, Known(scene, history, [], told)
