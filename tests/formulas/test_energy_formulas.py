"""The energy balance on curves of points against closed forms and against a fine table."""

from __future__ import annotations

import numpy as np
import pytest

from taichi_foam.errors import UserError
from taichi_foam.formulas import energy
from taichi_foam.laws.bond.kinds.crushable import Foam

EXACT = 1e-9
FALL, THICK = 0.76, 0.05


@pytest.mark.parametrize(("plateau", "locking"), [(2e5, 0.7), (45e3, 0.83)])
def test_a_foam_that_locks(plateau: float, locking: float) -> None:
    """Its best static stress and G = h / (e_D T); one a little above it hits the locked foam."""
    curve = [0.0, 0.0, locking, locking], [0.0, plateau, plateau, 1e9]
    stroke = locking * THICK
    static, least = plateau * stroke / (FALL + stroke), FALL / stroke
    found, stop = energy.optimum(*curve, FALL, THICK)
    assert found == pytest.approx(static, rel=EXACT)
    assert (stop.strain, stop.stress) == pytest.approx((locking, plateau), rel=EXACT)
    assert stop.g == pytest.approx(least, rel=EXACT)
    assert energy.stop(*curve, static, FALL, THICK).g == pytest.approx(least, rel=EXACT)
    assert energy.stop(*curve, 1.0001 * static, FALL, THICK) is None
    # below the optimum the whole plateau decelerates: G = sigma_pl / sigma_st - 1
    light = energy.stop(*curve, 0.3 * static, FALL, THICK)
    assert light.g == pytest.approx(plateau / (0.3 * static) - 1.0, rel=EXACT)
    way = FALL * 0.3 * static / (THICK * (plateau - 0.3 * static))
    assert light.strain == pytest.approx(way, rel=EXACT)


@pytest.mark.parametrize("points", [2, 7, 1000])
def test_a_linear_foam(points: int) -> None:
    """G = sqrt(1 + 2 h E / (sigma_st T)), whatever the points of its curve."""
    modulus = 4e5
    strain = np.sort(np.random.default_rng(points).uniform(0.0, 0.9, points))
    strain[[0, -1]] = 0.0, 0.9
    statics = np.geomspace(50.0, 9e3, 9)
    found = energy.cushion_curve(strain, modulus * strain, FALL, THICK, statics)
    for static, g in zip(statics, found, strict=True):
        assert g == pytest.approx((1 + 2 * FALL * modulus / (static * THICK)) ** 0.5, rel=EXACT)
    # up to the end of its curve it takes E e^2 T / 2 = sigma_st (h + e T), and is best there
    last = 0.5 * modulus * 0.9**2 * THICK / (FALL + 0.9 * THICK)
    static, stop = energy.optimum(strain, modulus * strain, FALL, THICK)
    assert static == pytest.approx(last, rel=EXACT)
    assert stop.g == pytest.approx((1 + 2 * FALL * modulus / (last * THICK)) ** 0.5, rel=EXACT)
    assert np.isnan(
        energy.cushion_curve(strain, modulus * strain, FALL, THICK, [1.001 * last])
    ).all()


def test_the_largest_efficiency_of_the_papers_foam() -> None:
    """Eq. 26 with Table 6's constants: e_d - e_y / 2 where densification begins.

    It does if the stress rises steeply enough from there: d(sigma)/d(strain) of at least
    sigma / (e_d - e_y / 2), which is a (e_d - e_y / 2) >= (e_l - e_d)^b.
    """
    foam = Foam()
    yields, begins = -foam.yield_strain, -foam.densification_strain
    strain = np.union1d(np.linspace(0.0, 0.94, 941), [yields, begins])
    stress = foam.loading(strain)
    expected = begins - 0.5 * yields
    assert expected == pytest.approx(0.775, rel=EXACT)
    assert energy.efficiency(strain, stress).max() == pytest.approx(expected, rel=EXACT)
    assert energy.densification_onset(strain, stress) == begins
    # the optimum of any cushion lies at G + 1 = sigma (h + e T) / (T W) of the same strain
    static, stop = energy.optimum(strain, stress, 1e3 * THICK, THICK)
    assert stop.strain == pytest.approx(begins, rel=EXACT)
    assert stop.g + 1 == pytest.approx((1e3 + begins) / expected, rel=EXACT)
    assert static == pytest.approx(foam.plateau_stress / (stop.g + 1), rel=EXACT)


def test_ratios_of_a_rigid_plastic_and_a_linear_foam() -> None:
    """W / (sigma e) is 1 and 1/2."""
    strain = np.array([0.0, 0.2, 0.5])
    linear, flat = 1e5 * strain, np.full(3, 1e5)
    assert energy.absorbed_energy(strain, linear) == pytest.approx(0.5e5 * strain**2)
    assert energy.ideality(strain, flat)[1:] == pytest.approx(1.0)
    assert energy.ideality(strain, linear)[1:] == pytest.approx(0.5)
    assert energy.efficiency(strain, linear) == pytest.approx(0.5 * strain)


@pytest.mark.parametrize("seed", range(12))
def test_any_curve_against_a_fine_table(seed: int) -> None:
    """Curves that fall and rise again: the first strain at which the table has taken enough."""
    random = np.random.default_rng(seed)
    count = int(random.integers(3, 12))
    strain = np.append(0.0, np.sort(random.uniform(0.05, 0.95, count)))
    stress = np.append(0.0, random.uniform(1e4, 1e5, count))
    fall, thick = random.uniform(0.05, 1.0), random.uniform(0.02, 0.2)
    fine = np.union1d(np.linspace(0.0, strain[-1], 200_001), strain)
    pressed = np.interp(fine, strain, stress)
    parts = 0.5 * (pressed[1:] + pressed[:-1]) * np.diff(fine)
    taken, step = np.append(0.0, np.cumsum(parts)), strain[-1] / 2e5
    static, best = energy.optimum(strain, stress, fall, thick)
    for each in static * random.uniform(0.1, 1.5, 6):
        enough = thick * taken >= each * (fall + thick * fine)
        found = energy.stop(strain, stress, each, fall, thick)
        assert (found is None) == (not enough.any())
        if found is None:
            continue
        at = int(np.argmax(enough))
        assert fine[at] - found.strain == pytest.approx(0.0, abs=1.01 * step)
        steepest = np.abs(np.diff(stress) / np.diff(strain)).max()
        assert found.stress == pytest.approx(pressed[: at + 1].max(), abs=2 * steepest * step)
        assert found.g == pytest.approx(found.stress / each - 1.0)
    # no static stress of a fine range does better, and the optimum is one of the curve's own stops
    range_of = energy.cushion_curve(
        strain, stress, fall, thick, static * np.geomspace(0.02, 3.0, 400)
    )
    assert best.g <= np.nanmin(range_of) * (1 + EXACT)
    assert energy.stop(strain, stress, static, fall, thick).g == pytest.approx(best.g, rel=1e-6)


def test_the_usual_range() -> None:
    """A linear foam, whose optimum is at the end of its curve, and one that locks."""
    linear = [0.0, 0.5], [0.0, 5e4]
    best, _ = energy.optimum(*linear, 1.0, 0.05)
    found = energy.usual_range(*linear, 1.0, 0.05, 4e4)
    assert found == pytest.approx((best / 6.0, 1.2 * best), rel=1e-12)
    locks = [0.0, 1e-9, 0.7, 0.9], [0.0, 1e5, 1e5, 1e6]
    best, least = energy.optimum(*locks, 0.76, 0.05)
    low, high = energy.usual_range(*locks, 0.76, 0.05, 1e5)
    assert low == pytest.approx(best / 6.0, rel=1e-12)
    ends = energy.cushion_curve(*locks, 0.76, 0.05, [high, 1.02 * high])
    assert ends[0] <= 3.0 * least.g < ends[1]
    # a thick pad and a short fall: at the optimum the weight alone would crush it
    low, high = energy.usual_range(*locks, 0.01, 0.3, 1e5)
    assert high == pytest.approx(9.5e4, rel=1e-12)
    assert high < 6.0 * low == pytest.approx(energy.optimum(*locks, 0.01, 0.3)[0], rel=1e-12)


@pytest.mark.parametrize(
    ("curve", "numbers", "said"),
    [
        (([0, 10, 50], [0, 1e5, 2e5]), {}, "strains are fractions"),
        (([0.1, 0.5], [1e5, 2e5]), {}, "must begin at rest"),
        (([0, 0.5, 0.4], [0, 1e5, 0]), {}, "cut the unloading off"),
        (([0, 0.5], [0, np.nan]), {}, "not finite"),
        (([0, 0.5], [0, -1e5]), {}, "positive in compression"),
        (([0, 0.5], [0, 1e5, 2e5]), {}, "as many strains as stresses"),
        (([0, 0.5], [0, 1e5]), {"drop_height": 0.0}, "drop_height = 0: must be a number above 0 m"),
        (
            ([0, 0.5], [0, 1e5]),
            {"static_stress": -1.0},
            "static_stress = -1: must be a number above 0 Pa",
        ),
        (
            ([0, 0.5], [0, 1e5]),
            {"thickness": np.inf},
            "thickness = inf: must be a number above 0 m",
        ),
    ],
)
def test_what_is_no_curve_and_no_drop(curve: tuple, numbers: dict, said: str) -> None:
    values = {"static_stress": 5e3, "drop_height": FALL, "thickness": THICK} | numbers
    with pytest.raises(UserError, match=said):
        energy.stop(*curve, **values)
