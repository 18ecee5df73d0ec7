"""What a pulse of the base does to a product: the velocity changes of both.

Velocities are absolute ones: the history's, which is relative to the base, and the base's own.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import copysign

from taichi_foam.records.record import Record


@dataclass(frozen=True)
class Shaking:
    """A pulse of the base, and what it gave.

    base_peak     m/s2, the largest acceleration of the base, with its sign, upwards positive
    base_change   m/s, largest velocity change of the base, in the direction of that peak
    change        m/s, the same of the product; None without one
    """

    base_peak: float
    base_change: float
    change: float | None


def shaking(record: Record) -> Shaking | None:
    """That of a run, until its end; None of a base that stands still, and before a first row."""
    pulse, history = record.scene.base.shaking, record.history
    if pulse is None or not history["time_s"].size:
        return None
    base = pulse.velocity(history["time_s"])
    product = base - history["velocity_m_s"]
    sign = copysign(1.0, pulse.peak)
    change = None
    if record.scene.impactor is not None:
        change = float((sign * (product - product[0])).max())
    return Shaking(pulse.peak, float((sign * base).max()), change)
