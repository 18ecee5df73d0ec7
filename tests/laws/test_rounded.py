"""Rounded edges of bodies that slide and turn: distance and way out, against shapely."""

import functools

import numpy as np
import pytest
import shapely
import taichi as ti

from taichi_foam.laws.shape import edges
from taichi_foam.scene import Cylinder, FlatBlock, Impactor, IShape, Outline, Polygon, Wedge

CELL = 0.005
REACH = 0.4 * CELL
ARC = 1500  # vertices, which the reference draws an arc with

vec2 = ti.types.vector(2, ti.f64)
vec3 = ti.types.vector(3, ti.f64)
Table = ti.types.ndarray(dtype=ti.f64, ndim=2)

pytestmark = pytest.mark.usefixtures("taichi_runtime")

FREE = {"guided": False}
BODIES = {
    "box": FlatBlock(width=0.03, height=0.05, rotation_deg=17, **FREE),
    "wedge": Wedge(angle_deg=40, shank_width=0.03, height=0.08, **FREE),
    "chamfers": Polygon(
        vertices=((-0.02, 0), (0.02, 0), (0.025, 0.005), (0.025, 0.05), (-0.025, 0.05)), **FREE
    ),
    "i-shape": IShape(width=0.05, height=0.05, flange=0.006, web=0.01, rotation_deg=-25, **FREE),
    "notched": Outline(
        vertices=((0, 0), (0.012, 0.013), (0.03, -0.004), (0.032, 0.03), (0.013, 0.018), (0, 0.03)),
        **FREE,
    ),
}  # fmt: skip


@ti.kernel
def distances(rows: Table, points: Table, found: Table, surface: ti.template()):
    for row in range(rows.shape[0]):
        surface[0, row] = vec3(rows[row, 0], rows[row, 1], rows[row, 2])
    for n in range(points.shape[0]):
        one = edges.rounded_distance(surface, 0, rows.shape[0], vec2(points[n, 0], points[n, 1]))
        for c in ti.static(range(3)):
            found[n, c] = one[c]


@functools.cache
def surface_of_all() -> ti.MatrixField:
    """One with room for every body: kernels are compiled for a field."""
    return vec3.field(shape=(1, 64))


def at(body: Impactor, points: np.ndarray) -> np.ndarray:
    """Signed distance [m] and normal (n, 3) at points about the body's reference point."""
    rows, found = edges.surface_of(body, CELL, True), np.zeros((len(points), 3))
    distances(rows, points, found, surface_of_all())
    return found


def drawn(body: Impactor) -> shapely.Polygon:
    """Its outline with arcs of many vertices for edges, by circles that touch both faces."""
    outline, corners = body.outline(), []
    sizes = edges.radii(outline, REACH)
    for before, corner, after, radius in zip(
        np.roll(outline, 1, axis=0), outline, np.roll(outline, -1, axis=0), sizes, strict=True
    ):
        back, ahead = ((p - corner) / np.linalg.norm(p - corner) for p in (before, after))
        if radius == 0.0:
            corners.append(corner)
            continue
        half = 0.5 * np.arccos(back @ ahead)  # of the angle within
        middle = back + ahead
        centre = corner + middle / np.linalg.norm(middle) * radius / np.sin(half)
        start, end = (corner + side * radius / np.tan(half) - centre for side in (back, ahead))
        whole = np.pi - 2 * half
        for share in np.linspace(0.0, 1.0, ARC):
            lean = np.sin((1 - share) * whole), np.sin(share * whole)
            corners.append(centre + (lean[0] * start + lean[1] * end) / np.sin(whole))
    return shapely.Polygon(corners)


@pytest.mark.parametrize("name", BODIES)
def test_the_distance_is_that_of_the_rounded_outline(name: str) -> None:
    """Within it, beyond its arcs up to the sharp corners, and up to a cell outside."""
    body = BODIES[name]
    shape, sharp = drawn(body), shapely.Polygon(body.outline())
    low, high = np.array(sharp.bounds[:2]) - CELL, np.array(sharp.bounds[2:]) + CELL
    chance = np.random.default_rng(4)
    anywhere = low + (high - low) * chance.random((4000, 2))
    near = [corner + REACH * (chance.random((200, 2)) - 0.5) for corner in body.outline()]
    points = np.vstack([anywhere, *near])
    found = at(body, points)
    within = shapely.contains_xy(shape, *points.T)
    np.testing.assert_array_equal(found[:, 0] < 0, within)
    assert within.sum() > 1000
    assert (shapely.contains_xy(sharp, *points.T) & ~within).sum() > 20
    ways = shapely.shortest_line(shapely.points(points), shape.exterior)
    nearest = shapely.get_coordinates(ways).reshape(-1, 2, 2)[:, 1]
    away = np.linalg.norm(nearest - points, axis=1)
    np.testing.assert_allclose(np.abs(found[:, 0]), away, rtol=0, atol=1e-9)
    deep = away > 1e-6
    reached = points - found[:, :1] * found[:, 1:]
    np.testing.assert_allclose(reached[deep], nearest[deep], rtol=1e-7, atol=2e-6)


def test_the_force_is_the_gradient_of_the_squared_depth() -> None:
    """And continuous across the ends of an arc: all points in turn, a hair to each side."""
    body = BODIES["wedge"]
    points = np.random.default_rng(6).random((3000, 2)) * [0.02, 0.02] - [0.01, 0.0]
    hair = 1e-7
    here = at(body, points)
    ways = np.array([(1, 0), (-1, 0), (0, 1), (0, -1)])
    shifted = [at(body, points + hair * way) for way in ways]
    energy = [0.5 * np.minimum(each[:, 0], 0.0) ** 2 for each in shifted]
    slope = np.column_stack([energy[0] - energy[1], energy[2] - energy[3]]) / (2 * hair)
    force = np.minimum(here[:, :1], 0.0) * here[:, 1:]
    # not where two faces are as near, where the way out changes: there the depth has a ridge
    ridge = np.abs(points[:, 0]) < 2 * hair
    np.testing.assert_allclose(force[~ridge], slope[~ridge], atol=2 * hair)


def test_mirrored_bodies_find_mirrored_numbers_to_the_last_bit() -> None:
    points = np.random.default_rng(7).random((3000, 2)) * [0.03, 0.05] - [0.015, 0.0]
    one, other = at(BODIES["wedge"], points), at(BODIES["wedge"], points * [-1.0, 1.0])
    np.testing.assert_array_equal(one * [1.0, -1.0, 1.0], other)


def test_an_edge_takes_no_more_than_its_reach_and_leaves_half_of_each_face() -> None:
    sizes = {name: edges.radii(body.outline(), REACH) for name, body in BODIES.items()}
    np.testing.assert_allclose(sizes["box"], REACH, rtol=1e-12)
    tip = BODIES["wedge"].outline()[:, 1].argmin()
    assert sizes["wedge"][tip] == pytest.approx(REACH * np.tan(np.radians(20)), rel=1e-12)
    thin = IShape(width=0.05, height=0.05, flange=0.002, web=0.01, **FREE)
    corners = thin.outline()
    outer = np.isclose(np.abs(corners[:, 0]), 0.025)
    np.testing.assert_allclose(edges.radii(corners, REACH)[outer], 0.0005, rtol=1e-9)
    assert not edges.radii(corners, REACH)[~outer].any()


def test_only_cornered_bodies_without_rails_are_rounded() -> None:
    free, railed = FlatBlock(guided=False), FlatBlock()
    for outside in (False, True):
        assert edges.distance_of(free, outside) is edges.rounded_distance
    assert edges.distance_of(railed, False) is railed.distance
    assert edges.distance_of(railed, True) is edges.Edged.distance
    np.testing.assert_array_equal(edges.surface_of(railed, CELL, False), railed.surface())
    circle = Cylinder(guided=False)
    assert edges.distance_of(circle, True) is circle.distance
    np.testing.assert_array_equal(edges.surface_of(circle, CELL, True), circle.surface())
