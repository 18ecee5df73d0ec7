"""Laws fitted to tests: Eq. 26 to a measured curve, and the way back of foam that springs back.

The error of the fit tells how well the paper's law can describe a foam. Its level plateau cannot
follow one that hardens; the tabulated law, which uses the curve itself, can.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from taichi_foam.formulas.energy import absorbed_energy
from taichi_foam.laws.bond.by_curve import SHEAR_OVER_PLATEAU, SHEAR_OVER_YOUNG
from taichi_foam.laws.bond.curve import LOCKS, Curve
from taichi_foam.laws.bond.kinds import crushable
from taichi_foam.laws.bond.kinds.crushable import Foam

Array = NDArray[np.float64]

PAPER = Foam()

_LEAST_YOUNG, _LARGEST_YOUNG = 1000.0 / SHEAR_OVER_YOUNG, 1e11
"""Range of Young's modulus [Pa] for which the shear modulus is within its allowed range, too."""

_FLOOR = 0.1
"""Fraction of the plateau stress added to the stress by which residuals are divided."""

_FAR = 0.1
"""Relative residuals beyond this weigh less, so that the fit is not distorted by parts of the curve
that the law cannot follow."""


_EARLIEST = 0.75
"""Densification begins at this fraction of the strain of largest energy efficiency, or later.

Otherwise the densification branch would follow a hardening plateau, and foam crushed to the middle
of its plateau would spring back as densified foam does.
"""


@dataclass(frozen=True)
class CrushableFit:
    """Eq. 26 fitted to a curve.

    foam       the fitted constants; strengths follow from the plateau, as for the tabulated law
    error      median over strain of |fit - test| / test, from the start of crushing
    densifies  whether the test went beyond densification; if not, the constants of that branch are
               the paper's, with strains moved beyond the end of the test if necessary
    """

    foam: Foam
    error: float
    densifies: bool


def crushable_fit(curve: Curve) -> CrushableFit:
    """Fit Eq. 26 to a curve by bounded least squares of relative residuals.

    Each point is weighted by the strain interval it represents, so that the fit does not depend on
    the sampling of the test. The locking strain is free between the end of the test and 1.
    """
    strain, stress = _spread_out(curve)
    spacing = np.gradient(strain)
    plateau = curve.plateau_stress
    weights = np.sqrt(spacing / spacing.sum()) / (stress + _FLOOR * plateau)

    def residuals(x: Array) -> Array:
        return weights * (crushable.loading_stress(strain, *_constants(x, curve)) - stress)

    densifies = curve.densification < curve.tested
    # SciPy's trust region recovers from such values
    with np.errstate(over="ignore", divide="ignore", invalid="ignore"):
        best = _solved(residuals, curve, densifies)
    young, yields, densification, locking, a, b = (float(c) for c in _constants(best, curve))
    if not densifies:  # the paper's constants, or strains beyond the test
        densification = max(-PAPER.densification_strain, 0.5 * (1.0 + curve.tested))
        locking = densification + LOCKS * (1.0 - densification)
        a, b = PAPER.densification_a, PAPER.densification_b
    shear = SHEAR_OVER_YOUNG * young
    foam = Foam(
        youngs_modulus=young,
        shear_modulus=shear,
        yield_strain=-yields,
        tensile_strain=yields,
        shear_strain=SHEAR_OVER_PLATEAU * young * yields / shear,
        densification_strain=-densification,
        locking_strain=-locking,
        densification_a=a,
        densification_b=b,
    )
    return CrushableFit(foam, _median_error(foam, curve), densifies)


def _solved(residuals: Callable[[Array], Array], curve: Curve, densifies: bool) -> Array:
    """The best solution from several starts: the constants of densification are correlated."""
    from scipy.optimize import least_squares

    plateau = curve.plateau_stress
    half = float(np.interp(0.5 * plateau, curve.stress, curve.strain))
    young = np.clip(0.5 * plateau / max(half, 1e-9), 1.01 * _LEAST_YOUNG, 0.99 * _LARGEST_YOUNG)
    low = np.array([np.log(_LEAST_YOUNG), np.log(0.05 * plateau), 0.01, 0.001, -7.0, np.log(0.1)])
    high = np.array(
        [np.log(_LARGEST_YOUNG), np.log(20 * plateau), 0.99, 0.999, np.log(10), np.log(5)]
    )
    elastic = [np.log(young), np.log(plateau)]
    accuracy: dict[str, Any] = {
        "loss": "soft_l1", "f_scale": _FAR, "max_nfev": 300,
        "xtol": 1e-12, "ftol": 1e-12, "gtol": 1e-12,
    }  # fmt: skip
    if not densifies:
        # the branch begins where the test ends: there is nothing to fit it to
        fixed = np.array([0.99, 0.999, np.log(0.5), 0.0])
        bounds = (low[:2], high[:2])
        found = least_squares(
            lambda x: residuals(np.append(x, fixed)), elastic, bounds=bounds, **accuracy
        )
        return np.append(found.x, fixed)
    solutions = []
    for later, room, b in itertools.product((0.05, 0.3, 0.6), (0.2, 0.7), (0.5, 1.0, 2.0)):
        start = [*elastic, later, room, np.log(0.5), np.log(b)]
        solutions.append(
            least_squares(residuals, start, bounds=(low, high), x_scale="jac", **accuracy)
        )
    return min(solutions, key=lambda solution: solution.cost).x


def _constants(x: Array, curve: Curve) -> tuple[float, ...]:
    """K, e_y, e_d, e_l, a and b from the fit's variables; the strains are always in order."""
    young = np.exp(x[0])
    yields = np.clip(np.exp(x[1] - x[0]), 1e-5, 0.5)
    locking = max(curve.tested, yields) + x[3] * (1.0 - max(curve.tested, yields))
    earliest = max(yields, _EARLIEST * curve.densification)
    densification = earliest + x[2] * (locking - earliest)
    return young, yields, densification, locking, np.exp(x[4]), np.exp(x[5])


def _spread_out(curve: Curve) -> tuple[Array, Array]:
    """The points of a curve, with interpolated ones added if there are few."""
    strain, stress = curve.points
    if strain.size < 100:
        strain = np.union1d(strain, np.linspace(0.0, curve.tested, 200))
        stress = curve.stress_at(strain)
    return strain, stress


def _median_error(foam: Foam, curve: Curve) -> float:
    """Median of |fit - test| / test at evenly spaced strains from the start of crushing."""
    strain = np.linspace(min(-foam.yield_strain, 0.5 * curve.tested), curve.tested, 500)
    # a test may begin with zero stress
    test = np.maximum(curve.stress_at(strain), 1e-3 * curve.plateau_stress)
    return float(np.median(np.abs(foam.loading(strain) / test - 1.0)))


@dataclass(frozen=True)
class ReturnFit:
    """The way back of `recovering` foam, fitted to an unloading branch.

    factor, shape, left  HU, SHAPE and the set, see `laws.bond.kinds.recovering`
    given_back           energy returned over energy taken in the test
    error                root mean square of fit less test, over the stress at the start
    """

    factor: float
    shape: float
    left: float
    given_back: float
    error: float


def return_fit(curve: Curve, strain: Array, stress: Array) -> ReturnFit:
    """The way back that fits an unloading branch best, by least squares of its stress.

    Args:
        curve: the loading curve.
        strain: strains of the branch (n,), from the largest one down; compression positive.
        stress: stresses [Pa] there.
    """
    from scipy.optimize import least_squares  # slow to import

    worst = float(strain[0])
    fine = np.linspace(0.0, worst, 2001)
    loading = curve.stress_at(fine)
    taken = absorbed_energy(fine, loading)
    top = max(float(loading[-1]), 1e-9)

    def stress_of(values: Array) -> Array:
        factor, shape, left = values
        x = np.clip((strain - left * worst) / (1.0 - left), 0.0, worst)
        share = np.interp(x, fine, taken) / taken[-1]
        return np.interp(x, fine, loading) * (factor + (1.0 - factor) * share**shape)

    reaches = strain[stress <= 0.02 * stress[0]]
    left = float(np.clip(reaches[0] / worst, 0.0, 0.85)) if reaches.size else 0.0
    best = min(
        (
            least_squares(
                lambda values: (stress_of(values) - stress) / top,
                (0.2, shape, left),
                bounds=((0.001, 0.1, 0.0), (1.0, 50.0, 0.9)),
            )
            for shape in (1.0, 5.0)
        ),
        key=lambda found: float(found.cost),
    )
    back = float(np.sum(0.5 * (stress[1:] + stress[:-1]) * -np.diff(strain)))
    return ReturnFit(
        *(float(f"{value:.4g}") for value in best.x),
        given_back=back / float(taken[-1]),
        error=float(np.sqrt(np.mean(best.fun**2))),
    )
