"""Plane geometry of impactors: convex outlines, their symmetry, and the volume that they crush.

An outline is an array (n, 2) of vertices [m], counter-clockwise with y upwards.
"""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np

TOLERANCE = 1e-9
"""Length below which two vertices are the same point, as a fraction of the outline's size."""


def size(points: np.ndarray) -> float:
    """Larger side of the bounding box [m]."""
    return float(np.max(np.ptp(points, axis=0)))


def convex_hull(points: np.ndarray) -> np.ndarray:
    """Return the corners of the convex hull, counter-clockwise; points on an edge are no corners.

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
    """Twice the signed area of a triangle [m2]: above zero for a left turn."""
    return float((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]))


def distance_inside(hull: np.ndarray, point: np.ndarray) -> float:
    """Distance of a point from the nearest edge of a hull [m], positive inside."""
    edges = np.roll(hull, -1, axis=0) - hull
    away = point - hull
    return float(np.min((edges[:, 0] * away[:, 1] - edges[:, 1] * away[:, 0]) / np.hypot(*edges.T)))


def rotated(points: np.ndarray, degrees: float) -> np.ndarray:
    """Return the points turned counter-clockwise about the origin; quarter turns are exact."""
    quarter, rest = divmod(degrees, 90.0)
    cosine, sine = math.cos(math.radians(rest)), math.sin(math.radians(rest))
    for _ in range(int(quarter) % 4):
        cosine, sine = -sine, cosine
    x, y = points[:, 0], points[:, 1]
    return np.column_stack([cosine * x - sine * y, sine * x + cosine * y])


def placed(points: np.ndarray) -> np.ndarray:
    """Return the outline with its mid-width at x = 0, its lowest point at y = 0, and mirrored.

    An outline that is its own mirror image but for rounding is made so to the last bit, so that
    a symmetric impact stays symmetric to the last bit too.
    """
    low, high = points.min(axis=0), points.max(axis=0)
    result = points - np.array([(low[0] + high[0]) / 2, low[1]])
    least = TOLERANCE * size(points)
    result[np.abs(result[:, 1]) < least, 1] = 0.0
    mirror_image = result * np.array([-1.0, 1.0])
    gaps = np.linalg.norm(result[:, None, :] - mirror_image[None, :, :], axis=2)
    partner = np.argmin(gaps, axis=1)
    if np.max(np.min(gaps, axis=1)) > least:
        return result
    x, y = result[:, 0], result[:, 1]
    return np.column_stack([(x - x[partner]) / 2, (y + y[partner]) / 2])


def lower_chain(outline: np.ndarray) -> np.ndarray:
    """Return the part of a convex outline that faces down, (k, 2), from left end to right end."""
    least = TOLERANCE * size(outline)
    x, y = outline[:, 0], outline[:, 1]

    def lowest_at(edge: float) -> int:
        at_edge = np.abs(x - edge) <= least
        return int(np.argmin(np.where(at_edge, y, np.inf)))

    first, last = lowest_at(x.min()), lowest_at(x.max())
    return np.roll(outline, -first, axis=0)[: (last - first) % len(outline) + 1]


def swept_area(outline: np.ndarray, depth: np.ndarray) -> np.ndarray:
    """Area [m2] that a convex body going straight down has swept below its lowest starting level.

    Above the depth where its full width is in, the body counts as continuing straight up.

    Args:
        outline: (n, 2) with its lowest point at y = 0 [m].
        depth: displacement from first contact [m], any shape, at least 0.
    """
    chain = lower_chain(outline)
    total = np.zeros_like(depth, dtype=np.float64)
    for (x0, y0), (x1, y1) in pairwise(chain):
        low, high = min(y0, y1), max(y0, y1)
        wet = np.clip(depth, low, high) - low
        if high > low:
            total += (x1 - x0) * wet**2 / (2 * (high - low))
        total += (x1 - x0) * np.maximum(depth - high, 0.0)
    return total
