"""Shear by cells and by faces, softened and torn, and overstress, against the NumPy lattice."""

import numpy as np
import pytest
from bench import (
    COLUMNS,
    FREE,
    LIFT,
    PLAIN,
    ROUNDING,
    ROWS,
    UNBREAKABLE,
    bench,
    node_forces,
    numerics,
    small_scene,
)
from reference_lattice import ReferenceLattice, reference_positions

from taichi_foam.scene import Foam, Model, Scene

SHEARS = ("cell", "face")
FORMS = pytest.mark.parametrize("shear", SHEARS)
GRADIENTS = {
    "small strain": ((1.0, 0.0), (0.0, 1.0)),
    "sheared": ((0.9, 0.2), (-0.1, 0.95)),
    "crushed": ((0.97, 0.0), (0.1, 0.3)),
    "densified": ((0.17, 0.03), (0.02, 0.6)),
}


def state(shear: str, gradient: tuple, seed: int, dx: float = 0.005, **parts) -> tuple[Scene, dict]:
    """A block deformed at random about a gradient; a third of its bonds are broken, a third soft.

    Shares of softened bonds are such as 32 bits hold.
    """
    scene = small_scene(
        dx=dx,
        base=FREE,
        model=PLAIN.model_copy(update={"shear": shear}),
        **{"foam": UNBREAKABLE, **parts},
    )
    rng = np.random.default_rng(seed)
    a, b = (COLUMNS - 1, ROWS), (COLUMNS, ROWS - 1)
    position = reference_positions(scene) @ np.array(gradient).T
    position += rng.uniform(-0.02, 0.02, position.shape) * [dx, 0.005]
    return scene, {
        "position": position,
        "worst_a": -rng.uniform(0.0, 0.9, a) * rng.integers(0, 2, a),
        "worst_b": -rng.uniform(0.0, 0.9, b) * rng.integers(0, 2, b),
        "intact_a": np.where(rng.random(a) < 0.5, rng.integers(1, 16, a) / 16.0, 1.0),
        "intact_b": np.where(rng.random(b) < 0.5, rng.integers(1, 16, b) / 16.0, 1.0),
        "broken_a": {tuple(map(int, k)) for k in np.argwhere(rng.random(a) < 0.3)},
        "broken_b": {tuple(map(int, k)) for k in np.argwhere(rng.random(b) < 0.3)},
    }


def lifted(start: dict) -> dict:
    return {**start, "position": start["position"] + LIFT}


@FORMS
@pytest.mark.parametrize("dx", [0.005, 0.003])
@pytest.mark.parametrize("name", GRADIENTS)
def test_any_softened_and_torn_state_agrees_with_the_tensors(
    shear: str, dx: float, name: str
) -> None:
    """Histories, free edges, broken neighbours and bare fibres in every combination."""
    scene, start = state(shear, GRADIENTS[name], seed=11, dx=dx)
    start = lifted(start)
    expected = ReferenceLattice(scene, **start).node_forces()
    assert np.abs(expected).max() > 1.0
    np.testing.assert_allclose(node_forces(scene, **start), expected, rtol=0, atol=ROUNDING)


def test_overstress_presses_too() -> None:
    """Crushed by a third at once, of any history: K times what each is ahead of its own.

    In the bench's instant it flows by D (y / e_y)^q dt, less than 1e-10 of a strain here.
    """
    foam = UNBREAKABLE.model_copy(update={"rate": 100.0, "rate_exponent": 2.0})
    scene, start = state("cell", ((0.7, 0.0), (0.0, 0.65)), seed=12, foam=foam)
    scene = scene.model_copy(update={"model": Model(self_contact=False)})
    start = lifted(start)
    forces = ReferenceLattice(scene, **start).node_forces()
    flowing = 2.78e6 * 4 * 0.005 * 0.057 * 100.0 * (0.4 / 0.05) ** 2 * 1e-12
    np.testing.assert_allclose(node_forces(scene, **start), forces, rtol=0, atol=2 * flowing)
    static = node_forces(scene.model_copy(update={"foam": UNBREAKABLE}), **start)
    assert np.abs(forces - static).max() > 100.0


@FORMS
def test_the_mirror_image_has_the_mirrored_forces_to_the_last_bit(shear: str) -> None:
    """Velocities after one short step: not lifted, so that x only changes its sign."""
    scene, start = state(shear, GRADIENTS["sheared"], seed=13)
    flip = np.array([-1.0, 1.0])
    image = {
        "position": start["position"][::-1] * flip,
        **{name: start[name][::-1].copy() for name in start if name.startswith(("worst", "int"))},
        "broken_a": {(COLUMNS - 2 - i, j) for i, j in start["broken_a"]},
        "broken_b": {(COLUMNS - 1 - i, j) for i, j in start["broken_b"]},
    }
    forces = node_forces(scene, **lifted(start))
    assert np.abs(forces).max() > 10.0
    np.testing.assert_array_equal(node_forces(scene, **lifted(image)), forces[::-1] * flip)


def test_cells_turn_no_block_however_torn() -> None:
    """Their energy is the same for a turned block: forces add up to nothing, and so do torques.

    The face form leaves the torque of every patch whose A and B do not pair off.
    """
    torques = {}
    for shear in SHEARS:
        scene, start = state(shear, GRADIENTS["sheared"], seed=14)
        forces = node_forces(scene, **lifted(start))
        np.testing.assert_allclose(forces.sum(axis=(0, 1)), 0.0, atol=COLUMNS * ROWS * ROUNDING)
        x = start["position"] - start["position"].mean(axis=(0, 1))
        torques[shear] = (x[..., 0] * forces[..., 1] - x[..., 1] * forces[..., 0]).sum()
    arm = 0.1  # m
    assert abs(torques["cell"]) < COLUMNS * ROWS * ROUNDING * arm
    assert abs(torques["face"]) > 0.1


@FORMS
def test_a_torn_block_turns_rigidly_without_force(shear: str) -> None:
    c, s = np.cos(0.7), np.sin(0.7)
    scene, start = state(shear, ((c, -s), (s, c)), seed=15)
    exact = reference_positions(scene) @ np.array([[c, -s], [s, c]]).T
    # the broken press once they have a history; here they have none
    start = {**start, "position": exact + LIFT, "worst_a": None, "worst_b": None}
    np.testing.assert_allclose(node_forces(scene, **start), 0.0, rtol=0, atol=ROUNDING)


def test_what_cells_hold_comes_back_with_the_next_lattice() -> None:
    """A torn lattice that is lent again is whole."""
    scene, start = state("cell", GRADIENTS["small strain"], seed=16)
    fresh = node_forces(scene, position=start["position"] + LIFT)
    with bench(scene, **lifted(start)) as loaded:
        loaded.step(3)
    np.testing.assert_array_equal(node_forces(scene, position=start["position"] + LIFT), fresh)


AT = (4, 9)
SIDES_A, SIDES_B = (AT, (4, 10)), (AT, (5, 9))


@pytest.mark.parametrize(
    ("broken_a", "broken_b", "grips"),
    [
        ((), (), True),
        ((AT,), (AT,), True),
        ((SIDES_A[1],), (SIDES_B[1],), True),
        (SIDES_A, (), False),
        ((), SIDES_B, False),
        (SIDES_A, SIDES_B, False),
    ],
)
def test_a_cell_carries_shear_by_one_side_along_each_axis(
    broken_a: tuple, broken_b: tuple, grips: bool
) -> None:
    """All of it, as long as one side of each pair is whole; then none.

    All other cells are cut off: no other has a side along x and one along y.
    """
    scene = small_scene(base=FREE, foam=UNBREAKABLE, model=PLAIN)
    all_a = {(i, j) for i in range(COLUMNS - 1) for j in range(ROWS)} - set(SIDES_A)
    all_b = {(i, j) for i in range(COLUMNS) for j in range(ROWS - 1)} - set(SIDES_B)
    gamma = 0.05
    position = reference_positions(scene) @ np.array([[1.0, gamma], [0.0, 1.0]]).T + LIFT
    torn = {"broken_a": all_a | set(broken_a), "broken_b": all_b | set(broken_b)}
    force = node_forces(scene, position=position, **torn)[AT]
    # F S N of half of each of its two faces at this corner; upright bonds are stretched besides
    shear = 0.5 * 0.84e6 * gamma * 0.005 * 0.057
    expected = np.array([shear + shear * gamma, shear]) if grips else np.zeros(2)
    if AT not in torn["broken_b"]:
        stretch = np.hypot(gamma, 1.0)
        along = np.array([gamma, 1.0]) / stretch
        expected = expected + 2.78e6 * (stretch - 1.0) * 0.005 * 0.057 * along
    np.testing.assert_allclose(force, expected, atol=ROUNDING)


@pytest.mark.parametrize(("slide", "breaks"), [(0.05, False), (0.07, True), (0.12, True)])
def test_compressed_foam_breaks_by_its_angle(slide: float, breaks: bool) -> None:
    """F = [[0.9, slide], [0, 0.6]]: gamma = 0.9 slide, its angle's sine slide / |(slide, 0.6)|.

    Both may reach 0.10: the sine by a slide of 0.0603, gamma by one of 0.111.
    """
    F = np.array([[0.9, slide], [0.0, 0.6]])
    scene = small_scene(
        base=FREE,
        foam=Foam(softening=False),
        model=Model(self_contact=False, shear_failure="angle"),
        numerics=numerics(dt=1e-9),
    )
    with bench(scene, position=reference_positions(scene) @ F.T + LIFT) as loaded:
        after = loaded.step(1)
    assert (after.broken_a.all(), after.broken_a.any()) == (breaks, breaks)
    assert (after.broken_b.all(), after.broken_b.any()) == (breaks, breaks)
