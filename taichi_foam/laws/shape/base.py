"""What every impactor is: a rigid body that moves straight down, as thick as the block.

It gives its outline about a reference point at its mid-width (x = 0) and its lowest level (y = 0).
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import taichi as ti
from numpy.typing import ArrayLike

from taichi_foam.laws.shape import outline as geometry
from taichi_foam.parts import Part, quantity

SURFACE_ROWS = 16
"""Rows of numbers that a surface may have."""

vec3 = ti.types.vector(3, ti.f64)


@dataclass(frozen=True)
class Control:
    """A size that a live page offers: its field, what people call it, range and step [shown unit].

    factor  SI units in one shown unit
    """

    field: str
    label: str
    low: float
    high: float
    step: float
    unit: str
    factor: float


class Impactor(Part):
    """Fields and measures that every shape has. A shape's own class adds `shape` and its sizes.

    It gives its outline. The contact of a convex polygon follows from that; a curved one gives its
    own `distance`, with the numbers of `surface`.
    """

    label: ClassVar[str]
    """What people call it."""
    controls: ClassVar[tuple[Control, ...]] = ()
    """Sizes that a live page offers to change."""

    mass: float = quantity(6.0, "kg", "mass", above=0, at_most=1e6)
    velocity: float = quantity(
        3.03, "m/s", "velocity at the start, downwards", at_least=0, at_most=500
    )
    drop_height: float | None = quantity(
        None,
        "m",
        "height of the fall that ends at first contact, in place of a velocity; gravity is then "
        "9.80665 m/s2 unless it is given",
        above=0,
        at_most=1000,
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
    shape: str

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

    @property
    def extent(self) -> float:
        """Width of the outline [m]."""
        return float(np.ptp(self.outline()[:, 0]))

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

    def surface(self) -> np.ndarray:
        """Rows of three numbers (n, 3) that `distance` reads, n <= SURFACE_ROWS.

        Here the outward half-planes (n_x, n_y, offset) of a convex polygon: a point p relative to
        the lowest point lies inside where n . p < offset for all.
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
        """Signed distance [m] of a point relative to the impactor's lowest point, and the normal.

        As a vector (distance, n_x, n_y). `surface[b, row]` are the `rows` rows of `surface`.
        """
        found = vec3(-ti.math.inf, 0.0, -1.0)
        for row in range(rows):
            edge = surface[b, row]
            distance = edge.xy.dot(point) - edge.z
            if distance > found[0]:
                found = vec3(distance, edge.x, edge.y)
        return found
