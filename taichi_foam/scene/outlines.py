"""Plane geometry of a block's outline and holes, by shapely: validity, areas and lengths.

Corners are pairs [x, y]; shapely is imported only when an outline is used.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import combinations
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from taichi_foam.laws.shape.outline import TOLERANCE, problems_of_ring

if TYPE_CHECKING:
    from shapely import Polygon

Array = NDArray[np.float64]
Corners = Sequence[tuple[float, float]]

AT_ONCE = 8
"""Largest tile, in cells along its longer side, whose cells are intersected individually."""

ROUNDING = 12
"""Decimals to which areas and lengths are rounded, so that symmetric ones are exactly symmetric."""


def polygon(outline: Corners | Array, holes: Iterable[Corners | Array] = ()) -> Polygon:
    """The polygon of an outline with its holes."""
    import shapely

    return shapely.Polygon(np.array(outline), [np.array(hole) for hole in holes])


def problems(outline: Corners, holes: Sequence[Corners]) -> list[str]:
    """Problems of an outline and its holes, in whole sentences."""
    found = problems_of_ring("block.outline", outline)
    for number, hole in enumerate(holes):
        found += problems_of_ring(f"block.holes[{number}]", hole)
    return found or _problems_of_holes(outline, holes)


def is_mirrored(shape: Polygon, width: float) -> bool:
    """Whether a shape is its own mirror image about the vertical line at half of `width`."""
    from shapely import affinity

    other = affinity.scale(shape, xfact=-1.0, origin=(width / 2, 0.0))
    return shape.normalize().equals_exact(other.normalize(), TOLERANCE * width)


def shares(shape: Polygon, across: Array, up: Array) -> Array:
    """Area of a shape in each box of a grid, (len(across) - 1, len(up) - 1).

    `across` and `up` are the grid's lines, in rising order.
    """
    found = np.zeros((len(across) - 1, len(up) - 1))
    _fill(shape, across, up, found)
    return np.round(found, ROUNDING)


def lengths(shape: Polygon, levels: Array, marks: Array, upright: bool) -> Array:
    """Length of straight lines inside a shape between marks, (len(levels), len(marks) - 1).

    The lines are vertical at x = `levels`, or horizontal at y = `levels`; parts along the shape's
    boundary are not inside.
    """
    import shapely

    ends = np.empty((len(levels), 2, 2))
    along = 1 if upright else 0
    ends[:, :, 1 - along] = levels[:, None]
    ends[:, :, along] = marks[[0, -1]]
    lines = shapely.linestrings(ends)
    inside = shapely.intersection(lines, shape)
    edge = shapely.intersection(lines, shape.boundary)
    found = _between(inside, len(levels), marks, along) - _between(edge, len(levels), marks, along)
    return np.round(found, ROUNDING)


def _problems_of_holes(outline: Corners, holes: Sequence[Corners]) -> list[str]:
    whole, cut = polygon(outline), [polygon(hole) for hole in holes]
    found = [
        f"block.holes[{number}]: is not inside the outline; a hole must lie within it and not "
        "touch it; move it, or draw it as a notch of block.outline"
        for number, hole in enumerate(cut)
        if not whole.contains_properly(hole)
    ]
    found += [
        f"block.holes[{second}]: crosses or touches block.holes[{first}]; holes must lie apart; "
        "draw both as one"
        for (first, one), (second, other) in combinations(enumerate(cut), 2)
        if one.intersects(other)
    ]
    return found


def _fill(shape: Any, across: Array, up: Array, found: Array) -> None:
    """Write the result of `shares` into `found`, full or empty tiles as a whole."""
    import shapely

    if shape.is_empty:
        return
    tile = shapely.box(across[0], up[0], across[-1], up[-1])
    if shape.covers(tile):
        found[:] = np.outer(np.diff(across), np.diff(up))
        return
    columns, rows = found.shape
    part = _areas_of(shape.intersection(tile))
    if max(columns, rows) <= AT_ONCE:
        left, low = (each.ravel() for each in np.meshgrid(across[:-1], up[:-1], indexing="ij"))
        right, high = (each.ravel() for each in np.meshgrid(across[1:], up[1:], indexing="ij"))
        boxes = shapely.box(left, low, right, high)
        shapely.prepare(part)
        full = shapely.covers(part, boxes)
        areas = (right - left) * (high - low)
        cut = ~full & shapely.intersects(part, boxes)
        areas[~full & ~cut] = 0.0
        areas[cut] = shapely.area(shapely.intersection(part, boxes[cut]))
        found[:] = areas.reshape(found.shape)
        return
    halves = (columns + 1) // 2 if columns >= rows else 0
    if halves:
        _fill(part, across[: halves + 1], up, found[:halves])
        _fill(part, across[halves:], up, found[halves:])
    else:
        halves = (rows + 1) // 2
        _fill(part, across, up[: halves + 1], found[:, :halves])
        _fill(part, across, up[halves:], found[:, halves:])


def _areas_of(part: Any) -> Any:
    """A geometry without lines and points, which remain where an intersection only touches."""
    import shapely

    if part.geom_type != "GeometryCollection":
        return part
    return shapely.multipolygons([each for each in part.geoms if each.geom_type == "Polygon"])


def _between(pieces: Any, count: int, marks: Array, along: int) -> Array:
    """Length of straight pieces of `count` lines between marks, (count, len(marks) - 1)."""
    import shapely

    found = np.zeros((count, len(marks) - 1))
    pieces, line = shapely.get_parts(pieces, return_index=True)
    straight = shapely.get_type_id(pieces) == 1
    pieces, line = pieces[straight], line[straight]
    bounds = shapely.bounds(pieces)
    low, high = bounds[:, along], bounds[:, 2 + along]
    for place, start, stop in zip(line, low, high, strict=True):
        inside = np.minimum(stop, marks[1:]) - np.maximum(start, marks[:-1])
        found[place] += np.maximum(inside, 0.0)
    return found
