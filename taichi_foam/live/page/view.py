"""The page as a view of the session: what all viewers see, and what they ask for."""

from __future__ import annotations

import io
import json
import struct
import threading
import time
import traceback
from collections.abc import Callable, Hashable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from PIL import Image

from taichi_foam.catalogue import reference_of
from taichi_foam.errors import UserError
from taichi_foam.live.controls import Controls, Value, heading
from taichi_foam.live.messages import Frame, Pace, Pause, Step
from taichi_foam.live.page import archive, commands
from taichi_foam.live.page.cushion import Charts
from taichi_foam.live.page.numbers import ENERGIES, FIGURES, Curve, Numbers, shown
from taichi_foam.live.session import PACES, Outcome, Session
from taichi_foam.picture import raster
from taichi_foam.picture.look import Look, shades
from taichi_foam.picture.modes import MODES
from taichi_foam.picture.view import window
from taichi_foam.results.files import plain

if TYPE_CHECKING:
    from taichi_foam.records.snapshot import Snapshot
    from taichi_foam.scene import Scene

Tone = str  # "light" or "dark"

#: Of the numbers in messages: more than anybody can see.
DIGITS = 6
#: Of simulated time, that the page's button goes on by [s].
STEP = 2e-4
#: Between two pictures, between two sets of numbers, and between looks when nobody watches [s].
PICTURE_SECONDS, NUMBER_SECONDS, IDLE_SECONDS = 1 / 30, 0.1, 1.0

#: Pixels of a picture, and how wide it may be for its height and the other way round.
PIXELS, WIDEST, TALLEST = 960 * 540, 2.4, 0.8
#: Colours that the gradient of the colour key is made of.
STOPS = 24
#: In front of a picture: the bytes of the JSON that comes first; little endian.
LENGTH = struct.Struct("<I")


class ViewState:
    """What the page shows now, written once for all viewers; they read it in any thread.

    notes     by kind: a number that grows with each change, and the latest message
    pictures  by tone: the same, and the picture as it is sent
    curve     the same of the current drop's curve
    """

    def __init__(self) -> None:
        self.notes: dict[str, tuple[int, str]] = {}
        self.pictures: dict[Tone, tuple[int, bytes]] = {}
        self.curve = (0, Curve(0, np.empty(0), np.empty(0)))
        self.wake: Callable[[], object] = lambda: None
        self._wanted: set[Tone] = set()
        self._lock = threading.Lock()  # guards the tones

    def post(self, kind: str, content: dict[str, Any], digits: int | None = DIGITS) -> None:
        """Show this from now on; the same again is no change. `digits` as of `_as_json`."""
        text = _as_json({"kind": kind, **content}, digits)
        number, before = self.notes.get(kind, (0, ""))
        if text != before:
            self.notes[kind] = (number + 1, text)
            self.wake()

    def set_picture(self, tone: Tone, picture: bytes) -> None:
        """Show this picture from now on."""
        number, _ = self.pictures.get(tone, (0, b""))
        self.pictures[tone] = (number + 1, picture)
        self.wake()

    def set_curve(self, curve: Curve) -> None:
        """Show this curve from now on; the same again is no change."""
        number, before = self.curve
        if curve is not before:
            self.curve = (number + 1, curve)
            self.wake()

    def want(self, tone: Tone) -> None:
        """Some viewer is ready for the next picture in this tone."""
        with self._lock:
            self._wanted.add(tone)

    def take_wanted(self) -> set[Tone]:
        """The tones in which a picture is wanted; the caller has to draw them."""
        with self._lock:
            wanted, self._wanted = self._wanted, set()
        return wanted


class PageView:
    """One session for all viewers, and the view state that they read.

    Everything happens in one thread, which alone calls the session and draws.
    """

    def __init__(
        self, scene: Scene, out: Path, arch: str = "cpu", threads: int | None = None
    ) -> None:
        self.view_state = ViewState()
        self.controls = Controls(scene)
        self.archive = archive.Archive(out, self._post_drops)
        self.session = Session(scene, self._keep, arch=arch, threads=threads)
        self.charts = Charts(scene)
        self.watchers = 0  # viewers who are there; set by `viewers.Viewers`
        self._shape, self._draft = self.controls.shape, dict(self.controls.defaults)
        self._look, self._theme = Look(scene.output.mode, words=False), "auto"
        self._numbers = Numbers(0)
        self._drawn: dict[Tone, Hashable] = {}
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
            reply("too many commands at once; try again")

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
        self._try(lambda: self.session.drop(self.session.given))
        while not self._is_closing.is_set():
            if not self._try(self._turn):
                self._is_closing.wait(NUMBER_SECONDS)
        self.charts.close()
        self._was_cut = self.session.finish()
        self.session.close()

    def _try(self, do: Callable[[], object]) -> bool:
        """Do this; an unexpected error is told to viewers, and the next drop gets its chance."""
        try:
            do()
        except Exception as error:
            message = f"{type(error).__name__}: {error}"
            if message != self.session.message:
                traceback.print_exc()  # in full, and once
            self.session.fail(message)
            self._post_standing(Numbers(self.session.number))
            return False
        return True

    def _turn(self) -> None:
        """Listen, look and tell, each if it is due."""
        if self._obey():
            self._next_look = 0.0
        now = time.monotonic()
        if now >= self._next_look:
            self.session.look()
            is_idle = self.session.settled or not self.watchers
            self._next_look = now + (IDLE_SECONDS if is_idle else PICTURE_SECONDS)
        wait = min(self._next_look, self._next_numbers) - now
        events = self.session.poll(min(max(0.002, wait), NUMBER_SECONDS))
        if self._numbers.drop != self.session.number:
            self._numbers = Numbers(self.session.number)
            self._post_scene()
            self._next_numbers = 0.0
        for event in events:
            if isinstance(event, Frame) and event.drop == self._numbers.drop:
                self._numbers.take(event)
        if self.charts.take():
            self._post_chart()
        self._draw()
        now = time.monotonic()
        if now >= self._next_numbers:
            self._post_numbers()
            # a history that takes long to go through is gone through more rarely
            took = time.monotonic() - now
            usual = NUMBER_SECONDS if self.watchers else IDLE_SECONDS
            self._next_numbers = now + min(max(usual, 5.0 * took), IDLE_SECONDS)

    def _keep(self, outcome: Outcome) -> None:
        scene, controls = outcome.result.scene, self.controls
        about = [scene.name]
        if controls.describes(scene):
            about = list(controls.changes(scene).values())
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
            case commands.Cushion():
                self.charts.ask(command)
                self._post_chart()
            case commands.Point(chart=chart, point=point):
                self._begin(self.charts.scene(chart, point))
            case Pause() | Step() | Pace():
                self.session.tell(command)
            case commands.Look(mode=mode, theme=theme, grid=grid):
                self._look, self._theme = Look(mode, grid=grid, words=False), theme
                self._post_scene()
            case commands.Save():
                self.archive.try_again()

    def _drop(self, shape: str, values: dict[str, Value]) -> None:
        self._begin(self.controls.scene_of(shape, values))
        self._shape, self._draft = shape, dict(values)

    def _begin(self, scene: Scene) -> None:
        """Drop a scene, once the drop before is saved. Raises UserError."""
        self.archive.check(scene)
        self.session.drop(scene, finish_current=True)

    # what viewers see

    def _draw(self) -> None:
        """Draw where somebody is ready for a picture that has changed."""
        self._wanted |= self.view_state.take_wanted()
        session = self.session
        scene, snapshot = session.scene, session.snapshot
        for tone in tuple(self._wanted):
            look = replace(self._look, theme=tone)
            readouts = _as_json(self._numbers.at(snapshot.time, session.so_far))
            key = (session.number, snapshot.time, look, readouts)
            if self._drawn.get(tone) != key:
                self._drawn[tone] = key
                self._wanted.discard(tone)
                self.view_state.set_picture(tone, _picture(snapshot, scene, look, readouts))

    def _post_numbers(self) -> None:
        session = self.session
        at_rest = session.settled or session.ended
        self._numbers.read(session.so_far, session.result is not None, at_rest)
        self.view_state.set_curve(self._numbers.curve)
        self._post_standing(self._numbers)

    def _post_standing(self, numbers: Numbers) -> None:
        """Post how the drop stands, and its numbers."""
        session = self.session
        told = {"state": session.state, "waiting": session.waiting, "message": session.message}
        self.view_state.post("numbers", told | numbers.told())

    def _post_scene(self) -> None:
        scene, controls = self.session.scene, self.controls
        known = reference_of(scene)
        is_described = controls.describes(scene)
        title, changes = scene.name, []
        if is_described:
            title, changes = heading(scene, controls.given, controls.changes(scene))
        told = {
            "drop": self.session.number,
            "name": title,
            "changes": changes,
            "size": _size(scene),
            "key": _colour_key(scene, self._look.mode),
            "measured": {"test": known.name, **known.figures} if known else None,
            "nodes": [scene.block.columns, scene.block.rows],
            "falls": scene.impactor is not None,
            "controlled": is_described,
        }
        self.view_state.post("scene", told)
        self._post_chart()

    def _post_chart(self) -> None:
        if self.charts.chart is not None:
            self.view_state.post("chart", self.charts.chart.told(self.session.scene))

    def _post_settings(self) -> None:
        told = {
            "shape": self._shape,
            "values": self._draft,
            "pace": self.session.pace,
            "mode": self._look.mode,
            "theme": self._theme,
            "grid": self._look.grid,
        }
        # a control's value is dropped as it was set
        self.view_state.post("settings", told, digits=None)

    def _post_drops(self) -> None:
        self.view_state.post("drops", self.archive.told())
        self.view_state.post("curves", self.archive.curves())

    def _hello(self) -> dict[str, Any]:
        files = archive.FILES | archive.FILMS
        return {
            "controls": self.controls.told(),
            "modes": [[name, mode.about] for name, mode in MODES.items()],
            "paces": PACES,
            "step": STEP,
            "figures": FIGURES,
            "energies": [words for words, _ in ENERGIES],
            "drop_figures": shown(archive.FIGURES),
            "cushion": {**self.charts.told(), "most_pasted": commands.MOST_PASTED},
            "files": [[name, *words] for name, words in files.items() if any(words)],
        }


def _as_json(content: dict[str, Any], digits: int | None = DIGITS) -> str:
    """A message's text; `digits` are those that its floats keep, None: all."""
    return json.dumps(plain(content, digits), separators=(",", ":"), allow_nan=False)


def _size(scene: Scene) -> tuple[int, int]:
    """Width and height [pixels] that show the whole window of a scene with little around it."""
    world = window(scene)
    shape = (world.x_max - world.x_min) / (world.y_max - world.y_min)
    width = (PIXELS * min(max(shape, TALLEST), WIDEST)) ** 0.5
    return 2 * round(width / 2), 2 * round(PIXELS / width / 2)


def _picture(snapshot: Snapshot, scene: Scene, look: Look, readouts: str) -> bytes:
    """A picture as it is sent: `LENGTH`, the JSON of what is read out beside it, then a PNG.

    They travel together, so that all that is shown is of one instant.

    At 960 x 540 and its like a PNG takes 36 kB and 8 ms, a JPEG as sharp 95 kB and 3 ms, a WebP
    that blurs lines 47 kB and 8 ms: flat colours suit PNG, and a phone or a tunnel feels the bytes.
    """
    image = raster.frame(snapshot, scene, _size(scene), look=look, threads=1)
    head = readouts.encode()
    file = io.BytesIO()
    file.write(LENGTH.pack(len(head)) + head)
    Image.fromarray(image).save(file, "PNG", compress_level=1)
    return file.getvalue()


def _colour_key(scene: Scene, mode: str) -> dict[str, Any]:
    """The colour key: words, colours from nothing to the most, and where ticks stand (0 to 1)."""
    key = Look(mode=mode).shown.key(scene)
    colours = shades(key.shades)
    picked = [colours[round(255 * k / (STOPS - 1))] for k in range(STOPS)]
    return {
        "words": " ".join(key.words),
        "colours": [f"#{r:02x}{g:02x}{b:02x}" for r, g, b in picked],
        "ticks": [[round(key.share(value), 4), text] for value, text in key.ticks],
    }
