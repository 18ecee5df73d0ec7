"""The renderer: draws a snapshot of a lattice as an RGB picture.

Cells are deformed quadrilaterals, coloured by the quantity shown, with the deformed grid of the
foam and a dark line along sides that face a crack or the outside. No display or graphics device
is needed.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from taichi_foam.analysis import cell_shapes
from taichi_foam.analysis.cell_shapes import along_outline
from taichi_foam.analysis.impact import impactor_now
from taichi_foam.errors import UserError
from taichi_foam.picture import annotate, inset
from taichi_foam.picture.annotate import Image8
from taichi_foam.picture.inset import Curve
from taichi_foam.picture.look import Look, crack_line_map, grid_line_map, levels, packed_shades
from taichi_foam.picture.modes import Key
from taichi_foam.picture.polygons import FINE, GRID_BITS, LAYER_BITS, paint
from taichi_foam.picture.view import Box, View, Window, fit, window
from taichi_foam.scene.filling import filling
from taichi_foam.scene.outlines import Corners

if TYPE_CHECKING:
    from taichi_foam.records.snapshot import Snapshot
    from taichi_foam.scene import Block, Scene

Ints = NDArray[np.int32]

#: Widths of grid and crack lines in a picture with 720 rows [pixels].
GRID_LINE, CRACK_LINE = 1.0, 1.5
#: Smaller cells [pixels] have strokes as lines: lines inside a cell would be thinner than samples.
SMALL_CELL = 5.0
#: Below this size each cell's grid line gets fainter [pixels].
GRID_FULL, GRID_NONE = 9.0, 3.0
#: Small cells share a coarser grid, with lines at least this far apart [pixels].
GRID_APART = 16.0
SMALLEST = (64, 64)
#: Below this size there is no room for text beside the field.
SMALLEST_WITH_TEXT = (512, 288)


def frame(
    snapshot: Snapshot,
    scene: Scene,
    size: tuple[int, int] = (1280, 720),
    *,
    look: Look | None = None,
    title: str | None = None,
    note: str = "",
    displacement: float | None = None,
    world: Window | None = None,
    curve: Curve | None = None,
    threads: int | None = None,
    shown: Shown | None = None,
) -> Image8:
    """Draw one instant with title, time, impactor displacement, colour key and scale bar.

    Args:
        snapshot: the instant.
        scene: the run's scene; block, impactor and start determine the window for the whole run.
        size: width and height [pixels].
        look: mode, theme and grid; default those of the scene.
        title: text above the picture; default the name of the scene.
        note: a few words at the right of the title.
        displacement: downward displacement of the impactor from its start [m]; default from the
            snapshot.
        world: the part of the world to show; default `view.window(scene)`.
        curve: the deceleration so far, drawn into the field's upper left corner.
        threads: CPU threads to draw with; default all. A live view leaves the others to the run.
        shown: result of `Shown.of`, if an instant is drawn at several sizes.

    Returns:
        uint8 (height, width, 3). Below 512 x 288 pixels there is no text.

    Raises:
        UserError: a size below 64 x 64.
    """
    check_size(size)
    look = look or Look.of(scene)
    layout = Layout(size, look.words)
    key = look.shown.key(scene)
    name = scene.name if title is None else title
    world, falls = world or window(scene), scene.impactor is not None
    stands_on = support_of(scene)
    page, view = _page(layout.size, world, name, look, key, bool(note), falls, stands_on)
    image, unit = page.copy(), layout.unit
    draw(image, snapshot, scene, view, unit, look, threads=threads, shown=shown)
    if curve is not None and layout.curve is not None:
        inset.draw(image, layout.curve, [curve], look.theme, unit)
    if layout.has_text:
        ink = look.tones.ink
        face = annotate.font(34 * unit, bold=True)
        time = annotate.time_text(snapshot.time, scene.output.snapshot_interval)
        annotate.write(image, layout.time, time, face, colour=ink)
        if note:
            small = annotate.font(21 * unit)
            annotate.write(image, layout.note, note, small, anchor="rs", colour=look.tones.soft_ink)
        if scene.impactor is not None:
            if displacement is None:
                start = scene.contact_height + scene.impactor.gap
                displacement = start - snapshot.impactor_y
            annotate.write(image, layout.depth, depth_text(displacement), face, colour=ink)
    return image


def support_of(scene: Scene) -> Corners | None:
    """Corners [m] of the support that is drawn instead of the floor; None: draw the floor."""
    outline = scene.support.outline_under(scene.block)
    return None if outline is None else tuple((x, y) for x, y in outline.tolist())


def check_size(size: tuple[int, int]) -> None:
    """Raise UserError for a picture [pixels] that is too small to show anything."""
    width, height = size
    if width < SMALLEST[0] or height < SMALLEST[1]:
        raise UserError(f"picture size = {width} x {height}: must be at least 64 x 64 pixels")


def line_width(width: int, height: int) -> float:
    """Width of a thin line in a picture [pixels], to which text is proportional, too."""
    return min(width / 1280, height / 720)


def depth_text(displacement: float) -> str:
    """A displacement [m], formatted for pictures."""
    # Adding 0 turns -0.00 into 0.00.
    return f"{round(1e2 * displacement, 2) + 0.0:.2f} cm"


class Layout:
    """Positions of the parts of a frame [pixels]; text only with `words`, and if there is room."""

    def __init__(self, size: tuple[int, int], words: bool = True) -> None:
        width, height = self.size = (int(size[0]), int(size[1]))
        unit = self.unit = line_width(width, height)
        self.has_text = words and width >= SMALLEST_WITH_TEXT[0] and height >= SMALLEST_WITH_TEXT[1]
        margin = round(18 * unit) if words else 0
        side, head = (round(250 * unit), round(62 * unit)) if self.has_text else (margin, margin)
        self.field = Box(margin, head, width - side, height - margin)
        left, top = width - side + round(22 * unit), head
        self.title = (margin + 2 * unit, 42 * unit)
        self.note = (width - margin, 42 * unit)
        self.time_label = (left, top + 18 * unit)
        self.time = (left, top + 54 * unit)
        self.depth_label = ((left, top + 98 * unit), (left, top + 123 * unit))
        self.depth = (left, top + 159 * unit)
        foot = height - margin
        self.key = Box(left, round(top + 200 * unit), width - margin, round(foot - 96 * unit))
        self.bar = (left, foot - 4 * unit)
        gap = round(12 * unit)
        corner = Box(margin + gap, head + gap, margin + gap + round(372 * unit),
                     head + gap + round(178 * unit))  # fmt: skip
        fits = self.has_text and corner.right < self.field.right
        self.curve = corner if fits else None


@lru_cache(maxsize=8)
def _page(
    size: tuple[int, int],
    world: Window,
    title: str,
    look: Look,
    key: Key,
    noted: bool,
    falls: bool,
    support: Corners | None,
) -> tuple[Image8, View]:
    """The constant parts of a run's frames, read-only, and the view of the field."""
    layout, tones = Layout(size, look.words), look.tones
    unit = layout.unit
    image = annotate.blank(*size, tones.page)
    view = fit(world, layout.field)
    annotate.field(image, view, unit, tones, support)
    if layout.has_text:
        bold, plain = annotate.font(28 * unit, bold=True), annotate.font(21 * unit)
        room = size[0] * (0.6 if noted else 1.0) - 2 * layout.title[0]
        name = annotate.shortened(title, bold, room)
        annotate.write(image, layout.title, name, bold, colour=tones.ink)
        annotate.write(image, layout.time_label, "time", plain, colour=tones.ink)
        words = ("impactor", "displacement") if falls else ()
        for place, word in zip(layout.depth_label, words, strict=False):
            annotate.write(image, place, word, plain, colour=tones.ink)
        annotate.upright_key(image, layout.key, 21 * unit, key, tones)
        annotate.scale_bar(image, *layout.bar, view.scale, 170 * unit, 21 * unit, tones)
    image.setflags(write=False)
    return image, view


@dataclass(frozen=True)
class Shown:
    """The data of an instant to draw at any position and size.

    shapes, sides  of cells, as returned by `cell_shapes.shapes_of`
    level          index of each cell's colour in the key's map (columns, rows), 0 to 255
    impactor       outline of the impactor (m, 2) [m]; None: there is none
    """

    shapes: NDArray[np.float64]
    sides: Ints
    level: NDArray[np.intp]
    impactor: NDArray[np.float64] | None

    @classmethod
    def of(
        cls, snapshot: Snapshot, scene: Scene, look: Look | None = None, key: Key | None = None
    ) -> Shown:
        """The data of a snapshot; `look` and `key` default to those of the scene."""
        look = look or Look.of(scene)
        key = key or look.shown.key(scene)
        shapes, sides = cell_shapes.shapes_of(snapshot, scene.block)
        level = levels(look.shown.values(snapshot, scene), key.top, key.bottom)
        return cls(shapes, sides, level, impactor_now(snapshot, scene))


def draw(
    image: Image8,
    snapshot: Snapshot,
    scene: Scene,
    view: View,
    unit: float = 1.0,
    look: Look | None = None,
    key: Key | None = None,
    threads: int | None = None,
    shown: Shown | None = None,
) -> None:
    """Draw cells and impactor over `image` (h, w, 3) within the view's box, in place.

    `unit` is the width of a thin line in pixels; each pixel is the mean of 2 x 2 samples. `key`
    defines the colours; default that of the scene. `shown` as for `frame`.
    """
    look = look or Look.of(scene)
    block = scene.block
    key = key or look.shown.key(scene)
    shown = shown or Shown.of(snapshot, scene, look, key)
    shapes, sides, level = shown.shapes, shown.sides.copy(), shown.level
    strokes = np.zeros_like(sides)
    smallest = view.scale * min(block.dx, block.dy)
    strength = float(np.clip((smallest - GRID_NONE) / (GRID_FULL - GRID_NONE), 0, 1))
    small = smallest < SMALL_CELL
    if small:
        strength = 1.0
        # a loose cell appears as a speck of its colour, which lines around it would hide
        strokes = np.where(sides == cell_shapes.ALL_SIDES, 0, sides)
        sides = np.zeros_like(sides)
        if look.grid:
            strokes |= _coarse_grid(*level.shape, GRID_APART / smallest) << GRID_BITS
    # a line inside a cell gets thinner where two sides of the cell are collinear
    rim = along_outline(block)
    strokes[rim] |= sides[rim]
    sides[rim] = 0
    if block.layers:
        strokes |= cell_shapes.layer_faces(snapshot, block) << LAYER_BITS
    maps = (  # columns FILL, EDGE, CRACK, SIDES, STROKES
        packed_shades(key.shades),
        grid_line_map(key.shades, round(strength, 2)),
        crack_line_map(key.shades, look.theme),
    )
    inks = np.stack([*(shades[level] for shades in maps), sides, strokes], axis=-1)
    held, order = _order(block)
    outer = shown.impactor
    paint(
        image,
        view,
        shapes.reshape(-1, 4, 2)[held],
        inks.reshape(-1, len(maps) + 2)[held],
        order,
        grid_line=_even(GRID_LINE * unit) if look.grid and not small else 0.0,
        crack_line=_even(CRACK_LINE * unit),
        shape=np.empty((0, 2)) if outer is None else outer,
        shape_line=2.5 * unit,
        theme=look.tones,
        threads=threads,
    )


def _even(width: float) -> float:
    """A line width [pixels] of a whole number of samples: equally strong at any position.

    The small excess resolves the case in which both edges fall on samples.
    """
    return (max(1, round(FINE * width)) + 0.02) / FINE


@lru_cache(maxsize=8)
def _coarse_grid(columns: int, rows: int, apart: float) -> Ints:
    """Sides of cells on a coarse grid with a spacing of at least `apart` cells, (columns, rows).

    Counted from the middle and drawn by the outer cell: symmetric if the number of columns is even.
    """
    steps = (step * 10**power for power in range(7) for step in (1, 2, 5))
    stride = next(step for step in steps if step >= apart)
    grid = np.zeros((columns, rows), dtype=np.int32)
    middle = columns // 2
    lines = np.flatnonzero((np.arange(columns) - middle) % stride == 0)
    grid[lines[lines >= middle]] |= cell_shapes.LEFT
    grid[lines[(lines > 0) & (lines <= middle)] - 1] |= cell_shapes.RIGHT
    grid[:, np.arange(rows) % stride == 0] |= cell_shapes.BOTTOM
    grid.setflags(write=False)
    return grid


def _order(block: Block) -> tuple[slice | NDArray[np.intp], Ints]:
    """Selection of the cells with foam, from all cells flattened, and their painting order."""
    order = _outside_in(block.columns, block.rows)
    if block.is_rectangle:
        return slice(None), order
    there = filling(block).there.ravel()
    return np.flatnonzero(there), (np.cumsum(there) - 1)[order[there[order]]].astype(np.int32)


@lru_cache(maxsize=8)
def _outside_in(columns: int, rows: int) -> Ints:
    """Painting order by columns from both ends to the middle, so that pictures are symmetric."""
    column = np.argsort(-np.abs(2 * np.arange(columns) - (columns - 1)), kind="stable")
    order = (column[:, None] * rows + np.arange(rows)).astype(np.int32).ravel()
    order.setflags(write=False)
    return order
