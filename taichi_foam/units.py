"""Units in files and of shown figures, SI prefixes, compact numbers, and standard gravity."""

from __future__ import annotations

import math

STANDARD_GRAVITY = 9.80665
"""An acceleration of 1 g [m/s2]."""

INCH, POUND = 0.0254, 0.45359237
"""In m and kg."""

LENGTH_UNITS = {"m": 1.0, "mm": 1e-3, "cm": 1e-2, "in": INCH, "inch": INCH, "ft": 12 * INCH}
AREA_UNITS = {
    f"{unit}{square}": size**2 for unit, size in LENGTH_UNITS.items() for square in ("2", "^2", "²")
}
MASS_UNITS = {"kg": 1.0, "g": 1e-3, "lb": POUND, "oz": POUND / 16}
VELOCITY_UNITS = {f"{unit}/s": size for unit, size in LENGTH_UNITS.items()}
STRAIN_UNITS = {"-": 1.0, "1": 1.0, "mm/mm": 1.0, "m/m": 1.0, "%": 0.01, "percent": 0.01}
STRESS_UNITS = {
    "pa": 1.0, "n/m2": 1.0, "n/m^2": 1.0, "kpa": 1e3, "mpa": 1e6, "n/mm2": 1e6, "n/mm^2": 1e6,
    "gpa": 1e9, "bar": 1e5, "psi": 6894.757293168361,
}  # fmt: skip
FORCE_UNITS = {"n": 1.0, "kn": 1e3, "kgf": STANDARD_GRAVITY, "lbf": POUND * STANDARD_GRAVITY}
TIME_UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6}
ACCELERATION_UNITS = {"m/s2": 1.0, "m/s^2": 1.0, "g": STANDARD_GRAVITY}
"""Factors that convert numbers to m, m2, kg, m/s, a fraction, Pa, N, s, or m/s2."""

SHOWN_UNITS = {
    "cm": 1e2,
    "cm³": 1e6,
    "ms": 1e3,
    "%": 1e2,
    "°": 57.29577951308232,
    "kPa": 1e-3,
    "10⁵ J/m³": 1e-5,
}
"""Factors that convert figures and columns of a run from SI units to those in which they are shown;
1 for all others."""

_PREFIXES = {-9: "n", -6: "µ", -3: "m", 0: "", 3: "k", 6: "M", 9: "G"}


def rounded(value: float, digits: int) -> float:
    """A value with so many significant digits: the last of a computed one are rounding errors."""
    return float(f"{value:.{digits}g}")


def plain(value: float) -> str:
    """A number in compact form, with five digits: 0.005, 2.78e6, 1e-7."""
    return f"{value:.5g}".replace("e+0", "e").replace("e+", "e").replace("e-0", "e-")


def si_scale(value: float, least: int = -9, digits: int = 6) -> tuple[float, str]:
    """The power of 1000 that suits a value, and its prefix: 2.78e6 gives (1e6, "M").

    `least` is the lowest power of ten. `digits` is the number of digits to which the value will be
    rounded: 999.9 with three digits is 1 k.
    """
    size = abs(rounded(value, digits))
    if size == 0.0 or not math.isfinite(size):
        return 1.0, ""
    power = 3 * math.floor(math.log10(size) / 3 + 1e-9)
    power = min(max(power, least), max(_PREFIXES))
    return 10.0**power, _PREFIXES[power]


def pressure_text(stress: float) -> str:
    """A stress [Pa] with three digits and a prefix: 111 kPa."""
    scale, prefix = si_scale(stress, digits=3)
    return f"{stress / scale:.3g} {prefix}Pa"


def duration_text(seconds: float) -> str:
    """A duration in a convenient unit: 40 s, 12 min, 3.5 h, 2.1 days."""
    for limit, unit, per in ((90, "s", 1), (5400, "min", 60), (172_800, "h", 3600)):
        if seconds < limit:
            return f"{seconds / per:.2g} {unit}"
    return f"{seconds / 86_400:.2g} days"
