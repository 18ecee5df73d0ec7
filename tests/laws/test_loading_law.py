"""The loading curve of Eq. 26: its branches, where they meet, and its rise towards locking."""

import numpy as np
import pytest
from law_bench import Reference, constants, densified, elastic, loading, normal

from taichi_foam.scene import Foam

pytestmark = pytest.mark.usefixtures("taichi_runtime")

TABLE_6 = Foam()
OTHER = Foam(
    youngs_modulus=7.1e6,
    yield_strain=-0.08,
    densification_strain=-0.55,
    locking_strain=-0.85,
    densification_a=0.8,
    densification_b=1.7,
)
FOAMS = pytest.mark.parametrize("foam", [TABLE_6, OTHER], ids=["Table 6", "another"])

# A handful of operations in double precision; near locking the exponent, up to 10, and the small
# difference e - e_l, down to 0.02, magnify their rounding by up to 1e3.
ROUNDING = 1e-12


@FOAMS
def test_the_curve_follows_eq_26(foam: Foam) -> None:
    """Everywhere but in the last tenth before locking, where the program may bound the stress."""
    last = foam.locking_strain + 0.1 * (foam.densification_strain - foam.locking_strain)
    e = np.linspace(last, foam.tensile_strain, 2001)
    reference = [Reference(foam).loading(x) for x in e]
    np.testing.assert_allclose(loading(constants(foam), e), reference, rtol=ROUNDING, atol=1e-9)


def test_numbers_worked_out_by_hand() -> None:
    """Half way from densification to locking the exponent is a; at 2/3 it is twice that."""
    e = np.array([0.05, -0.025, -0.05, -0.4, -0.8, -0.875, -0.9, -0.935])
    exponent = [0.0, 0.0, 0.0, 0.0, 0.0, 0.5, 1.0, 4.5]
    flat = np.array([1.39e5, -0.695e5, -1.39e5, -1.39e5, -1.39e5, -1.39e5, -1.39e5, -1.39e5])
    np.testing.assert_allclose(loading(constants(), e), flat * np.exp(exponent), rtol=ROUNDING)


@FOAMS
def test_the_curve_is_continuous_where_branches_meet(foam: Foam) -> None:
    """Across a gap of 2e-9 the stress may change by no more than the steepest slope times that."""
    for corner in (foam.yield_strain, foam.densification_strain):
        left, right = loading(constants(foam), np.array([corner - 1e-9, corner + 1e-9]))
        assert abs(left - right) <= 2e-9 * foam.youngs_modulus * 1.001


@FOAMS
def test_the_curve_rises_ever_steeper_and_without_bound_towards_locking(foam: Foam) -> None:
    """By 95 % of the way it must be exp(a (0.95 w) / (0.05 w)^b) times the plateau, w the width."""
    width = foam.densification_strain - foam.locking_strain
    e = foam.densification_strain - np.linspace(0.0, 0.95, 400) * width
    stress = -loading(constants(foam), e)
    # the last slope is the end of Eq. 26's own range; convex from the first interval on
    assert np.all(np.diff(stress, 2) > 0)
    exponent = foam.densification_a * 0.95 * width / (0.05 * width) ** foam.densification_b
    assert stress[-1] == pytest.approx(foam.plateau_stress * np.exp(exponent), rel=1e-10)


@FOAMS
def test_at_locking_and_beyond_the_stress_is_finite_and_still_rises(foam: Foam) -> None:
    """A trial stage may overstep the singularity; it must meet a wall there, not a NaN."""
    e = np.linspace(foam.locking_strain + 1e-3, -1.2, 200)
    stress = -loading(constants(foam), e)
    assert np.all(np.isfinite(stress))
    assert np.all(np.diff(stress) > 0)
    assert stress[0] > 1e3 * foam.plateau_stress


@FOAMS
def test_the_densified_modulus_is_the_curves_slope(foam: Foam) -> None:
    """Central differences, h = 1e-7: truncation h^2 f'''/6, far below the rounding of f/h, 1e-8."""
    width = foam.densification_strain - foam.locking_strain
    h = 1e-7
    e = foam.densification_strain - np.linspace(0.01, 0.9, 60) * width
    slope = (loading(constants(foam), e + h) - loading(constants(foam), e - h)) / (2 * h)
    assert slope[-1] > 2 * foam.youngs_modulus
    np.testing.assert_allclose(densified(constants(foam), e), slope, rtol=1e-6)


def test_the_densified_modulus_by_hand_and_beyond_the_guard() -> None:
    """At 0.9 of crush 0.05 K e (0.5 / 0.05 + 0.5 * 0.1 / 0.05^2); the guard's tangent keeps its."""
    at_09 = 1.39e5 * np.e * 30.0
    np.testing.assert_allclose(densified(constants(), np.array([-0.9])), at_09, rtol=1e-11)
    beyond = np.array([-0.945, -0.95, -1.1])
    slope = np.diff(loading(constants(), beyond)) / np.diff(beyond)
    np.testing.assert_allclose(densified(constants(), beyond[:2]), slope, rtol=1e-9)


@pytest.mark.parametrize("crushed_stress", [None, 3e4, 5e6])
def test_the_elastic_modulus_is_the_steepest_slope_before_densification(
    crushed_stress: float | None,
) -> None:
    """Over all histories; re-tension is steepest right after yield, from e_p = 0 to e_t / 2."""
    foam = constants(Foam(crushed_tensile_stress=crushed_stress))
    e = np.linspace(-0.8, 0.025, 20_001)
    found = max(
        np.abs(np.diff(normal(foam, e, e_min)) / np.diff(e)).max()
        for e_min in (0.0, -0.03, -0.05 - 1e-9, -0.2, -0.5, -0.8, -0.9)
    )
    assert elastic(foam) == pytest.approx(found, rel=1e-6)
