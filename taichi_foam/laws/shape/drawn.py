"""Any outline as impactor, convex or not, as one draws it."""

from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field, model_validator

from taichi_foam.laws.shape import outline as geometry
from taichi_foam.laws.shape.base import MOST_CORNERS
from taichi_foam.laws.shape.edges import Edged, counter_clockwise
from taichi_foam.parts import quantity

_Coordinate = Annotated[float, Field(ge=-5, le=5)]
_Corner = Annotated[tuple[_Coordinate, _Coordinate], Field(strict=False)]


class Outline(Edged):
    """Any outline that does not cross itself: of a product, out of a drawing."""

    shape: Literal["outline"] = "outline"
    label: ClassVar[str] = "outline"
    vertices: Annotated[
        tuple[_Corner, ...],
        Field(strict=False, min_length=3, max_length=MOST_CORNERS),
    ] = quantity(
        ...,
        "m",
        "corners (x, y) in order along the outline, either way round, about any origin; in their "
        "place `file` names a CSV file with a column of each, their unit in the header",
        allowed=f"3 to {MOST_CORNERS} corners [x, y], each from -5 to 5 m",
        fix="lengths are in metres; a square of 50 mm is [[0, 0], [0.05, 0], "
        "[0.05, 0.05], [0, 0.05]]",
    )

    @model_validator(mode="after")
    def _check_simple(self) -> "Outline":
        import shapely  # takes a while to load, and most scenes do without

        points = geometry.checked(self.vertices)
        if len(geometry.convex_hull(points)) < 3:
            raise ValueError(
                "impactor.vertices: all on one line; they must enclose an area; "
                "move one of them off the line"
            )
        if not shapely.LinearRing(points).is_simple:
            said = (
                str(shapely.is_valid_reason(shapely.Polygon(points))).partition("[")[2].rstrip("]")
            )
            place = ", ".join(f"{float(each):.4g}" for each in said.split())
            raise ValueError(
                f"impactor.vertices: the outline crosses or touches itself near [{place}]; it must "
                "be one simple outline; give its corners in order along it"
            )
        return self

    def corners(self) -> np.ndarray:
        """Return the corners as given [m], counter-clockwise; see the base class."""
        return counter_clockwise(np.array(self.vertices))

    def origin(self) -> np.ndarray:
        """Return the origin of the given corners."""
        return np.zeros(2)
