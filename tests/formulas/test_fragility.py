"""Damage boundaries and shock response spectra against closed forms and SciPy's simulation."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.optimize import minimize_scalar
from scipy.signal import lsim

from taichi_foam.errors import UserError
from taichi_foam.formulas.fragility import (
    DamageBoundary,
    half_sine_response,
    rectangle_response,
    shock_response_spectrum,
)
from taichi_foam.units import STANDARD_GRAVITY

DURATION = 0.011
FREQUENCIES = np.geomspace(4.0, 2000.0, 25)


def pulse(shape: str) -> tuple[np.ndarray, np.ndarray]:
    """A pulse of 1 g, sampled so that its straight pieces are as good as the curve."""
    time = np.linspace(0.0, DURATION, 4001)
    values = np.sin(np.pi * time / DURATION) if shape == "half-sine" else np.ones_like(time)
    return time, values


@pytest.mark.parametrize(
    ("shape", "response"), [("half-sine", half_sine_response), ("rectangle", rectangle_response)]
)
def test_spectra_without_damping_are_the_closed_forms(shape: str, response: object) -> None:
    """To 0.2 %, by which a peak may lie between samples."""
    found = shock_response_spectrum(*pulse(shape), FREQUENCIES, damping=0.0)
    expected = [response(frequency * DURATION) for frequency in FREQUENCIES]
    assert found == pytest.approx(expected, rel=2.1e-3)


@pytest.mark.parametrize("damping", [0.02, 0.1, 0.5])
def test_spectra_with_damping_are_simulations(damping: float) -> None:
    """SciPy's simulation of y'' + 2 d w y' + w^2 y = 2 d w a' + w^2 a, with linear pieces."""
    time = np.linspace(0.0, 0.12, 12_001)
    base = np.interp(time, [0.0, 0.004, 0.005, 0.02, 0.022], [0.0, 30.0, -12.0, 5.0, 0.0])
    frequencies = np.array([14.0, 45.0, 160.0])
    found = shock_response_spectrum(time, base, frequencies, damping)
    for frequency, peak in zip(frequencies, found, strict=True):
        w = 2 * np.pi * frequency
        system = ([2 * damping * w, w * w], [1.0, 2 * damping * w, w * w])
        _, response, _ = lsim(system, base, time)
        assert peak == pytest.approx(np.abs(response).max(), rel=2.1e-3)


def test_a_sampled_trace_need_not_be_fine() -> None:
    """Points of straight pieces are enough, and high frequencies follow the trace itself."""
    time = np.array([0.0, 0.004, 0.008, 0.012, 0.016])
    base = np.array([0.0, 3.0, 1.0, 2.0, 0.0])
    fine = np.linspace(0.0, 0.016, 16_001)
    coarse = shock_response_spectrum(time, base, [30.0, 200.0, 5e3])
    assert coarse == pytest.approx(
        shock_response_spectrum(fine, np.interp(fine, time, base), [30.0, 200.0, 5e3]), rel=2.1e-3
    )
    assert coarse[-1] == pytest.approx(3.0, rel=0.02)


def test_half_sines_respond_most_near_a_product_of_0_8() -> None:
    """Continuous where one branch takes over, and nowhere above the maximum that boundaries use."""
    best = minimize_scalar(
        lambda x: -half_sine_response(x), bounds=(0.6, 1.1), options={"xatol": 1e-10}
    )
    boundary = DamageBoundary(2.0, 40.0)
    assert boundary.critical_of("half-sine") == pytest.approx(80.0 / -best.fun, rel=1e-9)
    many = np.array([half_sine_response(x) for x in np.linspace(0.01, 8.0, 8001)])
    assert many.max() <= -best.fun
    assert np.abs(np.diff(many)).max() < 5e-3
    assert many[:20] == pytest.approx(4.0 * np.linspace(0.01, 8.0, 8001)[:20], rel=5e-3)


@pytest.mark.parametrize("shape", ["rectangle", "half-sine"])
def test_pulses_on_the_boundary_just_damage(shape: str) -> None:
    """The part of the product, simulated, responds with exactly what it withstands."""
    boundary = DamageBoundary(critical_velocity=2.5, critical_g=35.0)
    frequency = 35.0 * STANDARD_GRAVITY / (math.pi * 2.5)
    fullness = 1.0 if shape == "rectangle" else 2.0 / math.pi
    for change in (2.52, 3.0, 4.0, 7.0):
        g = boundary.g_at(change, shape)
        duration = change / (fullness * g * STANDARD_GRAVITY)
        time, values = pulse(shape)
        response = shock_response_spectrum(
            time * duration / DURATION, g * values, [frequency], damping=0.0
        )
        assert response[0] == pytest.approx(2 * 35.0, rel=2.1e-3)
        assert g >= boundary.critical_of(shape) * (1 - 1e-12)


def test_the_ends_of_the_boundary() -> None:
    """Infinite up to the critical velocity change; level from pi / 2 of it on, if rectangular."""
    boundary = DamageBoundary(critical_velocity=2.0, critical_g=50.0)
    assert boundary.g_at(2.0) == math.inf
    assert boundary.g_at(0.5 * math.pi * 2.0 * 0.99) > 50.0
    for ratio in (0.5 * math.pi * 1.0001, 3.0, 1e3):
        assert boundary.g_at(2.0 * ratio) == pytest.approx(50.0, rel=1e-9)
    # a half-sine that is long presses the part like a load at rest
    assert boundary.g_at(2e3, "half-sine") == pytest.approx(100.0, rel=5e-3)


def test_what_has_no_spectrum_and_no_boundary() -> None:
    trace = pulse("half-sine")
    with pytest.raises(UserError, match="damping = 1: must be at least 0 and below 1"):
        shock_response_spectrum(*trace, [10.0], damping=1.0)
    with pytest.raises(UserError, match="frequencies from 0 Hz"):
        shock_response_spectrum(*trace, [0.0, 10.0])
    with pytest.raises(UserError, match="time must increase"):
        shock_response_spectrum(trace[0][::-1], trace[1], [10.0])
    with pytest.raises(UserError, match="critical_g = 0: must be a number above 0 g"):
        DamageBoundary(2.0, 0.0)
