"""Base class of impactors: rigid bodies as thick as the block, guided or free in the plane.

An impactor's outline is relative to a reference point at its mid-width (x = 0) and lowest level
(y = 0) at the start.
"""

import math
from functools import lru_cache
from typing import ClassVar, Literal

import numpy as np
from numpy.typing import ArrayLike
from pydantic import model_validator

from taichi_foam.backend import ti
from taichi_foam.laws.shape import outline as geometry
from taichi_foam.parts import Control, Corner, Part, choice, quantity

SURFACE_ROWS = 1024
"""Most rows of numbers of a surface."""

MOST_CORNERS = SURFACE_ROWS // 2
"""Most corners of an outline."""

vec2 = ti.types.vector(2, ti.f64)
vec3 = ti.types.vector(3, ti.f64)


class Impactor(Part):
    """Fields and measures common to all shapes. A shape's own class adds `shape` and its sizes.

    Its fields must have a hash (tuples, not lists): equal shapes share one outline.

    A shape defines its corners, from which the contact of a convex polygon follows. A curved shape
    also defines its own `surface` and, unless that is a circle, the `distance` that reads it, and
    whatever its corners approximate too roughly.
    """

    label: ClassVar[str]
    """Name for users."""
    controls: ClassVar[tuple[Control, ...]] = ()
    """Sizes that can be changed on a live page."""

    mass: float = quantity(6.0, "kg", "mass", above=0, at_most=1e6)
    velocity: float = quantity(3.03, "m/s", "initial velocity, downwards", at_least=0, at_most=500)
    drop_height: float | None = quantity(
        None,
        "m",
        "height of the fall to first contact, instead of a velocity; gravity is then 9.80665 "
        "m/s2 unless it is given",
        above=0,
        at_most=100,  # beyond that, air resistance matters
        fix="lengths are in metres (760 mm is 0.76); a faster impact is impactor.velocity, in m/s",
    )
    motion: Literal["free", "crosshead"] = choice(
        "free",
        "free: contact forces change its velocity; crosshead: it keeps its velocity, whatever "
        "the force",
    )
    travel: float | None = quantity(
        None,
        "m",
        "distance from the start after which the run ends, instead of numerics.end (motion = "
        "'crosshead' only)",
        above=0,
        at_most=10,
    )
    friction: float = quantity(
        0.13, "-", "friction coefficient between impactor and foam", at_least=0, at_most=5
    )
    x: float = quantity(
        0.0, "m", "offset of its mid-width from that of the block", at_least=-5, at_most=5
    )
    gap: float = quantity(
        0.0,
        "m",
        "clearance above the foam beneath it",
        at_least=0,
        at_most=10,
        fix="below 0 the impactor would start inside the block; "
        "0 is first contact; lengths are in metres",
    )
    rotation_deg: float = quantity(
        0.0,
        "deg",
        "initial rotation, counter-clockwise; impactor.x and impactor.gap then refer to the "
        "mid-width and lowest level of the rotated outline",
        at_least=-180,
        at_most=180,
    )
    guided: bool = choice(
        True,
        "true: guide rails let it move only straight down, without rotation; false: it moves and "
        "rotates freely in the plane",
    )
    spin: float = quantity(
        0.0,
        "rad/s",
        "initial angular velocity, counter-clockwise (guided = false only)",
        at_least=-1000,
        at_most=1000,
    )
    velocity_x: float = quantity(
        0.0,
        "m/s",
        "initial sideways velocity, to the right (guided = false only)",
        at_least=-500,
        at_most=500,
        fix="speeds are in metres per second (3030 mm/s is 3.03)",
    )
    inertia: float | None = quantity(
        None,
        "kg m2",
        "moment of inertia about the centre of mass; none: that of a uniform plate with this "
        "outline and mass, about its centroid (guided = false only)",
        above=0,
        at_most=1e6,
    )
    centre: Corner | None = quantity(
        None,
        "m",
        "centre of mass [x, y] before the rotation by impactor.rotation_deg, in the coordinates "
        "of the shape's corners or, for a shape without corners, relative to its mid-width and "
        "lowest level; none: the centroid of the outline (guided = false only)",
        allowed="none, or two numbers [x, y], each from -5 to 5 m",
    )
    shape: str

    @model_validator(mode="after")
    def _check_rails(self) -> "Impactor":
        if self.guided:
            moves = {"spin": self.spin, "velocity_x": self.velocity_x}
            moves |= {"inertia": self.inertia, "centre": self.centre}
            problems = [
                f"impactor.{key} = {list(value) if isinstance(value, tuple) else f'{value:g}'}: "
                "guide rails only let the impactor move straight down; set impactor.guided = "
                "false, or leave it out"
                for key, value in moves.items()
                if value
            ]
            if problems:
                raise ValueError("\n".join(problems))
        return self

    def corners(self) -> np.ndarray:
        """Return the vertices (n, 2) [m] before any turn, counter-clockwise, in the shape's frame.

        A shape with left-right symmetry must be exactly symmetric.
        """
        raise NotImplementedError

    def origin(self) -> np.ndarray:
        """Return the point (2,) of that frame to which `centre` is relative [m]."""
        return geometry.foot(self.corners())

    def foot(self) -> np.ndarray:
        """Return mid-width and lowest level (2,) of the shape, turned about its frame's origin."""
        return geometry.foot(geometry.rotated(self.corners(), self.rotation_deg))

    def outline(self) -> np.ndarray:
        """Return the vertices (n, 2) [m], counter-clockwise, about mid-width and lowest level.

        The outline is turned by `rotation_deg`. One with left-right symmetry is exactly symmetric.
        The array cannot be written to.
        """
        return _outline(self)  # type: ignore[arg-type]  # pydantic's frozen classes do have a hash

    def outline_at(self, height: float, shift: float = 0.0, angle: float = 0.0) -> np.ndarray:
        """Return the vertices (n, 2) [m] of the moved body.

        Args:
            height, shift: height and horizontal displacement of the reference point, which moves
                with the centre of mass [m].
            angle: rotation of the body since the start, counter-clockwise [rad].
        """
        outline = self.outline()
        if angle != 0.0:
            centre = self.centre_of_mass
            outline = geometry.rotated(outline - centre, math.degrees(angle)) + centre
        return outline + np.array([self.x + shift, height])

    @property
    def centre_of_mass(self) -> np.ndarray:
        """Centre of mass (2,) at the start, relative to mid-width and lowest level [m]."""
        if self.centre is None:
            return geometry.centroid(self.outline())
        given = self.origin() + np.array(self.centre)
        return geometry.rotated(given[None], self.rotation_deg)[0] - self.foot()

    @property
    def squared_gyration(self) -> float:
        """Squared radius of gyration of a uniform plate about its centroid [m2]."""
        return geometry.squared_gyration(self.outline())

    @property
    def moment_of_inertia(self) -> float:
        """Moment of inertia about the centre of mass [kg m2]."""
        return self.mass * self.squared_gyration if self.inertia is None else self.inertia

    @property
    def reach(self) -> float:
        """Distance of the outline's furthest point from the centre of mass [m]."""
        return float(np.hypot(*(self.outline() - self.centre_of_mass).T).max())

    @property
    def box(self) -> tuple[float, float]:
        """Half the width and the height of the outline [m]."""
        outline = self.outline()
        return float(np.abs(outline[:, 0]).max()), float(outline[:, 1].max())

    @property
    def nose_depth(self) -> float:
        """Displacement from first contact to full-width contact [m]; 0 for a flat face."""
        return float(geometry.lower_chain(self.outline())[:, 1].max())

    @property
    def extent(self) -> float:
        """Width of the outline [m]."""
        return float(np.ptp(self.outline()[:, 0]))

    def crushed_volume(self, displacement: ArrayLike, thickness: float) -> np.ndarray:
        """Volume that the impactor has swept below the block's top (paper, Eqs 4-6) [m3].

        Args:
            displacement: from first contact, downwards [m]; any shape. Negative ones count as 0.
            thickness: of the block [m].

        Returns:
            Array of the displacement's shape.
        """
        depth = np.maximum(np.asarray(displacement, dtype=np.float64), 0.0)
        return geometry.swept_area(self.outline(), depth) * thickness

    @property
    def is_circle(self) -> bool:
        """Whether it touches as a circle, see `surface`."""
        return self.distance is Impactor.distance and len(self.surface()) == 1

    def surface(self) -> np.ndarray:
        """Rows of three numbers (n, 3) that `distance` reads, n <= SURFACE_ROWS.

        Here they are the half-planes (n_x, n_y, offset) of a convex polygon, with outward normals:
        a point p relative to the reference point is inside if n . p < offset for all. A single row
        is a circle that rests on the reference point; it begins with the radius.
        """
        outline = self.outline()
        following = np.roll(outline, -1, axis=0)
        along = following - outline
        middle = 0.5 * (following + outline)  # not an end: a mirrored edge starts at its other end
        normals = np.stack([along[:, 1], -along[:, 0]], axis=1)
        normals /= np.hypot(along[:, 0], along[:, 1])[:, None]
        offset = normals[:, 0] * middle[:, 0] + normals[:, 1] * middle[:, 1]
        return np.column_stack([normals, offset])

    @staticmethod
    @ti.func
    def distance(surface: ti.template(), b, rows, point):
        """Signed distance [m] of a point, relative to the reference point, and the normal.

        Returns a vector (distance, n_x, n_y). `surface[b, row]` are the `rows` rows of `surface`.
        A point that is as near to a second edge, such as one under a wedge's tip, has the mean of
        both normals: its length is the slope of the depth along the ridge between both, and the
        mirror image gives the same numbers. Circles are here too, so that the paper's three
        impactors share their kernels.
        """
        found = vec3(-ti.math.inf, 0.0, -1.0)
        for row in range(rows):
            edge = surface[b, row]
            distance = edge.xy.dot(point) - edge.z
            if distance > found[0]:
                found = vec3(distance, edge.x, edge.y)
            elif distance == found[0]:
                found = vec3(distance, 0.5 * (found[1] + edge.x), 0.5 * (found[2] + edge.y))
        if rows == 1:
            radius = surface[b, 0].x
            away = point - vec2(0.0, radius)
            length = away.norm()
            found = vec3(length - radius, 0.0, -1.0)
            if length > 0.0:
                found = vec3(length - radius, away.x / length, away.y / length)
        return found


@lru_cache(maxsize=64)  # most figures of a run ask for it
def _outline(impactor: Impactor) -> np.ndarray:
    turned = geometry.rotated(impactor.corners(), impactor.rotation_deg)
    found = geometry.placed(turned, impactor.foot())
    found.flags.writeable = False
    return found
