"""Measured curves: what they take, how they are smoothed, and what is read off them."""

import re

import numpy as np
import pytest
from scipy.optimize import isotonic_regression

from taichi_foam.laws.bond import Curve
from taichi_foam.laws.bond.kinds.tabulated import TabulatedFoam

STRAIN = [0.0, 0.05, 0.4, 0.6, 0.7, 0.8]
STRESS = [0.0, 100e3, 120e3, 160e3, 250e3, 800e3]


def test_either_sign_and_arrays_give_the_same_curve() -> None:
    curve = Curve(strain=STRAIN, stress=STRESS)
    assert Curve(strain=[-x for x in STRAIN], stress=[-x for x in STRESS]) == curve
    assert Curve(strain=np.array(STRAIN), stress=-np.array(STRESS)) == curve
    assert Curve(strain=STRAIN[1:], stress=STRESS[1:]) == curve  # from rest


def test_falling_stress_is_replaced_by_the_nearest_rising_curve() -> None:
    """A first peak, as of rigid foam; the change is kept."""
    peak = [0.0, 150e3, 110e3, 120e3, 250e3, 800e3]
    curve = Curve(strain=STRAIN, stress=peak)
    expected = isotonic_regression(np.array(peak[1:])).x
    np.testing.assert_allclose(curve.stress[1:], expected)
    assert curve.smoothing == pytest.approx(np.abs(expected - peak[1:]).max())
    assert Curve.model_validate(curve.model_dump()) == curve


def test_energy_efficiency_and_what_follows() -> None:
    """Against Riemann sums over a fine grid."""
    curve = Curve(strain=STRAIN, stress=STRESS)
    fine = np.linspace(0.0, 0.8, 800_001)
    stress = np.interp(fine, STRAIN, STRESS)
    energy = np.cumsum(stress) * (fine[1] - fine[0])
    at = np.searchsorted(fine, STRAIN)
    np.testing.assert_allclose(curve.energy, energy[at], rtol=1e-4, atol=1.0)
    efficiency = energy[1:] / stress[1:]
    # between points it may be a little larger than at any of them
    assert curve.densification == 0.6
    assert abs(fine[1 + np.argmax(efficiency)] - 0.6) < 0.05
    inside = (fine >= 0.2) & (fine <= 0.4)
    assert curve.plateau_stress == pytest.approx(stress[inside].mean(), rel=1e-5)
    assert curve.steepest(0.6) == pytest.approx(2e6)


@pytest.mark.parametrize(
    ("strain", "stress", "told"),
    [
        ([0.0, 5.0, 40.0, 80.0], [0, 1e5, 1.2e5, 4e5], "strains are fractions (80 % is 0.80)"),
        ([0.0, 0.05, 0.4, 0.8], [0, 0.1, 0.12, 0.4], "stresses are in pascals"),
        ([0.0, 0.05, 0.05, 0.8], [0, 1e5, 1e5, 4e5], "strain[2] = 0.05: repeats"),
        ([0.0, 0.4, 0.05, 0.8], [0, 1e5, 1e5, 4e5], "strain[2] = 0.05: is below"),
        ([-0.1, 0.05, 0.4], [0, 1e5, 1e5], "the strains have both signs"),
        ([0.0, 0.05, 0.4], [0, 1e5], "3 strains and 2 stresses"),
        ([0.0, 0.02], [0, 1e5], "must reach at least 0.05"),
        ([0.3], [1e5], "1 points; must be 2 to 2,000"),
        ([0.0, float("nan"), 0.4], [0, 1e5, 1e5], "finite"),
        ([0.0, "x", 0.4], [0, 1e5, 1e5], "number"),
    ],
)
def test_what_cannot_be_a_test_is_refused_with_a_cure(strain: list, stress: list, told: str):
    with pytest.raises(ValueError, match=re.escape(told)):
        Curve(strain=strain, stress=stress)


def test_noise_is_no_stiffness() -> None:
    """2 % of noise on 1,000 points: the slope of the secants is within what it does over 0.005.

    Slopes between neighbours are wrong by up to ten times the modulus.
    """
    strain = np.linspace(0.0, 0.8, 1001)
    rng = np.random.default_rng(7)
    stress = np.interp(strain, STRAIN, STRESS) * (1 + 0.02 * rng.standard_normal(strain.size))
    curve = Curve(strain=strain, stress=stress)
    # two ends of at most 100 kPa with 2 % of noise each, 0.005 apart; three times that is rare
    assert 2e6 < curve.steepest(0.6) < 2e6 + 3 * np.sqrt(2) * 0.02 * 100e3 / 0.005


def test_a_jump_at_the_end_stays_finite() -> None:
    curve = Curve(strain=(0.0, 0.05, 0.5, 0.50001), stress=(0.0, 1e5, 1.1e5, 1e7))
    table = TabulatedFoam(curve=curve).table
    assert np.isfinite(table).all()
    assert (np.diff(table[:, 0]) > 0.0).all()


def test_a_curve_that_ends_level_locks_all_the_same() -> None:
    """The last stress fell, and was raised to the one before: a slope of its own would be none."""
    curve = Curve(strain=[0, 0.05, 0.5, 0.7, 0.71], stress=[0, 1e5, 1.2e5, 6e5, 5.9e5])
    stress = curve.table(0.93, 1e6, 1e9, 1e6)[:, 0]
    assert stress[900] > 1.5 * curve.stress[-1]
    level = Curve(strain=[0, 0.05, 0.6], stress=[0, 1e5, 1e5]).table(0.9, 1e6, 1e9, 1e6)[:, 0]
    assert level[890] > 2 * level[600]
