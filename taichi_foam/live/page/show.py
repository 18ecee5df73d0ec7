"""The one show that all viewers share: a session, and the thread that keeps it and its board."""

from __future__ import annotations

import threading
import time
import traceback
from pathlib import Path
from typing import TYPE_CHECKING, Any

from taichi_foam.errors import UserError
from taichi_foam.live.messages import Died, Ended, Event, Failed, Frame, NothingYet, Refused
from taichi_foam.live.page import commands, figures, painter
from taichi_foam.live.page.archive import Archive
from taichi_foam.live.page.board import Board, Tone
from taichi_foam.live.page.controls import Controls, Value
from taichi_foam.live.page.readings import Readings
from taichi_foam.live.session import Session
from taichi_foam.live.stage import PACE
from taichi_foam.picture.look import Look
from taichi_foam.picture.modes import MODES
from taichi_foam.shim2000 import tests
from taichi_foam.shim2000.compare import measured_figures
from taichi_foam.version import __version__

if TYPE_CHECKING:
    from taichi_foam.records.snapshot import Snapshot
    from taichi_foam.scene import Scene

PACES = (0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 1.0, None)
STEP = 2e-4  # [s]

#: Between two pictures, between two sets of numbers, and between looks when nobody watches [s].
PICTURE_SECONDS, NUMBER_SECONDS, IDLE_SECONDS = 1 / 30, 0.1, 1.0
#: How long a drop may take to say what it has given when it is cut short [s].
PATIENCE = 20.0
#: Lattices of different sizes that one process computes: it keeps some 70 MB for each.
MOST_SIZES = 4


class Show:
    """Drops scenes one after another, and keeps the board that viewers read.

    Everything happens in one thread, which alone touches the session and draws.
    """

    def __init__(
        self, scene: Scene, out: Path, arch: str = "cpu", threads: int | None = None
    ) -> None:
        self.board = Board()
        self.controls = Controls(scene)
        self.archive = Archive(out, scene.name, self._list)
        self.watchers = 0  # viewers who are there; set by whoever knows
        self.refusal: str | None = None  # why nothing can be computed here
        self.began = threading.Event()  # the first frame, or a refusal, is there
        self.lost: dict[int, str] = {}  # drops that ran but gave nothing back, and why
        self._arch, self._threads = arch, threads
        self._session: Session | None = None
        self._number = 0  # of the current drop; goes on when a session is replaced
        self._offset = 0  # between that and the session's own
        self._sizes: set[tuple[int, int]] = set()  # columns and rows that the session has met
        self._scene = scene
        self._shape, self._draft = self.controls.shape, dict(self.controls.defaults)
        self._pace: float | None = PACE
        self._look = Look(scene.output.mode, words=False)
        self._theme = "auto"
        self._snapshot: Snapshot | None = None
        self._readings = Readings(0, scene)
        self._state, self._message = "preparing", ""
        self._drawn: dict[Tone, tuple[Any, ...]] = {}
        self._wanted: set[Tone] = set()
        self._next_look = self._next_numbers = 0.0  # on the monotonic clock [s]
        self._cut: list[int] = []  # drops that closing has cut short
        self._inbox = commands.Inbox()
        self._is_closing = threading.Event()
        self._thread = threading.Thread(target=self._keep, name="show", daemon=True)

    def start(self) -> None:
        """Drop the scene."""
        self._thread.start()

    def tell(self, command: commands.Shared, reply: commands.Reply) -> None:
        """Do this soon; `reply` hears, in the show's thread, what speaks against it.

        A viewer uses the same `reply` each time.
        """
        if not self._inbox.put(command, reply):
            reply("too much at once; try again")

    def close(self) -> list[int]:
        """End the drop, save what it gave, and return the drops that were cut short by this."""
        self._is_closing.set()
        self._thread.join()
        return self._cut

    def _keep(self) -> None:
        """The thread: listens to viewers and to the session in turn."""
        self.board.post("hello", self._hello())
        self._post_settings()
        self._list()
        try:
            self._begin(self._scene, _start_of(self._scene))
        except Exception as error:
            self._fail(f"{type(error).__name__}: {error}")
        while not self._is_closing.is_set():
            try:
                self._turn()
            except Exception as error:
                # viewers are told, and the next drop gets its chance
                self._fail(f"{type(error).__name__}: {error}")
                self._is_closing.wait(NUMBER_SECONDS)
        self._leave()

    def _turn(self) -> None:
        """Listen, look and tell, each if it is due."""
        if self._obey():
            self._next_look = 0.0
        now = time.monotonic()
        if now >= self._next_look:
            if self._session is not None:
                self._session.ask()
            goes = self._state in ("preparing", "running")
            self._next_look = now + (PICTURE_SECONDS if goes and self.watchers else IDLE_SECONDS)
        self._hear(max(0.002, min(self._next_look, self._next_numbers) - now))
        self._draw()
        now = time.monotonic()
        if now >= self._next_numbers:
            self._tell_numbers()
            # a history that takes long to go through is gone through more rarely
            took = time.monotonic() - now
            usual = NUMBER_SECONDS if self.watchers else IDLE_SECONDS
            self._next_numbers = now + min(max(usual, 5.0 * took), IDLE_SECONDS)

    def _fail(self, message: str) -> None:
        """Something that must not be has been: say so, on stderr in full, and once."""
        if message != self._message:
            traceback.print_exc()
        self._state, self._message = "failed", message
        empty = Readings(self._number, self._scene).told()
        self.board.post("numbers", {"state": "failed", "message": message, **empty})

    # what goes on

    def _begin(self, scene: Scene, start: Snapshot) -> None:
        """Drop a scene, which starts like this; what went on before has been seen to."""
        session = self._session_for(scene)
        if session is None:
            self._number += 1
        else:
            session.pace = self._pace
            self._number = session.start(scene) + self._offset
            self._state, self._message = "preparing", ""
        self._scene, self._snapshot = scene, start
        self._readings = Readings(self._number, scene)
        self._post_scene()

    def _session_for(self, scene: Scene) -> Session | None:
        """A session that computes a scene; None, and why on the page, if none can be started."""
        size = (scene.block.columns, scene.block.rows)
        is_full = len(self._sizes | {size}) > MOST_SIZES
        if self._session is None or not self._session.alive or is_full:
            self._let_go()
            try:
                self._session = Session(self._arch, self._threads)
            except Exception as error:
                self._state = "died"
                self._message = f"the process that computes cannot be started: {error}"
                self.began.set()
                return None
            self._offset = self._number
        self._sizes.add(size)
        return self._session

    def _let_go(self) -> None:
        """End the session, if there is one; it is of no more use."""
        if self._session is not None:
            self._session.close()
        self._session, self._sizes = None, set()

    def _cut_short(self) -> bool:
        """End what goes on and keep what it gave; whether there was something."""
        session = self._session
        if session is None or session.ended or not session.alive or session.last is None:
            return False  # not begun, or over and kept
        result = session.finish(PATIENCE)
        # poll tells of it once more, or of why there is none
        self._hear(0.0)
        if result is None and session.alive and not session.ended:
            self.lost[self._number] = f"no answer within {PATIENCE:.0f} s"
        return result is not None

    def _leave(self) -> None:
        self._hear(0.0)
        if self._cut_short():
            self._cut.append(self._number)
        self._let_go()

    def _hear(self, wait: float) -> None:
        """Take what comes from the session within so many seconds."""
        if self._session is None or not self._session.alive:
            self._is_closing.wait(min(wait, NUMBER_SECONDS))
        if self._session is not None:
            for event in self._session.poll(min(wait, NUMBER_SECONDS)):
                self._take(event)

    def _take(self, event: Event) -> None:
        match event:
            case Frame():
                self._snapshot = event.snapshot
                self._readings.take(event)
                if self._state in ("preparing", "running", "paused") and not event.ended:
                    self._state = "paused" if event.paused else "running"
                self.began.set()
            case Ended(_, result):
                number = event.drop + self._offset
                cut = result.run["interrupted"]
                self._keep_result(number, result, "cut short" if cut else result.run["ended_by"])
                if number == self._number:
                    self._state = "cut short" if cut else "ended"
            case Failed(_, message, result):
                self._state, self._message = "failed", message
                if result is not None:
                    self._keep_result(event.drop + self._offset, result, "failed")
            case NothingYet():
                self._state = "cut short"
            case Refused(message):
                self._state, self._message = "failed", message
                self.refusal = message
            case Died(message):
                if self._state in ("running", "paused"):
                    self.lost[self._number] = message
                self._state, self._message = "died", message
        if not isinstance(event, Frame):
            self.began.set()

    def _keep_result(self, number: int, result: Any, ended: str) -> None:
        self.lost.pop(number, None)  # late, but here
        about = self.controls.changes(result.scene)
        self.archive.add(number, about, ended, result)
        if number == self._number:
            self._readings.finish(result)
            self._snapshot = result.snapshots[-1]

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
                # what one viewer can bring about is no matter of the others
                traceback.print_exc()
                reply(f"{type(error).__name__}: {error}")
        if taken:
            self._post_settings()
        return any(not isinstance(command, commands.Set) for command, _ in taken)

    def _do(self, command: commands.Shared) -> None:
        """Raises UserError for what cannot be."""
        match command:
            case commands.Set(shape=shape, values=values):
                self.controls.check(shape, values)
                self._shape = shape
                self._draft.update(values)
            case commands.Let(shape=shape, values=values):
                self._drop_these(shape, {**self._draft, **values})
            case commands.Reset():
                self._drop_these(self.controls.shape, self.controls.defaults)
            case commands.Pause(on=on) if self._session is not None:
                self._session.pause() if on else self._session.resume()
            case commands.Step(seconds=seconds) if self._session is not None:
                self._session.step(seconds)
            case commands.Pace(rate=rate):
                self._pace = rate
                if self._session is not None:
                    self._session.pace = rate
            case commands.Looks(mode=mode, theme=theme, grid=grid):
                self._look, self._theme = Look(mode, grid=grid, words=False), theme
                self._post_scene()
            case commands.Save():
                self.archive.try_again()

    def _drop_these(self, shape: str, values: dict[str, Value]) -> None:
        scene = self.controls.scene_of(shape, values)
        self.archive.check(scene)
        start = _start_of(scene)
        # nothing of the scene speaks against it: only now the drop that goes on is ended
        self._cut_short()
        self._shape, self._draft = shape, dict(values)
        self._begin(scene, start)

    # what viewers see

    def _draw(self) -> None:
        """Draw where somebody is ready for a picture that has changed."""
        self._wanted |= self.board.take_wanted()
        snapshot = self._snapshot
        for tone in tuple(self._wanted):
            look = Look(self._look.mode, tone, self._look.grid, words=False)
            if snapshot is None:
                continue
            key = (self._number, snapshot.time, look)
            if self._drawn.get(tone) == key:
                continue
            self._drawn[tone] = key
            self._wanted.discard(tone)
            self.board.hang(tone, painter.draw(snapshot, self._scene, look, self._number))

    def _tell_numbers(self) -> None:
        told = {"state": self._state, "message": self._message, **self._readings.told()}
        self.board.plot(self._readings.curve)
        self.board.post("numbers", told)

    def _post_scene(self) -> None:
        scene, given = self._scene, self.controls.given
        block, test = scene.block, tests.test_of(scene)
        self.board.post(
            "scene",
            {
                "drop": self._number,
                # the changes stand beside it: those that make it another impact take the title away
                "name": tests.title(given) if test == tests.test_of(given) else given.name,
                "changes": self.controls.changes(scene),
                "size": painter.size_of(scene),
                "key": painter.key_of(scene, self._look.mode),
                "measured": {"test": test.name, **measured_figures(test)} if test else None,
                "latest_end": scene.numerics.latest_end,
                "nodes": [block.columns, block.rows],
                "falls": scene.impactor is not None,
            },
        )

    def _post_settings(self) -> None:
        self.board.post(
            "settings",
            {
                "shape": self._shape,
                "values": self._draft,
                "pace": self._pace,
                "mode": self._look.mode,
                "theme": self._theme,
                "grid": self._look.grid,
            },
        )

    def _list(self) -> None:
        self.board.post("drops", self.archive.told())
        self.board.post("curves", self.archive.curves())

    def _hello(self) -> dict[str, Any]:
        return {
            "version": __version__,
            "controls": self.controls.told(),
            "modes": [[name, mode.about] for name, mode in MODES.items()],
            "paces": PACES,
            "step": STEP,
            "figures": figures.FIGURES,
            "energies": figures.ENERGIES,
        }


def _start_of(scene: Scene) -> Snapshot:
    from taichi_foam.engine.state import initial_state

    return initial_state(scene).snapshot()
