"""What measured figures say about parameters: implausibility, and the posterior.

The measured figures are those of a run, plus errors of measurement, plus what the model lacks:

    z = f(theta) + e + b,   e ~ N(0, E),   b ~ N(0, diag((delta s)^2))

f is the emulator (mean and covariance), E the covariance of the measured figures, s their sizes,
and delta the model discrepancy, a relative deviation of its own (Kennedy & O'Hagan 2001, with
independent discrepancies of the figures). It is given, or estimated together with the parameters;
its prior is then half normal.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from taichi_foam.calibration.emulator import Emulator
from taichi_foam.sweeps.sampling import unit_points

Array = NDArray[np.float64]

RULED_OUT = 3.0
"""A point is ruled out when figures are more than this many deviations away (Pukelsheim 1994: at
most 5 % of any unimodal distribution lies beyond)."""

FAR = 2.0 * RULED_OUT
"""Runs that are further away leave the next emulator, which then knows nothing of that region."""

DISCREPANCY = 0.05
"""Scale of the prior of a model discrepancy that is estimated, as a part of the figures' size."""

_BEYOND = 1e3  # deviations beyond `FAR` that count
_BURNT = 3  # autocorrelation times at the start that are not used
_ENOUGH = 20  # autocorrelation times of a chain that is long enough: it begins where it is likely
_BLOCK = 200  # steps between checks of that


@dataclass(frozen=True)
class Target:
    """Measured figures (k), and the emulator of the runs that are compared with them.

    covariance  (k, k) of the errors of measurement
    size        (k,) to which the model discrepancy is relative
    tolerated   the discrepancy with which points are ruled out
    before      that of the wave before
    """

    emulator: Emulator
    measured: Array
    covariance: Array
    size: Array
    tolerated: float = DISCREPANCY
    before: Target | None = None

    def implausibility(self, unit: Array) -> Array:
        """How many deviations away the figures are at points (m, d), by the worst wave: (m,).

        The second largest over the figures, so that a single emulator that errs rules nothing out;
        the largest of less than four figures (Craig et al. 1997; Vernon, Goldstein & Bower 2010).
        Where a run would rather fail than not, it is infinite.
        """
        mean, deviation = self.emulator.predict(unit)
        spread = deviation**2 + np.diag(self.covariance) + (self.tolerated * self.size) ** 2
        away = np.sort(np.abs(self.measured - mean) / np.sqrt(spread), axis=1)
        found = away[:, -2] if away.shape[1] >= 4 else away[:, -1]
        found = np.where(self.emulator.success(unit) < 0.5, np.inf, found)
        return found if self.before is None else np.maximum(found, self.before.implausibility(unit))

    def log_likelihood(self, unit: Array, discrepancy: Array) -> Array:
        """Logarithm (m,) of the likelihood at points (m, d) with discrepancies (m,).

        What was far away by an earlier wave stays unlikely: without runs there, the emulator falls
        back to its prior, which is wide enough to hold any measurement.
        """
        mean, deviation = self.emulator.predict(unit)
        shared = self.emulator.doubt * self.emulator.correlation
        simulated = deviation[:, :, None] * shared * deviation[:, None, :]
        lacking = np.eye(len(self.size)) * ((discrepancy[:, None] * self.size) ** 2)[:, None, :]
        factor = np.linalg.cholesky(simulated + self.covariance + lacking)
        off = np.linalg.solve(factor, (self.measured - mean)[:, :, None])[:, :, 0]
        log_size = np.log(np.diagonal(factor, axis1=1, axis2=2)).sum(axis=1)
        with np.errstate(divide="ignore"):
            succeeds = np.log(self.emulator.success(unit))
        found = -0.5 * (off**2).sum(axis=1) - log_size + succeeds
        if self.before is not None:
            # finite and smooth, so that a chain that begins outside finds its way in
            found -= 0.5 * np.clip(self.before.implausibility(unit) - FAR, 0.0, _BEYOND) ** 2
        return found


@dataclass(frozen=True)
class Posterior:
    """Samples of the posterior.

    unit         (n, d) parameters, in coordinates from 0 to 1
    discrepancy  (n,) model discrepancy, a part of the figures' size
    independent  number of independent samples that these are worth, of the least mixed parameter
    accepted     part of the proposals that were accepted
    """

    unit: Array
    discrepancy: Array
    independent: float
    accepted: float

    @cached_property
    def correlation(self) -> Array:
        """Correlations (d, d) of the parameters."""
        return np.atleast_2d(np.corrcoef(self.unit.T))


def sample(
    targets: Sequence[Target],
    dimension: int,
    discrepancy: float | None = None,
    seed: int = 0,
    most: int = 3000,
) -> Posterior:
    """Sample the posterior of parameters by emcee's ensemble of walkers (Goodman & Weare 2010).

    Args:
        targets: what was measured; several tests with the same parameters are independent.
        dimension: number d of parameters; their prior is uniform from 0 to 1.
        discrepancy: the model discrepancy; None: estimated, with a half-normal prior.
        seed: of all random numbers.
        most: steps after which it ends, if the chain is not long enough before.
    """
    import emcee

    estimated = discrepancy is None
    size = dimension + estimated

    def log_posterior(points: Array) -> Array:
        unit, scale = points[:, :dimension], np.full(len(points), discrepancy or 0.0)
        inside = ((unit >= 0) & (unit <= 1)).all(axis=1)
        prior = np.zeros(len(points))
        if estimated:
            scale = points[:, dimension]
            inside &= scale >= 0
            prior -= 0.5 * (scale / DISCREPANCY) ** 2
        found = np.full(len(points), -np.inf)
        if inside.any():
            likely = [t.log_likelihood(unit[inside], scale[inside]) for t in targets]
            found[inside] = prior[inside] + np.sum(likely, axis=0)
        return found

    random = np.random.default_rng(seed)
    walkers = max(64, 4 * size)
    start = unit_points("sobol", size, 4096, seed)
    if estimated:
        start[:, dimension] *= 2.0 * DISCREPANCY
    # walkers begin where the prior's points are likely, so that hardly any steps are lost
    likely = log_posterior(start)
    weights = np.exp(likely - likely.max())
    first = start[random.choice(len(start), walkers, p=weights / weights.sum())]
    first = np.clip(first + 1e-3 * random.normal(size=first.shape), 1e-9, 1 - 1e-9)
    sampler = emcee.EnsembleSampler(walkers, size, log_posterior, vectorize=True)
    state = np.random.RandomState(seed).get_state()
    now = emcee.State(first, random_state=state)
    while sampler.iteration < most:
        now = sampler.run_mcmc(now, min(_BLOCK, most - sampler.iteration))
        times = np.asarray(sampler.get_autocorr_time(tol=0))
        slowest = float(np.nanmax(times)) if np.isfinite(times).any() else float(most)
        if sampler.iteration > _ENOUGH * slowest:
            break
    burnt = min(int(_BURNT * slowest), sampler.iteration // 2)
    chain = np.asarray(sampler.get_chain(discard=burnt, flat=True))
    return Posterior(
        unit=chain[:, :dimension],
        discrepancy=chain[:, dimension] if estimated else np.full(len(chain), discrepancy),
        independent=len(chain) / slowest,
        accepted=float(np.mean(sampler.acceptance_fraction)),
    )


def next_points(target: Target, dimension: int, count: int, seed: int) -> tuple[Array, float]:
    """Points (count, d) for another wave, in what is not ruled out, and the part that this is.

    The first points of a Sobol sequence that the target does not rule out. If there are too few, as
    when nothing within the ranges agrees with the measurement, the least implausible ones fill up.
    """
    unit = unit_points("sobol", dimension, 2**13, seed)
    away = target.implausibility(unit)
    left = np.flatnonzero(away <= RULED_OUT)
    part = len(left) / len(unit)
    chosen = left[:count] if len(left) >= count else np.argsort(away, kind="stable")[:count]
    return unit[chosen], part
