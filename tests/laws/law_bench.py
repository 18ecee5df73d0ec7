"""Each law's `ti.func` behind a kernel that maps it over an array, and a law of the test's own.

`Reference` is written from Eq. 26 and Figs 19-20 by branch, not by the program's expressions.
"""

import math
from dataclasses import dataclass
from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np
import taichi as ti

from taichi_foam.engine.stresses import with_own_table
from taichi_foam.laws.bond import BondFoam, BondLaw
from taichi_foam.scene import Foam, Model

Array = ti.types.ndarray(dtype=ti.f64, ndim=1)


@dataclass(frozen=True)
class Bound:
    """A law, and the constants of a foam."""

    law: BondLaw
    constants: Any
    table: Any = None

    @property
    def kernels(self) -> SimpleNamespace:
        """The law's functions, with the foam's table where they look something up."""
        kernels = _kernels(self.law)
        if self.table is not None:
            kernels.table.from_numpy(self.table[None])
        return kernels


def constants(foam: BondFoam | None = None, model: Model | None = None) -> Bound:
    """The law of a scene's foam and model choices, with its constants."""
    foam, model = foam or Foam(), model or Model()
    law = foam.law_for(model)
    return Bound(law, law.Constants(**foam.constants(model)), foam.table)


@cache
def _kernels(law: BondLaw) -> SimpleNamespace:
    """Each function of a law behind a kernel; a kernel compiles when it is called."""
    law, table = with_own_table(law, _kernels.cache_clear)

    @ti.kernel
    def normal(c: law.Constants, e: Array, e_min: ti.f64, broken: ti.i32, out: Array):
        for k in range(e.shape[0]):
            out[k] = law.normal_stress(c, e[k], law.History(worst=e_min), broken)

    @ti.kernel
    def stored(c: law.Constants, e: Array, e_min: ti.f64, broken: ti.i32, out: Array):
        for k in range(e.shape[0]):
            out[k] = law.stored_energy(c, e[k], law.History(worst=e_min), broken)

    @ti.kernel
    def flowed(
        c: law.Constants, e: Array, e_min: ti.f64, time: ti.f64, slowed: ti.f64, around: ti.f64,
        out: Array,
    ):  # fmt: skip
        for k in range(e.shape[0]):
            out[k] = law.flowed(c, e[k], law.History(worst=e_min), time, slowed, around).worst

    @ti.kernel
    def steadily(
        c: law.Constants, start: ti.f64, rate: ti.f64, step: ti.f64, steps: ti.i32, out: Array
    ):
        for k in range(out.shape[0]):
            worst = start
            for n in range(steps):
                e = start - n * rate * step
                worst = law.flowed(c, e, law.History(worst=worst), step, 1.0, 0.0).worst
            out[k] = worst

    @ti.kernel
    def leaked(c: law.Constants, e: ti.f64, lost: ti.f64, time: ti.f64) -> ti.f64:
        return law.flowed(c, e, law.History(0.0, lost), time, 1.0, 0.0).lost

    @ti.kernel
    def gas_energy(c: law.Constants, e: ti.f64, lost: ti.f64) -> ti.f64:
        return law._gas_energy(c, e, law.History(0.0, lost))

    @ti.kernel
    def densified(c: law.Constants, e: Array, out: Array):
        for k in range(e.shape[0]):
            out[k] = law.stiffening(c, e[k], law.History(), 0)[1]

    @ti.kernel
    def elastic(c: law.Constants) -> ti.f64:
        return law.largest_stiffness(c)

    @ti.kernel
    def piece(c: law.Constants, gap: Array, touch: ti.f64, length: ti.f64, out: Array):
        for k in range(gap.shape[0]):
            out[k] = law.contact_stress(c, gap[k], touch, length)

    @ti.kernel
    def pressed(c: law.Constants, area: Array, room: ti.f64, out: Array):
        for k in range(area.shape[0]):
            out[k] = law.room_stress(c, area[k], room)

    @ti.kernel
    def kept(c: law.Constants, area: Array, room: ti.f64, out: Array):
        for k in range(area.shape[0]):
            out[k] = law.room_energy(c, area[k], room)

    @ti.kernel
    def crushed_shear(c: law.Constants, worst: Array, out: Array):
        for k in range(worst.shape[0]):
            rise, _ = law.shear_rise(c, worst[k])
            out[k] = law.shear_modulus(c) + rise

    @ti.kernel
    def fails(
        c: law.Constants, e: ti.f64, sigma_e: ti.f64, tau: ti.f64, e_min: ti.f64, size: ti.f64,
        strength: ti.f64,
    ) -> ti.i32:  # fmt: skip
        history = law.History(worst=e_min)
        return law.fails(c, e, sigma_e, tau, history, size, strength, strength)

    return SimpleNamespace(**locals())


def loading(foam: Bound, e: np.ndarray) -> np.ndarray:
    """Stress [Pa] of virgin foam at strains `e`."""
    return normal(foam, e, 0.0)


def normal(foam: Bound, e: np.ndarray, e_min: float, broken: bool = False) -> np.ndarray:
    """Stress [Pa] at strains `e` with a history."""
    return _over(foam, "normal", e, e_min, int(broken))


def stored(foam: Bound, e: np.ndarray, e_min: float, broken: bool = False) -> np.ndarray:
    """Stored energy [J/m3] at strains `e` with a history."""
    return _over(foam, "stored", e, e_min, int(broken))


def flowed(
    foam: Bound,
    e: np.ndarray,
    e_min: float,
    time: float,
    slowed: float = 1.0,
    around: float = 0.0,
) -> np.ndarray:
    """What `e_min` becomes at strains `e` in a time [s]; see `BondLaw.flowed`."""
    return _over(foam, "flowed", e, e_min, time, slowed, around)


def flowed_steadily(foam: Bound, start: float, rate: float, step: float, steps: int) -> float:
    """What `e_min` becomes of `start` in steps [s] during which the strain falls at a rate."""
    out = np.empty(1)
    foam.kernels.steadily(foam.constants, start, rate, step, steps, out)
    return out[0]


def leaked(foam: Bound, e: float, lost: float, time: float) -> float:
    """What the lost part of the gas becomes at a strain in a time [s]."""
    return foam.kernels.leaked(foam.constants, e, lost, time)


def gas_energy(foam: Bound, e: float, lost: float) -> float:
    """Energy [J/m3] that the gas stores at a strain."""
    return foam.kernels.gas_energy(foam.constants, e, lost)


def densified(foam: Bound, e: np.ndarray) -> np.ndarray:
    """Slope [Pa] of the densification branch at strains `e`, all beyond densification."""
    return _over(foam, "densified", e)


def elastic(foam: Bound) -> float:
    """Steepest slope [Pa] before densification."""
    return foam.kernels.elastic(foam.constants)


def piece(foam: Bound, gap: np.ndarray, touch: float, length: float) -> np.ndarray:
    """Stress [Pa] of foam between nodes and a support, see `BondLaw.contact_stress`."""
    return _over(foam, "piece", gap, touch, length)


def pressed(foam: Bound, area: np.ndarray, room: float) -> np.ndarray:
    """Pressure [Pa] of cells of `area` whose bonds leave them `room`."""
    return _over(foam, "pressed", area, room)


def kept(foam: Bound, area: np.ndarray, room: float) -> np.ndarray:
    """Energy [J/m3] that such cells store."""
    return _over(foam, "kept", area, room)


def shear_modulus(foam: Bound, worst: np.ndarray) -> np.ndarray:
    """Shear modulus [Pa] of foam that has met strains `worst`."""
    return _over(foam, "crushed_shear", worst)


def fails(
    foam: Bound,
    e: float,
    sigma_e: float = 0.0,
    tau: float = 0.0,
    e_min: float = 0.0,
    size: float = 1.0,
    strength: float = 1.0,
) -> bool:
    """Whether an intact bond breaks."""
    return bool(foam.kernels.fails(foam.constants, e, sigma_e, tau, e_min, size, strength))


def _over(foam: Bound, kernel: str, values: np.ndarray, *given: float) -> np.ndarray:
    """What a kernel makes of values, one by one."""
    values = np.atleast_1d(np.asarray(values, dtype=np.float64))
    out = np.empty_like(values)
    getattr(foam.kernels, kernel)(foam.constants, values, *given, out)
    return out


class Reference:
    """Eq. 26 and Fig. 19, branch by branch; and foam that heeds the rate of its strain."""

    def __init__(self, foam: Foam) -> None:
        self.foam = foam
        self.crushed_strain = foam.crushed_tensile_fraction * foam.tensile_strain
        stress = foam.crushed_tensile_stress
        self.crushed_stress = (
            foam.youngs_modulus * self.crushed_strain if stress is None else stress
        )

    def loading(self, e: float) -> float:
        f = self.foam
        if e >= f.yield_strain:
            return f.youngs_modulus * e
        plateau = -f.plateau_stress
        if e >= f.densification_strain:
            return plateau
        room = (e - f.locking_strain) ** f.densification_b
        return plateau * math.exp(f.densification_a * (f.densification_strain - e) / room)

    def permanent(self, e_min: float) -> float:
        """Strain of zero stress after unloading."""
        f = self.foam
        if e_min >= f.yield_strain:
            return 0.0
        return max(e_min, f.densification_strain) - f.yield_strain

    def behind(self, e: float, e_min: float) -> float:
        """By how much e_min is short of a strain beyond it: the elastic part of the overstress."""
        if self.foam.rate is None:
            return 0.0
        return max(min(e_min, self.foam.yield_strain) - e, 0.0)

    def flow(self, e: float, e_min: float) -> float:
        """Rate [1/s] of e_min: Cowper & Symonds' law, solved for the rate."""
        f = self.foam
        rate = f.rate
        if f.overshoot_strain is not None:
            rate *= math.exp(-self.permanent(e_min) / f.overshoot_strain)
        return -rate * (self.behind(e, e_min) / -f.yield_strain) ** f.rate_exponent

    def normal(self, e: float, e_min: float) -> float:
        """Stress of an intact bond."""
        return self.static(e, e_min) - self.foam.youngs_modulus * self.behind(e, e_min)

    def static(self, e: float, e_min: float) -> float:
        """The same of foam that does not heed the rate."""
        f = self.foam
        if e_min >= f.yield_strain or e <= max(e_min, f.densification_strain):
            return self.loading(e)
        e_p = self.permanent(e_min)
        if e <= e_p:
            return f.youngs_modulus * (e - e_p)
        return self.crushed_stress * (e - e_p) / (self.crushed_strain - e_p)
