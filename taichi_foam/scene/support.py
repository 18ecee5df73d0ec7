"""The support beneath the block: a floor, or a rigid body with an outline of its own."""

from __future__ import annotations

import math
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from taichi_foam.laws.shape import outline as geometry
from taichi_foam.laws.shape.base import MOST_CORNERS
from taichi_foam.laws.shape.edges import counter_clockwise
from taichi_foam.parts import Corner, Part, choice, quantity
from taichi_foam.scene import outlines
from taichi_foam.scene.block import Block
from taichi_foam.scene.options import Base

_KEYS = {"floor": (), "ribs": ("pitch", "width", "depth"), "outline": ("outline",)}
"""Keys that each kind of support needs."""

LEAST_OVERLAP = 1e-6
"""Tolerated overlap of an outline with the foam, in areas of a cell: rounding of its corners."""


class Support(Part):
    """The support under the block if base.kind is `floor`; it is rigid and does not move.

    The impactor is stopped at y = 0 whatever the support (base.stops_impactor).
    """

    kind: Literal["floor", "ribs", "outline"] = choice(
        "floor",
        "floor: level, at y = 0; ribs: level tops at y = 0 with gaps between; outline: a "
        "polygon; ribs and outline need base.kind = 'floor', and have its friction; the impactor "
        "is stopped at y = 0 on any of them (base.stops_impactor)",
    )
    pitch: float | None = quantity(
        None,
        "m",
        "distance between the middles of neighbouring ribs (ribs only)",
        above=0,
        at_most=5,
    )
    width: float | None = quantity(
        None, "m", "width of a rib, less than the pitch (ribs only)", above=0, at_most=5
    )
    depth: float | None = quantity(
        None,
        "m",
        "depth of the gaps between ribs, down to their level bottom (ribs only)",
        above=0,
        at_most=5,
    )
    offset: float = quantity(
        0.0, "m", "offset of a rib's middle from x = 0 (ribs only)", at_least=-5, at_most=5
    )
    outline: Annotated[tuple[Corner, ...], Field(strict=False, max_length=MOST_CORNERS)] = quantity(
        (),
        "m",
        "corners [x, y] of the support, in order along a simple polygon, convex or not, that "
        "does not overlap the foam; there is no floor beside it (outline only)",
        allowed=f"a list of 3 to {MOST_CORNERS} corners [x, y], each from -5 to 5 m",
        fix="lengths are in metres, x from mid-width, y up from the block's bottom",
    )

    @model_validator(mode="after")
    def _check_kind(self) -> Support:
        needed = _KEYS[self.kind]
        found = [
            f"support.{key}: missing; support.kind = '{self.kind}' needs it; "
            f"give {' and '.join(f'support.{each}' for each in needed)}"
            for key in needed
            if not getattr(self, key)
        ]
        other = {
            key: kind for kind, keys in {**_KEYS, "ribs": (*_KEYS["ribs"], "offset")}.items()
            for key in keys
        }  # fmt: skip
        found += [
            f"support.{key} = {_shown(getattr(self, key))}: belongs to support.kind = '{kind}', "
            f"but the kind is '{self.kind}'; set the kind, or leave the key out"
            for key, kind in other.items()
            if kind != self.kind and getattr(self, key)
        ]
        if self.pitch is not None and self.width is not None and self.width >= self.pitch:
            found.append(
                f"support.width = {self.width:g}: no gap is left between ribs; must be below "
                f"support.pitch = {self.pitch:g} m; use thinner ribs, or support.kind = 'floor'"
            )
        if self.outline:
            found += geometry.problems_of_ring("support.outline", self.outline)
        if found:
            raise ValueError("\n".join(found))
        return self

    def outline_under(self, block: Block) -> NDArray[np.float64] | None:
        """Corners (n, 2) [m], counter-clockwise, n <= MOST_CORNERS; None: it is a floor.

        An outline that is symmetric about x = 0 is made exactly symmetric. Ribs are one polygon, a
        comb on a plate as thick as the block is high; it extends beyond the block's sides by the
        block's height, or the pitch if that is larger.
        """
        if self.kind == "floor":
            return None
        if self.kind == "outline":
            return geometry.placed(counter_clockwise(np.array(self.outline)), np.zeros(2))
        assert self.depth is not None
        assert self.width is not None
        half = self.width / 2
        middles = self._middles(block)
        foot = -self.depth - block.height
        top = [
            (x, y)
            for middle in middles[::-1]
            for x, y in (
                (middle + half, -self.depth),
                (middle + half, 0.0),
                (middle - half, 0.0),
                (middle - half, -self.depth),
            )
        ][1:-1]  # the plate ends with the outer ribs' flanks
        ends = [(middles[0] - half, foot), (middles[-1] + half, foot)]
        return geometry.placed(np.array([*top, *ends]), np.zeros(2))

    def _middles(self, block: Block) -> NDArray[np.float64]:
        """Middles of the ribs beneath or near the block, from left to right [m]."""
        assert self.pitch is not None
        x = np.array(block.corners)[:, 0]
        reach = max(-x.min(), x.max()) + max(block.height, self.pitch)
        start = math.remainder(self.offset, self.pitch)
        count = math.ceil(reach / self.pitch) + 1
        middles = start + self.pitch * np.arange(-count, count + 1)
        return middles[np.abs(middles) <= reach * (1 + outlines.TOLERANCE)]


def problems(support: Support, base: Base, block: Block) -> list[str]:
    """Why a block cannot stand on a support."""
    corners = support.outline_under(block)
    if corners is None:
        return []
    found = []
    if base.kind != "floor":
        found.append(
            f"support.kind = '{support.kind}': the bottom row is held (base.kind = '{base.kind}') "
            "and rests on nothing; set base.kind = 'floor'"
        )
    if support.kind == "ribs":
        if len(corners) > MOST_CORNERS:
            found.append(
                f"support.pitch = {support.pitch:g}: {len(corners) // 4} ribs near the block; at "
                f"most {MOST_CORNERS // 4}; use a wider pitch"
            )
        if support.width is not None and support.width < block.dx:
            found.append(
                f"support.width = {support.width:g}: ribs thinner than a cell of the lattice, "
                f"{block.dx:.4g} m, pass between mass points; use wider ribs or more block.columns"
            )
    if found:
        return found
    shape = outlines.polygon(corners)
    overlap = shape.intersection(outlines.polygon(block.corners, block.holes))
    if overlap.area > LEAST_OVERLAP * block.dx * block.dy:
        x, y = overlap.representative_point().coords[0]
        return [
            f"support.{'outline' if support.kind == 'outline' else 'kind'}: overlaps the foam, "
            f"near [{x:.4g}, {y:.4g}]; beneath the block its top must be at most at y = 0, or "
            "where block.outline leaves room; move its corners"
        ]
    return []


def _shown(value: object) -> str:
    return f"{value:g}" if isinstance(value, float) else f"{len(value)} corners"  # type: ignore[arg-type]
