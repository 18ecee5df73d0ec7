"""The shoulder envelope of a family of foams: the least stress for each absorbed energy.

Foams of one kind and different densities each have a shoulder in the diagram of stress over energy,
beyond which the stress rises steeply. The envelope of all shoulders says which density takes an
energy at the least stress.

S. K. Maiti, L. J. Gibson, M. F. Ashby: Deformation and energy absorption diagrams for cellular
    solids. Acta Metall. 32 (1984) 1963-1975
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from taichi_foam.errors import UserError
from taichi_foam.formulas.energy import largest_until, points, stopping_strain

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Envelope:
    """The best of a family of foams at each energy.

    energy  (n,) J/m3
    stress  (n,) Pa, the least of all foams; NaN where none can absorb the energy
    foam    (n,) which foam that is, from 0; -1 for none
    """

    energy: Array
    stress: Array
    foam: NDArray[np.intp]


def shoulder_envelope(curves: Sequence[tuple[ArrayLike, ArrayLike]], energy: ArrayLike) -> Envelope:
    """The envelope of foams, given by their curves (strain, stress [Pa]), at energies [J/m3].

    The stress of a foam is the largest until it has absorbed the energy. Raises UserError: no
    curves, or an energy below 0.
    """
    found = [points(*curve) for curve in curves]
    energies = np.asarray(energy, dtype=np.float64).ravel()
    if not found:
        raise UserError("no curves: must be one for each foam of the family")
    if not (np.isfinite(energies) & (energies >= 0.0)).all():
        raise UserError(f"energies from {energies.min():g} J/m3: must be at least 0, and finite")
    stresses = np.array([[_stress(*curve, each) for each in energies.tolist()] for curve in found])
    best = np.argmin(stresses, axis=0)
    least = stresses[best, np.arange(energies.size)]
    there = np.isfinite(least)
    return Envelope(energies, np.where(there, least, np.nan), np.where(there, best, -1))


def _stress(strain: Array, stress: Array, energy: float) -> float:
    end = stopping_strain(strain, stress, energy, 0.0)
    return np.inf if end is None else largest_until(strain, stress, end)
