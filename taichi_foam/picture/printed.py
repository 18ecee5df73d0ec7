"""Vector figures for print, as wide as a journal's column: a montage, and a run's curves.

Text is 7 to 8 points high and lines are 0.6 to 1 point wide on the page. `style.save` writes a
figure with `look=style.PRINT`, as PDF with embedded fonts, or as SVG.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import matplotlib as mpl
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.figure import Figure
from matplotlib.patches import Polygon
from numpy.typing import NDArray

from taichi_foam.analysis import cell_shapes
from taichi_foam.errors import UserError
from taichi_foam.picture import annotate
from taichi_foam.picture.figures import MOTION, PRESSING, ledger_layers
from taichi_foam.picture.look import Look, Rgb, grid_line_map, shades
from taichi_foam.picture.modes import Key
from taichi_foam.picture.montage import around, choose
from taichi_foam.picture.raster import Shown
from taichi_foam.picture.style import BLUE, INK, PRINT
from taichi_foam.picture.view import Window
from taichi_foam.scene.filling import filling
from taichi_foam.units import STANDARD_GRAVITY

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from taichi_foam.records.snapshot import Snapshot
    from taichi_foam.scene import Scene

Array = NDArray[np.float64]

#: Widths of a journal's columns [mm].
COLUMNS: Mapping[str, float] = {"single": 84.0, "double": 174.0}
#: If a figure has more cells than this, they are drawn as an image inside the vector file.
MOST_VECTORS = 10_000

_INCH = 25.4  # mm
_GAP = 1.5  # between panels [mm]
_RIM = 0.2  # around them all, for the outer half of their frames [mm]
_FOOT = 8.5  # below them, for scale bar and key [mm]
_LINE = 0.6  # points
#: Stroke without which neighbours of one colour would show a bright seam between them [points].
_SEAM = 0.2
#: Cells at least this large [points] have a grid line as their stroke, of this strength.
_GRID_CELL, _GRID_STRENGTH = 1.5, 0.5
#: Pairs of corners of a cell that are its sides.
_SIDES = (
    (cell_shapes.BOTTOM, 0, 1),
    (cell_shapes.RIGHT, 1, 2),
    (cell_shapes.TOP, 2, 3),
    (cell_shapes.LEFT, 3, 0),
)


def montage(
    snapshots: Sequence[Snapshot],
    scene: Scene,
    *,
    column: str = "double",
    n: int = 8,
) -> Figure:
    """Several instants of a run in the mode of its scene, with times, key and scale bar, on white.

    Args:
        snapshots: the run's instants, in order of time.
        scene: the run's scene.
        column: key of COLUMNS.
        n: number of instants, evenly spaced from the first snapshot to the last.

    Raises:
        UserError: unknown column, no snapshots.
    """
    width = column_width(column)
    chosen = choose(snapshots, n=n)
    look = Look(scene.output.mode)
    across = min(len(chosen), 4 if column == "double" else 2)
    down = math.ceil(len(chosen) / across)
    world = around(scene, snapshots)
    wide = (width - 2 * _RIM - _GAP * (across - 1)) / across
    tall = wide * (world.y_max - world.y_min) / (world.x_max - world.x_min)
    # as in the montage for screens: panels neither too flat nor too tall
    tall = float(np.clip(tall, 6.0, 1.5 * wide))
    # the time is written above the block, where the impactor starts
    tall += 0.0 if scene.impactor is not None else 3.5
    height = _RIM + down * (tall + _GAP) + _FOOT
    dense = len(chosen) * scene.block.columns * scene.block.rows > MOST_VECTORS
    with mpl.rc_context(PRINT):
        figure = _blank(width, height)
        scale = 1.0
        for k, snapshot in enumerate(chosen):
            left = _RIM + (k % across) * (wide + _GAP)
            top = height - _RIM - (k // across) * (tall + _GAP)
            axis = _axes(figure, left, top - tall, wide, tall)
            scale = _show(axis, world, wide, tall)
            _draw(axis, snapshot, scene, look, scale, dense)
            time = annotate.time_text(snapshot.time, scene.output.snapshot_interval)
            axis.annotate(
                time, (0, 1), xytext=(3, -3), va="top",
                xycoords="axes fraction", textcoords="offset points",
            )  # fmt: skip
        _scale_bar(figure, scale, 0.22 * width)
        _key(figure, look.shown.key(scene), width)
    return figure


def curves(history: Mapping[str, Array], scene: Scene, *, column: str = "single") -> Figure:
    """Deceleration, velocity, displacement and energies of a run over time.

    The deceleration has a second axis in g; for a crosshead it is replaced by the contact force.

    Args:
        history: columns of `records.history.COLUMNS`.
        scene: the run's scene; without an impactor only the energies are shown.
        column: key of COLUMNS; in a double column the panels are arranged two by two.

    Raises:
        UserError: unknown column, a history without rows or energy.
    """
    width = column_width(column)
    if len(history["time_s"]) < 2:
        raise UserError("curves: the history has fewer than two rows; run the scene for longer")
    names, layers, tones = ledger_layers(history)
    time = 1e3 * history["time_s"]
    motion = MOTION if scene.is_slowed else PRESSING
    shown = motion if scene.impactor is not None else ()
    count = len(shown) + 1
    across = min(count, 2 if column == "double" else 1)
    down = math.ceil(count / across)
    legend_columns = 5 if column == "double" else 2
    legend = 3.5 * math.ceil(len(names) / legend_columns) + 2
    with mpl.rc_context(PRINT):
        figure = _blank(width, 8 + down * (32 if column == "double" else 26) + legend)
        figure.set_layout_engine("constrained", w_pad=0.02, h_pad=0.02, hspace=0.02)
        grid = figure.subplots(down, across, sharex=True, squeeze=False)
        axes = list(grid.ravel())
        for axis, quantity in zip(axes, shown, strict=False):
            label, factor = quantity.axis
            values = factor * history[quantity.name]
            axis.plot(time, values, color=BLUE)
            axis.set_ylabel(label)
            # the filter rings a little at the onset of a deceleration
            if np.nanmin(values) < -0.01 * np.nanmax(values):
                axis.axhline(0, color=INK, linewidth=_LINE)
            else:
                axis.set_ylim(bottom=0)
            if quantity.name == "deceleration_smoothed_m_s2":
                both_ways = (lambda a: a / STANDARD_GRAVITY, lambda in_g: in_g * STANDARD_GRAVITY)
                in_g = axis.secondary_yaxis("right", functions=both_ways)
                in_g.set_ylabel("g")
                in_g.spines["right"].set_visible(True)
        ledger = axes[count - 1]
        patches = ledger.stackplot(time, layers, colors=tones, edgecolor="white", linewidth=0.2)
        ledger.set_ylabel("energy (J)")
        ledger.set_ylim(0, 1.04 * float(np.max(np.sum(layers, axis=0))))
        for axis in axes[count:]:
            axis.remove()
        for axis in grid[-1]:
            axis.set_xlabel("time (ms)")
        ledger.set_xlim(time[0], time[-1])
        for axis, mark in zip(axes[:count], "abcd", strict=False):
            axis.set_title(f"({mark})", pad=2.5)
        figure.align_ylabels(list(grid[:, 0]))
        figure.legend(
            patches, names, loc="outside lower center", ncols=legend_columns, frameon=False,
            handlelength=1.0, handletextpad=0.5, columnspacing=1.2, labelspacing=0.25,
            borderpad=0.1,
        )  # fmt: skip
    return figure


def column_width(column: str) -> float:
    """The width of a column [mm]. Raises UserError for an unknown column."""
    if column not in COLUMNS:
        raise UserError(f"column = {column!r}: must be one of {', '.join(COLUMNS)}")
    return COLUMNS[column]


def _blank(width: float, height: float) -> Figure:
    """An empty figure [mm]; its parts are placed explicitly unless it gets a layout."""
    figure = Figure(figsize=(width / _INCH, height / _INCH))
    FigureCanvasAgg(figure)
    return figure


def _axes(figure: Figure, left: float, bottom: float, wide: float, tall: float) -> Axes:
    """Axes without ticks, positioned from the figure's lower left corner [mm]."""
    width, height = _INCH * figure.get_size_inches()
    axis = figure.add_axes((left / width, bottom / height, wide / width, tall / height))
    axis.set(xticks=[], yticks=[])
    axis.grid(visible=False)
    return axis


def _show(axis: Axes, world: Window, wide: float, tall: float) -> float:
    """Set the limits so that `world` fills a panel [mm] down to its bottom; return mm per m."""
    scale = min(wide / (world.x_max - world.x_min), tall / (world.y_max - world.y_min))
    middle, half = (world.x_min + world.x_max) / 2, wide / (2 * scale)
    axis.set_xlim(middle - half, middle + half)
    axis.set_ylim(world.y_min, world.y_min + tall / scale)
    for spine in axis.spines.values():
        spine.set(visible=True, color="#9A9A98", linewidth=_LINE)
    return scale


def _draw(
    axis: Axes, snapshot: Snapshot, scene: Scene, look: Look, scale: float, dense: bool
) -> None:
    """Draw coloured cells, lines along open sides, support and impactor; `scale` in mm per m."""
    block, key, tones = scene.block, look.shown.key(scene), look.tones
    there, shown = filling(block).there, Shown.of(snapshot, scene, look, key)
    shapes, sides, level = shown.shapes[there], shown.sides[there], shown.level[there]
    faces = shades(key.shades)[level] / 255
    size = scale * min(block.dx, block.dy) * 72 / _INCH  # of a cell in points
    edges = faces
    if size >= _GRID_CELL and not dense:
        grid = grid_line_map(key.shades, _GRID_STRENGTH)[level]
        edges = np.stack([grid >> 16, grid >> 8 & 255, grid & 255], axis=-1) / 255
    support, floor = scene.support.outline_under(block), _tone(tones.floor)
    if support is None:
        axis.axhline(0, color=floor, linewidth=0.8, zorder=1)
    else:
        body = {"facecolor": _tone(tones.frame), "edgecolor": floor, "linewidth": 0.8}
        axis.add_patch(Polygon(support, zorder=1, **body))
    axis.add_collection(
        PolyCollection(
            list(shapes), facecolors=faces, edgecolors=edges,
            linewidths=_SEAM, rasterized=dense, zorder=2,
        ),
        autolim=False,
    )  # fmt: skip
    if block.layers:
        between = shapes[cell_shapes.layer_faces(snapshot, block)[there] > 0][:, 2:]
        axis.add_collection(
            LineCollection(
                list(between), colors=[_tone(tones.soft_ink)], linewidths=_LINE, rasterized=dense,
                zorder=3,
            ),
            autolim=False,
        )  # fmt: skip
    if dense:
        # a loose cell appears as a speck of its colour, which lines around it would hide
        sides = np.where(sides == cell_shapes.ALL_SIDES, 0, sides)
    lines = [shapes[(sides & bit) > 0][:, (start, end)] for bit, start, end in _SIDES]
    axis.add_collection(
        LineCollection(
            list(np.concatenate(lines)), colors=[_tone(tones.crack)],
            linewidths=_LINE / 2 if dense else _LINE,
            capstyle="round", rasterized=dense, zorder=3,
        ),
        autolim=False,
    )  # fmt: skip
    if shown.impactor is not None:
        steel, edge = _tone(tones.steel), _tone(tones.steel_edge)
        axis.add_patch(
            Polygon(shown.impactor, facecolor=steel, edgecolor=edge, linewidth=0.8, zorder=4)
        )


def _tone(colour: Rgb) -> tuple[float, float, float]:
    red, green, blue = colour
    return red / 255, green / 255, blue / 255


def _scale_bar(figure: Figure, scale: float, longest: float) -> None:
    """Draw a bar of a round length, at most `longest` mm, at the lower left."""
    length = annotate.round_length(longest / scale)
    axis = _axes(figure, 0.5, 0.0, longest + 10, _FOOT)
    axis.set(xlim=(0, longest + 10), ylim=(0, _FOOT))
    axis.set_axis_off()
    x, y, tick = [0.0, length * scale], 2.6, 0.7
    axis.plot([x[0], *x, x[1]], [y + tick, y, y, y + tick], color=INK, solid_capstyle="butt",
              solid_joinstyle="miter", clip_on=False)  # fmt: skip
    axis.text(0, y + 1.3, annotate.length_text(length), va="bottom")


def _with_room(key: Key, wide: float) -> list[tuple[float, str]]:
    """The ticks of a key `wide` mm wide that do not overlap the next one kept; the last stays."""
    kept: list[tuple[float, str]] = []
    reach = math.inf
    for value, text in reversed(key.ticks):
        half, place = _width(text) / 2, wide * key.share(value)
        if place + half + 0.6 <= reach:
            kept.append((value, text))
            reach = place - half
    return kept[::-1]


def _width(text: str) -> float:
    """Width of a tick's text on the page [mm]; the shape of letters does not depend on size."""
    return annotate.font(100).getlength(text) / 100 * PRINT["font.size"] * _INCH / 72


def _key(figure: Figure, key: Key, width: float) -> None:
    """Draw the key's bar at the lower right, with its ticks below and its title on the left."""
    wide, tall, right = 0.46 * width, 2.2, 5.5
    axis = _axes(figure, width - right - wide, _FOOT - 1.2 - tall, wide, tall)
    tones = shades(key.shades) / 255
    edges = np.linspace(key.bottom, key.top, len(tones) + 1)
    # each bar extends to the end, under the following ones, so that there are no seams
    bars = [[(start, 0), (key.top, 0), (key.top, 1), (start, 1)] for start in edges[:-1]]
    axis.add_collection(PolyCollection(bars, facecolors=tones, edgecolors="none"), autolim=False)
    axis.set(xlim=(key.bottom, key.top), ylim=(0, 1))
    for spine in axis.spines.values():
        spine.set(visible=True, color=INK, linewidth=_LINE)
    ticks = _with_room(key, wide)
    axis.set_xticks([value for value, _ in ticks], [text for _, text in ticks])
    clear = 72 / _INCH * (_width(ticks[0][1]) / 2 + 0.6)  # of the first tick's text
    axis.annotate(
        " ".join(key.words) if width > COLUMNS["single"] else "\n".join(key.words), (0, 0.5),
        xytext=(-clear, 0), xycoords="axes fraction", textcoords="offset points",
        ha="right", va="center", fontsize=PRINT["axes.labelsize"],
    )  # fmt: skip
