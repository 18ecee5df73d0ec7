"""A double cantilever of this foam in beam theory: two arms that a body between them holds apart.

Arms of height h and length a, width Z, each bent by delta. The law has no Poisson coupling, so
plane strain or stress is the same and E = K. For two arms with compliance C the energy is
U = delta^2 / C, and the energy release rate at a given opening

    G = -(dU/da) / Z = delta^2 C'(a) / (Z C^2)

Plain bending, C = a^3 / (3 E I), gives G = 9 E I delta^2 / (Z a^4) = 3 E h^3 w^2 / (16 a^4) with
the opening w = 2 delta: Obreimoff's (1930) wedge. Two things make the arms softer: shear,
a / (k G A) with k = 5/6 (Timoshenko), and the root, which is not clamped but gives way. For an
orthotropic arm Hashemi, Kinloch and Williams (1990, Proc. R. Soc. A 427:173) put both into a longer
arm, a + chi h.

A lattice's arm has n columns of bonds, each of them thin: I = Z h^3 (1 - 1/n^2) / 12.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

SHEAR_FACTOR = 5 / 6
THEORIES = ("bending", "bending and shear", "bending, shear and root")


@dataclass(frozen=True)
class Arm:
    """One arm; SI units."""

    youngs_modulus: float
    shear_modulus: float
    height: float
    width: float
    columns: int = 0  # of bonds; 0: a continuum

    @property
    def bending_stiffness(self) -> float:
        """E I [N m2]."""
        thin = 1.0 - 1.0 / self.columns**2 if self.columns else 1.0
        return self.youngs_modulus * self.width * self.height**3 * thin / 12.0

    @property
    def chi(self) -> float:
        """By how many heights the root's give lengthens the arm, its shear included."""
        ratio = 1.18 * self.youngs_modulus / self.shear_modulus
        inner = 3.0 - 2.0 * (ratio / (1.0 + ratio)) ** 2
        return math.sqrt(self.youngs_modulus / (11.0 * self.shear_modulus) * inner)

    def compliance(self, length: float, theory: str) -> float:
        """Deflection of one arm over its force [m/N]."""
        if theory == THEORIES[2]:
            length = length + self.chi * self.height
        bending = length**3 / (3.0 * self.bending_stiffness)
        if theory != THEORIES[1]:
            return bending
        section = self.height * self.width
        return bending + length / (SHEAR_FACTOR * self.shear_modulus * section)

    def energy(self, deflection: float, length: float, theory: str) -> float:
        """What both arms store [J]."""
        return deflection**2 / self.compliance(length, theory)

    def release(self, deflection: float, length: float, theory: str) -> float:
        """Energy release rate at a given opening [J/m2]."""

        def stored(a: float) -> float:
            return self.energy(deflection, a, theory)

        return -_derivative(stored, length) / self.width


def _derivative(function: Callable[[float], float], at: float) -> float:
    """Central difference over a thousandth: good to 1e-6 for powers of small order."""
    step = 1e-3 * at
    return (function(at + step) - function(at - step)) / (2.0 * step)
