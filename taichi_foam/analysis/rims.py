"""Where the outline of a block runs through the cells along it: their corners are put on it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from taichi_foam.scene import Block
from taichi_foam.scene.filling import filling, in_cells
from taichi_foam.scene.outlines import is_mirrored

Array = NDArray[np.float64]

AT_CORNER = 0.75
"""A corner of cells so near to one of the outline [cells] is put there, otherwise on its side.

Where the outline's corner is the nearest point of any, only these are put there: another one beside
them would leave a cell without a side."""

FURTHEST = 1.0
"""Corners further from the outline than this [cells] stay: what is there is too thin to show."""


@dataclass(frozen=True, eq=False)
class Rim:
    """The cells along an outline.

    i, j   (n,) numbers of the cells
    shift  (n, 4, 2) of their corners, lower left first, against the clock [cells]
    """

    i: NDArray[np.intp]
    j: NDArray[np.intp]
    shift: Array


def on_outline(quads: Array, block: Block) -> Array:
    """Corners (columns, rows, 4, 2) of deformed cells, those along the outline put on it."""
    if block.is_rectangle:
        return quads
    rim = _rim(block)
    found = quads.copy()
    cells = quads[rim.i, rim.j]
    across = (cells[:, 1] - cells[:, 0] + cells[:, 2] - cells[:, 3]) / 2
    up = (cells[:, 3] - cells[:, 0] + cells[:, 2] - cells[:, 1]) / 2
    move = rim.shift[..., :1] * across[:, None] + rim.shift[..., 1:] * up[:, None]
    found[rim.i, rim.j] = cells + move
    return found


def along_outline(block: Block) -> NDArray[np.bool_]:
    """(columns, rows) which cells have corners that were put on the outline."""
    found = np.zeros((block.columns, block.rows), dtype=bool)
    if not block.is_rectangle:
        rim = _rim(block)
        found[rim.i, rim.j] = True
    return found


def _rim(block: Block) -> Rim:
    return _kept(block)  # type: ignore[arg-type]  # pydantic's frozen classes do have a hash


@lru_cache(maxsize=16)
def _kept(block: Block) -> Rim:
    import shapely

    there = filling(block).there
    around = np.pad(there, 1).astype(int)
    count = around[:-1, :-1] + around[1:, :-1] + around[1:, 1:] + around[:-1, 1:]
    p, q = np.nonzero((count > 0) & (count < 4))
    corners = np.column_stack([p, q]).astype(float)
    foam = in_cells(block)
    edge = foam.boundary
    points = shapely.points(corners)
    nearest = shapely.get_coordinates(shapely.shortest_line(points, edge))[1::2]
    marks = shapely.get_coordinates(edge)
    away = np.abs(corners[:, None] - marks[None]).max(axis=2)
    best = away.argmin(axis=1)
    comes = np.abs(nearest - marks[best]).max(axis=1) < 1e-9
    at_corner = away[np.arange(len(best)), best] <= AT_CORNER
    at_corner &= comes | ~np.isin(best, best[comes])
    shift = np.where(at_corner[:, None], marks[best], nearest) - corners
    shift[np.abs(shift).max(axis=1) > FURTHEST] = 0.0
    shift[np.abs(shift) < 1e-9] = 0.0
    whole = np.zeros((*count.shape, 2))
    whole[p, q] = shift
    if block.lattice_angle_deg == 0 and is_mirrored(foam, block.columns):
        whole = 0.5 * (whole + whole[::-1] * [-1.0, 1.0])  # what lies between two sides, too
    of_cells = np.stack([whole[:-1, :-1], whole[1:, :-1], whole[1:, 1:], whole[:-1, 1:]], axis=2)
    i, j = np.nonzero(there & (of_cells != 0.0).any(axis=(2, 3)))
    return Rim(i, j, of_cells[i, j])
