"""Foam that springs back: the way back, its energy, the gas, and what recovers between drops."""

import itertools
import math
from pathlib import Path

import numpy as np
import pytest
from law_bench import constants, gas_energy, leaked, normal, stored
from scipy.integrate import quad

from taichi_foam.laws.bond import Curve
from taichi_foam.laws.bond.fit import return_fit
from taichi_foam.laws.bond.kinds.recovering import RecoveringFoam
from taichi_foam.scene.measured import read_test

pytestmark = pytest.mark.usefixtures("taichi_runtime")

# Strains of three decimals, which the table meets exactly.
STRAIN = (0.0, 0.05, 0.2, 0.4, 0.6, 0.7, 0.8)
STRESS = (0.0, 60e3, 80e3, 120e3, 220e3, 360e3, 800e3)
CURVE = Curve(strain=STRAIN, stress=STRESS)
FACTOR, SHAPE, SET = 0.3, 3.0, 0.1
FOAM = RecoveringFoam(
    curve=CURVE, hysteresis_factor=FACTOR, hysteresis_shape=SHAPE, permanent_set=SET
)
AIR, SOLID = 101325.0, 0.04
WORSTS = (-0.03, -0.1, -0.45, -0.75)


def curve_at(x: float) -> float:
    return float(np.interp(x, STRAIN, STRESS))


def bound(worst: float) -> float:
    """Of the relative error of s_0 W^SHAPE, about a power of SHAPE + 1 or so, in rows of 0.001."""
    return (SHAPE + 1.0) ** 2 / 8.0 * (0.001 / worst) ** 2


def area(x: float) -> float:
    """Under the curve, exactly: it is made of straight lines."""
    points = [each for each in STRAIN if each < x] + [x]
    return sum(0.5 * (curve_at(a) + curve_at(b)) * (b - a) for a, b in itertools.pairwise(points))


@pytest.mark.parametrize("worst", WORSTS)
def test_the_way_back_is_the_curve_times_the_factor(worst: float) -> None:
    foam = constants(FOAM)
    assert normal(foam, np.array([worst]), worst)[0] == pytest.approx(-curve_at(-worst), rel=1e-12)
    for e in np.linspace(worst, SET * worst, 9)[1:]:
        x = (SET * worst - e) / (1.0 - SET)
        part = (area(x) / area(-worst)) ** SHAPE if x > 1e-12 else 0.0
        expected = -curve_at(x) * (1.0 - (1.0 - FACTOR) * (1.0 - part))
        margin = 2.0 * bound(worst) * curve_at(-worst)
        assert normal(foam, np.array([e]), worst)[0] == pytest.approx(expected, abs=margin)
    assert FOAM.permanent_strain(np.array(worst)) == pytest.approx(SET * worst)


@pytest.mark.parametrize("worst", WORSTS)
def test_the_part_given_back_is_its_closed_form(worst: float) -> None:
    """(1 - S) (1 + SHAPE HU) / (1 + SHAPE); by quadrature of the stress, and as stored energy.

    Lines between rows of h = 0.001 add h^2 / 12 of the slope at the end to the area under a curve.
    """
    foam, part = constants(FOAM), 0.9 * (1.0 + 3.0 * 0.3) / (1.0 + 3.0)
    assert FOAM.given_back == pytest.approx(part)
    e = np.linspace(worst, SET * worst, 100_001)
    stress = -normal(foam, e, worst)
    parts = 0.5 * (stress[1:] + stress[:-1]) * np.diff(e)
    top, taken = curve_at(-worst), area(-worst)
    slope = (top - curve_at(-worst - 1e-6)) / 1e-6 / top + SHAPE * top / taken
    margin = 2e-6 / 12.0 * slope * (1.0 + SHAPE) * top / taken
    assert parts.sum() / taken == pytest.approx(part, rel=margin)
    assert stored(foam, e[:1], worst)[0] == pytest.approx(parts.sum(), rel=1e-6)
    halfway = stored(foam, e[50_000:50_001], worst)[0]
    assert halfway == pytest.approx(parts[50_000:].sum(), rel=1e-6)


def test_what_is_lost_never_falls_as_crush_grows() -> None:
    """The area under the curve less what the way back gives; exact for the law's own lines."""
    e, foam = np.linspace(0.0, 0.93, 931), constants(FOAM)
    stress = FOAM.loading(e)
    taken = np.append(0.0, np.cumsum(0.5 * (stress[1:] + stress[:-1]) * np.diff(e)))
    kept = np.concatenate([stored(foam, np.array([-x]), -x) for x in e])
    assert np.all(np.diff(taken - kept) >= -1e-12 * taken[-1])


def test_no_slope_exceeds_what_steps_are_made_for() -> None:
    """The bound of the table, over the difference quotients of every way back."""
    table, foam = FOAM.table, constants(FOAM)
    for worst in -np.array([2e-3, 0.02, 0.3, 0.65, 0.85]):
        e = np.linspace(worst, 0.99 * SET * worst, 4001)
        steepest = np.abs(np.diff(normal(foam, e, worst)) / np.diff(e)).max()
        assert steepest <= table[round(-1000 * worst), 1] * (1.0 + 1e-6)


@pytest.mark.parametrize("exponent", [1.0, 1.4])
def test_gas_adds_its_pressure_and_keeps_its_energy(exponent: float) -> None:
    """Against p e / (1 - e - r), or the adiabatic pressure, and the quadrature of it."""
    foam = FOAM.model_copy(
        update={"gas_pressure": AIR, "solid_fraction": SOLID, "gas_exponent": exponent}
    )

    def pressure(x: float) -> float:
        if exponent == 1.0:
            return AIR * x / (1.0 - x - SOLID)
        return AIR * (((1.0 - SOLID) / (1.0 - x - SOLID)) ** 1.4 - 1.0)

    with_gas, without, worst = constants(foam), constants(FOAM), -0.7
    for x in (0.7, 0.4, 0.1, 0.03):
        e = np.array([-x])
        added = normal(without, e, worst) - normal(with_gas, e, worst)
        assert added[0] == pytest.approx(pressure(x), rel=1e-9)  # at a row
        kept = stored(with_gas, e, worst) - stored(without, e, worst)
        # lines between rows of h = 0.001 add h^2 / 12 of what the slope has risen by
        risen = (pressure(x) - pressure(x - 1e-6) - pressure(1e-6)) / 1e-6
        exact = quad(pressure, 0.0, x)[0]
        assert exact * (1.0 - 1e-9) <= kept[0] <= exact + 1.2e-6 / 12.0 * risen
        # a broken bond has lost its gas
        broken = normal(with_gas, e, worst, broken=True)
        np.testing.assert_array_equal(broken, normal(without, e, worst, broken=True))
    assert foam.loading(np.array([0.5]))[0] == pytest.approx(curve_at(0.5) + pressure(0.5))


def test_what_recovers_between_drops() -> None:
    foam = FOAM.model_copy(
        update={
            "recovery_time": 40.0, "gas_pressure": AIR, "solid_fraction": SOLID,
            "gas_leak_time": 100.0,
        }
    )  # fmt: skip
    worst, lost = np.array([-0.5, 0.0]), np.array([0.3, 0.0])
    rested = foam.rested(worst, {"lost": lost}, 60.0)
    faded = -0.5 * math.exp(-1.5)
    np.testing.assert_allclose(rested["worst"], [faded, 0.0], rtol=1e-12)
    pressure = ((1.0 - SOLID) / (1.0 + SET * faded - SOLID)) ** 1.4  # over that at rest, if whole
    fading = math.exp(-60.0 * pressure / 100.0)
    amount = 1.0 / pressure + (0.7 - 1.0 / pressure) * fading
    assert rested["lost"][0] == pytest.approx(1.0 - amount, rel=1e-12)
    assert rested["lost"][1] == 0.0
    assert not FOAM.recovers
    np.testing.assert_array_equal(FOAM.rested(worst, {}, 1e6)["worst"], worst)


@pytest.mark.parametrize("exponent", [1.0, 1.4])
def test_gas_that_leaks_only_loses_energy(exponent: float) -> None:
    """At the strain -0.5, and in the foam that has come back short of gas: towards 0 in the end.

    In between the amount goes exponentially to that which has the pressure at rest.
    """
    foam = FOAM.model_copy(
        update={
            "gas_pressure": AIR, "solid_fraction": SOLID, "gas_exponent": exponent,
            "gas_leak_time": 0.1,
        }
    )  # fmt: skip
    for strain, lost in ((-0.5, 0.0), (0.0, 0.4)):
        pressure = ((1.0 - SOLID) / (1.0 + strain - SOLID)) ** exponent
        before = math.inf
        for time in (0.0, 0.02, 0.1, 0.5, 5.0):
            now = leaked(constants(foam), strain, lost, time)
            amount = 1.0 / pressure + (1.0 - lost - 1.0 / pressure) * math.exp(
                -time * pressure / 0.1
            )
            assert now == pytest.approx(1.0 - amount, abs=1e-6)
            kept = gas_energy(constants(foam), strain, now)
            # the area under the pressure is that of the table's lines
            assert -1e-5 * AIR <= kept < before
            before = kept
        assert before == pytest.approx(0.0, abs=1e-5 * AIR)


def test_a_curve_denser_than_its_cells_is_refused() -> None:
    with pytest.raises(ValueError, match=r"foam\.solid_fraction = 0\.3: must be below 0\.2"):
        RecoveringFoam(curve=CURVE, gas_pressure=AIR, solid_fraction=0.3)


def test_the_unloading_of_a_test_gives_hysteresis_and_set(tmp_path: Path) -> None:
    """A test to 70 % and back, made with known constants, with 1 % of noise."""
    up = np.linspace(0.0, 0.7, 141)
    down = np.linspace(0.7, 0.7 * SET, 100)[1:]
    x = (down - 0.7 * SET) / (1.0 - SET)
    share = np.array([area(each) if each > 1e-9 else 0.0 for each in x]) / area(0.7)
    back = np.interp(x, STRAIN, STRESS) * (FACTOR + (1.0 - FACTOR) * share**SHAPE)
    noise = 1.0 + 0.01 * np.random.default_rng(1).standard_normal(240)
    stress = np.append(np.interp(up, STRAIN, STRESS), back) * noise
    file = tmp_path / "test.csv"
    rows = zip(np.append(up, down), np.maximum(stress, 0.0), strict=True)
    file.write_text("strain [-],stress [Pa]\n" + "".join(f"{e:.6f},{s:.3f}\n" for e, s in rows))
    test = read_test(file)
    assert test.way_back is not None
    fit = return_fit(test.curve, *test.way_back)
    assert (fit.factor, fit.left) == pytest.approx((FACTOR, SET), abs=0.01)
    assert fit.shape == pytest.approx(SHAPE, rel=0.05)
    assert fit.given_back == pytest.approx(0.9 * (1.0 + 3.0 * 0.3) / (1.0 + 3.0), rel=0.02)
    file.write_text("".join(f"{e:.6f},{s:.3f}\n" for e, s in zip(up, stress[:141], strict=True)))
    assert read_test(file).way_back is None
