"""The one renderer: a snapshot of a lattice becomes an RGB picture.

Cells are deformed quadrilaterals in the colour of their worst compressive strain, with a grid
line along every side and a dark line along the sides that face a crack or the outside. Nothing
here needs a display or a graphics device.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from taichi_foam.crush import worst_strain
from taichi_foam.errors import UserError
from taichi_foam.picture import annotate, cells, colours
from taichi_foam.picture.paint import FINE, paint
from taichi_foam.picture.view import Box, View, Window, fit, window

if TYPE_CHECKING:
    from taichi_foam.result import Snapshot
    from taichi_foam.scene import Scene

Image8 = NDArray[np.uint8]

#: Widths of grid and crack lines on a picture of 720 rows [pixels].
GRID_LINE, CRACK_LINE = 1.0, 1.5
#: Grid lines fade out between these cell sizes [pixels].
GRID_NONE, GRID_FULL = 3.0, 9.0
SMALLEST = (64, 64)
#: Below this size there is no room for words beside the field.
SMALLEST_WITH_TEXT = (320, 180)


def frame(
    snapshot: Snapshot,
    scene: Scene,
    size: tuple[int, int] = (1280, 720),
    *,
    title: str | None = None,
    displacement: float | None = None,
    world: Window | None = None,
) -> Image8:
    """Draw one instant with title, time, impactor displacement, colour key and scale bar.

    Args:
        snapshot: the instant.
        scene: what was run; block, impactor and start fix the window over a whole run.
        size: width and height [pixels].
        title: text above the picture; default the scene's name.
        displacement: of the impactor from its start, downwards [m]; default from the snapshot.
        world: the part of the world to show; default `view.window(scene)`.

    Returns:
        uint8 (height, width, 3). Below 320 x 180 pixels there is no text.

    Raises:
        UserError: a size below 64 x 64.
    """
    width, height = size
    if width < SMALLEST[0] or height < SMALLEST[1]:
        raise UserError(f"picture size = {width} x {height}: must be at least 64 x 64 pixels")
    layout = _Layout(size)
    page, view = _page(layout.size, world or window(scene), scene.name if title is None else title)
    image, unit = page.copy(), layout.unit
    draw(image, snapshot, scene, view, unit)
    if layout.has_text:
        face = annotate.font(34 * unit, bold=True)
        annotate.write(image, layout.time, f"{1e3 * snapshot.time:.1f} ms", face)
        if scene.impactor is not None:
            if displacement is None:
                start = scene.contact_height + scene.impactor.gap
                displacement = start - snapshot.impactor_y
            # Adding 0 turns -0.00 into 0.00.
            depth = f"{round(1e2 * displacement, 2) + 0.0:.2f} cm"
            for place, word in zip(layout.depth_label, ("impactor", "displacement"), strict=True):
                annotate.write(image, place, word, annotate.font(21 * unit))
            annotate.write(image, layout.depth, depth, face)
    return image


class _Layout:
    """Where the parts of a frame lie [pixels]."""

    def __init__(self, size: tuple[int, int]) -> None:
        width, height = self.size = (int(size[0]), int(size[1]))
        unit = self.unit = min(width / 1280, height / 720)
        self.has_text = width >= SMALLEST_WITH_TEXT[0] and height >= SMALLEST_WITH_TEXT[1]
        margin = round(18 * unit)
        side, head = (round(250 * unit), round(62 * unit)) if self.has_text else (margin, margin)
        self.field = Box(margin, head, width - side, height - margin)
        left, top = width - side + round(22 * unit), head
        self.title = (margin + 2 * unit, 42 * unit)
        self.time_label = (left, top + 18 * unit)
        self.time = (left, top + 54 * unit)
        self.depth_label = ((left, top + 98 * unit), (left, top + 123 * unit))
        self.depth = (left, top + 159 * unit)
        foot = height - margin
        self.key = Box(left, round(top + 200 * unit), width - margin, round(foot - 96 * unit))
        self.bar = (left, foot - 4 * unit)


@lru_cache(maxsize=8)
def _page(size: tuple[int, int], world: Window, title: str) -> tuple[Image8, View]:
    """All of a frame that does not change over a run, read-only, and the view of its field."""
    layout = _Layout(size)
    unit = layout.unit
    image = annotate.blank(*size)
    view = fit(world, layout.field)
    annotate.field(image, view, unit)
    if layout.has_text:
        bold, plain = annotate.font(28 * unit, bold=True), annotate.font(21 * unit)
        room = size[0] - 2 * layout.title[0]
        annotate.write(image, layout.title, annotate.shortened(title, bold, room), bold)
        annotate.write(image, layout.time_label, "time", plain)
        annotate.upright_key(image, layout.key, 21 * unit)
        annotate.scale_bar(image, *layout.bar, view.scale, 170 * unit, 21 * unit)
    image.setflags(write=False)
    return image, view


def draw(image: Image8, snapshot: Snapshot, scene: Scene, view: View, unit: float = 1.0) -> None:
    """Draw cells and impactor over `image` (h, w, 3) within the view's box, in place.

    `unit` is the width of a thin line in pixels; each pixel is the mean of 2 x 2 samples.
    """
    block = scene.block
    broken_a, broken_b = snapshot.broken_a, snapshot.broken_b
    shapes = cells.corners(
        snapshot.position,
        snapshot.e_min_a,
        snapshot.e_min_b,
        broken_a,
        broken_b,
        block.dx,
        block.dy,
    )
    level = colours.strain_levels(worst_strain(snapshot.e_min_a, snapshot.e_min_b))
    sides = cells.open_sides(broken_a, broken_b)
    smallest = view.scale * min(block.dx, block.dy)
    strength = float(np.clip((smallest - GRID_NONE) / (GRID_FULL - GRID_NONE), 0, 1))
    outer = np.empty((0, 2))
    if scene.impactor is not None and math.isfinite(snapshot.impactor_y):
        outer = scene.impactor.outline() + np.array([scene.impactor.x, snapshot.impactor_y])
    paint(
        image,
        view,
        shapes.reshape(-1, 4, 2),
        fill=colours.packed_strain_map()[level].ravel(),
        edge=colours.grid_line_map(round(strength, 2))[level].ravel(),
        sides=sides.ravel(),
        order=_outside_in(*level.shape),
        grid_line=_even(GRID_LINE * unit) if strength > 0 else 0.0,
        crack_line=_even(CRACK_LINE * unit),
        shape=outer,
        shape_line=2.5 * unit,
    )


def _even(width: float) -> float:
    """A line width [pixels] of whole samples: such a line is equally strong wherever it falls.

    The trifle above that settles the case in which both edges fall on samples.
    """
    return (max(1, round(FINE * width)) + 0.02) / FINE


@lru_cache(maxsize=8)
def _outside_in(columns: int, rows: int) -> NDArray[np.int32]:
    """Painter's order by columns from both ends to the middle: the same from left and right."""
    column = np.argsort(-np.abs(2 * np.arange(columns) - (columns - 1)), kind="stable")
    order = (column[:, None] * rows + np.arange(rows)).astype(np.int32).ravel()
    order.setflags(write=False)
    return order
