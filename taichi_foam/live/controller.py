"""The controller of live drops. Window, notebook cell and page are its views.

It holds the session, the scene that is dropped, how the drop goes, and what it has given. A view
polls it, draws what it holds, and calls it for what people ask for.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from taichi_foam.analysis.columns import history_of
from taichi_foam.engine.state import initial_state
from taichi_foam.errors import UserError
from taichi_foam.interrupts import held_interrupts
from taichi_foam.laws.shape import SHAPES
from taichi_foam.live.messages import (
    Died,
    Ended,
    Event,
    Failed,
    Frame,
    Keeping,
    NothingYet,
    Refused,
)
from taichi_foam.live.session import Session
from taichi_foam.records.ending import Ending
from taichi_foam.records.history import row_columns
from taichi_foam.results.result import Result

if TYPE_CHECKING:
    from taichi_foam.scene import Scene

#: Simulated seconds in one of watching; None: as fast as it goes.
PACES = (1e-3, 2e-3, 5e-3, 1e-2, 2e-2, 5e-2, 1e-1, 1.0, None)
#: The pace at first: an impact of 50 ms takes five seconds.
PACE = 1e-2
#: How long a drop that is cut short may take to hand over what there is [s].
PATIENCE = 30.0
#: Lattices of different sizes that one process computes: it keeps some 70 MB for each.
MOST_SIZES = 4
#: What a drop that is being prepared waits for.
WAITING = "loading kernels: 2 to 3 s, or 10 to 20 s once where they have to be compiled"
# A poll of a session whose process is gone waits no longer than this [s].
_TURN = 0.1

State = Literal["preparing", "running", "paused", "ended", "cut short", "failed", "died"]


@dataclass(frozen=True)
class Outcome:
    """What a drop has given, and how it ended: "cut short", "failed", or as its record says."""

    drop: int
    result: Result
    ended: str


Keep = Callable[[Outcome], object]


class Controller:
    """Drops scenes, one after another. One thread calls it; attributes may be read by any.

    `keep` gets the outcome of every drop that ends by itself, fails, or is finished. What it
    cannot take (it raises UserError or OSError) stays here, and nothing more is dropped until it
    has been taken.

    given    the scene at first
    scene    of the current drop
    next     what `restart` drops: `scene`, unless another one waits to be dropped
    number   of the current drop, 0 before the first
    message  why it has failed or died; empty if it has not
    snapshot its latest instant
    result   what it gave, once it is over
    refusal  why nothing can be computed here, such as an absent device; None if it can
    failures what the drops that failed met
    lost     drops that ran but gave nothing back, and why
    unkept   outcomes that `keep` has not taken yet
    problem  why, in its words; empty if all is well
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

        `keeping` tells for each drop where it leaves checkpoints, if it is to leave some.
        """
        self.given = self.scene = self.next = scene
        self.number = 0
        self._over: State | None = None  # how the current drop ended
        self.message = ""
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
        self._pace = pace
        self._session: Session | None = None
        self._sizes: set[tuple[int, int]] = set()  # columns and rows that the session has met
        self._start = self.snapshot  # the first instant of `next`
        self._is_due = False  # `next` waits until the current drop is prepared
        self._so_far: Result | None = None  # while `result` is yet to come

    def __enter__(self) -> Controller:
        self.drop(self.given)
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """End the process that computes; see `finish` for what it has computed."""
        if self._session is not None:
            self._session.close()
        self._session, self._sizes = None, set()

    # what goes on

    def poll(self, timeout: float) -> list[Event]:
        """Take what has come, waiting up to `timeout` [s] if there is nothing, and return it."""
        session = self._session
        events = [] if session is None else session.poll(timeout)
        for event in events:
            self._take(event)
        if self._is_due and not self._is_preparing:
            self._begin()
        if not events and (session is None or not session.alive):
            time.sleep(min(timeout, _TURN))
        return events

    def look(self) -> None:
        """Ask for a frame, unless the drop is settled."""
        if self._session is not None and not self._session.settled:
            self._session.ask()

    @property
    def settled(self) -> bool:
        """Whether the drop is at rest, and `snapshot` is of that rest."""
        return self._session is None or self._session.settled

    @property
    def state(self) -> State:
        """Of the current drop."""
        if self._over is not None:
            return self._over
        if self._session is None or self._session.last is None:
            return "preparing"
        return "paused" if self._session.paused else "running"

    @property
    def waiting(self) -> str:
        """What the current drop waits for; empty once it has begun."""
        return WAITING if self.state == "preparing" else ""

    @property
    def ended(self) -> bool:
        """Whether nothing more is computed of the current drop."""
        return self._over is not None

    @property
    def paused(self) -> bool:
        """Whether the drop is meant to stand still, or will after the step that was asked for."""
        return self._session is not None and self._session.paused

    @property
    def so_far(self) -> Result:
        """What the current drop has given until now; the same object until there is more."""
        if self.result is not None:
            return self.result
        rows = np.empty((0, len(row_columns(self.scene.turns))))
        if self._session is not None:
            rows = self._session.rows
        if self._so_far is None or len(self._so_far.history["time_s"]) != len(rows):
            history = history_of(self.scene, rows)
            self._so_far = Result(self.scene, history, [self.snapshot], {})
        return self._so_far

    def _take(self, event: Event) -> None:
        match event:
            case Frame(snapshot=snapshot):
                self.snapshot = snapshot
            case Ended(drop, result):
                is_cut = result.ending is Ending.INTERRUPTED
                if drop == self.number:
                    self._over = "cut short" if is_cut else "ended"
                self._put(Outcome(drop, result, "cut short" if is_cut else result.run["ended_by"]))
            case Failed(drop, message, result):
                self.fail(message)
                self.failures.append(message)
                if result is not None:
                    self._put(Outcome(drop, result, "failed"))
            case NothingYet():
                self._over = "cut short"
            case Refused(message):
                self.refusal = message  # first: who waits for another state looks at it then
                self.fail(message)
            case Died(message):
                if self.state in ("running", "paused"):
                    self.lost[self.number] = message
                self._over, self.message = "died", message

    def fail(self, message: str) -> None:
        """The current drop has failed, in itself or in being shown."""
        self._over, self.message = "failed", message

    def _put(self, outcome: Outcome) -> None:
        """Have an outcome kept, or keep it here."""
        self.lost.pop(outcome.drop, None)  # late, but here
        if outcome.drop == self.number:
            self.result = outcome.result
        self.was_cut = outcome.result.ending is Ending.INTERRUPTED
        self.unkept.append(outcome)
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

    # what can be done

    def drop(self, scene: Scene, finish_current: bool = False) -> None:
        """Drop a scene; what goes on is given up, or finished and kept.

        While one drop is prepared the next one waits, and the last that was asked for wins: a key
        that is held down does not pile up drops. A process that is gone is replaced. Raises
        UserError for a scene that cannot start; what goes on then goes on.
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
        """Drop the same scene once more, from the start."""
        self.drop(self.next)

    def finish(self) -> bool:
        """End the current drop now and have everything kept; whether this has cut it short."""
        self._is_due = False
        self.poll(0.0)  # an end that has come, but has not been heard
        session, result = self._session, None
        try:
            if session is not None and not session.ended and session.last is not None:
                result = session.finish(PATIENCE)
        finally:
            self.poll(0.0)
            self.save()
        if session is not None and session.alive and session.last and not session.ended:
            self.lost[self.number] = f"no answer within {PATIENCE:.0f} s"
        return result is not None

    def pause(self, on: bool) -> None:
        """Stand still, or go on."""
        if self._session is not None:
            self._session.pause(on)

    def step(self, seconds: float) -> None:
        """Go on by so much simulated time, and stand still."""
        if self._session is not None:
            self._session.step(seconds)

    @property
    def pace(self) -> float | None:
        """Simulated seconds in one of watching; None: as fast as it goes."""
        return self._pace

    @pace.setter
    def pace(self, rate: float | None) -> None:
        self._pace = rate
        if self._session is not None:
            self._session.pace = rate

    def change_pace(self, by: int) -> None:
        """Faster (1) or slower (-1)."""
        place = PACES.index(self.pace) if self.pace in PACES else PACES.index(PACE)
        self.pace = PACES[min(max(place + by, 0), len(PACES) - 1)]

    @property
    def _is_preparing(self) -> bool:
        session = self._session
        return session is not None and session.alive and session.last is None and not session.ended

    def _begin(self) -> None:
        """Drop `next`; what went on before has been seen to."""
        self._is_due = False
        self.scene, self.snapshot = self.next, self._start
        self._over, self.message = None, ""
        self.result = self._so_far = None
        size = (self.scene.block.columns, self.scene.block.rows)
        is_full = len(self._sizes | {size}) > MOST_SIZES
        if self._session is None or not self._session.alive or is_full:
            self.close()
            try:
                self._session = Session(*self._settings, drops=self.number)
            except Exception as error:
                self.number += 1
                self._over = "died"
                self.message = f"the process that computes cannot be started: {error}"
                return
        self._sizes.add(size)
        self._session.pace = self.pace
        self.number = self._session.start(self.scene, self._keeping(self.scene))


def offered_shapes() -> tuple[str, ...]:
    """The shapes of impactors that a live view offers: those with sizes to change."""
    return tuple(name for name, kind in SHAPES.items() if kind.controls)
