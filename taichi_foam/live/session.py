"""A live session: drops computed in a separate process, and the state that views show.

Window, notebook cell and page are views. A view polls the session, draws its state, and calls its
methods when the user acts. The session never waits for the run, nor the run for a view.

    with Session(scene) as session:
        while not session.ended:
            session.look()
            if session.poll(1 / 30):
                show(session.snapshot)
"""

from __future__ import annotations

import atexit
import contextlib
import multiprocessing
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from types import ModuleType
from typing import TYPE_CHECKING, Literal

import numpy as np

from taichi_foam.analysis.columns import history_of
from taichi_foam.engine.state import initial_state
from taichi_foam.errors import UserError
from taichi_foam.interrupts import held_interrupts
from taichi_foam.live import worker
from taichi_foam.live.messages import (
    Command,
    Died,
    Ended,
    Event,
    Frame,
    Keeping,
    Pace,
    Pause,
    Refused,
    Start,
    Step,
)
from taichi_foam.records.ending import Ending
from taichi_foam.records.history import row_columns
from taichi_foam.results.result import Result

if TYPE_CHECKING:
    from taichi_foam.scene import Scene

#: Simulated seconds per second of watching; None: as fast as possible.
PACES = (1e-3, 2e-3, 5e-3, 1e-2, 2e-2, 5e-2, 1e-1, 1.0, None)
#: The initial pace: an impact of 50 ms takes five seconds.
PACE = 1e-2
#: How long a drop that is cut short may take to deliver its result [s].
PATIENCE = 30.0
#: How many lattice sizes one process computes: it keeps some 70 MB for each.
MOST_SIZES = 4
#: Text shown while a drop is being prepared.
WAITING = "loading kernels: 2 to 3 s, or 10 to 20 s once if they have to be compiled"
# A worker that has not exited this long after it was asked to is terminated [s].
GRACE = 2.0
# A poll without a worker waits no longer than this [s].
_TURN = 0.1
# A drop at rest sends no more frames. After a command the next frame may still be from before the
# command; the one after that is not.
_UNSETTLED = 2

State = Literal["preparing", "running", "paused", "ended", "cut short", "failed", "died"]


@dataclass(frozen=True)
class Outcome:
    """The result of a drop, and how it ended: "cut short", "failed", or as its record says."""

    drop: int
    result: Result
    ended: str


Keep = Callable[[Outcome], object]


class Session:
    """Drops scenes, one after another. Only one thread may call it; any may read attributes.

    `keep` receives the outcome of every drop that ends by itself, fails, or is finished. If it
    raises UserError or OSError, the outcome stays here, and no further drop starts until `keep`
    has accepted it.

    given    the initial scene
    scene    scene of the current drop
    next     the scene that `restart` drops: `scene`, unless another one waits to be dropped
    number   number of the current drop, 0 before the first
    paused   whether the drop is paused, or will be after the requested step
    pace     simulated seconds per second of watching; None: as fast as possible
    message  why the current drop failed; empty if it has not
    frame    its last frame, None before the first
    snapshot its latest instant
    result   its result, once it is over
    refusal  why nothing can be computed here, such as a missing device; None if it can
    failures reasons of the failed drops
    lost     drops that ran but returned no result, and why
    unkept   outcomes that `keep` has not accepted yet
    problem  why not, from the exception of `keep`; empty if there is none
    was_cut  whether the last result was cut short
    """

    def __init__(
        self,
        scene: Scene,
        keep: Keep = lambda outcome: None,
        *,
        arch: str = "cpu",
        threads: int | None = None,
        pace: float | None = PACE,
        keeping: Callable[[Scene], Keeping | None] = lambda scene: None,
    ) -> None:
        """Nothing runs before the first `drop`; `with` drops `scene` on entering.

        `keeping` returns where a drop writes its checkpoints; None: nowhere.
        """
        self.given = self.scene = self.next = scene
        self.number = 0
        self.paused = False
        self.message = ""
        self.frame: Frame | None = None
        self.snapshot = initial_state(scene).snapshot()
        self.result: Result | None = None
        self.refusal: str | None = None
        self.failures: list[str] = []
        self.lost: dict[int, str] = {}
        self.unkept: list[Outcome] = []
        self.problem = ""
        self.was_cut = False
        self._keep = keep
        self._keeping = keeping
        self._settings = (arch, threads)
        self._worker: _Worker | None = None
        self._sizes: set[tuple[int, int]] = set()  # columns and rows that the worker has computed
        self._start = self.snapshot  # the first instant of `next`
        self._is_due = False  # `next` waits for the current drop's preparation to end
        self._is_computed = False  # the worker will send more about the current drop
        self._over: State | None = None  # how the current drop ended
        self._rows: list[np.ndarray] = []
        self._so_far: Result | None = None  # until there is a `result`
        self._is_asked = False  # a frame was requested and has not come yet
        self._unsettled = _UNSETTLED
        self.tell(Pace(pace))

    def __enter__(self) -> Session:
        self.drop(self.given)
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """End the worker process; call `finish` first to keep what it has computed."""
        if self._worker is not None:
            self._worker.close()
        self._worker, self._sizes = None, set()
        self._is_computed = False

    # state

    def poll(self, timeout: float) -> list[Event]:
        """Process pending events, waiting up to `timeout` [s] for one, and return them.

        Events of earlier drops are ignored, except their final outcomes.
        """
        events = self._receive(timeout)
        if self._is_due and not self._is_preparing:
            self._begin()
        if not events and not self.alive:
            time.sleep(min(timeout, _TURN))
        return events

    def look(self) -> None:
        """Request a frame, unless one is already requested or the drop is settled."""
        if not self._is_asked and not self.settled:
            self._is_asked = True
            self._send("ask")

    @property
    def alive(self) -> bool:
        return self._worker is not None and self._worker.alive

    @property
    def settled(self) -> bool:
        """Whether the drop is paused or over, and `snapshot` is up to date."""
        return self._worker is None or self._unsettled <= 0

    @property
    def state(self) -> State:
        if self._over is not None:
            return self._over
        if self.frame is None:
            return "preparing"
        return "paused" if self.paused else "running"

    @property
    def waiting(self) -> str:
        """What the current drop waits for; empty once it has begun."""
        return WAITING if self.state == "preparing" else ""

    @property
    def ended(self) -> bool:
        return self._over is not None

    @property
    def rows(self) -> np.ndarray:
        """Rows (n, k) of the current drop's history, for `analysis.columns.history_of`."""
        if len(self._rows) != 1:
            none = np.empty((0, len(row_columns(self.scene.turns))))
            self._rows = [np.concatenate([none, *self._rows])]
        return self._rows[0]

    @property
    def so_far(self) -> Result:
        """The current drop's result so far; the same object until there is more."""
        if self.result is not None:
            return self.result
        rows = self.rows
        if self._so_far is None or len(self._so_far.history["time_s"]) != len(rows):
            history = history_of(self.scene, rows)
            self._so_far = Result(self.scene, history, [self.snapshot], {})
        return self._so_far

    def _receive(self, timeout: float) -> list[Event]:
        if self._worker is None:
            return []
        return [event for event in self._worker.events(timeout) if self._take(event)]

    def _take(self, event: Event) -> bool:
        """Process an event; return whether `poll` should return it."""
        is_current = isinstance(event, (Refused, Died)) or event.drop == self.number
        if isinstance(event, Frame):
            self._is_asked = False
        elif is_current:
            self._is_computed = False
        match event:
            case Frame() if is_current:
                self.frame, self.snapshot = event, event.snapshot
                self._rows.append(event.rows)
                is_at_rest = event.paused or event.ended
                self._unsettled = self._unsettled - 1 if is_at_rest else _UNSETTLED
            case Ended(drop, result, None):
                is_cut = result is None or result.ending is Ending.INTERRUPTED
                if is_current:
                    self._over = "cut short" if is_cut else "ended"
                if result is not None:
                    how = "cut short" if is_cut else result.run["ended_by"]
                    self._put(Outcome(drop, result, how))
                return True
            case Ended(drop, result, str(failure)) if is_current:
                self.fail(failure)
                self.failures.append(failure)
                if result is not None:
                    self._put(Outcome(drop, result, "failed"))
            case Refused(message):
                self.refusal = message  # set first: it is read as soon as the state changes
                self.fail(message)
            case Died(message):
                if self.state in ("running", "paused"):
                    self.lost[self.number] = message
                self._over, self.message = "died", message
        return is_current

    def fail(self, message: str) -> None:
        """Mark the current drop as failed; drawing it may have failed, too."""
        self._over, self.message = "failed", message

    def _put(self, outcome: Outcome) -> None:
        """Pass an outcome to `keep`, or hold it here."""
        self.lost.pop(outcome.drop, None)  # it came after all
        if outcome.drop == self.number:
            self.result = outcome.result
        self.was_cut = outcome.result.ending is Ending.INTERRUPTED
        self.unkept.append(outcome)
        self.save()

    def save(self) -> None:
        """Pass all unkept outcomes to `keep`. Ctrl-C waits until a result is complete."""
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

    # commands

    def drop(self, scene: Scene, finish_current: bool = False) -> None:
        """Drop a scene; the current drop is abandoned, or finished and kept.

        While one drop is being prepared the next one waits, and the latest request wins: a key
        that is held down does not pile up drops. A dead worker process is replaced. Raises
        UserError for a scene that cannot start; the current drop then continues.
        """
        start = initial_state(scene).snapshot()
        if finish_current:
            self.finish()
        self.save()
        self.next, self._start = scene, start
        self._is_due = not self.problem
        if self._is_due and not self._is_preparing:
            self._begin()

    def restart(self) -> None:
        """Drop the same scene again, from the start."""
        self.drop(self.next)

    def finish(self) -> bool:
        """End the current drop now and keep everything; return whether this cut it short."""
        self._is_due = False
        self.poll(0.0)  # it may have ended already, with the event still pending
        has_begun = self._is_computed and self.frame is not None
        try:
            if has_begun:
                self._send("finish")
                until = time.monotonic() + PATIENCE
                while self._is_computed and (left := until - time.monotonic()) > 0.0:
                    self._receive(left)
        finally:  # after Ctrl-C, too, what has arrived is kept
            self._receive(0.0)
            self.save()
        if has_begun and self._is_computed:
            self.lost[self.number] = f"no answer within {PATIENCE:.0f} s"
        return has_begun and self.result is not None

    def tell(self, command: Pause | Step | Pace) -> None:
        """Pause or continue the drop, advance it by a step, or change its pace.

        A pace also applies to later drops. Raises ValueError unless a step or a pace is above 0.
        """
        match command:
            case Pause(on):
                self.paused = on
            case Step(seconds):
                if not seconds > 0.0:
                    raise ValueError(f"step = {seconds}: must be above 0 s")
                self.paused = True
            case Pace(rate):
                if rate is not None and not rate > 0.0:
                    raise ValueError(f"pace = {rate}: must be above 0, or None")
                self.pace = rate
        self._send(command)

    def change_pace(self, by: int) -> None:
        """Change to the next faster (1) or slower (-1) pace."""
        place = PACES.index(self.pace) if self.pace in PACES else PACES.index(PACE)
        self.tell(Pace(PACES[min(max(place + by, 0), len(PACES) - 1)]))

    @property
    def _is_preparing(self) -> bool:
        return self.alive and self._is_computed and self.frame is None

    def _begin(self) -> None:
        """Drop `next`; the caller has already dealt with the previous drop."""
        self._is_due = self.paused = False
        self.scene, self.snapshot = self.next, self._start
        self._over, self.message = None, ""
        self.frame = self.result = self._so_far = None
        self._rows = []
        self.number += 1
        size = (self.scene.block.columns, self.scene.block.rows)
        if not self.alive or len(self._sizes | {size}) > MOST_SIZES:
            self.close()
            try:
                self._worker = _Worker(*self._settings)
            except Exception as error:
                self._over = "died"
                self.message = f"the computing process cannot be started: {error}"
                return
            self._is_asked = False
            self._send(Pace(self.pace))
        self._sizes.add(size)
        self._is_computed = True
        self._send(Start(self.number, self.scene, self._keeping(self.scene)))

    def _send(self, command: Command) -> None:
        """Send a command, if there is a worker."""
        if command != "ask":
            self._unsettled = _UNSETTLED
        if self._worker is not None:
            self._worker.send(command)


class _Worker:
    """The worker process, and this end of the pipe to it."""

    def __init__(self, arch: str, threads: int | None) -> None:
        self._is_lost = False  # the pipe delivers nothing any more
        context = multiprocessing.get_context("spawn")
        self._pipe, far_end = context.Pipe()
        self.process = context.Process(
            target=worker.main, args=(far_end, arch, threads), name="taichi-foam", daemon=True
        )
        with _hidden_script():
            self.process.start()
        far_end.close()  # else this process would keep the pipe of a dead worker open
        # The worker ignores SIGTERM and similar signals: it has to be asked to exit.
        atexit.register(self.close)

    @property
    def alive(self) -> bool:
        return not self._is_lost and self.process.is_alive()

    def send(self, command: Command) -> None:
        """Send a command; if the process has died, `events` reports it."""
        if not self._is_lost:
            with contextlib.suppress(OSError):
                self._pipe.send(command)

    def events(self, timeout: float) -> Iterator[Event]:
        """Yield pending events in order, waiting up to `timeout` [s] for the first."""
        try:
            while not self._is_lost and self._pipe.poll(timeout):
                yield self._pipe.recv()
                timeout = 0.0
        except (EOFError, OSError):
            self._is_lost = True
            self.process.join(GRACE)
            how = f"with exit code {self.process.exitcode}"
            if self.process.exitcode is not None and self.process.exitcode < 0:
                how = f"by signal {-self.process.exitcode}"
            yield Died(f"the computing process ended {how}")

    def close(self) -> None:
        """End the process; kill it after `GRACE` if necessary."""
        self.send("close")
        self._is_lost = True
        atexit.unregister(self.close)
        self.process.join(GRACE)
        if self.process.is_alive():
            self.process.kill()
            self.process.join()
        self._pipe.close()


@contextlib.contextmanager
def _hidden_script() -> Iterator[None]:
    """Hide the program's main module from a process that is started in the block.

    The process would otherwise run the script again from the top, with all its imports.
    """
    script = sys.modules["__main__"]
    sys.modules["__main__"] = ModuleType("__main__")
    try:
        yield
    finally:
        sys.modules["__main__"] = script
