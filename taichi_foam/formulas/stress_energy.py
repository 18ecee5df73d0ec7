"""The stress-energy method: one curve for cushions of all thicknesses, from drop tests.

Cushion tests of one foam at any drop height h, thickness T and static stress sigma_st fall on one
curve, if the force of the foam does not depend on the rate: the dynamic stress G sigma_st over the
dynamic energy sigma_st h / T, as a exp(b sigma_st h / T). So G is largest deceleration in g, and
least at sigma_st = T / (b h), where it is e a b h / T.

G. Burgess: Consolidation of cushion curves. Packag. Technol. Sci. 3 (1990) 189-194
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from taichi_foam.errors import UserError

Array = NDArray[np.float64]


@dataclass(frozen=True)
class StressEnergy:
    """A stress-energy curve.

    stress     a [Pa]
    exponent   b [m3/J]
    energies   smallest and largest dynamic energy of the tests [J/m3]; the curve holds between them
    deviation  standard deviation of the tests from it, of ln(G sigma_st)
    """

    stress: float
    exponent: float
    energies: tuple[float, float]
    deviation: float

    def g(self, static_stress: ArrayLike, drop_height: ArrayLike, thickness: ArrayLike) -> Array:
        """Largest deceleration [g] by static stress [Pa], drop height [m] and thickness [m]."""
        static = np.asarray(static_stress, dtype=np.float64)
        energy = static * np.asarray(drop_height) / np.asarray(thickness)
        return self.stress * np.exp(self.exponent * energy) / static

    def optimum(self, drop_height: float, thickness: float) -> tuple[float, float]:
        """The static stress [Pa] of least deceleration, and that deceleration [g].

        It is at the energy 1 / b, which may lie beyond the tests, see `energies`.
        """
        steepness = self.exponent * drop_height / thickness
        return 1.0 / steepness, math.e * self.stress * steepness


def fitted(
    drop_height: ArrayLike, thickness: ArrayLike, static_stress: ArrayLike, g: ArrayLike
) -> StressEnergy:
    """The curve of tests (n,): heights and thicknesses [m], static stresses [Pa], and G [g].

    By least squares of ln(G sigma_st), so that all tests weigh the same in relative terms. Values
    that all tests share may be given once. Raises UserError: fewer than three tests, or at one
    energy only; a value not above 0; a stress that does not rise with the energy.
    """
    columns = (drop_height, thickness, static_stress, g)
    try:
        values = np.array(np.broadcast_arrays(*(np.asarray(each, float) for each in columns)))
    except ValueError:
        raise UserError(
            "tests: heights, thicknesses, static stresses and G must be equal in number"
        ) from None
    values = values.reshape(4, -1)
    names = ("drop_height", "thickness", "static_stress", "g")
    for name, row in zip(names, values, strict=True):
        wrong = row[~(np.isfinite(row) & (row > 0.0))]
        if wrong.size:
            raise UserError(f"tests: {name} = {wrong[0]:g}: must be above 0")
    height, thick, static, deceleration = values
    energy, stress = static * height / thick, np.log(deceleration * static)
    if energy.size < 3 or np.ptp(energy) <= 1e-6 * energy.max():
        raise UserError(
            f"tests: {energy.size} at energies sigma_st h / T from {energy.min():g} to "
            f"{energy.max():g} J/m3: must be at least three, at different energies"
        )
    exponent, level = np.polyfit(energy, stress, 1)
    if exponent <= 0.0:
        raise UserError(
            "tests: the dynamic stress G sigma_st does not rise with the energy sigma_st h / T; "
            "check the units: Pa, m, and G in g"
        )
    rest = stress - (level + exponent * energy)
    deviation = math.sqrt(float(rest @ rest) / (energy.size - 2))
    ends = float(energy.min()), float(energy.max())
    return StressEnergy(math.exp(level), float(exponent), ends, deviation)
