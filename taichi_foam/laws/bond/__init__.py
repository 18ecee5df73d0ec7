"""Bond laws: the kinds of foam that a scene can have. docs/extending.md tells how to add one."""

from taichi_foam.laws.bond import kinds
from taichi_foam.laws.bond.base import BondFoam, BondLaw, Landmarks, Limit
from taichi_foam.laws.bond.curve import Curve
from taichi_foam.parts import Registry

__all__ = ["FOAMS", "BondFoam", "BondLaw", "Curve", "Landmarks", "Limit"]

FOAMS: Registry[BondFoam] = Registry("law", "how the foam's bonds behave", default="crushable")
"""Foams by their `law`."""

for name in kinds.__all__:
    FOAMS.register(getattr(kinds, name))
