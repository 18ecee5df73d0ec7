"""Forces of the lattice: patches of Eqs 25-26, rotations, and any state against NumPy tensors."""

import math

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

from taichi_foam.scene import Base, Block, Model, Start

FACE = PLAIN.model_copy(update={"shear": "face"})
FORMS = pytest.mark.parametrize("model", [PLAIN, FACE], ids=["cell", "face"])


def free_block(gradient: object = ((1.0, 0.0), (0.0, 1.0)), dx: float = 0.005, **parts: object):
    """A scene of a free block that nothing breaks, and its lifted positions x = F X."""
    scene = small_scene(dx=dx, base=FREE, **{"foam": UNBREAKABLE, "model": PLAIN, **parts})
    return scene, reference_positions(scene) @ np.array(gradient).T + LIFT


def uniform_stress(scene, F: np.ndarray, sigma: tuple[float, float], tau: float) -> np.ndarray:
    """Node forces under one first Piola stress: none inside, one face's where one is missing.

    Shear is of bonds, which have whole faces in the outermost rows and columns too, or of cells,
    which end there: a corner has half a face of each side.
    """
    block, inverse = scene.block, 1 / np.linalg.norm(F, axis=0)
    forces = np.zeros((block.columns, block.rows, 2))
    normal = F @ np.diag(np.array(sigma) * inverse)
    _add_faces(forces, normal, block, 1.0)
    _add_faces(forces, F @ [[0.0, tau], [tau, 0.0]], block, scene.model.shear == "face" or 0.5)
    return forces


def _add_faces(forces: np.ndarray, P: np.ndarray, block: Block, at_ends: float) -> None:
    """Add a stress on the faces of a block; those at the ends of a side are so much of others."""
    along_x, along_y = np.ones((block.columns, 1)), np.ones((block.rows, 1))
    for along in (along_x, along_y):
        along[[0, -1]] = at_ends
    left, below = along_y * P[:, 0] * block.dy, along_x * P[:, 1] * block.dx
    forces[0] += left * block.depth
    forces[-1] -= left * block.depth
    forces[:, 0] += below * block.depth
    forces[:, -1] -= below * block.depth


@pytest.mark.parametrize("dx", [0.005, 0.003])
@pytest.mark.parametrize(
    ("e", "stress"),
    [
        (0.04, 0.04 * 2.78e6),
        (-0.04, -0.04 * 2.78e6),
        (-0.3, -1.39e5),
        (-0.8, -1.39e5),
        (-0.875, -1.39e5 * math.exp(0.5)),
        (-0.9, -1.39e5 * math.e),
    ],
)
def test_a_uniaxial_patch_carries_eq_26(e: float, stress: float, dx: float) -> None:
    """The nominal stress times the face on the end rows, and nothing anywhere else."""
    for axis in (0, 1):
        F = np.eye(2)
        F[axis, axis] += e
        scene, position = free_block(F, dx)
        sigma = (stress, 0.0) if axis == 0 else (0.0, stress)
        found = node_forces(scene, position=position)
        # the strain of a narrow bond, and with it the stress, rounds in proportion
        np.testing.assert_allclose(found, uniform_stress(scene, F, sigma, 0.0), atol=ROUNDING)


def test_the_patch_starts_from_a_scene_alone() -> None:
    """Without the bench's hands on the state: stretched by 3 % on a held base, top row in play."""
    start = Start(deformation_gradient=((1.0, 0.0), (0.0, 1.03)))
    scene = small_scene(base=Base(kind="held"), start=start)
    expected = uniform_stress(scene, np.diag([1.0, 1.03]), (0.0, 0.03 * 2.78e6), 0.0)
    expected[:, 0, 1] = 0.0  # held
    np.testing.assert_allclose(node_forces(scene), expected, atol=ROUNDING)


@pytest.mark.parametrize("dx", [0.005, 0.003])
@pytest.mark.parametrize("gamma", [0.09, -0.04, 0.6])
@FORMS
def test_a_simple_shear_patch_carries_eq_25(gamma: float, dx: float, model: Model) -> None:
    """S_12 = G gamma; the bonds across the layer also stretch, by sqrt(1 + gamma^2)."""
    F = np.array([[1.0, gamma], [0.0, 1.0]])
    scene, position = free_block(F, dx, model=model)
    stretch = math.hypot(gamma, 1.0)
    expected = uniform_stress(scene, F, (0.0, 2.78e6 * (stretch - 1.0)), 0.84e6 * gamma)
    np.testing.assert_allclose(node_forces(scene, position=position), expected, atol=ROUNDING)


@pytest.mark.parametrize("angle", [1e-3, 0.3, 1.0, math.pi / 2, 2.5, math.pi])
@FORMS
def test_a_rigid_rotation_gives_no_force(angle: float, model: Model) -> None:
    c, s = math.cos(angle), math.sin(angle)
    scene, position = free_block(((c, -s), (s, c)), model=model)
    np.testing.assert_allclose(node_forces(scene, position=position), 0.0, atol=ROUNDING)


def test_a_small_rotation_by_the_scene_alone_gives_no_force() -> None:
    """Of all that does not dip into the floor: the half that turns up."""
    c, s = math.cos(0.2), math.sin(0.2)
    start = Start(deformation_gradient=((c, -s), (s, c)))
    scene = small_scene(base=FREE, start=start, model=PLAIN)
    forces = node_forces(scene)
    np.testing.assert_allclose(forces[COLUMNS // 2 :], 0.0, atol=ROUNDING)
    assert forces[0, 0, 1] > 1.0  # the corner that does dip is pushed up


@FORMS
def test_forces_turn_with_the_block(model: Model) -> None:
    """A distorted, partly crushed and broken block, turned, has the same forces, turned."""
    scene, position = free_block(model=model)
    start = distorted(scene, position, seed=1)
    c, s = math.cos(1.1), math.sin(1.1)
    Q = np.array([[c, -s], [s, c]])
    turned = {**start, "position": (start["position"] - LIFT) @ Q.T + LIFT}
    np.testing.assert_allclose(
        node_forces(scene, **turned), node_forces(scene, **start) @ Q.T, atol=ROUNDING
    )


def distorted(scene, position: np.ndarray, seed: int) -> dict:
    """Random positions (bonds by 4 % or so), histories, and a quarter of the bonds broken."""
    rng = np.random.default_rng(seed)
    block = scene.block
    noise = rng.uniform(-0.02, 0.02, position.shape) * [block.dx, block.dy]
    a, b = (COLUMNS - 1, ROWS), (COLUMNS, ROWS - 1)
    return {
        "position": position + noise,
        "worst_a": -rng.uniform(0.0, 0.9, a) * rng.integers(0, 2, a),
        "worst_b": -rng.uniform(0.0, 0.9, b) * rng.integers(0, 2, b),
        "broken_a": {tuple(map(int, k)) for k in np.argwhere(rng.random(a) < 0.25)},
        "broken_b": {tuple(map(int, k)) for k in np.argwhere(rng.random(b) < 0.25)},
    }


@pytest.mark.parametrize("dx", [0.005, 0.003])
@FORMS
def test_dashpots_drag_on_what_holds_together(model: Model, dx: float) -> None:
    """The same state in motion: 5 m/s at random, where dashpots outweigh the stresses.

    tau K on the rate of a bond's length, tau G on that of a cell's shear strain.
    One step of 1e-12 s: forward differences err by (c/m) dt = 3e-6, rounding by 1e-9, relatively.
    """
    scene, position = free_block(dx=dx, numerics=numerics(dt=1e-12), model=model)
    start = distorted(scene, position, seed=3)
    velocity = np.random.default_rng(4).uniform(-5.0, 5.0, position.shape)
    with bench(scene, velocity=velocity, **start) as loaded:
        change = loaded.step(1).velocity - velocity
    found = change * (scene.block.node_mass / 1e-12)
    expected = ReferenceLattice(scene, velocity=velocity, **start).node_forces()
    at_rest = ReferenceLattice(scene, **start).node_forces()
    assert np.abs(expected - at_rest).max() > 10.0
    np.testing.assert_allclose(found, expected, atol=1e-5 * np.abs(expected).max())


@pytest.mark.parametrize(("kind", "slides"), [("held", 1), ("gripped", 0)])
def test_bases_hold_the_bottom_row(kind: str, slides: int) -> None:
    """In y, or in both: the same forces, but for the components that the base takes."""
    scene, position = free_block(((0.96, 0.05), (0.03, 0.97)))
    free = node_forces(scene, position=position)
    fixed = node_forces(scene.model_copy(update={"base": Base(kind=kind)}), position=position)
    np.testing.assert_allclose(fixed[:, 1:], free[:, 1:], atol=ROUNDING)
    np.testing.assert_allclose(fixed[:, 0, 0], free[:, 0, 0] * slides, atol=ROUNDING)
    assert np.abs(free[:, 0, 1]).min() > 1.0
    assert not fixed[:, 0, 1].any()


@pytest.mark.parametrize(
    ("kind", "moves"), [("held", [1, 0]), ("gripped", [0, 0]), ("floor", [1, 1])]
)
def test_what_a_base_holds_starts_at_rest(kind: str, moves: list[int]) -> None:
    """A start that would set the bottom row going, by (1, 2) m/s at 5 mm from its middle."""
    spin = Start(velocity_gradient=((200.0, 30.0), (400.0, 50.0)))
    with bench(small_scene(base=Base(kind=kind), start=spin)) as loaded:
        velocity = loaded.snapshots()[0].velocity
    x = reference_positions(small_scene())[:, 0, 0]
    expected = x[:, None] * [200.0, 400.0] * moves
    np.testing.assert_allclose(velocity[:, 0], expected, rtol=1e-12)
    np.testing.assert_allclose(velocity[-1, 1], [200 * x[-1] + 0.15, 400 * x[-1] + 0.25])
