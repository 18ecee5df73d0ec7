"""The pattern of crushing and cracking in numbers, for comparison with the paper's pictures.

Every function takes an instant (or several, in order of time) and its scene, and returns None if
the figure is undefined: nothing is crushed, or nothing hits the block. SI units.

The impactor's path is the strip between the vertical lines through the ends of its outline, over
the block's whole height. A cell belongs to it if its centre does, in the reference configuration.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import ceil

import numpy as np
from numpy.typing import NDArray

from taichi_foam.analysis.cell_state import (
    by_foam,
    crushed_cells,
    over_bonds,
    there,
    worst_strain,
)
from taichi_foam.analysis.fragments import Crack, parts, sizes_of
from taichi_foam.laws.shape.outline import lower_chain
from taichi_foam.records.snapshot import Snapshot
from taichi_foam.scene import Block, Impactor, Scene
from taichi_foam.scene.motion import ends_of, in_middle_half

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

SPLIT_FRACTION = 0.1
"""A crack splits the block if it comes this near to the bottom, as a share of the height."""

ELASTIC_YIELDS = 2.0
"""Foam counts as permanently deformed beyond this many yield strains.

One would be too few: the plateau is level, so all foam below a crushed layer is at the yield
stress, a little beyond the yield strain.
"""

WORST_SHARE = 0.1
"""The worst crushed cells are this share of all crushed cells."""


@dataclass(frozen=True)
class CrushedRegion:
    """The largest patch of crushed cells connected by sides.

    columns, rows  first and last index
    width, height  m, extent in the reference configuration
    fill           crushed share of its bounding box: 1 for a rectangle, 0.79 for half an ellipse,
                   0.5 for a triangle
    """

    columns: tuple[int, int]
    rows: tuple[int, int]
    width: float
    height: float
    fill: float


@dataclass(frozen=True)
class TopCracks:
    """Tensile cracks that open at the top surface, beside the impactor.

    count       number of bonds of the top row that have opened
    depth       m, depth of the deepest of these cracks
    first_time  s, when the first bond of the top row broke; None without any
    """

    count: int
    depth: float
    first_time: float | None


# --- crushing -----------------------------------------------------------------------------------


def crushed_region(snapshot: Snapshot, scene: Scene) -> CrushedRegion | None:
    """The largest connected patch of crushed cells; None if there is none."""
    patch = _largest_patch(crushed_cells(snapshot, scene))
    if patch is None:
        return None
    columns, rows = np.flatnonzero(patch.any(axis=1)), np.flatnonzero(patch.any(axis=0))
    across, edges = int(columns[-1] - columns[0] + 1), scene.block.row_edges
    height = float(edges[rows[-1] + 1] - edges[rows[0]])
    return CrushedRegion(
        columns=(int(columns[0]), int(columns[-1])),
        rows=(int(rows[0]), int(rows[-1])),
        width=across * scene.block.dx,
        height=height,
        fill=float((patch @ np.diff(edges)).sum() / (across * height)),
    )


def boundary_cells(snapshot: Snapshot, scene: Scene) -> tuple[float, float] | None:
    """Number of cells between crushed and elastic foam: beside the crushed region, and below it.

    Counts successive cells that are permanently deformed but not crushed, outwards from the
    region's last crushed cell (in each of its rows, to both sides; in each of its columns,
    downwards). Means over rows and sides, and over columns. 0 is the sharpest boundary.
    """
    patch = _largest_patch(crushed_cells(snapshot, scene))
    if patch is None:
        return None
    lasting = _deformed_for_good(snapshot, scene)
    rows, columns = patch.any(axis=0), patch.any(axis=1)
    sides = [
        *_cells_beyond(patch.T[rows], lasting.T[rows]),
        *_cells_beyond(patch.T[rows][:, ::-1], lasting.T[rows][:, ::-1]),
    ]
    below = _cells_beyond(patch[columns][:, ::-1], lasting[columns][:, ::-1])
    return float(np.mean(sides)), float(np.mean(below))


def crushed_outside(snapshot: Snapshot, scene: Scene, margin: float) -> float | None:
    """Share of the crushed cells that lie more than `margin` [m] outside the impactor's path.

    The smallest meaningful margin is one cell: a crushed bond across the edge of the path makes
    the cells on both its sides crushed.
    """
    crushed = crushed_cells(snapshot, scene)
    if scene.impactor is None or not crushed.any():
        return None
    inside = _path_columns(scene, scene.impactor, margin)
    return float(np.count_nonzero(crushed[~inside]) / np.count_nonzero(crushed))


def severity_by_row(snapshot: Snapshot, scene: Scene) -> Array | None:
    """(rows,) mean worst compressive strain (positive) in the impactor's path, top row first."""
    if scene.impactor is None:
        return None
    inside = _path_columns(scene, scene.impactor)
    if not inside.any():
        return None
    worst, held = -worst_strain(snapshot.e_min_a, snapshot.e_min_b), there(scene.block)[inside]
    total = np.where(held, worst[inside], 0.0).sum(axis=0)
    return (total / np.maximum(held.sum(axis=0), 1))[::-1]


def severity_falls(snapshot: Snapshot, scene: Scene) -> float | None:
    """How consistently severity decreases with distance from the impactor's face, from 0 to 1.

    It is the share of all pairs of rows in the crushed region in which the row nearer to the face
    is crushed more; equal rows count half. It equals (1 + Kendall's tau) / 2, and is 0.5 for an
    evenly crushed region: the step at its lower side does not count.
    """
    severity, region = severity_by_row(snapshot, scene), crushed_region(snapshot, scene)
    if severity is None or region is None or region.rows[0] == region.rows[1]:
        return None
    lowest, highest = region.rows
    crushed = severity[severity.size - 1 - highest : severity.size - lowest]
    nearer, further = np.triu_indices(crushed.size, k=1)
    return float(0.5 + 0.5 * np.sign(crushed[nearer] - crushed[further]).mean())


def worst_beneath(snapshot: Snapshot, scene: Scene) -> float | None:
    """Share of the worst crushed cells that lie beneath the impactor now.

    The worst are the WORST_SHARE of the crushed cells with the largest compressive strain (ties
    with the last one included). "Beneath" means within the impactor's width, below the level where
    its nose is fully immersed: for a cylinder, under its lower half and not beside its flanks.
    """
    crushed = crushed_cells(snapshot, scene)
    if scene.impactor is None or not crushed.any():
        return None
    strain = worst_strain(snapshot.e_min_a, snapshot.e_min_b)
    count = ceil(WORST_SHARE * np.count_nonzero(crushed))
    worst = strain <= np.sort(strain[crushed])[count - 1]
    # A flat face has no nose; in contact, mass points sink into it by a fraction of a cell.
    level = snapshot.impactor_y + max(scene.impactor.nose_depth, scene.block.dy)
    left, right = ends_of(scene.impactor)
    x = snapshot.position[..., 0]
    beneath = (left < x) & (x < right) & (snapshot.position[..., 1] < level)
    return float(np.count_nonzero(worst & beneath) / np.count_nonzero(worst))


def crushed_along_faces(snapshot: Snapshot, scene: Scene, margin: float) -> float | None:
    """Share of the crushed cells that are now within `margin` [m] of the cavity.

    The cavity is the region swept by the impactor: its lower faces, and vertical walls above its
    ends.
    """
    crushed = crushed_cells(snapshot, scene)
    if scene.impactor is None or not crushed.any():
        return None
    place = np.array([scene.impactor.x, snapshot.impactor_y])
    chain = lower_chain(scene.impactor.outline()) + place
    distance = _distance_from_cavity(snapshot.position[crushed], chain)
    return float(np.count_nonzero(distance <= margin) / distance.size)


def crushed_left(snapshot: Snapshot, scene: Scene) -> float | None:
    """Share of the crushed cells left of the impactor's axis; cells on the axis count half."""
    crushed = crushed_cells(snapshot, scene)
    if scene.impactor is None or not crushed.any():
        return None
    sides = np.sign(np.round((_column_x(scene.block) - scene.impactor.x) / scene.block.dx, 6))
    return float(0.5 - 0.5 * np.repeat(sides, crushed.sum(axis=1)).mean())


def crushed_ahead(snapshot: Snapshot, scene: Scene) -> float | None:
    """Share of the crushed cells that are now below the impactor's lowest point."""
    crushed = crushed_cells(snapshot, scene)
    if scene.impactor is None or not crushed.any():
        return None
    lower = snapshot.position[..., 1] < snapshot.impactor_y
    return float(np.count_nonzero(crushed & lower) / np.count_nonzero(crushed))


def reach_ahead(snapshot: Snapshot, scene: Scene) -> float | None:
    """Depth of permanently deformed foam below the impactor's lowest point [m].

    Measured to the lowest side of the deformed cells that are now in the middle half of the
    impactor's width (half a cell below their mass points, or the block's bottom); 0 if none of them
    is lower.
    """
    if scene.impactor is None:
        return None
    block = scene.block
    below = np.full(block.rows, block.dy / 2)
    below[0] = block.foot
    depth = snapshot.impactor_y - snapshot.position[..., 1] + below
    middle = in_middle_half(scene.impactor, snapshot.position[..., 0])
    lasting = _deformed_for_good(snapshot, scene) & middle
    return float(depth[lasting].max(initial=0.0))


# --- cracking -----------------------------------------------------------------------------------


def crack_reach(crack: Crack | None, block: Block) -> float:
    """Share of the block's height above a crack's lowest end; 0 without a crack."""
    return 1.0 - crack.lowest_height / block.height if crack else 0.0


def splits(crack: Crack | None, block: Block) -> bool:
    """Whether a crack below the impactor comes within SPLIT_FRACTION of the height of the bottom.

    It cannot reach the bottom if the base grips the bottom row: that row never opens, and near it,
    where the halves rotate as about a hinge, the crack hardly opens.
    """
    return crack_reach(crack, block) >= 1.0 - SPLIT_FRACTION - 1e-9


def second_part(snapshot: Snapshot, block: Block) -> float:
    """Share of all mass points in the second largest part above the base; 0 without one.

    The base is SPLIT_FRACTION of the block's height: if gripped, it holds together halves that a
    crack has separated (see `splits`).
    """
    return _second(_above_base(snapshot, block), slice(None)) / there(block).sum()


def second_half(snapshot: Snapshot, block: Block) -> float:
    """As `second_part`, but only for parts that stand on the base.

    A block split by a vertical crack has two of nearly equal size. A part torn off sideways, above
    a layer that stays on the base, does not count.
    """
    above = _above_base(snapshot, block)
    standing = np.unique(above[:, 0])
    return _second(above, standing[standing >= 0]) / there(block).sum()


def crack_from_tip(crack: Crack, snapshots: Sequence[Snapshot], scene: Scene) -> float | None:
    """Distance between a crack's start and the impactor's lowest point at that time [m].

    The start is given in the reference configuration; foam ahead of a tip has hardly moved.
    """
    if scene.impactor is None or not snapshots:
        return None
    times = [snapshot.time for snapshot in snapshots]
    tip = np.interp(crack.start_time, times, [snapshot.impactor_y for snapshot in snapshots])
    return float(np.hypot(crack.start_x - scene.impactor.x, crack.start_height - tip))


def top_cracks(snapshots: Sequence[Snapshot], scene: Scene) -> TopCracks | None:
    """Tensile cracks of the top surface within one impactor's width beside the impactor.

    A bond A has opened in tension if it is broken in the last snapshot and was stretched beyond
    the tensile strain in any of them; a shear tear hardly lengthens its bond. Its edge must lie
    more than half a cell outside the impactor's path, where the flanks tear the foam off.
    Cracks begin in the top row, and continue down as long as the next row has an opened bond in
    the same or a neighbouring column.
    """
    from scipy import ndimage

    if scene.impactor is None or not snapshots:
        return None
    dx, row_edges = scene.block.dx, scene.block.row_edges
    left, right = ends_of(scene.impactor)
    edge = (_column_x(scene.block)[1:] + _column_x(scene.block)[:-1]) / 2
    outside = np.maximum(left - edge, edge - right)
    near = (outside > dx / 2) & (outside <= right - left)

    lengths = np.max(
        [np.linalg.norm(np.diff(s.position, axis=0), axis=2) for s in snapshots], axis=0
    )
    last = snapshots[-1]
    opened = last.broken_a & (lengths / dx - 1 > scene.foam.landmarks.tensile) & near[:, None]
    top = opened[:, -1]
    rows, reached = 0, top
    while reached.any():
        rows += 1
        if rows == opened.shape[1]:
            break
        reached = opened[:, -1 - rows] & ndimage.binary_dilation(reached)
    times = last.break_time_a[top, -1]
    return TopCracks(
        count=int(np.count_nonzero(top)),
        depth=float(row_edges[-1] - row_edges[-1 - rows]),
        first_time=float(times.min()) if times.size else None,
    )


# --- parts --------------------------------------------------------------------------------------


def _largest_patch(crushed: Flags) -> Flags | None:
    """The largest set of crushed cells connected by sides, (columns, rows); None if none is."""
    from scipy import ndimage

    patches = np.zeros(crushed.shape, dtype=np.int32)
    if ndimage.label(crushed, output=patches) == 0:
        return None
    return patches == 1 + np.argmax(np.bincount(patches.ravel())[1:])


def _deformed_for_good(snapshot: Snapshot, scene: Scene) -> Flags:
    """(columns, rows) whether a cell was compressed beyond ELASTIC_YIELDS yield strains."""
    beyond = by_foam(
        snapshot,
        scene,
        lambda foam, worst: 1.0 * (worst < ELASTIC_YIELDS * foam.landmarks.crush_start),
    )
    return over_bonds(np.maximum, *beyond) > 0.0


def _cells_beyond(crushed: Flags, lasting: Flags) -> list[int]:
    """For each line (n, m), the number of permanently deformed cells after the last crushed one."""
    lines = zip(crushed, lasting, strict=True)
    beyond = [lasts[np.flatnonzero(crush)[-1] + 1 :] for crush, lasts in lines]
    return [int(np.argmin(np.append(flags, False))) for flags in beyond]


def _above_base(snapshot: Snapshot, block: Block) -> NDArray[np.int32]:
    """The number of the part of each mass point, without the base's rows."""
    base = SPLIT_FRACTION * block.height * (1.0 + 1e-9)
    return parts(snapshot, block, bottom_rows=int(np.sum(block.row_edges[1:] <= base)))


def _second(labels: NDArray[np.int32], chosen: slice | NDArray[np.int32]) -> int:
    """Number of mass points in the second largest of the chosen parts; 0 without one."""
    sizes = np.sort(sizes_of(labels)[chosen])
    return int(sizes[-2]) if sizes.size > 1 else 0


def _column_x(block: Block) -> Array:
    """(columns,) x of the cells' centres in the reference configuration [m]."""
    return block.positions[:, 0, 0]


def _path_columns(scene: Scene, impactor: Impactor, margin: float = 0.0) -> Flags:
    """(columns,) whether the cells of a column lie in the path, or within `margin` [m] of it."""
    x, (left, right) = _column_x(scene.block), ends_of(impactor)
    slack = margin + 1e-6 * scene.block.dx
    return (x > left - slack) & (x < right + slack)


def _distance_from_cavity(points: Array, chain: Array) -> Array:
    """(n,) distance [m] of points (n, 2) from the region above a chain (k, 2) of faces; 0 inside.

    The chain runs from left to right; above its ends the region has vertical walls.
    """
    # Above an end, the nearest point of the wall is at the point's own height.
    x, y = points.T
    walls = [np.hypot(x - end[0], np.minimum(y - end[1], 0.0)) for end in (chain[0], chain[-1])]
    faces = [_distance_from_side(points, a, b) for a, b in pairwise(chain)]
    inside = (x >= chain[0, 0]) & (x <= chain[-1, 0]) & (y >= np.interp(x, *chain.T))
    return np.where(inside, 0.0, np.min([*walls, *faces], axis=0))


def _distance_from_side(points: Array, a: Array, b: Array) -> Array:
    """(n,) distance [m] of points (n, 2) from the straight line between two corners."""
    along = np.clip((points - a) @ (b - a) / ((b - a) @ (b - a)), 0.0, 1.0)
    return np.linalg.norm(points - a - along[:, None] * (b - a), axis=1)
