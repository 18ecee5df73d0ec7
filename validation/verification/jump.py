"""Compaction fronts in theory: the jump conditions for the foam's own law (Eq. 26).

One dimension, nominal stress s and engineering strain e, both positive in compression here, density
rho of the virgin foam, reference coordinates. Across a front that runs at c into foam of strain e1,
stress s1 and velocity v1, and leaves e2, s2 and v2 (Rankine and Hugoniot):

    v2 - v1 = c (e2 - e1)        s2 - s1 = rho c (v2 - v1)

With s2 = s(e2) a jump of the velocity decides everything. What the front dissipates per volume is
the work (s1 + s2) (e2 - e1) / 2 less what is stored: the area between the law and the chord, on
top of what the law itself dissipates. With a locking strain e_d, s1 = s_p and e1 = v1 = 0 this is
Reid and Peng's s_p + rho v^2 / e_d (Int. J. Impact Engng 19 (1997) 531).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from scipy.integrate import quad
from scipy.optimize import brentq

from taichi_foam.scene import Foam

# The engine goes on with a tangent this near to locking; a jump that ends there is not the law's.
GUARD = 0.05


@dataclass(frozen=True)
class Precursor:
    """The elastic wave that runs ahead and brings foam to yield."""

    speed: float  # m/s
    strain: float
    stress: float  # Pa
    velocity: float  # of the foam behind it [m/s]


@dataclass(frozen=True)
class Front:
    """A compaction front: what lies behind it, in compression."""

    ahead: Precursor
    velocity_jump: float  # m/s
    strain: float
    stress: float  # Pa
    speed: float  # in reference coordinates [m/s]
    dissipated: float  # J/m3, by the law and by what makes the front thick


def stress(foam: Foam, e: float) -> float:
    """Stress [Pa] of a first loading to the strain `e`, both positive in compression."""
    densified = -foam.densification_strain
    if e <= densified:
        return foam.youngs_modulus * min(e, -foam.yield_strain)
    room = -foam.locking_strain - e
    exponent = foam.densification_a * (e - densified) / room**foam.densification_b
    return foam.plateau_stress * math.exp(exponent)


def stored(foam: Foam, e: float) -> float:
    """Energy [J/m3] that unloading gives back: densification retraces itself, the plateau not."""
    elastic = 0.5 * foam.youngs_modulus * min(e, -foam.yield_strain) ** 2
    densified = -foam.densification_strain
    if e <= densified:
        return elastic
    return elastic + quad(lambda strain: stress(foam, strain), densified, e)[0]


def precursor(foam: Foam, density: float) -> Precursor:
    """The wave at sqrt(K / rho) that brings virgin foam at rest to its yield point."""
    speed = math.sqrt(foam.youngs_modulus / density)
    strain = -foam.yield_strain
    return Precursor(speed, strain, foam.plateau_stress, speed * strain)


def front(foam: Foam, density: float, velocity_jump: float) -> Front:
    """The front into foam at yield across which the velocity jumps by so much [m/s]."""
    ahead = precursor(foam, density)

    def excess(e: float) -> float:
        raised = density * velocity_jump**2 / (e - ahead.strain)
        return math.log(stress(foam, e) / (ahead.stress + raised))

    densified, locked = -foam.densification_strain, -foam.locking_strain
    most = locked - GUARD * (locked - densified)
    strain: Any = brentq(excess, densified, most, xtol=1e-14)
    rise = strain - ahead.strain
    speed = velocity_jump / rise
    behind = ahead.stress + density * speed * velocity_jump
    work = 0.5 * (ahead.stress + behind) * rise
    lost = work - stored(foam, strain) + stored(foam, ahead.strain)
    return Front(ahead, velocity_jump, strain, behind, speed, lost)


def locking_stress(foam: Foam, density: float, velocity: float, locking: float) -> float:
    """Reid and Peng's stress behind the front [Pa] for the same plateau, locked at a strain."""
    return foam.plateau_stress + density * velocity**2 / locking


def thickness(foam: Foam, front: Front, density: float, viscosity: float) -> float:
    """Width of a steady front in reference coordinates [m], from 10 to 90 % of its strain.

    Dashpots carry what the law does not of the chord's stress, eta c de/dX = chord(e) - s(e). Over
    the plateau the chord leaves rho c^2 (e - e1): strain grows by e over eta / (rho c).
    """
    ahead, rise = front.ahead, front.strain - front.ahead.strain

    def length(e: float) -> float:
        chord = ahead.stress + density * front.speed**2 * (e - ahead.strain)
        return viscosity * front.speed / (chord - stress(foam, e))

    low, high = (ahead.strain + part * rise for part in (0.1, 0.9))
    kink = [-foam.densification_strain] if low < -foam.densification_strain < high else None
    return quad(length, low, high, points=kink)[0]
