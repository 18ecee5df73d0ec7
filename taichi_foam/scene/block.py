"""The foam block: its size and outline, its lattice, its density and layers."""

from __future__ import annotations

import math
from collections.abc import Mapping
from itertools import pairwise
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from taichi_foam.errors import note
from taichi_foam.laws.bond import FOAMS, BondFoam
from taichi_foam.parts import Corner, Part, choice, completed, is_number, quantity
from taichi_foam.scene import outlines

MAX_NODES = 4_000_000
MOST_CORNERS = 2000
MOST_LAYERS = 100
MOST_HOLES = 1000

CELLS_IN_HEIGHT, CELLS_IN_WIDTH = 20, 10
"""Fewest square cells in the height and in the width, unless a scene gives their number or size."""

SQUARE = "for square cells"
"""Text in place of a default for the numbers of columns and rows."""

OBLONG = 1.25
"""Aspect ratio of cells above which `advice` warns."""

_Outline = Annotated[tuple[Corner, ...], Field(strict=False, max_length=MOST_CORNERS)]
_Hole = Annotated[tuple[Corner, ...], Field(strict=False, min_length=3, max_length=MOST_CORNERS)]

_FOAM = "none, a table like [foam], a name in the library, or a file"
"""How another foam than that of [foam] may be given."""

_CORNERS_FIX = "lengths are in metres, x from mid-width, y up from the bottom"


def _mass_points(default: int, where: str) -> Any:
    """A field for a number of mass points."""
    return quantity(
        default,
        "count",
        f"number of mass points {where}",
        at_least=2,
        at_most=MAX_NODES // 2,
        fix="use larger cells (block.cell); the paper has 40 by 20",
        unless=SQUARE,
    )


class Layer(Part):
    """A horizontal layer of the block, with a foam or a density of its own."""

    bottom: float = quantity(..., "m", "height of the layer's lower face above the block's bottom",
                             at_least=0, below=5)  # fmt: skip
    top: float = quantity(
        ..., "m", "height of the layer's upper face above the block's bottom", above=0, at_most=5
    )
    foam: Annotated[BondFoam, FOAMS] | None = Field(
        default=None,
        description="its foam, given as in [foam]; none: that of [foam]",
        json_schema_extra={"allowed": _FOAM},
    )
    density: float | None = quantity(
        None,
        "kg/m3",
        "density of its foam; none: block.density",
        at_least=1,
        at_most=5000,
    )
    interface: Literal["bonded", "loose"] = choice(
        "bonded",
        "how it is joined to the foam below and above: bonded: in one piece; loose: only in "
        "contact",
    )


class Across(Part):
    """The foam along x, if the foam of [foam] rises along y and differs across its rise."""

    foam: Annotated[BondFoam, FOAMS] | None = Field(
        default=None,
        description="the foam along x, given as in [foam]; none: it is the same in both directions",
        json_schema_extra={"allowed": _FOAM},
    )


class Block(Part):
    """A block on its lattice of mass points, its density and layers (paper, Table 6, Fig. 14).

    It is a rectangle, or the part of it within an outline with holes.
    """

    width: float = quantity(0.2, "m", "width of the block", at_least=1e-4, at_most=5)
    height: float = quantity(0.1, "m", "height of the block", at_least=1e-4, at_most=5)
    depth: float = quantity(
        0.057,
        "m",
        "depth of the block and of the impactor, perpendicular to the plane",
        at_least=1e-5,
        at_most=5,
        fix="lengths are in metres (57 mm is 0.057)",
    )
    cell: float | None = quantity(
        None,
        "m",
        "edge length of the lattice's cells, rounded so that whole numbers of them fill width "
        f"and height; none: height / {CELLS_IN_HEIGHT} or width / {CELLS_IN_WIDTH}, whichever is "
        "smaller",
        above=0,
        at_most=5,
    )
    columns: int = _mass_points(40, "along the width")
    rows: int = _mass_points(21, "along the height")
    mass_points: Literal["cells", "faces"] = choice(
        "faces",
        "position of the rows of mass points: faces: the first and last rows on the block's "
        "bottom and top, so that the whole height lies between the surfaces that are held and "
        "hit; cells: in the middles of rows of cells, half a cell inside, so that a cushion acts "
        "as if it were one cell thinner",
    )
    density: float = quantity(25.6, "kg/m3", "density of the foam", at_least=1, at_most=5000)
    outline: _Outline = quantity(
        (),
        "m",
        "corners [x, y] of the foam, in order along a simple polygon within the rectangle, "
        "standing on the base at y = 0; none: the whole rectangle",
        allowed=f"a list of 3 to {MOST_CORNERS:,} corners [x, y], each from -5 to 5 m",
        fix=_CORNERS_FIX,
    )
    holes: Annotated[tuple[_Hole, ...], Field(strict=False, max_length=MOST_HOLES)] = quantity(
        (),
        "m",
        "holes through the depth, each a list of corners like the outline",
        allowed=f"up to {MOST_HOLES:,} lists of 3 to {MOST_CORNERS:,} corners [x, y], each from -5 "
        "to 5 m",
        fix=_CORNERS_FIX,
    )
    layers: Annotated[tuple[Layer, ...], Field(strict=False, max_length=MOST_LAYERS)] = Field(
        default=(),
        description="level bands of other foams or densities; elsewhere [foam] and density apply",
        json_schema_extra={"allowed": f"a list of up to {MOST_LAYERS} tables with bottom and top"},
    )
    lattice_angle_deg: float = quantity(
        0.0,
        "deg",
        "rotation of the lattice under the outline, counter-clockwise, about the outline's "
        "middle; width and height are then those of the lattice",
        at_least=-90,
        at_most=90,
    )

    @model_validator(mode="wrap")
    @classmethod
    def _complete(cls, data: Any, handler: Any) -> Block:
        """Add numbers of columns and rows that were not given; record which were."""
        if not isinstance(data, Mapping):
            return handler(data)
        given = _by_todays_names(data)
        return completed(given, _square(given), handler)

    @model_validator(mode="after")
    def _check_size(self) -> Block:
        if self.columns * self.rows > MAX_NODES:
            raise ValueError(
                f"block.columns = {self.columns}, block.rows = {self.rows}: "
                f"{self.columns * self.rows:,} mass points; at most {MAX_NODES:,}; use fewer "
                "columns or rows"
            )
        found = [
            *_problems_of_cell(self),
            *_problems_of_outline(self),
            *_problems_of_layers(self),
        ]
        if found:
            raise ValueError("\n".join(found))
        return self

    @property
    def computed(self) -> frozenset[str]:
        """Which of `columns` and `rows` were not given."""
        return frozenset({"columns", "rows"} - self.model_fields_set)

    @property
    def dx(self) -> float:
        """Width of a cell [m]."""
        return self.width / self.columns

    @property
    def dy(self) -> float:
        """Height of a cell [m]."""
        return self.height / (self.rows - (self.mass_points == "faces"))

    @property
    def foot(self) -> float:
        """Height of the first row of mass points [m]."""
        return 0.0 if self.mass_points == "faces" else 0.5 * self.dy

    @property
    def column_edges(self) -> NDArray[np.float64]:
        """x (columns + 1,) at which columns of cells of the unturned lattice begin and end [m]."""
        return (np.arange(self.columns + 1.0) - self.columns / 2) * self.dx

    @property
    def row_edges(self) -> NDArray[np.float64]:
        """Heights (rows + 1,) at which rows of cells begin and end [m], clipped to the block.

        With mass points on the faces the first and the last row are half as high as the others.
        """
        edges = self.foot - self.dy / 2 + np.arange(self.rows + 1.0) * self.dy
        return np.clip(edges, 0.0, self.height)

    @property
    def node_mass(self) -> float:
        """Mass of a mass point with a whole cell, at the block's density [kg]: rho dX dY Z."""
        return self.density * self.dx * self.dy * self.depth

    @property
    def frame(self) -> tuple[tuple[float, float], ...]:
        """Corners [x, y] of the rectangle of its width and height [m]."""
        half, top = self.width / 2, self.height
        return (-half, 0.0), (half, 0.0), (half, top), (-half, top)

    @property
    def corners(self) -> tuple[tuple[float, float], ...]:
        """Corners [x, y] of the foam's outline [m], those of its frame if none are given."""
        return self.outline or self.frame

    @property
    def is_rectangle(self) -> bool:
        """Whether foam fills every cell of the lattice completely."""
        return not self.outline and not self.holes and self.mass_points == "cells"

    @property
    def positions(self) -> NDArray[Any]:
        """Reference positions of the mass points, (columns, rows, 2) [m]."""
        x = (np.arange(self.columns) - 0.5 * (self.columns - 1)) * self.dx
        y = _in_rows(self) * self.dy
        return self.turned(np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1))

    def turned(self, points: NDArray[Any]) -> NDArray[Any]:
        """Points (..., 2) [m] of the unturned lattice, moved with the turned lattice."""
        if self.lattice_angle_deg == 0:
            return points
        return self._middle + (points - [0.0, self.height / 2]) @ self._turn.T

    def on_lattice(self, points: NDArray[Any]) -> NDArray[Any]:
        """Points (..., 2) [m] in the frame of the unturned lattice: the inverse of `turned`."""
        if self.lattice_angle_deg == 0:
            return points
        return [0.0, self.height / 2] + (points - self._middle) @ self._turn

    @property
    def _turn(self) -> NDArray[np.float64]:
        angle = math.radians(self.lattice_angle_deg)
        c, s = math.cos(angle), math.sin(angle)
        return np.array([[c, -s], [s, c]])

    @property
    def _middle(self) -> NDArray[np.float64]:
        """Middle of the outline's bounding box [m], which is also that of a turned lattice."""
        points = np.array(self.corners)
        return (points.min(axis=0) + points.max(axis=0)) / 2


def advice(block: Block) -> str | None:
    """Advice against cells that are far from square; None: they are nearly square."""
    longer, shorter = max(block.dx, block.dy), min(block.dx, block.dy)
    if longer <= OBLONG * shorter:
        return None
    return (
        f"cells are {1e3 * block.dx:.4g} mm wide and {1e3 * block.dy:.4g} mm high: cells that are "
        "not square crush and crack differently along x and y, and shorten the time step; for "
        f"square cells, give block.cell = {shorter:.4g} instead of block.columns and block.rows"
    )


def todays_key(key: str) -> str:
    """The present name of a dotted key of a scene; prints a note if a former one was given."""
    if key != "block.thickness":
        return key
    note(
        "block.thickness is now block.depth, perpendicular to the plane; the thickness of a "
        "cushion under a drop is block.height"
    )
    return "block.depth"


def _by_todays_names(data: Mapping[str, Any]) -> dict[str, Any]:
    """Raw data of a block under present key names, unless both names of one key are given."""
    if {"thickness", "depth"} <= data.keys():
        return dict(data)
    return {todays_key(f"block.{key}").removeprefix("block."): data[key] for key in data}


def _square(given: Mapping[str, Any]) -> dict[str, int]:
    """Numbers of columns and rows that make cells square, from a block's raw data."""
    known = {key: given.get(key, Block.model_fields[key].default) for key in ("width", "height")}
    known |= {key: given[key] for key in ("cell", "columns", "rows") if given.get(key) is not None}
    if not all(is_number(value) and value > 0 for value in known.values()):
        return {}  # later checks report the error
    width, height = known["width"], known["height"]
    points = given.get("mass_points", Block.model_fields["mass_points"].default)
    more = int(points == "faces")
    if "cell" in known:
        edge = known["cell"]
    elif "columns" in known:
        edge = width / known["columns"]
    elif "rows" in known and known["rows"] > more:
        edge = height / (known["rows"] - more)
    else:
        edge = min(height / CELLS_IN_HEIGHT, width / CELLS_IN_WIDTH)
    return {
        "columns": max(2, round(min(width / edge, MAX_NODES))),
        "rows": max(2, round(min(height / edge, MAX_NODES)) + more),
    }


def _problems_of_cell(block: Block) -> list[str]:
    """Which numbers of cells contradict `block.cell`."""
    if block.cell is None:
        return []
    fit = _square({key: getattr(block, key) for key in ("width", "height", "cell", "mass_points")})
    return [
        f"block.{key} = {getattr(block, key)}: cells of block.cell = {block.cell:g} m make "
        f"{number} {key}; give one of the two"
        for key, number in fit.items()
        if getattr(block, key) != number
    ]


def _in_rows(block: Block) -> NDArray[np.float64]:
    """Heights (J,) of the rows of mass points, in cells."""
    first = 0.0 if block.mass_points == "faces" else 0.5
    return np.arange(block.rows, dtype=np.float64) + first


def _problems_of_outline(block: Block) -> list[str]:
    """Why the outline and the holes are invalid, or do not lie on the lattice."""
    if block.is_rectangle and block.lattice_angle_deg == 0:
        return []
    found = outlines.problems(block.corners, block.holes)
    if found:
        return found
    points = np.array(block.corners)
    least = outlines.TOLERANCE * max(block.width, block.height)
    if abs(points[:, 1].min()) > least:
        return [
            f"block.outline: its lowest corner is at y = {points[:, 1].min():.4g} m; it must be "
            "at 0, where the base is; shift the outline"
        ]
    lying = block.on_lattice(points)
    low, high = lying.min(axis=0), lying.max(axis=0)
    half = block.width / 2
    if (
        low[0] >= -half - least
        and high[0] <= half + least
        and low[1] >= -least
        and high[1] <= block.height + least
    ):
        return []
    if block.lattice_angle_deg == 0:
        return [
            f"block.outline: spans x = {low[0]:.4g} to {high[0]:.4g} m and y = {low[1]:.4g} to "
            f"{high[1]:.4g} m; must be within x = {-half:.4g} to {half:.4g} m and y = 0 to "
            f"{block.height:.4g} m, the block's rectangle; enlarge block.width and block.height, "
            "and columns and rows with them; lengths are in metres"
        ]
    width, height = 2 * np.abs(lying - [0.0, block.height / 2]).max(axis=0)
    return [
        f"block.lattice_angle_deg = {block.lattice_angle_deg:g}: the outline extends beyond the "
        f"rotated lattice, which needs at least block.width = {width:.4g} m and block.height = "
        f"{height:.4g} m; enlarge them, and columns and rows with them"
    ]


def _problems_of_layers(block: Block) -> list[str]:
    """Why the layers do not fit this block."""
    found = []
    least = outlines.TOLERANCE * block.height
    faces = block.mass_points == "faces"
    ordered = sorted(enumerate(block.layers), key=lambda each: each[1].bottom)
    for number, layer in ordered:
        key = f"block.layers[{number}]"
        if layer.top <= layer.bottom:
            found.append(
                f"{key}.top = {layer.top:g}: must be above its bottom at {layer.bottom:g} m; both "
                "are heights above the block's bottom"
            )
        elif layer.top > block.height + least:
            found.append(
                f"{key}.top = {layer.top:g}: above the block; must be at most block.height = "
                f"{block.height:g} m; lengths are in metres"
            )
        elif not np.any(rows_of(block, layer)):
            found.append(
                f"{key}: {layer.bottom:g} to {layer.top:g} m contains no middle of a row of cells, "
                f"which are {block.dy:.4g} m high; set block.rows = "
                f"{math.ceil(block.height / (layer.top - layer.bottom)) + faces} or more"
            )
    for (first, below), (second, above) in pairwise(ordered):
        if above.bottom < below.top - least:
            found.append(
                f"block.layers[{second}].bottom = {above.bottom:g}: lies inside "
                f"block.layers[{first}], which reaches up to {below.top:g} m; layers must not "
                "overlap; raise one or lower the other"
            )
    if block.layers and block.lattice_angle_deg != 0:
        found.append(
            f"block.lattice_angle_deg = {block.lattice_angle_deg:g}: must be 0 with block.layers, "
            "which are rows of the lattice; leave one of the two out"
        )
    return found


def rows_of(block: Block, layer: Layer) -> NDArray[np.bool_]:
    """Which rows (J,) of cells belong to a layer: those whose middles lie in it."""
    middle = _in_rows(block) * block.dy
    least = outlines.TOLERANCE * block.height
    below = (middle < layer.top - least) | (layer.top >= block.height - least)
    return (middle >= layer.bottom - least) & below
