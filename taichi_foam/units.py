"""Figures that people read: SI prefixes, numbers as one would write them, and what 1 g is."""

from __future__ import annotations

import math

STANDARD_GRAVITY = 9.80665
"""What an acceleration of 1 g is [m/s2]."""

_PREFIXES = {-9: "n", -6: "µ", -3: "m", 0: "", 3: "k", 6: "M", 9: "G"}


def plain(value: float) -> str:
    """A number as one would write it: 0.005, 2.78e6, 1e-7; five digits."""
    return f"{value:.5g}".replace("e+0", "e").replace("e+", "e").replace("e-0", "e-")


def si_scale(value: float, least: int = -9, digits: int = 6) -> tuple[float, str]:
    """The power of a thousand that suits a value, and its prefix: 2.78e6 has (1e6, "M").

    `least` is the lowest power of ten; `digits` those to which the value will be rounded, so that
    999.9 of three digits is 1 k.
    """
    rounded = abs(float(f"{value:.{digits}g}"))
    if rounded == 0.0 or not math.isfinite(rounded):
        return 1.0, ""
    power = 3 * math.floor(math.log10(rounded) / 3 + 1e-9)
    power = min(max(power, least), max(_PREFIXES))
    return 10.0**power, _PREFIXES[power]


def duration_text(seconds: float) -> str:
    """A time for people: 40 s, 12 min, 3.5 h, 2.1 days."""
    for limit, unit, per in ((90, "s", 1), (5400, "min", 60), (172_800, "h", 3600)):
        if seconds < limit:
            return f"{seconds / per:.2g} {unit}"
    return f"{seconds / 86_400:.2g} days"
