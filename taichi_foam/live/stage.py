"""A drop as one person watches it: what is shown, and what can be done to it.

Window and notebook draw what a stage shows; neither knows how a run is computed.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from taichi_foam.analysis.history import history_of
from taichi_foam.catalogue import load_scene
from taichi_foam.engine.state import initial_state
from taichi_foam.errors import UserError
from taichi_foam.live import overlay
from taichi_foam.live.messages import Died, Ended, Event, Failed, Frame, Refused
from taichi_foam.live.session import Session
from taichi_foam.picture import raster
from taichi_foam.picture.colours import THEMES
from taichi_foam.picture.inset import Curve
from taichi_foam.picture.look import Look
from taichi_foam.picture.modes import MODES
from taichi_foam.results.result import Result
from taichi_foam.scene import Scene
from taichi_foam.shim2000 import tests
from taichi_foam.simulation.interrupts import held_interrupts

Image8 = NDArray[np.uint8]
Keep = Callable[[Result], object]

#: Simulated seconds in one of watching; None: as fast as it goes.
PACES = (1e-3, 2e-3, 5e-3, 1e-2, 2e-2, 5e-2, 1e-1, None)
#: The pace at first: an impact of 50 ms takes five seconds.
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

    What `keep` cannot take (it raises UserError or OSError) stays here, and nothing more is dropped
    until it has been taken.

    scene    what is dropped, with the changes made so far
    session  the run behind it
    look     how it is drawn
    pace     one of PACES
    curve    whether the deceleration is drawn into the picture
    unkept   results that `keep` has not taken yet
    problem  why, in its words; empty if all is well
    failures what the drops that failed met
    was_cut  whether the last result was cut short
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
        self.unkept: list[Result] = []
        self.problem = ""
        self.failures: list[str] = []
        self.was_cut = False
        self._trouble = ""  # of the current drop
        self._said = ""  # why the last key did nothing
        self._is_due = False  # a drop that waits until the current one is prepared
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
            self._put(event.result)
        elif isinstance(event, Failed):
            self._trouble = event.message
            self.failures.append(event.message)
            if event.result is not None:
                self._put(event.result)
        elif isinstance(event, Refused):
            raise UserError(event.message)
        elif isinstance(event, Died):
            self._trouble = f"{event.message}; drop again to go on"
        if self._is_due and (self.session.last is not None or self.session.ended):
            self._drop()

    def _put(self, result: Result) -> None:
        """Have a result kept, or keep it here."""
        self.was_cut = bool(result.run["interrupted"])
        self.unkept.append(result)
        self.save()

    def save(self) -> None:
        """Have everything kept that is not yet. Ctrl-C waits until a result is whole."""
        with held_interrupts() as pressed:
            try:
                while self.unkept:
                    self._keep(self.unkept[0])
                    self.unkept.pop(0)
                self.problem = ""
            except (UserError, OSError) as error:
                self.problem = f"not saved: {error}"
        if pressed.is_set():
            raise KeyboardInterrupt

    @property
    def ended(self) -> bool:
        """Whether nothing more is computed of the current drop."""
        return self.session.ended

    @property
    def state(self) -> str:
        """The drop's state in a word or two, or what is wrong."""
        if self._trouble:
            return "failed"
        if self.session.ended:
            return "at its end"
        if self.session.last is None:
            return "preparing"
        if self.session.paused:
            return "paused"
        return pace_words(self.pace)

    @property
    def message(self) -> str:
        """What went wrong, in a sentence or two; empty if nothing did."""
        return self.problem or self._trouble or self._said

    def dismiss(self) -> None:
        """Whoever watches has seen why the last key did nothing."""
        self._said = ""

    def picture(self, size: tuple[int, int], hint: str = "") -> Image8:
        """The picture of this moment, uint8 (height, width, 3), `hint` at its upper right."""
        last = self.session.last
        note = " · ".join(part for part in (self.state, hint) if part)
        snapshot = initial_state(self.scene).snapshot() if last is None else last.snapshot
        curve = self._curve(snapshot.time) if self.curve else None
        image = raster.frame(
            snapshot, self.scene, size, look=self.look, title=tests.title(self.scene), note=note,
            curve=curve, threads=1,
        )  # fmt: skip
        if self.message:
            overlay.strip(image, self.message, self.look.theme)
        return image

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
        """Drop once more, from the start; after a breakdown in a new process.

        A key that is held down does not pile up drops: while one is prepared, the next one waits.
        """
        self.save()
        self._is_due = not self.problem
        is_preparing = self.session.alive and self.session.last is None and not self.session.ended
        if self._is_due and not is_preparing:
            self._drop()

    def _drop(self) -> None:
        self._is_due = False
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
            self._said = str(error).splitlines()[-1].strip()
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

    def finish(self) -> None:
        """End the drop now and have everything kept; see `unkept`, `problem`, `was_cut`."""
        self._is_due = False
        self.update(0.0)  # an end that has come, but has not been heard
        try:
            if not self.session.ended and self.session.last is not None:
                self.session.finish(PATIENCE)
        finally:
            self.update(0.0)
            self.save()


def pace_words(pace: float | None) -> str:
    """A pace as people say it."""
    return "full speed" if pace is None else f"1:{1 / pace:.0f} of real time"
