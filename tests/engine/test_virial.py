"""Stress about mass points, the virial of all forces on them, against closed forms."""

from dataclasses import replace

import numpy as np
import pytest
from bench import COLUMNS, FREE, LIFT, PLAIN, ROWS, bench, node_forces, numerics, small_scene
from reference_lattice import reference_positions

from taichi_foam.engine import transfer, virial
from taichi_foam.engine.stresses import cell_stresses
from taichi_foam.laws.bond import Curve
from taichi_foam.scene import Base, FlatBlock, Foam, Model, Numerics, Output, TabulatedFoam, Wedge
from taichi_foam.simulation.simulate import run

FOAM = Foam()
K, G, PLATEAU = FOAM.youngs_modulus, FOAM.shear_modulus, FOAM.plateau_stress
INNER = np.s_[1:-1, 1:-1]
SINGLE = 3e-7  # rounding of stresses that are stored with 32 bits


def deformed(gradient: list, **parts: object) -> tuple:
    """The small block with a deformation gradient, its bonds never crushed further than now."""
    scene = small_scene(base=FREE, numerics=numerics(), **parts)
    position = reference_positions(scene) @ np.array(gradient).T
    found = {"position": position + LIFT}
    for axis, name in enumerate(("worst_a", "worst_b")):
        length = np.linalg.norm(np.diff(position, axis=axis), axis=-1) / 0.005 - 1.0
        found[name] = np.minimum(length, 0.0)
    return scene, found


def stresses(scene, **start: object) -> np.ndarray:
    with bench(scene, **start) as loaded:
        return virial.stresses(loaded.lattice, 0, scene.block).astype(float)


@pytest.mark.parametrize(
    ("strain", "expected"), [(0.02, 0.02 * K), (-0.03, -0.03 * K), (-0.5, -PLATEAU)]
)
def test_a_block_in_uniaxial_strain_has_the_laws_stress_in_every_inner_cell(
    strain: float, expected: float
) -> None:
    found = _of(deformed([[1.0, 0.0], [0.0, 1.0 + strain]]))[INNER]
    np.testing.assert_allclose(found[..., 1], expected, rtol=1e-6)
    assert np.abs(found[..., [0, 2]]).max() < SINGLE * K


def _of(pair: tuple) -> np.ndarray:
    return stresses(pair[0], **pair[1])


def test_a_sheared_block_has_the_shear_stress() -> None:
    gamma = 1e-3
    scene, start = deformed([[1.0, gamma], [0.0, 1.0]])
    found = stresses(scene, **start)[INNER]
    np.testing.assert_allclose(found[..., 2], G * gamma, rtol=1e-5)
    # normal stresses are of second order: of upright bonds that are longer by gamma^2 / 2
    assert np.abs(found[..., :2]).max() < 2 * K * gamma**2


@pytest.mark.parametrize("angle", [0.3, 2.0])
def test_the_tensor_turns_with_the_block(angle: float) -> None:
    """A turned block has Q sigma Q^T."""
    F = np.array([[1.01, 0.004], [0.0, 0.97]])
    c, s = np.cos(angle), np.sin(angle)
    Q = np.array([[c, -s], [s, c]])
    scene, start = deformed(F.tolist())
    straight = stresses(scene, **start)
    scene, start = deformed((Q @ F).tolist())
    turned = stresses(scene, **start)
    expected = Q @ _matrix(straight) @ Q.T
    np.testing.assert_allclose(_matrix(turned), expected, atol=SINGLE * K)
    assert np.abs(_matrix(straight)).max() > 0.02 * K


def _matrix(found: np.ndarray) -> np.ndarray:
    xx, yy, xy = np.moveaxis(found, -1, 0)
    return np.stack([np.stack([xx, xy], -1), np.stack([xy, yy], -1)], -1)


@pytest.mark.parametrize("crushed_room", [True, False])
def test_all_of_it_is_the_moment_of_the_forces(crushed_room: bool) -> None:
    """Of dust without order, folded, torn and pressed: sum of V sigma = -sum of x (x) f.

    f are the forces on the mass points, by which the engine moves them. Of each bond whole arm and
    force are in the sum, and of each cell that resists being smaller all of its pressure.
    """
    scene = small_scene(
        base=FREE,
        foam=Foam(tensile_strain=2.0, shear_strain=2.0, shear_modulus=1e3),
        model=Model(self_contact=False) if crushed_room else PLAIN,
        numerics=numerics(damping_time=0.0),
    )
    rng = np.random.default_rng(3)
    position = reference_positions(scene) @ np.array([[0.7, 0.2], [0.1, 0.6]]) + LIFT
    position += rng.uniform(-1e-3, 1e-3, position.shape)
    start = {"position": position}
    for axis, name in enumerate(("worst_a", "worst_b")):
        length = np.linalg.norm(np.diff(position, axis=axis), axis=-1) / 0.005 - 1.0
        start[name] = np.minimum(length, -rng.uniform(0.0, 0.6, length.shape))
    whole = stresses(scene, **start)
    # volumes as the stress has them: by the mean sides of each mass point's bonds
    sides = []
    for axis in range(2):
        d = np.diff(position, axis=axis)
        pads = [[(0, 0), (0, 0)] for _ in range(2)]
        pads[0][axis], pads[1][axis] = (1, 0), (0, 1)
        total = np.sum([np.pad(d, [*pad, (0, 0)]) for pad in pads], axis=0)
        count = np.sum([np.pad(np.ones(d.shape[:2]), pad) for pad in pads], axis=0)
        worst = start[("worst_a", "worst_b")[axis]]
        left = 0.005 * (1 + np.sum([np.pad(worst, pad) for pad in pads], axis=0) / count)
        sides.append((total / count[..., None], left))
    (a, wide), (b, tall) = sides
    area = np.maximum(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0], 0.5 * wide * tall)
    volume = area * scene.block.depth
    found = _matrix((whole * volume[..., None]).sum(axis=(0, 1)))
    forces = node_forces(scene, **start)
    moment = -np.einsum("ija,ijb->ab", position, forces)
    np.testing.assert_allclose(found, 0.5 * (moment + moment.T), rtol=1e-4, atol=1e-4)
    assert np.abs(found).max() > 1.0


PRESSED = {
    "gripped": (Base(kind="gripped"), 0.02),
    "on a floor": (Base(kind="floor", friction=0.0), 0.02),
    "crushed": (Base(kind="gripped"), 0.5),
}


@pytest.mark.parametrize("name", PRESSED)
def test_every_row_of_a_pressed_block_carries_the_contact_force(name: str) -> None:
    """From the row that the plate touches to the one that is held or lies on the floor.

    Slowly, so that inertia counts for little: rho c v is 1 in 100 of the plateau, and it rings.
    """
    base, strain = PRESSED[name]
    speed = 0.1 if strain < 0.1 else 0.5
    curve = Curve(strain=[0.0, 0.05, 0.9], stress=[0.0, 0.1e6, 0.3e6])
    scene = small_scene(
        base=base,
        foam=TabulatedFoam(curve=curve),
        impactor=FlatBlock(width=0.08, mass=1e4, velocity=speed, friction=0.0),
        numerics=Numerics(end=strain * 0.095 / speed, damping_time=2e-4),
        output=Output(snapshot_interval=0.2, history_interval=1e-3, stress=True),
    )
    result = run(scene)
    last, force = result.snapshots[-1], result.history["contact_force_N"][-1]
    x = last.position[..., 0]
    width = np.ptp(x, axis=0) * COLUMNS / (COLUMNS - 1)
    rows = last.stress[..., 1].astype(float).mean(axis=0) * width * scene.block.depth
    assert rows.shape == (ROWS,)
    np.testing.assert_allclose(rows, -force, rtol=0.02)
    if name == "crushed":
        assert last.e_min_b.min() < -0.4


def test_stresses_change_no_bit_of_a_run() -> None:
    """Taken after every step or never; a wedge breaks and crushes the block, pieces touch."""
    scene = small_scene(
        base=Base(kind="floor"),
        impactor=Wedge(angle_deg=60, shank_width=0.02, mass=0.1, velocity=25.0, friction=0.5),
        numerics=numerics(),
    )
    with bench(scene) as loaded:
        loaded.step(600)
        without = transfer.take(loaded.lattice, 0)
    with bench(scene) as loaded:
        for _ in range(600):
            loaded.step(1)
            found = virial.stresses(loaded.lattice, 0, scene.block)
        taken = transfer.take(loaded.lattice, 0)
    assert np.isfinite(found).all()
    assert len(without.neighbours["pairs"]) > 0
    for name, values in without.to_arrays().items():
        np.testing.assert_array_equal(values, taken.to_arrays()[name], err_msg=name)


def test_stresses_of_a_stored_instant_are_worked_out_again() -> None:
    """They are those that are kept, without friction, softening, pieces and dashpots of contact.

    A bond's own strength does not matter to what it carries.
    """
    scene = small_scene(
        impactor=FlatBlock(width=0.02, mass=0.5, velocity=4.0, friction=0.0),
        foam=Foam(softening=False, strength_scatter=0.2, strength_seed=3),
        model=Model(self_contact=False),
        numerics=Numerics(end=2e-3, contact_damping=0.0),
        output=Output(stress=True),
    )
    last = run(scene).snapshots[-1]
    again = cell_stresses(scene, replace(last, stress=None))
    assert cell_stresses(scene, last) is last.stress
    np.testing.assert_allclose(again, last.stress, atol=1e-3 * PLATEAU)
    assert last.stress.min() < -PLATEAU
    assert last.stress.max() > 0.2 * PLATEAU
