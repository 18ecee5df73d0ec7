"""Decelerations so far, of one or a few runs, as a small diagram inside a frame.

The left axis is in m/s², the right one in g.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from taichi_foam.picture import annotate
from taichi_foam.picture.annotate import Image8
from taichi_foam.picture.look import THEMES, Rgb
from taichi_foam.picture.view import Box
from taichi_foam.units import STANDARD_GRAVITY

Array = NDArray[np.float64]

#: Pillow's lines have no smooth edges, so they are drawn this many times larger and averaged.
_FINE = 3
_TITLE = "deceleration (left m/s², right g)"


@dataclass(frozen=True)
class Curve:
    """A deceleration over time, and the axes that it is drawn on.

    time, deceleration  (n,) [s], [m/s2], so far
    last, top           ends of the axes [s], [m/s2]; constant over a film
    name                its label if there are several
    place               index of its run among those shown, from 0; determines its colour
    """

    time: Array
    deceleration: Array
    last: float
    top: float
    name: str = ""
    place: int = 0

    @classmethod
    def of(
        cls,
        history: Mapping[str, Array],
        last: float | None = None,
        name: str = "",
        place: int = 0,
    ) -> Curve:
        """The smoothed deceleration of a run, complete or so far, on axes that just contain it."""
        time, values = history["time_s"], history["deceleration_smoothed_m_s2"]
        top = float(np.nanmax(values, initial=0.0))
        end = last or float(np.max(time, initial=0.0))
        # runs end up to a step after a round time
        ends = _round_up(0.998 * end), _round_up(1.05 * top or 1.0)
        return cls(time, values, *ends, name, place)

    def until(self, time: float) -> Curve:
        """The part up to a time [s], on the same axes."""
        shown = self.time <= time * (1 + 1e-9)
        return replace(self, time=self.time[shown], deceleration=self.deceleration[shown])


def _round_up(value: float) -> float:
    """The smallest round number that is not below `value`."""
    value = max(value, 1e-12)
    power = 10.0 ** np.floor(np.log10(value))
    steps = (1, 1.2, 1.5, 2, 2.5, 3, 4, 5, 6, 8, 10)
    return float(next(s for s in steps if s * power >= value * (1 - 1e-9)) * power)


def draw(image: Image8, box: Box, curves: Sequence[Curve], theme: str, unit: float) -> None:
    """Draw the diagram over `image` (h, w, 3) in `box`, in place; `unit` as in `raster.draw`.

    Several curves share the largest of their axes. The first is drawn on top. Their names are
    written above if there is room.
    """
    last, top = max(curve.last for curve in curves), max(curve.top for curve in curves)
    tones = THEMES[theme].curves
    names = tuple((curve.name, tones[curve.place]) for curve in curves if curve.name)
    panel, plot = _panel(box.width, box.height, last, top, names, theme, unit)
    picture = panel.copy()
    patch = picture[plot.top : plot.bottom, plot.left : plot.right]
    large = Image.fromarray(np.ascontiguousarray(patch)).resize(
        (_FINE * plot.width, _FINE * plot.height), Image.Resampling.NEAREST
    )
    pen = ImageDraw.Draw(large)
    thick = max(_FINE, round(2.2 * unit * _FINE))
    for curve in reversed(curves):
        tone = tones[curve.place]
        points = _points(replace(curve, last=last, top=top), plot)
        if len(points) > 1:
            pen.line(points, fill=tone, width=thick)
        if points:
            (x, y), dot = points[-1], 1.6 * thick
            pen.ellipse((x - dot, y - dot, x + dot, y + dot), fill=tone)
    small = large.resize((plot.width, plot.height), Image.Resampling.BOX)
    picture[plot.top : plot.bottom, plot.left : plot.right] = np.asarray(small)
    image[box.top : box.bottom, box.left : box.right] = picture


def _points(curve: Curve, plot: Box) -> list[tuple[float, float]]:
    """The curve in pixels of the enlarged plot, with about one point per column.

    At this spacing a line needs no round joints, which would cost more than everything else.
    """
    known = np.isfinite(curve.deceleration)
    time, values = curve.time[known], curve.deceleration[known]
    every = max(1, len(time) // plot.width)
    keep = np.r_[0 : len(time) : every, len(time) - 1] if len(time) else slice(0, 0)
    x = _FINE * (plot.width - 1) * time[keep] / curve.last
    y = _FINE * (plot.height - 1) * (1 - np.clip(values[keep] / curve.top, -0.02, 1))
    return list(zip(x.tolist(), y.tolist(), strict=True))


def _names_across(names: Sequence[str], width: int, size: float) -> int:
    """Number of names on a line `width` wide: all, two or one; 0 if there is no room.

    The names of one or two runs are shortened if necessary, as long as they stay distinct. Those of
    more runs can be left out, since a comparison also has them above its fields.
    """
    bold = annotate.font(size, bold=True)
    if len(names) <= 2:
        for across in range(len(names), 0, -1):
            shown = {annotate.shortened(name, bold, width / across - size) for name in names}
            if len(shown) == len(names):
                return across
        return 0
    widest = max(bold.getlength(name) for name in names) + size
    return next((across for across in (len(names), 2) if across * widest <= width), 0)


@lru_cache(maxsize=32)
def _panel(
    width: int,
    height: int,
    last: float,
    top: float,
    names: tuple[tuple[str, Rgb], ...],
    theme: str,
    unit: float,
) -> tuple[Image8, Box]:
    """The diagram without its curves, read-only, and the position of its plot."""
    tones = THEMES[theme]
    panel = annotate.blank(width, height, tones.page)
    size = 16 * unit
    face, bold = annotate.font(size), annotate.font(size, bold=True)
    widest = max(face.getlength(f"{share * top:g}") for share in (0.5, 1.0))
    side = round(widest + 1.1 * size)
    in_g = {share: f"{share * top / STANDARD_GRAVITY:.3g}" for share in (0.5, 1.0)}
    right = width - round(max(map(face.getlength, in_g.values())) + 0.8 * size)
    across = _names_across([name for name, _ in names], right - side, size)
    lines = math.ceil(len(names) / across) if across else 0
    head, foot = round((2.4 + 1.1 * lines) * size), round(1.8 * size)
    plot = Box(side, head, right, height - foot)
    annotate.sheet(panel, Box(0, 0, width, height), unit, tones)
    line = max(1, round(unit))
    title = (0.5 * size, 1.3 * size)
    annotate.write(panel, title, _TITLE, face, colour=tones.ink)
    room = plot.width / max(1, across)
    for k, (name, tone) in enumerate(names if across else ()):
        place = (plot.left + k % across * room, (2.6 + 1.3 * (k // across)) * size)
        annotate.write(panel, place, annotate.shortened(name, bold, room - size), bold, colour=tone)
    for share in (0.0, 0.5, 1.0):
        row = plot.bottom - 1 - round(share * (plot.height - 1))
        tone = tones.ink if share == 0 else tones.frame
        annotate.rectangle(panel, Box(plot.left, row, plot.right, row + line), tone)
        place = (plot.left - 0.4 * size, row)
        annotate.write(panel, place, f"{share * top:g}", face, anchor="rm", colour=tones.ink)
        place = (plot.right + 0.4 * size, row)
        annotate.write(panel, place, in_g.get(share, "0"), face, anchor="lm", colour=tones.ink)
    for share in (0.0, 0.5, 1.0):
        column = plot.left + round(share * (plot.width - 1))
        words = f"{1e3 * share * last:g}" + (" ms" if share == 1 else "")
        anchor = {0.0: "la", 0.5: "ma", 1.0: "ra"}[share]
        place = (column, plot.bottom + 0.35 * size)
        annotate.write(panel, place, words, face, anchor=anchor, colour=tones.ink)
    panel.setflags(write=False)
    return panel, plot
