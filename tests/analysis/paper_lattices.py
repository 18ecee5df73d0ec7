"""The paper's block, its impactors, and cracks in it, for measures of hand-made lattices."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from taichi_foam.records.snapshot import Snapshot
from taichi_foam.scene import Block, Cylinder, FlatBlock, Scene, Wedge

PAPER = Block(rows=20, mass_points="cells")  # 40 x 20 cells of 5 mm
FACES = Block()  # 21 rows, the first and the last on the faces
DX = DY = 0.005
AXIS = 19  # the A bonds that cross x = 0
FLAT = Scene(name="flat", block=PAPER, impactor=FlatBlock())
CYLINDER = Scene(name="cylinder", block=PAPER, impactor=Cylinder())
WEDGE = Scene(name="wedge", block=PAPER, impactor=Wedge())
FLAT_ON_FACES, WEDGE_ON_FACES = (each.model_copy(update={"block": FACES}) for each in (FLAT, WEDGE))
ALONE = WEDGE.model_copy(update={"impactor": None})


def column(i: int, rows: range) -> list[tuple[int, int]]:
    """Bonds A of a vertical crack."""
    return [(i, j) for j in rows]


def downwards(i: int, j: int) -> float:
    """Break times of a crack that runs down the block, 1 ms a row."""
    return 1e-3 * (20 - j)


def mirrored(snapshot: Snapshot) -> Snapshot:
    """The same instant seen from behind."""
    flipped: dict[str, Any] = {
        name: getattr(snapshot, name)[::-1]
        for name in ("e_min_a", "e_min_b", "break_time_a", "break_time_b", "velocity")
    }
    return replace(snapshot, position=snapshot.position[::-1] * [-1.0, 1.0], **flipped)
