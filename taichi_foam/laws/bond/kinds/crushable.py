"""Crushable foam (Eq. 26, Figs 19-20): plateau, densification, unloading, weak re-tension, failure.

A bond that has reached the strain e_min unloads from there elastically, and is weak in tension. In
rate-dependent foam e_min lags behind the strain by a flow rule; the lag gives the overstress, the
stress above the static one.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import model_validator

from taichi_foam.backend import ti
from taichi_foam.laws import elementary
from taichi_foam.laws.bond.base import Landmarks
from taichi_foam.laws.bond.crushing import UNLESS_GIVEN, Crushing, CrushingFoam
from taichi_foam.parts import Control, quantity

# The densification law is singular at the locking strain. Within this fraction of the interval from
# locking to densification it continues as its tangent, so that a trial stage that overshoots still
# has a finite, rising stress. For Table 6's constants that stress is 1.9 GPa, far above any that a
# run reaches.
GUARD = 0.05

# A plateau stress below this [Pa] was probably given in kPa or MPa.
LEAST_PLATEAU = 500.0

# Quadrature rule for the energy stored by densification, on [-1, 1].
GAUSS_POINTS, GAUSS_WEIGHTS = (each.tolist() for each in np.polynomial.legendre.leggauss(8))


class Foam(CrushingFoam):
    """Parameters of crushable foam (paper, Table 1 and Eq. 26). Strains: tension positive."""

    law: Literal["crushable"] = "crushable"
    unless_given: ClassVar[Mapping[str, str]] = MappingProxyType(
        dict.fromkeys(
            (
                "youngs_modulus", "shear_modulus", "yield_strain", "tensile_strain",
                "shear_strain", "densification_strain", "locking_strain", "densification_a",
                "densification_b", "crushed_tensile_fraction",
            ),
            "that of the paper's foam",
        )
        | UNLESS_GIVEN
    )  # fmt: skip
    controls: ClassVar[tuple[Control, ...]] = (
        *CrushingFoam.controls,
        Control("yield_strain", "yield strain", -0.2, -0.01, 0.001),
        Control("densification_strain", "densification", -0.94, -0.3, 0.01),
        Control("rate", "rate D", 5, 100_000, 1, "1/s", log=True),
    )
    yield_strain: float = quantity(
        -0.05,
        "compression",
        "strain at which the plateau begins; plateau_stress, in Pa, may be given instead",
        at_least=-0.5,
        below=0,
    )
    densification_strain: float = quantity(
        -0.80,
        "compression",
        "strain at which densification begins",
        above=-1,
        below=0,
    )
    locking_strain: float = quantity(
        -0.95,
        "compression",
        "strain at which the stress becomes infinite",
        above=-1,
        below=0,
    )
    densification_a: float = quantity(
        0.5, "-", "constant a of Eq. 26: how steeply the stress rises", above=0, at_most=10
    )
    densification_b: float = quantity(
        1.0, "-", "constant b of Eq. 26: exponent of the distance to locking", above=0, at_most=5
    )
    rate: float | None = quantity(
        None,
        "1/s",
        "strain rate D at which the plateau stress is twice the static one (Cowper & Symonds); "
        "none: no rate dependence",
        at_least=1,
        at_most=1e9,
    )
    rate_exponent: float = quantity(
        1.0,
        "-",
        "exponent q: the plateau stress grows by the fraction (rate / D)^(1/q)",
        at_least=1,
        at_most=20,
    )
    overshoot_strain: float | None = quantity(
        None,
        "-",
        "lasting strain over which the rate D grows by a factor e: whole foam resists the rate, "
        "and loses this resistance as it or the foam beside it yields (with a rate only); "
        "none: D is constant",
        at_least=5e-3,
        at_most=1,
    )

    @model_validator(mode="before")
    @classmethod
    def _take_plateau(cls, data: Any) -> Any:
        """Replace a given `plateau_stress` by the yield strain."""
        if not isinstance(data, dict) or "plateau_stress" not in data:
            return data
        rest = {key: value for key, value in data.items() if key != "plateau_stress"}
        if data["plateau_stress"] is None:
            return rest
        stress, young = data["plateau_stress"], data.get("youngs_modulus")
        young = cls.model_fields["youngs_modulus"].default if young is None else young
        if not all(isinstance(x, int | float) and type(x) is not bool for x in (stress, young)):
            raise ValueError(
                f"foam.plateau_stress = {stress!r}: must be a number; stresses are in pascals "
                "(0.12 MPa is 0.12e6)"
            )
        if not LEAST_PLATEAU <= stress <= 0.5 * young:
            raise ValueError(
                f"foam.plateau_stress = {stress:g}: must be at least {LEAST_PLATEAU:g} Pa and at "
                f"most half of foam.youngs_modulus = {young:g} Pa; stresses are in pascals "
                "(0.12 MPa is 0.12e6)"
            )
        strain = -stress / young
        given = data.get("yield_strain")
        if isinstance(given, int | float) and abs(given - strain) > 1e-9 * abs(strain):
            raise ValueError(
                f"foam.plateau_stress = {stress:g}: with foam.youngs_modulus = {young:g} Pa it "
                f"gives foam.yield_strain = {strain:.4g}, not {given:g}; give one of the two"
            )
        return {**rest, "yield_strain": strain}

    @model_validator(mode="after")
    def _check_order(self) -> "Foam":
        problems = []
        if self.densification_strain >= self.yield_strain:
            problems.append(
                f"foam.densification_strain = {self.densification_strain:g}: must be below "
                f"foam.yield_strain = {self.yield_strain:g}; the paper uses -0.80 and -0.05"
            )
        if self.locking_strain >= self.densification_strain:
            problems.append(
                f"foam.locking_strain = {self.locking_strain:g}: must be below "
                f"foam.densification_strain = {self.densification_strain:g} (more compressive, "
                "nearer to -1); the paper uses -0.95 and -0.80"
            )
        if problems:
            raise ValueError("\n".join(problems))
        return self

    @property
    def plateau_stress(self) -> float:
        """Magnitude of the plateau's stress [Pa], K |e_y| (Eq. 26)."""
        return self.youngs_modulus * -self.yield_strain

    @property
    def landmarks(self) -> Landmarks:
        return Landmarks(
            crush_start=self.yield_strain,
            crush_end=self.densification_strain,
            limit=self.locking_strain,
            tensile=self.tensile_strain,
            crushed_tensile=self.crushed_tension[0],
            shear=self.shear_strain,
            plateau_stress=self.plateau_stress,
        )

    def permanent_strain(self, worst: NDArray[np.float64]) -> NDArray[np.float64]:
        """The plateau unloads with slope K; densification retraces the loading curve (Fig. 19)."""
        return np.clip(worst, self.densification_strain, self.yield_strain) - self.yield_strain

    def loading(self, strain: NDArray[np.float64]) -> NDArray[np.float64]:
        return loading_stress(
            strain,
            self.youngs_modulus,
            -self.yield_strain,
            -self.densification_strain,
            -self.locking_strain,
            self.densification_a,
            self.densification_b,
        )

    def law_for(self, model: Any) -> "Crushable":
        return Crushable(
            heeds_rate=self.rate is not None,
            overshoots=self.rate is not None and self.overshoot_strain is not None,
            linear_flow=self.rate_exponent == 1.0,
            linear_room=self.densification_b == 1.0,
            **self.options(model),
        )

    def constants(self, model: Any) -> dict[str, float]:
        return super().constants(model) | {
            "locking_strain": self.locking_strain,
            "densification_a": self.densification_a,
            "densification_b": self.densification_b,
            "rate": self.rate or 0.0,
            "rate_exponent": self.rate_exponent,
            "overshoot_strain": self.overshoot_strain or 0.0,
        }


def loading_stress(
    strain: NDArray[np.float64],
    young: float,
    yields: float,
    densification: float,
    locking: float,
    a: float,
    b: float,
) -> NDArray[np.float64]:
    """Stress [Pa] of Eq. 26 on first loading, for arrays; everything is positive in compression.

    As in `Crushable.densified`, the curve continues as its tangent near locking (GUARD).
    """
    guard = locking - GUARD * (locking - densification)
    inside = np.clip(strain, densification, guard)
    room = locking - inside
    exponent = a * (inside - densification) / room**b
    stress = young * yields * np.exp(np.minimum(exponent, 300.0))
    slope = stress * (a / room**b + b * exponent / room)
    dense = stress + slope * np.maximum(strain - guard, 0.0)
    return np.where(strain <= densification, young * np.clip(strain, 0.0, yields), dense)


@ti.dataclass
class Constants:
    """Constants of one foam: strains dimensionless, stresses in Pa."""

    youngs_modulus: ti.f64
    shear_modulus: ti.f64
    yield_strain: ti.f64
    tensile_strain: ti.f64
    shear_strain: ti.f64
    densification_strain: ti.f64
    locking_strain: ti.f64
    densification_a: ti.f64
    densification_b: ti.f64
    crushed_tensile_strain: ti.f64
    crushed_tensile_stress: ti.f64
    shear_pressure_coefficient: ti.f64
    rate: ti.f64  # D of Cowper & Symonds [1/s], or 0: rate-independent
    rate_exponent: ti.f64
    overshoot_strain: ti.f64


@dataclass(frozen=True)
class Crushable(Crushing):
    """The law's functions, for one set of options.

    heeds_rate      with Cowper & Symonds' overstress
    overshoots      its rate D grows with the lasting strain, its own or that of the foam around it:
                    a yield point above the plateau, which crushing does not meet as it spreads
    linear_flow     its exponent q is 1
    linear_room     the constant b of Eq. 26 is 1: no power is computed

    The other options are those of `Crushing`.
    """

    heeds_rate: bool = False
    overshoots: bool = False
    linear_flow: bool = True
    linear_room: bool = True

    Constants = Constants
    yields_in_shear = True

    @property
    def looks_around(self) -> bool:
        return self.overshoots

    @property
    def only_flows(self) -> bool:
        return self.heeds_rate

    @ti.func
    def densified(self, c: ti.template(), e):
        """Stress of the densification branch and its slope (Eq. 26c, both brackets positive).

        For e < e_d; beyond the guard strain the curve continues as its tangent.
        """
        guard = c.locking_strain + GUARD * (c.densification_strain - c.locking_strain)
        inside = elementary.larger(e, guard)
        room = inside - c.locking_strain
        power = room
        if ti.static(not self.linear_room):  # a power costs as much as the exponential
            power = elementary.power(room, c.densification_b)
        steepness = c.densification_a / power
        exponent = steepness * (c.densification_strain - inside)
        stress = c.youngs_modulus * c.yield_strain * elementary.exp(exponent)
        slope = -stress * (steepness + c.densification_b * exponent / room)
        return stress + slope * (e - inside), slope

    @ti.func
    def met(self, c: ti.template(), e, history: ti.template()):
        """Rate-dependent foam only flows; see `flowed`."""
        now = history
        if ti.static(not self.only_flows):
            now.worst = elementary.smaller(e, history.worst)
        return now

    @ti.func
    def stiffening(self, c: ti.template(), e, history: ti.template(), broken):
        """Stress that densification adds to the plateau, and its slope [Pa]; 0 above e_d."""
        stress, slope = self.densified(c, elementary.smaller(e, c.densification_strain))
        acts = e < c.densification_strain
        if ti.static(self.broken_contact == "jump"):
            acts = ti.select(broken, acts & (e <= history.worst), acts)
        added = stress - c.youngs_modulus * c.yield_strain
        return ti.select(acts, added, 0.0), ti.select(acts, slope, 0.0)

    @ti.func
    def unloading(self, c: ti.template(), e_min):
        """Strain at zero stress of a bond with this `e_min`, and the slope of unloading [Pa].

        The plateau unloads with the slope K; densification retraces the loading curve, so that the
        turning point is never beyond e_d.
        """
        turn = elementary.larger(e_min, c.densification_strain)
        turn = elementary.smaller(turn, c.yield_strain)
        return turn - c.yield_strain, c.youngs_modulus

    @ti.func
    def flowed(self, c: ti.template(), e, history: ti.template(), time, slowed, around):
        """The history of rate-dependent foam after `time` [s] at strain `e`.

        In flow at the rate r the plateau stress is K e_y (1 + (r / D)^(1/q)) (Cowper & Symonds
        1957, as Perzyna's overstress): while e_min lags behind e by y, its rate is
        D (y / |e_y|)^q. At a constant strain and D this has a closed-form solution for any time.
        Where D grows with the lasting strain, its value in the middle of the time counts, which
        leaves an error of second order; where it grows with that around it, its value at the start,
        which leaves one of first order.
        """
        elastic = elementary.larger(e, c.yield_strain)
        start = elementary.smaller(elastic, history.worst)
        lag = elementary.larger(start - e, 0.0)
        acts, left = time * slowed, lag
        if ti.static(self.overshoots):
            near = c.yield_strain - around
            own = elementary.larger(c.yield_strain - start, 0.0)
            # exponentials are expensive, and most foam that is pressed further is elastic
            if elementary.any_of(lag > 0.0):
                # not unrolled: the compiler vectorises two exponentials, but not four in a row
                for half in range(1, 3):
                    grown = elementary.larger(own + (lag - left), near)
                    rate = self._grown_rate(c, grown, slowed)
                    left = self._lag_after(c, lag, rate, 0.5 * half * acts)
        else:
            left = self._lag_after(c, lag, c.rate, acts)
        now = history
        now.worst = start - (lag - left)
        return now

    @ti.func
    def _grown_rate(self, c: ti.template(), yielded, slowed):
        """D [1/s] of foam in which the lasting strain `yielded` counts.

        If a row of cells is thinner than the band that its rate counts over, so is its yielding:
        the overshoot fades over the same displacement.
        """
        return c.rate * elementary.exp(yielded / (c.overshoot_strain * slowed))

    @ti.func
    def _lag_after(self, c: ti.template(), lag, rate, time):
        """What is left of a lag after a time [s] at a constant strain and `rate` D [1/s]."""
        times = rate * time / -c.yield_strain
        left = lag * elementary.exp(-times)
        if ti.static(not self.linear_flow):
            power = c.rate_exponent - 1.0
            # the base of a power must be above 0; foam that lags by so little does not flow anyway
            share = elementary.larger(lag / -c.yield_strain, 1e-30)
            growth = 1.0 + power * times * elementary.power(share, power)
            left = lag * elementary.power(growth, -1.0 / power)
        return left

    @ti.func
    def lasting_crush(self, c: ti.template(), worst):
        return elementary.larger(c.yield_strain - worst, 0.0)

    @ti.func
    def plateau_stress(self, c: ti.template()):
        return -c.youngs_modulus * c.yield_strain

    @ti.func
    def yields_as_at(self, c: ti.template(), e, share):
        """By as much of the yield strain as the plateau falls, up to where foam is packed."""
        sooner = e + (1.0 - share) * c.yield_strain
        sooner = elementary.larger(sooner, elementary.smaller(e, c.densification_strain))
        return ti.select(sooner < c.yield_strain, sooner, e)

    @ti.func
    def elastic_strain(self, c: ti.template(), e, e_min, permanent):
        """Elastic part of a compressive strain, as if the plateau had no end.

        At most the yield strain, plus the lag of e_min behind e in rate-dependent foam.
        """
        strain = elementary.larger(e - permanent, c.yield_strain)
        if ti.static(self.heeds_rate):
            flows_from = elementary.smaller(e_min, c.yield_strain)
            strain += elementary.smaller(e - flows_from, 0.0)
        return strain

    @ti.func
    def stiffening_energy(self, c: ti.template(), e: ti.f64, e_min: ti.f64) -> ti.f64:
        energy = 0.0
        if e < c.densification_strain:
            energy = self._densified_energy(c, e)
            if ti.static(self.heeds_rate):
                # over the lag of e_min behind e the overstress also stores the plateau's energy
                short = ti.max(ti.min(e_min, c.densification_strain) - e, 0.0)
                energy += c.youngs_modulus * c.yield_strain * short
        return energy

    @ti.func
    def _densified_energy(self, c: ti.template(), e: ti.f64) -> ti.f64:
        """Area under the densification branch between `e` and e_d [J/m3], by Gauss's rule.

        The integral has no closed form for general b. Over the logarithm of e - e_l, eight points
        have a relative error of 1e-5 up to a crush of 0.93 for Table 6's constants.
        """
        room = c.densification_strain - c.locking_strain
        inside = ti.max(e - c.locking_strain, GUARD * room)
        half = -0.5 * elementary.log(inside / room)
        area = 0.0
        for k in range(ti.static(len(GAUSS_POINTS))):
            # selected in a loop: SPIR-V, and so Vulkan, cannot index a list of constants
            point, weight = 0.0, 0.0
            for n in ti.static(range(len(GAUSS_POINTS))):
                if k == n:
                    point, weight = GAUSS_POINTS[n], GAUSS_WEIGHTS[n]
            here = room * elementary.exp(-half * (1.0 + point))
            stress, _ = self.densified(c, c.locking_strain + here)
            area += weight * here * stress
        # beyond the guard strain the curve is its tangent
        beyond = e - c.locking_strain - inside
        stress, slope = self.densified(c, c.locking_strain + inside)
        return beyond * (stress + 0.5 * slope * beyond) - half * area
