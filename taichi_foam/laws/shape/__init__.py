"""Impactor shapes: what can hit the block. docs/extending.md tells how to add one."""

from taichi_foam.laws.registry import Registry
from taichi_foam.laws.shape import cylinder, drawn, ellipse, flat, i_shape, polygon, wedge
from taichi_foam.laws.shape.base import Control, Impactor

__all__ = ["SHAPES", "Control", "Impactor"]

SHAPES: Registry[Impactor] = Registry("shape", "what the impactor is")
"""Impactors by their `shape`."""

SHAPES.register(flat.FlatBlock)
SHAPES.register(cylinder.Cylinder)
SHAPES.register(wedge.Wedge)
SHAPES.register(polygon.Polygon)
SHAPES.register(ellipse.Ellipse)
SHAPES.register(i_shape.IShape)
SHAPES.register(drawn.Outline)
