"""Foam that crushes but does not break: the orders of convergence in the cells and in the step."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from taichi_foam.scene import Scene
from verification import convergence
from verification.convergence import CASES, Impact
from verification.runs import whole

END = 2e-3  # s
STEPS = (1, 2, 4, 8)  # by how many times the step is cut
EXACT = 64
COARSEST_STEP = END / 590  # 3.39 us, about the automatic one for cells of 5 mm


@dataclass(frozen=True)
class Smooth:
    """A short run of one of the impacts."""

    case: str
    cell: float
    step: float | None = None  # none: automatic


def scene(smooth: Smooth) -> Scene:
    numerics = {"end": END, "dt": "auto" if smooth.step is None else smooth.step}
    impact = Impact(smooth.case, smooth.cell, convergence.STRENGTHS[0])
    given = convergence.scene(impact, **numerics)
    tough = given.foam.model_copy(update={"tensile_strain": 2.0, "shear_strain": 2.0})
    return given.model_copy(update={"foam": tough})


def compute(smooth: Smooth) -> dict[str, float]:
    """What the foam has taken from the impactor at `END`; a run's last step goes past it."""
    history = whole(scene(smooth)).history
    at_end = {
        name: float(np.interp(END, history["time_s"], history[name]))
        for name in ("velocity_m_s", "crushing_J", "broken_bonds")
    }
    start = float(history["velocity_m_s"][0])
    return {
        "lost": start - at_end["velocity_m_s"],
        "crushing": at_end["crushing_J"],
        "broken": at_end["broken_bonds"],
    }


def plan() -> dict[str, Smooth]:
    """All runs by name."""
    runs = {
        cell_name(case, cell): Smooth(case, cell) for case in CASES for cell in convergence.CELLS
    }
    for parts in (*STEPS, EXACT):
        runs[step_name(parts)] = Smooth(CASES[0], convergence.REFERENCE, COARSEST_STEP / parts)
    return runs


def cell_name(case: str, cell: float) -> str:
    return f"{case}, cells of {1e3 * cell:g} mm"


def step_name(parts: int) -> str:
    return f"step / {parts}"


def order(coarse: float, middle: float, fine: float) -> float | None:
    """Order of convergence from three values, each with half the size of the one before.

    None where they do not approach one another from one side.
    """
    ratio = (coarse - middle) / (middle - fine) if middle != fine else 0.0
    return math.log2(ratio) if ratio > 1.0 else None
