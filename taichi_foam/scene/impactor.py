"""The rigid impactors: flat block, cylinder, wedge and any convex polygon.

Each moves straight down, is as thick as the block, and gives its outline about a reference point
at its mid-width (x = 0) and its lowest level (y = 0).
"""

from __future__ import annotations

import math
from typing import Annotated, Literal, TypeAlias

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field, model_validator

from taichi_foam.scene import outline as geometry
from taichi_foam.scene.fields import Part, quantity

CYLINDER_VERTICES = 64
"""Vertices of the polygon that draws a cylinder; contact uses the circle itself."""

MAX_VERTICES = 16

_Coordinate = Annotated[float, Field(ge=-2, le=2)]
_Corner = Annotated[tuple[_Coordinate, _Coordinate], Field(strict=False)]


class _Impactor(Part):
    """Fields and measures that every shape has."""

    mass: float = quantity(6.0, "kg", "mass", above=0, at_most=1e6)
    velocity: float = quantity(
        3.03, "m/s", "velocity at the start, downwards", at_least=0, at_most=500
    )
    friction: float = quantity(
        0.22, "-", "friction coefficient between impactor and foam", at_least=0, at_most=5
    )
    x: float = quantity(
        0.0, "m", "offset of the mid-width from that of the block", at_least=-5, at_most=5
    )
    gap: float = quantity(
        0.0,
        "m",
        "clearance above the top row of mass points",
        at_least=0,
        at_most=10,
        fix="below 0 the impactor would start inside the block; "
        "0 is first contact; lengths are in metres",
    )

    def outline(self) -> np.ndarray:
        """Return the vertices (n, 2) [m], counter-clockwise, about mid-width and lowest level.

        An outline with left-right symmetry is symmetric to the last bit.
        """
        raise NotImplementedError

    @property
    def nose_depth(self) -> float:
        """Displacement from first contact at which the full width is in [m]; 0 for a flat face."""
        chain = geometry.lower_chain(self.outline())
        return float(max(chain[0, 1], chain[-1, 1]))

    def crushed_volume(self, displacement: ArrayLike, thickness: float) -> np.ndarray:
        """Volume that the impactor has swept below the block's top (paper, Eqs 4-6) [m3].

        Args:
            displacement: from first contact, downwards [m]; any shape. Below 0 counts as 0.
            thickness: that of the block [m].

        Returns:
            Array of the displacement's shape.
        """
        depth = np.maximum(np.asarray(displacement, dtype=np.float64), 0.0)
        return geometry.swept_area(self.outline(), depth) * thickness


class FlatBlock(_Impactor):
    """A rectangular block, face down or tilted (paper, Fig. 4a)."""

    shape: Literal["flat"] = "flat"
    width: float = quantity(
        0.05, "m", "width of the face, before turning", at_least=1e-4, at_most=5
    )
    height: float = quantity(0.10, "m", "height", at_least=1e-4, at_most=5)
    rotation_deg: float = quantity(
        0.0, "deg", "turn, counter-clockwise", at_least=-180, at_most=180
    )

    def outline(self) -> np.ndarray:
        """Return the four vertices [m]; see the base class."""
        x, y = self.width / 2, self.height / 2
        corners = np.array([[-x, -y], [x, -y], [x, y], [-x, y]])
        return geometry.placed(geometry.rotated(corners, self.rotation_deg))


class Cylinder(_Impactor):
    """A cylinder lying across the thickness (paper, Fig. 4b).

    The paper's text gives a radius of 5 cm; its Eqs 3 and 5 with Tables 3 and 5 need 2.5 cm.
    """

    shape: Literal["cylinder"] = "cylinder"
    radius: float = quantity(
        0.025, "m", "radius", at_least=1e-4, at_most=2, fix="lengths are in metres (25 mm is 0.025)"
    )

    def outline(self) -> np.ndarray:
        """Return a regular polygon on the circle [m], for drawing; see the base class."""
        half = CYLINDER_VERTICES // 2
        angle = np.arange(1, half) * (math.pi / half)
        x, y = self.radius * np.sin(angle), self.radius * (1 - np.cos(angle))
        right, left = np.column_stack([x, y]), np.column_stack([-x, y])[::-1]
        return np.vstack([[[0.0, 0.0]], right, [[0.0, 2 * self.radius]], left])

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


class Wedge(_Impactor):
    """A symmetric wedge tip below a straight shank (paper, Fig. 4c)."""

    shape: Literal["wedge"] = "wedge"
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
    def _check_height(self) -> Wedge:
        if self.height <= self.nose_depth:
            raise ValueError(
                f"impactor.height = {self.height:g}: must be above {self.nose_depth:.4g} m, the "
                f"depth of a tip of {self.angle_deg:g} degrees and {self.shank_width:g} m width; "
                "raise it, or take a larger impactor.angle_deg"
            )
        return self

    @property
    def nose_depth(self) -> float:
        """Depth of the tip [m]: half the width over the tangent of half the angle."""
        # tan(45 degrees) falls one bit short of 1 in floating point; the paper's tip is W/2 deep.
        slope = 1.0 if self.angle_deg == 90 else math.tan(math.radians(self.angle_deg / 2))
        return self.shank_width / 2 / slope

    @property
    def width(self) -> float:
        """Width of the shank [m]."""
        return self.shank_width

    def outline(self) -> np.ndarray:
        """Return the five vertices [m], tip first; see the base class."""
        x, shoulder, top = self.shank_width / 2, self.nose_depth, self.height
        return np.array([[0.0, 0.0], [x, shoulder], [x, top], [-x, top], [-x, shoulder]])


class Polygon(_Impactor):
    """Any convex polygon, turned by any angle."""

    shape: Literal["polygon"] = "polygon"
    vertices: Annotated[
        tuple[_Corner, ...],
        Field(strict=False, min_length=3, max_length=MAX_VERTICES),
    ] = Field(
        description="corners (x, y) [m], in any order and about any origin",
        json_schema_extra={
            "allowed": f"3 to {MAX_VERTICES} corners [x, y], each from -2 to 2 m",
            "fix": "lengths are in metres; a square of 50 mm is [[0, 0], [0.05, 0], "
            "[0.05, 0.05], [0, 0.05]]",
        },
    )
    rotation_deg: float = quantity(
        0.0, "deg", "turn, counter-clockwise", at_least=-180, at_most=180
    )

    @model_validator(mode="after")
    def _check_convex(self) -> Polygon:
        points = np.array(self.vertices)
        extent = geometry.size(points)
        if extent < 1e-4:
            raise ValueError(
                f"impactor.vertices: {extent:g} m across; must be at least 0.0001 m; "
                "lengths are in metres"
            )
        least = geometry.TOLERANCE * extent
        for k, vertex in enumerate(points):
            if np.any(np.linalg.norm(points[:k] - vertex, axis=1) <= least):
                raise ValueError(
                    f"impactor.vertices[{k}] = {list(self.vertices[k])}: repeats an earlier "
                    "corner; each must be given once; leave it out"
                )
        hull = geometry.convex_hull(points)
        if len(hull) < 3:
            raise ValueError(
                "impactor.vertices: all on one line; they must enclose an area; "
                "move one of them off the line"
            )
        for k, vertex in enumerate(points):
            if geometry.distance_inside(hull, vertex) > least:
                raise ValueError(
                    f"impactor.vertices[{k}] = {list(self.vertices[k])}: lies inside the others' "
                    "outline; the polygon must be convex; leave it out or move it outwards"
                )
        return self

    @property
    def width(self) -> float:
        """Width of the turned polygon [m]."""
        return float(np.ptp(self.outline()[:, 0]))

    def outline(self) -> np.ndarray:
        """Return the corners [m], counter-clockwise; see the base class."""
        hull = geometry.convex_hull(np.array(self.vertices))
        return geometry.placed(geometry.rotated(hull, self.rotation_deg))


Impactor: TypeAlias = FlatBlock | Cylinder | Wedge | Polygon
