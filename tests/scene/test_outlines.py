"""Outlines and holes of blocks: what of them is in which cell, and which are refused."""

from __future__ import annotations

import math
from typing import Any, Literal

import numpy as np
import pytest
import shapely
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from taichi_foam.errors import UserError
from taichi_foam.scene import Block, FlatBlock, Scene, outlines
from taichi_foam.scene.block import Layer
from taichi_foam.scene.files import scene_from_text, scene_to_toml
from taichi_foam.scene.filling import Filling, _cut, filling, in_cells, thin_parts

ARRAYS = ("mass", "face_a", "face_b", "reach", "share", "cell", "on_base", "owner")
DROP = {"impactor": {"shape": "flat", "velocity": 3.0, "width": 0.05}}
PAD = [[-0.05, 0.0], [0.05, 0.0], [0.03, 0.05], [-0.03, 0.05]]
SIZE = {"width": 0.1, "height": 0.05, "columns": 20, "rows": 10, "mass_points": "cells"}


def circle(x: float, y: float, radius: float, corners: int = 24) -> list[tuple[float, float]]:
    turn = 2 * math.pi / corners
    return [(x + radius * math.cos(k * turn), y + radius * math.sin(k * turn))
            for k in range(corners)]  # fmt: skip


def total(block: Block) -> float:
    """Mass of the foam [kg], from its area alone."""
    area = shapely.Polygon(block.corners, block.holes).area
    return block.density * area * block.depth


def bonds_of(filled: Filling) -> tuple[np.ndarray, np.ndarray]:
    """Whether both ends of bonds A and B have a mass point."""
    there = filled.there
    return there[:-1] & there[1:], there[:, :-1] & there[:, 1:]


# --- the plain block ------------------------------------------------------------------------------


@given(
    st.floats(0.05, 0.3), st.floats(0.02, 0.2), st.integers(2, 30), st.integers(2, 30),
    st.integers(0, 3), st.booleans(), st.sampled_from(["cells", "faces"]), st.floats(0.2, 0.8),
)  # fmt: skip
def test_a_rectangle_that_is_drawn_is_the_plain_block(
    width: float, height: float, columns: int, rows: int, first: int, clockwise: bool,
    mass_points: Literal["cells", "faces"], top: float,
) -> None:  # fmt: skip
    plain = Block(
        width=width, height=height, columns=columns, rows=rows, mass_points=mass_points
    )  # fmt: skip
    corners = np.roll(plain.corners, first, axis=0)[:: -1 if clockwise else 1]
    drawn = plain.model_copy(update={"outline": tuple(map(tuple, corners.tolist()))})
    for name in ARRAYS:
        np.testing.assert_array_equal(getattr(filling(drawn), name), getattr(filling(plain), name))
    # filled by cutting cells, as any other outline, it differs in the reach near its sides alone
    cut = _cut(plain, in_cells(plain))
    for name in (each for each in ARRAYS if each not in ("reach", "owner")):
        np.testing.assert_array_equal(getattr(cut, name), getattr(filling(plain), name))
    beside = (np.minimum(np.arange(columns), np.arange(columns)[::-1]) + 0.5) * plain.dx
    inner = beside > 0.5 * max(plain.dx, plain.dy)
    np.testing.assert_array_equal(cut.reach[inner], filling(plain).reach[inner])
    np.testing.assert_array_equal(cut.area, filling(plain).area)
    if rows >= 10:  # a layer that ends within a row of cells: equal but for rounding
        layers = {"layers": (Layer(bottom=0.0, top=top * height, density=80.0),)}
        layered = plain.model_copy(update=layers)
        of_both = [_cut(layered, in_cells(layered)).mass, filling(layered).mass]
        # areas that are cut are rounded, both parts of the row's cells by half of this each
        rounded = 10.0**-outlines.ROUNDING * of_both[1].max()
        np.testing.assert_allclose(*of_both, rtol=1e-15, atol=rounded)


def test_what_a_plain_block_is() -> None:
    block = Block(width=0.2, height=0.06, columns=40, rows=10, mass_points="cells")
    filled = filling(block)
    assert (filled.mass == block.node_mass).all()
    assert (filled.face_a == 1).all()
    assert (filled.face_b == 1).all()
    assert (filled.on_base == (np.arange(10) == 0)).all()
    # from the mass point to the bottom or the top; inside half of a cell of the same area
    assert (filled.reach[:, [0, -1]] == 0.5 * block.dy).all()
    assert (filled.reach[:, 1:-1] == 0.5 * math.sqrt(block.dx * block.dy)).all()


# --- mass -----------------------------------------------------------------------------------------


@st.composite
def stars(draw: st.DrawFn) -> Block:
    """Blocks with outlines of any number of corners around a middle, some with a round hole."""
    count = draw(st.integers(3, 12))
    middle = np.array([draw(st.floats(-0.01, 0.01)), 0.1])
    steps = np.array(draw(st.lists(st.floats(0.2, 1.0), min_size=count, max_size=count)))
    angles = np.cumsum(steps) / steps.sum() * 2 * math.pi
    radii = np.array(draw(st.lists(st.floats(0.02, 0.08), min_size=count, max_size=count)))
    points = middle + radii[:, None] * np.column_stack([np.cos(angles), np.sin(angles)])
    points[:, 1] -= points[:, 1].min()
    assume(shapely.Polygon(points).is_valid)
    assume(shapely.Polygon(points).area > 1e-4)
    sides = draw(st.integers(3, 40))
    angle = draw(st.one_of(st.just(0.0), st.floats(-90, 90)))
    holes = []
    if draw(st.booleans()):
        inner = shapely.Polygon(points).buffer(-0.006)
        assume(not inner.is_empty)
        place = inner.representative_point()
        holes = [circle(place.x, place.y, 0.005)]
    return Block(
        width=0.4, height=0.4, columns=2 * sides, rows=2 * sides + draw(st.integers(0, 5)),
        outline=[tuple(point) for point in points.tolist()], holes=holes, lattice_angle_deg=angle,
    )  # fmt: skip


@settings(max_examples=60)
@given(stars())
def test_no_mass_is_lost(block: Block) -> None:
    filled = filling(block)
    assume(filled.there.any())
    assert filled.mass.sum() == pytest.approx(total(block), rel=1e-9)
    assert filled.share.sum() * block.dx * block.dy * block.depth * block.density == (
        pytest.approx(total(block), rel=1e-9)
    )


@settings(max_examples=60)
@given(stars())
def test_bonds_join_mass_points_through_foam(block: Block) -> None:
    filled = filling(block)
    for face, both in zip((filled.face_a, filled.face_b), bonds_of(filled), strict=True):
        assert not face[~both].any()
        assert (face >= 0).all()
    # a whole cell beside a whole cell has a whole face between
    full = filled.share >= 1
    assert (filled.face_a[full[:-1] & full[1:]] >= 1).all()
    assert (filled.face_b[full[:, :-1] & full[:, 1:]] >= 1).all()


@pytest.mark.parametrize("cut", [0.0, 0.1, 0.2, 0.3, 0.5, 0.8])
def test_a_level_cut_through_cells(cut: float) -> None:
    """A pad that ends within a row of cells: faces and masses of the row by hand."""
    dy, rows = 0.005, 10
    top = (rows - 1 + cut) * dy
    outline = [(-0.05, 0.0), (0.05, 0.0), (0.05, top), (-0.05, top)]
    block = Block(width=0.1, height=0.1, columns=20, rows=20, mass_points="cells", outline=outline)
    filled = filling(block)
    line = filled.mass[5][filled.there[5]] / block.node_mass
    if cut == 0:
        assert line == pytest.approx(np.ones(rows - 1))
    elif cut < 0.25:  # these have gone to the row below
        assert line[-1] == pytest.approx(1 + cut)
    else:
        assert line[-1] == pytest.approx(cut)
    last = len(line) - 1
    assert filled.mass.sum() == pytest.approx(total(block), rel=1e-12)
    assert filled.face_a[5, last] == pytest.approx(line[-1])
    assert filled.face_b[5, last - 1] == 1
    assert filled.reach[5, last] == pytest.approx(top - (last + 0.5) * dy)


def test_a_slope_by_hand() -> None:
    """A triangle of two by two cells: the slanted ones are half full, their faces half or whole."""
    block = Block(
        width=0.02, height=0.02, columns=2, rows=2, mass_points="cells",
        outline=[(-0.01, 0), (0.01, 0), (-0.01, 0.02)],
    )  # fmt: skip
    filled = filling(block)
    np.testing.assert_allclose(filled.mass / block.node_mass, [[1.0, 0.5], [0.5, 0.0]])
    np.testing.assert_allclose(filled.face_a, [[1.0, 0.0]])
    np.testing.assert_allclose(filled.face_b, [[1.0], [0.0]])
    np.testing.assert_array_equal(filled.there, [[True, True], [True, False]])
    # the slanted side runs through the middles of the cells that it halves
    np.testing.assert_allclose(filled.reach[[0, 1], [1, 0]], 0.0, atol=1e-12)


def test_what_is_symmetric_is_so_to_the_last_bit() -> None:
    hole = [(0.1 + x, y) for x, y in circle(0.0, 0.03, 0.01)]
    mirrored = [(-x, y) for x, y in hole]
    outline = [(-0.15, 0.0), (0.15, 0.0), (0.1234, 0.0567), (-0.1234, 0.0567)]
    block = Block(
        width=0.3, height=0.06, columns=60, rows=12, outline=outline, holes=[hole, mirrored]
    )
    filled = filling(block)
    for name in ("mass", "face_a", "face_b", "share", "on_base", "reach"):
        found = getattr(filled, name)
        np.testing.assert_array_equal(found, found[::-1], err_msg=name)


def test_the_base_is_where_the_outline_lies_on_it() -> None:
    """Ribs stand on the base, what is between them does not; so on a turned lattice, too."""
    ribs = [(-0.06, 0), (-0.03, 0), (-0.03, 0.012), (0.03, 0.012), (0.03, 0), (0.06, 0),
            (0.06, 0.06), (-0.06, 0.06)]  # fmt: skip
    block = Block(width=0.12, height=0.06, columns=24, rows=12, outline=ribs)
    expected = np.zeros((24, 12), dtype=bool)
    expected[:6, 0] = expected[-6:, 0] = True
    np.testing.assert_array_equal(filling(block).on_base, expected)
    turned = Block(width=0.15, height=0.15, columns=30, rows=30, outline=ribs, lattice_angle_deg=30)
    x, y = turned.positions[filling(turned).on_base].T
    assert (np.abs(x) > 0.03 - turned.dx).all()
    assert (y < turned.dy).all()
    assert len(x) >= 10


def test_a_turned_lattice_lies_under_the_same_pad() -> None:
    block = Block(width=0.13, height=0.12, columns=26, rows=24, outline=PAD, lattice_angle_deg=37)
    points, filled = block.positions, filling(block)
    pad = shapely.Polygon(PAD).buffer(max(block.dx, block.dy))
    assert shapely.covers(pad, shapely.points(points[filled.there])).all()
    steps = np.linalg.norm(np.diff(points, axis=0), axis=-1)
    np.testing.assert_allclose(steps, block.dx)
    np.testing.assert_allclose(block.on_lattice(points)[3, 2], Block(
        width=0.13, height=0.12, columns=26, rows=24).positions[3, 2])  # fmt: skip


# --- scenes ---------------------------------------------------------------------------------------


def refusal(**block: Any) -> str:
    with pytest.raises(UserError) as caught:
        Scene.checked({"block": {**SIZE, **block}, **DROP}, "scene")
    return str(caught.value)


HOLE = circle(0.0, 0.025, 0.008)
NARROW = [(-0.05, 0), (0.05, 0), (0.05, 0.02), (0.001, 0.02), (0.001, 0.03), (0.05, 0.03),
          (0.05, 0.05), (-0.05, 0.05), (-0.05, 0.03), (-0.0002, 0.03), (-0.0002, 0.02),
          (-0.05, 0.02)]  # fmt: skip

RIB = [(-0.05, 0), (0.05, 0), (0.05, 0.02), (0.0005, 0.02), (0.0005, 0.05), (-0.0005, 0.05),
       (-0.0005, 0.02), (-0.05, 0.02)]  # fmt: skip


@pytest.mark.parametrize(
    ("block", "told"),
    [
        ({"outline": PAD[:2]}, "block.outline: 2 corners; at least 3"),
        ({"outline": [*PAD, PAD[0]]}, "block.outline[4] = [-0.05, 0.0]: repeats an earlier"),
        ({"outline": [PAD[0], PAD[2], PAD[1], PAD[3]]}, "block.outline: crosses or touches itself"),
        ({"outline": [[0, 0], [0.01, 0], [0.02, 0]]}, "block.outline: encloses no area"),
        ({"outline": [[-0.06, 0], [0.05, 0], [0, 0.05]]}, "must be within x = -0.05 to 0.05 m"),
        ({"outline": [[-0.05, 0], [0.05, 0], [0, 0.06]]}, "enlarge block.width and block.height"),
        ({"outline": [[-0.05, 0.01], [0.05, 0.01], [0, 0.05]]}, "y = 0.01 m; it must be at 0"),
        ({"outline": [[0, 0], [0.05, 0.05], [-0.05, 0.05]]}, "base.kind = 'gripped'"),
        ({"outline": 3}, "block.outline = 3: must be a list of 3 to 2,000 corners"),
        ({"outline": [[0, "a"]]}, "must be"),
        ({"outline": [[0, 0, 0]]}, "must be"),
        ({"outline": PAD, "holes": [circle(0.05, 0.025, 0.01)]}, "holes[0]: is not inside"),
        ({"holes": [circle(0.0, 0.025, 0.025)]}, "block.holes[0]: is not inside the outline"),
        ({"holes": [HOLE, circle(0.01, 0.025, 0.008)]}, "block.holes[1]: crosses or touches"),
        ({"holes": [HOLE, circle(0.0, 0.025, 0.004)]}, "block.holes[1]: crosses or touches"),
        ({"holes": [[[0, 0.01], [0.01, 0.01]]]}, "block.holes[0]"),
        ({"outline": NARROW}, "the lattice falls into 2 parts"),
        ({"outline": RIB}, "thinner than a quarter of a cell"),
        ({"outline": PAD, "lattice_angle_deg": 30}, "needs at least block.width = 0.1116 m and"),
        ({"lattice_angle_deg": 91}, "block.lattice_angle_deg = 91: must be"),
    ],
)  # fmt: skip
def test_outlines_that_cannot_be_are_refused(block: dict[str, Any], told: str) -> None:
    message = refusal(**block)
    assert told in message
    assert "Traceback" not in message


def test_thin_foam_is_told() -> None:
    rib = [(-0.05, 0), (0.05, 0), (0.05, 0.02), (0.004, 0.02), (0.004, 0.05), (-0.004, 0.05),
           (-0.004, 0.02), (-0.05, 0.02)]  # fmt: skip
    place = thin_parts(Block(**SIZE, outline=rib))  # 8 mm in cells of 5 mm
    assert abs(place[0]) < 0.004
    assert 0.02 < place[1] < 0.05
    fine = {"width": 0.1, "height": 0.05, "columns": 60, "rows": 30}
    assert thin_parts(Block(**fine, outline=rib)) is None
    assert thin_parts(Block(**SIZE, outline=PAD)) is None
    assert thin_parts(Block(**SIZE, holes=[HOLE])) is None


def test_it_is_written_and_read_back() -> None:
    scene = Scene(
        block=Block(**SIZE, outline=PAD, holes=[circle(0.0, 0.025, 0.01)]),
        impactor=FlatBlock(width=0.05, velocity=3.0),
    )
    assert scene_from_text(scene_to_toml(scene), "copy") == scene
    moved = scene.with_values({"block.outline[2]": [0.04, 0.05]})
    assert moved.block.outline[2] == (0.04, 0.05)
    assert moved.with_values({"block.outline": [], "block.holes": []}).block == Block(**SIZE)


def test_the_impactor_starts_at_the_highest_foam_under_it() -> None:
    """At the outline: beside a wall, not above it."""
    corner = [(-0.05, 0), (0.05, 0), (0.05, 0.02), (-0.02, 0.02), (-0.02, 0.05), (-0.05, 0.05)]
    block = Block(**SIZE, outline=corner)
    low = Scene(block=block, impactor=FlatBlock(width=0.05, x=0.015, velocity=3.0))
    assert low.contact_height == pytest.approx(0.02)
    wide = Scene(block=block, impactor=FlatBlock(width=0.1, velocity=3.0))
    assert wide.contact_height == pytest.approx(0.05)
    with pytest.raises(ValueError, match="never touches the block"):
        Scene(block=block, impactor=FlatBlock(width=0.05, x=0.2, velocity=3.0))
