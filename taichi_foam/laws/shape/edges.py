"""Contact with any simple polygon, convex or not, by its edges.

For contact, the corners of a body that slides and turns are rounded: the next mass point in front
of a sharp one would touch the body's side, and be pushed along instead of passing under it
(docs/model.md, Contact). The depth in the rounded outline is the potential of the force.
"""

from collections.abc import Callable
from typing import Any

import numpy as np

from taichi_foam.backend import ti
from taichi_foam.laws.shape import outline as geometry
from taichi_foam.laws.shape.base import Impactor, vec3

EDGE_RADIUS = 0.4
"""Radius of a rounded corner over a cell's shorter side. It is less than half: if the corner is in
the middle between two mass points, as for a face of a whole number of cells, the last mass point
under the face touches its flat part."""

MOST_OF_FACE = 0.25
"""Largest fraction of a face that the arc at either end may take, so that half of it stays flat."""

STRAIGHT = 0.01
"""A corner with a smaller turning angle [rad] needs no rounding."""

vec2 = ti.types.vector(2, ti.f64)
vec4 = ti.types.vector(4, ti.f64)


class Edged(Impactor):
    """Base of impactors whose outline may be non-convex: the surface consists of their edges."""

    def surface(self) -> np.ndarray:
        """Return the rows of its edges, see `edges_of`."""
        return edges_of(self.outline())

    @staticmethod
    @ti.func
    def distance(surface: ti.template(), b, rows, point):
        """Signed distance [m] to the nearest point of the outline, and the normal there."""
        return Edged.nearest(surface, b, rows, point)[:3]

    @staticmethod
    @ti.func
    def nearest(surface: ti.template(), b, rows, point):
        """The numbers of `distance`, and that of the nearest edge.

        Where a corner is nearest, the sum of its edges' normals tells inside from outside
        (Baerentzen & Aanaes 2005, IEEE TVCG 11:243). Positions along an edge are relative to its
        middle, and a point that is as near to a second edge has the mean of both normals (see
        `Impactor.distance`), so that the mirror image gives the same numbers.
        """
        nearest = ti.math.inf  # squared
        found_edge, found_end = 0, 0  # -1, 0, 1: start, between, end
        second = -1  # the edge that is as near
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
                nearest, found_edge, found_end, second = squared, edge, which, -1
            elif squared == nearest and which == 0:
                second = edge
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
        elif second >= 0:
            normal = 0.5 * (normal + surface[b, 2 * second + 1].xy)
        return vec4(distance, normal.x, normal.y, found_edge)


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
    """Return the corners in counter-clockwise order."""
    return points if geometry.area(points) > 0 else points[::-1]


def distance_of(impactor: Impactor, outside: bool) -> Callable[..., Any]:
    """The function for the distance from an impactor; see `Impactor.distance`.

    `outside`: points outside the outline, too, get the distance to the nearest point of it.
    """
    if _is_rounded(impactor):
        return rounded_distance
    return Edged.distance if outside and _has_faces(impactor) else impactor.distance


def surface_of(impactor: Impactor, cell: float, outside: bool) -> np.ndarray:
    """Rows (n, 3) that `distance_of` reads; `cell` is the shorter side of a lattice cell [m]."""
    if not _is_rounded(impactor):
        by_edges = outside and _has_faces(impactor)
        return edges_of(impactor.outline()) if by_edges else impactor.surface()
    outline = impactor.outline()
    rows = edges_of(outline)
    rows[1::2, 2] = radii(outline, EDGE_RADIUS * cell)
    return rows


def _has_faces(impactor: Impactor) -> bool:
    """Whether its distance follows from the straight faces of its outline."""
    return impactor.distance in (Impactor.distance, Edged.distance) and not impactor.is_circle


def _is_rounded(impactor: Impactor) -> bool:
    """Whether a body slides and turns, and its distance follows from its corners."""
    return _has_faces(impactor) and not impactor.guided


def radii(outline: np.ndarray, reach: float) -> np.ndarray:
    """Radius of each corner of an outline (n,) [m]; 0 if it is re-entrant or nearly straight.

    The radius is `reach`, or less if the corner is sharper than a right angle or a face is short:
    the arc begins at most `reach` from the corner, and leaves half of each face flat.

    Args:
        outline: (n, 2), counter-clockwise [m].
        reach: largest radius [m].
    """
    ahead = np.roll(outline, -1, axis=0) - outline
    behind = np.roll(ahead, 1, axis=0)
    lengths = np.hypot(*ahead.T), np.hypot(*behind.T)
    cross = behind[:, 0] * ahead[:, 1] - behind[:, 1] * ahead[:, 0]
    turn = np.arctan2(cross, (behind * ahead).sum(axis=1))
    half = np.tan(0.5 * np.clip(turn, STRAIGHT, None))  # length that the arc takes, per radius
    taken = np.minimum(reach, MOST_OF_FACE * np.minimum(*lengths))
    return np.where(turn > STRAIGHT, np.minimum(reach, taken / half), 0.0)


@ti.func
def rounded_distance(surface: ti.template(), b, rows, point):
    """Signed distance [m] to an outline whose corners are rounded, and the normal there.

    The rows are those of `edges_of`; the second row of each edge contains the radius R of the
    corner at its start. In the sector between an arc's ends and its centre, the arc is the surface.
    Let q be the point relative to the centre. Its component along an edge's normal n is R minus the
    point's depth below that edge. With the components a and b along the normals n_1 and n_2 of both
    edges, and c the cosine between the normals, q = ((a - b c) n_1 + (b - a c) n_2) / (1 - c^2),
    which treats both edges alike.
    """
    nearest = Edged.nearest(surface, b, rows, point)
    found = nearest[:3]
    for end in range(2):  # the corners of the nearest edge
        edge = (ti.cast(nearest[3], ti.i32) + end) % (rows // 2)
        radius = surface[b, 2 * edge + 1].z
        if radius > 0.0:
            before = (2 * edge - 2 + rows) % rows
            one, two = surface[b, before + 1].xy, surface[b, 2 * edge + 1].xy
            start, corner = surface[b, before].xy, surface[b, 2 * edge].xy
            last = surface[b, (2 * edge + 2) % rows].xy
            cosine = one.dot(two)
            along_one = radius + one.dot(point - 0.5 * (start + corner))
            along_two = radius + two.dot(point - 0.5 * (corner + last))
            share_one = along_one - along_two * cosine
            share_two = along_two - along_one * cosine
            if share_one > 0.0 and share_two > 0.0:
                squared_sine = 1.0 - cosine * cosine
                squared = (along_one * share_one + along_two * share_two) / squared_sine
                away = ti.sqrt(squared)
                if away - radius > found[0]:
                    normal = (share_one * one + share_two * two) / (squared_sine * away)
                    found = vec3(away - radius, normal.x, normal.y)
    return found
