"""The picture of a drop in a window or notebook cell, and how keys change it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from PIL import ImageFont

from taichi_foam import catalogue
from taichi_foam.analysis import measures as q
from taichi_foam.errors import UserError
from taichi_foam.live.controls import offered_shapes, renamed
from taichi_foam.live.messages import Pause, Step
from taichi_foam.live.session import Session
from taichi_foam.picture import annotate, raster
from taichi_foam.picture.annotate import Image8
from taichi_foam.picture.inset import Curve
from taichi_foam.picture.look import THEMES, Look
from taichi_foam.picture.modes import MODES
from taichi_foam.picture.view import Box
from taichi_foam.records.history import FILTER

#: Frames requested per second; a single step advances by one of them.
FPS = 30
#: Change of the impactor's velocity per key press [m/s].
VELOCITY_STEP = 0.1
#: Minimum length of the time axis [s]: one that grew from zero would jump at every frame.
SHORTEST_AXIS = 0.01

#: Largest number of lines of a strip; the rest is cut off.
_MOST_LINES = 6

# Words for states that are not shown as they are called.
_WORDS = {"cut short": "ended", "died": "failed"}


class Screen:
    """A session's drop as a picture.

    look   how it is drawn
    curve  whether the deceleration is drawn into the picture
    """

    def __init__(self, session: Session) -> None:
        self.session = session
        self.look = Look.of(session.given)
        self.curve = True
        self._refused = ""  # why the last key had no effect

    def update(self, timeout: float) -> bool:
        """Process events, waiting up to `timeout` [s]; return whether there is something to draw.

        Raises:
            UserError: the requested device is not available.
        """
        is_new = bool(self.session.poll(timeout))
        if self.session.refusal is not None:
            raise UserError(self.session.refusal)
        self.session.look()  # a frame is prepared while the last one is drawn
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
        return f"peak {q.CREST.words(value)}, {q.CREST_G.words(in_g)} ({FILTER})"

    @property
    def message(self) -> str:
        """What went wrong, in a sentence or two; empty if nothing did."""
        session = self.session
        remedy = "; drop again to continue" if session.state == "died" else ""
        return session.problem or (session.message + remedy) or self._refused

    def dismiss(self) -> None:
        """Forget why the last key had no effect."""
        self._refused = ""

    def picture(self, size: tuple[int, int], hint: str = "") -> Image8:
        """The current picture, uint8 (height, width, 3), with `hint` at its upper right."""
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

    # keys

    def toggle_pause(self) -> None:
        self.session.tell(Pause(not self.session.paused))

    def step(self) -> None:
        """Advance by one frame and pause."""
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
        """Drop again with the next impactor shape, in the shape's default size."""
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
        """Show the next quantity of the foam, or the previous one (-1)."""
        self.look = replace(self.look, mode=_after(self.look.mode, list(MODES), by))

    def next_theme(self) -> None:
        self.look = replace(self.look, theme=_after(self.look.theme, list(THEMES), 1))

    def toggle_grid(self) -> None:
        self.look = replace(self.look, grid=not self.look.grid)

    def toggle_curve(self) -> None:
        self.curve = not self.curve


def pace_words(pace: float | None) -> str:
    return "full speed" if pace is None else f"1:{1 / pace:.0f} of real time"


def _after(name: str, names: list[str], by: int) -> str:
    """The name `by` positions after `name`; the first follows the last."""
    return names[(names.index(name) + by) % len(names)]


def panel(image: Image8, rows: Sequence[tuple[str, str]], theme: str) -> None:
    """Draw a panel of keys and their effects over the middle of `image` (h, w, 3), in place."""
    height, width = image.shape[:2]
    tones, unit = THEMES[theme], raster.line_width(width, height)
    size = 22 * unit
    bold, plain = annotate.font(size, bold=True), annotate.font(size)
    left = max(bold.getlength(key) for key, _ in rows)
    right = max(plain.getlength(words) for _, words in rows)
    gap, line = 1.2 * size, 1.55 * size
    wide, high = round(left + right + 3 * gap), round((len(rows) + 0.9) * line)
    x, y = (width - wide) // 2, (height - high) // 2
    annotate.sheet(image, Box(x, y, x + wide, y + high), 2 * unit, tones)
    for k, (key, words) in enumerate(rows):
        base = y + (k + 1.1) * line
        annotate.write(image, (x + gap, base), key, bold, colour=tones.ink)
        annotate.write(image, (x + 2 * gap + left, base), words, plain, colour=tones.ink)


def strip(image: Image8, text: str, theme: str) -> None:
    """Draw a strip with wrapped `text` across the bottom of `image` (h, w, 3), in place."""
    height, width = image.shape[:2]
    tones, unit = THEMES[theme], raster.line_width(width, height)
    size = 20 * unit
    face, gap, line = annotate.font(size), 0.9 * size, 1.4 * size
    lines = _wrapped(text, face, width - 2 * gap)
    top = height - round(len(lines) * line + gap)
    annotate.sheet(image, Box(0, top, width, height), 2 * unit, tones)
    for k, words in enumerate(lines):
        base = top + 0.5 * gap + (k + 0.75) * line
        annotate.write(image, (gap, base), words, face, colour=tones.ink)


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
