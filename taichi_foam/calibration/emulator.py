"""An emulator of a scene: Gaussian processes of its figures over the parameters.

One process for each figure, each normalised, with one length per parameter (Matern, nu = 5/2) and
white noise: figures of broken foam scatter between runs of almost equal values, and the noise takes
that up. The predicted deviation therefore holds the scatter of a single run as well as what the
runs leave unknown (Rasmussen & Williams 2006, chapters 2, 4 and 5).

Predictions are checked by leaving out each run once, in closed form (ibid., Eqs. 5.10 to 5.12):
where the errors are larger than predicted, deviations are widened, and their correlation between
figures becomes that of the emulator, since a run that stops late has many figures that deviate.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from taichi_foam.calibration.space import sobol
from taichi_foam.errors import UserError, installed

Array = NDArray[np.float64]

LEAST_RUNS = 12
"""Fewest runs with figures that an emulator is made of."""

_PURPOSE, _EXTRA = "calibrating", "taichi-foam[calibrate]"
_LENGTHS = (0.05, 50.0)
"""Bounds of a length, in ranges: a parameter with the longest has no influence."""

_NO_SPREAD = 1e-9


@dataclass(frozen=True)
class Emulator:
    """Figures (k) as functions of d parameters in coordinates from 0 to 1.

    errors       (n, k) of the runs, each left out, in predicted deviations
    explained    (k,) part of the variance of the runs that is predicted when each is left out
    widening     (k,) factor of the deviations, at least 1
    correlation  (k, k) of the errors
    """

    errors: Array
    explained: Array
    widening: Array
    correlation: Array
    _processes: tuple[Any, ...]
    _classifier: Any

    def predict(self, unit: Array) -> tuple[Array, Array]:
        """Means and standard deviations (m, k) of a run's figures at points (m, d)."""
        found = [process.predict(unit, return_std=True) for process in self._processes]
        mean, deviation = (np.stack(each, axis=1) for each in zip(*found, strict=True))
        return mean, deviation * self.widening

    def success(self, unit: Array) -> Array:
        """Probability (m,) that a run at points (m, d) does not fail."""
        if self._classifier is None:
            return np.ones(len(unit))
        return self._classifier.predict_proba(unit)[:, 1]


def emulator_of(unit: Array, figures: Array, seed: int = 0) -> Emulator:
    """The emulator of runs.

    Args:
        unit: (n, d) coordinates of the runs' parameters.
        figures: (n, k) figures; a run with any that is not finite has failed.
        seed: of the search for the processes' constants.

    Raises:
        UserError: too few runs have figures, or scikit-learn is not installed.
    """
    with installed(_PURPOSE, _EXTRA):
        from sklearn.covariance import LedoitWolf
        from sklearn.exceptions import ConvergenceWarning
        from sklearn.gaussian_process import GaussianProcessClassifier, GaussianProcessRegressor
        from sklearn.gaussian_process.kernels import RBF, ConstantKernel, Matern, WhiteKernel

    good = np.asarray(np.isfinite(figures).all(axis=1))
    if good.sum() < LEAST_RUNS:
        raise UserError(
            f"only {good.sum()} of {len(good)} runs have the figures of the trace; an emulator "
            f"needs {LEAST_RUNS}. Fix: take narrower ranges, or more --runs"
        )
    inside, known = unit[good], figures[good]
    lengths: Any = np.full(unit.shape[1], 0.5)  # their type is declared as that of one
    processes, errors, explained = [], [], []
    with warnings.catch_warnings():
        # a length or a noise at its bound is a finding, not a failure
        warnings.simplefilter("ignore", ConvergenceWarning)
        for column in known.T:
            kernel = ConstantKernel(1.0, (1e-2, 1e2)) * Matern(
                lengths, _LENGTHS, nu=2.5
            ) + WhiteKernel(1e-2, (1e-6, 1.0))
            process = GaussianProcessRegressor(
                kernel, alpha=1e-10, normalize_y=True, n_restarts_optimizer=1, random_state=seed
            ).fit(inside, column)
            processes.append(process)
            off, deviation = _left_out(process)
            errors.append(off / deviation)
            explained.append(1.0 - np.mean(off**2))
        classifier = None
        if not good.all():
            classifier = GaussianProcessClassifier(
                1.0 * RBF(lengths, (0.1, 10.0)), random_state=seed
            ).fit(unit, good)
    errors = np.stack(errors, axis=1)
    shared = LedoitWolf(assume_centered=True).fit(errors).covariance_
    size = np.sqrt(np.diag(shared))
    return Emulator(
        errors=errors,
        explained=np.array(explained),
        widening=np.maximum(1.0, np.sqrt(np.mean(errors**2, axis=0))),
        correlation=shared / np.outer(size, size),
        _processes=tuple(processes),
        _classifier=classifier,
    )


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
    unit = sobol(dimension, 4096, seed)
    mean, _ = emulator.predict(unit)
    whole = mean.var(axis=0)
    found = np.zeros((mean.shape[1], dimension))
    for d in range(dimension):
        order = np.argsort(unit[:, d])
        classes = mean[order].reshape(16, -1, mean.shape[1]).mean(axis=1)
        found[:, d] = classes.var(axis=0)
    return found / np.maximum(whole, np.finfo(float).tiny)[:, None]


def _left_out(process: Any) -> tuple[Array, Array]:
    """Errors and predicted deviations (n,) of each run left out, in spreads of the figures."""
    from scipy.linalg import cho_solve

    inverse = cho_solve((process.L_, True), np.eye(len(process.L_)))
    variance = 1.0 / np.diag(inverse)
    return np.ravel(process.alpha_) * variance, np.sqrt(variance)
