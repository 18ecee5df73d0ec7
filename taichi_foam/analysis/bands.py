"""Statistics over many runs of one test: medians and bands of figures and of curves."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from numbers import Real
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from taichi_foam.scene import Output

Array = NDArray[np.float64]

ENDS = (0.05, 0.95)
"""The quantiles at the ends of a band."""

# Spacing of points on the time axis of a band of curves [s].
_INTERVAL = Output().history_interval


class Band(NamedTuple):
    """The median of a figure over many runs, and the ends of its band; inf if undefined."""

    low: float
    median: float
    high: float


class Curves(NamedTuple):
    """A band of curves, arrays (n,): time [s], and at each instant the band of the values."""

    time: Array
    low: Array
    median: Array
    high: Array


def quantile(values: Sequence[float | None], share: float) -> float:
    """The value that `share` (0 to 1) of the runs do not exceed, interpolated between ranks.

    An undefined value, None, counts as +inf: the impactor never stopped, so duration and
    displacement exceed all others. The median is therefore inf as soon as half of the runs are
    undefined, and failed runs cannot improve it.
    """
    ranked = sorted(math.inf if value is None else float(value) for value in values)
    # Rounded: a rank that is an integer except for its last bit must not mix in a neighbouring inf.
    rank = round(share * (len(ranked) - 1), 9)
    below, above = ranked[math.floor(rank)], ranked[math.ceil(rank)]
    return below if below == above else below + (rank - math.floor(rank)) * (above - below)


def band(values: Sequence[float | None], ends: tuple[float, float] = ENDS) -> Band:
    """Median and band of one figure; `ends` (0, 1) gives the minimum and the maximum."""
    low, high = ends
    return Band(quantile(values, low), quantile(values, 0.5), quantile(values, high))


def bands(runs: Sequence[Mapping[str, Any]]) -> dict[str, Band]:
    """The band of every figure in the runs' summaries, by key; not of names and flags."""
    keys = [key for key in runs[0] if all(_is_figure(run[key]) for run in runs)]
    return {key: band([run[key] for run in runs]) for key in keys}


def nearest(runs: Sequence[Mapping[str, Any]], keys: Sequence[str]) -> int:
    """Index of the run whose figures `keys` are nearest to their medians over all runs.

    It minimises the largest relative deviation of these figures.
    """
    medians = {key: band([run[key] for run in runs]).median for key in keys}

    def worst(place: int) -> float:
        return max(_apart(runs[place][key], medians[key]) for key in keys)

    return min(range(len(runs)), key=worst)


def band_of_curves(curves: Sequence[tuple[Array, Array]]) -> Curves:
    """Median and band, instant by instant, of curves (time [s], values), each with its own times.

    The common time axis ends when half of the curves have ended; a curve that has ended earlier
    keeps its last value, which is near zero after a rebound.
    """
    end = float(np.median([time[-1] for time, _ in curves]))
    axis = np.arange(0.0, end + 0.5 * _INTERVAL, _INTERVAL)
    values = np.array([np.interp(axis, *curve) for curve in curves])
    low, median, high = np.quantile(values, (ENDS[0], 0.5, ENDS[1]), axis=0)
    return Curves(axis, low, median, high)


def _is_figure(value: Any) -> bool:
    return value is None or (isinstance(value, Real) and not isinstance(value, bool))


def _apart(value: float | None, median: float) -> float:
    """Relative deviation of a figure from the median; 0 if both are undefined, inf if one is."""
    value = math.inf if value is None else value
    if value == median:
        return 0.0
    if math.isinf(value) or math.isinf(median) or median == 0.0:
        return math.inf
    return abs(value / median - 1.0)
