"""Impactors given by their corners: a convex polygon, and any simple outline."""

from collections.abc import Callable, Sequence
from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field, model_validator

from taichi_foam.laws.shape import outline as geometry
from taichi_foam.laws.shape.base import MOST_CORNERS, Impactor
from taichi_foam.laws.shape.edges import Edged, counter_clockwise
from taichi_foam.parts import Corner, quantity

MOST_VERTICES = 16

Corners = Sequence[tuple[float, float]]

_Within2 = Annotated[float, Field(ge=-2, le=2)]
_Near = Annotated[tuple[_Within2, _Within2], Field(strict=False)]


class Polygon(Impactor):
    """Any convex polygon, turned by any angle."""

    shape: Literal["polygon"] = "polygon"
    label: ClassVar[str] = "polygon"
    vertices: Annotated[
        tuple[_Near, ...],
        Field(strict=False, min_length=3, max_length=MOST_VERTICES),
    ] = quantity(
        ...,
        "m",
        "corners (x, y), in any order and relative to any origin",
        allowed=f"3 to {MOST_VERTICES} corners [x, y], each from -2 to 2 m",
        fix="lengths are in metres; a square of 50 mm is [[0, 0], [0.05, 0], "
        "[0.05, 0.05], [0, 0.05]]",
    )

    @model_validator(mode="after")
    def _check_convex(self) -> "Polygon":
        _check_size(self.vertices, geometry.problems_of_corners)
        points = np.array(self.vertices)
        least = geometry.TOLERANCE * geometry.size(points)
        hull = geometry.convex_hull(points)
        for k, vertex in enumerate(points):
            if geometry.distance_inside(hull, vertex) > least:
                raise ValueError(
                    f"impactor.vertices[{k}] = {list(self.vertices[k])}: lies inside the others' "
                    "outline; the polygon must be convex; move it outwards, or use impactor.shape "
                    "= 'outline' with the corners in order"
                )
        return self

    def corners(self) -> np.ndarray:
        """Return the corners as given [m], counter-clockwise; see the base class."""
        return geometry.convex_hull(np.array(self.vertices))

    def origin(self) -> np.ndarray:
        """Return the origin of the given corners."""
        return np.zeros(2)


class Outline(Edged):
    """Any outline that does not cross itself, such as that of a product from a drawing."""

    shape: Literal["outline"] = "outline"
    label: ClassVar[str] = "outline"
    vertices: Annotated[
        tuple[Corner, ...],
        Field(strict=False, min_length=3, max_length=MOST_CORNERS),
    ] = quantity(
        ...,
        "m",
        "corners (x, y) in order along the outline, in either direction, relative to any origin; "
        "instead of them, `file` may name a CSV file with a column for x and one for y, and "
        "their unit in the header",
        allowed=f"3 to {MOST_CORNERS} corners [x, y], each from -5 to 5 m",
        fix="lengths are in metres; a square of 50 mm is [[0, 0], [0.05, 0], "
        "[0.05, 0.05], [0, 0.05]]",
    )

    @model_validator(mode="after")
    def _check_simple(self) -> "Outline":
        _check_size(self.vertices, geometry.problems_of_ring)
        return self

    def corners(self) -> np.ndarray:
        """Return the corners as given [m], counter-clockwise; see the base class."""
        return counter_clockwise(np.array(self.vertices))

    def origin(self) -> np.ndarray:
        """Return the origin of the given corners."""
        return np.zeros(2)


def _check_size(vertices: Corners, problems: Callable[[str, Corners], list[str]]) -> None:
    """Raises ValueError: the outline is too small, or has one of the `problems`."""
    extent = geometry.size(np.array(vertices))
    if extent < 1e-4:
        raise ValueError(
            f"impactor.vertices: {extent:g} m across; must be at least 0.0001 m; "
            "lengths are in metres"
        )
    if found := problems("impactor.vertices", vertices):
        raise ValueError(found[0])
