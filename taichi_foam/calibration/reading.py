"""What is read from a trace: the same figures from a measured one and from runs.

Both go through the same filter, and their time begins when the filtered deceleration first exceeds
a part of its peak, so that neither the trigger of a recorder nor the start of a run counts. Figures
are the peak, which names its filter, and the means over equal intervals of that time. Together
these determine what a trace can: the first intervals the stiffness and the onset of crushing, those
in the middle the plateau and its rate, the last ones densification and rebound, the sum of all the
velocity change. Noise hardly changes means over intervals longer than the response of the filter,
and the chaos of broken foam changes them much less than values at instants; unlike principal
components of the runs they mean something to a reader.

The time of the peak, the duration and the velocity change are read, too, but not compared: they
follow from the means in part, and serve as a check of the result.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from taichi_foam.errors import UserError
from taichi_foam.formulas.traces import channel, check_rate, even_means, filtered, sampled
from taichi_foam.scene import Scene
from taichi_foam.scene.traces import FEWEST, read_trace

Array = NDArray[np.float64]

LEAST_NOISE = 0.01
"""Least noise of a measured trace, as a part of its peak, if none is given."""

_ONSET = 0.1  # part of the peak at which time begins
_CLEAR = 5.0  # standard deviations of the filtered noise that the onset is above zero
_MOST_INTERVALS = 8
_INTERVAL = 1.2  # cycles of the channel class in the shortest one: two of the cut-off frequency
_BEYOND = 1.25  # compared time over the pulse's duration: longer pulses of runs show, too
_PAD = 5.0  # cycles of the channel class before and after a trace, in which the filter settles
_STEPS = 60  # samples per cycle of the channel class
_DRAWN = 200  # noisy copies of the trace
_WITHIN = 20  # noisy copies of each of them


@dataclass(frozen=True)
class Measured:
    """A measured trace.

    time          (n,) s, increasing
    deceleration  (n,) m/s2 from free fall, that is, contact force over mass: what a load cell
                  shows, or a sensor whose zero is that before the impact
    name          of its file
    """

    time: Array
    deceleration: Array
    name: str = "trace"


@dataclass(frozen=True)
class Reader:
    """How traces are read.

    channel_class  CFC of the filter [Hz]
    onset          part of the peak at which time begins
    length         compared time from there [s]
    """

    channel_class: int
    onset: float
    length: float

    @property
    def step(self) -> float:
        """Interval of the series [s]."""
        return 1.0 / (_STEPS * self.channel_class)

    @property
    def time(self) -> Array:
        """Instants (m,) of the series from the onset [s]; the first ones are before it."""
        before = int(_STEPS * 0.6)  # the response of the filter, half an amplitude's cycle
        return np.arange(-before, round(self.length / self.step) + 1, dtype=float) * self.step

    @property
    def edges(self) -> Array:
        """Ends (i + 1,) of the intervals [s]: equal, longer than two cycles of the filter."""
        count = int(np.clip(self.length * self.channel_class / _INTERVAL, 3, _MOST_INTERVALS))
        return np.linspace(0.0, self.length, count + 1)

    @property
    def names(self) -> list[str]:
        """Names of the figures (k)."""
        ends = [f"{1e3 * edge:.3g}" for edge in self.edges]
        means = [f"mean, {a} to {b} ms" for a, b in pairwise(ends)]
        return [f"peak, {channel(self.channel_class)}", *means]

    def series(self, time: ArrayLike, deceleration: ArrayLike, *, means: bool = False) -> Array:
        """The filtered deceleration (m,) at `Reader.time`; nan if it has no peak.

        With `means`, value k is the mean over time[k-1] .. time[k], and value 0 is not used.
        """
        return self._from_onset(
            *self._filtered(np.asarray(time, float), np.asarray(deceleration, float), means)
        )

    def _from_onset(self, t: Array, a: Array) -> Array:
        """Filtered values `a` at evenly spaced times `t`, at `Reader.time` from their onset."""
        peak = float(a.max())
        if not np.isfinite(peak) or peak <= 0.0:
            return np.full(len(self.time), np.nan)
        first = int(np.argmax(a >= self.onset * peak))
        begin = t[first]
        if first:
            begin -= self.step * (a[first] - self.onset * peak) / (a[first] - a[first - 1])
        return np.interp(begin + self.time, t, a)

    def _filtered(self, time: Array, values: Array, means: bool = False) -> tuple[Array, Array]:
        """Times and filtered values, evenly spaced; zero before the trace, its last value after."""
        pad = _PAD / self.channel_class
        edges = np.arange(time[0] - pad, time[-1] + pad + self.step, self.step)
        # samples that keep the integral of the trace, so that noise is averaged and not picked
        mean = values[1:] if means else 0.5 * (values[1:] + values[:-1])
        middle, samples = even_means(time, mean, values[-1], edges, self.step)
        return middle, filtered(middle, samples, self.channel_class)

    def figures(self, series: Array) -> Array:
        """The figures (..., k) of series (..., m) [m/s2]."""
        inside = [(self.time >= a) & (self.time <= b) for a, b in pairwise(self.edges)]
        means = [series[..., where].mean(axis=-1) for where in inside]
        return np.stack([series.max(axis=-1), *means], axis=-1)

    def checks(self, series: Array) -> Mapping[str, Array]:
        """Figures (...) of series (..., m) that are not compared: SI."""
        peak = series.max(axis=-1, keepdims=True)
        above = series >= _ONSET * peak
        last = series.shape[-1] - 1 - np.argmax(above[..., ::-1], axis=-1)
        return {
            "time of the peak [s]": self.time[np.argmax(series, axis=-1)],
            "duration above 10 % of the peak [s]": self.time[last]
            - self.time[np.argmax(above, -1)],
            "velocity change [m/s]": self.step * series.sum(axis=-1),
        }


@dataclass(frozen=True)
class Reading:
    """A measured trace as it was read.

    reader      how
    series      (m,) the filtered trace at `reader.time` [m/s2]
    figures     (k,)
    covariance  (k, k) of their errors of measurement
    noise       standard deviation of the samples of the trace [m/s2]
    band        (m,) standard deviation of the filtered trace [m/s2]
    notes       what was assumed, and found
    """

    reader: Reader
    series: Array
    figures: Array
    covariance: Array
    noise: float
    band: Array
    notes: tuple[str, ...]

    @property
    def level(self) -> float:
        """Root mean square of the means over intervals [m/s2]."""
        return float(np.sqrt(np.mean(self.figures[1:] ** 2)))


def measured_in(path: Path, scene: Scene, column: str | None = None) -> Measured:
    """The trace in a CSV file, see `read_trace`; a force is divided by the mass of the impactor.

    Raises UserError: as `read_trace`, or a force without an impactor.
    """
    found = read_trace(path, column)
    if found.kind == "acceleration":
        return Measured(found.time, found.values, path.name)
    if scene.impactor is None:
        raise UserError(f"{path}: a force, and the scene has no impactor whose mass it stops")
    return Measured(found.time, found.values / scene.impactor.mass, path.name)


def reading_of(
    trace: Measured,
    channel_class: int,
    noise: float | None = None,
    offset: float | None = None,
    seed: int = 0,
    length: float | None = None,
) -> Reading:
    """Read a measured trace.

    Errors of measurement are those of 200 copies of the trace with white noise added, through the
    same filter and with an offset found in the same way. A peak's bias by noise is taken off, of
    the trace and of each copy: the bias is found from noisy values, so that it errs, too (the
    iterated bootstrap of Hall 1992, The Bootstrap and Edgeworth Expansion, section 1.4).

    Args:
        trace: the trace; if it is mostly negative, its sign is changed, and this is noted.
        channel_class: CFC of the filter [Hz].
        offset: what the sensor shows before the impact [m/s2], in the sign of the pulse; None: the
            mean of the samples before it, if there are at least ten.
        noise: standard deviation of the samples, as a part of the peak; None: from their second
            differences, at least `LEAST_NOISE`.
        seed: of the noise.
        length: compared time from the onset [s]; None: 1.25 times the duration of the pulse.

    Raises:
        UserError: times that do not increase, too few samples for the filter, or no peak.
    """
    try:
        t, a = sampled(trace.time, trace.deceleration)
        check_rate(t, channel_class)
    except UserError as error:
        raise UserError(f"{trace.name}: {error}") from None
    if len(t) < FEWEST:
        raise UserError(f"{trace.name}: {len(t)} samples: must be at least {FEWEST}")
    notes: list[str] = []
    whole = Reader(channel_class, _ONSET, 1.0)
    at, smooth = whole._filtered(t, a)
    if -smooth.min() > smooth.max():
        a, smooth = -a, -smooth
        notes.append("the trace is mostly negative: its sign was changed")
    peak = float(smooth.max())
    before = np.zeros(len(t), bool)  # the samples that the offset is found from
    if offset is None:
        # two cycles of the filter before the onset nothing of the pulse is seen
        before = t < at[int(np.argmax(smooth >= _ONSET * peak))] - 2.0 / channel_class
        if before.sum() < FEWEST:
            before[:] = False
        offset = float(a[before].mean()) if before.any() else 0.0
        if offset:
            notes.append(f"offset: {offset:.3g} m/s2, the mean of the samples before the impact")
    a = a - offset
    at, smooth = whole._filtered(t, a)
    peak = float(smooth.max())
    second = np.diff(a, 2)
    found = 1.4826 * float(np.median(np.abs(second - np.median(second)))) / np.sqrt(6.0)
    if noise is None:
        deviation = max(found, LEAST_NOISE * peak)
        notes.append(
            f"noise: {100 * deviation / peak:.1f} % of the peak, "
            + ("the least that is assumed" if deviation > found else "from second differences")
        )
    else:
        deviation = noise * peak
    random = np.random.default_rng(seed)
    noises = random.normal(scale=deviation, size=(_DRAWN + _WITHIN, len(t)))
    if before.any():  # the offset of each copy would be found from its own noise
        noises -= noises[:, before].mean(axis=1, keepdims=True)
    # the filter is linear: it is applied to the trace and to each noise once
    noises = np.stack([whole._filtered(t, noise)[1] for noise in noises])
    rough = float(noises.std())
    onset = max(_ONSET, _CLEAR * rough / peak) if peak > 0.0 else np.inf
    if onset > 0.5:
        raise UserError(
            f"{trace.name}: no peak rises above its noise (peak {peak:.3g} m/s2 with CFC "
            f"{channel_class:g}, noise {rough:.3g} m/s2). Fix: check the column and its unit, take "
            "a lower channel class, or state the noise"
        )
    above = np.flatnonzero(smooth >= onset * peak)
    begin, end = at[above[0]], at[above[-1]]
    wanted = _BEYOND * (end - begin) if length is None else length
    compared = float(min(wanted, t[-1] - begin))
    least = 3 * _INTERVAL / channel_class
    if compared < least:
        compared = least
        notes.append("the pulse is shorter than three cycles of its filter")
    reader = Reader(channel_class, onset, compared)
    series = reader._from_onset(at, smooth)
    copies, within = smooth + noises[:_DRAWN], noises[_DRAWN:]

    def seen(traces: Array) -> Array:
        return np.stack([reader._from_onset(at, each) for each in traces])

    noisy = seen(copies)
    figures, drawn = reader.figures(series), reader.figures(noisy)
    again = [reader.figures(seen(copy + within)).mean(axis=0) for copy in copies]
    unbiased = 2.0 * drawn - again
    return Reading(
        reader=reader,
        series=series,
        figures=2.0 * figures - drawn.mean(axis=0),
        covariance=doubt(_DRAWN, drawn.shape[1]) * np.cov(unbiased.T),
        noise=deviation,
        band=noisy.std(axis=0),
        notes=tuple(notes),
    )


def doubt(count: int, figures: int) -> float:
    """Factor of a covariance of figures that is estimated from `count` samples.

    The inverse of an estimated covariance is too large on average (Hartlap, Simon & Schneider
    2007, Astronomy & Astrophysics 464, 399).
    """
    return (count - 1) / max(count - figures - 2, 1)
