"""One scene, advanced a little at a time: the basis of live views.

    with Drop(scene) as drop:
        while not drop.ended:
            drop.advance(0.01)
            show(drop.now())
    result = drop.result()

Steps, rows and snapshots equal those of `simulation.run(scene)` to the last bit, wherever it
pauses: the step size does not depend on pauses.
"""

import contextlib
import math
import time
from pathlib import Path

import numpy as np

from taichi_foam.records.ending import Ending
from taichi_foam.records.snapshot import Snapshot
from taichi_foam.results.result import Result
from taichi_foam.scene import Scene
from taichi_foam.simulation.batches import CALL_SECONDS, ENDINGS, Wall, borrowed_slots, result_of
from taichi_foam.simulation.checkpoint import Checkpoints

# `advance` makes no further call of the engine when less than this part of its time is left.
REST = 0.2


class Drop:
    """A scene on a borrowed lattice. Recorded data stays readable after `close`."""

    def __init__(
        self, scene: Scene, *, checkpoint: Path | None = None, every: float | None = None
    ) -> None:
        """Load the scene and compile its kernels; starts Taichi unless it runs already.

        Args:
            scene: what is dropped.
            checkpoint: folder for a checkpoint; the run continues from one that is there.
            every: wall time between two checkpoints [s]; None: as `simulate.run`.

        Raises:
            UserError: a checkpoint cannot be continued.
        """
        self.scene = scene
        self._wall = Wall()
        kept = None if checkpoint is None else Checkpoints([checkpoint], every)
        with contextlib.ExitStack() as borrowed:
            self._slots = borrowed.enter_context(borrowed_slots(1, scene, self._wall, kept))
            self._slots.fill([(0, scene)])
            self._borrowed = borrowed.pop_all()
        self._run = self._slots.runs[0]
        self._is_open = True

    def __enter__(self) -> "Drop":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Give the lattice back. Closing again does nothing."""
        self._is_open = False
        self._borrowed.close()

    def advance(self, seconds: float, until: float = math.inf) -> None:
        """Advance for about `seconds` of wall time (inf: no limit), at most to time `until` [s].

        Stops at the end of the first step that reaches `until`, and when the run ends. A run that
        has ended stays unchanged. Raises ValueError after `close`.
        """
        self._check_open()
        start = time.perf_counter()
        spent = 0.0
        while spent < (1.0 - REST) * seconds and self.time < until and not self.ended:
            if self._slots.advance(min(seconds - spent, CALL_SECONDS), until):
                raise KeyboardInterrupt
            spent = time.perf_counter() - start

    def save_checkpoint(self) -> None:
        """Write a checkpoint now, if there is a folder for it and something to store."""
        self._check_open()
        if self._run.rows:
            self._slots.save()

    def catch(self, seconds: float, until: float = math.inf) -> Snapshot | None:
        """Like `advance`, but stop where a row of the history is due, and return that instant.

        One further step is taken, which writes the row. None if the instant has not been reached.
        The last instant of a run has its own row.
        """
        if self.has_last_row:
            self.advance(seconds, min(until, self._next_row))
            if self.has_last_row and not self.ended:
                return None
        caught = self.now()
        if not self.ended:
            self.advance(seconds, math.nextafter(self.time, math.inf))
        return caught

    @property
    def has_last_row(self) -> bool:
        """Whether no row is due; a row that is due is written by the next step."""
        return self.time < self._next_row

    @property
    def last_row(self) -> float:
        """Time of the latest row of the history [s]; NaN before the first."""
        return float(self._run.rows[-1][-1, 0]) if self._run.rows else math.nan

    @property
    def _next_row(self) -> float:
        """When the row after the latest is due [s]."""
        interval = self.scene.output.history_interval
        rows = self._run.rows
        return interval * (math.floor(self.last_row / interval + 1e-9) + 1) if rows else 0.0

    def now(self) -> Snapshot:
        """The present instant; it is not recorded. Raises ValueError after `close`."""
        self._check_open()
        return self._slots.now(0)

    def rows(self, since: int = 0) -> np.ndarray:
        """Rows (n, `row_columns`) after the first `since`, for `analysis.columns.history_of`."""
        return self._run.rows_since(since)

    def result(self) -> Result:
        """The result so far; an interrupted one if the run has not ended.

        Raises ValueError before the first row.
        """
        if not self._run.rows:
            raise ValueError(f"{self.scene.name}: nothing has been computed yet")
        return result_of(self._run, self._wall)

    @property
    def time(self) -> float:
        """Simulated time [s]."""
        return self._run.time

    @property
    def ended(self) -> bool:
        """Whether it takes no more steps, after success or failure."""
        return self._run.ended

    @property
    def ended_by(self) -> Ending | None:
        """How it ended; None while it runs."""
        return ENDINGS[self._run.status] if self.ended else None

    @property
    def failure(self) -> str | None:
        """The message of a RunError, if the run has failed."""
        return self._run.failure

    @property
    def fraction(self) -> float:
        """Fraction of the run that is done, 0 to 1."""
        return self._run.fraction

    @property
    def steps(self) -> int:
        """Steps taken."""
        return self._wall.steps

    @property
    def wall(self) -> float:
        """Wall time that the engine's calls have taken [s], without compiling."""
        return self._wall.seconds

    def _check_open(self) -> None:
        if not self._is_open:
            raise ValueError(
                f"{self.scene.name}: this drop has been closed and its lattice released"
            )
