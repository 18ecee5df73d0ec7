"""Impactor shapes. docs/extending.md tells how to add one."""

from taichi_foam.laws.shape import kinds
from taichi_foam.laws.shape.base import Impactor
from taichi_foam.parts import Registry

__all__ = ["SHAPES", "Impactor"]

SHAPES: Registry[Impactor] = Registry("shape", "what the impactor is")
"""Impactors by their `shape`."""

for name in kinds.__all__:
    SHAPES.register(getattr(kinds, name))
