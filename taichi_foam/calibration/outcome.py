"""A finished calibration: parameters with their intervals, and what was checked."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from taichi_foam.calibration.emulator import influences
from taichi_foam.calibration.posterior import Posterior, Target
from taichi_foam.calibration.reading import Reading
from taichi_foam.calibration.runs import Runs
from taichi_foam.calibration.space import Space
from taichi_foam.errors import UserError
from taichi_foam.scene import Scene
from taichi_foam.scene.keys import keys

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

LEVELS = (0.05, 0.5, 0.95)
"""Quantiles of all intervals and bands: they hold 90 %."""

AS_WIDE = 0.75
"""A parameter is not determined if its interval is at least this part of the prior's: with 64 runs
a parameter without influence comes out between 0.9 and 1."""

TOGETHER = 0.85
"""Two parameters are determined only together from this correlation on ..."""

_WIDE = 0.35  # ... if the interval of each is at least this part of the prior's

NINETY = 1.6449
"""Standard deviations either side that hold 90 % of a normal distribution."""

_AT_END, _AT_END_PART = 0.02, 0.1
"""An interval leans on an end of its range if a tenth of the samples is in its last 2 %."""


@dataclass(frozen=True)
class Parameter:
    """What is known of a parameter after the calibration.

    key        of the scene
    unit       SI; "-" for a plain number
    prior      ends of its range
    low, median, high
               5, 50 and 95 % quantiles of the posterior
    width      width of that interval over the prior's, in the coordinates in which the prior is
               uniform
    verdict    "determined", "not determined", "only together with KEY", "at LOW", or "at HIGH"
    """

    key: str
    unit: str
    prior: tuple[float, float]
    low: float
    median: float
    high: float
    width: float
    verdict: str

    @property
    def is_determined(self) -> bool:
        return self.verdict == "determined"


@dataclass(frozen=True)
class Calibration:
    """Parameters of a scene from a measured trace, with what is known about them.

    scene        the scene, with its own values of the parameters
    space        the ranges
    reading      the measured trace; None: only key figures were given
    names        of the figures (k) that were compared
    kept         which of all figures these are: those that differ between the runs
    target       measured figures, and the emulator of the runs at the end
    posterior    samples of the parameters
    runs         of each wave
    left         part of the ranges that was not ruled out after each wave
    predicted    runs at samples of the posterior
    given        the model discrepancy that was given; None: it was estimated
    notes        what was assumed, and what is doubtful
    """

    scene: Scene
    space: Space
    reading: Reading | None
    names: tuple[str, ...]
    kept: NDArray[np.bool_]
    target: Target
    posterior: Posterior
    runs: tuple[Runs, ...]
    left: tuple[float, ...]
    predicted: Runs
    given: float | None
    notes: tuple[str, ...]

    @cached_property
    def samples(self) -> Array:
        """Samples (n, d) of the parameters."""
        return self.space.values(self.posterior.unit)

    @property
    def correlation(self) -> Array:
        """Correlations (d, d) of the parameters in the posterior."""
        return self.posterior.correlation

    @cached_property
    def discrepancy(self) -> Array:
        """5, 50 and 95 % quantiles of the model discrepancy, a part of the figures' size."""
        return np.quantile(self.posterior.discrepancy, LEVELS)

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """The parameters, in the order of the ranges."""
        return parameters_of(self.space, self.posterior)

    @property
    def table(self) -> list[dict[str, Any]]:
        """A row for each parameter, for `pandas.DataFrame`."""
        return [
            {
                "parameter": each.key,
                "unit": each.unit,
                "prior_low": each.prior[0],
                "prior_high": each.prior[1],
                "low_5": each.low,
                "median": each.median,
                "high_95": each.high,
                "width_over_prior": each.width,
                "verdict": each.verdict,
            }
            for each in self.parameters
        ]

    @cached_property
    def influence(self) -> Array:
        """Part (k, d) of each figure's variance in the ranges that each parameter explains."""
        return influences(self.target.emulator, len(self.space))

    @property
    def held_out(self) -> Mapping[str, float]:
        """Checks of predictions: the part of each that lies within predicted 90 % intervals.

        runs, each left out      figures of the runs that made the emulator
        runs of the posterior    figures of runs that it has not seen, where it matters
        """
        inside = np.abs(self.target.emulator.errors / self.target.emulator.widening) <= NINETY
        found = {"runs, each left out": float(inside.mean())}
        figures = self.predicted.figures(self.reading and self.reading.reader)
        good = np.isfinite(figures).all(axis=1)
        if good.any():
            mean, deviation = self.target.emulator.predict(
                self.space.unit(self.predicted.values[good])
            )
            known = figures[good][:, self.kept]
            found["runs of the posterior"] = float(
                (np.abs(known - mean) <= NINETY * deviation).mean()
            )
        return found

    @cached_property
    def bands(self) -> tuple[Array, Array]:
        """Bands of the trace at `reading.reader.time` [m/s2]: 5, 50 and 95 % of it (3, m) each.

        The first is that of the runs at samples of the posterior; the second has the noise of the
        measurement and the model discrepancy in it, and should hold 90 % of the measured trace.

        Raises UserError: there is no trace.
        """
        if self.reading is None:
            raise UserError("no trace was given, so none is predicted; only key figures were")
        series = self.predicted.traces
        random = np.random.default_rng(0)
        drawn = random.choice(len(series), 2000)
        lacking = random.choice(self.posterior.discrepancy, len(drawn)) * self.reading.level
        # each copy deviates in one direction: neighbouring instants err together
        noise = random.normal(size=(len(drawn), 2))
        whole = series[drawn] + noise[:, :1] * lacking[:, None] + noise[:, 1:] * self.reading.band
        return np.quantile(series, LEVELS, axis=0), np.quantile(whole, LEVELS, axis=0)

    @property
    def inside_band(self) -> float | None:
        """Part of the measured trace from the onset that is in the wider band; None: no trace."""
        if self.reading is None:
            return None
        low, _, high = self.bands[1]
        after = self.reading.reader.time >= 0
        inside = (self.reading.series >= low) & (self.reading.series <= high)
        return float(inside[after].mean())

    def __repr__(self) -> str:
        lines = [
            f"{each.key} = {each.median:.4g} ({each.low:.4g} to {each.high:.4g}): {each.verdict}"
            for each in self.parameters
        ]
        return "\n".join(["Calibration, medians and 5-95 % intervals", *lines])

    def plot(self) -> Figure:
        """The posterior: each parameter, and each pair."""
        from taichi_foam.calibration import charts

        return charts.posterior(self)

    def report(self, path: str | Path) -> Path:
        """Write the report as one HTML file. Raises UserError: it cannot be written."""
        from taichi_foam.calibration import report

        return report.write(self, path)


def parameters_of(space: Space, posterior: Posterior) -> tuple[Parameter, ...]:
    """Intervals and verdicts of parameters."""
    units = {each.key: each.unit for each in keys(Scene)}
    ends = np.quantile(posterior.unit, LEVELS, axis=0)
    values = space.values(ends)
    widths = (ends[2] - ends[0]) / (LEVELS[2] - LEVELS[0])
    related = np.abs(posterior.correlation) - np.eye(len(space))
    found = []
    for d, one in enumerate(space.ranges):
        other = int(np.argmax(related[d]))
        is_wide = min(widths[d], widths[other]) >= _WIDE
        if widths[d] >= AS_WIDE:
            verdict = "not determined"
        elif len(space) > 1 and related[d, other] >= TOGETHER and is_wide:
            verdict = f"only together with {space.keys[other]}"
        elif np.mean(posterior.unit[:, d] < _AT_END) > _AT_END_PART:
            verdict = "at LOW"
        elif np.mean(posterior.unit[:, d] > 1 - _AT_END) > _AT_END_PART:
            verdict = "at HIGH"
        else:
            verdict = "determined"
        low, median, high = (float(value) for value in values[:, d])
        found.append(
            Parameter(
                one.key,
                units.get(one.key, "-"),
                (one.low, one.high),
                low,
                median,
                high,
                float(widths[d]),
                verdict,
            )
        )
    return tuple(found)
