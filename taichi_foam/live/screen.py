"""What one person sees of a drop in window or cell, and what keys change of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from PIL import ImageFont

from taichi_foam import catalogue
from taichi_foam.analysis import measures as q
from taichi_foam.errors import UserError
from taichi_foam.live.controls import offered_shapes, renamed
from taichi_foam.live.messages import Pause, Step
from taichi_foam.live.session import Session
from taichi_foam.picture import annotate, raster
from taichi_foam.picture.inset import Curve
from taichi_foam.picture.look import THEMES, Look, Theme
from taichi_foam.picture.modes import MODES
from taichi_foam.picture.view import Box

#: Frames per second that are asked for; a single step goes on by as much as one of them.
FPS = 30
#: What a key adds to the impactor's velocity [m/s].
VELOCITY_STEP = 0.1
#: The time axis is at least so long [s]: one that grew from nothing would jump at every frame.
SHORTEST_AXIS = 0.01

#: Lines of a strip at most: what is longer is cut.
_MOST_LINES = 6

Image8 = NDArray[np.uint8]

_WORDS = {"ended": "at its end", "cut short": "at its end", "died": "failed"}


class Screen:
    """A session's drop as a picture.

    look   how it is drawn
    curve  whether the deceleration is drawn into the picture
    """

    def __init__(self, session: Session) -> None:
        self.session = session
        self.look = Look.of(session.given)
        self.curve = True
        self._refused = ""  # why the last key did nothing

    def update(self, timeout: float) -> bool:
        """Take what has come, waiting up to `timeout` [s]; whether there is something new to draw.

        Raises:
            UserError: the device that was asked for cannot be had.
        """
        is_new = bool(self.session.poll(timeout))
        if self.session.refusal is not None:
            raise UserError(self.session.refusal)
        self.session.look()  # one frame is on its way while the last one is drawn
        return is_new

    @property
    def state(self) -> str:
        """The drop's state in a word or two, or what is wrong."""
        state = self.session.state
        return pace_words(self.session.pace) if state == "running" else _WORDS.get(state, state)

    @property
    def peak(self) -> str:
        """The peak deceleration of a drop at its end, in words; empty if it never touched."""
        result = self.session.result
        if result is None or self.session.state != "ended":
            return ""
        value, in_g = result.summary[q.CREST.key], result.summary[q.CREST_G.key]
        if value is None:
            return ""
        return f"peak {q.CREST.text(value)} m/s², {q.CREST_G.text(in_g)} g (CFC 180)"

    @property
    def message(self) -> str:
        """What went wrong, in a sentence or two; empty if nothing did."""
        session = self.session
        remedy = "; drop again to go on" if session.state == "died" else ""
        return session.problem or (session.message + remedy) or self._refused

    def dismiss(self) -> None:
        """Forget why the last key did nothing."""
        self._refused = ""

    def picture(self, size: tuple[int, int], hint: str = "") -> Image8:
        """The picture of this moment, uint8 (height, width, 3), `hint` at its upper right."""
        snapshot, scene = self.session.snapshot, self.session.scene
        note = " · ".join(part for part in (self.state, self.peak, hint) if part)
        curve = None
        if self.curve and scene.is_slowed:
            history = self.session.so_far.history
            if len(history["time_s"]):
                curve = Curve.of(history, last=max(snapshot.time, SHORTEST_AXIS))
        image = raster.frame(
            snapshot, scene, size, look=self.look, title=catalogue.title(scene), note=note,
            curve=curve, threads=1,
        )  # fmt: skip
        if words := self.message or self.session.waiting:
            strip(image, words, self.look.theme)
        return image

    # what keys do

    def toggle_pause(self) -> None:
        """Stand still, or go on."""
        self.session.tell(Pause(not self.session.paused))

    def step(self) -> None:
        """Go on by one frame and stand still."""
        pace = self.session.pace
        interval = self.session.scene.output.snapshot_interval
        self.session.tell(Step(interval if pace is None else pace / FPS))

    def change_velocity(self, by: int) -> None:
        """Drop again with an impactor that is faster (1) or slower (-1)."""
        impactor = self.session.next.impactor
        if impactor is not None:
            velocity = max(round(impactor.velocity + by * VELOCITY_STEP, 3), 0.0)
            self._drop_with("impactor.velocity", velocity)

    def next_shape(self) -> None:
        """Drop again with the next shape of impactor, of the shape's own default size."""
        impactor = self.session.next.impactor
        if impactor is not None:
            shapes = offered_shapes()
            place = shapes.index(impactor.shape) if impactor.shape in shapes else -1
            self._drop_with("impactor.shape", shapes[(place + 1) % len(shapes)])

    def _drop_with(self, key: str, value: str | float) -> None:
        try:
            scene = self.session.next.with_values({key: value})
        except UserError as error:
            self._refused = str(error).splitlines()[-1].strip()
            return
        given, impactor = self.session.given, scene.impactor
        assert given.impactor is not None
        assert impactor is not None
        changes = {}
        if impactor.shape != given.impactor.shape:
            changes["impactor.shape"] = impactor.label
        if impactor.velocity != given.impactor.velocity:
            changes["impactor.velocity"] = f"velocity {impactor.velocity:.6g} m/s"
        self.session.drop(renamed(scene, given, changes))

    def next_mode(self, by: int = 1) -> None:
        """Show the next figure of the foam, or the one before (-1)."""
        self.look = replace(self.look, mode=_after(self.look.mode, list(MODES), by))

    def next_theme(self) -> None:
        """Light, dark."""
        self.look = replace(self.look, theme=_after(self.look.theme, list(THEMES), 1))

    def toggle_grid(self) -> None:
        """Show the foam's grid, or not."""
        self.look = replace(self.look, grid=not self.look.grid)

    def toggle_curve(self) -> None:
        """Show the deceleration, or not."""
        self.curve = not self.curve


def pace_words(pace: float | None) -> str:
    """A pace as people say it."""
    return "full speed" if pace is None else f"1:{1 / pace:.0f} of real time"


def _after(name: str, names: list[str], by: int) -> str:
    """The name `by` places on; after the last comes the first."""
    return names[(names.index(name) + by) % len(names)]


def panel(image: Image8, rows: Sequence[tuple[str, str]], theme: str) -> None:
    """A panel of keys and what they do over the middle of `image` (h, w, 3), in place."""
    height, width = image.shape[:2]
    tones, unit = THEMES[theme], min(width / 1280, height / 720)
    size = 22 * unit
    bold, plain = annotate.font(size, bold=True), annotate.font(size)
    left = max(bold.getlength(key) for key, _ in rows)
    right = max(plain.getlength(words) for _, words in rows)
    gap, line = 1.2 * size, 1.55 * size
    wide, high = round(left + right + 3 * gap), round((len(rows) + 0.9) * line)
    x, y = (width - wide) // 2, (height - high) // 2
    _sheet(image, Box(x, y, x + wide, y + high), tones, unit)
    for k, (key, words) in enumerate(rows):
        base = y + (k + 1.1) * line
        annotate.write(image, (x + gap, base), key, bold, colour=tones.ink)
        annotate.write(image, (x + 2 * gap + left, base), words, plain, colour=tones.ink)


def strip(image: Image8, text: str, theme: str) -> None:
    """A strip with `text` in whole lines across the foot of `image` (h, w, 3), in place."""
    height, width = image.shape[:2]
    tones, unit = THEMES[theme], min(width / 1280, height / 720)
    size = 20 * unit
    face, gap, line = annotate.font(size), 0.9 * size, 1.4 * size
    lines = _wrapped(text, face, width - 2 * gap)
    top = height - round(len(lines) * line + gap)
    _sheet(image, Box(0, top, width, height), tones, unit)
    for k, words in enumerate(lines):
        base = top + 0.5 * gap + (k + 0.75) * line
        annotate.write(image, (gap, base), words, face, colour=tones.ink)


def _sheet(image: Image8, box: Box, tones: Theme, unit: float) -> None:
    """An empty sheet with an edge."""
    edge = max(1, round(2 * unit))
    annotate.rectangle(image, box, tones.frame)
    inner = Box(box.left + edge, box.top + edge, box.right - edge, box.bottom - edge)
    annotate.rectangle(image, inner, tones.page)


def _wrapped(text: str, face: ImageFont.FreeTypeFont, room: float) -> list[str]:
    """`text` in lines of at most `room` pixels, broken between words."""
    lines = [""]
    for word in text.split():
        longer = f"{lines[-1]} {word}".strip()
        if lines[-1] and face.getlength(longer) > room:
            lines.append(word)
        else:
            lines[-1] = longer
    shown = lines[:_MOST_LINES]
    return [annotate.shortened(each, face, room) for each in shown]
