"""Breaking: Fig. 20's cases by hand, what a broken face still carries, and when faces break."""

import math

import numpy as np
import pytest
from bench import (
    ALL_A,
    ALL_B,
    COLUMNS,
    FREE,
    LIFT,
    ROUNDING,
    ROWS,
    bench,
    node_forces,
    numerics,
    small_scene,
)
from reference_lattice import reference_positions

from taichi_foam.scene import Foam, Model

BY_FACES = Model(self_contact=False, crushed_room=False, shear="face")
G, K = 0.84e6, 2.78e6
FACE = 0.005 * 0.057  # m2


# Rows slide over each other: u_x of row j is dy * OFFSET[j], shear ROW_SHEAR[j] from j to j + 1.
ROW_SHEAR = np.linspace(-0.05, 0.08, ROWS - 1)
OFFSET = np.concatenate([[0.0], np.cumsum(ROW_SHEAR)])
AT = 7  # the row that is looked at


def pull_of_b(shear: float) -> np.ndarray:
    """T of an intact B between two rows: stretched sideways, and sheared against straight As."""
    stretch = math.hypot(shear, 1.0)
    return FACE * (K * (stretch - 1) / stretch * np.array([shear, 1.0]) + [G * shear, 0.0])


@pytest.mark.parametrize(
    ("broken_b", "halves"),
    [
        ([], ["above", "below"]),
        ([(0, AT)], ["below"]),
        ([(1, AT)], ["below"]),
        ([(0, AT), (1, AT)], ["below"]),
        ([(0, AT - 1)], ["above"]),
        ([(1, AT - 1)], ["above"]),
        ([(0, AT), (0, AT - 1)], []),
        ([(0, AT), (1, AT - 1)], []),
        ([(1, AT), (1, AT - 1)], []),
    ],
)
def test_a_broken_neighbour_takes_its_half_of_the_gradient_along(
    broken_b: list, halves: list[str]
) -> None:
    """Fig. 20 at the left edge, where a node has one A, to its right, and the Bs above and below.

    The rows slide by different amounts, so that each half sees its own shear: the mean of all
    four differences, of two, or none, and then no shear stress at all.
    """
    scene = small_scene(base=FREE, model=BY_FACES)
    position = reference_positions(scene) + LIFT
    position[..., 0] += 0.005 * OFFSET
    shear = {"above": ROW_SHEAR[AT], "below": ROW_SHEAR[AT - 1]}
    gamma = np.mean([shear[half] for half in halves]) if halves else 0.0
    expected = FACE * G * gamma * np.array([gamma, 1.0])  # of A, whose own bond is straight
    if (0, AT) not in broken_b:
        expected = expected + pull_of_b(ROW_SHEAR[AT])
    if (0, AT - 1) not in broken_b:
        expected = expected - pull_of_b(ROW_SHEAR[AT - 1])
    found = node_forces(scene, position=position, broken_b=broken_b)[0, AT]
    np.testing.assert_allclose(found, expected, atol=ROUNDING)


def test_a_bare_fibre_still_pulls_and_presses_along_itself() -> None:
    """All B broken: every row is a string, sheared rows or not."""
    scene = small_scene(base=FREE)
    for e, sigma in ((0.03, 0.03 * K), (-0.03, -0.03 * K), (-0.4, -0.05 * K)):
        position = reference_positions(scene)
        position[..., 0] *= 1 + e
        position[..., 0] += 0.005 * OFFSET
        position[..., 1] *= 1.2  # and rows apart, which without B costs nothing
        forces = node_forces(scene, position=position + LIFT, broken_b=ALL_B)
        expected = np.zeros_like(forces)
        expected[0, :, 0] = sigma * FACE
        expected[-1, :, 0] = -sigma * FACE
        np.testing.assert_allclose(forces, expected, atol=ROUNDING)


@pytest.mark.parametrize("reading", ["reload", "jump"])
def test_a_broken_face_carries_no_tension_and_no_shear(reading: str) -> None:
    """Pulled, sheared dust does nothing, and its dashpots are gone: it coasts, to the last bit."""
    scene = small_scene(
        base=FREE,
        model=Model(self_contact=False, broken_contact=reading),
        numerics=numerics(dt=1e-6),
    )
    F = np.array([[1.02, 0.3], [0.1, 1.3]])
    position = reference_positions(scene) @ F.T + LIFT
    velocity = np.random.default_rng(0).uniform([0.0, 5.0], [0.1, 5.1], position.shape)
    with bench(
        scene, position=position, velocity=velocity, broken_a=ALL_A, broken_b=ALL_B
    ) as loaded:
        after = loaded.step(100)
    np.testing.assert_array_equal(after.velocity, velocity)
    np.testing.assert_allclose(after.position, position + 1e-4 * velocity, atol=1e-14)


@pytest.mark.parametrize(
    ("reading", "e", "stress"),
    [
        # crushed to -0.4 and then broken; zero stress at -0.35
        ("reload", -0.34, 0.0),
        ("reload", -0.36, -0.01 * K),
        ("reload", -0.39, -0.04 * K),
        ("reload", -0.5, -0.05 * K),
        ("jump", -0.36, 0.0),
        ("jump", -0.39, 0.0),
        ("jump", -0.41, -0.05 * K),
    ],
)
def test_broken_faces_meet_again_by_the_chosen_reading(
    reading: str, e: float, stress: float
) -> None:
    """A block of dust, squeezed along x with sheared rows: pressure along x and nothing else."""
    scene = small_scene(base=FREE, model=Model(self_contact=False, broken_contact=reading))
    position = reference_positions(scene)
    position[..., 0] = position[..., 0] * (1 + e) + 0.005 * OFFSET
    position[..., 1] *= 1.1
    forces = node_forces(
        scene,
        position=position + LIFT,
        worst_a=np.full((COLUMNS - 1, ROWS), -0.4),
        broken_a=ALL_A,
        broken_b=ALL_B,
    )
    expected = np.zeros_like(forces)
    expected[0, :, 0] = stress * FACE
    expected[-1, :, 0] = -stress * FACE
    np.testing.assert_allclose(forces, expected, atol=ROUNDING)


@pytest.mark.parametrize(
    ("gradient", "worst", "broken"),
    [
        (((1.0, 0.0), (0.0, 1.0499)), 0.0, (False, False)),
        (((1.0, 0.0), (0.0, 1.0501)), 0.0, (False, True)),
        (((1.0501, 0.0), (0.0, 1.0)), 0.0, (True, False)),
        (((1.0, 0.0), (0.0, 1.0249)), -0.2, (False, False)),
        (((1.0, 0.0), (0.0, 1.0251)), -0.2, (False, True)),
        # A and B share gamma = 1.001 F_12; all bonds are stretched by 0.1 %, none compressed
        (((1.001, 0.0998), (0.0, 1.001)), 0.0, (False, False)),
        (((1.001, 0.1), (0.0, 1.001)), 0.0, (True, True)),
        (((1.001, 0.0), (-0.1, 1.001)), 0.0, (True, True)),
        # the A are compressed and so spared, the B are not
        (((0.9, 0.115), (0.0, 1.0)), 0.0, (False, True)),
    ],
)
def test_faces_break_at_their_limits(gradient: tuple, worst: float, broken: tuple) -> None:
    """All of an axis at once, in the first step, for good; times and histories say so."""
    foam = Foam(softening=False)
    scene = small_scene(base=FREE, foam=foam, numerics=numerics(dt=1e-9))
    position = reference_positions(scene) @ np.array(gradient).T + LIFT
    with bench(scene, position=position, worst_b=np.full((COLUMNS, ROWS - 1), worst)) as loaded:
        first = loaded.step(1)
        later = loaded.step(20)
    assert (first.broken_a.all(), first.broken_b.all()) == broken
    assert (first.broken_a.any(), first.broken_b.any()) == broken
    np.testing.assert_array_equal(later.broken_a, first.broken_a)
    np.testing.assert_array_equal(later.broken_b, first.broken_b)
    times = np.concatenate([first.break_time_a[first.broken_a], first.break_time_b[first.broken_b]])
    np.testing.assert_allclose(times, first.time, rtol=1e-7)  # kept in single precision


def test_history_keeps_the_worst_compression_and_never_heals() -> None:
    """A free bar, squeezed by 20 % and let go: e_min is -0.2 where it began, and stays."""
    scene = small_scene(base=FREE, foam=Foam(tensile_strain=1.0))
    position = reference_positions(scene) * [1.0, 0.8] + LIFT
    with bench(scene, position=position) as loaded:
        first = loaded.step(1)
        later = loaded.step(300)
    np.testing.assert_allclose(first.e_min_b, -0.2, atol=1e-12)
    assert np.all(later.e_min_b <= first.e_min_b)
    stretch = np.linalg.norm(np.diff(later.position, axis=1), axis=-1) / 0.005
    assert stretch.max() > 0.85  # it has expanded since
