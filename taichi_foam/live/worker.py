"""The worker process: computes one drop at a time, at a pace, and takes commands between calls.

A Taichi kernel holds the interpreter's lock, so a viewer in the same process would freeze while it
computes. Ctrl-C reaches both processes, and the viewer decides what it means; slow imports are done
after this process has begun to ignore Ctrl-C.
"""

from __future__ import annotations

import contextlib
import math
import queue
import threading
import time
from multiprocessing.reduction import ForkingPickler
from typing import TYPE_CHECKING

from taichi_foam import interrupts
from taichi_foam.errors import UserError
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

# Length of a call of the engine [s]; the worker takes commands between calls.
CALL_SECONDS = 0.01

# A run that has fallen behind its pace catches up by no more than this [s].
MOST_BEHIND = 0.1


def main(pipe: Connection, arch: str, threads: int | None) -> None:
    """Carry out commands from the pipe, until "close" or until the viewer is gone.

    The signals of Ctrl-C, a closed terminal and a stopped service go to the viewer's whole process
    group. The viewer decides what they mean: it may want the data so far first.
    """
    interrupts.ignore()
    _Worker(pipe, arch, threads).serve()


class _Worker:
    def __init__(self, pipe: Connection, arch: str, threads: int | None) -> None:
        self._pipe = pipe
        self._arch, self._threads = arch, threads
        self._send = _Sender(pipe)
        self._number = 0
        self._drop: Drop | None = None
        self._is_over = True  # the drop has ended
        self._rows_sent = 0
        self._is_asked = False
        self._shown: Snapshot | None = None  # snapshot of the drop's last frame
        self._is_paused = False
        self._step_to: float | None = None  # simulated time [s] at which a Step ends
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
            self._drop.save_checkpoint()  # the viewer is gone, and has not asked for the result

    def _listen(self, wait: float | None) -> bool:
        """Carry out commands, waiting up to `wait` [s] for one; return False if none will come."""
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
        """Time [s] in which there is nothing to do without a command; None: forever."""
        if self._drop is None:
            return None
        if self._is_asked and (self._stands_still or self._shown is None):
            return 0.0
        if self._stands_still:
            return None
        return 0.0 if self._step_to is not None else self._pace.idle_seconds(self._drop.time)

    def _due(self, drop: Drop) -> float:
        """The time at which the row of the shown instant was due [s]; Steps are counted from it.

        The row was taken a little later, at the end of a step; these delays must not add up.
        """
        shown = drop.time if self._shown is None else self._shown.time
        interval = drop.scene.output.history_interval
        return interval * math.floor(shown / interval + 1e-9)

    def _shows_last_row(self, drop: Drop) -> bool:
        """Whether the last frame sent is as recent as the history."""
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
        """Answer a request, then compute for one call."""
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
            # even at rest a frame shows an instant of the history: the next one is near
            is_urgent = is_still or self._shown is None
            snapshot = drop.catch(CALL_SECONDS, math.inf if is_urgent else until)
            if snapshot is not None:
                self._answer(drop, snapshot)
        if self._step_to is not None and drop.time >= self._step_to:
            self._step_to = None
        if drop.ended:
            self._end(drop.failure)

    def _end(self, failure: str | None = None) -> None:
        """End the drop, and send its result so far."""
        self._is_over = True
        self._send(Ended(self._number, self._result(), failure))

    def _fail(self, error: Exception) -> None:
        """End the drop after an unexpected error, and send its result so far."""
        result = None
        with contextlib.suppress(Exception):  # the same error may occur here, too
            result = self._result()
        self._leave_drop()
        words = f"{type(error).__name__}: {error}".rstrip(": ")
        self._send(Ended(self._number, result, words))

    def _result(self) -> Result | None:
        """The drop's result so far, if there is any."""
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
        """Send a frame of this instant, with the new rows."""
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
    """Keeps simulated time in step with wall time, from an instant at which both were set."""

    def __init__(self) -> None:
        self.rate: float | None = None  # simulated seconds per second of wall time
        self._time = 0.0  # [s]
        self._wall = 0.0  # [s]

    def anchor(self, reached: float) -> None:
        """Set simulated time `reached` [s] to correspond to now."""
        self._time, self._wall = reached, time.monotonic()

    def due(self, reached: float) -> float:
        """The simulated time that a run, now at `reached` [s], should have reached by now [s]."""
        if self.rate is None:
            return math.inf
        due = self._time + self.rate * (time.monotonic() - self._wall)
        if due - reached > self.rate * MOST_BEHIND:
            self.anchor(reached)
            self._wall -= MOST_BEHIND
            due = reached + self.rate * MOST_BEHIND
        return due

    def idle_seconds(self, reached: float) -> float:
        """Wall time until a run at `reached` [s] is due for another call [s]."""
        if self.rate is None:
            return 0.0
        ahead = (reached - self._time) / self.rate - (time.monotonic() - self._wall)
        return max(ahead + CALL_SECONDS, 0.0)


class _Sender:
    """Sends events without waiting for the viewer to receive them.

    A frame of a large lattice does not fit into the pipe; a thread waits while the run continues.
    """

    def __init__(self, pipe: Connection) -> None:
        self._pipe = pipe
        self._waiting: queue.SimpleQueue[Event] = queue.SimpleQueue()
        self._is_taken = threading.Event()
        threading.Thread(target=self._serve, daemon=True).start()

    def __call__(self, event: Event) -> None:
        self._is_taken.clear()
        self._waiting.put(event)
        # the next call of the engine would block the interpreter and keep the thread from sending
        self._is_taken.wait(CALL_SECONDS)

    def _serve(self) -> None:
        with contextlib.suppress(OSError):  # the viewer is gone: the other thread notices
            while True:
                data = ForkingPickler.dumps(self._waiting.get())
                self._is_taken.set()
                self._pipe.send_bytes(data)
