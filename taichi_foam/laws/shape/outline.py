"""Plane geometry of impactors: outlines, symmetry, moments of area, and the area swept.

An outline is an array (n, 2) of vertices [m], counter-clockwise with y upwards.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np

TOLERANCE = 1e-9
"""Length below which two vertices are the same point, as a fraction of the outline's size."""


def size(points: np.ndarray) -> float:
    """Larger side of the bounding box [m]."""
    return float(np.max(np.ptp(points, axis=0)))


def problems_of_corners(key: str, corners: Sequence[tuple[float, float]]) -> list[str]:
    """Problems of the corners under a key of a scene: one repeats, or all are on one line."""
    points = np.array(corners)
    least = TOLERANCE * size(points)
    for k in range(1, len(points)):
        near = np.abs(points[:k] - points[k]).max(axis=1) <= least
        if near.any():
            closing = k == len(points) - 1 and near[0]
            return [
                f"{key}[{k}] = {list(corners[k])}: repeats an earlier corner; each must be given "
                f"once{', the outline closes by itself' if closing else ''}; leave it out"
            ]
    if len(convex_hull(points)) < 3:
        return [
            f"{key}: encloses no area: its corners are all on one line; move one of them off that "
            "line"
        ]
    return []


def problems_of_ring(key: str, corners: Sequence[tuple[float, float]]) -> list[str]:
    """Problems of the corners of a simple polygon, given in order."""
    import shapely  # slow to import, and seldom needed

    if len(corners) < 3:
        return [
            f"{key}: {len(corners)} corners; at least 3 make an outline; give more, or leave it out"
        ]
    found = problems_of_corners(key, corners)
    if found or shapely.LinearRing(corners).is_simple:
        return found
    where = shapely.is_valid_reason(shapely.Polygon(corners)).partition("[")[2].rstrip("]")
    near = f" near [{', '.join(f'{float(c):.4g}' for c in where.split())}]" if where else ""
    return [
        f"{key}: crosses or touches itself{near}; it must be one simple outline, its corners in "
        "order along it; put them in order"
    ]


def convex_hull(points: np.ndarray) -> np.ndarray:
    """Return the corners of the convex hull, counter-clockwise, without points on its edges.

    Args:
        points: (n, 2), in any order [m].
    """
    least = TOLERANCE * size(points) ** 2

    def chain(ordered: list[np.ndarray]) -> list[np.ndarray]:
        kept: list[np.ndarray] = []
        for p in ordered:
            while len(kept) > 1 and _turn(kept[-2], kept[-1], p) <= least:
                kept.pop()
            kept.append(p)
        return kept[:-1]

    ordered = sorted(points, key=lambda p: (p[0], p[1]))
    return np.array(chain(ordered) + chain(ordered[::-1]))


def _turn(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> float:
    """Twice the signed area of a triangle [m2]: positive for a left turn."""
    return float((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]))


def distance_inside(hull: np.ndarray, point: np.ndarray) -> float:
    """Distance of a point from the nearest edge of a hull [m], positive inside."""
    edges = np.roll(hull, -1, axis=0) - hull
    away = point - hull
    return float(np.min((edges[:, 0] * away[:, 1] - edges[:, 1] * away[:, 0]) / np.hypot(*edges.T)))


def rotated(points: np.ndarray, degrees: float) -> np.ndarray:
    """Return the points turned counter-clockwise about the origin; quarter turns are exact."""
    quarter = round(degrees / 90.0)  # the rest is in -45 to 45: exactly odd in `degrees`
    rest = degrees - 90.0 * quarter
    cosine, sine = math.cos(math.radians(rest)), math.sin(math.radians(rest))
    for _ in range(quarter % 4):
        cosine, sine = -sine, cosine
    x, y = points[:, 0], points[:, 1]
    return np.column_stack([cosine * x - sine * y, sine * x + cosine * y])


def foot(points: np.ndarray) -> np.ndarray:
    """Return the point (2,) at mid-width and lowest level."""
    low, high = points.min(axis=0), points.max(axis=0)
    return np.array([(low[0] + high[0]) / 2, low[1]])


def placed(points: np.ndarray, origin: np.ndarray) -> np.ndarray:
    """Return the outline relative to `origin`, its mid-width and lowest level.

    An outline that is its own mirror image except for rounding is made exactly symmetric, so that a
    symmetric impact stays exactly symmetric, too.
    """
    result = points - origin
    least = TOLERANCE * size(points)
    result[np.abs(result[:, 1]) < least, 1] = 0.0
    mirror_image = result * np.array([-1.0, 1.0])
    gaps = np.linalg.norm(result[:, None, :] - mirror_image[None, :, :], axis=2)
    partner = np.argmin(gaps, axis=1)
    if np.max(np.min(gaps, axis=1)) > least:
        return result
    x, y = result[:, 0], result[:, 1]
    return np.column_stack([(x - x[partner]) / 2, (y + y[partner]) / 2])


def is_mirrored(outline: np.ndarray) -> bool:
    """Whether an outline is exactly its own mirror image."""
    return {(-x, y) for x, y in outline.tolist()} == {(x, y) for x, y in outline.tolist()}


def area(outline: np.ndarray) -> float:
    """Area that an outline encloses [m2]; negative if it is clockwise."""
    x, y = outline[:, 0], outline[:, 1]
    return 0.5 * float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))


def centroid(outline: np.ndarray) -> np.ndarray:
    """Return the centroid (2,) of the area within an outline [m]."""
    about = outline[0]
    start = outline - about  # relative to a corner, to avoid cancellation
    end = np.roll(start, -1, axis=0)
    twice = start[:, 0] * end[:, 1] - end[:, 0] * start[:, 1]
    found = about + ((start + end) * twice[:, None]).sum(axis=0) / (3 * twice.sum())
    if is_mirrored(outline):
        found[0] = 0.0
    return found


def squared_gyration(outline: np.ndarray) -> float:
    """Polar second moment of area about the centroid, over the area [m2]."""
    start = outline - centroid(outline)
    end = np.roll(start, -1, axis=0)
    twice = start[:, 0] * end[:, 1] - end[:, 0] * start[:, 1]
    moment = np.sum((start**2 + start * end + end**2).sum(axis=1) * twice) / 12
    return float(moment / (0.5 * twice.sum()))


def lower_chain(outline: np.ndarray) -> np.ndarray:
    """Return the part of an outline that is visible from below, (k, 2), from left to right.

    Where it jumps, behind an overhang, two points have the same x.
    """
    least = TOLERANCE * size(outline)
    ahead = np.roll(outline, -1, axis=0)
    left = np.where((outline[:, 0] <= ahead[:, 0])[:, None], outline, ahead)
    right = np.where((outline[:, 0] <= ahead[:, 0])[:, None], ahead, outline)
    chain: list[np.ndarray] = []
    last = -1
    for low, high in pairwise(np.unique(outline[:, 0])):
        if high - low <= least:
            continue
        middle = 0.5 * (low + high)
        spans = np.flatnonzero((left[:, 0] < middle) & (middle < right[:, 0]))
        share = (middle - left[spans, 0]) / (right[spans, 0] - left[spans, 0])
        level = left[spans, 1] + share * (right[spans, 1] - left[spans, 1])
        edge = int(spans[np.argmin(level)])
        start, end = (_at(left[edge], right[edge], x, least) for x in (low, high))
        if edge == last:
            chain[-1] = end
            continue
        if not chain or np.abs(start - chain[-1]).max() > least:
            chain.append(start)
        chain.append(end)
        last = edge
    return np.array(chain)


def _at(left: np.ndarray, right: np.ndarray, x: float, least: float) -> np.ndarray:
    """The point of an edge at `x`: exactly one of its ends, or a point between them."""
    for end in (left, right):
        if abs(end[0] - x) <= least:
            return end
    share = (x - left[0]) / (right[0] - left[0])
    return np.array([x, left[1] + share * (right[1] - left[1])])


def swept_area(outline: np.ndarray, depth: np.ndarray) -> np.ndarray:
    """Area [m2] that a body going straight down has swept below its lowest starting level.

    Swept area stays swept: above its lower side the body counts as continuing straight up.

    Args:
        outline: (n, 2) with its lowest point at y = 0 [m].
        depth: displacement from first contact [m], any shape, at least 0.
    """
    chain = lower_chain(outline)
    total = np.zeros_like(depth, dtype=np.float64)
    for (x0, y0), (x1, y1) in pairwise(chain):
        low, high = min(y0, y1), max(y0, y1)
        wet = np.clip(depth, low, high) - low
        if high > low and x1 > x0:
            total += (x1 - x0) * wet**2 / (2 * (high - low))
        total += (x1 - x0) * np.maximum(depth - high, 0.0)
    return total
