"""Foam that heeds the rate, in the lattice: stress in steady flow, and the order in the step."""

import numpy as np
import pytest
from bench import COLUMNS, ROWS, numerics, run_to, small_scene
from reference_lattice import reference_positions
from scipy.integrate import solve_ivp

from taichi_foam.scene import Base, FlatBlock, Foam, Model, Numerics, Output, Start
from taichi_foam.simulation.simulate import run

K, E_Y = 2.78e6, -0.05
VISCOSITY = K * 1e-6 / 0.057  # Pa s, of the dashpots
LOOSE = Model(self_contact=False)
GAUGE = 0.095  # m, of the column


def crushed_steadily(
    foam: Foam, strain_rate: float, until: float, interval: float
) -> tuple[np.ndarray, np.ndarray]:
    """Strain and stress [Pa] of a column under a plate that is too heavy to slow down.

    Every row is in motion from the start, so that the strain and its rate [1/s] are the same
    everywhere. `until` is the last strain, `interval` that of the history [s].
    """
    scene = small_scene(
        base=Base(kind="held"),
        impactor=FlatBlock(width=0.06, mass=1e4, velocity=strain_rate * GAUGE, friction=0.0),
        foam=foam,
        model=LOOSE,
        start=Start(velocity_gradient=((0.0, 0.0), (0.0, -strain_rate))),
        numerics=Numerics(end=until / strain_rate),
        output=Output(history_interval=interval),
    )
    history = run(scene).history
    return history["displacement_m"] / GAUGE, history["contact_force_N"] / (0.05 * 0.057)


@pytest.mark.parametrize(("rate", "exponent"), [(50.0, 4.0), (20.0, 1.0), (5.0, 2.0)])
def test_a_column_that_is_crushed_steadily_has_the_stress_of_cowper_and_symonds(
    rate: float, exponent: float
) -> None:
    """The plateau's stress times 1 + (r / D)^(1/q) at the rate r, and the dashpots' tau K r.

    The penalty's ringing is damped by both; 0.1 % as for the static curve in tests/scenes. Pieces
    do not touch: worst strains lag here, so that discs at the sides would meet those after next
    within the strains of the test.
    """
    strain_rate = 2.0 / GAUGE
    foam = Foam(rate=rate, rate_exponent=exponent)
    strain, stress = crushed_steadily(foam, strain_rate, until=0.7, interval=1e-4)
    steady = (strain > 0.5) & (strain < 0.7)
    overstress = (strain_rate / rate) ** (1.0 / exponent)
    expected = -K * E_Y * (1.0 + overstress) + VISCOSITY * strain_rate
    np.testing.assert_allclose(stress[steady], expected, rtol=1e-3)


def test_whole_foam_overshoots_its_plateau_and_comes_down_to_it() -> None:
    """The same column of foam whose resistance to the rate fades: the stress of one bond.

    Integrated by scipy: e_min' = -D exp(p / p0) (y / |e_y|) with the lasting strain p = |e_min| -
    |e_y| and the lag y. The yield point is 1.7 times the plateau here.
    """
    rate, fades, strain_rate = 30.0, 0.02, 5.0 / GAUGE
    foam = Foam(rate=rate, overshoot_strain=fades)
    strain, stress = crushed_steadily(foam, strain_rate, until=0.4, interval=2e-5)
    yielding = (strain > 0.06) & (strain < 0.35)

    def flow(time: float, lasting: list[float]) -> list[float]:
        lag = max(strain_rate * time + E_Y - lasting[0], 0.0)
        return [rate * np.exp(lasting[0] / fades) * lag / -E_Y]

    time = strain[yielding] / strain_rate
    lasting = solve_ivp(
        flow, (0.0, time[-1]), [0.0], method="LSODA", t_eval=time, rtol=1e-9, atol=1e-12
    ).y[0]
    expected = K * (strain[yielding] - lasting) + VISCOSITY * strain_rate
    assert expected.max() > 1.5 * K * -E_Y
    assert expected[-1] < 1.1 * K * -E_Y
    # 1 % of the plateau: the penalty's ringing, which is damped but begins at the peak
    np.testing.assert_allclose(stress[yielding], expected, rtol=0, atol=0.01 * K * -E_Y)


@pytest.mark.parametrize(
    ("axis", "model"),
    [
        (0, LOOSE),
        (1, LOOSE),
        (1, Model(shear="face", crushed_room=False, self_contact=False)),  # no cells but for this
    ],
)
def test_foam_overshoots_unless_foam_next_to_it_has_been_crushed(axis: int, model: Model) -> None:
    """Of a block strained to twice the yield strain, with one crushed bond: those around it."""
    foam = Foam(rate=20.0, overshoot_strain=0.0167, tensile_strain=1.0, shear_strain=2.0)
    scene = small_scene(base=Base(kind="floor"), model=model, foam=foam, numerics=numerics())
    squeezed = np.ones(2)
    squeezed[axis] += 2 * E_Y
    name, shape = [("worst_a", (COLUMNS - 1, ROWS)), ("worst_b", (COLUMNS, ROWS - 1))][axis]
    worst = np.full(shape, E_Y)
    worst[3, 3] = -0.4
    start = {"position": reference_positions(scene) * squeezed + [0.0, 0.5], name: worst}
    found = run_to(scene, 1e-6, 1, **start)
    flowed = (found.e_min_a, found.e_min_b)[axis]
    around = np.zeros(shape, dtype=bool)
    around[[2, 4, 3, 3], [3, 3, 2, 4]] = True
    np.testing.assert_allclose(flowed[around], 2 * E_Y, rtol=1e-3)
    others = ~around
    others[3, 3] = False
    # the lag is the yield strain, at which foam flows at the rate D
    np.testing.assert_allclose(flowed[others] - E_Y, -20.0 * 1e-6, rtol=1e-3)
    assert flowed[3, 3] == -0.4


def test_flow_is_of_second_order_in_the_step() -> None:
    """A free bar at the yield point that closes at 800 1/s, and swings: flow, no kinks.

    For q = 2 the flow rule is smooth enough, y^2 on one side and nothing on the other; unloading
    begins with the slope of the overstress. Steps are far below the waves' own, so that Runge-
    Kutta's error, of the fourth order, is nothing beside it.
    """
    foam = Foam(rate=300.0, rate_exponent=2.0, tensile_strain=1.0, shear_strain=2.0)
    scene = small_scene(base=Base(kind="floor"), model=LOOSE, foam=foam, numerics=numerics())
    X = reference_positions(scene)
    position = X * [1.0, 1.0 + E_Y] + np.array([0.0, 0.5])
    velocity = (X - X.mean(axis=(0, 1))) * [0.0, -800.0]
    start = {
        "position": position,
        "velocity": velocity,
        "worst_b": np.full((COLUMNS, ROWS - 1), E_Y),
    }
    time, counts = 4e-4, np.array([200, 283, 400, 566])
    exact = run_to(scene, time, 9056, **start)
    assert exact.e_min_b.min() < -0.07
    errors = [
        np.abs(run_to(scene, time, n, **start).position - exact.position).max() for n in counts
    ]
    order = -np.polyfit(np.log(counts), np.log(errors), 1)[0]
    assert order == pytest.approx(2.0, abs=0.15)
