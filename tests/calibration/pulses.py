"""Runs that are not computed: pulses whose form is known, for scenes with given parameters."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from taichi_foam.records.ending import Ending
from taichi_foam.records.history import HISTORY_COLUMNS, History
from taichi_foam.results.result import Result
from taichi_foam.scene import Scene

Array = NDArray[np.float64]

SCENE = "paper/rectangular-3.03"
FIT = {
    "foam.yield_strain": (-0.06, -0.03),
    "foam.densification_strain": (-0.85, -0.65),
    "impactor.friction": (0.0, 0.4),
}
"""The height of the pulse, its growth, and a parameter without influence."""

TIME = np.arange(0.0, 0.06, 1e-4)


def pulse(scene: Scene, time: Array = TIME) -> Array:
    """Deceleration [m/s2]: a plateau that rises towards its end, with smooth flanks."""
    level = -2e3 * scene.foam.yield_strain
    growth = 4.0 + 10.0 * (scene.foam.densification_strain + 0.75)
    flanks = 1.0 / (1 + np.exp(-(time - 0.004) / 5e-4)) / (1 + np.exp((time - 0.045) / 1e-3))
    return level * (1.0 + growth * (time / 0.05) ** 4) * flanks


class Pulsed(Result):
    """A result with a trace, and one key figure."""

    @property
    def summary(self) -> dict[str, Any]:
        return {"scene": self.scene.name, "max_displacement_m": -self.scene.foam.yield_strain}

    def measured(self, keys: Iterable[str]) -> dict[str, Any]:
        return {key: self.summary[key] for key in keys}


@dataclass
class Solver:
    """Gives pulses at once, with scatter from run to run; counts how many.

    fails   whether the run of a scene diverges
    before  called before each run with the number of those so far
    """

    scatter: float = 0.01
    fails: Callable[[Scene], bool] = lambda scene: False
    before: Callable[[int], None] = lambda count: None
    asked: list[Scene] = field(default_factory=list)

    def __call__(self, scenes: Sequence[Scene]) -> Iterator[tuple[int, Result]]:
        for place, scene in enumerate(scenes):
            self.before(len(self.asked))
            self.asked.append(scene)
            seed = abs(hash((scene.foam.yield_strain, scene.impactor.friction))) % 2**32
            factor = 1.0 + self.scatter * np.random.default_rng(seed).normal()
            columns = {name: np.zeros_like(TIME) for name in HISTORY_COLUMNS}
            columns |= {"time_s": TIME, "deceleration_m_s2": factor * pulse(scene)}
            ending = Ending.DIVERGED if self.fails(scene) else Ending.REBOUND
            told = {"ended_by": ending.value, "wall_s": 0.01, "batch": 1}
            yield place, Pulsed(scene, History(columns), [], told)


def measured(scene: Scene, noise: float = 0.05, seed: int = 0) -> tuple[Array, Array]:
    """A noisy trace of a scene, with 20 ms before the impact: time [s], deceleration [m/s2]."""
    time = np.arange(-0.02, 0.06, 1e-4)
    clean = np.where(time >= 0.0, pulse(scene, time), 0.0)
    random = np.random.default_rng(seed)
    return time, clean + random.normal(scale=noise * clean.max(), size=len(time))
