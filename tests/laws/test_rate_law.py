"""Foam that heeds the rate of its strain: how it flows, and its stress on the way."""

import math

import numpy as np
import pytest
from law_bench import Reference, constants, flowed, flowed_steadily, normal, stored
from scipy.integrate import solve_ivp

from taichi_foam.scene import Foam

pytestmark = pytest.mark.usefixtures("taichi_runtime")

K, E_Y = 2.78e6, -0.05
D = 80.0  # 1/s
EXPONENTS = pytest.mark.parametrize("q", [1.0, 2.0, 4.0])


def sensitive(q: float) -> Foam:
    return Foam(rate=D, rate_exponent=q)


@EXPONENTS
@pytest.mark.parametrize("e_min", [0.0, -0.03, -0.05, -0.3, -0.85])
def test_at_a_constant_strain_it_flows_as_scipy_integrates(q: float, e_min: float) -> None:
    """From where elastic loading has brought it. DOP853 to 1e-12 of the yield strain."""
    reference = Reference(sensitive(q))
    start = min(e_min, E_Y)
    for ahead in (1e-4, 0.01, 0.06):
        e = start - ahead
        for time in (1e-6, 1e-4, 3e-3):
            exact = solve_ivp(
                lambda _, x, e=e: [reference.flow(e, x[0])],
                (0.0, time), [start], method="DOP853", rtol=1e-12, atol=1e-12 * -E_Y,
            )  # fmt: skip
            found = flowed(constants(sensitive(q)), np.array([e]), e_min, time)[0]
            assert found == pytest.approx(exact.y[0, -1], rel=0, abs=1e-11 * -E_Y)
            assert e < found < start


@EXPONENTS
def test_two_times_one_after_the_other_are_as_good_as_their_sum(q: float) -> None:
    foam, e = constants(sensitive(q)), np.array([-0.4])
    half_way = flowed(foam, e, -0.3, 2e-4)[0]
    at_once = flowed(foam, e, -0.3, 5e-4)[0]
    assert flowed(foam, e, half_way, 3e-4)[0] == pytest.approx(at_once, rel=1e-13)


@EXPONENTS
def test_what_is_not_beyond_its_worst_does_not_flow(q: float) -> None:
    """e_min stays to the last bit; and before yield it is the strain itself, as without a rate."""
    foam = constants(sensitive(q))
    for e_min in (-0.06, -0.4, -0.9):
        unloaded = np.linspace(e_min, 0.05, 40)
        np.testing.assert_array_equal(flowed(foam, unloaded, e_min, 1.0), e_min)
    elastic = np.linspace(-0.05, 0.05, 41)
    for e_min in (0.0, -0.02):
        expected = np.minimum(elastic, e_min)
        np.testing.assert_array_equal(flowed(foam, elastic, e_min, 1.0), expected)


@EXPONENTS
@pytest.mark.parametrize("rate", [0.5, 80.0, 400.0])
def test_steady_flow_has_the_stress_of_cowper_and_symonds(q: float, rate: float) -> None:
    """K e_y (1 + (r / D)^(1/q)), in steps as the engine takes them.

    The history flows at a step's first strain, and is then held: the stress at the step's middle
    counts. Where the plateau's overstress is y, a step errs by parts of (r h / y)^2, so that half
    of it leaves a quarter of the error.
    """
    foam = constants(sensitive(q))
    overstress = (rate / D) ** (1.0 / q)
    # long enough to forget the start by exp(-30): the flow's own time is e_y / (D q share^(q-1))
    memory = -E_Y / (D * q * overstress ** (q - 1.0))
    errors = []
    for steps in (600, 1200, 2400):
        step = 30.0 * memory / steps
        e_min = flowed_steadily(foam, E_Y, rate, step, steps)
        # far below densification only the distance to e_min counts
        behind = E_Y - rate * step * (steps - 0.5) - e_min
        stress = normal(foam, np.array([-0.4 + behind]), -0.4)[0]
        errors.append(stress / (K * E_Y * (1.0 + overstress)) - 1.0)
    assert abs(errors[-1]) < 1e-3
    assert math.log2(errors[0] / errors[1]) == pytest.approx(2.0, abs=0.1)
    assert math.log2(errors[1] / errors[2]) == pytest.approx(2.0, abs=0.1)


@EXPONENTS
@pytest.mark.parametrize("e_min", [-0.05, -0.06, -0.1])
def test_a_rate_that_grows_as_foam_yields_flows_as_scipy_integrates(q: float, e_min: float) -> None:
    """To second order in the time: half of it has an eighth of the error of one step."""
    foam = Foam(rate=20.0, rate_exponent=q, overshoot_strain=0.0167)
    reference, e = Reference(foam), e_min - 0.03
    errors = []
    # short against the time in which the lag falls, so that the lowest order shows
    longest = 0.02 * 0.03 / -reference.flow(e, e_min)
    for time in (longest, longest / 2, longest / 4):
        exact = solve_ivp(
            lambda _, x: [reference.flow(e, x[0])],
            (0.0, time), [e_min], method="DOP853", rtol=1e-13, atol=1e-16,
        )  # fmt: skip
        errors.append(abs(flowed(constants(foam), np.array([e]), e_min, time)[0] - exact.y[0, -1]))
    assert errors[0] < 1e-5 * -E_Y
    assert math.log2(errors[0] / errors[1]) == pytest.approx(3.0, abs=0.1)
    assert math.log2(errors[1] / errors[2]) == pytest.approx(3.0, abs=0.1)


def test_foam_that_has_yielded_heeds_the_rate_no_more() -> None:
    """After a lasting strain of 0.4 its lag is gone within a microsecond, however short of e."""
    foam = constants(Foam(rate=20.0, overshoot_strain=0.0167))
    assert flowed(foam, np.array([-0.5]), -0.45, 1e-6)[0] == -0.5
    np.testing.assert_array_equal(flowed(foam, np.array([-0.3]), -0.45, 1e-6), -0.45)


def test_foam_next_to_crushed_foam_heeds_the_rate_as_if_it_had_yielded_as_far() -> None:
    foam = constants(Foam(rate=20.0, overshoot_strain=0.0167))
    e = np.array([-0.1])
    assert flowed(foam, e, E_Y, 1e-6, around=-0.45)[0] == -0.1
    # the rate D grows by exp(0.02 / p0): as much flows in a time that is shorter by that
    growth = math.exp(0.02 / 0.0167)
    alone = flowed(foam, e, E_Y, 1e-7)[0]
    helped = flowed(foam, e, E_Y, 1e-7 / growth, around=-0.07)[0]
    assert helped - E_Y == pytest.approx(alone - E_Y, rel=1e-4)
    # what has yielded less makes no difference
    np.testing.assert_array_equal(
        flowed(foam, e, -0.08, 1e-3, around=-0.07), flowed(foam, e, -0.08, 1e-3)
    )


def test_a_thin_row_of_cells_overshoots_over_the_same_displacement() -> None:
    """Half of the rate counts in a row of half the band: it flows twice as fast, and p0 is double.

    So a row of half the height, whose strains are twice as large, has the same displacements.
    """
    foam = Foam(rate=20.0, overshoot_strain=0.0167)
    lag, time = 0.02, 1e-6  # the lag is elastic: it has the same stress in both
    for slowed in (1.0, 2.0):
        e_min = E_Y - slowed * 0.03
        flow = slowed * Reference(foam).flow(E_Y - 0.03 - lag, E_Y - 0.03)
        found = flowed(constants(foam), np.array([e_min - lag]), e_min, time, slowed)[0]
        assert found - e_min == pytest.approx(flow * time, rel=1e-3)


@pytest.mark.parametrize("e_min", [0.0, -0.03, -0.05, -0.3, -0.79, -0.85])
def test_the_overstress_is_elastic_in_what_the_history_is_short_of(e_min: float) -> None:
    foam = sensitive(4.0)
    e = np.linspace(-0.93, 0.03, 500)
    expected = [Reference(foam).normal(x, e_min) for x in e]
    np.testing.assert_allclose(
        normal(constants(foam), e, e_min), expected, rtol=1e-12, atol=1e-12 * K
    )


@pytest.mark.parametrize("e_min", [0.0, -0.03, -0.3, -0.85])
@pytest.mark.parametrize("broken", [False, True])
def test_to_the_last_bit_only_loading_beyond_the_worst_heeds_the_rate(
    e_min: float, broken: bool
) -> None:
    """And foam without a rate does not heed the exponent."""
    e = np.linspace(min(e_min, E_Y), 0.05, 300)
    for other in (Foam(rate=D), Foam(rate_exponent=7.0)):
        for law in (normal, stored):
            static = law(constants(), e, e_min, broken)
            np.testing.assert_array_equal(law(constants(other), e, e_min, broken), static)
    deep = np.linspace(-0.93, e_min, 100)
    for law in (normal, stored):
        static = law(constants(), deep, e_min)
        np.testing.assert_array_equal(law(constants(Foam(rate_exponent=7.0)), deep, e_min), static)
