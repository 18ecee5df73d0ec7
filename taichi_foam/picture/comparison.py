"""Two runs side by side: one clock, one scale, one colour key, and both decelerations."""

from __future__ import annotations

import re
from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from taichi_foam.errors import UserError
from taichi_foam.picture import annotate, inset, montage, raster
from taichi_foam.picture.inset import Curve
from taichi_foam.picture.look import Look
from taichi_foam.picture.modes import Key
from taichi_foam.picture.view import Box, Window, fit, window
from taichi_foam.scene import CHOICE_SETS, Scene

if TYPE_CHECKING:
    from taichi_foam.result import Result, Snapshot

Image8 = NDArray[np.uint8]

#: Instants of a montage.
INSTANTS = 4
#: Words need a picture of at least this share of 1280 x 720.
_LEAST_UNIT = 0.5


@dataclass(frozen=True)
class Pair:
    """Two finished runs to be shown together.

    a, b   left or upper run, right or lower run; each with a snapshot at least
    names  what they are called in the pictures
    shared what both are called, if the names are only what differs

    Raises UserError for a run without snapshots.
    """

    a: Result
    b: Result
    names: tuple[str, str]
    shared: str = ""

    def __post_init__(self) -> None:
        for result, name in zip(self.runs, self.names, strict=True):
            if not result.snapshots:
                raise UserError(f"{name}: the run has no snapshots to show; run it again")

    @classmethod
    def of(cls, a: Result, b: Result, folders: tuple[str, str] = ("first", "second")) -> Pair:
        """Two runs under names that tell them apart: their scenes', what differs, or `folders`."""
        if a.scene.name != b.scene.name:
            return cls(a, b, (a.scene.name, b.scene.name))
        return cls(a, b, told_apart(a.scene, b.scene) or folders, a.scene.name)

    @property
    def runs(self) -> tuple[Result, Result]:
        return self.a, self.b

    @cached_property
    def times(self) -> list[float]:
        """Instants of a film [s]: the finer run's snapshots, then what the other has after them.

        Of two equally fine the longer one's.
        """

        def rank(run: Result) -> tuple[float, float]:
            return run.scene.output.snapshot_interval, -run.snapshots[-1].time

        finer, other = sorted(self.runs, key=rank)
        times = [snapshot.time for snapshot in finer.snapshots]
        return [*times, *(s.time for s in other.snapshots if s.time > times[-1])]

    @cached_property
    def window(self) -> Window:
        """The part of the world that both halves show [m]."""
        return _together(window(self.a.scene), window(self.b.scene))

    @cached_property
    def curves(self) -> list[Curve]:
        """The decelerations of the runs that have an impactor, by name."""
        last = max(self.times[-1], 1e-9)
        return [
            Curve.of(run.history, last, name, second)
            for run, name, second in zip(self.runs, self.names, (False, True), strict=True)
            if run.scene.impactor is not None
        ]

    def key(self, look: Look) -> Key:
        """The key of the first scene, or of the second where that goes further."""
        a, b = (look.shown.key(run.scene) for run in self.runs)
        return b if b.top > a.top else a


def at(snapshots: Sequence[Snapshot], time: float) -> Snapshot:
    """The latest snapshot that is not after `time` [s]; the first one before that."""
    after = bisect_right(snapshots, time * (1 + 1e-9), key=lambda snapshot: snapshot.time)
    return snapshots[max(after - 1, 0)]


def frame(
    pair: Pair, time: float, size: tuple[int, int] = (1280, 720), *, look: Look | None = None
) -> Image8:
    """Draw one instant of both runs, with names, impactor displacements, time, key and curves.

    Args:
        time: of the instant [s]; a run that has ended before stays as it ended.
        size: width and height [pixels].
        look: mode, theme and grid; default those of the first run's scene.

    Returns:
        uint8 (height, width, 3). Below half of 1280 x 720 pixels there is no text.

    Raises:
        UserError: a size below 64 x 64.
    """
    width, height = size
    if width < raster.SMALLEST[0] or height < raster.SMALLEST[1]:
        raise UserError(f"picture size = {width} x {height}: must be at least 64 x 64 pixels")
    look = look or Look.of(pair.a.scene)
    shape = (pair.window.y_max - pair.window.y_min) / (pair.window.x_max - pair.window.x_min)
    tones, layout, key = look.tones, _Layout(size, look.words, shape), pair.key(look)
    image, unit = annotate.blank(width, height, tones.page), layout.unit
    scale = 1.0
    for run, box in zip(pair.runs, layout.fields, strict=True):
        view = fit(pair.window, box)
        scale = view.scale
        annotate.field(image, view, unit, tones)
        raster.draw(image, at(run.snapshots, time), run.scene, view, unit, look, key)
    if not layout.has_text:
        return image
    for k in (0, 1):
        _write_head(image, layout, pair, k, time, look)
    strip = layout.strip
    if pair.curves:
        left = layout.fields[0]
        diagram = Box(left.left, strip.top, left.right, strip.bottom)
        shown = [curve.until(time) for curve in pair.curves]
        inset.draw(image, diagram, shown, look.theme, 1.2 * unit)
        strip = Box(layout.fields[1].left, strip.top, strip.right, strip.bottom)
    _write_clock(image, strip, unit, time, scale, look, key)
    return image


def instants(
    pair: Pair,
    *,
    n: int = INSTANTS,
    width: int = montage.WIDTH,
    look: Look | None = None,
) -> Image8:
    """Draw `n` instants of both runs as one picture `width` pixels wide, the first run above.

    Returns uint8 (h, width, 3), h even. Raises UserError for fewer than one instant, and for
    a width that `montage.check_width` refuses.
    """
    montage.check_width(width)
    if n < 1:
        raise UserError(f"montage: n = {n}; must be at least 1")
    look = look or Look.of(pair.a.scene)
    tones, key = look.tones, pair.key(look)
    unit = width / montage.WIDTH
    gap, text = round(montage.GAP * unit), montage.TEXT * unit
    across = (width - gap * (n + 1)) // n
    world = _together(*(window(run.scene, side=0.14, above=0.42) for run in pair.runs))
    high = montage.height_of(across, world, text)
    head, foot = round(1.9 * text), round(montage.FOOT * unit)
    above = 2 * (head + high) + foot
    image = annotate.blank(width, above + above % 2, tones.page)
    shown, scale = np.linspace(pair.times[0], pair.times[-1], n), 1.0
    for k, (run, top) in enumerate(zip(pair.runs, (head, 2 * head + high), strict=True)):
        room = width - 2 * gap
        _write_name(image, (gap + 2, top - 0.55 * text), pair, k, room, 1.0 * text, look)
        for column, time in enumerate(shown):
            left = gap + column * (across + gap)
            box = Box(left, top, left + across, top + high)
            snapshot = at(run.snapshots, float(time))
            scale = montage.panel(image, box, snapshot, run.scene, world, unit, look, key)
    montage.foot_line(image, above, scale, unit, look, key)
    return image


def told_apart(a: Scene, b: Scene) -> tuple[str, str] | None:
    """What tells two scenes of one name apart, in a few words each; None if it takes too many.

    Names of `CHOICE_SETS`, or up to two keys with their values; `output` does not count.
    """
    flat = [_flat(scene.model_dump()) for scene in (a, b)]
    sets = [_choice_set(one) for one in flat]
    if sets[0] and sets[1] and sets[0] != sets[1]:
        return sets[0], sets[1]
    keys = [
        key for key in dict.fromkeys([*flat[0], *flat[1]]) if flat[0].get(key) != flat[1].get(key)
    ]
    if "impactor.shape" in keys:
        keys = ["impactor.shape"]
    if not 1 <= len(keys) <= 2:
        return None
    first, second = (
        ", ".join(f"{key} = {_shown(one.get(key))}{_unit(scene, key)}" for key in keys)
        for one, scene in zip(flat, (a, b), strict=True)
    )
    return first, second


def _flat(table: dict[str, Any], head: str = "") -> dict[str, Any]:
    """The values of nested tables by dotted key, without name and output."""
    found: dict[str, Any] = {}
    for name, value in table.items():
        if head + name in ("name", "output"):
            continue
        if isinstance(value, dict):
            found |= _flat(value, f"{head}{name}.")
        else:
            found[head + name] = value
    return found


def _choice_set(flat: dict[str, Any]) -> str | None:
    for name, choices in CHOICE_SETS.items():
        if all(flat.get(key, value) == value for key, value in choices.items()):
            return name
    return None


def _shown(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, float):
        return f"{value:.6g}"
    return "none" if value is None else str(value)


def _unit(scene: Scene, key: str) -> str:
    """The unit of a scene's key with a space before it, as its description ends with it."""
    owner: Any = scene
    *heads, last = key.split(".")
    for head in heads:
        owner = getattr(owner, head)
    field = type(owner).model_fields.get(last)
    found = re.search(r"\[([^\]]+)\]$", field.description or "") if field else None
    return f" {found[1]}" if found else ""


def _together(a: Window, b: Window) -> Window:
    """The smallest window that holds both."""
    return Window(
        min(a.x_min, b.x_min), max(a.x_max, b.x_max), min(a.y_min, b.y_min), max(a.y_max, b.y_max)
    )


class _Layout:
    """Where the parts of a frame lie [pixels]; with `words`, if they have room.

    `shape` is what the fields show: height over width. What they leave free the diagram takes.
    """

    def __init__(self, size: tuple[int, int], words: bool, shape: float) -> None:
        width, height = size
        unit = self.unit = min(width / 1280, height / 720)
        self.has_text = words and unit >= _LEAST_UNIT - 1e-9
        margin = max(2, round(18 * unit))
        head, foot = (round(80 * unit), round(214 * unit)) if self.has_text else (margin, margin)
        half = (width - 3 * margin) // 2
        tall = min(height - head - foot, round(half * shape))
        gap = round(12 * unit)
        low = foot - gap - margin  # height of the strip below the fields
        if self.has_text:
            low = min(max(low, round(0.6 * half)), height - head - tall - gap - margin)
        # What is still free on an upright page is shared between its top and its foot.
        self.rise = (height - head - tall - gap - low - margin) // 2 if self.has_text else 0
        top = head + self.rise
        self.fields = tuple(
            Box(left, top, left + half, top + tall) for left in (margin, width - margin - half)
        )
        top += tall + gap
        self.strip = Box(margin, top, width - margin, top + low)


def _write_head(
    image: Image8, layout: _Layout, pair: Pair, k: int, time: float, look: Look
) -> None:
    """The name above a field, and below it displacement and, once it is over, the run's end."""
    box, unit, tones, run = layout.fields[k], layout.unit, look.tones, pair.runs[k]
    _write_name(image, (box.left, layout.rise + 36 * unit), pair, k, box.width, 26 * unit, look)
    plain, bold = annotate.font(21 * unit), annotate.font(24 * unit, bold=True)
    foot, last = layout.rise + 68 * unit, run.snapshots[-1].time
    if run.scene.impactor is not None:
        words = "displacement "
        depth = raster.depth_text(raster.sunk(at(run.snapshots, time), run.scene))
        annotate.write(image, (box.left, foot), words, plain, colour=tones.soft_ink)
        start = box.left + plain.getlength(words)
        annotate.write(image, (start, foot), depth, bold, colour=tones.ink)
    if time > last * (1 + 1e-9):
        ended = f"ended at {1e3 * last:.1f} ms"
        annotate.write(image, (box.right, foot), ended, plain, anchor="rs", colour=tones.soft_ink)


def _write_name(
    image: Image8,
    place: tuple[float, float],
    pair: Pair,
    k: int,
    room: float,
    size: float,
    look: Look,
) -> None:
    """A run's name in the colour of its curve, then what both are called, where there is room."""
    bold, plain = annotate.font(size, bold=True), annotate.font(0.8 * size)
    tone = (look.tones.curve, look.tones.other_curve)[k]
    name = annotate.shortened(pair.names[k], bold, room)
    annotate.write(image, place, name, bold, colour=tone)
    start = bold.getlength(name) + 0.7 * size
    if pair.shared and start + plain.getlength(pair.shared) <= room:
        after = (place[0] + start, place[1])
        annotate.write(image, after, pair.shared, plain, colour=look.tones.soft_ink)


def _write_clock(
    image: Image8, box: Box, unit: float, time: float, scale: float, look: Look, key: Key
) -> None:
    """Time and scale bar, and the key below them."""
    ink, plain = look.tones.ink, annotate.font(21 * unit)
    foot = box.top + 58 * unit
    annotate.write(image, (box.left, box.top + 20 * unit), "time", plain, colour=ink)
    big = annotate.font(34 * unit, bold=True)
    annotate.write(image, (box.left, foot), f"{1e3 * time:.1f} ms", big, colour=ink)
    middle = box.left + 0.5 * box.width
    annotate.scale_bar(image, middle, foot, scale, 170 * unit, 21 * unit, look.tones)
    # The last tick's text is centred on the bar's end.
    room = plain.getlength(key.ticks[-1][1]) / 2
    place = Box(
        box.left, round(foot + 40 * unit), round(box.right - room), round(foot + 126 * unit)
    )
    annotate.level_key(image, place, 21 * unit, key, look.tones, under=True)
