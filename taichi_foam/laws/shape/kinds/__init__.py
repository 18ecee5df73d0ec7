"""The package's impactor shapes: their files, and their names here, in the order of tables."""

from taichi_foam.laws.shape.kinds.bodies import Cylinder, Ellipse, FlatBlock, IShape, Wedge
from taichi_foam.laws.shape.kinds.polygon import Outline, Polygon

__all__ = ["FlatBlock", "Cylinder", "Wedge", "Polygon", "Ellipse", "IShape", "Outline"]  # noqa: RUF022
