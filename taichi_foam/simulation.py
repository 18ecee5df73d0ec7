"""Run scenes, one or many.

    from taichi_foam import run
    from taichi_foam.paper import paper_scene
    result = run(paper_scene("paper/wedge-2.86"))

`simulate` yields snapshots of one scene as they come, `simulate_many` results of many scenes as
they come; `run` and `run_many` return results. All start Taichi with its defaults unless
`engine.runtime.start` has been called before.
"""

import platform
import time
from collections.abc import Callable, Generator, Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import groupby

import numpy as np
import taichi as ti

import taichi_foam
from taichi_foam.engine import loading, runtime, stepper
from taichi_foam.engine.lattice import (
    AT_END_TIME,
    AT_REBOUND,
    CROWDED,
    NOT_FINITE,
    RUNNING,
    Lattice,
    borrowed,
)
from taichi_foam.engine.ledger import ROW_COLUMNS
from taichi_foam.errors import RunError
from taichi_foam.result import Result, Snapshot
from taichi_foam.scene import Scene

# A kernel call holds the interpreter: it is kept this short, so that Ctrl-C and progress work.
CALL_SECONDS = 0.075
MOST_STEPS = 1_000_000

# Most nodes and lattices that are on the device at a time. Lattices that end make room for others.
MOST_NODES = {"cpu": 200_000, "gpu": 16_000_000}
MOST_LATTICES = {"cpu": 64, "gpu": 4096}

ENDINGS = {
    RUNNING: "interrupt",
    AT_END_TIME: "end time",
    AT_REBOUND: "rebound",
    NOT_FINITE: "values that went astray",
    CROWDED: "a full neighbour list",
}


@dataclass(frozen=True)
class Progress:
    """Where a run or a batch of runs stands, once per call of the engine."""

    time: float  # of the slowest lattice on the device [s]
    fraction: float  # 0 to 1; an impact ends when its velocity is spent
    steps: int  # of all lattices together
    wall: float  # [s]
    finished: int = 0
    of: int = 1


ProgressCallback = Callable[[Progress], None]


@dataclass
class _Wall:
    """What the engine has done so far: seconds, and steps and stages of nodes of all lattices."""

    seconds: float = 0.0
    steps: int = 0
    node_stages: int = 0


@dataclass
class _Run:
    """What one lattice has given so far."""

    scene: Scene
    index: int
    begun: _Wall
    batch: int
    rows: list[np.ndarray] = field(default_factory=list)
    snapshots: list[Snapshot] = field(default_factory=list)
    status: int = RUNNING
    time: float = 0.0
    report: dict[str, float] = field(default_factory=dict)

    @property
    def next_snapshot(self) -> float:
        """Time of the next snapshot [s]: a multiple of the interval, the first at the start."""
        return len(self.snapshots) * self.scene.output.snapshot_interval

    @property
    def fraction(self) -> float:
        """How much of the run is done: by time, or by how much of the velocity is spent."""
        numerics, impactor = self.scene.numerics, self.scene.impactor
        if self.status != RUNNING:
            return 1.0
        done = self.time / numerics.latest_end
        if numerics.end == "rebound" and impactor is not None and self.rows:
            start = self.rows[0][0, ROW_COLUMNS.index("v")]
            now = self.rows[-1][-1, ROW_COLUMNS.index("v")]
            if start < 0.0:
                done = max(done, 1.0 - now / start)
        return float(np.clip(done, 0.0, 1.0))


def simulate(scene: Scene) -> Iterator[Snapshot]:
    """Step through `scene`, yielding a snapshot every `output.snapshot_interval`.

    Raises:
        RunError: the run met values that are not finite, or too many pieces in one place.
    """
    given = 0
    for runs in _drive([scene], _Wall()):
        yield from runs[0].snapshots[given:]
        given = len(runs[0].snapshots)
        _raise_on_failure(runs)


def simulate_many(
    scenes: Sequence[Scene], on_progress: ProgressCallback | None = None
) -> Generator[tuple[int, Result], None, None]:
    """Run scenes side by side, yielding each one's place in `scenes` and its result as it ends.

    They may differ in everything. Those with the same lattice counts share a batch, one lattice on
    each CPU thread, and a lattice that has ended makes room for the next. Nothing is kept of what
    has been yielded. A result does not depend, to the last bit, on what else is run.

    A run that fails is yielded like any other; `run["ended_by"]` says why it ended.
    """
    wall = _Wall()
    finished = 0
    for runs in _drive(scenes, wall):
        ended = [run for run in runs if run.status != RUNNING]
        finished += len(ended)
        if on_progress is not None:
            on_progress(_progress(runs, wall, finished, len(scenes)))
        for run in ended:
            yield run.index, _result(run, wall)


def run(scene: Scene, on_progress: ProgressCallback | None = None) -> Result:
    """Run `scene` to its end and return everything it gave.

    Ctrl-C ends it early: the result then holds what there is, with `interrupted` set.

    Raises:
        RunError: as `simulate`; its `results` hold what came before.
    """
    return run_many([scene], on_progress)[0]


def run_many(scenes: Sequence[Scene], on_progress: ProgressCallback | None = None) -> list[Result]:
    """Run scenes as `simulate_many` does, and return their results in order.

    Ctrl-C ends it early: there are then results of the scenes that were begun, those that had not
    ended with `interrupted` set.

    Raises:
        RunError: as `run`, once all others have ended; its `results` hold everything.
    """
    wall = _Wall()
    begun: dict[int, _Run] = {}
    results: dict[int, Result] = {}
    try:
        for runs in _drive(scenes, wall):
            begun.update((run.index, run) for run in runs)
            for run in runs:
                if run.status != RUNNING:
                    results[run.index] = _result(run, wall)
            if on_progress is not None:
                on_progress(_progress(runs, wall, len(results), len(scenes)))
    except KeyboardInterrupt:
        for index, run in begun.items():
            if index not in results and run.rows:
                results[index] = _result(run, wall, interrupted=True)
        if not results:
            raise
    ordered = [results[index] for index in sorted(results)]
    _raise_on_failure(list(begun.values()), ordered)
    return ordered


def _drive(scenes: Sequence[Scene], wall: _Wall) -> Iterator[list[_Run]]:
    """Advance scenes call by call; yields the runs on the device after each.

    A run is yielded for the last time with the status that ended it.
    """
    counts = [(scene.block.columns, scene.block.rows) for scene in scenes]
    order = sorted(range(len(scenes)), key=lambda index: counts[index])
    for (columns, rows), group in groupby(order, key=lambda index: counts[index]):
        waiting = [(index, scenes[index]) for index in group]
        yield from _drive_batch(waiting, columns, rows, wall)


def _drive_batch(
    waiting: list[tuple[int, Scene]], columns: int, rows: int, wall: _Wall
) -> Iterator[list[_Run]]:
    """Advance scenes of the same lattice counts; see `_drive`."""
    runtime.start()
    batch = _batch_size(len(waiting), columns * rows)
    with borrowed(batch, columns, rows) as lattice:
        advance = stepper.advance_of(lattice)
        slots: list[_Run | None] = [None] * batch
        waiting = waiting[::-1]
        most_steps = 0  # the first call steps nothing: it compiles, and is not counted
        try:
            while waiting or any(slots):
                for b in range(batch):
                    if slots[b] is None and waiting:
                        index, scene = waiting.pop()
                        loading.load(lattice, b, scene)
                        stepper.prepare(lattice, b)
                        first = [loading.snapshot(lattice, b)]
                        slots[b] = _Run(scene, index, replace(wall), batch, snapshots=first)
                if most_steps == 0:
                    loading.set_pause(lattice, np.zeros(batch))
                    advance(lattice, 1)
                    most_steps = 1
                pauses = [0.0 if run is None else run.next_snapshot for run in slots]
                loading.set_pause(lattice, np.array(pauses))
                start = time.perf_counter()
                advance(lattice, most_steps)
                ti.sync()
                took = time.perf_counter() - start
                wall.seconds += took
                most_steps = _steps_for_call(most_steps, took)
                _collect(lattice, slots, wall)
                yield [run for run in slots if run is not None]
                for b, run in enumerate(slots):
                    if run is not None and run.status != RUNNING:
                        loading.unload(lattice, b)
                        slots[b] = None
        finally:
            for b in range(batch):
                loading.unload(lattice, b)


def _batch_size(scenes: int, nodes: int) -> int:
    """Lattices at a time: a power of two, so that few sizes are ever compiled."""
    device = "cpu" if runtime.settings()["arch"] == "cpu" else "gpu"
    most = max(1, min(MOST_LATTICES[device], MOST_NODES[device] // nodes))
    return 1 << min((scenes - 1).bit_length(), most.bit_length() - 1)


def _steps_for_call(most_steps: int, took: float) -> int:
    """Steps of the next call: towards CALL_SECONDS, at most doubling."""
    wanted = most_steps * CALL_SECONDS / max(took, 1e-6)
    return int(np.clip(wanted, 1, min(2 * most_steps, MOST_STEPS)))


def _collect(lattice: Lattice, slots: Sequence[_Run | None], wall: _Wall) -> None:
    """Take the rows that a call has left, and the snapshots that are due."""
    standing, rows = loading.harvest(lattice)
    for b, run in enumerate(slots):
        if run is None:
            continue
        before = run.report.get("steps", 0)
        run.report = {name: float(values[b]) for name, values in standing.items()}
        run.status, run.time = int(run.report["status"]), run.report["time"]
        wall.steps += int(run.report["steps"] - before)
        wall.node_stages += 4 * lattice.nodes * int(run.report["steps"] - before)
        if len(rows[b]):
            run.rows.append(rows[b])
        if run.status != RUNNING or run.time >= run.next_snapshot:
            if run.snapshots and run.snapshots[-1].time == run.time:
                run.snapshots.pop()  # the run has ended where its last snapshot was due
            run.snapshots.append(loading.snapshot(lattice, b))


def _progress(runs: list[_Run], wall: _Wall, finished: int, of: int) -> Progress:
    running = [run for run in runs if run.status == RUNNING]
    return Progress(
        time=min(run.time for run in runs),
        fraction=(finished + sum(run.fraction for run in running)) / of,
        steps=wall.steps,
        wall=wall.seconds,
        finished=finished,
        of=of,
    )


def _result(run: _Run, wall: _Wall, interrupted: bool = False) -> Result:
    rows: dict[str, np.ndarray] = dict(zip(ROW_COLUMNS, np.concatenate(run.rows).T, strict=True))
    seconds = wall.seconds - run.begun.seconds
    node_stages = wall.node_stages - run.begun.node_stages
    return Result(
        scene=run.scene,
        history=_history(run.scene, rows),
        snapshots=run.snapshots,
        run={
            "ended_by": ENDINGS[run.status],
            "interrupted": interrupted,
            "steps": int(run.report["steps"]),
            "dt_min_s": run.report["shortest"],
            "dt_max_s": run.report["longest"],
            "max_overlap_m": run.report["overlap"],
            "batch": run.batch,
            "wall_s": seconds,
            "node_stages_per_s": node_stages / max(seconds, 1e-9),
            **runtime.settings(),
            "taichi_foam": taichi_foam.__version__,
            "taichi": ".".join(map(str, ti.__version__)),
            "numpy": np.__version__,
            "python": platform.python_version(),
            "machine": platform.platform(),
        },
    )


def _history(scene: Scene, rows: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """The history's columns from the engine's rows: signs and sums as people report them.

    Work counts from the first row; crushing is what the normal stresses took up beyond what they
    still store or lost by breaking. The residual is the energy that no column accounts for.
    """
    # filters take a second to load: after the run, not before it
    from taichi_foam.smoothing import smooth_deceleration

    impactor = scene.impactor
    mass, gravity = (impactor.mass if impactor else 0.0), scene.numerics.gravity
    t, y, v = rows["time"], rows["y"], rows["v"]
    interval = np.diff(t, prepend=t[0])
    deceleration = np.divide(
        np.diff(v, prepend=v[0]), interval, out=np.zeros_like(t), where=interval > 0
    )
    stored = rows["stored"]
    normal = rows["faces"] - rows["shear"] - rows["dashpots"]
    crushing = normal - (stored - stored[0]) - rows["fracture"]
    potential = rows["potential"] + mass * gravity * y
    energies = {
        "impactor_kinetic_J": 0.5 * mass * v**2,
        "foam_kinetic_J": rows["kinetic"],
        "strain_J": stored,
        "crushing_J": crushing,
        "shear_J": rows["shear"],
        "damping_J": rows["dashpots"] + rows["drag"],
        "friction_J": rows["friction"],
        "contact_J": rows["impactor"],
        "self_contact_J": rows["self_contact"],
        "fracture_J": rows["fracture"],
        "base_J": rows["base"],
        "gravity_J": potential - potential[0],
    }
    total = np.sum(list(energies.values()), axis=0)
    return {
        "time_s": t,
        "displacement_m": (scene.contact_height - y) if impactor else np.zeros_like(t),
        "velocity_m_s": -v,
        "deceleration_m_s2": deceleration,
        "deceleration_smoothed_m_s2": smooth_deceleration(t, deceleration),
        "contact_force_N": rows["force"],
        **energies,
        "residual_J": total[0] - total,
        "broken_connections": rows["broken"],
        "dt_s": rows["step"],
    }


def _raise_on_failure(runs: Sequence[_Run], results: Sequence[Result] = ()) -> None:
    """Say when and where a run failed, with what it left."""
    for run in runs:
        if run.status in (NOT_FINITE, CROWDED):
            raise RunError(_failure(run), list(results))


def _failure(run: _Run) -> str:
    rows = run.scene.block.rows
    node = int(run.report["bad_node"])
    if run.status == CROWDED:
        return (
            f"{run.scene.name}: at {run.time * 1e3:.4f} ms more pieces touch than the neighbour "
            "list holds; set model.self_contact = false or take a finer lattice"
        )
    return (
        f"{run.scene.name}: went astray at {run.time * 1e3:.4f} ms, first at node "
        f"({node // rows}, {node % rows}): values that are not finite, or beyond all measure; "
        "take a smaller numerics.dt, or 'auto'"
    )
