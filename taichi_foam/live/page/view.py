"""The page as a view of the controller: what all viewers see, and what they ask for."""

from __future__ import annotations

import threading
import time
import traceback
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from taichi_foam.catalogue import reference_of
from taichi_foam.errors import UserError
from taichi_foam.live.controller import PACES, Controller, Outcome
from taichi_foam.live.heading import heading
from taichi_foam.live.messages import Frame
from taichi_foam.live.page import commands, figures
from taichi_foam.live.page.archive import Archive
from taichi_foam.live.page.controls import Controls, Value
from taichi_foam.live.page.numbers import Numbers
from taichi_foam.live.page.view_state import Tone, ViewState, as_json
from taichi_foam.live.pictures import colour_key, field_png, field_size
from taichi_foam.picture.look import Look
from taichi_foam.picture.modes import MODES

if TYPE_CHECKING:
    from taichi_foam.scene import Scene

#: Of simulated time, that the page's button goes on by [s].
STEP = 2e-4
#: Between two pictures, between two sets of numbers, and between looks when nobody watches [s].
PICTURE_SECONDS, NUMBER_SECONDS, IDLE_SECONDS = 1 / 30, 0.1, 1.0


class PageView:
    """One controller for all viewers, and the view state that they read.

    Everything happens in one thread, which alone calls the controller and draws.
    """

    def __init__(
        self, scene: Scene, out: Path, arch: str = "cpu", threads: int | None = None
    ) -> None:
        self.view_state = ViewState()
        self.controls = Controls(scene)
        self.archive = Archive(out, self._post_drops)
        self.controller = Controller(scene, self._keep, arch=arch, threads=threads)
        self.watchers = 0  # viewers who are there; set by `viewers.Viewers`
        self._shape, self._draft = self.controls.shape, dict(self.controls.defaults)
        self._look, self._theme = Look(scene.output.mode, words=False), "auto"
        self._numbers = Numbers(0)
        self._drawn: dict[Tone, tuple[Any, ...]] = {}
        self._wanted: set[Tone] = {"light"}  # viewers find a picture when they come
        self._next_look = self._next_numbers = 0.0  # on the monotonic clock [s]
        self._was_cut = False  # closing has cut a drop short
        self._inbox = commands.Inbox()
        self._is_closing = threading.Event()
        self._thread = threading.Thread(target=self._run, name="page", daemon=True)

    def start(self) -> None:
        """Drop the scene."""
        self._thread.start()

    def tell(self, command: commands.Shared, reply: commands.Reply) -> None:
        """Do this soon; `reply` hears, in the view's thread, why it cannot be done.

        A viewer uses the same `reply` each time.
        """
        if not self._inbox.put(command, reply):
            reply("too much at once; try again")

    def close(self) -> bool:
        """End the drop and have kept what it gave; whether this has cut it short."""
        self._is_closing.set()
        self._thread.join()
        return self._was_cut

    def _run(self) -> None:
        """The thread: listens to viewers and to the session in turn."""
        self.view_state.post("hello", self._hello())
        self._post_settings()
        self._post_drops()
        self._try(lambda: self.controller.drop(self.controller.given))
        while not self._is_closing.is_set():
            if not self._try(self._turn):
                self._is_closing.wait(NUMBER_SECONDS)
        self._was_cut = self.controller.finish()
        self.controller.close()

    def _try(self, do: Callable[[], object]) -> bool:
        """Do this; an unexpected error is told to viewers, and the next drop gets its chance."""
        try:
            do()
        except Exception as error:
            message = f"{type(error).__name__}: {error}"
            if message != self.controller.message:
                traceback.print_exc()  # in full, and once
            self.controller.fail(message)
            told = {"state": "failed", "waiting": "", "message": message}
            self.view_state.post("numbers", told | Numbers(self.controller.number).told())
            return False
        return True

    def _turn(self) -> None:
        """Listen, look and tell, each if it is due."""
        if self._obey():
            self._next_look = 0.0
        now = time.monotonic()
        if now >= self._next_look:
            self.controller.look()
            is_idle = self.controller.settled or not self.watchers
            self._next_look = now + (IDLE_SECONDS if is_idle else PICTURE_SECONDS)
        wait = min(self._next_look, self._next_numbers) - now
        events = self.controller.poll(min(max(0.002, wait), NUMBER_SECONDS))
        if self._numbers.drop != self.controller.number:
            self._numbers = Numbers(self.controller.number)
            self._post_scene()
            self._next_numbers = 0.0
        for event in events:
            if isinstance(event, Frame) and event.drop == self._numbers.drop:
                self._numbers.take(event)
        self._draw()
        now = time.monotonic()
        if now >= self._next_numbers:
            self._post_numbers()
            # a history that takes long to go through is gone through more rarely
            took = time.monotonic() - now
            usual = NUMBER_SECONDS if self.watchers else IDLE_SECONDS
            self._next_numbers = now + min(max(usual, 5.0 * took), IDLE_SECONDS)

    def _keep(self, outcome: Outcome) -> None:
        about = list(self.controls.changes(outcome.result.scene).values())
        self.archive.add(outcome.drop, about, outcome.ended, outcome.result)

    # what viewers want

    def _obey(self) -> bool:
        """Do some of what waits to be done; whether that asks for a new picture."""
        taken = self._inbox.take()
        for command, reply in taken:
            try:
                self._do(command)
            except (UserError, ValueError) as error:
                reply(str(error))
            except Exception as error:
                # told to its sender alone
                traceback.print_exc()
                reply(f"{type(error).__name__}: {error}")
        if taken:
            self._post_settings()
        return any(not isinstance(command, commands.Set) for command, _ in taken)

    def _do(self, command: commands.Shared) -> None:
        """Raises UserError for what cannot be done."""
        match command:
            case commands.Set(shape=shape, values=values):
                self.controls.check(shape, values)
                self._shape = shape
                self._draft.update(values)
            case commands.Drop(shape=shape, values=values):
                self._drop(shape, {**self._draft, **values})
            case commands.Reset():
                self._drop(self.controls.shape, self.controls.defaults)
            case commands.Pause(on=on):
                self.controller.pause(on)
            case commands.Step(seconds=seconds):
                self.controller.step(seconds)
            case commands.Pace(rate=rate):
                self.controller.pace = rate
            case commands.Look(mode=mode, theme=theme, grid=grid):
                self._look, self._theme = Look(mode, grid=grid, words=False), theme
                self._post_scene()
            case commands.Save():
                self.archive.try_again()

    def _drop(self, shape: str, values: dict[str, Value]) -> None:
        scene = self.controls.scene_of(shape, values)
        self.archive.check(scene)
        self.controller.drop(scene, finish_current=True)
        self._shape, self._draft = shape, dict(values)

    # what viewers see

    def _draw(self) -> None:
        """Draw where somebody is ready for a picture that has changed."""
        self._wanted |= self.view_state.take_wanted()
        controller = self.controller
        number, scene, snapshot = controller.number, controller.scene, controller.snapshot
        for tone in tuple(self._wanted):
            look = replace(self._look, theme=tone)
            readouts = as_json(self._numbers.at(snapshot.time, controller.so_far))
            key = (number, snapshot.time, look, readouts)
            if self._drawn.get(tone) != key:
                self._drawn[tone] = key
                self._wanted.discard(tone)
                self.view_state.set_picture(tone, field_png(snapshot, scene, look, readouts))

    def _post_numbers(self) -> None:
        controller = self.controller
        at_rest = controller.settled or controller.ended
        self._numbers.read(controller.so_far, controller.result is not None, at_rest)
        self.view_state.set_curve(self._numbers.curve)
        told = {
            "state": controller.state,
            "waiting": controller.waiting,
            "message": controller.message,
            **self._numbers.told(),
        }
        self.view_state.post("numbers", told)

    def _post_scene(self) -> None:
        scene, given = self.controller.scene, self.controls.given
        known = reference_of(scene)
        title, changes = heading(scene, given, self.controls.changes(scene))
        self.view_state.post(
            "scene",
            {
                "drop": self.controller.number,
                "name": title,
                "changes": changes,
                "size": field_size(scene),
                "key": colour_key(scene, self._look.mode),
                "measured": {"test": known.name, **known.figures} if known else None,
                "nodes": [scene.block.columns, scene.block.rows],
                "falls": scene.impactor is not None,
            },
        )

    def _post_settings(self) -> None:
        self.view_state.post(
            "settings",
            {
                "shape": self._shape,
                "values": self._draft,
                "pace": self.controller.pace,
                "mode": self._look.mode,
                "theme": self._theme,
                "grid": self._look.grid,
            },
            digits=None,  # a control's value is dropped as it was set
        )

    def _post_drops(self) -> None:
        self.view_state.post("drops", self.archive.told())
        self.view_state.post("curves", self.archive.curves())

    def _hello(self) -> dict[str, Any]:
        return {
            "controls": self.controls.told(),
            "modes": [[name, mode.about] for name, mode in MODES.items()],
            "paces": PACES,
            "step": STEP,
            "figures": figures.FIGURES,
            "energies": [words for words, _ in figures.ENERGIES],
        }
