"""A cylinder as impactor."""

import math
from typing import ClassVar, Literal

import numpy as np
from numpy.typing import ArrayLike

from taichi_foam.backend import ti
from taichi_foam.laws.shape import outline as geometry
from taichi_foam.laws.shape.base import Control, Impactor, vec3
from taichi_foam.parts import quantity

OUTLINE_VERTICES = 64
"""Vertices of the polygon that draws a cylinder; contact uses the circle itself."""

vec2 = ti.types.vector(2, ti.f64)


class Cylinder(Impactor):
    """A cylinder lying across the thickness (paper, Fig. 4b).

    The paper's text gives a radius of 5 cm; its Eqs 3 and 5 with Tables 3 and 5 need 2.5 cm.
    """

    shape: Literal["cylinder"] = "cylinder"
    label: ClassVar[str] = "cylinder"
    controls: ClassVar[tuple[Control, ...]] = (Control("radius", "radius", 5, 75, 0.5, "mm", 1e-3),)
    radius: float = quantity(
        0.025, "m", "radius", at_least=1e-4, at_most=2, fix="lengths are in metres (25 mm is 0.025)"
    )

    def corners(self) -> np.ndarray:
        """Return a regular polygon on the circle [m], for drawing; see the base class."""
        half = OUTLINE_VERTICES // 2
        angle = np.arange(1, half) * (math.pi / half)
        x, y = self.radius * np.sin(angle), self.radius * (1 - np.cos(angle))
        right, left = np.column_stack([x, y]), np.column_stack([-x, y])[::-1]
        return np.vstack([[[0.0, 0.0]], right, [[0.0, 2 * self.radius]], left])

    def foot(self) -> np.ndarray:
        """Return the lowest point of the turned circle [m]; see the base class."""
        middle = np.array([[0.0, self.radius]])
        return geometry.rotated(middle, self.rotation_deg)[0] - middle[0]

    @property
    def squared_gyration(self) -> float:
        """That of a disc [m2]; see the base class."""
        return self.radius**2 / 2

    @property
    def nose_depth(self) -> float:
        """Radius [m]."""
        return self.radius

    @property
    def width(self) -> float:
        """Diameter [m]."""
        return 2 * self.radius

    def crushed_volume(self, displacement: ArrayLike, thickness: float) -> np.ndarray:
        """Volume that the circle has swept, Eq. 5 [m3]; see the base class."""
        R = self.radius
        depth = np.maximum(np.asarray(displacement, dtype=np.float64), 0.0)
        d = np.minimum(depth, R)
        segment = np.arccos(1 - d / R) * R**2 - (R - d) * np.sqrt(2 * R * d - d**2)
        # Past the half circle the swept strip is as wide as the diameter: Eq. 5's (d - R) 2R Z.
        return (segment + (depth - d) * 2 * R) * thickness

    def surface(self) -> np.ndarray:
        """Return the radius [m], in one row."""
        return np.array([[self.radius, 0.0, 0.0]])

    @staticmethod
    @ti.func
    def distance(surface: ti.template(), b, rows, point):
        """Signed distance [m] to the circle, which rests on the origin, and the normal."""
        radius = surface[b, 0].x
        away = point - vec2(0.0, radius)
        length = away.norm()
        normal = vec2(0.0, -1.0)
        if length > 0.0:
            normal = away / length
        return vec3(length - radius, normal.x, normal.y)
