"""Sound in the lattice: its exact dispersion, the order in the cell size, and its dampings."""

import math

import numpy as np
import pytest
from bench import ROWS, numerics, run_to, small_scene
from reference_lattice import reference_positions
from scipy.linalg import expm

from taichi_foam.scene import Base, Model

K, RHO = 2.78e6, 25.6
SOUND = math.sqrt(K / RHO)  # 330 m/s
LOOSE = Model(self_contact=False)
LINKS = ROWS - 0.5  # a held foot and a free top: the top's mass reaches half a cell beyond it


def measured_frequency(mode: int, dy: float) -> float:
    """Angular frequency [1/s] of a standing wave of (2 mode + 1) quarter waves, plane in x.

    A start with the velocity sin(k s), s from the held row, has the amplitude cos(w t) later on;
    after 1.25 periods of the continuum that is near 0, where it tells w best. RK4 errs by
    (w dt)^4 / 120 = 1e-9 of w; the chain itself is linear.
    """
    scene = small_scene(
        dy=dy, base=Base(kind="held"), model=LOOSE, numerics=numerics(damping_time=0.0)
    )
    X = reference_positions(scene)
    s = X[0, :, 1] - 0.5 * dy
    wave_number = (2 * mode + 1) * 0.5 * math.pi / (LINKS * dy)
    shape = np.sin(wave_number * s)
    velocity = np.zeros_like(X)
    velocity[..., 1] = 0.1 * shape
    time = 1.25 * 2 * math.pi / (wave_number * SOUND)
    after = run_to(scene, time, 400, velocity=velocity)
    amplitude = after.velocity[..., 1].mean(axis=0) @ shape / (0.1 * shape @ shape)
    np.testing.assert_allclose(after.velocity[..., 0], 0.0, atol=1e-9)
    for column in after.velocity[..., 1]:
        np.testing.assert_allclose(column, 0.1 * amplitude * shape, atol=1e-9)
    return (2 * math.pi + math.acos(amplitude)) / time


@pytest.mark.parametrize("mode", [0, 1, 3, 6])
def test_standing_waves_have_the_chains_exact_frequency(mode: int) -> None:
    """w = (2 c / dy) sin(k dy / 2), for masses on springs."""
    dy = 0.005
    wave_number = (2 * mode + 1) * 0.5 * math.pi / (LINKS * dy)
    exact = 2 * SOUND / dy * math.sin(0.5 * wave_number * dy)
    assert measured_frequency(mode, dy) == pytest.approx(exact, rel=1e-8)


def test_the_wave_speed_tends_to_sqrt_k_over_rho_with_the_square_of_the_cell() -> None:
    """One wave of 0.39 m in ever larger cells: dy times 1, 3, 5, 7 with the same count of cells.

    (A bar of 2 m + 1 quarter waves, with cells 2 m + 1 times as large.) The error is
    (k dy)^2 / 24 to leading order, the next term changes it by (k dy)^2 / 80 < 1 % of itself.
    """
    sizes = np.array([1, 3, 5, 7])
    wave = 4 * LINKS * 0.005
    frequencies = [measured_frequency((n - 1) // 2, 0.005 * n) for n in sizes]
    speeds = np.array(frequencies) * wave / (2 * math.pi)
    errors = 1 - speeds / SOUND
    assert np.polyfit(np.log(sizes), np.log(errors), 1)[0] == pytest.approx(2.0, abs=0.01)
    np.testing.assert_allclose(errors, (2 * math.pi / wave * 0.005 * sizes) ** 2 / 24, rtol=0.01)


def test_dashpots_damp_the_chain_as_its_matrix_exponential_says() -> None:
    """Kelvin-Voigt bonds, c = tau k: u'' = -(k/m) D u - tau (k/m) D u', D the chain's Laplacian.

    RK4's error over the run is below t w (w dt)^4 / 120 = 1e-8 of what it starts with.
    """
    tau, time = 1.7e-5, 2e-4
    scene = small_scene(base=Base(kind="held"), model=LOOSE, numerics=numerics(damping_time=tau))
    start = np.random.default_rng(7).uniform(-0.5, 0.5, ROWS)
    start[0] = 0.0
    X = reference_positions(scene)
    velocity = np.zeros_like(X)
    velocity[..., 1] = start
    after = run_to(scene, time, 2000, velocity=velocity)
    n = ROWS - 1
    laplacian = 2 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)
    laplacian[-1, -1] = 1.0  # free top
    laplacian *= K / RHO / 0.005**2
    system = np.block([[np.zeros((n, n)), np.eye(n)], [-laplacian, -tau * laplacian]])
    state = expm(system * time) @ np.concatenate([np.zeros(n), start[1:]])
    for column in after.position[:, 1:, 1] - X[:, 1:, 1]:
        np.testing.assert_allclose(column, state[:n], atol=1e-7 * np.abs(state[:n]).max())
    for column in after.velocity[:, 1:, 1]:
        np.testing.assert_allclose(column, state[n:], atol=1e-7)


def test_absolute_damping_slows_free_flight_and_connection_damping_does_not() -> None:
    """Eqs 28-29 as printed: m v' = -C v, C = beta K = 1e-6 m s * 2.78 MPa = 2.78 N s/m."""
    time = 2e-5
    for damping, rate in (("absolute", 2.78 / (RHO * 0.005**2 * 0.057)), ("bond", 0.0)):
        scene = small_scene(
            base=Base(kind="floor"), model=Model(damping=damping, self_contact=False)
        )
        X = reference_positions(scene) + np.array([0.0, 0.5])
        after = run_to(scene, time, 200, position=X, velocity=np.full_like(X, 3.0))
        np.testing.assert_allclose(after.velocity, 3.0 * math.exp(-rate * time), rtol=1e-9)


def test_shear_runs_at_sqrt_g_over_rho() -> None:
    """A standing wave of a gripped layer, swinging sideways: its upright bonds alone are sheared.

    It is a chain as well, w = (2 c_s / dy) sin(k dy / 2), c_s^2 = G / rho. Cells so wide, 0.5 m,
    that no news from the free sides reaches the middle: over four of them, (w' t / 2)^8 / 8! = 1e-8
    with w' = 2 c / dx. Strains of 5e-6 keep finite strain out, and position round-off of
    2e-16 m over 1 mm to 1e-7 of them.
    """
    dy, speed = 0.001, 1e-3
    scene = small_scene(dx=0.5, dy=dy, model=LOOSE, numerics=numerics(damping_time=0.0))
    X = reference_positions(scene)
    wave_number = 0.5 * math.pi / (LINKS * dy)
    shape = np.sin(wave_number * (X[0, :, 1] - 0.5 * dy))
    velocity = np.zeros_like(X)
    velocity[..., 0] = speed * shape
    omega = 2 * math.sqrt(0.84e6 / RHO) / dy * math.sin(0.5 * wave_number * dy)
    for periods, amplitude in ((1.25, 0.0), (0.5, -1.0)):
        after = run_to(scene, periods * 2 * math.pi / omega, 2000, velocity=velocity)
        for column in after.velocity[4:6, :, 0]:
            np.testing.assert_allclose(column, amplitude * speed * shape, atol=1e-6 * speed)
