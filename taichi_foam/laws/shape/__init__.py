"""Impactor shapes. docs/extending.md tells how to add one."""

from taichi_foam.laws.shape import bodies, polygon
from taichi_foam.laws.shape.base import Impactor
from taichi_foam.parts import Registry

__all__ = ["SHAPES", "Impactor"]

SHAPES: Registry[Impactor] = Registry("shape", "what the impactor is")
"""Impactors by their `shape`."""

SHAPES.register(bodies.FlatBlock)
SHAPES.register(bodies.Cylinder)
SHAPES.register(bodies.Wedge)
SHAPES.register(polygon.Polygon)
SHAPES.register(bodies.Ellipse)
SHAPES.register(bodies.IShape)
SHAPES.register(polygon.Outline)
