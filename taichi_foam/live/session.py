"""A viewer's end of a run that goes on in a process of its own.

    with Session() as session:
        session.start(scene)
        while session.alive:
            session.ask()
            for event in session.poll(1 / 30):
                show(event)

Nothing here waits for the run, nor the run for the viewer. A session needs neither Taichi nor
Matplotlib.
"""

from __future__ import annotations

import atexit
import contextlib
import multiprocessing
import sys
import time
from collections.abc import Iterator
from types import ModuleType
from typing import TYPE_CHECKING

import numpy as np

from taichi_foam.live import worker
from taichi_foam.live.messages import (
    Ask,
    Close,
    Command,
    Died,
    Ended,
    Event,
    Failed,
    Finish,
    Frame,
    Keeping,
    Pace,
    Pause,
    Refused,
    Start,
    Step,
)
from taichi_foam.records.history import row_columns

if TYPE_CHECKING:
    from taichi_foam.results.result import Result
    from taichi_foam.scene import Scene

# A worker that has not left so long after it was asked is ended [s].
GRACE = 2.0

# A drop at rest sends no more frames. After a command the next frame may still be from before it,
# the one after that is not.
_UNSETTLED = 2


class Session:
    """Drops scenes, one after another, and hears how they go. One thread calls it.

    drop    number of the current drop, `drops` before the first
    paused  whether it is meant to stand still, or will after the step that was asked for
    last    its last frame
    settled whether it is at rest, and `last` is of that rest
    ended   whether nothing more is computed of it
    result  what it gave, once it has ended
    """

    def __init__(self, arch: str = "cpu", threads: int | None = None, drops: int = 0) -> None:
        """Start a worker that computes on `arch` with `threads` CPU threads (None: all).

        The first drop has the number after `drops`.
        """
        self.drop = drops
        self.paused = False
        self.last: Frame | None = None
        self.ended = True
        self.result: Result | None = None
        self._rows: list[np.ndarray] = []
        self._columns = row_columns(False)
        self._pace: float | None = None
        self._unsettled = _UNSETTLED
        self._is_asked = False
        self._is_lost = False  # nothing comes through the pipe any more
        self._is_closing = False
        self._news: list[Event] = []
        context = multiprocessing.get_context("spawn")
        self._pipe, far_end = context.Pipe()
        self._process = context.Process(
            target=worker.main, args=(far_end, arch, threads), name="taichi-foam", daemon=True
        )
        with _hidden_script():
            self._process.start()
        far_end.close()  # else this process would keep the pipe open for a worker that has died
        # The worker ignores SIGTERM and its like: it has to be asked.
        atexit.register(self.close)

    def __enter__(self) -> Session:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def start(self, scene: Scene, keeping: Keeping | None = None) -> int:
        """Drop `scene`, whatever goes on, and return the drop's number.

        It runs at once, at the pace that is set. Kernels that no drop of this session has needed
        yet take seconds to prepare; frames begin after that. With `keeping` it leaves checkpoints.
        """
        self.drop += 1
        self.last = self.result = None
        self.paused = self.ended = False
        self._rows, self._columns = [], row_columns(scene.turns)
        self._send(Start(self.drop, scene, keeping))
        return self.drop

    def pause(self, on: bool = True) -> None:
        """Stand still, or go on."""
        self.paused = on
        self._send(Pause(on))

    def step(self, seconds: float) -> None:
        """Go on by `seconds` of simulated time, as fast as it goes, and stay paused there.

        Steps that are asked for before the last one is done add up. Raises ValueError unless
        `seconds` is above 0.
        """
        if not seconds > 0.0:
            raise ValueError(f"step = {seconds}: must be above 0 s")
        self.paused = True
        self._send(Step(seconds))

    @property
    def pace(self) -> float | None:
        """Simulated seconds in a second of wall time; None: as fast as it goes.

        Setting it raises ValueError unless it is above 0.
        """
        return self._pace

    @pace.setter
    def pace(self, rate: float | None) -> None:
        if rate is not None and not rate > 0.0:
            raise ValueError(f"pace = {rate}: must be above 0, or None")
        self._pace = rate
        self._send(Pace(rate))

    def ask(self) -> None:
        """Ask for a frame, unless one is on its way."""
        if not self._is_asked:
            self._is_asked = True
            self._send(Ask())

    @property
    def settled(self) -> bool:
        return self._unsettled <= 0

    @property
    def rows(self) -> np.ndarray:
        """Rows (n, k) of the current drop's history, for `analysis.columns.history_of`."""
        if len(self._rows) > 1:
            self._rows = [np.concatenate(self._rows)]
        return self._rows[0] if self._rows else np.empty((0, len(self._columns)))

    def poll(self, timeout: float = 0.0) -> list[Event]:
        """What has come, in order; waits up to `timeout` [s] if there is nothing.

        Of earlier drops only what they gave in the end is told.
        """
        self._receive(0.0 if self._news else timeout)
        news, self._news = self._news, []
        return [each for each in news if isinstance(each, Ended) or self._is_current(each)]

    def finish(self, timeout: float) -> Result | None:
        """End the current drop now and return what there is, waiting up to `timeout` [s].

        None if there is nothing yet, or no answer in time. What comes meanwhile stays for `poll`.
        """
        if not self.ended:
            self._send(Finish())
        until = time.monotonic() + timeout
        while not self.ended and not self._is_lost and (left := until - time.monotonic()) > 0.0:
            self._receive(left)
        return self.result

    @property
    def alive(self) -> bool:
        """Whether there is a worker."""
        return not self._is_lost and not self._is_closing and self._process.is_alive()

    def close(self) -> None:
        """End the worker, if need be the hard way after `GRACE`. Closing again does nothing."""
        if self._is_closing:
            return
        self._send(Close())
        self._is_closing = self._is_lost = True
        atexit.unregister(self.close)
        self._process.join(GRACE)
        if self._process.is_alive():
            self._process.kill()
            self._process.join()
        self._pipe.close()

    def _send(self, command: Command) -> None:
        """Send, unless the worker has gone: `poll` tells of that."""
        if not isinstance(command, Ask):
            self._unsettled = _UNSETTLED
        if not self._is_lost:
            with contextlib.suppress(OSError):
                self._pipe.send(command)

    def _receive(self, timeout: float) -> None:
        """Take everything that has come."""
        try:
            while not self._is_lost and self._pipe.poll(timeout):
                self._take(self._pipe.recv())
                timeout = 0.0
        except (EOFError, OSError):
            self._lose()

    def _take(self, event: Event) -> None:
        self._news.append(event)
        if isinstance(event, Frame):
            self._is_asked = False
        if not self._is_current(event):
            return
        if isinstance(event, Frame):
            self.last = event
            self._rows.append(event.rows)
            is_at_rest = event.paused or event.ended
            self._unsettled = self._unsettled - 1 if is_at_rest else _UNSETTLED
            return
        self.ended = True
        if isinstance(event, (Ended, Failed)):
            self.result = event.result

    def _is_current(self, event: Event) -> bool:
        return isinstance(event, (Refused, Died)) or event.drop == self.drop

    def _lose(self) -> None:
        """The worker has gone without having been asked to: say so."""
        self._is_lost = self.ended = True
        self._process.join(GRACE)
        how = f"with exit code {self._process.exitcode}"
        if self._process.exitcode is not None and self._process.exitcode < 0:
            how = f"by signal {-self._process.exitcode}"
        self._news.append(Died(f"the process that computes was ended {how}"))


@contextlib.contextmanager
def _hidden_script() -> Iterator[None]:
    """Keep the program's main module from a process that is started meanwhile.

    It would run the script again from its top, with all its imports.
    """
    script = sys.modules["__main__"]
    sys.modules["__main__"] = ModuleType("__main__")
    try:
        yield
    finally:
        sys.modules["__main__"] = script
