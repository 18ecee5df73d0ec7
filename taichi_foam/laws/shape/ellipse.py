"""An ellipse as impactor."""

import math
from typing import ClassVar, Literal

import numpy as np

from taichi_foam.backend import ti
from taichi_foam.laws.shape import outline as geometry
from taichi_foam.laws.shape.base import Control, Impactor, vec3
from taichi_foam.parts import quantity

OUTLINE_VERTICES = 128
"""Vertices of the polygon that draws an ellipse; contact uses the ellipse itself."""

MOST_NEWTON = 60
"""Steps in search of the nearest point; near the surface five do."""

vec2 = ti.types.vector(2, ti.f64)


class Ellipse(Impactor):
    """An elliptic cylinder lying across the thickness."""

    shape: Literal["ellipse"] = "ellipse"
    label: ClassVar[str] = "ellipse"
    controls: ClassVar[tuple[Control, ...]] = (
        Control("width", "width", 10, 150, 1, "mm", 1e-3),
        Control("height", "height", 10, 150, 1, "mm", 1e-3),
    )
    width: float = quantity(0.05, "m", "width before any turn", at_least=1e-4, at_most=5)
    height: float = quantity(0.03, "m", "height before any turn", at_least=1e-4, at_most=5)

    def corners(self) -> np.ndarray:
        """Return a polygon on the ellipse, about its middle [m], for drawing."""
        quarter = OUTLINE_VERTICES // 4
        angle = np.arange(1, quarter) * (math.pi / 2 / quarter)
        a, b = self.width / 2, self.height / 2
        x, y = a * np.sin(angle), b * np.cos(angle)
        below, beside = np.column_stack([x, -y]), np.column_stack([x, y])[::-1]
        right = np.vstack([[[0.0, -b]], below, [[a, 0.0]], beside])
        return np.vstack([right, -right])

    def foot(self) -> np.ndarray:
        """Return the lowest level (0, y) of the turned ellipse [m]; see the base class."""
        return np.array([0.0, -self._turned_half[1]])

    @property
    def _turned_half(self) -> tuple[float, float]:
        """Half the width and half the height of the turned ellipse [m]."""
        axes = np.array([[self.width / 2, 0.0], [0.0, self.height / 2]])
        turned = geometry.rotated(axes, self.rotation_deg)
        return math.hypot(*turned[:, 0]), math.hypot(*turned[:, 1])

    @property
    def box(self) -> tuple[float, float]:
        """Half the width and the height of the turned ellipse [m]."""
        across, up = self._turned_half
        return across, 2 * up

    @property
    def squared_gyration(self) -> float:
        """That of an elliptic plate [m2]; see the base class."""
        return (self.width**2 + self.height**2) / 16

    def surface(self) -> np.ndarray:
        """Return the semi-axes, the direction of the first, and the height of the middle [m]."""
        (direction,) = geometry.rotated(np.array([[1.0, 0.0]]), self.rotation_deg)
        middle = self._turned_half[1]
        return np.array([[self.width / 2, self.height / 2, middle], [*direction, 0.0]])

    @staticmethod
    @ti.func
    def distance(surface: ti.template(), b, rows, point):
        """Signed distance [m] to the ellipse, and the normal at its nearest point.

        The foot of the perpendicular by Newton's method on its multiplier, which comes from one
        side without overshooting (Eberly 2013, Distance from a point to an ellipse).
        """
        size, axis = surface[b, 0], surface[b, 1].xy
        away = point - vec2(0.0, size.z)
        across = vec2(axis.x * away.x + axis.y * away.y, axis.x * away.y - axis.y * away.x)
        long, short = ti.max(size.x, size.y), ti.min(size.x, size.y)
        turned = size.y > size.x
        x, y = ti.abs(across.x), ti.abs(across.y)
        near = vec2(ti.select(turned, y, x), ti.select(turned, x, y))
        foot = vec2(0.0, short)  # in the quadrant x, y >= 0, the longer axis along x
        if near.y > 0.0:
            # of (long x / (t + long^2))^2 + (short y / (t + short^2))^2 = 1, by s = t / short^2 + 1
            ratio = (long / short) ** 2
            u, w = long * near.x / short**2, near.y / short
            s = w
            for _ in range(MOST_NEWTON):
                p, q = u / (s + ratio - 1.0), w / s
                residual = p * p + q * q - 1.0
                slope = 2.0 * (p * p / (s + ratio - 1.0) + q * q / s)
                following = s + residual / slope
                if following <= s:
                    break
                s = following
            foot = vec2(ratio * near.x / (s + ratio - 1.0), near.y / s)
        else:
            between = long * near.x / (long * long - short * short + 1e-300)
            if between < 1.0:
                foot = vec2(long * between, short * ti.sqrt(1.0 - between * between))
            else:
                foot = vec2(long, 0.0)
        normal = vec2(foot.x / (long * long), foot.y / (short * short)).normalized()
        distance = normal.dot(near - foot)
        x, y = ti.select(turned, normal.y, normal.x), ti.select(turned, normal.x, normal.y)
        x, y = ti.select(across.x < 0.0, -x, x), ti.select(across.y < 0.0, -y, y)
        return vec3(distance, axis.x * x - axis.y * y, axis.x * y + axis.y * x)
