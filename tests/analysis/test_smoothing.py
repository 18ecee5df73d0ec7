"""The CFC 180 filter against the amplitude response that SAE J211 asks for."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import butter, lfilter, lfilter_zi

from taichi_foam.analysis.columns import _low_pass, smooth_deceleration


def gain(frequency: float) -> float:
    """Amplitude of a smoothed unit sine wave, well inside the record."""
    step = 1e-5
    t = np.arange(0, 0.2, step)
    omega = 2 * np.pi * frequency
    phase = omega * t
    means = np.concatenate([[0.0], -np.diff(np.cos(phase)) / (omega * step)])  # over each row
    smooth = smooth_deceleration(t, means)
    middle = (t > 0.1 - 1e-9) & (t < 0.15 - 1e-9)  # whole periods, for multiples of 20 Hz
    sine, cosine = np.sin(phase[middle]), np.cos(phase[middle])
    assert abs(2 * np.mean(smooth[middle] * cosine)) < 1e-3, "the filter shifts the phase"
    return float(2 * np.mean(smooth[middle] * sine))


@pytest.mark.parametrize("cutoff", [0.2, 0.0374, 3.74e-4])
def test_a_pass_is_that_of_scipy(cutoff: float) -> None:
    samples = np.random.default_rng(1).normal(size=4000)
    b, a = butter(2, cutoff, fs=1.0)  # type: ignore[misc]
    expected = lfilter(b, a, samples, zi=lfilter_zi(b, a) * samples[0])[0]
    # two poles this near to 1 lose digits in either way of computing
    assert _low_pass(samples, cutoff) == pytest.approx(expected, rel=0.0, abs=1e-15 / cutoff**2)


def test_a_constant_passes_unchanged() -> None:
    t = np.linspace(0, 0.05, 501)
    smooth = smooth_deceleration(t, np.full_like(t, 74.0))
    assert smooth[t > 0.01] == pytest.approx(74.0, rel=1e-6)


def test_three_decibels_are_lost_at_300_hz() -> None:
    assert 20 * np.log10(gain(300.0)) == pytest.approx(-10 * np.log10(2), abs=0.02)


@pytest.mark.parametrize("frequency", [20.0, 60.0, 100.0, 180.0])
def test_pass_band_lies_within_half_a_decibel(frequency: float) -> None:
    assert abs(20 * np.log10(gain(frequency))) <= 0.5


def test_stop_band_falls_by_24_decibels_an_octave() -> None:
    # Four poles: far above the cut-off the amplitude falls with the fourth power of frequency.
    assert 20 * np.log10(gain(2000.0) / gain(4000.0)) == pytest.approx(24.1, abs=0.6)


def test_a_sudden_start_is_halfway_up_at_contact() -> None:
    """A phaseless filter is odd about a step: half of it at the step, none of it far before."""
    t = np.linspace(0, 0.05, 5001)
    smooth = smooth_deceleration(t, np.full_like(t, 100.0))
    assert smooth[0] == pytest.approx(50.0, rel=5e-3)
    half = np.searchsorted(t, 0.02)
    delayed = smooth_deceleration(t, np.where(t > t[half], 100.0, 0.0))
    before, after = delayed[half - 400 : half + 1][::-1], delayed[half : half + 401]
    assert before + after == pytest.approx(100.0, abs=0.05)


def test_velocity_change_is_kept() -> None:
    t = np.linspace(0, 0.06, 601)
    pulse = np.where(t < 0.03, 100 * np.sin(np.pi * t / 0.03), 0.0)
    smooth = smooth_deceleration(t, pulse)
    change = np.sum(0.5 * (smooth[1:] + smooth[:-1]) * np.diff(t))
    assert change == pytest.approx(np.sum(pulse[1:] * np.diff(t)), rel=2e-3)


def test_uneven_rows_give_the_same_curve() -> None:
    even = np.linspace(0, 0.05, 501)
    uneven = np.sort(np.concatenate([even, even[:-1:3] + 3e-5]))

    def ramp(t: np.ndarray) -> np.ndarray:  # means over rows of a deceleration of 2000 t
        return np.concatenate([[0.0], 1000 * (t[1:] + t[:-1])])

    inside = even[20:-60]
    expected = np.interp(inside, even, smooth_deceleration(even, ramp(even)))
    found = np.interp(inside, uneven, smooth_deceleration(uneven, ramp(uneven)))
    assert found == pytest.approx(expected, abs=0.02)
    assert found == pytest.approx(2000 * inside, abs=0.05)


def test_short_and_bad_series() -> None:
    assert smooth_deceleration([], []).shape == (0,)
    assert smooth_deceleration([0.0], [5.0]).tolist() == [0.0]
    assert np.isfinite(smooth_deceleration([0.0, 1e-4], [0.0, 5.0])).all()
    assert np.isnan(smooth_deceleration([0.0, 1e-4], [np.nan, np.nan])).all()
    with pytest.raises(ValueError, match="increase"):
        smooth_deceleration([0.0, 0.0], [1.0, 1.0])
    with pytest.raises(ValueError, match="equal in length"):
        smooth_deceleration([0.0, 1.0], [1.0])
