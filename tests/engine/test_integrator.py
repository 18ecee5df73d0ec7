"""Time stepping: its order, its stability limit, and what happens beyond it."""

import math

import numpy as np
import pytest
from bench import FREE, LIFT, UNBREAKABLE, bench, numerics, run_to, small_scene
from reference_lattice import reference_positions

from taichi_foam.errors import RunError
from taichi_foam.scene import (
    Block,
    FlatBlock,
    Foam,
    Model,
    Numerics,
    Output,
    Scene,
    Start,
)
from taichi_foam.simulation.simulate import run

RETARDATION = 1e-6 / 0.057


@pytest.mark.parametrize("damping_time", [0.0, RETARDATION])
def test_runge_kutta_is_of_order_four_while_nothing_breaks(damping_time: float) -> None:
    """Free vibration in stretch, shear and spin, below yield: the equations are smooth.

    Steps from 5 us, w dt = 0.6 for the fastest mode, down by factors of sqrt 2; the yardstick has
    an eighth of the shortest but one. What is left of the next order, and of the yardstick's own
    error (1/8^4 of the last), moves the fitted slope by less than 0.15.
    """
    scene = small_scene(base=FREE, numerics=numerics(damping_time=damping_time))
    X = reference_positions(scene)
    velocity = (X - X.mean(axis=(0, 1))) @ np.array([[40.0, 30.0], [-50.0, 60.0]]).T
    start = {"position": X + LIFT, "velocity": velocity}
    time, counts = 4e-4, np.array([80, 113, 160, 226])
    exact = run_to(scene, time, 1280, **start)
    assert exact.e_min_a.min() > -0.05
    assert exact.e_min_b.min() > -0.05
    assert not exact.broken_a.any()
    assert not exact.broken_b.any()
    errors = [
        np.abs(run_to(scene, time, n, **start).position - exact.position).max() for n in counts
    ]
    order = -np.polyfit(np.log(counts), np.log(errors), 1)[0]
    assert order == pytest.approx(4.0, abs=0.15)
    moved = np.abs(exact.position - start["position"]).max()
    assert moved > 1e5 * max(errors)  # there was something to integrate


# The stiffest mode of a lattice of square cells, nodes alternating along the motion: bonds give
# 4 K / (rho dx^2), and the means of a cell's sides vanish for it. RK4 follows an undamped mode up
# to w dt = 2 sqrt 2.
K, RHO, CELL = 2.78e6, 25.6, 0.005
STIFFEST = 2.0 * math.sqrt(K / RHO) / CELL
LIMIT = 2.0 * math.sqrt(2.0) / STIFFEST


def swing(dt: float, steps: int) -> float:
    """Largest displacement [m] after shaking a free, undamped block at random by 0.1 mm/s."""
    scene = small_scene(base=FREE, foam=UNBREAKABLE, numerics=numerics(dt=dt, damping_time=0.0))
    position = reference_positions(scene) + LIFT
    velocity = np.random.default_rng(5).uniform(-1e-4, 1e-4, position.shape)
    with bench(scene, position=position, velocity=velocity) as loaded:
        return float(np.abs(loaded.step(steps).position - position).max())


def test_the_linear_lattice_is_stable_up_to_runge_kuttas_limit() -> None:
    """Below it no mode grows: displacements stay below 2 * 0.1 mm/s / w_min, w_min = c_s / 5 cells.

    Beyond it the stiffest mode grows by |1 - z^2/2 + z^4/24 - i(...)| a step, 4 % at 1.05 limits.
    """
    assert swing(0.97 * LIMIT, 3000) < 1e-5
    assert not swing(1.05 * LIMIT, 3000) < 1e-3
    assert not swing(1.5 * LIMIT, 100) < 1e-3


@pytest.mark.parametrize(
    ("values", "foam", "damping"),
    [
        ({}, Foam(), "stiffness"),
        ({"damping_time": 0.0}, Foam(), "stiffness"),
        ({"damping_time": 2e-4}, Foam(), "stiffness"),
        ({"contact_stiffness": 1000.0}, Foam(), "stiffness"),
        ({}, Foam(shear_modulus=8e6), "stiffness"),
        ({"damping_time": 1e-4}, Foam(shear_modulus=8e6), "stiffness"),
        ({}, Foam(crushed_tensile_stress=5e6), "stiffness"),
    ],
    ids=[
        "default",
        "undamped",
        "overdamped",
        "stiff contact",
        "stiff in shear",
        "viscous in shear",
        "stiff crushed",
    ],
)
def test_the_automatic_step_is_stable_with_no_safety_at_all(
    values: dict, foam: Foam, damping: str
) -> None:
    """safety = 1, an impact that crushes: the ledger would show what an unstable mode makes.

    RK4 at the edge of stability is inaccurate for the fastest modes, so that the energies only
    close to some per cent of what the impact brings; an instability gains orders of magnitude.
    """
    scene = small_scene(
        impactor=FlatBlock(width=0.03, mass=0.2, velocity=5.0),
        numerics=Numerics(end=6e-3, safety=1.0, **values),
        foam=foam,
        model=Model(damping=damping),
    )
    history = run(scene).history
    energy = history["impactor_kinetic_J"][0]
    assert history["crushing_J"][-1] > 0.05 * energy
    assert np.abs(history["residual_J"]).max() < 0.02 * energy
    assert history["foam_kinetic_J"].max() < 0.2 * energy


def test_the_automatic_step_shrinks_with_the_stiffness_of_densified_foam() -> None:
    """Started at 90 % of crush, where Eq. 26 has the slope 0.05 K e (0.5 / 0.05 + 0.05 / 0.05^2).

    That is 4.1 K: 0.05 is the way left to locking, 0.1 that from densification, the exponent 1.
    """
    slope = 0.05 * math.e * (0.5 / 0.05 + 0.5 * 0.1 / 0.05**2)
    longest = 2.0 * math.sqrt(2.0) / (2.0 * math.sqrt(slope * K / RHO) / CELL)
    start = Start(deformation_gradient=((1.0, 0.0), (0.0, 0.1)))
    quick = Numerics(end=1e-4, damping_time=0.0)
    result = run(small_scene(start=start, numerics=quick))
    assert result.history["dt_s"][0] < longest
    assert result.history["dt_s"][0] < run(small_scene(numerics=quick)).history["dt_s"][0]
    assert np.abs(result.history["residual_J"]).max() < 0.01 * result.history["strain_J"][0]


def test_an_absurd_step_stops_the_run_and_says_when_and_where() -> None:
    """0.1 ms is five times Runge-Kutta's limit: what it gives is no result, finite or not."""
    scene = small_scene(
        impactor=FlatBlock(width=0.03, velocity=5.0), numerics=Numerics(dt=1e-4, end=0.05)
    )
    with pytest.raises(RunError, match=r"[0-9.]+ ms.*node \(\d+, \d+\)") as failure:
        run(scene)
    (left,) = failure.value.results
    assert 0.0 < left.snapshots[-1].time < 0.05


def test_rows_and_snapshots_come_at_their_times() -> None:
    """Many short calls: a row every 20 us and a snapshot every 50 us, at most one step late."""
    scene = Scene(
        block=Block(mass_points="cells", width=0.05, height=0.1, columns=10, rows=20),
        numerics=Numerics(end=4e-3),
        output=Output(history_interval=2e-5, snapshot_interval=5e-5),
    )
    result = run(scene)
    step = result.run["dt_max_s"]
    late = result.history["time_s"][:-1] - 2e-5 * np.arange(200)
    assert np.all((late > -1e-12) & (late <= step))
    late = np.array([s.time for s in result.snapshots]) - 5e-5 * np.arange(81)
    assert np.all((late > -1e-12) & (late <= step))
    assert result.history["time_s"][-1] == pytest.approx(4e-3, abs=step)
