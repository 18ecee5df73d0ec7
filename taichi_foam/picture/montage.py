"""A run at a glance: instants side by side with one key and one scale (paper, Figs 22, 24, 26)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from taichi_foam.analysis.impact import impactor_now
from taichi_foam.errors import UserError
from taichi_foam.picture import annotate, raster
from taichi_foam.picture.annotate import Image8
from taichi_foam.picture.look import Look
from taichi_foam.picture.modes import Key
from taichi_foam.picture.view import Box, Window, fit, window
from taichi_foam.scene.filling import filling

if TYPE_CHECKING:
    from taichi_foam.records.snapshot import Snapshot
    from taichi_foam.scene import Scene

#: Width of a montage [pixels]; text is legible at half this width.
WIDTH = 1800
#: Below this width the text does not fit [pixels].
NARROWEST = 640
#: Gap between panels, size of the text, and height of the line below them, at that width [pixels].
GAP, TEXT, FOOT = 14, 30, 90
_NOTE = 0.8  # size of the note's text relative to the rest


def montage(
    snapshots: Sequence[Snapshot],
    scene: Scene,
    *,
    times: Sequence[float] | None = None,
    n: int = 8,
    title: str | None = None,
    note: Sequence[str] = (),
    width: int = WIDTH,
) -> Image8:
    """Draw several instants of a run as one picture, with mode and theme of its scene.

    Args:
        snapshots: the run's instants, in order of time.
        scene: the run's scene.
        times: instants to show [s], each by the snapshot nearest to it; default `n` of them,
            evenly spaced from the first snapshot to the last.
        title: text above the panels; default the name of the scene.
        note: lines of text below them; lines longer than the width are cut.
        width: width of the picture [pixels].

    Returns:
        uint8 (h, width, 3), h even.

    Raises:
        UserError: no snapshots, fewer than one instant, or a width below NARROWEST.
    """
    check_width(width)
    chosen = choose(snapshots, times, n)
    look = Look.of(scene)
    tones = look.tones
    across = _columns(len(chosen))
    down = math.ceil(len(chosen) / across)
    unit = width / WIDTH
    gap, text = round(GAP * unit), TEXT * unit
    world = around(scene, snapshots)
    panel_width = (width - gap * (across + 1)) // across
    panel_height = height_of(panel_width, world, text)
    interval = scene.output.snapshot_interval
    over = strip(Box(0, 0, panel_width, panel_height), chosen, scene, world, text, interval)
    panel_height += over
    head, foot = round(2.1 * text), round(FOOT * unit)
    line = round(1.3 * _NOTE * text)
    above = head + down * (panel_height + gap) + foot
    height = above + len(note) * line + (round(0.5 * line) if note else 0)
    image = annotate.blank(width, height + height % 2, tones.page)
    name = scene.name if title is None else title
    bold = annotate.font(1.15 * text, bold=True)
    name = annotate.shortened(name, bold, width - 2 * gap)
    annotate.write(image, (gap + 2, 1.45 * text), name, bold, colour=tones.ink)
    key, scale = look.shown.key(scene), 1.0
    for k, snapshot in enumerate(chosen):
        left = gap + (k % across) * (panel_width + gap)
        top = head + (k // across) * (panel_height + gap)
        box = Box(left, top, left + panel_width, top + panel_height)
        scale = panel(image, box, snapshot, scene, world, unit, look, key, interval, over)
    foot_line(image, above, scale, unit, look, key)
    small = annotate.font(_NOTE * text)
    for k, words in enumerate(note):
        words = annotate.shortened(words, small, width - 2 * gap)
        annotate.write(image, (gap + 2, above + (k + 0.8) * line), words, small, colour=tones.ink)
    return image


def check_width(width: int) -> None:
    """Raise UserError for a montage [pixels] that is too narrow for its text."""
    if width < NARROWEST:
        raise UserError(
            f"montage: width = {width} pixels; must be at least {NARROWEST}, such as {WIDTH}"
        )


def around(scene: Scene, snapshots: Sequence[Snapshot] = ()) -> Window:
    """The part of the world that panels show: closer around the block than in a film."""
    return window(scene, snapshots, side=0.14, above=0.42)


def height_of(panel_width: int, world: Window, text: float) -> int:
    """Height [pixels] of a panel that shows `world`."""
    height = round(panel_width * (world.y_max - world.y_min) / (world.x_max - world.x_min))
    # A long bar still needs room for its time; a tall column must not fill the page.
    return int(np.clip(height, 3 * text, 1.5 * panel_width))


def strip(
    box: Box,
    snapshots: Sequence[Snapshot],
    scene: Scene,
    world: Window,
    text: float,
    interval: float,
) -> int:
    """Height [pixels] that panels like `box` need above the world to keep the times clear.

    0 if neither foam nor impactor ever reaches the corner in which a time is written.
    """
    view, face = fit(world, box), annotate.font(text, bold=True)
    right = 0.8 * text + max(
        face.getlength(annotate.time_text(s.time, interval)) for s in snapshots
    )
    # the corner in the world, one cell larger for the cells around the mass points
    pad = np.array([scene.block.dx, scene.block.dy])
    rows = np.array([box.top + 1.4 * text, box.top])
    x = (np.array([box.left, box.left + right]) - view.x_zero) / view.scale
    y = (view.y_zero - rows) / view.scale
    low, high = np.array([x[0], y[0]]) - pad, np.array([x[1], y[1]]) + pad
    there = filling(scene.block).there
    for snapshot in snapshots:
        points = snapshot.position[there]
        met = np.any(np.all((points > low) & (points < high), axis=-1))
        outline = impactor_now(snapshot, scene)
        if outline is not None:
            met |= np.all((outline.max(axis=0) > low) & (outline.min(axis=0) < high))
        if met:
            return round(1.6 * text)
    return 0


def panel(
    image: Image8,
    box: Box,
    snapshot: Snapshot,
    scene: Scene,
    world: Window,
    unit: float,
    look: Look,
    key: Key,
    interval: float = 1e-3,
    over: int = 0,
) -> float:
    """Draw one instant with its time into `box`, in place; return its scale [pixels/m].

    `interval` [s] is that of the snapshots; only the time is drawn in the first `over` rows.
    """
    below = Box(box.left, box.top + over, box.right, box.bottom)
    view, text, ink = fit(world, below), TEXT * unit, look.tones.ink
    whole = replace(view, box=box)
    annotate.field(image, whole, unit, look.tones, raster.support_of(scene))
    raster.draw(image, snapshot, scene, view, 0.85 * unit, look, key)
    place, label = (box.left + 0.4 * text, box.top + 1.2 * text), annotate.font(text, bold=True)
    time = annotate.time_text(snapshot.time, interval)
    annotate.write(image, place, time, label, colour=ink)
    return view.scale


def foot_line(image: Image8, bottom: int, scale: float, unit: float, look: Look, key: Key) -> None:
    """Draw scale bar and colour key across the picture, FOOT units high, down to `bottom`."""
    width, gap, text, foot = image.shape[1], round(GAP * unit), TEXT * unit, round(FOOT * unit)
    bar = (gap + 2, bottom - 0.5 * foot + 0.4 * text)
    annotate.scale_bar(image, *bar, scale, 0.16 * width, text, look.tones)
    # the last tick's text is centred on the bar's end
    room = round(max(1.2 * text, annotate.font(text).getlength(key.ticks[-1][1]) / 2))
    box = Box(round(0.3 * width), bottom - foot, width - gap - room, bottom)
    annotate.level_key(image, box, text, key, look.tones)


def choose(
    snapshots: Sequence[Snapshot], times: Sequence[float] | None = None, n: int = 8
) -> list[Snapshot]:
    """The snapshots nearest to `times` [s], or `n` of them evenly spaced over the run."""
    if not snapshots:
        raise UserError("montage: the run has no snapshots to show")
    when = np.array([snapshot.time for snapshot in snapshots])
    if times is None:
        if n < 1:
            raise UserError(f"montage: n = {n}; must be at least 1")
        times = [float(t) for t in np.linspace(when[0], when[-1], n)]
    if not len(times):
        raise UserError("montage: times is empty; give at least one")
    return [snapshots[int(np.argmin(np.abs(when - t)))] for t in times]


def _columns(count: int) -> int:
    """Panels per row: one row up to four, else three or four, whichever leaves fewer empty."""
    if count <= 4:
        return count
    return min((4, 3), key=lambda across: -count % across)
