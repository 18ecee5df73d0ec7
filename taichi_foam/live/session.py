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
import threading
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
    NothingYet,
    Pace,
    Pause,
    Refused,
    Start,
    Step,
)

if TYPE_CHECKING:
    from taichi_foam.results.result import Result
    from taichi_foam.scene import Scene

# Numbers in a row of the history: as many as `engine.ledger.ROW_COLUMNS`, which would load Taichi.
ROW_VALUES = 18

# A worker that has not left so long after it was asked is ended [s].
GRACE = 2.0

# How long a call that waits for an answer may keep others from the pipe [s].
TURN = 0.02


class Session:
    """Drops scenes, one after another, and hears how they go. Any thread may call anything.

    drop    number of the current drop, `drops` before the first
    scene   its scene
    paused  whether it is meant to stand still, or will after the step that was asked for
    last    its last frame
    ended   whether nothing more is computed of it
    result  what it gave, once it has ended
    """

    def __init__(self, arch: str = "cpu", threads: int | None = None, drops: int = 0) -> None:
        """Start a worker that computes on `arch` with `threads` CPU threads (None: all).

        The first drop has the number after `drops`.
        """
        self.drop = drops
        self.scene: Scene | None = None
        self.paused = False
        self.last: Frame | None = None
        self.ended = True
        self.result: Result | None = None
        self._rows: list[np.ndarray] = []
        self._pace: float | None = None
        self._is_asked = False
        self._is_lost = False  # nothing comes through the pipe any more
        self._is_closing = False
        self._news: list[Event] = []
        self._state = threading.RLock()  # guards the above, and what is sent
        self._receiving = threading.Lock()  # guards the pipe's reading end; taken before _state
        context = multiprocessing.get_context("spawn")
        self._pipe, far_end = context.Pipe()
        self._process = context.Process(
            target=worker.main, args=(far_end, arch, threads), name="taichi-foam", daemon=True
        )
        with _hidden_script():
            self._process.start()
        far_end.close()  # else this process would keep the pipe open for a worker that has died
        # The worker does not heed what ends processes politely: it has to be asked.
        atexit.register(self.close)

    def __enter__(self) -> Session:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def start(self, scene: Scene) -> int:
        """Drop `scene`, whatever goes on, and return the drop's number.

        It runs at once, at the pace that is set. Kernels that no drop of this session has needed
        yet take seconds to prepare; frames begin after that.
        """
        with self._state:
            self.drop += 1
            self.scene = scene
            self.last = self.result = None
            self.paused = self.ended = False
            self._rows = []
            self._send(Start(self.drop, scene))
            return self.drop

    def pause(self) -> None:
        """Stand still."""
        self._set_paused(True)

    def resume(self) -> None:
        """Go on."""
        self._set_paused(False)

    def _set_paused(self, on: bool) -> None:
        with self._state:
            self.paused = on
            self._send(Pause(on))

    def step(self, seconds: float) -> None:
        """Go on by `seconds` of simulated time, as fast as it goes, and stay paused there.

        Steps that are asked for before the last one is done add up. Raises ValueError unless
        `seconds` is above 0.
        """
        if not seconds > 0.0:
            raise ValueError(f"step = {seconds}: must be above 0 s")
        with self._state:
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
        with self._state:
            self._pace = rate
            self._send(Pace(rate))

    def ask(self) -> None:
        """Ask for a frame, unless one is on its way."""
        with self._state:
            if not self._is_asked:
                self._is_asked = True
                self._send(Ask())

    @property
    def rows(self) -> np.ndarray:
        """Rows (n, 18) of the current drop's history, for `batches.history_of`."""
        with self._state:
            if len(self._rows) > 1:
                self._rows = [np.concatenate(self._rows)]
            return self._rows[0] if self._rows else np.empty((0, ROW_VALUES))

    def poll(self, timeout: float = 0.0) -> list[Event]:
        """What has come, in order; waits up to `timeout` [s] if there is nothing.

        Of earlier drops only what they gave in the end is told.
        """
        with self._receiving:
            with self._state:
                has_news = bool(self._news)
            self._receive(0.0 if has_news else timeout)
            with self._state:
                news, self._news = self._news, []
        return [each for each in news if isinstance(each, Ended) or self._is_current(each)]

    def finish(self, timeout: float) -> Result | None:
        """End the current drop now and return what there is, waiting up to `timeout` [s].

        None if there is nothing yet, or no answer in time. What comes meanwhile stays for `poll`.
        """
        with self._state:
            number = self.drop
            if not self.ended:
                self._send(Finish())
        until = time.monotonic() + timeout
        while self.drop == number and not (self.ended or self._is_lost):
            left = until - time.monotonic()
            if left <= 0.0:
                break
            with self._receiving:
                self._receive(min(left, TURN))
        return self.result if self.drop == number else None

    @property
    def alive(self) -> bool:
        """Whether there is a worker."""
        return not self._is_lost and not self._is_closing and self._process.is_alive()

    def close(self) -> None:
        """End the worker, if need be the hard way after `GRACE`. Closing again does nothing."""
        with self._state:
            if self._is_closing:
                return
            self._send(Close())
            self._is_closing = True
        atexit.unregister(self.close)
        self._process.join(GRACE)
        if self._process.is_alive():
            self._process.kill()
            self._process.join()
        # whoever waits in poll has been woken by the pipe's end
        with self._receiving:
            self._is_lost = True
            self._pipe.close()

    def _send(self, command: Command) -> None:
        """Send, unless nobody is there: `poll` tells of that."""
        with self._state:
            if not self._is_lost and not self._is_closing:
                with contextlib.suppress(OSError):
                    self._pipe.send(command)

    def _receive(self, timeout: float) -> None:
        """Take everything that has come; `_receiving` is held."""
        try:
            while not self._is_lost and self._pipe.poll(timeout):
                self._take(self._pipe.recv())
                timeout = 0.0
        except (EOFError, OSError):
            self._lose()

    def _take(self, event: Event) -> None:
        with self._state:
            self._news.append(event)
            if isinstance(event, Frame):
                self._is_asked = False
            if isinstance(event, Refused):
                self.ended = True
            elif self._is_current(event):
                self._take_of_current(event)

    def _take_of_current(self, event: Event) -> None:
        if isinstance(event, Frame):
            self.last = event
            self._rows.append(event.rows)
        elif isinstance(event, (Ended, Failed)):
            self.ended, self.result = True, event.result
        elif isinstance(event, NothingYet):
            self.ended = True

    def _is_current(self, event: Event) -> bool:
        return isinstance(event, (Refused, Died)) or event.drop == self.drop

    def _lose(self) -> None:
        """The worker has gone: say so, unless it was asked to."""
        with self._state:
            self._is_lost = self.ended = True
            if self._is_closing:
                return
        self._process.join(GRACE)
        how = f"with exit code {self._process.exitcode}"
        if self._process.exitcode is not None and self._process.exitcode < 0:
            how = f"by signal {-self._process.exitcode}"
        with self._state:
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
