"""The units in which values of cushions are given and shown: metric, or US customary."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from taichi_foam.errors import UserError
from taichi_foam.units import INCH, POUND, STRESS_UNITS, rounded


@dataclass(frozen=True)
class Units:
    """A system of units: name and size in SI units of each kind of value; energy is per volume."""

    name: str
    kinds: Mapping[str, tuple[str, float]]

    def unit(self, kind: str) -> str:
        """The unit of a kind of value."""
        return self.kinds[kind][0]

    def of(self, kind: str, value: float) -> float:
        """A number in this unit, of a value in its SI unit."""
        return value / self.kinds[kind][1]

    def si(self, kind: str, number: float) -> float:
        """The value in its SI unit of a number in this unit."""
        return number * self.kinds[kind][1]

    def text(self, kind: str, value: float) -> str:
        """A value in its SI unit, in words: 50 mm."""
        return f"{self.number(kind, value)} {self.unit(kind)}"

    def number(self, kind: str, value: float) -> str:
        """The number of `text`, with three digits and without an exponent."""
        return f"{rounded(self.of(kind, value), 3):.8g}"


UNITS = {
    "si": Units("si", {
        "length": ("mm", 1e-3), "height": ("m", 1.0), "area": ("cm²", 1e-4), "mass": ("kg", 1.0),
        "stress": ("kPa", 1e3), "density": ("kg/m³", 1.0), "energy": ("kJ/m³", 1e3),
        "velocity": ("m/s", 1.0),
    }),
    "us": Units("us", {
        "length": ("in", INCH), "height": ("in", INCH), "area": ("in²", INCH**2),
        "mass": ("lb", POUND), "stress": ("psi", STRESS_UNITS["psi"]),
        "density": ("lb/ft³", POUND / (12.0 * INCH) ** 3),
        "energy": ("in·lb/in³", STRESS_UNITS["psi"]), "velocity": ("in/s", INCH),
    }),
}  # fmt: skip


def units_named(name: str) -> Units:
    """A system by name. Raises UserError: there is none of this name."""
    if name not in UNITS:
        raise UserError(f"units = {name!r}: must be {' or '.join(UNITS)}")
    return UNITS[name]
