"""What the page's tables and curve show beside the run itself: names, units, measured figures."""

from __future__ import annotations

import dataclasses
from functools import lru_cache
from typing import TYPE_CHECKING, Any

from taichi_foam.analysis.quantities import (
    BROKEN,
    DISPLACEMENT,
    DURATION,
    ENERGY_ABSORBED,
    ENERGY_PER_VOLUME,
    HEIGHT,
    PEAK,
    PIECES,
    PLATEAU,
    REBOUND,
    RESIDUAL,
    WIDTH,
)
from taichi_foam.records import history
from taichi_foam.scene import CHOICE_SETS
from taichi_foam.shim2000.tests import MEASURED, NAMES, paper_scene

if TYPE_CHECKING:
    from taichi_foam.scene import Scene

QUANTITIES = (
    DISPLACEMENT, DURATION, PLATEAU, ENERGY_PER_VOLUME, ENERGY_ABSORBED, PEAK, REBOUND, WIDTH,
    HEIGHT, PIECES, BROKEN, RESIDUAL,
)  # fmt: skip
"""The figures of the page's table, in its order."""

FIGURES = tuple((q.key, q.name, q.unit, q.factor, q.digits) for q in QUANTITIES)
"""The same as the page gets them."""

ENERGIES = tuple((column.name, column.label) for column in history.ENERGIES)
"""The ledger as the page gets it: columns of the history and their words."""


def measured(scene: Scene) -> dict[str, Any] | None:
    """What the paper measured in the test that a scene is, by keys of a summary, and its name.

    None if it is none of them. A test is its impactor and its block, whatever the foam's law.
    """
    found = _tests().get(_conditions(scene))
    if found is None:
        return None
    figures = dataclasses.asdict(MEASURED[found])
    return {"test": found, **{key: value for key, value in figures.items() if value is not None}}


def _conditions(scene: Scene) -> tuple[Any, ...] | None:
    impactor, block = scene.impactor, scene.block
    if impactor is None:
        return None
    shape = impactor.model_dump(exclude={"friction", "gap"})
    return (*shape.items(), block.width, block.height, block.thickness)


@lru_cache(maxsize=1)
def _tests() -> dict[tuple[Any, ...] | None, str]:
    """The paper's tests by their conditions; a choice set may read a size differently."""
    return {_conditions(paper_scene(name, c)): name for name in NAMES for c in CHOICE_SETS}
