"""A drop as one person watches it: what is shown, and what can be done to it.

Window and notebook draw what a stage shows; neither knows how a run is computed.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from taichi_foam.drive import history_of
from taichi_foam.engine.start import start_of
from taichi_foam.errors import UserError
from taichi_foam.live.messages import Died, Ended, Event, Failed, Frame, Refused
from taichi_foam.live.session import Session
from taichi_foam.picture import annotate, raster
from taichi_foam.picture.colours import THEMES
from taichi_foam.picture.inset import Curve
from taichi_foam.picture.look import Look
from taichi_foam.picture.modes import MODES
from taichi_foam.result import Result
from taichi_foam.scene import Scene
from taichi_foam.scene_io import load_scene

Image8 = NDArray[np.uint8]
Keep = Callable[[Result], None]

#: Simulated seconds in one of watching; None: as fast as it goes.
PACES = (1e-3, 2e-3, 5e-3, 1e-2, 2e-2, 5e-2, 1e-1, None)
PACE = 1e-2
#: Frames per second that are asked for; a single step goes on by as much as one of them.
FPS = 30
#: What a key adds to the impactor's velocity [m/s].
VELOCITY_STEP = 0.1
SHAPES = ("flat", "cylinder", "wedge")
#: The time axis is at least so long [s]: one that grew from nothing would jump at every frame.
SHORTEST_AXIS = 0.01
# A drop at rest sends no more pictures. After a command the next frame may still be from before it,
# the one after that is not.
_UNSETTLED = 2
#: How long a drop that is cut short may take to hand over what there is [s].
PATIENCE = 30.0


class Stage:
    """One viewer's drop. `keep` gets every result that comes to its end, and the last as it is.

    scene    what is dropped, with the changes made so far
    session  the run behind it
    look     how it is drawn
    pace     one of PACES
    curve    whether the deceleration is drawn into the picture
    """

    def __init__(
        self,
        scene: Scene,
        keep: Keep = lambda result: None,
        *,
        arch: str = "cpu",
        threads: int | None = None,
        pace: float | None = PACE,
    ) -> None:
        self.scene, self.look, self.pace = scene, Look.of(scene), pace
        self.curve = True
        self._name = scene.name
        self._keep = keep
        self._settings = (arch, threads)
        self._trouble = ""
        self._wanted = _UNSETTLED
        self._history: tuple[int, dict] = (0, {})  # rows it was made from, and the columns
        self._open()

    def _open(self) -> None:
        self.session = Session(*self._settings)
        self.session.pace = self.pace
        self.session.start(self.scene)

    def __enter__(self) -> Stage:
        return self

    def __exit__(self, *_: object) -> None:
        self.session.close()

    # what is shown

    def update(self, timeout: float) -> bool:
        """Hear what has come, waiting up to `timeout` [s]; whether there is something new to draw.

        Raises:
            UserError: the device that was asked for cannot be had.
        """
        events = self.session.poll(timeout)
        for event in events:
            self._hear(event)
        # One is on its way while the last one is drawn.
        if self._wanted > 0:
            self.session.ask()
        return bool(events)

    def _hear(self, event: Event) -> None:
        if isinstance(event, Frame):
            is_at_rest = event.paused or event.ended
            self._wanted = self._wanted - 1 if is_at_rest else _UNSETTLED
        elif isinstance(event, Ended):
            self._keep(event.result)
        elif isinstance(event, Failed):
            self._trouble = event.message
            if event.result is not None:
                self._keep(event.result)
        elif isinstance(event, Refused):
            raise UserError(event.message)
        elif isinstance(event, Died):
            self._trouble = f"{event.message}; drop again to go on"

    @property
    def ended(self) -> bool:
        """Whether nothing more is computed of the current drop."""
        return self.session.ended

    @property
    def state(self) -> str:
        """The drop's state in a word or two, or what is wrong."""
        if self._trouble:
            return self._trouble
        if self.session.ended:
            return "at its end"
        if self.session.last is None:
            return "preparing"
        if self.session.paused:
            return "paused"
        return pace_words(self.pace)

    def picture(self, size: tuple[int, int], hint: str = "") -> Image8:
        """The picture of this moment, uint8 (height, width, 3), `hint` at its upper right."""
        last = self.session.last
        note = " · ".join(part for part in (self.state, hint) if part)
        snapshot = start_of(self.scene) if last is None else last.snapshot
        curve = self._curve(snapshot.time) if self.curve else None
        return raster.frame(
            snapshot, self.scene, size, look=self.look, note=note, curve=curve, threads=1
        )

    def _curve(self, now: float) -> Curve | None:
        rows = self.session.rows
        if self.scene.impactor is None or not len(rows):
            return None
        if self._history[0] != len(rows):
            self._history = (len(rows), history_of(self.scene, rows))
        return Curve.of(self._history[1], last=max(now, SHORTEST_AXIS))

    # what can be done

    def toggle_pause(self) -> None:
        """Stand still, or go on."""
        self._wanted = _UNSETTLED
        if self.session.paused:
            self.session.resume()
        else:
            self.session.pause()

    def step(self) -> None:
        """Go on by one frame and stand still."""
        self._wanted = _UNSETTLED
        pace = self.pace
        interval = self.scene.output.snapshot_interval
        self.session.step(interval if pace is None else pace / FPS)

    def change_pace(self, by: int) -> None:
        """Faster (1) or slower (-1)."""
        place = PACES.index(self.pace) if self.pace in PACES else PACES.index(PACE)
        self.pace = PACES[min(max(place + by, 0), len(PACES) - 1)]
        self.session.pace = self.pace

    def again(self) -> None:
        """Drop once more, from the start; after a breakdown in a new process."""
        self._trouble, self._history, self._wanted = "", (0, {}), _UNSETTLED
        if self.session.alive:
            self.session.start(self.scene)
        else:
            self.session.close()
            self._open()

    def change_velocity(self, by: int) -> None:
        """Drop again with an impactor that is faster (1) or slower (-1)."""
        impactor = self.scene.impactor
        if impactor is not None:
            velocity = max(round(impactor.velocity + by * VELOCITY_STEP, 3), 0.0)
            self._change(f"impactor.velocity={velocity!r}")

    def next_shape(self) -> None:
        """Drop again with the next shape of impactor, of the shape's own default size."""
        impactor = self.scene.impactor
        if impactor is not None:
            place = SHAPES.index(impactor.shape) if impactor.shape in SHAPES else -1
            self._change(f"impactor.shape={SHAPES[(place + 1) % len(SHAPES)]}")

    def _change(self, override: str) -> None:
        try:
            scene = load_scene(self.scene, overrides=[override])
        except UserError as error:
            self._trouble = str(error).splitlines()[-1].strip()
            return
        assert scene.impactor is not None
        # A scene's name stands for what was measured: another impact needs another name.
        name = f"{self._name}: {scene.impactor.shape}, {scene.impactor.velocity:.2f} m/s"
        self.scene = scene.model_copy(update={"name": name[:100]})
        self.again()

    def next_mode(self, by: int = 1) -> None:
        """Show the next figure of the foam, or the one before (-1)."""
        names = list(MODES)
        mode = names[(names.index(self.look.mode) + by) % len(names)]
        self.look = replace(self.look, mode=mode)

    def next_theme(self) -> None:
        """Light, dark."""
        names = list(THEMES)
        theme = names[(names.index(self.look.theme) + 1) % len(names)]
        self.look = replace(self.look, theme=theme)

    def toggle_grid(self) -> None:
        """Show the foam's grid, or not."""
        self.look = replace(self.look, grid=not self.look.grid)

    def toggle_curve(self) -> None:
        """Show the deceleration, or not."""
        self.curve = not self.curve

    def finish(self) -> bool:
        """End the drop now and keep what there is; whether that cut it short."""
        if self.session.ended:
            return False
        result = self.session.finish(PATIENCE)
        if result is not None:
            self._keep(result)
        return True


def pace_words(pace: float | None) -> str:
    """A pace as people say it."""
    return "full speed" if pace is None else f"1:{1 / pace:.0f} of real time"


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
    box = annotate.Box(x, y, x + wide, y + high)
    annotate.rectangle(image, box, tones.frame)
    edge = max(1, round(2 * unit))
    inner = annotate.Box(x + edge, y + edge, x + wide - edge, y + high - edge)
    annotate.rectangle(image, inner, tones.page)
    for k, (key, words) in enumerate(rows):
        base = y + (k + 1.1) * line
        annotate.write(image, (x + gap, base), key, bold, colour=tones.ink)
        annotate.write(image, (x + 2 * gap + left, base), words, plain, colour=tones.ink)
