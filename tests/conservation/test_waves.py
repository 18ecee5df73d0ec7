"""Sound, shear waves and bending in the lattice: frequencies, orders in the cell size, dampings."""

import math

import numpy as np
import pytest
from bench import PLAIN, ROWS, numerics, run_to, small_scene
from reference_lattice import reference_positions
from scipy.linalg import eigh, expm

from taichi_foam.scene import Base, Block, Scene

K, RHO = 2.78e6, 25.6
SOUND = math.sqrt(K / RHO)  # 330 m/s
LINKS = ROWS - 0.5  # a held foot and a free top: the top's mass reaches half a cell beyond it


def measured_frequency(mode: int, dy: float) -> float:
    """Angular frequency [1/s] of a standing wave of (2 mode + 1) quarter waves, plane in x.

    A start with the velocity sin(k s), s from the held row, has the amplitude cos(w t) later on;
    after 1.25 periods of the continuum that is near 0, where it tells w best. RK4 errs by
    (w dt)^4 / 120 = 1e-9 of w; the chain itself is linear.
    """
    scene = small_scene(dy=dy, base=Base(kind="held"), numerics=numerics(damping_time=0.0))
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
    scene = small_scene(base=Base(kind="held"), numerics=numerics(damping_time=tau))
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
    for damping, rate in (("absolute", 2.78 / (RHO * 0.005**2 * 0.057)), ("stiffness", 0.0)):
        scene = small_scene(
            base=Base(kind="floor"),
            model=PLAIN.model_copy(update={"damping": damping}),
        )
        X = reference_positions(scene) + np.array([0.0, 0.5])
        after = run_to(scene, time, 200, position=X, velocity=np.full_like(X, 3.0))
        np.testing.assert_allclose(after.velocity, 3.0 * math.exp(-rate * time), rtol=1e-9)


LAYER = (72, 12)  # columns and rows


@pytest.mark.parametrize(("dx", "dy"), [(0.005, 0.005), (0.010, 0.005), (0.005, 0.007)])
def test_a_layer_swings_in_shear_at_sqrt_g_over_rho(dx: float, dy: float) -> None:
    """A quarter of a wave stands in a gripped layer: within 0.5 %, of which 0.08 % is the lattice.

    Rows are a chain as well, w = (2 c_s / dy) sin(k dy / 2), c_s^2 = G / rho. Looked at after a
    quarter of a period, where the amplitude tells the frequency best. News from the free sides, at
    the speed of sound, is then 1.83 heights deep, and the middle 2.1 off.
    """
    columns, rows = LAYER
    scene = Scene(
        block=Block(
            mass_points="cells", width=columns * dx, height=rows * dy, columns=columns, rows=rows
        ),
        numerics=numerics(damping_time=0.0),
    )
    X = scene.block.positions
    height, speed = (rows - 0.5) * dy, 1e-3
    shape = np.sin(0.5 * math.pi * (X[0, :, 1] - 0.5 * dy) / height)
    velocity = np.zeros_like(X)
    velocity[..., 0] = speed * shape
    time = height / math.sqrt(0.84e6 / RHO)
    after = run_to(scene, time, 400, velocity=velocity)
    middle = after.velocity[columns // 2 - 1 : columns // 2 + 1, :, 0].mean(axis=0)
    amplitude = middle @ shape / (speed * shape @ shape)
    found = math.acos(amplitude) / (0.5 * math.pi)
    assert found == pytest.approx(1.0, rel=5e-3)
    half = 0.25 * math.pi * dy / height
    assert found == pytest.approx(math.sin(half) / half, rel=1e-6)


@pytest.mark.parametrize(("dx", "dy"), [(0.005, 0.005), (0.004, 0.006), (0.006, 0.004)])
def test_a_cantilever_swings_as_timoshenkos_beam_does(dx: float, dy: float) -> None:
    """A column of six by forty cells, gripped at its foot, in its first mode: within 1 %.

    Bonds at the middles of cells have the moment of inertia of the section but for 1 / 36, and so
    has the rotary inertia of the mass points; five cells of six carry shear, with 5 / 6 of that for
    its parabola. All of shear takes 1 to 3 % off the frequency. Other modes that the start has a
    little of do not show: the projection on the mode leaves them out to second order.
    """
    columns, rows = 6, 40
    scene = Scene(
        block=Block(
            mass_points="cells", width=columns * dx, height=rows * dy, columns=columns, rows=rows
        ),
        numerics=numerics(damping_time=0.0),
    )
    X = scene.block.positions
    depth, length = columns * dx, (rows - 0.5) * dy
    second = depth**3 / 12.0 * (1.0 - 1.0 / columns**2)
    exact, nodes, turns = timoshenko(length, depth, second, 5.0 / 6.0 * (depth - dx))
    along = X[0, :, 1] - 0.5 * dy
    at = np.linspace(0.0, length, len(nodes))
    velocity = np.zeros_like(X)
    speed = 1e-3
    velocity[..., 0] = speed * np.interp(along, at, nodes)
    velocity[..., 1] = -speed * np.interp(along, at, turns) * X[..., 0]
    assert not velocity[:, 0].any()
    time = 1.25 * 2.0 * math.pi / exact
    after = run_to(scene, time, 8000, velocity=velocity)
    amplitude = (after.velocity * velocity).sum() / (velocity**2).sum()
    found = (2.0 * math.pi + math.acos(amplitude)) / time
    assert found == pytest.approx(exact, rel=1e-2)
    slender = 1.8751**2 / length**2 * math.sqrt(K * second / (RHO * depth))
    assert found < 0.995 * slender  # or shear would not matter


def timoshenko(
    length: float, depth: float, second: float, shear_depth: float, elements: int = 200
) -> tuple[float, np.ndarray, np.ndarray]:
    """First angular frequency [1/s] of a cantilever of unit thickness, its deflections, its turns.

    By linear elements of one point each, which do not lock.
    """
    h, n = length / elements, elements + 1
    stiffness, mass = np.zeros((2, 2 * n, 2 * n))
    for k in range(elements):
        at = [2 * k, 2 * k + 1, 2 * k + 2, 2 * k + 3]  # deflection and turn of either end
        bent = np.array([0.0, -1.0, 0.0, 1.0]) / h
        slid = np.array([-1.0 / h, -0.5, 1.0 / h, -0.5])
        local = K * second * h * np.outer(bent, bent)
        local += 0.84e6 * shear_depth * h * np.outer(slid, slid)
        stiffness[np.ix_(at, at)] += local
        inertia = 0.5 * h * RHO * np.array([depth, second, depth, second])
        mass[np.ix_(at, at)] += np.diag(inertia)
    squared, shapes = eigh(stiffness[2:, 2:], mass[2:, 2:], subset_by_index=[0, 0])
    shape = np.concatenate([[0.0, 0.0], shapes[:, 0]])
    shape = shape / shape[-2]
    return math.sqrt(squared[0]), shape[::2], shape[1::2]
