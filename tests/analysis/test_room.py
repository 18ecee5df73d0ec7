"""Room of crushed foam, on lattices whose answers are known in closed form."""

from __future__ import annotations

import warnings
from dataclasses import replace

import numpy as np
import pytest
from paper_lattices import DX, DY, FACES, FLAT_ON_FACES, mirrored

from taichi_foam.analysis import room
from taichi_foam.records.snapshot import Snapshot
from taichi_foam.scene import Block, Cylinder, FlatBlock, Scene

BLOCK = Block(columns=12, rows=9, width=0.06, height=0.04)  # cells of 5 mm
INSIDE = Block(columns=12, rows=8, width=0.06, height=0.04, mass_points="cells")  # as large
SCENE = Scene(name="room", block=BLOCK, impactor=FlatBlock())


def mapped(snapshot: Snapshot, matrix: object) -> Snapshot:
    """The block after a uniform map of all positions."""
    return replace(snapshot, position=snapshot.position @ np.transpose(matrix))


def crushed_to(snapshot: Snapshot, left: float) -> Snapshot:
    """The block crushed evenly to `left` of its height."""
    snapshot.e_min_b[:] = left - 1.0
    return mapped(snapshot, [[1.0, 0.0], [0.0, left]])


def slid(snapshot: Snapshot, columns: float) -> Snapshot:
    """The left half pushed so many columns into the right one, from which it is broken off."""
    middle = snapshot.position.shape[0] // 2
    snapshot.break_time_a[middle - 1] = 0.0
    snapshot.position[:middle, :, 0] += columns * DX
    return snapshot


# --- crushed foam without room ----------------------------------------------------------------


def test_without_crushed_foam_there_is_no_answer(make_snapshot) -> None:
    assert room.without_room(make_snapshot(BLOCK), SCENE) is None


MAPS = {
    "as it was": [[1.0, 0.0], [0.0, 1.0]],
    "sheared": [[1.0, 0.7], [0.0, 1.0]],
    "sheared along the crush": [[1.0, 0.0], [0.3, 1.0]],
    "turned": [[0.8, -0.6], [0.6, 0.8]],
    "turned over": [[-1.0, 0.0], [0.0, -1.0]],
}


@pytest.mark.parametrize("block", [BLOCK, INSIDE], ids=["faces", "cells"])
@pytest.mark.parametrize("shape", MAPS)
@pytest.mark.parametrize("left", [1.0, 0.5, 0.25, 0.13, 0.1, 0.06, 0.02])
def test_foam_that_is_crushed_evenly_has_its_room(make_snapshot, shape, left, block) -> None:
    snapshot = mapped(crushed_to(make_snapshot(block), left), MAPS[shape])
    snapshot.e_min_b[:] = np.minimum(snapshot.e_min_b, -0.5)
    scene = SCENE.model_copy(update={"block": block})
    assert room.without_room(snapshot, scene) == pytest.approx(0.0, abs=2e-3)


def test_foam_that_is_crushed_both_ways_has_its_room(make_snapshot) -> None:
    """It needs the 4 % that it was pressed to, not the 12 % of foam crushed one way."""
    snapshot = crushed_to(make_snapshot(BLOCK), 0.2)
    snapshot.e_min_a[:] = -0.8
    squeezed = mapped(snapshot, [[0.2, 0.0], [0.0, 1.0]])
    assert room.without_room(squeezed, SCENE) == pytest.approx(0.0, abs=2e-3)


def test_a_crushed_layer_on_whole_foam_has_its_room(make_snapshot) -> None:
    """A front within the block: cells at it are crushed on one side."""
    snapshot = make_snapshot(BLOCK)
    snapshot.e_min_b[:, 4:] = -0.85
    height = snapshot.position[:, :, 1]
    height[:, 5:] = height[:, 4:5] + 0.15 * (height[:, 5:] - height[:, 4:5])
    assert room.without_room(snapshot, SCENE) == pytest.approx(0.0, abs=2e-3)


@pytest.mark.parametrize("down", [0, 2, 2.5])
def test_pieces_that_touch_have_their_room(make_snapshot, down) -> None:
    snapshot = slid(crushed_to(make_snapshot(BLOCK), 0.2), 0.0)
    snapshot.position[:6, :, 1] -= down * 0.2 * DY
    assert room.without_room(snapshot, SCENE) == pytest.approx(0.0, abs=2e-3)


@pytest.mark.parametrize("columns", [1, 2, 3])
def test_crushed_foam_in_whole_foam_has_no_room(make_snapshot, columns) -> None:
    """The left half is crushed, the right one is whole: so many of six columns are lost."""
    snapshot = slid(make_snapshot(BLOCK), columns)
    snapshot.e_min_b[:6] = -0.8
    snapshot.position[:6, :, 1] = 0.01 + 0.2 * snapshot.position[:6, :, 1]
    assert room.without_room(snapshot, SCENE) == pytest.approx(columns / 6, abs=2e-3)


def test_a_cell_may_be_covered_as_far_as_it_does_not_need_its_area(make_snapshot) -> None:
    """Crushed to 0.2, of which it needs 0.12: two fifths of a column may be covered."""
    for covered, share in ((0.3, 0.0), (0.5, 1 / 6), (0.7, 0.5)):
        snapshot = slid(make_snapshot(BLOCK), covered)
        snapshot.e_min_b[:6] = -0.8
        snapshot.position[:6, :, 1] = 0.01 + 0.2 * snapshot.position[:6, :, 1]
        assert room.without_room(snapshot, SCENE) == pytest.approx(share / 6, abs=6e-3)


@pytest.mark.parametrize(("left", "share"), [(0.3, 0.0), (0.24, 0.0), (0.2, 1 / 6), (0.12, 0.5)])
def test_crushed_foam_on_crushed_foam_shares_the_room(make_snapshot, left, share) -> None:
    """The halves lie on each other: each cell has half of what it covers, and needs 0.12."""
    snapshot = slid(crushed_to(make_snapshot(BLOCK), left), 6)
    assert room.without_room(snapshot, SCENE) == pytest.approx(share, abs=2e-3)


def test_foam_that_is_turned_inside_out_has_no_room(make_snapshot) -> None:
    snapshot = crushed_to(make_snapshot(BLOCK), 0.3)
    inside_out = mapped(snapshot, [[1.0, 0.0], [0.0, -1.0]])
    assert room.without_room(inside_out, SCENE) == pytest.approx(1.0)


def folded(make_snapshot, block: Block) -> Snapshot:
    """The upper half is crushed and folded down over itself at mid height, at 0.2 of its height."""
    snapshot = make_snapshot(block)
    half = block.rows // 2
    snapshot.e_min_b[:, half:] = -0.8
    height = snapshot.position[:, half:, 1]
    start = height[:, :1].copy()
    depth = 0.2 * (height - start)
    deepest = depth.max() / 2
    snapshot.position[:, half:, 1] = start + np.where(depth < deepest, depth, 2 * deepest - depth)
    return snapshot


def test_the_share_does_not_depend_on_the_mesh(make_snapshot) -> None:
    shares = []
    for finer in (1, 2, 4):
        block = Block(cell=0.005 / finer, width=0.06, height=0.08)
        snapshot = folded(make_snapshot, block)
        shares.append(room.without_room(snapshot, SCENE.model_copy(update={"block": block})))
    # The part that comes back is inside out; the part on its way lies free beneath it.
    assert shares == pytest.approx([0.5, 0.5, 0.5], abs=0.08)
    assert shares[2] == pytest.approx(0.5, abs=0.02)


def test_the_share_does_not_depend_on_the_pixels(make_snapshot, monkeypatch) -> None:
    random = np.random.default_rng(5)
    snapshot = crushed_to(make_snapshot(BLOCK), 0.2)
    snapshot.position[:] += random.normal(0, 1e-3, snapshot.position.shape)
    found = []
    for most in (room.MOST_PIXELS, 1e7, 2e4):
        monkeypatch.setattr(room, "MOST_PIXELS", most)
        monkeypatch.setattr(room, "PIXELS", 80 if most == 1e7 else 20)
        found.append(room.without_room(snapshot, SCENE))
    assert 0.02 < found[0] < 0.9
    assert found == pytest.approx([found[0]] * 3, abs=0.02)


def test_the_mirror_image_has_the_same_room(make_snapshot) -> None:
    random = np.random.default_rng(7)
    snapshot = crushed_to(make_snapshot(BLOCK), 0.2)
    snapshot.position[:] += random.normal(0, 1e-3, snapshot.position.shape)
    snapshot.break_time_b[3:7, 4] = 0.0
    found = room.without_room(snapshot, SCENE)
    assert room.without_room(mirrored(snapshot), SCENE) == pytest.approx(found, abs=0.01)


@pytest.mark.parametrize("value", [np.nan, np.inf, 1e300, -1e30])
def test_values_of_a_run_that_diverged_do_no_harm(make_snapshot, value) -> None:
    snapshot = crushed_to(make_snapshot(BLOCK), 0.2)
    snapshot.position[3, 4] = value
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = room.without_room(snapshot, SCENE)
    assert found == pytest.approx(0.0, abs=2e-3)


# --- the crushed layer ------------------------------------------------------------------------


@pytest.fixture
def pressed(make_snapshot) -> Snapshot:
    """Under a flat face the upper ten bonds of its columns are crushed to a fifth."""
    snapshot = make_snapshot(FACES)
    snapshot.e_min_b[15:25, 10:] = -0.8
    height = snapshot.position[15:25, :, 1]
    height[:, 11:] = height[:, 10:11] + 0.2 * (height[:, 11:] - height[:, 10:11])
    return replace(snapshot, impactor_y=float(height.max()))


def test_the_layer_reaches_from_the_face_to_its_lower_end(pressed) -> None:
    assert room.crushed_layer(pressed, FLAT_ON_FACES) == pytest.approx(10 * 0.2 * DY)


def test_of_a_bond_crushed_in_part_the_upper_part_is_crushed(pressed) -> None:
    """At 0.6 of the way from 0.05 to 0.8 it is 0.6 crushed foam (0.2) and 0.4 yielded (0.95)."""
    pressed.e_min_b[15:25, 9] = -0.5
    pressed.position[15:25, 10:, 1] -= 0.5 * DY
    lowered = replace(pressed, impactor_y=pressed.impactor_y - 0.5 * DY)
    assert room.crushed_layer(lowered, FLAT_ON_FACES) == pytest.approx((10 * 0.2 + 0.6 * 0.2) * DY)


def test_foam_that_is_hardly_crushed_does_not_count(pressed) -> None:
    pressed.e_min_b[15:25, 5:10] = -0.4
    assert room.crushed_layer(pressed, FLAT_ON_FACES) == pytest.approx(10 * 0.2 * DY)


def test_the_layer_is_measured_where_it_lies(pressed) -> None:
    """Folded foam leaves no layer, whatever its bonds would measure when unloaded."""
    pressed.position[15:25, 12:, 1] = pressed.position[15:25, 11:12, 1]
    face = replace(pressed, impactor_y=float(pressed.position[15:25, -1, 1].max()))
    assert room.crushed_layer(face, FLAT_ON_FACES) == pytest.approx(0.2 * DY)


def test_odd_mass_points_do_not_count(pressed) -> None:
    """Those of two of the six columns in the middle half, and of flanks outside it."""
    expected = room.crushed_layer(pressed, FLAT_ON_FACES)
    pressed.position[19, :, 1] += 0.03
    pressed.position[[15, 16, 23, 24], :, 1] -= 0.02
    pressed.e_min_b[20, 2] = -0.9
    assert room.crushed_layer(pressed, FLAT_ON_FACES) == pytest.approx(expected)


def test_where_the_face_has_lifted_the_layer_begins_at_the_foam(pressed) -> None:
    lifted = replace(pressed, impactor_y=pressed.impactor_y + 0.02)
    assert room.crushed_layer(lifted, FLAT_ON_FACES) == room.crushed_layer(pressed, FLAT_ON_FACES)


def test_an_offset_face_has_its_layer_below_it(pressed) -> None:
    aside = FLAT_ON_FACES.model_copy(update={"impactor": FlatBlock(x=0.02)})
    pressed.e_min_b[15:19, 2] = -0.9  # no longer below it
    assert room.crushed_layer(pressed, aside) == pytest.approx(10 * 0.2 * DY)
    far = FLAT_ON_FACES.model_copy(update={"impactor": FlatBlock(x=0.06)})
    assert room.crushed_layer(pressed, far) is None


@pytest.mark.parametrize("impactor", [None, Cylinder()])
def test_without_a_level_face_there_is_no_layer_below_it(pressed, impactor) -> None:
    assert (
        room.crushed_layer(pressed, FLAT_ON_FACES.model_copy(update={"impactor": impactor})) is None
    )


def test_without_crushed_foam_there_is_no_layer(make_snapshot) -> None:
    assert room.crushed_layer(make_snapshot(FACES), FLAT_ON_FACES) is None
