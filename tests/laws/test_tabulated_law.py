"""Foam by its measured curve: loading, unloading, what it stores, and what is derived from it."""

import numpy as np
import pytest
from law_bench import constants, densified, fails, loading, normal, shear_modulus, stored
from scipy.integrate import quad

from taichi_foam.laws.bond import Curve
from taichi_foam.laws.bond.kinds.tabulated import TabulatedFoam
from taichi_foam.scene import Foam, Model

pytestmark = pytest.mark.usefixtures("taichi_runtime")

# Strains of three decimals, which the table meets exactly.
STRAIN = (0.0, 0.04, 0.2, 0.4, 0.55, 0.65, 0.75, 0.82, 0.88)
STRESS = (0.0, 80e3, 95e3, 115e3, 150e3, 200e3, 330e3, 600e3, 1300e3)
CURVE = Curve(strain=STRAIN, stress=STRESS)
FOAM = TabulatedFoam(curve=CURVE)
YOUNG = 2e6  # the first line

# A handful of operations on numbers up to 1.3 MPa.
ROUNDING = 1e-14


def curve_at(e: np.ndarray) -> np.ndarray:
    return -np.interp(-e, STRAIN, STRESS)


def test_loading_gives_the_table_back_to_rounding() -> None:
    e = -np.array([*STRAIN, *np.linspace(0.0, 0.88, 41)])
    np.testing.assert_allclose(loading(constants(FOAM), e), curve_at(e), rtol=ROUNDING, atol=1e-8)


@pytest.mark.parametrize("worst", [-0.03, -0.2, -0.5])
def test_it_unloads_with_youngs_modulus_to_the_permanent_strain(worst: float) -> None:
    permanent = worst - curve_at(np.array(worst)) / YOUNG
    assert FOAM.permanent_strain(np.array(worst)) == pytest.approx(permanent, abs=1e-12)
    e = np.linspace(worst, permanent, 9)
    np.testing.assert_allclose(
        normal(constants(FOAM), e, worst), YOUNG * (e - permanent), rtol=1e-11, atol=1e-6
    )


def test_it_is_weak_in_tension_once_it_is_crushed() -> None:
    foam, worst = constants(FOAM), -0.3
    permanent = float(FOAM.permanent_strain(np.array(worst)))
    strain, stress = FOAM.crushed_tension
    e = np.array([permanent, 0.5 * (permanent + strain), strain])
    np.testing.assert_allclose(
        normal(foam, e, worst), [0.0, 0.5 * stress, stress], rtol=1e-11, atol=1e-6
    )
    assert not fails(foam, 0.99 * strain, e_min=worst)
    assert fails(foam, 1.01 * strain, e_min=worst)


def test_it_unloads_with_the_steepest_slope_so_far_beyond_densification() -> None:
    """Densified foam is no spring: its own slope, where that is more than Young's modulus."""
    worst, steepest = -0.85, 700e3 / 0.06  # the last line of the curve
    permanent = worst - curve_at(np.array(worst)) / steepest
    assert FOAM.permanent_strain(np.array(worst)) == pytest.approx(permanent, abs=1e-12)
    e = np.linspace(worst, permanent, 7)
    np.testing.assert_allclose(
        normal(constants(FOAM), e, worst), steepest * (e - permanent), rtol=1e-11, atol=1e-6
    )


def test_what_is_lost_never_falls_as_crush_grows() -> None:
    """The area under the curve less what unloading gives back."""
    e, foam = -np.linspace(0.0, 0.93, 500), constants(FOAM)
    stress = -loading(foam, e)
    taken = np.append(0.0, np.cumsum(0.5 * (stress[1:] + stress[:-1]) * np.diff(-e)))
    kept = stored(foam, e, 0.0)
    # trapezes of a curve that is straight over a row of 0.001 have the error of its kinks
    assert np.all(np.diff(taken - kept) >= -1e-6 * taken[-1])


@pytest.mark.parametrize("worst", [-0.02, -0.3, -0.55, -0.7, -0.86])
def test_what_is_stored_is_the_work_of_unloading(worst: float) -> None:
    """Against a quadrature of the stress over the way back."""
    foam, permanent = constants(FOAM), float(FOAM.permanent_strain(np.array(worst)))
    work, _ = quad(lambda e: -normal(foam, np.array([e]), worst)[0], worst, permanent)
    assert stored(foam, np.array([worst]), worst)[0] == pytest.approx(work, rel=1e-9)


def test_strains_met_now_count_for_the_stored_energy() -> None:
    """The ledger asks with the worst strain of the step before."""
    foam, e = constants(FOAM), np.array([-0.3])
    np.testing.assert_array_equal(stored(foam, e, -0.25), stored(foam, e, -0.3))


def test_beyond_the_test_it_rises_without_a_kink_to_locking() -> None:
    foam, end = constants(FOAM), CURVE.tested
    assert FOAM.locking_strain == pytest.approx(-(end + 0.75 * (1 - end)))
    around = loading(foam, -np.array([end - 1e-3, end, end + 1e-3]))
    slopes = -np.diff(around) / 1e-3
    assert slopes[0] == pytest.approx(700e3 / 0.06)
    locking, top = -FOAM.locking_strain, STRESS[-1]
    power = slopes[0] * (locking - end) / top
    half_a_row = 5e-4 * (power + 1) / (locking - end)  # what the slope of a power grows by there
    assert densified(foam, np.array([-end]))[0] > slopes[1]  # of which unloading has no less
    assert slopes[1] == pytest.approx((1 + half_a_row) * slopes[0], rel=1e-3)
    e = -np.linspace(end, 0.999, 200)
    stress = loading(foam, e)
    assert np.all(np.diff(stress) < 0)
    # the power of the distance to locking that continues the slope, up to the tangent
    inside = -e[-e < locking - 0.06 * (locking - end)]
    expected = -top * ((locking - end) / (locking - inside)) ** power
    # the table's lines lie above a convex curve by h^2/8 of its second derivative
    bound = 1e-6 / 8 * power * (power + 1) / (locking - inside - 1e-3) ** 2
    assert np.all(np.abs(stress[: inside.size] / expected - 1) <= 1.1 * bound + 1e-12)


def test_a_table_of_eq_26_is_that_foam() -> None:
    """The paper's own law as a table: loading, and unloading from the plateau."""
    paper = Foam()
    strain = np.linspace(0.0, 0.92, 921)
    stress = -normal(constants(paper), -strain, 0.0)
    foam = TabulatedFoam(
        curve=Curve(strain=strain, stress=stress),
        densification_strain=-0.8, shear_modulus=paper.shear_modulus,
        tensile_strain=paper.tensile_strain, shear_strain=paper.shear_strain,
    )  # fmt: skip
    assert foam.youngs_modulus == pytest.approx(paper.youngs_modulus, rel=1e-12)
    np.testing.assert_allclose(
        loading(constants(foam), -strain[::9]), -stress[::9], rtol=1e-9, atol=1e-4
    )
    for worst in (-0.03, -0.4):
        e = np.array([*strain[strain <= -worst] * -1.0, 0.01, 0.02])
        np.testing.assert_allclose(
            normal(constants(foam), e, worst), normal(constants(paper), e, worst),
            rtol=1e-9, atol=1e-4,
        )  # fmt: skip


def test_what_is_not_given_follows_from_the_curve() -> None:
    plateau = np.interp(np.linspace(0.2, 0.4, 201), STRAIN, STRESS).mean()
    assert FOAM.model_fields_set == {"curve"}
    assert FOAM.youngs_modulus == pytest.approx(YOUNG)
    assert FOAM.shear_modulus == pytest.approx(3 / 8 * YOUNG)
    assert FOAM.landmarks.plateau_stress == pytest.approx(plateau)
    assert FOAM.landmarks.crush_start == pytest.approx(-plateau / YOUNG)
    assert FOAM.youngs_modulus * FOAM.tensile_strain == pytest.approx(plateau)
    assert FOAM.shear_modulus * FOAM.shear_strain == pytest.approx(0.6 * plateau)
    stiffer = TabulatedFoam(curve=CURVE, youngs_modulus=4e6)
    assert stiffer.youngs_modulus * stiffer.tensile_strain == pytest.approx(plateau)


@pytest.mark.parametrize(
    ("values", "key"),
    [
        ({"youngs_modulus": 1e6}, "foam.youngs_modulus = 1e+06"),
        ({"densification_strain": -0.9}, "foam.densification_strain = -0.9"),
        ({"locking_strain": -0.85}, "foam.locking_strain = -0.85"),
    ],
)
def test_values_that_contradict_the_curve_are_refused(values: dict, key: str) -> None:
    with pytest.raises(ValueError, match=r"foam\.curve") as caught:
        TabulatedFoam(curve=CURVE, **values)
    assert key in str(caught.value)


def test_jumping_contact_drops_the_stress_of_broken_bonds() -> None:
    foam = constants(FOAM, Model(broken_contact="jump"))
    e = np.array([-0.3, -0.29, -0.1])
    assert list(normal(foam, e, -0.3, broken=True) != 0.0) == [True, False, False]


def test_shear_gives_back_twice_what_bonds_lose_by_turning() -> None:
    """Under the stress s a bond of the length 1 - e turns as if it had lost s / (1 - e) of G.

    But that kinks are smoothed over 2 % of strain.
    """
    e = -np.array([0.0, 0.2, 0.55, 0.75, 0.88])
    turning = -curve_at(e) / (1 + e)
    expected = np.maximum(FOAM.shear_modulus, 2 * turning)
    np.testing.assert_allclose(shear_modulus(constants(FOAM), e), expected, rtol=0.04)
    assert expected[-1] > 10 * expected[0]
