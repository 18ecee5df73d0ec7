"""Calls of the engine: scenes on the device, advanced call by call, and the data they return.

`simulate` uses this to run scenes to their ends, `stepwise` to advance one a little at a time.
"""

from __future__ import annotations

import contextlib
import math
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from taichi_foam.analysis.columns import history_of
from taichi_foam.backend import ti
from taichi_foam.engine import runtime, transfer
from taichi_foam.engine.features import Features, features_of
from taichi_foam.engine.lattice import Lattice, borrowed
from taichi_foam.engine.state import (
    AT_END_TIME,
    AT_REBOUND,
    CROWDED,
    DIVERGED,
    RUNNING,
    State,
    state_after,
)
from taichi_foam.errors import LongRunWarning, warn_of_run
from taichi_foam.interrupts import held_interrupts
from taichi_foam.records.cushion import Cushion
from taichi_foam.records.ending import Ending
from taichi_foam.records.history import row_columns
from taichi_foam.records.snapshot import Snapshot
from taichi_foam.results.result import Result
from taichi_foam.results.snapshot_file import SnapshotFile, rounded
from taichi_foam.scene import Scene
from taichi_foam.simulation.after import After
from taichi_foam.simulation.checkpoint import Checkpoint, Checkpoints
from taichi_foam.simulation.provenance import provenance

# A kernel call blocks the interpreter: it is kept this short [s], so that Ctrl-C and progress work.
CALL_SECONDS = 0.075
MOST_STEPS = 1_000_000

# A run that needs more steps than this gives a warning when it begins: a small block takes a day.
MANY_STEPS = 1e9

# Most nodes and lattices on the device at a time. Lattices that end make room for others.
MOST_NODES = {"cpu": 200_000, "gpu": 16_000_000}
MOST_LATTICES = {"cpu": 64, "gpu": 4096}
# Lattices for each CPU thread: enough that no thread waits for long when a lattice pauses, and few
# enough that some scenes end long before others begin.
LATTICES_PER_THREAD = 8

ENDINGS = {
    RUNNING: Ending.INTERRUPTED,
    AT_END_TIME: Ending.END_TIME,
    AT_REBOUND: Ending.REBOUND,
    DIVERGED: Ending.DIVERGED,
    CROWDED: Ending.CROWDED,
}
"""How a run ended, by the status that the engine returns."""

LEAVING = (AT_END_TIME, AT_REBOUND)
"""Those of them that leave a block for the next impact."""

Afters = Sequence[After | None]
"""For each scene, by its index, the block that it starts on; None: a fresh one. Empty: all are."""


@dataclass
class Wall:
    """Work of the engine so far: seconds, and the steps and node stages of all lattices."""

    seconds: float = 0.0
    steps: int = 0
    node_stages: int = 0


@dataclass
class Run:
    """The data of one lattice's run so far."""

    scene: Scene
    index: int
    begun: Wall
    batch: int
    rows: list[np.ndarray] = field(default_factory=list)  # none of them is empty
    snapshots: list[Snapshot] | SnapshotFile = field(default_factory=list)
    recorded: float = -math.inf  # time of the last snapshot [s]
    status: int = RUNNING
    time: float = 0.0
    report: dict[str, float] = field(default_factory=dict)
    resumed: int = 0
    after: After | None = None
    cushion: Cushion | None = None  # the block it leaves, once it has ended well

    @classmethod
    def stored(cls, checkpoint: Checkpoint, index: int, wall: Wall, batch: int) -> Run:
        """The run of a checkpoint, to be continued in a batch of size `batch` unless it has ended.

        `wall` is the engine's work so far; the checkpoint's own work is subtracted from it.
        """
        state = checkpoint.state
        run = cls(
            checkpoint.scene, index,
            Wall(
                wall.seconds - checkpoint.seconds,
                node_stages=wall.node_stages - checkpoint.node_stages,
            ),
            batch,
            rows=[checkpoint.rows] if len(checkpoint.rows) else [],
            snapshots=checkpoint.snapshots,
            recorded=checkpoint.snapshots[-1].time,
            status=int(state.clock["status"]),
            time=state.clock["time"],
            report={**state.clock, "overlap": float(state.overlap.max(initial=0.0))},
            after=None if checkpoint.after is None else After(checkpoint.after),
        )  # fmt: skip
        run.cushion = state.cushion() if run.status in LEAVING else None
        run.resumed = checkpoint.resumed + (not run.ended)
        return run

    @property
    def ended(self) -> bool:
        """Whether it takes no more steps, after success or failure."""
        return self.status != RUNNING

    @property
    def next_snapshot(self) -> float:
        """Time of the next snapshot [s]: the first multiple of the interval after the last one."""
        interval = self.scene.output.snapshot_interval
        return interval * (math.floor(self.recorded / interval + 1e-9) + 1)

    @property
    def fraction(self) -> float:
        """Fraction of the run that is done: by time, or by the share of the velocity lost."""
        numerics, impactor = self.scene.numerics, self.scene.impactor
        if self.ended:
            return 1.0
        done = self.time / numerics.latest_end
        if numerics.end == "rebound" and impactor is not None and self.rows:
            velocity = row_columns(self.scene.turns).index("body.v")
            start, now = self.rows[0][0, velocity], self.rows[-1][-1, velocity]
            if start < 0.0:
                done = max(done, 1.0 - now / start)
        return float(np.clip(done, 0.0, 1.0))

    @property
    def failure(self) -> str | None:
        """When and where the run failed, if it did, and what to do."""
        ending = ENDINGS[self.status]
        if not ending.failed:
            return None
        where = ""
        if ending is Ending.DIVERGED:
            i, j = divmod(int(self.report.get("bad_node", 0)), self.scene.block.rows)
            where = f", first at node ({i}, {j})"
        return (
            f"{self.scene.name}: {ending} at {self.time * 1e3:.4f} ms{where}: {ending.meaning}; "
            f"{ending.remedy}"
        )

    def record(self, snapshot: Snapshot) -> None:
        """Store a snapshot, unless that instant is stored already. Raises OSError."""
        if snapshot.time > self.recorded:
            self.snapshots.append(rounded(snapshot, self.scene))
            self.recorded = snapshot.time

    @property
    def length(self) -> str | None:
        """The warning for a run that needs a very large number of steps; None if it does not."""
        step = self.report["shortest"]
        ahead = (self.scene.numerics.latest_end - self.time) / step
        if ahead <= MANY_STEPS:
            return None
        return (
            f"{self.scene.name}: needs up to {ahead:.1g} steps of {step:.1g} s, which may take "
            "days; end it sooner (numerics.end, numerics.time_limit), or slow down its fastest "
            "vibration with a heavier impactor, softer contacts, softer foam or larger cells"
        )

    def rows_since(self, since: int) -> np.ndarray:
        """The rows (n, `row_columns`) after the first `since`."""
        late: list[np.ndarray] = []
        before = sum(map(len, self.rows))
        for rows in reversed(self.rows):
            if before <= since:
                break
            before -= len(rows)
            late.append(rows[max(since - before, 0) :])
        if late:
            return np.concatenate(late[::-1])
        return np.empty((0, len(row_columns(self.scene.turns))))

    def checkpoint(self, state: State, wall: Wall) -> Checkpoint:
        """A checkpoint of the run now; `state` is the state of its lattice."""
        assert isinstance(self.snapshots, SnapshotFile)  # the run has a folder
        return Checkpoint(
            scene=self.scene,
            state=state,
            arch=_arch(),
            rows=self.rows_since(0),
            snapshots=self.snapshots,
            seconds=wall.seconds - self.begun.seconds,
            node_stages=wall.node_stages - self.begun.node_stages,
            resumed=self.resumed,
            after=self.after and self.after.told,
        )


class Slots:
    """The slots of a borrowed lattice's batch, the runs in them, and the length of calls.

    runs  the runs in the slots, in order, including ended ones that were not cleared
    """

    def __init__(
        self, lattice: Lattice, wall: Wall, kept: Checkpoints | None, after: Afters
    ) -> None:
        """The engine's work is added to `wall`.

        Runs continue from the checkpoints in `kept` and write new ones.
        """
        self._lattice = lattice
        self._wall = wall
        self._kept, self._after = kept, after
        self._advance = transfer.advance_of(lattice)
        self._places: list[Run | None] = [None] * lattice.size.batch
        # of the whole batch, from the last call that took all its steps
        self._steps_per_second = 0.0
        self._is_compiled = False

    @property
    def runs(self) -> list[Run]:
        return [run for run in self._places if run is not None]

    def fill(self, waiting: list[tuple[int, Scene]]) -> None:
        """Load scenes, each with its index, from the end of `waiting` into empty slots.

        A scene with a checkpoint continues from it. Raises UserError if it cannot.
        """
        lattice = self._lattice
        for b in range(lattice.size.batch):
            if self._places[b] is None and waiting:
                self._places[b] = self._loaded(b, *waiting.pop())
        if not self._is_compiled:
            # a call that takes no steps, and is not counted
            transfer.set_pause(lattice, np.zeros(lattice.size.batch))
            self._advance(lattice, 1)
            transfer.harvest(lattice)
            self._is_compiled = True

    def _loaded(self, b: int, index: int, scene: Scene) -> Run:
        """The run of a scene in slot `b`: from its checkpoint, if it has one, or from its start."""
        lattice, wall, kept = self._lattice, self._wall, self._kept
        after = self._after[index] if self._after else None
        stored = kept and kept.stored(index, scene, _arch(), after)
        if stored is not None:
            transfer.load(lattice, b, scene, stored.state)
            return Run.stored(stored, index, wall, lattice.size.batch)
        snapshots = kept.snapshots(index, scene) if kept else []
        cushion = after and after.cushion
        transfer.load(lattice, b, scene, None if cushion is None else state_after(scene, cushion))
        run = Run(
            scene, index, replace(wall), lattice.size.batch, snapshots=snapshots, after=after
        )  # fmt: skip
        run.record(self._snapshot(b, run))
        return run

    def save(self, only_ended: bool = False) -> None:
        """Write checkpoints of all runs, or of the ended ones only, if checkpoints are kept."""
        if self._kept is None:
            return
        standing = [
            (run.index, run.checkpoint(transfer.take(self._lattice, b), self._wall))
            for b, run in enumerate(self._places)
            if run is not None and (run.ended or not only_ended)
        ]
        if standing:
            self._kept.save(standing)

    def advance(self, seconds: float, until: float = math.inf) -> bool:
        """One call of the engine, which takes about `seconds` of wall time.

        A run stops earlier when its next snapshot is due, when its rows on the device are full, or
        at the simulated time `until` [s]. Rows and snapshots are added to the runs, and checkpoints
        that are due are written. Ctrl-C waits until rows and snapshots are stored; the return value
        says whether it was pressed.
        """
        pauses = [0.0 if run is None else min(run.next_snapshot, until) for run in self._places]
        transfer.set_pause(self._lattice, np.array(pauses))
        most_steps = int(np.clip(self._steps_per_second * seconds, 1, MOST_STEPS))
        with held_interrupts() as pressed:
            start = time.perf_counter()
            self._advance(self._lattice, most_steps)
            ti.sync()
            took = time.perf_counter() - start
            self._wall.seconds += took
            taken = self._collect()
        # a call that a pause cut short is mostly overhead, so it does not count for the step rate
        if taken >= most_steps or took > seconds:
            self._steps_per_second = taken / max(took, 1e-6)
        if self._kept is not None and self._kept.are_due():
            self.save()
        return pressed.is_set()

    def _collect(self) -> int:
        """Fetch the rows of the last call, and the snapshots that are due.

        Returns the largest number of steps that any run took in that call.
        """
        standing, rows = transfer.harvest(self._lattice)
        most = 0
        for b, run in enumerate(self._places):
            if run is None:
                continue
            before = run.report.get("steps", 0)
            run.report = {name: float(values[b]) for name, values in standing.items()}
            run.status, run.time = int(run.report["status"]), run.report["time"]
            taken = int(run.report["steps"] - before)
            if not before and taken and run.length:
                warn_of_run(run.length, LongRunWarning)
            most = max(most, taken)
            self._wall.steps += taken
            self._wall.node_stages += 4 * self._lattice.size.nodes * taken
            if len(rows[b]):
                run.rows.append(rows[b])
            if run.ended or run.time >= run.next_snapshot:
                run.record(self._snapshot(b, run))
            if run.status in LEAVING:
                run.cushion = transfer.take(self._lattice, b).cushion()
        return most

    def now(self, b: int) -> Snapshot:
        """A snapshot of the run in slot `b` now; it is not recorded."""
        run = self._places[b]
        assert run is not None
        return self._snapshot(b, run)

    def _snapshot(self, b: int, run: Run) -> Snapshot:
        scene = run.scene
        return transfer.snapshot(
            self._lattice, b, scene.block if scene.output.keeps_stress else None
        )

    def clear_ended(self) -> None:
        """Free the slots of runs that have ended."""
        for b, run in enumerate(self._places):
            if run is not None and run.ended:
                transfer.unload(self._lattice, b)
                self._places[b] = None


@contextlib.contextmanager
def borrowed_slots(
    batch: int,
    scene: Scene,
    wall: Wall,
    checkpoints: Checkpoints | None = None,
    after: Afters = (),
) -> Iterator[Slots]:
    """`batch` slots for scenes like `scene`, on a lattice that is returned empty.

    See `Slots` for the other arguments.
    """
    block = scene.block
    with borrowed(batch, block.columns, block.rows, features_of(scene)) as lattice:
        try:
            yield Slots(lattice, wall, checkpoints, after)
        finally:
            for b in range(batch):
                transfer.unload(lattice, b)


def advance_all(
    scenes: Sequence[Scene],
    wall: Wall,
    checkpoints: Checkpoints | None = None,
    after: Afters = (),
) -> Iterator[list[Run]]:
    """Advance scenes call by call; yields the runs on the device after each call.

    A run is last yielded with the status that ended it. With `checkpoints`, runs continue from
    existing ones, and write new ones at intervals, on interruption and at the end.

    Raises UserError: a checkpoint cannot be continued.
    """
    runtime.start()
    groups: dict[tuple[int, int, Features], list[int]] = {}
    for index, scene in enumerate(scenes):
        if checkpoints is not None and checkpoints.has_ended(index):
            stored = checkpoints.stored(index, scene, _arch(), after[index] if after else None)
            assert stored is not None
            yield [Run.stored(stored, index, wall, batch=1)]
            continue
        block = scene.block
        groups.setdefault((block.columns, block.rows, features_of(scene)), []).append(index)
    for (columns, rows, _), group in groups.items():
        waiting = [(index, scenes[index]) for index in group][::-1]
        batch = _batch_size(len(waiting), columns * rows)
        with borrowed_slots(batch, scenes[group[0]], wall, checkpoints, after) as slots:
            try:
                while waiting or slots.runs:
                    slots.fill(waiting)
                    pressed = slots.advance(CALL_SECONDS)
                    slots.save(only_ended=True)
                    yield slots.runs
                    if pressed:  # the caller has taken the ended runs
                        raise KeyboardInterrupt
                    slots.clear_ended()
            except (KeyboardInterrupt, GeneratorExit):
                slots.save()
                raise


def _arch() -> str:
    """The arch that computes."""
    return str(runtime.settings()["arch"])


def _batch_size(scenes: int, nodes: int) -> int:
    """Number of lattices at a time: a power of two, so that few sizes are ever compiled."""
    settings = runtime.settings()
    device = "cpu" if settings["arch"] == "cpu" else "gpu"
    most = min(MOST_LATTICES[device], MOST_NODES[device] // nodes)
    if device == "cpu":
        most = min(most, LATTICES_PER_THREAD * int(settings["threads"]))
    most = max(1, most)
    return 1 << min((scenes - 1).bit_length(), most.bit_length() - 1)


def result_of(run: Run, wall: Wall) -> Result:
    """The result of a run, with how it was computed. The run must have had at least one call.

    A run that has not ended counts as interrupted.
    """
    ending = ENDINGS[run.status]
    seconds = wall.seconds - run.begun.seconds
    node_stages = wall.node_stages - run.begun.node_stages
    return Result(
        scene=run.scene,
        history=history_of(run.scene, run.rows_since(0)),
        snapshots=run.snapshots,
        run={
            "ended_by": ending.value,
            "interrupted": ending is Ending.INTERRUPTED,
            "steps": int(run.report["steps"]),
            "dt_min_s": run.report["shortest"],
            "dt_max_s": run.report["longest"],
            "dt_stable_min_s": run.report["stable"],
            "max_overlap_m": run.report["overlap"],
            "batch": run.batch,
            "resumed": run.resumed,
            "wall_s": seconds,
            "node_stages_per_s": node_stages / max(seconds, 1e-9),
            **runtime.settings(),
            **provenance(run.scene),
            **({} if run.after is None else {"after": dict(run.after.told)}),
        },
        cushion=run.cushion,
    )
