"""What a free block keeps: energy, momentum and angular momentum; and what the face form loses."""

from dataclasses import replace

import numpy as np
import pytest
from bench import COLUMNS, LIFT, PLAIN, ROWS, UNBREAKABLE, bench, numerics, run_to, small_scene
from reference_lattice import ReferenceLattice, reference_positions

from taichi_foam.engine import transfer
from taichi_foam.engine.state import WORK, State, initial_state
from taichi_foam.records.snapshot import Snapshot
from taichi_foam.scene import Base, Block, FlatBlock, Output, Scene, Start
from taichi_foam.scene.filling import filling

K = 2.78e6
TIME, COUNTS = 4e-4, np.array([80, 160, 320])


def block(shear: str) -> Scene:
    return small_scene(
        base=Base(kind="floor"),
        foam=UNBREAKABLE,
        model=PLAIN.model_copy(update={"shear": shear}),
        numerics=numerics(damping_time=0.0),
    )


def torn() -> dict:
    """A block in stretch, shear and spin, below yield, with cracks.

    What is broken was crushed by half before: it does not press, so that no force has a kink.
    """
    scene = block("cell")
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
    cell = scene.block.dx * scene.block.dy * scene.block.depth
    total = (
        0.5 * scene.block.node_mass * (now.velocity**2).sum()
        + lattice.shear_energies(lattice.corners()).sum()
    )
    for axis, worst in enumerate((now.e_min_a, now.e_min_b)):
        whole = lattice.whole(axis)
        assert np.all(worst[whole] > -0.05)
        assert np.all(worst[~whole] == -0.5)
        e, _ = lattice.strains(axis)
        total += 0.5 * K * (e[whole] ** 2).sum() * cell
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
        for shear in ("face", "cell")
    }


def at_start() -> Snapshot:
    now = run_to(block("cell"), 1e-12, 1, **torn())
    start = torn()
    return type(now)(**{**vars(now), "position": start["position"], "velocity": start["velocity"]})


@pytest.mark.parametrize("shear", ["face", "cell"])
def test_both_forms_keep_the_momentum_to_rounding(ends: dict, shear: str) -> None:
    """320 steps of a few dozen sums each, at random: 1e-14 of the speeds' sum."""
    velocity = torn()["velocity"]
    for now in ends[shear]:
        lost = np.abs((now.velocity - velocity).sum(axis=(0, 1)))
        assert np.all(lost < 1e-13 * np.abs(velocity).sum())
    assert np.abs(ends[shear][-1].velocity - velocity).max() > 1.0


def order(errors: np.ndarray) -> np.ndarray:
    return np.log2(errors[:-1] / errors[1:])


def test_a_block_keeps_its_energy_to_the_integrators_order(ends: dict) -> None:
    """Runge-Kutta's own error, at least of the fourth order: in linear vibration of the fifth."""
    first = energy("cell", torn(), at_start())
    last = np.array([energy("cell", torn(), now) for now in ends["cell"]])
    errors = np.abs(last / first - 1.0)
    assert np.all(order(errors) > 3.8)
    assert errors[-1] < 1e-7


def test_a_block_keeps_its_angular_momentum_to_the_integrators_order(ends: dict) -> None:
    first = spin(at_start())
    errors = np.abs(np.array([spin(now) for now in ends["cell"]]) / first - 1.0)
    # until rounding, 1e-14, is reached
    assert order(errors)[0] > 3.4
    assert errors[-1] < 1e-13


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


def spinning(cracked: bool, **parts: object) -> tuple[Scene, State, np.ndarray]:
    """A block off the floor that spins at 100 rad/s and stretches, with all dashpots on.

    With it comes the mass (I, J, 1) of its mass points [kg].
    """
    cuts = ((-0.03, 0.06, 0.005, 0.03), (0.0, 0.02, 0.0, 0.07)) if cracked else ()
    scene = small_scene(
        base=Base(kind="floor"), start=Start(cuts=cuts), numerics=numerics(), **parts
    )
    state = initial_state(scene)
    arm = state.position - state.position.mean(axis=(0, 1))
    velocity = 100.0 * np.stack([-arm[..., 1], arm[..., 0]], axis=-1)
    velocity += arm * [20.0, -30.0]
    state = replace(state, position=state.position + np.array([0.0, 1.0]), velocity=velocity)
    return scene, state, filling(scene.block).mass[..., None]


FREE_BLOCKS = {
    "whole": (False, {}),
    "cracked": (True, {}),
    "flat cells": (True, {"dy": 0.003}),
    "on faces": (True, {"block": Block(
        width=0.05, height=0.095, columns=COLUMNS, rows=ROWS, mass_points="faces")}),
}  # fmt: skip


@pytest.mark.parametrize("name", FREE_BLOCKS)
def test_a_damped_block_that_spins_keeps_its_angular_momentum(name: str) -> None:
    """After 4 ms in the air, of the sum of what its mass points have, about where it was.

    All forces are along bonds and diagonals, and along what joins two pieces that meet. What is
    left is the integrator's: of cracked foam, whose forces have kinks, the more.
    """
    cracked, parts = FREE_BLOCKS[name]
    scene, state, mass = spinning(cracked, **parts)
    with bench(scene) as loaded:
        transfer.load(loaded.lattice, 0, scene, state)
        transfer.set_pause(loaded.lattice, np.array([4e-3]))
        while transfer.take(loaded.lattice, 0).clock["time"] < 4e-3 * (1 - 1e-9):
            loaded.step(500)
        after = transfer.take(loaded.lattice, 0)
    assert after.work[:, WORK.dashpots].sum() > 1e-3 * kinetic(mass, state)
    middle = state.position.mean(axis=(0, 1))

    def angular_momentum(now: State) -> float:
        x = now.position - middle
        return float((mass[..., 0] * _cross(x, now.velocity)).sum())

    largest = float((mass[..., 0] * np.abs(_cross(state.position - middle, state.velocity))).sum())
    lost = abs(angular_momentum(after) - angular_momentum(state)) / largest
    assert lost < (1e-10 if cracked else 1e-12)


def _cross(x: np.ndarray, v: np.ndarray) -> np.ndarray:
    return x[..., 0] * v[..., 1] - x[..., 1] * v[..., 0]


def kinetic(mass: np.ndarray, state: State) -> float:
    return float(0.5 * (mass * state.velocity**2).sum())


def test_a_turning_impact_in_the_air_keeps_angular_momentum_to_the_integrators_order() -> None:
    """Body and foam, both free, the floor far below: a tilted plate rocks on foam below yield.

    Body and block turn each other by contact forces that act at one point. What is left is the
    integrator's: at least of third order, as friction springs stretch along the chord of a step.
    """
    body = FlatBlock(
        width=0.03, height=0.02, mass=0.5, inertia=1e-4, x=0.004, velocity=0.2, velocity_x=0.02,
        spin=0.5, guided=False, friction=0.5,
    )  # fmt: skip
    time, lost = 1e-3, []
    for steps in (400, 800, 1600):
        scene = small_scene(
            base=Base(kind="floor"),
            impactor=body,
            numerics=numerics(dt=time / steps),
            output=Output(history_interval=time / 2, snapshot_interval=1.0),
        )
        state = initial_state(scene)
        up = np.array([0.0, 1.0])
        raised = {**state.body, "y": state.body["y"] + 1.0 - 5e-6}  # in touch from the start
        state = replace(state, position=state.position + up, body=raised)
        with bench(scene) as loaded:
            transfer.load(loaded.lattice, 0, scene, state)
            transfer.set_pause(loaded.lattice, np.array([1.0]))
            loaded.step(steps)
            after = transfer.take(loaded.lattice, 0)
        assert after.clock["broken"] == 0
        before, now = (_of_both(scene, each) for each in (state, after))
        scale = abs(body.moment_of_inertia * after.turn["spin"]) + 1e-3
        lost.append(abs(now - before) / scale)
    assert abs(after.turn["spin"] - body.spin) > 0.02
    assert lost[-1] < 1e-8
    # to rounding a metre up, or to the integrator's order
    assert lost[-1] < 1e-11 or np.all(order(np.array(lost)) > 2.8)


def _of_both(scene: Scene, state: State) -> float:
    """Angular momentum [kg m2/s] of block and body about the body's place at the start."""
    body = scene.impactor
    assert body is not None
    mass = filling(scene.block).mass
    start = np.array([body.x, scene.contact_height + 1.0])
    total = float((mass * _cross(state.position - start, state.velocity)).sum())
    reference = np.array([body.x + state.turn["x"], state.body["y"]])
    centre = reference + np.array(body.centre_of_mass)
    velocity = np.array([state.turn["u"], state.body["v"]])
    own = body.moment_of_inertia * state.turn["spin"]
    return total + own + float(body.mass * _cross(centre - start, velocity))
