"""Contact with any simple polygon, convex or not, by its edges."""

import numpy as np

from taichi_foam.backend import ti
from taichi_foam.laws.shape import outline as geometry
from taichi_foam.laws.shape.base import Impactor, vec3

vec2 = ti.types.vector(2, ti.f64)


class Edged(Impactor):
    """What impactors share whose outline may have notches: the surface is their edges."""

    def surface(self) -> np.ndarray:
        """Return the rows of its edges, see `edges_of`."""
        return edges_of(self.outline())

    @staticmethod
    @ti.func
    def distance(surface: ti.template(), b, rows, point):
        """Signed distance [m] to the nearest point of the outline, and the normal there.

        Where a corner is nearest, the sum of its edges' normals tells inside from outside
        (Baerentzen & Aanaes 2005, IEEE TVCG 11:243). An edge is met from its middle, so that the
        mirror image finds the same numbers.
        """
        nearest = ti.math.inf  # squared
        found_edge, found_end = 0, 0  # -1, 0, 1: start, between, end
        for edge in range(rows // 2):
            start, normal = surface[b, 2 * edge], surface[b, 2 * edge + 1].xy
            end = surface[b, (2 * edge + 2) % rows]
            away = point - 0.5 * (start.xy + end.xy)
            along = normal.x * away.y - normal.y * away.x
            height = normal.dot(away)
            squared, which = height * height, 0
            if along > start.z:
                which = 1
                squared = (point - end.xy).norm_sqr()
            elif along < -start.z:
                which = -1
                squared = (point - start.xy).norm_sqr()
            if squared < nearest:
                nearest, found_edge, found_end = squared, edge, which
        start, normal = surface[b, 2 * found_edge], surface[b, 2 * found_edge + 1].xy
        end = surface[b, (2 * found_edge + 2) % rows]
        distance = normal.dot(point - 0.5 * (start.xy + end.xy))
        if found_end != 0:
            corner = ti.select(found_end > 0, end.xy, start.xy)
            beyond = (2 * (found_edge + found_end) + rows) % rows
            both = normal + surface[b, beyond + 1].xy
            away = point - corner
            side = ti.select(both.dot(away) < 0.0, -1.0, 1.0)
            length = away.norm()
            distance = side * length
            normal = both.normalized()
            if length > 0.0:
                normal = side * away / length
        return vec3(distance, normal.x, normal.y)


def edges_of(outline: np.ndarray) -> np.ndarray:
    """Return two rows for each edge: its start (x, y) and half its length; its normal [m].

    Args:
        outline: (n, 2), counter-clockwise [m].
    """
    along = np.roll(outline, -1, axis=0) - outline
    length = np.hypot(along[:, 0], along[:, 1])
    rows = np.zeros((2 * len(outline), 3))
    rows[0::2] = np.column_stack([outline, 0.5 * length])
    rows[1::2, :2] = np.stack([along[:, 1], -along[:, 0]], axis=1) / length[:, None]
    return rows


def counter_clockwise(points: np.ndarray) -> np.ndarray:
    """Return the corners the other way round if they go clockwise."""
    return points if geometry.area(points) > 0 else points[::-1]
