"""Filters against the amplitude response that SAE J211 asks for; figures of pulses."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import butter, lfilter, lfilter_zi

from taichi_foam.errors import UserError
from taichi_foam.formulas.traces import CHANNEL_CLASSES, filtered, low_pass, pulse_of
from taichi_foam.units import STANDARD_GRAVITY


def of_rows(time: object, means: object) -> np.ndarray:
    """The filter of a history's column: each row is a mean since the row before."""
    return filtered(time, means, 180, means=True)


def half_sine(time: np.ndarray, duration: float) -> np.ndarray:
    inside = (time >= 0.0) & (time <= duration)
    return np.where(inside, np.sin(np.pi * time / duration), 0.0)


def rectangle(time: np.ndarray, duration: float) -> np.ndarray:
    return np.where((time >= 0.0) & (time <= duration), 1.0, 0.0)


def gain(frequency: float) -> float:
    """Amplitude of a smoothed unit sine wave, well inside the record."""
    step = 1e-5
    t = np.arange(0, 0.2, step)
    omega = 2 * np.pi * frequency
    phase = omega * t
    means = np.concatenate([[0.0], -np.diff(np.cos(phase)) / (omega * step)])  # over each row
    smooth = of_rows(t, means)
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
    assert low_pass(samples, cutoff) == pytest.approx(expected, rel=0.0, abs=1e-15 / cutoff**2)


def test_a_constant_passes_unchanged() -> None:
    t = np.linspace(0, 0.05, 501)
    smooth = of_rows(t, np.full_like(t, 74.0))
    assert smooth[t > 0.01] == pytest.approx(74.0, rel=1e-6)


@pytest.mark.parametrize("frequency", [20.0, 60.0, 100.0, 180.0])
def test_pass_band_lies_within_half_a_decibel(frequency: float) -> None:
    assert abs(20 * np.log10(gain(frequency))) <= 0.5


def test_stop_band_falls_by_24_decibels_an_octave() -> None:
    # Four poles: far above the cut-off the amplitude falls with the fourth power of frequency.
    assert 20 * np.log10(gain(2000.0) / gain(4000.0)) == pytest.approx(24.1, abs=0.6)


def test_a_sudden_start_is_halfway_up_at_contact() -> None:
    """A phaseless filter is odd about a step: half of it at the step, none of it far before."""
    t = np.linspace(0, 0.05, 5001)
    smooth = of_rows(t, np.full_like(t, 100.0))
    assert smooth[0] == pytest.approx(50.0, rel=5e-3)
    half = np.searchsorted(t, 0.02)
    delayed = of_rows(t, np.where(t > t[half], 100.0, 0.0))
    before, after = delayed[half - 400 : half + 1][::-1], delayed[half : half + 401]
    assert before + after == pytest.approx(100.0, abs=0.05)


def test_velocity_change_is_kept() -> None:
    t = np.linspace(0, 0.06, 601)
    pulse = np.where(t < 0.03, 100 * np.sin(np.pi * t / 0.03), 0.0)
    smooth = of_rows(t, pulse)
    change = np.sum(0.5 * (smooth[1:] + smooth[:-1]) * np.diff(t))
    assert change == pytest.approx(np.sum(pulse[1:] * np.diff(t)), rel=2e-3)


def test_uneven_rows_give_the_same_curve() -> None:
    even = np.linspace(0, 0.05, 501)
    uneven = np.sort(np.concatenate([even, even[:-1:3] + 3e-5]))

    def ramp(t: np.ndarray) -> np.ndarray:  # means over rows of a deceleration of 2000 t
        return np.concatenate([[0.0], 1000 * (t[1:] + t[:-1])])

    inside = even[20:-60]
    expected = np.interp(inside, even, of_rows(even, ramp(even)))
    found = np.interp(inside, uneven, of_rows(uneven, ramp(uneven)))
    assert found == pytest.approx(expected, abs=0.02)
    assert found == pytest.approx(2000 * inside, abs=0.05)


def test_short_and_bad_series() -> None:
    assert of_rows([], []).shape == (0,)
    assert of_rows([0.0], [5.0]).tolist() == [0.0]
    assert np.isfinite(of_rows([0.0, 1e-4], [0.0, 5.0])).all()
    assert np.isnan(of_rows([0.0, 1e-4], [np.nan, np.nan])).all()
    with pytest.raises(UserError, match="increase"):
        of_rows([0.0, 0.0], [1.0, 1.0])
    with pytest.raises(UserError, match="equal in length"):
        of_rows([0.0, 1.0], [1.0])


@pytest.mark.parametrize("channel_class", CHANNEL_CLASSES)
def test_every_class_is_3_db_down_at_its_limit(channel_class: int) -> None:
    """Amplitude of a sine of CFC / 0.6 Hz is 1 / sqrt 2, and that of CFC Hz within 0.5 dB of 1."""
    time = np.arange(0.0, 60.0 / channel_class, 1.0 / (200.0 * channel_class))
    middle = (time > 20.0 / channel_class) & (time < 40.0 / channel_class)
    for frequency, expected, share in (
        (channel_class / 0.6, 0.5**0.5, 0.002),
        (float(channel_class), 1.0, 0.056),
    ):
        seen = filtered(time, np.sin(2 * np.pi * frequency * time), channel_class)
        assert seen[middle].max() == pytest.approx(expected, rel=share)


def test_filters_move_peaks() -> None:
    """A half-sine of 3 ms keeps 93 and 48 % of its peak, a long rectangle gains 3.4 %.

    The transfer function of two passes is 1 / (1 + (f / f_c)^4) with f_c = 2.0775 CFC: its inverse
    Fourier integral with the half-sine's spectrum is the peak at the middle, by symmetry.
    """
    time = np.arange(-2000, 5000) / 1e5
    f = np.linspace(-20_000.0, 20_000.0, 400_001)
    duration = 0.003
    # the spectrum of cos(pi t / T), |t| < T / 2
    near = 1.0 - (2.0 * f * duration) ** 2
    spectrum = 2.0 * duration / np.pi * np.cos(np.pi * f * duration) / near
    for channel_class, said in ((180, 0.93), (60, 0.48)):
        passed = spectrum / (1.0 + (f / (2.0775 * channel_class)) ** 4)
        expected = float(np.sum(passed) * (f[1] - f[0]))
        peak = filtered(time, half_sine(time, duration), channel_class).max()
        assert peak == pytest.approx(expected, rel=2e-3)
        assert peak == pytest.approx(said, abs=0.005)
    for channel_class in (60, 180):
        level = filtered(time, rectangle(time, 0.03), channel_class)
        assert level.max() == pytest.approx(1.034, abs=1e-3)


def test_samples_and_means_give_one_curve() -> None:
    """A trace sampled finely, and its means over rows, as a run writes them."""
    time = np.arange(0, 4001) / 1e5
    seen = filtered(time, half_sine(time - 5e-3, 0.01), 180)
    area = 0.01 / np.pi * (1.0 - np.cos(np.pi * np.clip(time - 5e-3, 0.0, 0.01) / 0.01))
    means = np.diff(area, prepend=0.0) * 1e5
    assert filtered(time, means, 180, means=True) == pytest.approx(seen, abs=1e-3)


def test_traces_that_no_filter_takes() -> None:
    time = np.arange(100) / 1e4
    flat = np.ones_like(time)
    with pytest.raises(UserError, match="9500 samples/s: must be at least 10,000"):
        filtered(time / 0.95, flat, 1000)
    assert filtered(time, flat, 1000) == pytest.approx(flat)
    with pytest.raises(UserError, match="60, 180, 600, 1000"):
        filtered(time, flat, 100)


def test_figures_of_a_half_sine() -> None:
    """Its velocity change is 2 A T / pi; it is at 10 % and 90 % where sin is 0.1 and 0.9."""
    time, duration, g = np.arange(-2000, 3000) / 1e5, 0.011, 50.0
    trace = g * STANDARD_GRAVITY * half_sine(time, duration)
    change = 2.0 * g * STANDARD_GRAVITY * duration / np.pi
    pulse = pulse_of(time, trace, None, impact_velocity=0.8 * change)
    assert pulse.channel == "raw"
    assert pulse.g == pytest.approx(g)
    assert pulse.time == pytest.approx(0.5 * duration)
    at_10, at_90 = (duration / np.pi * np.arcsin(share) for share in (0.1, 0.9))
    assert pulse.duration == pytest.approx(duration - 2.0 * at_10, rel=1e-4)
    assert pulse.rise == pytest.approx(at_90 - at_10, rel=1e-3)
    assert pulse.velocity_change == pytest.approx(change, rel=1e-4)
    assert pulse.restitution == pytest.approx(0.25, rel=1e-3)
    seen = pulse_of(time, trace, 60)
    assert (seen.channel, seen.restitution) == ("CFC 60", None)
    assert seen.g < 0.99 * g
    assert seen.velocity_change == pytest.approx(change, rel=1e-4)


def test_what_is_no_pulse() -> None:
    time = np.arange(400) / 1e4
    trace = 100.0 * half_sine(time - 0.01, 0.01)
    for values, said in (
        (-trace, "without a peak"),
        (np.full_like(time, np.nan), "all finite"),
        (np.where(time < 0.016, trace, 60.0), "ends at 60 % of its peak"),
    ):
        with pytest.raises(UserError, match=said):
            pulse_of(time, values, None)
    with pytest.raises(UserError, match="above 0 m/s"):
        pulse_of(time, trace, None, impact_velocity=0.0)
