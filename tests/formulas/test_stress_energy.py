"""The stress-energy method: its own curve comes back, its optimum is one, and it is that of a foam
whose balance is known."""

from __future__ import annotations

import math

import numpy as np
import pytest

from taichi_foam.errors import UserError
from taichi_foam.formulas import energy
from taichi_foam.formulas.stress_energy import StressEnergy, fitted

CURVE = StressEnergy(stress=120e3, exponent=2.5e-5, energies=(1e3, 1e5), deviation=0.0)


def drops(noise: float) -> dict[str, np.ndarray]:
    random = np.random.default_rng(5)
    height, thickness = random.uniform(0.3, 1.2, 60), random.uniform(0.025, 0.15, 60)
    static = random.uniform(1e3, 9e3, 60)
    g = CURVE.g(static, height, thickness) * np.exp(noise * random.standard_normal(60))
    return {"drop_height": height, "thickness": thickness, "static_stress": static, "g": g}


def test_a_curve_comes_back_from_tests() -> None:
    found = fitted(**drops(0.0))
    assert found.stress == pytest.approx(CURVE.stress, rel=1e-9)
    assert found.exponent == pytest.approx(CURVE.exponent, rel=1e-9)
    assert found.deviation == pytest.approx(0.0, abs=1e-9)
    # its deviation is the scatter of the tests, within four standard errors 1 / sqrt(2 n)
    assert fitted(**drops(0.05)).deviation == pytest.approx(0.05, rel=4 / 120**0.5)


def test_its_optimum() -> None:
    """G_min = e a b h / T at sigma_st = T / (b h), and no static stress does better."""
    height, thickness = 0.76, 0.05
    static, g = CURVE.optimum(height, thickness)
    assert static == pytest.approx(thickness / (CURVE.exponent * height), rel=1e-12)
    expected = math.e * CURVE.stress * CURVE.exponent * height / thickness
    assert g == pytest.approx(expected, rel=1e-12)
    assert CURVE.g(static, height, thickness) == pytest.approx(g, rel=1e-12)
    beside = CURVE.g(static * np.array([0.99, 1.01]), height, thickness)
    assert (beside > g).all()


def test_equal_height_over_thickness_is_one_curve_by_energy_balance() -> None:
    """G sigma_st of a linear foam is sqrt(sigma_st^2 + 2 E sigma_st h / T) at any size."""
    for static in (2e3, 6e3):
        for thick in (0.03, 0.12):
            stop = energy.stop([0.0, 0.9], [0.0, 0.9 * 5e5], static, 15.0 * thick, thick)
            assert stop is not None
            assert stop.g * static == pytest.approx((static**2 + 2 * 5e5 * static * 15) ** 0.5)


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"g": -1.0}, "g = -1: must be above 0"),
        ({"thickness": 0.0}, "thickness = 0: must be above 0"),
        ({"g": [40.0, 50.0]}, "must be equal in number"),
        ({"drop_height": 0.76, "thickness": 0.05, "static_stress": 5e3}, "at different energies"),
        ({"g": 1e9 / drops(0.0)["static_stress"] ** 3}, "does not rise with the energy"),
    ],
)
def test_what_gives_no_curve(changed: dict, said: str) -> None:
    with pytest.raises(UserError, match=said):
        fitted(**(drops(0.0) | changed))
