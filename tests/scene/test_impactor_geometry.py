"""Outlines and swept volumes of the impactors, against Eqs 4-6 and an area by another way."""

import itertools
import math
from functools import partial

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial import ConvexHull

from taichi_foam.laws.shape import outline as geometry
from taichi_foam.scene import Cylinder, Ellipse, FlatBlock, IShape, Outline, Polygon, Wedge

Z = 0.057

# Taichi, once started, has its process flush subnormal numbers to zero.
floats = partial(st.floats, allow_subnormal=False)

lengths = floats(0.001, 0.5)
angles = floats(-180, 180)
depths = floats(0, 0.3)


@st.composite
def polygons(draw):
    """Convex polygons: points on an ellipse, in any order, turned by any angle."""
    count = draw(st.integers(3, 16))
    places = draw(st.lists(st.integers(0, 59), min_size=count, max_size=count, unique=True))
    a, b = draw(lengths), draw(lengths)
    corners = [(a * math.cos(k * math.pi / 30), b * math.sin(k * math.pi / 30)) for k in places]
    return Polygon(vertices=corners, rotation_deg=draw(angles))


wedges = st.builds(Wedge, angle_deg=floats(20, 170), shank_width=lengths, height=st.just(4.0))
flats = st.builds(FlatBlock, width=lengths, height=lengths, rotation_deg=angles)
cylinders = st.builds(Cylinder, radius=lengths)


def area_below(outline, depth):
    """Area below y = depth of a convex body and of the shaft that it leaves behind going down.

    The swept region is convex, so its part below a level is the hull of its corners there and
    of the points where lines between its corners cross that level.
    """
    shaft = np.array([0, 10 * (1 + np.ptp(outline[:, 1]))])
    tall = np.vstack([outline, outline + shaft])
    kept = list(tall[tall[:, 1] <= depth])
    for p, q in itertools.combinations(tall, 2):
        if (p[1] - depth) * (q[1] - depth) < 0:
            kept.append(p + (q - p) * (depth - p[1]) / (q[1] - p[1]))
    # QJ joggles flat sets of points instead of refusing them.
    return ConvexHull(np.array(kept), qhull_options="QJ").volume


@given(st.one_of(flats, wedges, polygons()), floats(0.02, 3))
def test_swept_volume_is_the_area_of_the_clipped_body(impactor, fraction):
    outline = impactor.outline()
    depth = fraction * np.ptp(outline[:, 1])
    expected = area_below(outline, depth)
    scale = depth * np.ptp(outline[:, 0])
    assert impactor.crushed_volume(depth, 1.0) == pytest.approx(expected, abs=1e-6 * scale)


@given(lengths, depths)
def test_flat_block_follows_eq_4(width, d):
    assert FlatBlock(width=width).crushed_volume(d, Z) == pytest.approx(d * width * Z)


@given(lengths, depths)
def test_cylinder_follows_eq_5(R, d):
    if d <= R:
        expected = (math.acos(1 - d / R) * R**2 - (R - d) * math.sqrt(2 * R * d - d**2)) * Z
    else:
        expected = math.pi * R**2 * Z / 2 + (d - R) * 2 * R * Z
    assert Cylinder(radius=R).crushed_volume(d, Z) == pytest.approx(expected, rel=1e-9, abs=1e-15)


@given(lengths, depths)
def test_right_angled_wedge_follows_eq_6(W, d):
    expected = d**2 * Z if d <= W / 2 else d * W * Z - W**2 * Z / 4
    wedge = Wedge(angle_deg=90, shank_width=W, height=4)
    assert wedge.crushed_volume(d, Z) == pytest.approx(expected, rel=1e-9, abs=1e-18)


@given(lengths, floats(0.01, 3))
def test_circle_sweeps_what_its_drawn_polygon_does_and_the_slivers(R, fraction):
    """The inscribed 64-gon lacks at most the slivers below half of it: (pi - 32 sin(pi/32)) / 2."""
    circle = Cylinder(radius=R)
    missing = circle.crushed_volume(fraction * R, 1.0) - area_below(circle.outline(), fraction * R)
    assert -1e-6 < missing / R**2 < (math.pi - 32 * math.sin(math.pi / 32)) / 2 + 1e-6


def test_crushed_volume_takes_arrays_and_counts_a_lift_off_as_nothing():
    wedge = Wedge()
    depth = np.array([[-0.01, 0.0], [0.01, 0.04]])
    volume = wedge.crushed_volume(depth, Z)
    assert volume.shape == depth.shape
    assert volume[0].tolist() == [0.0, 0.0]
    assert volume[1] == pytest.approx([0.01**2 * Z, (0.04 * 0.05 - 0.05**2 / 4) * Z])


@given(st.one_of(flats, wedges, cylinders, polygons()))
def test_outline_is_convex_counter_clockwise_and_stands_on_its_reference_point(impactor):
    outline = impactor.outline()
    size = np.ptp(outline, axis=0).max()
    assert outline[:, 1].min() == 0.0
    assert outline[:, 0].min() == pytest.approx(-outline[:, 0].max(), abs=1e-9 * size)
    edges = np.roll(outline, -1, axis=0) - outline
    ahead = np.roll(edges, -1, axis=0)
    assert np.all(edges[:, 0] * ahead[:, 1] - edges[:, 1] * ahead[:, 0] > -1e-9 * size**2)


@given(
    st.one_of(
        wedges,
        cylinders,
        st.builds(FlatBlock, width=lengths, height=lengths),
        st.builds(
            FlatBlock, width=lengths, height=lengths, rotation_deg=st.sampled_from([90, 180])
        ),
        lengths.map(lambda s: FlatBlock(width=s, height=s, rotation_deg=45)),
        lengths.map(lambda s: Polygon(vertices=((0, 0), (s, 0), (s, s), (0, s)), rotation_deg=-45)),
        st.builds(
            lambda w, h: Polygon(vertices=((0.1, 0.3), (0.1 + w, 0.3), (0.1 + w / 2, 0.3 + h))),
            lengths,
            lengths,
        ),
    )
)
def test_symmetric_outline_is_its_own_mirror_image_to_the_last_bit(impactor):
    outline = impactor.outline()
    assert {(x, y) for x, y in outline} == {(-x, y) for x, y in outline}


def test_asymmetric_outline_is_left_alone():
    """A 3-4-5 triangle has no mirror line: its corners come out as given, moved to the middle."""
    outline = Polygon(vertices=((0, 0), (0.4, 0), (0, 0.3))).outline()
    assert outline == pytest.approx(np.array([[-0.2, 0], [0.2, 0], [-0.2, 0.3]]), abs=1e-15)


@pytest.mark.parametrize(
    ("impactor", "nose", "width"),
    [
        (FlatBlock(), 0.0, 0.05),
        (FlatBlock(rotation_deg=180), 0.0, 0.05),
        (Cylinder(), 0.025, 0.05),
        (Wedge(), 0.025, 0.05),
        (Wedge(angle_deg=60, shank_width=0.04), 0.02 * math.sqrt(3), 0.04),
        # A unit square on its corner: half a diagonal deep, a diagonal wide.
        (Polygon(vertices=((0, 0), (1, 0), (1, 1), (0, 1)), rotation_deg=45), 0.5**0.5, 2**0.5),
        # Tilted by 30 degrees: its left and right corners lie at sin 30 and cos 30.
        (
            Polygon(vertices=((0, 0), (1, 0), (1, 1), (0, 1)), rotation_deg=30),
            math.cos(math.pi / 6),
            0.5 + math.cos(math.pi / 6),
        ),
    ],
)
def test_nose_depth_and_width(impactor, nose, width):
    assert impactor.nose_depth == pytest.approx(nose, abs=1e-12)
    assert impactor.extent == pytest.approx(width)


def test_flat_faces_have_no_nose_exactly():
    assert FlatBlock().nose_depth == 0.0
    assert Wedge().nose_depth == 0.025


@st.composite
def outlines(draw):
    """Star-shaped outlines with notches: corners at rising angles, at any distances."""
    count = draw(st.integers(3, 24))
    far = draw(st.lists(floats(0.01, 0.2), min_size=count, max_size=count))
    start = draw(floats(0, 6))
    turn = 2 * math.pi / count
    corners = [
        (0.3 + r * math.cos(start + k * turn), r * math.sin(start + k * turn))
        for k, r in enumerate(far)
    ]
    return Outline(vertices=corners[:: draw(st.sampled_from([1, -1]))], rotation_deg=draw(angles))


i_shapes = st.builds(
    IShape,
    width=floats(0.02, 0.2), height=floats(0.05, 0.2), flange=floats(0.001, 0.02),
    web=floats(0.001, 0.019), rotation_deg=angles,
)  # fmt: skip
ellipses = st.builds(Ellipse, width=lengths, height=lengths, rotation_deg=angles)


def swept_by(outline, depth):
    """Area that an outline sweeps below y = depth on its way down, by shapely's union."""
    tall = 3 * np.ptp(outline[:, 1])
    ring = shapely.Polygon(outline)
    edges = zip(outline, np.roll(outline, -1, axis=0), strict=True)
    up = np.array([0.0, tall])
    shafts = [shapely.Polygon([a, b, b + up, a + up]) for a, b in edges]
    whole = shapely.union_all([ring, *(each.buffer(0) for each in shafts)])
    x = outline[:, 0]
    return whole.intersection(shapely.box(x.min(), -1, x.max(), depth)).area


@given(st.one_of(outlines(), i_shapes), floats(0.02, 0.95))
def test_swept_volume_of_outlines_with_notches(impactor, fraction):
    outline = impactor.outline()
    depth = fraction * np.ptp(outline[:, 1])
    scale = depth * np.ptp(outline[:, 0])
    expected = swept_by(outline, depth)
    assert impactor.crushed_volume(depth, 1.0) == pytest.approx(expected, abs=1e-6 * scale)


def test_nose_of_an_i_shape_on_its_side_is_behind_the_overhang():
    """Its flanges stand on their edges; full width is in when the web is, 30 mm up."""
    lying = IShape(width=0.08, height=0.1, web=0.02, flange=0.02, rotation_deg=90)
    assert lying.nose_depth == pytest.approx(0.03)
    assert lying.crushed_volume(0.04, 1.0) == pytest.approx(0.04 * 0.04 + 0.06 * 0.01)
    assert IShape().nose_depth == 0.0


@given(st.one_of(outlines(), i_shapes, polygons(), flats, wedges))
def test_centroid_and_gyration_are_those_of_a_plate(impactor):
    """Against shapely's, and a signed sum over triangles, each with the moment of its corners."""
    outline = impactor.outline()
    plate = shapely.Polygon(outline)
    triangles = [np.array([outline[0], *pair]) for pair in itertools.pairwise(outline[1:])]
    centre = np.array([plate.centroid.x, plate.centroid.y])
    size = geometry.size(impactor.outline())
    np.testing.assert_allclose(impactor.centre_of_mass, centre, rtol=0, atol=1e-9 * size)
    moment = 0.0
    for triangle in triangles:
        corners = triangle - centre
        middle = corners.mean(axis=0)
        own = ((corners - middle) ** 2).sum() / 12
        moment += geometry.area(corners) * (middle @ middle + own)
    assert impactor.squared_gyration == pytest.approx(moment / plate.area, rel=1e-6)


@given(ellipses)
def test_a_drawn_ellipse_is_the_ellipse_but_for_slivers(ellipse):
    """128 corners lack 1 - sin(2 pi / 128) / (2 pi / 128) of the area, 4e-4, and so do moments."""
    outline = ellipse.outline()
    assert geometry.area(outline) == pytest.approx(
        math.pi / 4 * ellipse.width * ellipse.height, rel=5e-4
    )
    assert geometry.squared_gyration(outline) == pytest.approx(ellipse.squared_gyration, rel=1e-3)
    half, height = ellipse.box
    assert np.abs(outline[:, 0]).max() == pytest.approx(half, rel=1e-3)
    assert np.ptp(outline[:, 1]) == pytest.approx(height, rel=1e-3)
    np.testing.assert_allclose(ellipse.centre_of_mass, [0, height / 2], atol=1e-9)


def test_a_disc_has_half_its_squared_radius():
    assert Cylinder(radius=0.03, mass=2.0).moment_of_inertia == pytest.approx(9e-4)


@given(
    st.sampled_from(
        [
            lambda **given: FlatBlock(width=0.04, height=0.1, **given),
            lambda **given: Ellipse(width=0.04, height=0.1, **given),
            lambda **given: Cylinder(radius=0.05, **given),
        ]
    ),
    angles,
)
def test_a_centre_of_mass_turns_with_its_shape(build, degrees):
    """Given about mid-width and lowest level before the turn; 50 mm up is the middle of all."""
    given = build(guided=False, rotation_deg=degrees, centre=(0.0, 0.05)).centre_of_mass
    own = build(guided=False, rotation_deg=degrees).centre_of_mass
    np.testing.assert_allclose(given, own, rtol=0, atol=2e-4)  # polygons' slivers
    beside = build(guided=False, rotation_deg=degrees, centre=(0.01, 0.05)).centre_of_mass
    turn = math.radians(degrees)
    expected = [0.01 * math.cos(turn), 0.01 * math.sin(turn)]
    np.testing.assert_allclose(beside - given, expected, rtol=0, atol=1e-12)


def test_a_centre_of_mass_of_an_outline_is_in_the_frame_of_its_corners():
    """A square about (1, 1): its corner, given, is its lowest point after a turn by 45 degrees."""
    square = Outline(
        vertices=((1, 1), (1.1, 1), (1.1, 1.1), (1, 1.1)), guided=False, rotation_deg=45,
        centre=(1, 1),
    )  # fmt: skip
    np.testing.assert_allclose(square.centre_of_mass, [0, 0], atol=1e-12)


@given(outlines(), angles)
def test_turned_the_other_way_an_outline_is_the_mirror_image_to_the_last_bit(outline, degrees):
    corners = [(x - 0.3, y) for x, y in outline.vertices]
    one = Outline(vertices=corners, rotation_deg=degrees)
    other = Outline(vertices=[(-x, y) for x, y in corners], rotation_deg=-degrees)
    assert {(x, y) for x, y in one.outline()} == {(-x, y) for x, y in other.outline()}
