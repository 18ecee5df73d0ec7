"""The shapes of the cells against maps and rotations that are known exactly."""

from __future__ import annotations

import numpy as np
import pytest
from picture_states import dented, intact, reference, scene_of, shattered, snapshot_of, split

from taichi_foam.analysis import cell_shapes
from taichi_foam.analysis.cell_state import worst_strain
from taichi_foam.records.snapshot import Snapshot
from taichi_foam.scene import Scene


def corners_of(snapshot: Snapshot, scene: Scene) -> np.ndarray:
    return cell_shapes.shapes_of(snapshot, scene.block)[0]


def reference_corners(scene: Scene) -> np.ndarray:
    half = 0.5 * np.array([scene.block.dx, scene.block.dy])
    signs = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    return reference(scene)[:, :, None, :] + signs * half


def area(quads: np.ndarray) -> np.ndarray:
    x, y = quads[..., 0], quads[..., 1]
    return 0.5 * np.sum(x * np.roll(y, -1, axis=-1) - y * np.roll(x, -1, axis=-1), axis=-1)


@pytest.mark.parametrize(
    "F",
    [
        [[1.0, 0.0], [0.0, 1.0]],
        [[1.02, 0.05], [-0.04, 0.9]],
        [[0.6, 0.8], [-0.8, 0.6]],  # a rotation
        [[1.0, 0.0], [0.0, 0.1]],
    ],
)
def test_a_homogeneous_deformation_maps_every_corner_exactly(F: list[list[float]]) -> None:
    scene = scene_of(7, 5)
    position = reference(scene) @ np.array(F).T
    expected = reference_corners(scene) @ np.array(F).T
    np.testing.assert_allclose(
        corners_of(snapshot_of(scene, position), scene), expected, atol=1e-15
    )


def test_cells_of_a_whole_block_share_their_corners_to_the_last_bit() -> None:
    scene = scene_of()
    points = corners_of(dented(scene), scene)
    np.testing.assert_array_equal(points[:-1, :, 1], points[1:, :, 0])
    np.testing.assert_array_equal(points[:-1, :, 2], points[1:, :, 3])
    np.testing.assert_array_equal(points[:, :-1, 3], points[:, 1:, 0])
    np.testing.assert_array_equal(points[:, :-1, 2], points[:, 1:, 1])


def test_halves_of_a_split_block_keep_their_own_shape() -> None:
    """Each half moved rigidly, so its corners are the rotated reference corners, crack included."""
    scene, opening = scene_of(8, 6), 0.2
    points = corners_of(split(scene, opening), scene)
    half = scene.block.columns // 2
    pivot = np.array([-scene.block.width / 4, scene.block.dy / 2])
    c, s = np.cos(opening), np.sin(opening)
    turned = pivot + (reference_corners(scene)[:half] - pivot) @ np.array([[c, s], [-s, c]])
    np.testing.assert_allclose(points[:half], turned, atol=1e-15)
    gap = points[half, :, 3, 0] - points[half - 1, :, 2, 0]
    assert np.all(np.diff(gap) > 0)
    # Tops of the faces, rotated about a point that lies a quarter width aside.
    arm = np.array([scene.block.width / 4, scene.block.height - scene.block.dy / 2])
    across = arm[0] - (c * arm[0] - s * arm[1])
    np.testing.assert_allclose(gap[-1], 2 * across, rtol=1e-12)


def test_one_broken_connection_inside_whole_foam_keeps_the_corners_together() -> None:
    """A crack opens between its tips; a single broken bond is all tip."""
    scene = scene_of(6, 6)
    broken_b = np.zeros((6, 5), dtype=bool)
    broken_b[2, 2] = True
    points = corners_of(snapshot_of(scene, reference(scene), broken_b=broken_b), scene)
    np.testing.assert_array_equal(points[2, 2, 2:], points[2, 3, [1, 0]])


def test_a_crack_of_two_connections_opens_in_the_middle() -> None:
    scene = scene_of(6, 6)
    broken_b = np.zeros((6, 5), dtype=bool)
    broken_b[2:4, 2] = True
    position = reference(scene)
    position[2:4, 3:, 1] += 0.01 * scene.block.dy
    points = corners_of(snapshot_of(scene, position, broken_b=broken_b), scene)
    upper, lower = points[2, 3, 1], points[2, 2, 2]
    assert upper[1] > lower[1]
    np.testing.assert_array_equal(points[2, 2, 3], points[2, 3, 0])


def test_a_loose_cell_has_the_size_that_its_worst_strains_leave() -> None:
    scene = scene_of(5, 4)
    broken = {"broken_a": np.ones((4, 4), dtype=bool), "broken_b": np.ones((5, 3), dtype=bool)}
    strains = {"e_min_a": np.full((4, 4), -0.3), "e_min_b": np.full((5, 3), -0.6)}
    snapshot = snapshot_of(scene, reference(scene), **broken, **strains)
    points = corners_of(snapshot, scene)
    size = np.array([0.7 * scene.block.dx, 0.4 * scene.block.dy])
    np.testing.assert_allclose(
        points[..., 2, :] - points[..., 0, :], np.broadcast_to(size, (5, 4, 2))
    )


@pytest.mark.parametrize("state", [intact, dented, split, shattered])
def test_no_cell_is_turned_inside_out_or_larger_than_a_stretched_one(state) -> None:
    scene = scene_of()
    quads = area(corners_of(state(scene), scene))
    assert np.all(quads > 0)
    assert np.all(quads < 1.06**2 * scene.block.dx * scene.block.dy)


def test_rubble_pushed_past_its_neighbour_is_drawn_as_a_rectangle_of_its_own() -> None:
    """Sharing corners with the neighbour it has passed would fold the cell."""
    scene = scene_of(6, 6)
    dx, dy = scene.block.dx, scene.block.dy
    position = reference(scene)
    position[2, 3, 0] += 1.4 * dx  # its right bond is turned round, and 0.4 dx long
    broken_a, broken_b = np.zeros((5, 6), dtype=bool), np.zeros((6, 5), dtype=bool)
    broken_a[1, 3] = broken_b[2, 2] = broken_b[2, 3] = True
    snapshot = snapshot_of(scene, position, broken_a=broken_a, broken_b=broken_b)
    quad = corners_of(snapshot, scene)[2, 3]
    # Half a whole cell on the torn side, half of what is left of the bond on the other.
    wide = (0.5 + 0.2) * dx
    sides = np.diff(quad, axis=0)
    np.testing.assert_allclose(sides, [[-wide, 0], [0, -dy], [wide, 0]], atol=1e-15)


def test_worst_strain_is_the_least_over_the_connections_of_a_node() -> None:
    e_min_a = np.array([[-0.1, 0.0], [-0.5, -0.2]])
    e_min_b = np.array([[-0.3], [0.0], [-0.4]])
    worst = worst_strain(e_min_a, e_min_b)
    np.testing.assert_array_equal(worst, [[-0.3, -0.3], [-0.5, -0.2], [-0.5, -0.4]])


def test_open_sides_are_the_outside_and_both_faces_of_a_break() -> None:
    broken_a = np.zeros((2, 3), dtype=bool)
    broken_b = np.zeros((3, 2), dtype=bool)
    broken_a[0, 1] = broken_b[1, 0] = True
    sides = cell_shapes.open_sides(broken_a, broken_b)
    assert sides[1, 1] == cell_shapes.LEFT | cell_shapes.BOTTOM
    assert sides[0, 1] == cell_shapes.LEFT | cell_shapes.RIGHT
    assert sides[1, 0] == cell_shapes.BOTTOM | cell_shapes.TOP
    assert sides[2, 1] == cell_shapes.RIGHT
