"""Measures of blocks with outlines and layers: what is not there counts for nothing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import shapely

from taichi_foam.analysis import cell_shapes
from taichi_foam.analysis.cell_state import apart, crushed_cells, there
from taichi_foam.analysis.fragments import cracks, parts, piece_sizes, pieces
from taichi_foam.analysis.impact import bottomed_out
from taichi_foam.analysis.room import crushed_layer, without_room
from taichi_foam.analysis.soundness import loose_share, warnings_of
from taichi_foam.scene import Block, Curve, FlatBlock, Foam, Layer, Scene, TabulatedFoam
from taichi_foam.scene.filling import filling

SIZE = {"width": 0.1, "height": 0.05, "columns": 20, "rows": 10, "mass_points": "cells"}
ON_FACES = {"width": 0.1, "height": 0.05, "cell": 0.005, "mass_points": "faces"}
# an L: all columns up to 20 mm, the six on the left up to 50 mm
CORNER = Block(
    **SIZE,
    outline=[(-0.05, 0), (0.05, 0), (0.05, 0.02), (-0.02, 0.02), (-0.02, 0.05), (-0.05, 0.05)],
)
CORNER_ON_FACES = Block(**ON_FACES, outline=CORNER.outline)
SLOPED = Block(
    **SIZE,
    outline=[(-0.05, 0), (0.05, 0), (0.031, 0.0483), (-0.031, 0.0483)],
    holes=[[(-0.012, 0.02), (0.01, 0.02), (0.0, 0.036)]],
)


def test_an_outlined_block_is_one_piece(make_snapshot) -> None:
    snapshot = make_snapshot(CORNER)
    assert pieces(snapshot, CORNER) == 1
    assert piece_sizes(snapshot, CORNER) == pytest.approx([1.0])
    assert loose_share(snapshot, CORNER) == 0.0
    assert cracks(snapshot, CORNER) == []
    labels = parts(snapshot, CORNER)
    np.testing.assert_array_equal(labels >= 0, there(CORNER))


def test_a_crack_through_the_arm_of_a_corner_parts_it(make_snapshot) -> None:
    """Of 6 x 10 + 14 x 4 mass points the arm has six columns of six rows, above row 4."""
    snapshot = make_snapshot(CORNER, b=[(i, 3) for i in range(6)])
    assert pieces(snapshot, CORNER) == 2
    assert piece_sizes(snapshot, CORNER) == pytest.approx([80 / 116, 36 / 116])


def test_bonds_that_never_were_join_nothing_and_are_not_broken(make_snapshot) -> None:
    snapshot = make_snapshot(CORNER)
    a, b = apart(snapshot, CORNER)
    assert a[6:, 5].all()
    assert a[5, 5]  # from the arm to where there is nothing
    assert not a[:5, 5].any()
    assert b[10, 3]
    assert not snapshot.broken_a.any()
    assert not snapshot.broken_b.any()


@pytest.mark.parametrize(
    "block",
    [
        Block(**ON_FACES),
        # its corners in the middles of cells, both ways
        Block(**ON_FACES, outline=[(-0.0425, 0), (0.0425, 0), (0.0425, 0.04), (-0.0425, 0.04)]),
    ],
    ids=["whole", "aside"],
)
def test_every_cell_is_drawn_as_large_as_it_is(make_snapshot, block: Block) -> None:
    """Half of a cell along a face that runs through its middle, a quarter at a corner of two."""
    shapes, _ = cell_shapes.shapes_of(make_snapshot(block), block)
    held = there(block)
    drawn = shapely.area(shapely.polygons(shapes[held]))
    expected = filling(block).share[held] * block.dx * block.dy
    assert drawn == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("block", [CORNER, SLOPED, CORNER_ON_FACES])
def test_cells_fill_the_outline(make_snapshot, block: Block) -> None:
    """As they are drawn, but for what is cut off at the outline's corners."""
    shapes, sides = cell_shapes.shapes_of(make_snapshot(block), block)
    foam = shapely.Polygon(block.corners, block.holes)
    drawn = shapely.union_all(shapely.polygons(shapes[there(block)]))
    assert shapely.area(shapely.symmetric_difference(drawn, foam)) < 0.01 * foam.area
    if block is not SLOPED:
        assert drawn.area == pytest.approx(foam.area, rel=1e-9)
    if block is CORNER:
        assert sides[0, -1] == cell_shapes.LEFT | cell_shapes.TOP
        assert sides[5, 5] == cell_shapes.RIGHT
        assert sides[8, 3] == cell_shapes.TOP


def test_each_layer_is_crushed_by_its_own_foam(make_snapshot) -> None:
    weak = Foam(densification_strain=-0.3, locking_strain=-0.5)
    block = Block(**SIZE, layers=(Layer(bottom=0.0, top=0.025, foam=weak),))
    scene = Scene(block=block, impactor=FlatBlock(width=0.1, velocity=3.0))
    strain = np.full((20, 9), -0.25)  # 0.8 through the crushing of the one, 0.27 of the other
    snapshot = make_snapshot(block, e_min_b=strain)
    crushed = crushed_cells(snapshot, scene)
    assert crushed[:, :5].all()
    # the bond between the layers is of the lower one, where both have the same plateau
    np.testing.assert_array_equal(crushed[:, 5:].any(axis=0), [True, *[False] * 4])


def test_the_layer_under_a_face_beside_a_wall(make_snapshot) -> None:
    """Two rows of three crushed to a fifth: what is left of them and the wall's height beside."""
    product = FlatBlock(width=0.06, x=0.015, velocity=3.0)
    scene = Scene(block=CORNER, impactor=product)
    strain = np.zeros((20, 9))
    strain[6:, 1:3] = -0.8
    position = make_snapshot(CORNER).position.copy()
    position[6:, 2:, 1] -= 0.8 * CORNER.dy
    position[6:, 3:, 1] -= 0.8 * CORNER.dy
    face = position[10, 3, 1]
    snapshot = make_snapshot(CORNER, e_min_b=strain, position=position, impactor_y=face)
    assert crushed_layer(snapshot, scene) == pytest.approx(0.4 * CORNER.dy)
    assert without_room(snapshot, scene) == pytest.approx(0.0, abs=0.02)


def test_a_column_of_an_outlined_block_bottoms_out(make_snapshot, make_result) -> None:
    product = FlatBlock(width=0.06, x=0.015, velocity=3.0)
    scene = Scene(block=CORNER, impactor=product)
    strain = np.zeros((20, 9))
    strain[10, :3] = -0.85  # all that there is of the column

    def found(worst: np.ndarray) -> bool | None:
        force = 3 * scene.foam.landmarks.plateau_stress * 0.06 * CORNER.depth
        return bottomed_out(
            make_result(
                scene=scene,
                time=(0.0, 1e-3, 2e-3),
                displacement_m=(0.0, 0.002, 0.003),
                velocity_m_s=(3.0, 1.0, -1.0),
                contact_force_N=(0.0, force, force),
                snapshots=[make_snapshot(CORNER, e_min_b=worst)],
            )
        )

    assert found(strain) is True
    assert found(np.where(strain < 0, -0.5, 0.0)) is False


def test_a_layer_that_leaves_its_test_is_told(make_snapshot, make_result) -> None:
    first = Curve(strain=(0, 0.05, 0.6, 0.9), stress=(0, 1e5, 1.6e5, 1e6))
    second = Curve(strain=(0, 0.05, 0.5), stress=(0, 2e5, 3e5))
    layer = Layer(bottom=0.0, top=0.025, foam=TabulatedFoam(curve=second))
    scene = Scene(
        block=Block(**SIZE, layers=(layer,)),
        foam=TabulatedFoam(curve=first),
        impactor=FlatBlock(width=0.1, velocity=3.0),
    )
    for row, told in ((2, ["block.layers[0].foam were crushed beyond a strain of 0.5"]), (7, [])):
        strain = np.zeros((20, 9))
        strain[:, row] = -0.6
        snapshot = make_snapshot(scene.block, e_min_b=strain)
        found = warnings_of(make_result(scene=scene, snapshots=[snapshot]))
        assert len(found) == len(told)
        assert all(words in sentence for words, sentence in zip(told, found, strict=True))


def test_thin_foam_is_told(make_snapshot, make_result) -> None:
    rib = [(-0.05, 0), (0.05, 0), (0.05, 0.02), (0.004, 0.02), (0.004, 0.05), (-0.004, 0.05),
           (-0.004, 0.02), (-0.05, 0.02)]  # fmt: skip
    scene = Scene(block=Block(**SIZE, outline=rib), impactor=FlatBlock(width=0.05, velocity=3.0))
    (sentence,) = warnings_of(make_result(scene=scene, snapshots=[make_snapshot(scene.block)]))
    assert "is thinner than two cells of 0.005 x 0.005 m" in sentence


def test_what_has_been_torn_off_an_outlined_block_is_loose(make_snapshot) -> None:
    a = [(i, j) for i in range(19) for j in range(10)]
    b = [(i, j) for i in range(20) for j in range(9)]
    snapshot = replace(make_snapshot(CORNER, a=a, b=b))
    assert loose_share(snapshot, CORNER) == 1.0
    assert pieces(snapshot, CORNER) == 0
