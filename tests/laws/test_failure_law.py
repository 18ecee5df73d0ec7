"""Shear, and when a connection breaks (Eq. 25; Section 4.6)."""

import numpy as np
import pytest
from law_bench import constants, fails, shear

from taichi_foam.scene import Foam, Model

pytestmark = pytest.mark.usefixtures("taichi_runtime")

FOAM = Foam()
JUST = 1e-9


def test_shear_stress_is_g_gamma_both_ways() -> None:
    gamma = np.linspace(-0.5, 0.5, 11)
    np.testing.assert_allclose(shear(constants(), gamma), 0.84e6 * gamma, rtol=1e-15)


@pytest.mark.parametrize(("e_min", "limit"), [(0.0, 0.05), (-0.05, 0.05), (-0.0501, 0.025)])
def test_tension_breaks_virgin_foam_at_e_t_and_crushed_foam_at_half(
    e_min: float, limit: float
) -> None:
    assert not fails(constants(), limit - JUST, e_min=e_min)
    assert fails(constants(), limit + JUST, e_min=e_min)


def test_compression_alone_never_breaks() -> None:
    for model in ("tension-only", "always", "pressure-dependent"):
        foam = constants(model=Model(shear_failure=model))
        assert not any(fails(foam, e, sigma_e=-1e5, e_min=e) for e in (-0.01, -0.5, -0.9))


@pytest.mark.parametrize("reading", ["tension-only", "always", "pressure-dependent"])
@pytest.mark.parametrize("e", [0.0, 0.03])
def test_shear_breaks_a_pulled_or_unloaded_connection_in_every_reading(
    reading: str, e: float
) -> None:
    foam = constants(model=Model(shear_failure=reading))
    for sign in (-1, 1):
        assert not fails(foam, e, gamma=sign * (0.10 - JUST))
        assert fails(foam, e, gamma=sign * (0.10 + JUST))


def test_a_compressed_connection_in_shear_by_each_reading() -> None:
    """G gamma_t + c |sigma|, with 50 kPa, is 134 kPa: gamma = 0.15952380952..."""
    e, sigma = -0.018, -5e4
    for sign in (-1, 1):
        tension_only = constants(model=Model(shear_failure="tension-only"))
        assert not fails(tension_only, e, sigma, sign * 5.0)
        always = constants(model=Model(shear_failure="always"))
        assert fails(always, e, sigma, sign * (0.10 + JUST))
        assert not fails(always, e, sigma, sign * (0.10 - JUST))
        for coefficient, limit in ((1.0, 0.134 / 0.84), (0.5, 0.109 / 0.84), (0.0, 0.1)):
            foam = constants(
                model=Model(
                    shear_failure="pressure-dependent", shear_pressure_coefficient=coefficient
                )
            )
            assert not fails(foam, e, sigma, sign * (limit - JUST))
            assert fails(foam, e, sigma, sign * (limit + JUST))
