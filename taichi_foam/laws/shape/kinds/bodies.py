"""Bodies described by their sizes: the paper's three shapes, the ellipse, the I-shape."""

import math
from typing import ClassVar, Literal

import numpy as np
from numpy.typing import ArrayLike
from pydantic import model_validator

from taichi_foam.backend import ti
from taichi_foam.laws.shape import outline as geometry
from taichi_foam.laws.shape.base import Impactor, vec3
from taichi_foam.laws.shape.edges import Edged
from taichi_foam.parts import Control, quantity

CYLINDER_VERTICES = 64
"""Vertices of the polygon that draws a cylinder; contact uses the circle itself."""

ELLIPSE_VERTICES = 128
"""Vertices of the polygon that draws an ellipse; contact uses the ellipse itself."""

MOST_NEWTON = 60
"""Most steps in the search for the nearest point; near the surface five suffice."""

vec2 = ti.types.vector(2, ti.f64)


class FlatBlock(Impactor):
    """A rectangular block, face down or tilted (paper, Fig. 4a)."""

    shape: Literal["flat"] = "flat"
    label: ClassVar[str] = "flat block"
    controls: ClassVar[tuple[Control, ...]] = (Control("width", "width", 10, 150, 1, "mm", 1e-3),)
    width: float = quantity(
        0.05, "m", "width of the face, before any rotation", at_least=1e-4, at_most=5
    )
    height: float = quantity(0.10, "m", "height", at_least=1e-4, at_most=5)

    def corners(self) -> np.ndarray:
        """Return the four vertices about the middle [m]; see the base class."""
        x, y = self.width / 2, self.height / 2
        return np.array([[-x, -y], [x, -y], [x, y], [-x, y]])


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
        half = CYLINDER_VERTICES // 2
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
        """Squared radius of gyration of a disc [m2]; see the base class."""
        return self.radius**2 / 2

    @property
    def nose_depth(self) -> float:
        """Radius [m]."""
        return self.radius

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


class Wedge(Impactor):
    """A symmetric wedge tip below a straight shank (paper, Fig. 4c)."""

    shape: Literal["wedge"] = "wedge"
    label: ClassVar[str] = "wedge"
    controls: ClassVar[tuple[Control, ...]] = (Control("angle_deg", "angle", 30, 160, 1, "°", 1.0),)
    angle_deg: float = quantity(
        90.0,
        "deg",
        "angle between the two faces",
        at_least=10,
        at_most=170,
        fix="angles are in degrees, between the two faces (the paper's wedge is 90)",
    )
    shank_width: float = quantity(0.05, "m", "width of the shank", at_least=1e-4, at_most=5)
    height: float = quantity(0.20, "m", "height from tip to top", at_least=1e-4, at_most=5)

    @model_validator(mode="after")
    def _check_height(self) -> "Wedge":
        if self.height <= self.tip_depth:
            raise ValueError(
                f"impactor.height = {self.height:g}: must be above {self.tip_depth:.4g} m, the "
                f"depth of a tip of {self.angle_deg:g} degrees and {self.shank_width:g} m width; "
                "increase it, or use a larger impactor.angle_deg"
            )
        return self

    @property
    def tip_depth(self) -> float:
        """Depth of the tip [m]: half the width over the tangent of half the angle."""
        # tan(45 degrees) falls one bit short of 1 in floating point; the paper's tip is W/2 deep.
        slope = 1.0 if self.angle_deg == 90 else math.tan(math.radians(self.angle_deg / 2))
        return self.shank_width / 2 / slope

    def corners(self) -> np.ndarray:
        """Return the five vertices [m], tip first; see the base class."""
        x, shoulder, top = self.shank_width / 2, self.tip_depth, self.height
        return np.array([[0.0, 0.0], [x, shoulder], [x, top], [-x, top], [-x, shoulder]])


class Ellipse(Impactor):
    """An elliptic cylinder lying across the thickness."""

    shape: Literal["ellipse"] = "ellipse"
    label: ClassVar[str] = "ellipse"
    controls: ClassVar[tuple[Control, ...]] = (
        Control("width", "width", 10, 150, 1, "mm", 1e-3),
        Control("height", "height", 10, 150, 1, "mm", 1e-3),
    )
    width: float = quantity(0.05, "m", "width before any rotation", at_least=1e-4, at_most=5)
    height: float = quantity(0.03, "m", "height before any rotation", at_least=1e-4, at_most=5)

    def corners(self) -> np.ndarray:
        """Return a polygon on the ellipse, about its middle [m], for drawing."""
        quarter = ELLIPSE_VERTICES // 4
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
        """Squared radius of gyration of an elliptic plate [m2]; see the base class."""
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

        The foot of the perpendicular follows from its Lagrange multiplier by Newton's method, which
        converges from one side (Eberly 2013, Distance from a point to an ellipse).
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
            # (long x / (t + long^2))^2 + (short y / (t + short^2))^2 = 1, with s = t / short^2 + 1
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


class IShape(Edged):
    """Two flanges, horizontal before any turn, joined by a web at their middles."""

    shape: Literal["i-shape"] = "i-shape"
    label: ClassVar[str] = "I-shape"
    controls: ClassVar[tuple[Control, ...]] = (Control("width", "width", 10, 150, 1, "mm", 1e-3),)
    width: float = quantity(0.05, "m", "width of the flanges", at_least=1e-4, at_most=5)
    height: float = quantity(0.10, "m", "height over both flanges", at_least=1e-4, at_most=5)
    flange: float = quantity(0.01, "m", "thickness of a flange", at_least=1e-5, at_most=5)
    web: float = quantity(0.008, "m", "thickness of the web", at_least=1e-5, at_most=5)

    @model_validator(mode="after")
    def _check_web(self) -> "IShape":
        problems = []
        if self.web >= self.width:
            problems.append(
                f"impactor.web = {self.web:g}: must be below impactor.width = {self.width:g} m, "
                "the width of the flanges; use shape = 'flat' for a plain block"
            )
        if 2 * self.flange >= self.height:
            problems.append(
                f"impactor.flange = {self.flange:g}: the two flanges together must be below "
                f"impactor.height = {self.height:g} m; make them thinner"
            )
        if problems:
            raise ValueError("\n".join(problems))
        return self

    def corners(self) -> np.ndarray:
        """Return the twelve vertices about the middle [m]; see the base class."""
        x, y = self.width / 2, self.height / 2
        inner, under = self.web / 2, y - self.flange
        right = [[x, -y], [x, -under], [inner, -under], [inner, under], [x, under], [x, y]]
        left = [[-across, up] for across, up in right[::-1]]
        return np.array(right + left)
