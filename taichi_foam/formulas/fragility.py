"""What a product withstands: the damage boundary, and the shock response spectrum of a trace.

Both see the part of a product that breaks as a mass on a spring, of a natural frequency f, which
breaks at a deceleration of its own. Closed forms are those without damping.

ASTM D3332: Standard test methods for mechanical-shock fragility of products, using shock machines
R. E. Newton: Fragility assessment theory and test procedure. Monterey Research Laboratory (1968)
D. O. Smallwood: An improved recursive formula for calculating shock response spectra. Shock Vib.
    Bull. 51 (1981) 211-217
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from taichi_foam.errors import UserError
from taichi_foam.formulas.energy import check_above_0
from taichi_foam.formulas.traces import sampled

Array = NDArray[np.float64]

Shape = Literal["rectangle", "half-sine"]

PER_PERIOD = 50
"""Samples per natural period: a peak between two of them is 0.2 % larger at most."""

SLOWEST = 1e-5
"""Lowest natural frequency over the sampling rate: below it, coefficients lose their digits."""


def rectangle_response(frequency_times_duration: float) -> float:
    """Largest response to a rectangular pulse over its peak: 2 sin(pi f D), 2 from f D = 1/2 on."""
    return 2.0 * math.sin(math.pi * min(frequency_times_duration, 0.5))


def half_sine_response(frequency_times_duration: float) -> float:
    """Largest response to a half-sine pulse over its peak, the larger of these, with r = 2 f D.

    During the pulse, r / (r - 1) sin(2 pi k / (r + 1)) for k = 1, 2 ... while the sine's argument
    is below pi; after it, 2 r cos(pi r / 2) / (1 - r^2).
    """
    r = 2.0 * frequency_times_duration
    if abs(r - 1.0) < 1e-6:
        return 0.5 * math.pi
    after = abs(2.0 * r * math.cos(0.5 * math.pi * r) / (1.0 - r * r))
    if r <= 1.0:
        return after
    # the crest nearest to the peak of the pulse is the highest one
    nearest = max(round(0.25 * (r + 1.0)), 1)
    return max(after, r / (r - 1.0) * math.sin(2.0 * math.pi * nearest / (r + 1.0)))


_RESPONSES: dict[Shape, tuple[Callable[[float], float], float, float]] = {
    "rectangle": (rectangle_response, 2.0, 1.0),
    "half-sine": (half_sine_response, 1.768457653994, 2.0 / math.pi),
}
"""By shape: response, its largest value for any duration, and velocity change over peak times
duration."""


@dataclass(frozen=True)
class DamageBoundary:
    """The pulses that just damage a product (ASTM D3332).

    critical_velocity  velocity change below which no pulse damages it [m/s]
    critical_g         peak of rectangular pulses below which none damages it, however long [g]

    Both are those of a part that breaks at a response of 2 critical_g, and whose natural frequency
    is critical_g times standard gravity over pi critical_velocity.
    """

    critical_velocity: float
    critical_g: float

    def __post_init__(self) -> None:
        check_above_0(critical_velocity=self.critical_velocity, critical_g=self.critical_g)

    def critical_of(self, shape: Shape) -> float:
        """The peak [g] of pulses of a shape below which none damages the product."""
        return 2.0 * self.critical_g / _RESPONSES[shape][1]

    def g_at(self, velocity_change: float, shape: Shape = "rectangle") -> float:
        """The peak [g] of the pulse of a velocity change [m/s] that just damages the product.

        Infinite up to the critical velocity change. Of rectangular pulses it is the critical one
        from pi / 2 critical velocity changes on.
        """
        ratio = velocity_change / self.critical_velocity
        if ratio <= 1.0:
            return math.inf
        response, largest, fullness = _RESPONSES[shape]

        def excess(share: float) -> float:
            """Response over that at which the part breaks, minus 1, by the peak over the latter."""
            return share * response(ratio / (2.0 * math.pi * fullness * share)) - 1.0

        from scipy.optimize import root_scalar

        low = high = 1.0 / largest
        while excess(high) < 0.0:
            low, high = high, 2.0 * high
        share = high if high == low else root_scalar(excess, bracket=(low, high)).root
        return 2.0 * self.critical_g * share


def shock_response_spectrum(
    time: ArrayLike, acceleration: ArrayLike, frequencies: ArrayLike, damping: float = 0.05
) -> Array:
    """(m,) largest absolute acceleration of masses on springs on a base that moves like a trace.

    time          (n,) s, increasing
    acceleration  (n,) any unit, that of the result; linear between samples, and 0 beyond them
    frequencies   (m,) natural frequencies [Hz], at least SLOWEST of the sampling rate
    damping       fraction of the critical one, from 0, below 1; 0.05 is an amplification Q of 10

    Smallwood's ramp-invariant filter, which is exact for such a trace, with at least PER_PERIOD
    samples a period; the response after the trace counts, too. Raises UserError: no trace,
    invalid frequencies or damping.
    """
    from scipy.signal import lfilter

    t, raw = sampled(time, acceleration)
    natural = np.asarray(frequencies, dtype=np.float64).ravel()
    rate = 1.0 / float(np.median(np.diff(t)))
    if not 0.0 <= damping < 1.0:
        raise UserError(f"damping = {damping:g}: must be at least 0 and below 1; 5 % is 0.05")
    if not (np.isfinite(natural) & (natural >= SLOWEST * rate)).all():
        raise UserError(
            f"frequencies from {natural.min():g} Hz: must be at least {SLOWEST * rate:g} Hz for "
            f"a trace of {rate:g} samples/s"
        )
    found = []
    for frequency in natural.tolist():
        step = 1.0 / (rate * math.ceil(max(PER_PERIOD * frequency / rate, 1.0)))
        longest = t[-1] + 1.0 / frequency
        even = t[0] + step * np.arange(math.ceil((longest - t[0]) / step) + 1)
        base = np.interp(even, t, raw, right=0.0)
        found.append(float(np.abs(lfilter(*_oscillator(frequency * step, damping), base)).max()))
    return np.array(found)


def _oscillator(cycles: float, damping: float) -> tuple[list[float], list[float]]:
    """Coefficients of Smallwood's filter for a frequency in cycles per sample."""
    omega = 2.0 * math.pi * cycles
    turned = omega * math.sqrt(1.0 - damping**2)
    shrunk = math.exp(-damping * omega)
    c, s = shrunk * math.cos(turned), shrunk * math.sin(turned)
    mean = s / turned
    return [1.0 - mean, 2.0 * (mean - c), shrunk**2 - mean], [1.0, -2.0 * c, shrunk**2]
