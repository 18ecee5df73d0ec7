"""The process that computes: one drop at a time, at a pace, obeying its viewer between calls.

A Taichi kernel holds the interpreter's lock, so that a viewer in the same process would stand still
while it computes. Ctrl-C reaches both processes, and the viewer decides what it means; what takes
long to import is imported once this process ignores Ctrl-C.
"""

from __future__ import annotations

import contextlib
import math
import queue
import signal
import threading
import time
from multiprocessing.reduction import ForkingPickler
from typing import TYPE_CHECKING

from taichi_foam.errors import UserError
from taichi_foam.interrupts import SIGNALS
from taichi_foam.live.messages import (
    Command,
    Ended,
    Event,
    Frame,
    Pace,
    Pause,
    Refused,
    Start,
    Step,
)

if TYPE_CHECKING:
    from multiprocessing.connection import Connection

    from taichi_foam.records.snapshot import Snapshot
    from taichi_foam.results.result import Result
    from taichi_foam.simulation.stepwise import Drop

# Between two calls of the engine the worker listens.
CALL_SECONDS = 0.01

# A run that cannot keep its pace does not make up for more than this once it can [s].
MOST_BEHIND = 0.1


def main(pipe: Connection, arch: str, threads: int | None) -> None:
    """Do what comes through the pipe, until Close or until the viewer is gone.

    Ctrl-C, a closed terminal and the end of a service reach the viewer's whole group of processes.
    The viewer decides what they mean: it may want to have what there is first.
    """
    for number in SIGNALS:
        signal.signal(number, signal.SIG_IGN)
    _Worker(pipe, arch, threads).serve()


class _Worker:
    def __init__(self, pipe: Connection, arch: str, threads: int | None) -> None:
        self._pipe = pipe
        self._arch, self._threads = arch, threads
        self._send = _Sender(pipe)
        self._number = 0
        self._drop: Drop | None = None
        self._is_over = True  # nothing more is computed of the drop
        self._rows_sent = 0
        self._is_asked = False
        self._shown: Snapshot | None = None  # of the last frame of the drop
        self._is_paused = False
        self._step_to: float | None = None  # simulated time [s] that a Step goes to
        self._pace = _PaceMaker()

    def serve(self) -> None:
        is_wanted = True
        while is_wanted:
            try:
                is_wanted = self._listen(self._idle_seconds())
                if is_wanted:
                    self._go_on()
            except Exception as error:
                self._fail(error)
        if self._drop is not None and not self._is_over:
            self._drop.save_checkpoint()  # the viewer has gone, and not asked for what there is

    def _listen(self, wait: float | None) -> bool:
        """Do what the viewer wants, waiting so long [s] for it; False if it wants no more."""
        while True:
            try:
                if not self._pipe.poll(wait):
                    return True
                command = self._pipe.recv()
            except (EOFError, OSError):
                return False  # the viewer is gone
            if command == "close":
                return False
            self._obey(command)
            wait = 0.0

    def _idle_seconds(self) -> float | None:
        """How long there is nothing to do unless a command comes; None: for ever."""
        if self._drop is None:
            return None
        if self._is_asked and (self._stands_still or self._shown is None):
            return 0.0
        if self._stands_still:
            return None
        return 0.0 if self._step_to is not None else self._pace.idle_seconds(self._drop.time)

    def _due(self, drop: Drop) -> float:
        """When the row of the instant that is shown was due [s]: what steps count from.

        It was taken at the end of a step, a little later; such remainders must not add up.
        """
        shown = drop.time if self._shown is None else self._shown.time
        interval = drop.scene.output.history_interval
        return interval * math.floor(shown / interval + 1e-9)

    def _shows_last_row(self, drop: Drop) -> bool:
        """Whether the frame that went last is as new as the history."""
        shown = self._shown
        return shown is not None and shown.time == drop.last_row and drop.has_last_row

    @property
    def _stands_still(self) -> bool:
        return self._is_over or (self._is_paused and self._step_to is None)

    def _obey(self, command: Command) -> None:
        match command:
            case Start():
                self._start(command)
            case Pause(on):
                self._is_paused, self._step_to = on, None
                self._anchor()
            case Step(seconds) if self._drop is not None:
                start = self._due(self._drop) if self._step_to is None else self._step_to
                self._is_paused, self._step_to = True, start + seconds
            case Pace(rate):
                self._pace.rate = rate
                self._anchor()
            case "ask":
                self._is_asked = True
            case "finish" if self._drop is not None and not self._is_over:
                self._drop.save_checkpoint()
                self._end()

    def _start(self, command: Start) -> None:
        self._leave_drop()
        self._number = command.drop
        self._is_paused, self._step_to = False, None
        try:
            from taichi_foam.engine import runtime
            from taichi_foam.simulation.checkpoint import CHECKPOINT
            from taichi_foam.simulation.stepwise import Drop

            runtime.start(self._arch, self._threads)
            keeping = command.keeping
            if keeping is None:
                self._drop = Drop(command.scene)
            else:
                if not keeping.goes_on:
                    (keeping.folder / CHECKPOINT).unlink(missing_ok=True)
                folder, every = keeping.folder, keeping.every
                self._drop = Drop(command.scene, checkpoint=folder, every=every)
        except UserError as error:
            self._send(Refused(str(error)))
        except Exception as error:
            self._fail(error)
        else:
            self._is_over, self._rows_sent, self._shown = False, 0, None
            self._anchor()

    def _go_on(self) -> None:
        """Answer, then compute for one call."""
        drop = self._drop
        if drop is None:
            return
        is_still = self._stands_still
        until = self._pace.due(drop.time) if self._step_to is None else self._step_to
        if not self._is_asked:
            if is_still:
                return
            drop.advance(CALL_SECONDS, until)
        elif self._is_over or (is_still and self._shows_last_row(drop)):
            self._answer(drop, drop.now() if drop.ended or self._shown is None else self._shown)
            return
        else:
            # even at rest a frame is of an instant that the history holds: the next one is near
            is_urgent = is_still or self._shown is None
            snapshot = drop.catch(CALL_SECONDS, math.inf if is_urgent else until)
            if snapshot is not None:
                self._answer(drop, snapshot)
        if self._step_to is not None and drop.time >= self._step_to:
            self._step_to = None
        if drop.ended:
            self._end(drop.failure)

    def _end(self, failure: str | None = None) -> None:
        """Compute nothing more of the drop, and hand over what there is."""
        self._is_over = True
        self._send(Ended(self._number, self._result(), failure))

    def _fail(self, error: Exception) -> None:
        """An unexpected error ends the drop; what came before it is handed over."""
        result = None
        with contextlib.suppress(Exception):  # whatever is wrong may be wrong there, too
            result = self._result()
        self._leave_drop()
        words = f"{type(error).__name__}: {error}".rstrip(": ")
        self._send(Ended(self._number, result, words))

    def _result(self) -> Result | None:
        """What there is of the drop, if there is anything."""
        drop = self._drop
        return drop.result() if drop is not None and len(drop.rows()) else None

    def _leave_drop(self) -> None:
        if self._drop is not None:
            self._drop.close()
        self._drop, self._is_over = None, True

    def _anchor(self) -> None:
        if self._drop is not None:
            self._pace.anchor(self._drop.time)

    def _answer(self, drop: Drop, snapshot: Snapshot) -> None:
        """Send a frame of this instant, and the rows so far."""
        rows = drop.rows(self._rows_sent)
        self._rows_sent += len(rows)
        self._is_asked, self._shown = False, snapshot
        self._send(
            Frame(
                drop=self._number,
                snapshot=snapshot,
                rows=rows,
                fraction=drop.fraction,
                steps=drop.steps,
                wall=drop.wall,
                paused=self._is_paused and self._step_to is None,
                ended=self._is_over,
            )
        )


class _PaceMaker:
    """Holds simulated time to wall time, from an instant at which the two were set together."""

    def __init__(self) -> None:
        self.rate: float | None = None  # simulated seconds in one of wall time
        self._time = 0.0  # [s]
        self._wall = 0.0  # [s]

    def anchor(self, reached: float) -> None:
        """Simulated time `reached` [s] belongs to now."""
        self._time, self._wall = reached, time.monotonic()

    def due(self, reached: float) -> float:
        """How far a run that stands at `reached` [s] may be by now [s]."""
        if self.rate is None:
            return math.inf
        due = self._time + self.rate * (time.monotonic() - self._wall)
        if due - reached > self.rate * MOST_BEHIND:
            self.anchor(reached)
            self._wall -= MOST_BEHIND
            due = reached + self.rate * MOST_BEHIND
        return due

    def idle_seconds(self, reached: float) -> float:
        """Wall time until a run at `reached` [s] has a call's worth of time to catch up [s]."""
        if self.rate is None:
            return 0.0
        ahead = (reached - self._time) / self.rate - (time.monotonic() - self._wall)
        return max(ahead + CALL_SECONDS, 0.0)


class _Sender:
    """Sends events without waiting for the viewer to take them.

    A frame of a big lattice does not fit into the pipe; a thread waits there while the run goes on.
    """

    def __init__(self, pipe: Connection) -> None:
        self._pipe = pipe
        self._waiting: queue.SimpleQueue[Event] = queue.SimpleQueue()
        self._is_taken = threading.Event()
        threading.Thread(target=self._serve, daemon=True).start()

    def __call__(self, event: Event) -> None:
        self._is_taken.clear()
        self._waiting.put(event)
        # the next call of the engine would hold the interpreter and keep the thread from sending
        self._is_taken.wait(CALL_SECONDS)

    def _serve(self) -> None:
        with contextlib.suppress(OSError):  # the viewer is gone: the other thread notices
            while True:
                data = ForkingPickler.dumps(self._waiting.get())
                self._is_taken.set()
                self._pipe.send_bytes(data)
