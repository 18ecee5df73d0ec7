"""Whether crushed foam keeps its room, measured in the deformed configuration of an instant.

docs/model.md, Room of crushed foam, defines both measures. SI units.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from taichi_foam.analysis.cell_shapes import shapes_of
from taichi_foam.analysis.cell_state import (
    CRUSHED_FRACTION,
    crushed_cells,
    crushed_parts,
    there,
    worst_strain,
)
from taichi_foam.analysis.impact import is_flat
from taichi_foam.laws.bond import BondFoam
from taichi_foam.records.snapshot import Snapshot
from taichi_foam.scene import Block, Scene
from taichi_foam.scene.filling import filling
from taichi_foam.scene.layers import foams_of_bonds
from taichi_foam.scene.motion import in_middle_half

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Indices = NDArray[np.int64]

NEEDED_AREA = 0.12
"""A crushed cell needs this share of its area: about halfway between 0.20 at densification and 0.05
at locking, a little less than bonds keep in crushed layers of the paper's flat tests (0.13)."""

PIXELS = 20
"""Pixels along the shorter side of a cell; fewer if there would be more than MOST_PIXELS in all."""

MOST_PIXELS = 2e6
"""Largest number of pixels of all cells, to limit time and memory."""

# Cells longer or further away than this many cells are ignored: the run has diverged.
_LONGEST, _FURTHEST = 4, 1e6
# Offset of the pixels, so that no side of a regular lattice runs through the centres of pixels.
_ASIDE = np.array([0.317, 0.239])
# Stride of pixel numbers from row to row: more than the pixels of a row.
_ROW = 2**31


def crushed_layer(snapshot: Snapshot, scene: Scene) -> float | None:
    """Thickness of the crushed layer under a level face [m], from the face to its lower end.

    If the face has lifted off, the layer begins at the median of the columns' highest mass points.

    None without a level face on rails, on a rotated lattice, and if nothing below it is crushed.
    """
    impactor, block = scene.impactor, scene.block
    if impactor is None or scene.turns or not is_flat(impactor) or block.lattice_angle_deg != 0:
        return None
    middle = in_middle_half(impactor, block.positions[:, 0, 0], slack=1e-6 * block.dx)
    part = crushed_parts(snapshot, scene)[1][middle]
    crushed = part > CRUSHED_FRACTION
    if not crushed.any():
        return None
    height, held = snapshot.position[middle, :, 1], there(block)[middle]
    kept = held.any(axis=1)  # columns with foam
    part, crushed, height, held = part[kept], crushed[kept], height[kept], held[kept]
    column, lowest = np.arange(len(height)), crushed.argmax(axis=1)
    below, above = height[column, lowest], height[column, lowest + 1]
    foams, _, rows = foams_of_bonds(scene)
    shares = np.array([_crushed_share(part[column, lowest], foam) for foam in foams])
    end = above - (above - below) * shares[rows[lowest], column]
    top = np.where(held, height, -np.inf).max(axis=1)
    begin = min(snapshot.impactor_y, float(np.median(top)))
    return float(np.median(np.where(crushed.any(axis=1), begin - end, 0.0)))


def without_room(snapshot: Snapshot, scene: Scene) -> float | None:
    """Share of the crushed foam that has no room, since it overlaps other foam; 0 to 1.

    It is the area that cells lack over the area that they need; None if nothing is crushed.
    """
    from scipy.spatial import KDTree  # imported late: it takes a third of a second to load

    block = scene.block
    quads, extent, sound = _cells(snapshot, block)
    sound &= there(block)
    crushed = crushed_cells(snapshot, scene)
    if not (crushed & sound).any():
        return None
    claims, others = quads[crushed & sound], quads[~crushed & sound]
    reach = 2.0 * np.sqrt(2.0) * extent[sound].max()  # of corners of cells that touch
    near = KDTree(claims[:, 0]).query(others[:, 0], distance_upper_bound=reach)[0] < np.inf
    others = others[near]
    boxes = sum(float(np.ptp(cells, axis=1).prod(axis=1).sum()) for cells in (claims, others))
    pixel = max(min(block.dx, block.dy) / PIXELS, np.sqrt(boxes / MOST_PIXELS))
    room = pixel**2 * _room(claims / pixel, others / pixel)
    needed = (_needed(snapshot) * filling(block).share)[crushed & sound] * block.dx * block.dy
    return float(np.maximum(needed - room, 0.0).sum() / needed.sum())


def _cells(snapshot: Snapshot, block: Block) -> tuple[Array, Array, Flags]:
    """Corners of all cells (columns, rows, 4, 2) [m], their extents [m], and which are valid."""
    with np.errstate(over="ignore", invalid="ignore"):
        quads, _ = shapes_of(snapshot, block)
        extent = np.ptp(quads, axis=2).max(axis=2)
        furthest = np.abs(quads).max(axis=(2, 3))
    size = max(block.dx, block.dy)
    return quads, extent, (extent <= _LONGEST * size) & (furthest <= _FURTHEST * size)


def _crushed_share(part: Array, foam: BondFoam) -> Array:
    """The share of a bond's current length that its crushed part takes."""
    marks = foam.landmarks
    crushed, yielded = part * (1.0 + marks.crush_end), (1.0 - part) * (1.0 + marks.crush_start)
    return crushed / (crushed + yielded)


def _needed(snapshot: Snapshot) -> Array:
    """(columns, rows) share of its reference area that each cell needs when crushed."""
    across = worst_strain(snapshot.e_min_a, np.zeros_like(snapshot.e_min_b))
    upright = worst_strain(np.zeros_like(snapshot.e_min_a), snapshot.e_min_b)
    return np.minimum(NEEDED_AREA, (1.0 + across) * (1.0 + upright))


def _room(claims: Array, others: Array) -> Array:
    """(n,) area that each of the quadrilaterals `claims` (n, 4, 2) has to itself; all in pixels.

    It is its area times the mean share of its pixels that it has: 0 of a pixel that any of `others`
    (m, 4, 2) covers, 1/k of a pixel that k claims cover. A quadrilateral too thin to cover a pixel
    has its whole area.
    """
    x, y = claims[..., 0], claims[..., 1]
    area = 0.5 * np.sum(x * np.roll(y, -1, axis=1) - y * np.roll(x, -1, axis=1), axis=1)
    origin = claims.min(axis=(0, 1)) - _ASIDE
    which, pixels = _pixels(claims - origin)
    claimed, place, claimants = np.unique(pixels, return_inverse=True, return_counts=True)
    taken = _pixels(others - origin)[1]
    shares = 1.0 / claimants
    if claimed.size:
        nearest = np.searchsorted(claimed[:-1], taken)
        shares[nearest[claimed[nearest] == taken]] = 0.0
    covered = np.bincount(which, minlength=len(claims))
    kept = np.bincount(which, shares[place], minlength=len(claims))
    return np.maximum(area, 0.0) * np.where(covered > 0, kept / np.maximum(covered, 1), 1.0)


def _pixels(quads: Array) -> tuple[Indices, Indices]:
    """Pairs of quadrilaterals (n, 4, 2) [pixels] and pixels that they cover.

    A pixel is covered if its centre lies to the left of all sides, or on them: a quadrilateral
    whose corners run clockwise covers none.
    """
    quads = quads - 0.5  # centres of pixels at whole numbers
    first = np.ceil(quads.min(axis=1)).astype(np.int64)
    size = np.floor(quads.max(axis=1)).astype(np.int64) + 1 - first
    count = size.prod(axis=1)
    which = np.repeat(np.arange(len(quads)), count)
    place = np.arange(len(which)) - np.repeat(np.cumsum(count) - count, count)
    x = first[which, 0] + place % size[which, 0]
    y = first[which, 1] + place // size[which, 0]
    inside = np.ones(len(which), dtype=bool)
    for corner, following in zip(range(4), (1, 2, 3, 0), strict=True):
        along = quads[:, following] - quads[:, corner]
        level = along[:, 0] * quads[:, corner, 1] - along[:, 1] * quads[:, corner, 0]
        inside &= along[which, 0] * y - along[which, 1] * x >= level[which]
    return which[inside], _ROW * y[inside] + x[inside]
