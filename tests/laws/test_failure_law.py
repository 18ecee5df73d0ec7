"""Shear, and when a bond breaks (Eq. 25; Section 4.6)."""

import numpy as np
import pytest
from law_bench import constants, fails, shear_modulus

from taichi_foam.scene import Foam, Model

pytestmark = pytest.mark.usefixtures("taichi_runtime")

FOAM = Foam()
JUST = 1e-9
STRENGTH = 84e3  # G gamma_t = 0.84 MPa * 0.10 [Pa]
A_TOUCH = 1e-3  # Pa
READINGS = ("tension-only", "always", "pressure-dependent", "angle")


def test_the_shear_modulus_is_g_however_crushed() -> None:
    worst = np.linspace(-0.95, 0.0, 11)
    np.testing.assert_array_equal(shear_modulus(constants(), worst), np.full(11, 0.84e6))


def test_compression_alone_never_breaks() -> None:
    for model in READINGS:
        foam = constants(model=Model(shear_failure=model))
        assert not any(fails(foam, e, sigma_e=-1e5, e_min=e) for e in (-0.01, -0.5, -0.9))


@pytest.mark.parametrize("reading", READINGS)
@pytest.mark.parametrize("e", [0.0, 0.03])
def test_shear_breaks_a_pulled_or_unloaded_connection_in_every_reading(
    reading: str, e: float
) -> None:
    foam = constants(model=Model(shear_failure=reading))
    for sign in (-1, 1):
        assert not fails(foam, e, tau=sign * (STRENGTH - A_TOUCH))
        assert fails(foam, e, tau=sign * (STRENGTH + A_TOUCH))


def test_a_compressed_connection_in_shear_by_each_reading() -> None:
    """G gamma_t + c |sigma| is 84 kPa + c * 50 kPa, in Pa below."""
    e, sigma = -0.018, -5e4
    for sign in (-1, 1):
        tension_only = constants(model=Model(shear_failure="tension-only"))
        assert not fails(tension_only, e, sigma, sign * 1e9)
        always = constants(model=Model(shear_failure="always"))
        assert fails(always, e, sigma, sign * (STRENGTH + A_TOUCH))
        assert not fails(always, e, sigma, sign * (STRENGTH - A_TOUCH))
        for coefficient, limit in ((15.0, 834e3), (1.0, 134e3), (0.5, 109e3), (0.0, 84e3)):
            foam = constants(
                model=Model(
                    shear_failure="pressure-dependent", shear_pressure_coefficient=coefficient
                )
            )
            assert not fails(foam, e, sigma, sign * (limit - A_TOUCH))
            assert fails(foam, e, sigma, sign * (limit + A_TOUCH))


def test_the_strength_is_a_stress_whatever_the_shear_modulus() -> None:
    """G gamma_t of 1.2 MPa and 0.05 is 60 kPa; under 139 kPa of plateau, 15 times that comes on."""
    foam = constants(
        Foam(shear_modulus=1.2e6, shear_strain=0.05), Model(shear_pressure_coefficient=15.0)
    )
    for e, sigma, limit in ((0.01, 2.78e4, 60e3), (-0.4, -139e3, 60e3 + 2085e3)):
        assert not fails(foam, e, sigma, limit - A_TOUCH, e_min=min(e, 0.0))
        assert fails(foam, e, sigma, limit + A_TOUCH, e_min=min(e, 0.0))


@pytest.mark.parametrize("e", [-0.01, -0.6, -0.9])
@pytest.mark.parametrize("across", [1.0, 1.3, 0.4])
def test_by_the_angle_a_connection_breaks_at_the_same_one_however_short_it_is(
    e: float, across: float
) -> None:
    """Two columns of F, of lengths 1 + e and `across`, at an angle: gamma = u . w.

    At right angles less the angle's sine, u . w = |u| |w| sin; it may reach 0.10.
    """
    foam = constants(model=Model(shear_failure="angle"))
    u = np.array([1.0 + e, 0.0])
    for sine in (0.0999, 0.1001, -0.0999, -0.1001):
        w = across * np.array([sine, np.sqrt(1.0 - sine**2)])
        size = np.linalg.norm(u) * np.linalg.norm(w)
        broken = fails(foam, e, sigma_e=-1.39e5, tau=0.84e6 * (u @ w), e_min=e, size=float(size))
        assert broken == (abs(sine) > 0.10)


def test_the_angle_matters_to_no_connection_that_is_pulled() -> None:
    foam = constants(model=Model(shear_failure="angle"))
    for size in (0.3, 1.0, 2.0):
        assert not fails(foam, 0.01, tau=STRENGTH - A_TOUCH, size=size)
        assert fails(foam, 0.01, tau=STRENGTH + A_TOUCH, size=size)


def test_without_foam_across_it_a_connection_does_not_break_by_the_angle() -> None:
    """A bare fibre: no column across, no shear, no angle."""
    assert not fails(constants(model=Model(shear_failure="angle")), -0.5, size=0.0)


@pytest.mark.parametrize("strength", [0.3, 1.0, 1.7])
@pytest.mark.parametrize(("e_min", "limit"), [(0.0, 0.05), (-0.05, 0.05), (-0.0501, 0.025)])
def test_tension_breaks_whole_foam_at_e_t_and_crushed_foam_at_half_times_its_strength(
    strength: float, e_min: float, limit: float
) -> None:
    for beyond in (-JUST, JUST):
        e = strength * limit + beyond
        assert fails(constants(), e, e_min=e_min, strength=strength) == (beyond > 0)


@pytest.mark.parametrize("strength", [0.3, 1.0, 1.7])
@pytest.mark.parametrize(
    ("reading", "e", "limit"),
    [
        ("tension-only", 0.01, 84e3),
        ("always", -0.02, 84e3),
        # 84 kPa + 18 * 50 kPa, and 84 kPa * 0.5
        ("pressure-dependent", -0.02, 984e3),
        ("angle", -0.02, 42e3),
    ],
)
def test_a_connections_own_strength_multiplies_its_shear_strength(
    strength: float, reading: str, e: float, limit: float
) -> None:
    foam = constants(model=Model(shear_failure=reading, shear_pressure_coefficient=18.0))
    for sign in (-1, 1):
        for beyond in (-A_TOUCH, A_TOUCH):
            tau = sign * (strength * limit + beyond)
            found = fails(foam, e, sigma_e=-5e4, tau=tau, size=0.5, strength=strength)
            assert found == (beyond > 0)


def test_no_strength_lets_a_compressed_connection_shear_in_tension_only() -> None:
    foam = constants(model=Model(shear_failure="tension-only"))
    assert not fails(foam, -0.02, sigma_e=-5e4, tau=1e9, strength=0.1)
