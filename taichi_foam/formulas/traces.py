"""Traces of acceleration or force: the filters of SAE J211, and the figures of a pulse.

A filter moves peaks: a half-sine of 3 ms and 100 g keeps 93 g with CFC 180, a rectangular pulse
overshoots by 3.4 %. Traces can only be compared through the same filter, and each peak has to name
it.

SAE J211-1: Instrumentation for impact test, part 1: electronic instrumentation
ASTM D3332: Standard test methods for mechanical-shock fragility of products, using shock machines
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from taichi_foam.errors import UserError
from taichi_foam.units import STANDARD_GRAVITY

Array = NDArray[np.float64]

CHANNEL_CLASSES = (60, 180, 600, 1000)
"""Channel frequency classes CFC [Hz]: up to there, a signal passes unchanged within 0.5 dB."""

PASS_CUTOFF = 2.0775
"""Cut-off frequency of each pass over CFC. Two passes together are 3 dB down at CFC / 0.6."""

LEAST_SAMPLES = 10
"""Least sampling rate over CFC (SAE J211)."""

ENDS = 0.1
"""A pulse lasts while it is above this fraction of its peak (ASTM D3332)."""

_FINEST = 1e-4
"""Interval [s] at which means over longer intervals are sampled for CFC 180."""

_PAD = 0.02
"""Time [s] added at either end for CFC 180; the response of a pass has decayed to 1e-14 by then."""


def channel(channel_class: int | None) -> str:
    """How a filter is named beside a peak: "CFC 180", or "raw" for none."""
    return "raw" if channel_class is None else f"CFC {channel_class}"


def check_channel_class(channel_class: int) -> None:
    """Raise UserError for a class that is none of SAE J211's."""
    if channel_class not in CHANNEL_CLASSES:
        raise UserError(
            f"channel class {channel_class}: must be one of "
            f"{', '.join(str(each) for each in CHANNEL_CLASSES)} (SAE J211)"
        )


def check_rate(time: Array, channel_class: int) -> None:
    """Raise UserError if times [s] are too far apart for a class."""
    step, least = float(np.median(np.diff(time))), LEAST_SAMPLES * channel_class
    if step * least > 1.001:  # a rate given by rounded times may be a little below what it is
        raise UserError(
            f"{1.0 / step:.4g} samples/s: must be at least {least:,} for CFC {channel_class} "
            "(SAE J211); take a lower channel class, or sample faster"
        )


def filtered(
    time: ArrayLike, values: ArrayLike, channel_class: int, *, means: bool = False
) -> Array:
    """(n,) values after the four-pole zero-phase Butterworth filter of SAE J211, at each time.

    time           (n,) s, increasing, not necessarily evenly spaced
    values         (n,) samples of any unit; before the first and after the last they are constant
    channel_class  one of CHANNEL_CLASSES
    means          value k is the mean over time[k-1] .. time[k]; value 0 is not used, and before
                   time[0] all is 0. The intervals may be long; the integral over each is kept

    A value that is not finite gives all NaN. Raises UserError: other shapes, times or classes, or
    fewer than 10 CFC samples a second.
    """
    t, raw = np.asarray(time, dtype=np.float64), np.asarray(values, dtype=np.float64)
    check_channel_class(channel_class)
    _check_lengths(t, raw)
    if not np.isfinite(raw[1:] if means else raw).all():
        return np.full_like(raw, np.nan)
    if t.size < 2:
        return np.zeros_like(raw) if means else raw.copy()
    _check_rising(t)
    widths = np.diff(t)
    step, scale = float(np.median(widths)), 180 / channel_class
    if means:
        step = min(step, _FINEST * scale)
    else:
        check_rate(t, channel_class)
    pad = int(np.ceil(_PAD * scale / step))
    count = int(np.ceil((t[-1] - t[0]) / step))
    edges = t[0] + step * np.arange(-pad, count + pad + 1)
    if means:
        at, samples = even_means(t, raw[1:], raw[-1], edges, step)
    else:
        samples, at = np.interp(edges, t, raw), edges
    cutoff = PASS_CUTOFF * channel_class * step
    forth = low_pass(samples, cutoff)
    return np.interp(t, at, low_pass(forth[::-1], cutoff)[::-1])


def even_means(
    time: Array, means: Array, after: float, edges: Array, step: float
) -> tuple[Array, Array]:
    """Middles and means (m,) of even intervals, `step` wide, that keep the integral of others.

    means  (n - 1,) between the times (n,); before them all is 0
    after  the value after them
    edges  (m + 1,) of the even intervals
    """
    total = np.append(0.0, np.cumsum(means * np.diff(time)))
    beyond = np.maximum(edges - time[-1], 0.0) * after
    even = np.diff(np.interp(edges, time, total) + beyond) / step
    return 0.5 * (edges[1:] + edges[:-1]), even


def sampled(time: ArrayLike, values: ArrayLike) -> tuple[Array, Array]:
    """The samples of a trace. Raises UserError: fewer than two, not finite, times do not rise."""
    t, raw = np.asarray(time, dtype=np.float64), np.asarray(values, dtype=np.float64)
    _check_lengths(t, raw)
    if raw.size < 2 or not (np.isfinite(t).all() and np.isfinite(raw).all()):
        raise UserError(f"{raw.size} samples: must be at least two, all finite; remove the others")
    _check_rising(t)
    return t, raw


def low_pass(samples: Array, cutoff: float) -> Array:
    """One pass of a two-pole Butterworth low-pass (SAE J211-1, appendix C).

    `cutoff` is in cycles per sample; the signal before the first sample is assumed constant. SciPy
    also uses a loop for this, and takes half a second to load: a fifth of a short run.
    """
    w = math.tan(math.pi * cutoff)
    whole = 1.0 + math.sqrt(2.0) * w + w * w
    b = w * w / whole
    a1, a2 = 2.0 * (w * w - 1.0) / whole, (1.0 - math.sqrt(2.0) * w + w * w) / whole
    first = float(samples[0])
    passed, one, two = np.empty_like(samples), 0.0, 0.0  # filter state from the last two samples
    for k, sample in enumerate((samples - first).tolist()):
        now = b * sample + one
        one = 2.0 * b * sample - a1 * now + two
        two = b * sample - a2 * now
        passed[k] = now
    return passed + first


@dataclass(frozen=True)
class Pulse:
    """The figures of a pulse of deceleration.

    channel          the filter through which it was seen, "CFC 180" or "raw"
    g                its peak [g]
    time             when that is, on the trace's clock [s]
    duration         between the instants around the peak at which it is 10 % of it [s]
    rise             from 10 to 90 % of the peak [s]
    velocity_change  integral of the unfiltered trace over the whole pulse, from the last zero
                     before the peak to the first one after it [m/s]
    restitution      velocity of the rebound over that of the impact; None: that is not known
    """

    channel: str
    g: float
    time: float
    duration: float
    rise: float
    velocity_change: float
    restitution: float | None


def pulse_of(
    time: ArrayLike,
    acceleration: ArrayLike,
    channel_class: int | None,
    *,
    impact_velocity: float | None = None,
) -> Pulse:
    """The figures of the highest pulse of a trace, positive in deceleration.

    time             (n,) s, increasing
    acceleration     (n,) m/s2, samples; its zero is that of the sensor at rest or in free fall
    channel_class    the class of the filter; None: as it is
    impact_velocity  velocity at the start of the pulse [m/s], above 0

    Raises UserError: nothing is above 0, a peak at the end of the trace, a value that is not
    finite, a velocity not above 0, and as `filtered`.
    """
    t, raw = sampled(time, acceleration)
    if impact_velocity is not None and not 0.0 < impact_velocity < math.inf:
        raise UserError(f"impact_velocity = {impact_velocity:g}: must be above 0 m/s")
    seen = raw if channel_class is None else filtered(t, raw, channel_class)
    top = int(np.argmax(seen))
    peak = float(seen[top])
    if peak <= 0.0:
        raise UserError(
            f"trace without a peak: at most {peak:g} m/s2; deceleration must be positive, change "
            "the sign if it is not"
        )
    if seen[-1] > ENDS * peak:
        raise UserError(
            f"the trace ends at {100 * seen[-1] / peak:.0f} % of its peak: must go on until the "
            f"pulse is over, below {100 * ENDS:g} % of it"
        )
    start, end = _before(t, seen, top, ENDS * peak), _after(t, seen, top, ENDS * peak)
    first, last = _before(t, seen, top, 0.0), _after(t, seen, top, 0.0)
    inside = np.concatenate([[first], t[(t > first) & (t < last)], [last]])
    values = np.interp(inside, t, raw)
    change = float(np.sum(0.5 * (values[1:] + values[:-1]) * np.diff(inside)))
    return Pulse(
        channel=channel(channel_class),
        g=peak / STANDARD_GRAVITY,
        time=float(t[top]),
        duration=end - start,
        rise=_before(t, seen, top, 0.9 * peak) - start,
        velocity_change=change,
        restitution=None if impact_velocity is None else change / impact_velocity - 1.0,
    )


def _check_lengths(time: Array, values: Array) -> None:
    if time.ndim != 1 or time.shape != values.shape:
        raise UserError(f"time {time.shape} and values {values.shape} must be equal in length")


def _check_rising(time: Array) -> None:
    back = np.flatnonzero(~(np.diff(time) > 0.0))
    if back.size:
        n = int(back[0])
        raise UserError(
            f"time runs from {time[n]:g} s to {time[n + 1]:g} s in sample {n + 2}: time must "
            "increase from value to value; sort them, or give one test only"
        )


def _before(time: Array, values: Array, top: int, level: float) -> float:
    """The last instant before the peak at which the values are at a level; else the first."""
    below = np.flatnonzero(values[:top] <= level)
    return float(time[0]) if below.size == 0 else _crossing(time, values, int(below[-1]), level)


def _after(time: Array, values: Array, top: int, level: float) -> float:
    """The first instant after the peak at which the values are at a level; else the last."""
    below = np.flatnonzero(values[top:] <= level)
    if below.size == 0:
        return float(time[-1])
    return _crossing(time, values, top + int(below[0]) - 1, level)


def _crossing(time: Array, values: Array, at: int, level: float) -> float:
    """The instant between sample `at` and the next at which a line is at a level."""
    share = (level - values[at]) / (values[at + 1] - values[at])
    return float(time[at] + share * (time[at + 1] - time[at]))
