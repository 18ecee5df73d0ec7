"""The units in which cushions are described to people: SI, or those of the United States."""

from __future__ import annotations

from dataclasses import dataclass

from taichi_foam.errors import UserError
from taichi_foam.units import LENGTH_UNITS, STRESS_UNITS

_POUND = 0.45359237


@dataclass(frozen=True)
class Unit:
    """A unit: its name, and its size in the SI unit of the quantity."""

    name: str
    size: float

    def text(self, value: float, digits: int = 3) -> str:
        """A value in SI units as a number in this unit, without its name."""
        rounded = float(f"{value / self.size:.{digits}g}")
        if abs(rounded) >= 10.0 ** (digits - 1):
            return f"{rounded:,.0f}"
        return f"{rounded:#.{digits}g}"


SYSTEMS = {
    "si": {
        "length": Unit("mm", 1e-3),
        "mass": Unit("kg", 1.0),
        "stress": Unit("kPa", 1e3),
        "energy": Unit("kJ/m³", 1e3),
        "density": Unit("kg/m³", 1.0),
    },
    "us": {
        "length": Unit("in", LENGTH_UNITS["in"]),
        "mass": Unit("lb", _POUND),
        "stress": Unit("psi", STRESS_UNITS["psi"]),
        "energy": Unit("in·lb/in³", STRESS_UNITS["psi"]),
        "density": Unit("lb/ft³", _POUND / (12 * LENGTH_UNITS["in"]) ** 3),
    },
}
"""Units by system and quantity; an energy is one per volume of foam."""


def units_of(system: str) -> dict[str, Unit]:
    """The units of a system, "si" or "us". Raises UserError: another name."""
    if system not in SYSTEMS:
        raise UserError(
            f"units = {system!r}: must be si (kPa, kJ/m³, mm, kg) or us (psi, in·lb/in³, in, lb)"
        )
    return SYSTEMS[system]
