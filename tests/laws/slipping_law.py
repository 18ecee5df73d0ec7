"""A law whose bonds remember two values of their own, one of which changes in time.

Two elements side by side: a spring that slips at a limit, and a spring whose rest length follows
the strain within a relaxation time (Maxwell's).
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from taichi_foam.backend import ti
from taichi_foam.laws import elementary
from taichi_foam.laws.bond.base import BondFoam, BondLaw, Landmarks
from taichi_foam.parts import quantity


@ti.dataclass
class Constants:
    youngs_modulus: ti.f64
    shear_modulus: ti.f64
    slip_strain: ti.f64
    relaxation_time: ti.f64


@ti.dataclass
class History:
    worst: ti.f64
    slip: ti.f64
    creep: ti.f64


class SlippingFoam(BondFoam):
    """Parameters of such a foam."""

    law: Literal["slipping"] = "slipping"
    slip_strain: float = quantity(0.01, "-", "strain of the spring that slips", above=0)
    relaxation_time: float = quantity(5e-3, "s", "that of the other spring", above=0)

    @property
    def landmarks(self) -> Landmarks:
        return Landmarks(-0.5, -0.8, -0.9, 10.0, 10.0, 10.0, self.youngs_modulus)

    def permanent_strain(self, worst):
        return np.zeros_like(worst)

    def law_for(self, model):
        return Slipping()

    def constants(self, model):
        return {name: getattr(self, name) for name in Constants.members}


@dataclass(frozen=True)
class Slipping(BondLaw):
    Constants = Constants
    History = History
    heeds_rate = True

    @ti.func
    def met(self, c: ti.template(), e, history: ti.template()):
        now = history
        now.worst = elementary.smaller(e, history.worst)
        now.slip = elementary.larger(
            elementary.smaller(history.slip, e + c.slip_strain), e - c.slip_strain
        )
        return now

    @ti.func
    def flows(self, c: ti.template(), e, history: ti.template()):
        return e != history.creep

    @ti.func
    def flowed(self, c: ti.template(), e, history: ti.template(), time, slowed, around):
        now = history
        now.creep = e + (history.creep - e) * ti.exp(-time / c.relaxation_time)
        return now

    @ti.func
    def stress_fraction(self, c: ti.template(), e, history: ti.template(), broken):
        return c.youngs_modulus * (2.0 * e - history.slip - history.creep), 1.0 + 0.0 * e

    @ti.func
    def stored_energy(
        self, c: ti.template(), e: ti.f64, history: ti.template(), broken: ti.i32
    ) -> ti.f64:
        met = self.met(c, e, history)
        return 0.5 * c.youngs_modulus * ((e - met.slip) ** 2 + (e - met.creep) ** 2)

    @ti.func
    def energy_lost_by_breaking(
        self, c: ti.template(), e: ti.f64, history: ti.template()
    ) -> ti.f64:
        return 0.0

    @ti.func
    def fails(
        self, c: ti.template(), e, sigma_e, tau, history: ti.template(), size, tensile, strength
    ):
        return e > 10.0 * tensile

    @ti.func
    def largest_stiffness(self, c: ti.template()) -> ti.f64:
        return 2.0 * c.youngs_modulus
