"""The scenes that are compared: a paper test with one of two sets of choices, of any size."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

import numpy as np

from taichi_foam.choices import CHOICE_SETS, PAPERS_FOAM
from taichi_foam.scene import Scene
from taichi_foam.shim2000.impacts import paper_scene

CASE = "paper/rectangular-3.03"
Choices = Literal["calibrated", "rated"]
Extent = Literal["peers", "room", "apart", "whole"]
NO_OVERSHOOT: dict[str, object] = {"rate": None, "overshoot_strain": None, "yield_strain": -0.042}
CHANGES: dict[Choices, dict[str, dict[str, object]]] = {
    "calibrated": {"foam": NO_OVERSHOOT, "impactor": {"friction": 0.14}},
    "rated": {"foam": {**NO_OVERSHOOT, "rate": 3000.0}, "impactor": {"friction": 0.14}},
}
"""What differs from the calibrated choices: the peers' foam has no overshoot, and the plateau and
friction that were calibrated without. Rated: a plateau that grows with the strain rate."""


WHOLE_CELLS = {"rows": 20, "mass_points": "cells"}
AT_ONCE = {"softening": False, "fracture_energy": None, "shear_fracture_energy": None}
WHOLE = {
    "foam": {"crush_band": None, **{key: PAPERS_FOAM[key] for key in NO_OVERSHOOT}},
    "impactor": {"friction": CHOICE_SETS["calibrated"]["impactor.friction"]},
}
EXTENTS: dict[Extent, dict[str, dict[str, object]]] = {
    "peers": {
        "block": WHOLE_CELLS,
        "model": {"self_contact": False, "crushed_room": False, "shear_yield": False},
        "foam": {"crush_band": None, **AT_ONCE},
    },
    "room": {
        "block": WHOLE_CELLS,
        "model": {"self_contact": False, "shear_yield": False},
        # enough for bonds of any cell here: the peers do not reduce a bond's limits
        "foam": {"crush_band": None, "fracture_energy": 75.0, "shear_fracture_energy": 130.0},
    },
    "apart": {**WHOLE, "model": {"self_contact": False}},
    "whole": WHOLE,
}
"""How much of the model: what the peers have; besides, the room of crushed foam and bonds that
soften; also mass points on the block's faces, overshoot and yield in shear; and all of it, with
contact of pieces.
(Pieces of foam without room fold, and their contact costs what it never does in a run.) All take
strain rates over a cell: then dashpots limit the step, and all take the same ones."""


def scene_with(choices: Choices, name: str = CASE, extent: Extent = "peers") -> Scene:
    """A paper test with these choices, and so much of the model."""
    return updated(updated(paper_scene(name), CHANGES[choices]), EXTENTS[extent])


def updated(scene: Scene, values: Mapping[str, Mapping[str, object]]) -> Scene:
    """The scene with other values, by part and field."""
    return scene.model_copy(
        update={part: getattr(scene, part).model_copy(update=new) for part, new in values.items()}
    )


SPREAD = 0.03  # of the impactors' velocities in a batch


def batch_of(scene: Scene, count: int) -> list[Scene]:
    """As many drops that differ: their impactors are up to 3 % slower or faster."""
    assert scene.impactor is not None
    velocity = scene.impactor.velocity
    if count == 1:
        return [scene]
    return [
        updated(scene, {"impactor": {"velocity": velocity * (1.0 + SPREAD * part)}})
        for part in np.linspace(-1.0, 1.0, count).tolist()
    ]


def lattice_of(scene: Scene, columns: int, rows: int) -> Scene:
    """The scene with other counts but the same cells, so that the step size stays the same.

    The impactor grows with the block's width, so that as large a part of it is hit.
    """
    block, impactor = scene.block, scene.impactor
    size = {"width": columns * block.dx, "height": rows * block.dy}
    scene = updated(scene, {"block": {"columns": columns, "rows": rows, **size}})
    if impactor is None:
        return scene
    share = size["width"] / block.width
    sizes = [key for key in ("mass", "width") if key in type(impactor).model_fields]
    return updated(scene, {"impactor": {key: share * getattr(impactor, key) for key in sizes}})
