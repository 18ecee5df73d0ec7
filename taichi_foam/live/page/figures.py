"""What the page's tables and curve show beside the run itself: names, units, measured figures."""

from __future__ import annotations

import dataclasses
from functools import lru_cache
from typing import TYPE_CHECKING, Any

from taichi_foam.analysis import quantities as q
from taichi_foam.records import history
from taichi_foam.scene import CHOICE_SETS
from taichi_foam.shim2000.tests import MEASURED, NAMES, paper_scene

if TYPE_CHECKING:
    from taichi_foam.scene import Scene

QUANTITIES = (
    q.DISPLACEMENT, q.DURATION, q.PLATEAU, q.ENERGY_PER_VOLUME, q.ENERGY_ABSORBED, q.PEAK,
    q.REBOUND, q.WIDTH, q.HEIGHT, q.PIECES, q.BROKEN, q.RESIDUAL,
)  # fmt: skip
"""The figures of the page's table, in its order."""

FIGURES = tuple((one.key, one.name, one.unit, one.factor, one.digits) for one in QUANTITIES)
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
