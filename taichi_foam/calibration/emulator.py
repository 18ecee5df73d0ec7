"""An emulator of a scene: Gaussian processes of its figures over the parameters.

One process for each figure, each normalised, with one length per parameter (Matern, nu = 5/2) and
white noise: figures of broken foam scatter between runs of almost equal values, and the noise takes
that up. The predicted deviation therefore holds the scatter of a single run as well as what the
runs leave unknown (Rasmussen & Williams 2006, chapters 2, 4 and 5). A parameter counts for a figure
only if the runs show that it does: among many lengths that are fitted to scattered runs, some are
short by chance, and the trace would then seem to determine what has no influence.

Predictions are checked by leaving out each run once, in closed form (ibid., Eqs. 5.10 to 5.12):
where the errors are larger than predicted, deviations are widened, and their correlation between
figures becomes that of the emulator, since a run that stops late has many figures that deviate.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from taichi_foam.calibration.reading import doubt
from taichi_foam.errors import UserError
from taichi_foam.sweeps.sampling import unit_points

Array = NDArray[np.float64]

LEAST_RUNS = 12
"""Fewest runs with figures that an emulator is made of."""

_LONGEST = 50.0
"""Longest length, in ranges: a parameter that has it has no influence."""

_BY_CHANCE = 0.05
"""Probability that a parameter without influence counts for any of the figures."""

_NO_SPREAD = 1e-9

_AT_ONCE = 512  # points that are predicted together: their covariances fit into caches


@dataclass(frozen=True)
class _Processes:
    """Fitted processes of k figures over the same n runs, evaluated together.

    scikit-learn evaluates one at a time, and spends most of it on checks: a chain calls them ten
    thousand times with a few points.

    points    (k, n, d) of the runs, divided by the lengths
    lengths   (k, d)
    variance  (k,) of the smooth part
    noise     (k,) variance of the scatter between runs
    weights   (k, n) of the runs in the mean
    inverse   (k, n, n) of their covariance
    mean, size
              (k,) by which figures are normalised
    """

    points: Array
    lengths: Array
    variance: Array
    noise: Array
    weights: Array
    inverse: Array
    mean: Array
    size: Array

    @classmethod
    def of(cls, fitted: Sequence[Any], used: NDArray[np.bool_], unit: Array) -> _Processes:
        """Those of scikit-learn's regressors with a kernel `constant * Matern(5/2) + white`.

        `used` (k, d) tells of which parameters each is a function.
        """
        from scipy.linalg import cho_solve

        smooth = [each.kernel_.k1 for each in fitted]
        lengths = np.full(used.shape, np.inf)
        for own, where, kernel in zip(lengths, used, smooth, strict=True):
            own[where] = kernel.k2.length_scale
        eye = np.eye(len(unit))
        return cls(
            points=unit / lengths[:, None, :],
            lengths=lengths,
            variance=np.array([k.k1.constant_value for k in smooth]),
            noise=np.array([each.kernel_.k2.noise_level for each in fitted]),
            weights=np.stack([np.ravel(each.alpha_) for each in fitted]),
            inverse=np.stack([cho_solve((each.L_, True), eye) for each in fitted]),
            mean=np.array([float(each._y_train_mean) for each in fitted]),
            size=np.array([float(each._y_train_std) for each in fitted]),
        )

    def predict(self, unit: Array) -> tuple[Array, Array]:
        """Means and standard deviations (m, k) of a run's figures at points (m, d)."""
        at = unit / self.lengths[:, None, :]
        squares = (
            (at**2).sum(axis=2)[:, :, None]
            + (self.points**2).sum(axis=2)[:, None, :]
            - 2.0 * at @ self.points.transpose(0, 2, 1)
        )
        away = np.sqrt(5.0 * np.maximum(squares, 0.0))
        shared = self.variance[:, None, None] * (1.0 + away + away**2 / 3.0) * np.exp(-away)
        mean = np.einsum("kmn,kn->km", shared, self.weights)
        known = np.einsum("kmn,kmn->km", shared @ self.inverse, shared)
        # no less than the scatter, which rounding would leave of a difference of large numbers
        variance = np.maximum(self.variance[:, None] - known, 0.0) + self.noise[:, None]
        deviation = np.sqrt(variance)
        return (self.mean[:, None] + self.size[:, None] * mean).T, (
            self.size[:, None] * deviation
        ).T

    def left_out(self) -> tuple[Array, Array]:
        """Errors and predicted deviations (n, k), in spreads, of each run left out."""
        variance = 1.0 / np.diagonal(self.inverse, axis1=1, axis2=2)
        return (self.weights * variance).T, np.sqrt(variance).T


@dataclass(frozen=True)
class Emulator:
    """Figures (k) as functions of d parameters in coordinates from 0 to 1.

    errors       (n, k) of the runs, each left out, in predicted deviations
    explained    (k,) part of the variance of the runs that is predicted when each is left out
    correlation  (k, k) of the errors
    """

    errors: Array
    explained: Array
    correlation: Array
    _processes: _Processes
    _classifier: Any

    @cached_property
    def widening(self) -> Array:
        """(k,) factor of the deviations, at least 1."""
        return np.maximum(1.0, np.sqrt(np.mean(self.errors**2, axis=0)))

    @property
    def doubt(self) -> float:
        """Factor of the covariance of all figures together, which is estimated from the runs."""
        return doubt(*self.errors.shape)

    def predict(self, unit: Array) -> tuple[Array, Array]:
        """Means and standard deviations (m, k) of a run's figures at points (m, d)."""
        parts = np.split(unit, range(_AT_ONCE, len(unit), _AT_ONCE))
        found = zip(*map(self._processes.predict, parts), strict=True)
        mean, deviation = map(np.concatenate, found)
        return mean, deviation * self.widening

    def success(self, unit: Array) -> Array:
        """Probability (m,) that a run at points (m, d) does not fail."""
        if self._classifier is None:
            return np.ones(len(unit))
        return self._classifier.predict_proba(unit - 0.5)[:, 1]


def emulator_of(unit: Array, figures: Array, seed: int = 0) -> Emulator:
    """The emulator of runs.

    Args:
        unit: (n, d) coordinates of the runs' parameters.
        figures: (n, k) figures; a run with any that is not finite has failed.
        seed: of the search for the processes' constants.

    Raises:
        UserError: too few runs have figures.
    """
    from scipy.stats import chi2
    from sklearn.covariance import LedoitWolf
    from sklearn.exceptions import ConvergenceWarning
    from sklearn.linear_model import LogisticRegression
    from sklearn.pipeline import make_pipeline
    from sklearn.preprocessing import PolynomialFeatures
    from threadpoolctl import threadpool_limits

    good = np.asarray(np.isfinite(figures).all(axis=1))
    if good.sum() < LEAST_RUNS:
        raise UserError(
            f"only {good.sum()} of {len(good)} runs have the figures of the trace; an emulator "
            f"needs {LEAST_RUNS}. Fix: take narrower ranges, or more --runs"
        )
    inside, known = unit[good], figures[good]
    # by chance, twice the logarithm of a ratio of likelihoods is 0 in half of the cases, since
    # no influence is the end of a length's range, and else as chi-squared (Self & Liang 1987)
    least = 0.5 * float(chi2.isf(min(2.0 * _BY_CHANCE / known.shape[1], 0.5), 1))
    # matrices this small are slower on several threads, and much slower beside other work
    with threadpool_limits(1, "blas"), warnings.catch_warnings():
        # a length or a noise at its bound is a finding, not a failure
        warnings.simplefilter("ignore", ConvergenceWarning)
        fitted, used = zip(
            *(_process(inside, column, least, seed) for column in known.T), strict=True
        )
        classifier = None
        if not good.all():
            # quadratic: unlike a process, it does not return to doubt far from the boundary
            classifier = make_pipeline(
                PolynomialFeatures(2), LogisticRegression(C=100.0, max_iter=1000)
            ).fit(unit - 0.5, good)
    processes = _Processes.of(fitted, np.array(used), inside)
    off, deviation = processes.left_out()
    errors = off / deviation
    shared = LedoitWolf(assume_centered=True).fit(errors).covariance_
    size = np.sqrt(np.diag(shared))
    return Emulator(
        errors=errors,
        explained=1.0 - np.mean(off**2, axis=0),
        correlation=shared / np.outer(size, size),
        _processes=processes,
        _classifier=classifier,
    )


def _process(unit: Array, figure: Array, least: float, seed: int) -> tuple[Any, NDArray[np.bool_]]:
    """The process of one figure (n,), and of which parameters (d,) it is a function.

    Those are left out without which the logarithm of the likelihood falls by less than `least`.
    """
    from sklearn.gaussian_process import GaussianProcessRegressor
    from sklearn.gaussian_process.kernels import ConstantKernel, Matern, WhiteKernel

    # what is finer than the runs are apart cannot be told from their scatter
    finest = min(len(unit) ** (-1.0 / unit.shape[1]), 0.5)

    def of(columns: NDArray[np.intp], lengths: Any, size: float = 1.0, noise: float = 1e-2) -> Any:
        kernel = ConstantKernel(size, (1e-2, 1e2)) * Matern(
            lengths, (finest, _LONGEST), nu=2.5
        ) + WhiteKernel(noise, (1e-6, 1.0))
        process = GaussianProcessRegressor(kernel, alpha=1e-10, normalize_y=True, random_state=seed)
        return process.fit(unit[:, columns], figure)

    everything = np.arange(unit.shape[1])
    found = of(everything, np.full(len(everything), 0.5))
    smooth, noise = found.kernel_.k1, found.kernel_.k2.noise_level
    lengths = np.broadcast_to(smooth.k2.length_scale, everything.shape)

    def without(gone: NDArray[np.intp]) -> Any:
        rest = np.setdiff1d(everything, gone)
        return of(rest, lengths[rest], smooth.k1.constant_value, noise)

    losses = np.array(
        [
            found.log_marginal_likelihood_value_ - without(each).log_marginal_likelihood_value_
            for each in everything[:, None]
        ]
        if len(everything) > 1
        else [np.inf]
    )
    idle = losses < least
    idle[np.argmax(losses)] = False  # a process is a function of something
    if idle.any():
        found = without(everything[idle])
    return found, ~idle


def spreads(figures: Array) -> NDArray[np.bool_]:
    """Which figures (n, k) differ between the runs that have them: a constant tells nothing."""
    good = figures[np.isfinite(figures).all(axis=1)]
    if not len(good):
        return np.ones(figures.shape[1], bool)
    return np.ptp(good, axis=0) > _NO_SPREAD * np.abs(good).max(axis=0)


def influences(emulator: Emulator, dimension: int, seed: int = 0) -> Array:
    """Part (k, d) of each figure's variance over the prior that each parameter alone explains.

    The first-order indices of Sobol (1993): the variance of the mean over all other parameters,
    from the emulator's means at 4096 points in 16 classes of the parameter.
    """
    unit = unit_points("sobol", dimension, 4096, seed)
    mean, _ = emulator.predict(unit)
    whole = mean.var(axis=0)
    found = np.zeros((mean.shape[1], dimension))
    for d in range(dimension):
        order = np.argsort(unit[:, d])
        classes = mean[order].reshape(16, -1, mean.shape[1]).mean(axis=1)
        found[:, d] = classes.var(axis=0)
    return found / np.maximum(whole, np.finfo(float).tiny)[:, None]
