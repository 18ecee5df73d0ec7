"""Shear forces from an energy: what a free block without damping keeps, and the face form loses."""

import numpy as np
import pytest
from bench import COLUMNS, ROWS, numerics, run_to, small_scene
from reference_lattice import ReferenceLattice, reference_positions

from taichi_foam.records.snapshot import Snapshot
from taichi_foam.scene import Base, Foam, Model, Scene

K = 2.78e6
LIFT = np.array([0.0, 0.5])
TIME, COUNTS = 4e-4, np.array([80, 160, 320])


def block(shear: str) -> Scene:
    return small_scene(
        base=Base(kind="floor"),
        foam=Foam(tensile_strain=1.0, shear_strain=2.0),
        model=Model(self_contact=False, shear=shear),
        numerics=numerics(damping_time=0.0),
    )


def torn() -> dict:
    """A block in stretch, shear and spin, below yield, with cracks.

    What is broken was crushed by half before: it does not press, so that no force has a kink.
    """
    scene = block("face")
    X = reference_positions(scene)
    velocity = (X - X.mean(axis=(0, 1))) @ np.array([[30.0, 20.0], [-35.0, 40.0]]).T
    velocity += [3.0, -2.0]
    worst_a, worst_b = np.zeros((COLUMNS - 1, ROWS)), np.zeros((COLUMNS, ROWS - 1))
    worst_a[4, :6] = worst_b[:4, 12] = -0.5
    return {
        "position": X + LIFT,
        "velocity": velocity,
        "broken_a": [(4, j) for j in range(6)],
        "broken_b": [(i, 12) for i in range(4)],
        "worst_a": worst_a,
        "worst_b": worst_b,
    }


def energy(shear: str, start: dict, now: Snapshot) -> float:
    """Kinetic, elastic and shear energy [J], from the NumPy lattice."""
    scene = block(shear)
    broken = {name: set(start[name]) for name in ("broken_a", "broken_b")}
    lattice = ReferenceLattice(scene, now.position, **broken)
    cell = scene.block.dx * scene.block.dy * scene.block.thickness
    total = (
        0.5 * scene.block.node_mass * (now.velocity**2).sum()
        + lattice.shear_energies(now.position).sum()
    )
    for axis, i, j in lattice.bonds():
        worst = (now.e_min_a, now.e_min_b)[axis][i, j]
        if lattice.whole(axis, i, j):
            assert worst > -0.05
            e, _ = lattice.strains(axis, i, j)
            total += 0.5 * K * e**2 * cell
        else:
            assert worst == -0.5
    return float(total)


def spin(now: Snapshot) -> float:
    """Angular momentum about the origin over the mass of a node [m2/s]."""
    x, v = now.position, now.velocity
    return float((x[..., 0] * v[..., 1] - x[..., 1] * v[..., 0]).sum())


@pytest.fixture(scope="module")
def ends() -> dict[str, list[Snapshot]]:
    """States at one instant after ever shorter steps, in both forms."""
    start = torn()
    return {
        shear: [run_to(block(shear), TIME, n, **start) for n in COUNTS]
        for shear in ("face", "variational")
    }


def at_start() -> Snapshot:
    now = run_to(block("face"), 1e-12, 1, **torn())
    start = torn()
    return type(now)(**{**vars(now), "position": start["position"], "velocity": start["velocity"]})


@pytest.mark.parametrize("shear", ["face", "variational"])
def test_both_forms_keep_the_momentum_to_rounding(ends: dict, shear: str) -> None:
    """320 steps of a few dozen sums each, at random: 1e-14 of the speeds' sum."""
    velocity = torn()["velocity"]
    for now in ends[shear]:
        lost = np.abs((now.velocity - velocity).sum(axis=(0, 1)))
        assert np.all(lost < 1e-13 * np.abs(velocity).sum())
    assert np.abs(ends[shear][-1].velocity - velocity).max() > 1.0


def order(errors: np.ndarray) -> np.ndarray:
    return np.log2(errors[:-1] / errors[1:])


def test_a_variational_block_keeps_its_energy_to_the_integrators_order(ends: dict) -> None:
    """Runge-Kutta's own error, at least of the fourth order: in linear vibration of the fifth."""
    first = energy("variational", torn(), at_start())
    last = np.array([energy("variational", torn(), now) for now in ends["variational"]])
    errors = np.abs(last / first - 1.0)
    assert np.all(order(errors) > 3.8)
    assert errors[-1] < 1e-7


def test_a_variational_block_keeps_its_angular_momentum_to_the_integrators_order(
    ends: dict,
) -> None:
    first = spin(at_start())
    errors = np.abs(np.array([spin(now) for now in ends["variational"]]) / first - 1.0)
    assert np.all(order(errors) > 3.8)
    assert errors[-1] < 1e-8


def test_the_face_form_keeps_neither_whatever_the_step(ends: dict) -> None:
    """What it loses or gains is a property of its forces: finer steps do not change it."""
    drift = {
        "energy": [energy("face", torn(), now) - energy("face", torn(), at_start())
                   for now in ends["face"]],
        "spin": [spin(now) - spin(at_start()) for now in ends["face"]],
    }  # fmt: skip
    scale = {"energy": energy("face", torn(), at_start()), "spin": abs(spin(at_start()))}
    for name, found in drift.items():
        assert abs(found[-1]) > 1e-4 * scale[name], name
        assert found[-2] == pytest.approx(found[-1], rel=1e-2), name
