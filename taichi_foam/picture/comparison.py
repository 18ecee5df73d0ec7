"""Runs side by side: one clock, one scale, one colour key, and all decelerations."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from taichi_foam.errors import UserError
from taichi_foam.picture import annotate, inset, montage, naming, raster
from taichi_foam.picture.annotate import Image8
from taichi_foam.picture.inset import Curve
from taichi_foam.picture.look import Look
from taichi_foam.picture.modes import Key
from taichi_foam.picture.naming import Caption
from taichi_foam.picture.view import Box, Window, fit, window

if TYPE_CHECKING:
    from taichi_foam.records.snapshot import Snapshot
    from taichi_foam.results.result import Result

#: Number of runs that can be shown side by side.
FEWEST, MOST = 2, 4
#: Number of instants of a montage.
INSTANTS = 4
#: Text needs a picture of at least this share of 1280 x 720.
_LEAST_UNIT = 0.5
#: A page wider than this many times its height has no room for the diagram.
_WIDE = 2.5
#: A field narrower than this, in units of a layout, has shorter text above it.
_NARROW = 450


@dataclass(frozen=True)
class Lineup:
    """Two to four finished runs to be shown together.

    runs    from left to right or downwards; each with at least one snapshot. Pictures have size,
            pace, mode and theme of the first one's scene
    names   their names in the pictures
    asides  further text on each, shown if there is room; empty: none

    Raises UserError for fewer or more runs, and for a run without snapshots.
    """

    runs: tuple[Result, ...]
    names: tuple[str, ...]
    asides: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if not FEWEST <= len(self.runs) <= MOST:
            raise UserError(f"runs to compare: {len(self.runs)} given, must be {FEWEST} to {MOST}")
        for result, name in zip(self.runs, self.names, strict=True):
            if not result.snapshots:
                raise UserError(f"{name}: the run has no snapshots to show; run it again")

    @classmethod
    def of(
        cls,
        runs: Sequence[Result],
        folders: Sequence[str] = (),
        captions: Sequence[Caption] | None = None,
    ) -> Lineup:
        """Runs with names that distinguish them: their titles, differing values, or `folders`.

        `captions`, in the order of the runs, give their titles; default their scenes' names.
        """
        folders = folders or [f"run {k + 1}" for k in range(len(runs))]
        found = naming.names([run.scene for run in runs], folders, captions)
        return cls(
            tuple(runs), tuple(name for name, _ in found), tuple(aside for _, aside in found)
        )

    @cached_property
    def times(self) -> list[float]:
        """Instants of a film [s]: the finest run's snapshots, then later ones of other runs.

        Of equally fine runs the longest comes first. Times within a step are the same instant.
        """

        def rank(run: Result) -> tuple[float, float]:
            return run.scene.output.snapshot_interval, -run.snapshots[-1].time

        times: list[float] = []
        for run in sorted(self.runs, key=rank):
            end = times[-1] + self.trifle if times else -math.inf
            times += [s.time for s in run.snapshots if s.time > end]
        return times

    @cached_property
    def interval(self) -> float:
        """The interval between snapshots of the finest run [s]."""
        return min(run.scene.output.snapshot_interval for run in self.runs)

    @cached_property
    def trifle(self) -> float:
        """Largest time difference of snapshots of one instant [s]: each is taken after a step."""
        return 0.1 * self.interval

    def has_ended(self, k: int, time: float) -> bool:
        """Whether a run was over before `time` [s]."""
        return time > self.runs[k].snapshots[-1].time + self.trifle

    def ended_at(self, k: int) -> str:
        """The time at which a run ended, in words."""
        return f"ended at {annotate.time_text(self.runs[k].snapshots[-1].time, self.interval)}"

    @cached_property
    def window(self) -> Window:
        """The part of the world that all fields show [m]."""
        return _together([window(run.scene, run.snapshots) for run in self.runs])

    @cached_property
    def curves(self) -> list[Curve]:
        """The decelerations of the runs whose impactor is slowed down, with their names."""
        last = max(self.times[-1], 1e-9)
        return [
            Curve.of(run.history, last, name, place)
            for place, (run, name) in enumerate(zip(self.runs, self.names, strict=True))
            if run.scene.is_slowed
        ]

    @cached_property
    def look(self) -> Look:
        return Look.of(self.runs[0].scene)

    @cached_property
    def key(self) -> Key:
        """The colour key with the largest range; the first of equal ones."""
        return max((self.look.shown.key(run.scene) for run in self.runs), key=lambda key: key.top)


def at(snapshots: Sequence[Snapshot], time: float) -> Snapshot:
    """The snapshot nearest to `time` [s]; the earlier one if two are equally near."""

    def distance(snapshot: Snapshot) -> float:
        late = snapshot.time - time
        # runs have different steps, so "equally near" allows for some steps
        return 1.02 * late if late > 0 else -late

    return min(snapshots, key=distance)


def frame(lineup: Lineup, time: float, size: tuple[int, int] = (1280, 720)) -> Image8:
    """Draw one instant of all runs, with names, impactor displacements, time, key and curves.

    Args:
        time: time of the instant [s]; a run that has ended earlier is shown in its final state.
        size: width and height [pixels].

    Returns:
        uint8 (height, width, 3). Below half of 1280 x 720 pixels there is no text; a page wider
        than two and a half times its height has no curves.

    Raises:
        UserError: a size below 64 x 64.
    """
    raster.check_size(size)
    look, layout = lineup.look, _Layout.best(lineup, size)
    image, unit = annotate.blank(*size, look.tones.page), layout.unit
    scale = 1.0
    for run, box in zip(lineup.runs, layout.fields, strict=True):
        view = fit(lineup.window, box)
        scale = view.scale
        annotate.field(image, view, unit, look.tones, raster.support_of(run.scene))
        raster.draw(image, at(run.snapshots, time), run.scene, view, unit, look, lineup.key)
    if not layout.has_text:
        return image
    for k in range(len(lineup.runs)):
        _write_head(image, layout, lineup, k, time)
    if layout.diagram and lineup.curves:
        shown = [curve.until(time) for curve in lineup.curves]
        inset.draw(image, layout.diagram, shown, look.theme, 1.2 * unit)
    _write_clock(image, layout, lineup, time, scale)
    return image


def instants(lineup: Lineup, *, n: int = INSTANTS, width: int = montage.WIDTH) -> Image8:
    """Draw `n` instants of all runs as one picture `width` pixels wide, one row per run.

    Returns uint8 (h, width, 3), h even. Raises UserError for fewer than one instant, or for a
    width that `montage.check_width` refuses.
    """
    montage.check_width(width)
    if n < 1:
        raise UserError(f"montage: n = {n}; must be at least 1")
    look, unit = lineup.look, width / montage.WIDTH
    gap, text = round(montage.GAP * unit), montage.TEXT * unit
    across = (width - gap * (n + 1)) // n
    world = _together([montage.around(run.scene, run.snapshots) for run in lineup.runs])
    high = montage.height_of(across, world, text)
    head, foot = round(1.9 * text), round(montage.FOOT * unit)
    chosen = [float(time) for time in np.linspace(lineup.times[0], lineup.times[-1], n)]
    shown = [[at(run.snapshots, time) for time in chosen] for run in lineup.runs]
    panel = Box(0, 0, across, high)
    strip = max(
        montage.strip(panel, row, run.scene, world, text, lineup.interval)
        for row, run in zip(shown, lineup.runs, strict=True)
    )
    high += strip
    above = len(lineup.runs) * (head + high) + foot
    image = annotate.blank(width, above + above % 2, look.tones.page)
    scale, plain = 1.0, annotate.font(0.8 * text)
    for k, run in enumerate(lineup.runs):
        top = head + k * (head + high)
        foot_of_name, room = top - 0.55 * text, width - 2 * gap
        if lineup.has_ended(k, chosen[-1]):
            ended = lineup.ended_at(k)
            place, tone = (width - gap - 2, foot_of_name), look.tones.soft_ink
            annotate.write(image, place, ended, plain, anchor="rs", colour=tone)
            room -= plain.getlength(ended) + 0.7 * text
        _write_name(image, (gap + 2, foot_of_name), lineup, k, room, text)
        for column, snapshot in enumerate(shown[k]):
            left = gap + column * (across + gap)
            box = Box(left, top, left + across, top + high)
            scale = montage.panel(
                image, box, snapshot, run.scene, world, unit, look, lineup.key, lineup.interval,
                strip,
            )  # fmt: skip
    montage.foot_line(image, above, scale, unit, look, lineup.key)
    return image


def _together(windows: Sequence[Window]) -> Window:
    """The smallest window that contains all."""
    return Window(
        min(w.x_min for w in windows),
        max(w.x_max for w in windows),
        min(w.y_min for w in windows),
        max(w.y_max for w in windows),
    )


class _Layout:
    """Positions of the parts of a frame [pixels]; text only if there is room.

    The fields are in `columns`, with the diagram below them. `beside` puts clock and diagram to
    their right instead. On a wide page clock and key are on one line.
    """

    diagram: Box | None = None

    def __init__(self, lineup: Lineup, size: tuple[int, int], columns: int, beside: bool) -> None:
        (width, height), world = size, lineup.window
        self.is_level, self.beside = width > _WIDE * height, beside
        unit = self.unit = min(width / 1280, height / (460 if self.is_level else 720))
        self.has_text = unit >= _LEAST_UNIT - 1e-9
        rows = -(-len(lineup.runs) // columns)
        margin, gap = max(2, round(18 * unit)), round(12 * unit)
        head, foot, side = margin, margin, 0
        if self.has_text:
            head = round(80 * unit)
            side = round(372 * unit) + margin if beside else 0
            foot = margin if beside else round((110 if self.is_level else 214) * unit)
        shape = (world.y_max - world.y_min) / (world.x_max - world.x_min)
        across = (width - side - (columns + 1) * margin) // columns
        tall = min((height - rows * head - foot) // rows, round(across * shape))
        self.pixels = min(across, tall / shape)  # width of the drawn world
        used, half = rows * (head + tall), (width - 3 * margin) // 2
        low = foot - gap - margin  # height of the parts below the fields
        if self.has_text and not (self.is_level or beside):
            low = min(max(low, round(0.6 * half)), height - used - gap - margin)
        # The remaining free space is divided between the top and the bottom of the page.
        rise = (height - used - gap - low - margin) // 2 if self.has_text else 0
        step = (width - side - 2 * margin - across) / max(1, columns - 1)
        self.fields: list[Box] = []
        for k in range(len(lineup.runs)):
            left = round(margin + k % columns * step)
            top = rise + head + k // columns * (head + tall)
            self.fields.append(Box(left, top, left + across, top + tall))
        top, foot = rise + used + gap, rise + used + gap + low
        self.clock = Box(margin, top, width - margin, foot)
        if beside:
            left, foot = width - side, rise + used
            middle = foot - round(0.62 * (side - margin))
            self.clock = Box(left, rise + head, width - margin, middle - gap)
            self.diagram = Box(left, middle, width - margin, foot)
        elif lineup.curves and not self.is_level:
            self.diagram = Box(margin, top, margin + half, foot)
            self.clock = Box(width - margin - half, top, width - margin, foot)

    @classmethod
    def best(cls, lineup: Lineup, size: tuple[int, int]) -> _Layout:
        """The layout with the largest fields: in a row, in a column, or four as 2 x 2."""
        grids = {2: [(2, False), (1, False)], 3: [(3, False), (1, False)]}
        four = [(4, False), (2, False), (2, True)]
        found = [cls(lineup, size, *grid) for grid in grids.get(len(lineup.runs), four)]
        return max(found, key=lambda layout: layout.pixels)


def _write_head(image: Image8, layout: _Layout, lineup: Lineup, k: int, time: float) -> None:
    """Write a run's name above its field, and below the name the displacement and the run's end."""
    box, unit, tones, run = layout.fields[k], layout.unit, lineup.look.tones, lineup.runs[k]
    head = box.top - round(80 * unit)
    _write_name(image, (box.left, head + 36 * unit), lineup, k, box.width, 26 * unit)
    plain, bold = annotate.font(21 * unit), annotate.font(24 * unit, bold=True)
    foot, start = head + 68 * unit, float(box.left)
    if run.scene.impactor is not None:
        depth = raster.depth_text(run.displacement(at(run.snapshots, time)) or 0.0)
        said = "moved " if box.width < _NARROW * unit else "displacement "
        for words, face, tone in ((said, plain, tones.soft_ink), (depth, bold, tones.ink)):
            annotate.write(image, (start, foot), words, face, colour=tone)
            start += face.getlength(words)
    if lineup.has_ended(k, time):
        ended = lineup.ended_at(k)
        if start + 0.5 * 21 * unit + plain.getlength(ended) > box.right:
            ended = "ended"
        annotate.write(image, (box.right, foot), ended, plain, anchor="rs", colour=tones.soft_ink)


def _write_name(
    image: Image8,
    place: tuple[float, float],
    lineup: Lineup,
    k: int,
    room: float,
    size: float,
) -> None:
    """Write a run's name in the colour of its curve, then its further text, if there is room."""
    bold, plain = annotate.font(size, bold=True), annotate.font(0.8 * size)
    tones = lineup.look.tones
    name = annotate.shortened(lineup.names[k], bold, room)
    annotate.write(image, place, name, bold, colour=tones.curves[k])
    start, aside = bold.getlength(name) + 0.7 * size, lineup.asides[k] if lineup.asides else ""
    if aside and start + plain.getlength(aside) <= room:
        after = (place[0] + start, place[1])
        annotate.write(image, after, aside, plain, colour=tones.soft_ink)


def _write_clock(image: Image8, layout: _Layout, lineup: Lineup, time: float, scale: float) -> None:
    """Draw time, scale bar and key: the key below them, on one line with them, or upright."""
    box, unit, level = layout.clock, layout.unit, layout.is_level
    tones, key, plain = lineup.look.tones, lineup.key, annotate.font(21 * unit)
    foot = box.top + 58 * unit
    annotate.write(image, (box.left, box.top + 20 * unit), "time", plain, colour=tones.ink)
    now, big = annotate.time_text(time, lineup.interval), annotate.font(34 * unit, bold=True)
    annotate.write(image, (box.left, foot), now, big, colour=tones.ink)
    share = (0.16 if level else 0.5) * box.width
    middle = box.left + max(share, big.getlength(now) + 24 * unit)
    longest = min(170 * unit, box.right - middle)
    annotate.scale_bar(image, middle, foot, scale, longest, 21 * unit, tones)
    if layout.beside:
        upright = Box(box.left, round(foot + 40 * unit), box.right, box.bottom)
        annotate.upright_key(image, upright, 21 * unit, key, tones)
        return
    # The last tick's text is centred on the bar's end.
    room = plain.getlength(key.ticks[-1][1]) / 2
    left, top, high = box.left, foot + 40 * unit, 86 * unit
    if level:
        left = max(box.left + 0.33 * box.width, middle + longest + 24 * unit)
        top, high = box.top, box.height
    place = Box(round(left), round(top), round(box.right - room), round(top + high))
    annotate.level_key(image, place, 21 * unit, key, tones, under=not level)
