"""Any convex polygon as impactor."""

from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field, model_validator

from taichi_foam.laws.shape import outline as geometry
from taichi_foam.laws.shape.base import Impactor
from taichi_foam.parts import quantity

MOST_VERTICES = 16

_Coordinate = Annotated[float, Field(ge=-2, le=2)]
_Corner = Annotated[tuple[_Coordinate, _Coordinate], Field(strict=False)]


class Polygon(Impactor):
    """Any convex polygon, turned by any angle."""

    shape: Literal["polygon"] = "polygon"
    label: ClassVar[str] = "polygon"
    vertices: Annotated[
        tuple[_Corner, ...],
        Field(strict=False, min_length=3, max_length=MOST_VERTICES),
    ] = quantity(
        ...,
        "m",
        "corners (x, y), in any order and about any origin",
        allowed=f"3 to {MOST_VERTICES} corners [x, y], each from -2 to 2 m",
        fix="lengths are in metres; a square of 50 mm is [[0, 0], [0.05, 0], "
        "[0.05, 0.05], [0, 0.05]]",
    )

    @model_validator(mode="after")
    def _check_convex(self) -> "Polygon":
        points = geometry.checked(self.vertices)
        least = geometry.TOLERANCE * geometry.size(points)
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
                    "outline; the polygon must be convex; move it outwards, or take "
                    "impactor.shape = 'outline' with the corners in order"
                )
        return self

    @property
    def width(self) -> float:
        """Width of the turned polygon [m]."""
        return float(np.ptp(self.outline()[:, 0]))

    def corners(self) -> np.ndarray:
        """Return the corners as given [m], counter-clockwise; see the base class."""
        return geometry.convex_hull(np.array(self.vertices))

    def origin(self) -> np.ndarray:
        """Return the origin of the given corners."""
        return np.zeros(2)
