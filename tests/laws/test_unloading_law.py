"""What a bond answers with once it has been crushed or broken (Figs 19-20)."""

from itertools import pairwise

import numpy as np
import pytest
from law_bench import Reference, constants, densified, elastic, loading, normal, stored
from scipy.integrate import quad

from taichi_foam.scene import Foam, Model

pytestmark = pytest.mark.usefixtures("taichi_runtime")

FOAM = Foam()
K = FOAM.youngs_modulus
ROUNDING = 1e-12
JUMP = Model(broken_contact="jump")
CRUSHED = (-0.051, -0.2, -0.5, -0.79, -0.8, -0.85, -0.93)
HISTORIES = (0.0, -0.03, *CRUSHED)


@pytest.mark.parametrize("e_min", HISTORIES)
@pytest.mark.parametrize("crushed_stress", [None, 0.0, 3e4])
def test_unloading_and_retension_follow_fig_19(e_min: float, crushed_stress: float | None) -> None:
    foam = Foam(crushed_tensile_stress=crushed_stress)
    e = np.linspace(e_min, 0.05, 1001)
    reference = [Reference(foam).normal(x, e_min) for x in e]
    np.testing.assert_allclose(
        normal(constants(foam), e, e_min), reference, rtol=ROUNDING, atol=1e-12 * K
    )


@pytest.mark.parametrize("e_min", [-0.06, -0.4, -0.8])
def test_from_the_plateau_it_unloads_with_youngs_modulus(e_min: float) -> None:
    """To zero at e_min - e_y; numbers from the sketch of Fig. 19, not from a formula for all e."""
    e = e_min + np.array([0.0, 0.01, 0.025, 0.05])
    expected = [-1.39e5, -1.39e5 + 2.78e4, -0.695e5, 0.0]
    np.testing.assert_allclose(normal(constants(), e, e_min), expected, rtol=1e-11, atol=1e-7)


def test_densification_is_retraced_and_then_left_at_e_d() -> None:
    """All unloading from beyond e_d is one curve: back along Eq. 26c, then slope K to -0.75."""
    for e_min in (-0.81, -0.87, -0.93):
        e = np.linspace(e_min, -0.8, 50)
        np.testing.assert_array_equal(normal(constants(), e, e_min), loading(constants(), e))
        e = np.linspace(-0.8, 0.02, 100)
        np.testing.assert_array_equal(normal(constants(), e, e_min), normal(constants(), e, -0.8))


@pytest.mark.parametrize("e_min", HISTORIES)
def test_going_deeper_than_ever_meets_the_loading_curve(e_min: float) -> None:
    """The history is frozen while a step's stages try strains beyond it."""
    e = np.linspace(-0.94, e_min, 200)
    np.testing.assert_allclose(
        normal(constants(), e, e_min), loading(constants(), e), rtol=ROUNDING
    )


@pytest.mark.parametrize("e_min", HISTORIES)
def test_stress_is_continuous_in_strain_for_every_history(e_min: float) -> None:
    """No branch is steeper than its modulus, so no step between two close strains is."""
    e = np.linspace(-0.9, 0.05, 200_001)
    steep = np.full_like(e, elastic(constants()))
    steep[e < -0.8] = np.maximum(steep[e < -0.8], densified(constants(), e[e < -0.8]))
    steepest = np.maximum(steep[1:], steep[:-1])
    for broken in (False, True):
        jump = np.abs(np.diff(normal(constants(), e, e_min, broken)))
        assert np.all(jump <= 1.001 * steepest * np.diff(e))


@pytest.mark.parametrize("e_min", HISTORIES)
def test_a_broken_pair_reloads_as_before_but_never_pulls(e_min: float) -> None:
    e = np.linspace(-0.93, 0.3, 500)
    intact = normal(constants(), e, e_min)
    np.testing.assert_array_equal(
        normal(constants(), e, e_min, broken=True), np.minimum(intact, 0.0)
    )


@pytest.mark.parametrize("e_min", HISTORIES)
def test_under_the_jump_reading_it_answers_only_beyond_its_worst(e_min: float) -> None:
    foam = constants(model=JUMP)
    e = np.linspace(-0.93, 0.3, 500)
    expected = np.where(e <= e_min, np.minimum(loading(foam, e), 0.0), 0.0)
    np.testing.assert_array_equal(normal(foam, e, e_min, broken=True), expected)
    intact = normal(constants(), e, e_min)
    np.testing.assert_array_equal(normal(foam, e, e_min), intact)  # it concerns the broken alone


@pytest.mark.parametrize("e_min", HISTORIES)
@pytest.mark.parametrize("broken", [False, True])
@pytest.mark.parametrize("ahead", [0.0, 0.001, 0.04, 0.3])
def test_stored_energy_is_the_work_of_unloading(e_min: float, broken: bool, ahead: float) -> None:
    """SciPy's quadrature along the path from `e` to zero stress, with e_min as it is.

    Foam that heeds the rate may be `ahead` of its e_min, and unloads from an overstress. The law
    states 1e-5 for the densified part down to 0.93 of crush, and is far better where that is less
    steep; quad is good to 1e-10.
    """
    foam = FOAM if ahead == 0.0 else Foam(rate=50.0)
    reference = Reference(foam)
    end = reference.permanent(e_min)
    for e in np.linspace(max(e_min - ahead, -0.93), 0.024, 12):
        if broken and e > end:
            work = 0.0  # a broken pair does not pull
        else:
            bends = (-0.8, -0.05, e_min)
            corners = sorted({e, end, *(c for c in bends if min(e, end) < c < max(e, end))})
            work = sum(
                quad(reference.normal, a, b, args=(e_min,), epsabs=0, epsrel=1e-10)[0]
                for a, b in pairwise(corners)
            ) * (1 if e > end else -1)
        found = stored(constants(foam), np.array([e]), e_min, broken)[0]
        assert found == pytest.approx(work, rel=1e-5 if e < -0.9 else 1e-8, abs=1e-6)


def test_near_locking_the_energy_is_that_of_the_tangent() -> None:
    """From the guard strain on the stress is a straight line, whose area a trapeze has."""
    guard = FOAM.locking_strain + 0.05 * (FOAM.densification_strain - FOAM.locking_strain)
    e = np.linspace(guard, guard - 0.03, 50)
    stress = normal(constants(), e, e[-1])
    work = 0.5 * (stress[1:] + stress[:-1]) * np.diff(e)
    np.testing.assert_allclose(np.diff(stored(constants(), e, e[-1])), work, rtol=1e-9)


def test_under_the_jump_reading_a_broken_pair_stores_nothing() -> None:
    foam = constants(model=JUMP)
    assert not stored(foam, np.linspace(-0.6, 0.1, 50), -0.6, broken=True).any()
    assert stored(foam, np.array([-0.6]), -0.6)[0] == pytest.approx(0.5 * K * 0.05**2)
