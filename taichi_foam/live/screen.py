"""What one person sees of a drop in window or cell, and what keys change of it."""

from __future__ import annotations

from dataclasses import replace

from taichi_foam import catalogue
from taichi_foam.analysis import quantities as q
from taichi_foam.errors import UserError
from taichi_foam.live.controller import Controller, offered_shapes
from taichi_foam.live.heading import renamed
from taichi_foam.live.pictures import Image8, strip
from taichi_foam.picture import raster
from taichi_foam.picture.colours import THEMES
from taichi_foam.picture.inset import Curve
from taichi_foam.picture.look import Look
from taichi_foam.picture.modes import MODES

#: Frames per second that are asked for; a single step goes on by as much as one of them.
FPS = 30
#: What a key adds to the impactor's velocity [m/s].
VELOCITY_STEP = 0.1
#: The time axis is at least so long [s]: one that grew from nothing would jump at every frame.
SHORTEST_AXIS = 0.01

_WORDS = {"ended": "at its end", "cut short": "at its end", "died": "failed"}


class Screen:
    """A controller's drop as a picture.

    look   how it is drawn
    curve  whether the deceleration is drawn into the picture
    """

    def __init__(self, controller: Controller) -> None:
        self.controller = controller
        self.look = Look.of(controller.given)
        self.curve = True
        self._refused = ""  # why the last key did nothing

    def update(self, timeout: float) -> bool:
        """Take what has come, waiting up to `timeout` [s]; whether there is something new to draw.

        Raises:
            UserError: the device that was asked for cannot be had.
        """
        is_new = bool(self.controller.poll(timeout))
        if self.controller.refusal is not None:
            raise UserError(self.controller.refusal)
        self.controller.look()  # one frame is on its way while the last one is drawn
        return is_new

    @property
    def state(self) -> str:
        """The drop's state in a word or two, or what is wrong."""
        state = self.controller.state
        return pace_words(self.controller.pace) if state == "running" else _WORDS.get(state, state)

    @property
    def peak(self) -> str:
        """The peak deceleration of a drop at its end, in words; empty if it never touched."""
        result = self.controller.result
        if result is None or self.controller.state != "ended":
            return ""
        value, in_g = result.summary[q.CREST.key], result.summary[q.CREST_G.key]
        if value is None:
            return ""
        return f"peak {q.CREST.text(value)} m/s², {q.CREST_G.text(in_g)} g (CFC 180)"

    @property
    def message(self) -> str:
        """What went wrong, in a sentence or two; empty if nothing did."""
        controller = self.controller
        remedy = "; drop again to go on" if controller.state == "died" else ""
        return controller.problem or (controller.message + remedy) or self._refused

    def dismiss(self) -> None:
        """Forget why the last key did nothing."""
        self._refused = ""

    def picture(self, size: tuple[int, int], hint: str = "") -> Image8:
        """The picture of this moment, uint8 (height, width, 3), `hint` at its upper right."""
        snapshot, scene = self.controller.snapshot, self.controller.scene
        note = " · ".join(part for part in (self.state, self.peak, hint) if part)
        curve = None
        if self.curve and scene.is_slowed:
            history = self.controller.so_far.history
            if len(history["time_s"]):
                curve = Curve.of(history, last=max(snapshot.time, SHORTEST_AXIS))
        image = raster.frame(
            snapshot, scene, size, look=self.look, title=catalogue.title(scene), note=note,
            curve=curve, threads=1,
        )  # fmt: skip
        if words := self.message or self.controller.waiting:
            strip(image, words, self.look.theme)
        return image

    # what keys do

    def toggle_pause(self) -> None:
        """Stand still, or go on."""
        self.controller.pause(not self.controller.paused)

    def step(self) -> None:
        """Go on by one frame and stand still."""
        pace = self.controller.pace
        interval = self.controller.scene.output.snapshot_interval
        self.controller.step(interval if pace is None else pace / FPS)

    def change_velocity(self, by: int) -> None:
        """Drop again with an impactor that is faster (1) or slower (-1)."""
        impactor = self.controller.next.impactor
        if impactor is not None:
            velocity = max(round(impactor.velocity + by * VELOCITY_STEP, 3), 0.0)
            self._drop_with("impactor.velocity", velocity)

    def next_shape(self) -> None:
        """Drop again with the next shape of impactor, of the shape's own default size."""
        impactor = self.controller.next.impactor
        if impactor is not None:
            shapes = offered_shapes()
            place = shapes.index(impactor.shape) if impactor.shape in shapes else -1
            self._drop_with("impactor.shape", shapes[(place + 1) % len(shapes)])

    def _drop_with(self, key: str, value: str | float) -> None:
        try:
            scene = self.controller.next.with_values({key: value})
        except UserError as error:
            self._refused = str(error).splitlines()[-1].strip()
            return
        given, impactor = self.controller.given, scene.impactor
        assert given.impactor is not None
        assert impactor is not None
        changes = {}
        if impactor.shape != given.impactor.shape:
            changes["impactor.shape"] = impactor.label
        if impactor.velocity != given.impactor.velocity:
            changes["impactor.velocity"] = f"velocity {impactor.velocity:.6g} m/s"
        self.controller.drop(renamed(scene, given, changes))

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
