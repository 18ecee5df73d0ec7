"""Numbers among options that may carry their unit: 50mm, 2in, 76cm, 4kPa."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from taichi_foam.errors import UserError
from taichi_foam.units import (
    AREA_UNITS,
    LENGTH_UNITS,
    MASS_UNITS,
    STRESS_UNITS,
    VELOCITY_UNITS,
)

if TYPE_CHECKING:
    from taichi_foam.cushions.shown import Units

_KINDS = {
    "length": (LENGTH_UNITS, "50"), "height": (LENGTH_UNITS, "0.76"), "area": (AREA_UNITS, "400"),
    "mass": (MASS_UNITS, "5"), "stress": (STRESS_UNITS, "4"), "velocity": (VELOCITY_UNITS, "2.5"),
}  # fmt: skip
"""Units of a kind, and a number for messages."""

_NUMBER = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:e[-+]?\d+)?)\s*(.*?)\s*", re.IGNORECASE)


def numbers(option: str, text: str, kind: str, used: Units, between: str = ",") -> list[float]:
    """The numbers of an option [SI]; those without a unit are in the unit of the kind.

    Args:
        option: its name, for messages.
        text: what was given.
        kind: "length", "height", "area", "mass", "stress" or "velocity".
        used: the units of numbers without one.
        between: what stands between two numbers.

    Raises:
        UserError: no number, an unknown unit, or a number that is not above 0.
    """
    return [_number(option, text, word, kind, used) for word in text.split(between)]


def number(option: str, text: str, kind: str, used: Units) -> float:
    """The number of an option [SI], as in `numbers`."""
    return _number(option, text, text, kind, used)


def _number(option: str, text: str, word: str, kind: str, used: Units) -> float:
    known, example = _KINDS[kind]
    match = _NUMBER.fullmatch(word)
    unit = match[2].lower() if match else ""
    if match is None or (unit and unit not in known):
        raise UserError(
            f"{option} {text}: {word.strip()!r} is no number with or without a unit. Fix: a number "
            f"in {used.unit(kind)}, such as {example}, or with a unit ({', '.join(known)})"
        )
    value = float(match[1])
    if value <= 0.0:
        raise UserError(
            f"{option} {text}: {word.strip()} must be above 0. Fix: a number in "
            f"{used.unit(kind)}, or with a unit ({', '.join(known)})"
        )
    return float(f"{value * known[unit]:.12g}") if unit else used.si(kind, value)
