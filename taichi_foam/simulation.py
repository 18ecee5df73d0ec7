"""Run scenes: `simulate` yields snapshots as they come, `run` and `run_many` return results.

    from taichi_foam import run
    from taichi_foam.paper import paper_scene
    result = run(paper_scene("paper/wedge-2.86"))

All three start Taichi with its defaults unless `engine.runtime.start` has been called before.
"""

import platform
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
import taichi as ti

import taichi_foam
from taichi_foam.engine import runtime, stepper
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
from taichi_foam.smoothing import smooth_deceleration

# A kernel call holds the interpreter: it is kept this short, so that Ctrl-C and progress work.
CALL_SECONDS = 0.075
MOST_STEPS = 1_000_000

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

    time: float  # of the slowest lattice [s]
    fraction: float  # 0 to 1; an impact ends when its velocity is spent
    steps: int  # of all lattices together
    wall: float  # [s]


ProgressCallback = Callable[[Progress], None]


@dataclass
class _Run:
    """What one lattice of a batch has given so far."""

    scene: Scene
    rows: list[np.ndarray] = field(default_factory=list)
    snapshots: list[Snapshot] = field(default_factory=list)
    status: int = RUNNING
    time: float = 0.0
    bad_node: int = 0

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


def run(scene: Scene, on_progress: ProgressCallback | None = None) -> Result:
    """Run `scene` to its end and return everything it gave.

    Ctrl-C ends it early: the result then holds what there is, with `interrupted` set.

    Raises:
        RunError: as `simulate`; its `results` hold what came before.
    """
    return run_many([scene], on_progress)[0]


def run_many(scenes: Sequence[Scene], on_progress: ProgressCallback | None = None) -> list[Result]:
    """Run scenes with the same lattice counts side by side, one lattice on each CPU thread.

    Raises:
        ValueError: no scenes, or different lattice counts.
        RunError: as `run`.
    """
    counts = {(scene.block.columns, scene.block.rows) for scene in scenes}
    if len(counts) != 1:
        raise ValueError(f"one batch takes scenes with the same lattice counts, not {counts}")
    wall = _Wall()
    runs: list[_Run] = []
    interrupted = False
    try:
        for runs in _drive(scenes, wall):
            if on_progress is not None:
                on_progress(
                    Progress(
                        time=min(run.time for run in runs),
                        fraction=sum(run.fraction for run in runs) / len(runs),
                        steps=wall.steps,
                        wall=wall.seconds,
                    )
                )
    except KeyboardInterrupt:
        interrupted = True
        if not wall.clocks or not all(run.rows for run in runs):
            raise
    results = [_result(run, wall, b, interrupted) for b, run in enumerate(runs)]
    _raise_on_failure(runs, results)
    return results


@dataclass
class _Wall:
    """How long the engine took, and the clocks and impactors that it left."""

    seconds: float = 0.0
    steps: int = 0
    nodes: int = 0
    clocks: dict[str, np.ndarray] = field(default_factory=dict)
    max_overlap: np.ndarray | None = None


def _drive(scenes: Sequence[Scene], wall: _Wall) -> Iterator[list[_Run]]:
    """Advance a batch call by call; yields the same list of runs after each."""
    block = scenes[0].block
    runtime.start()
    with borrowed(len(scenes), block.columns, block.rows) as lattice:
        lattice.load(scenes)
        stepper.prepare(lattice)
        advance = stepper.advance_of(lattice)
        advance(lattice, 0)  # compiles; not counted as stepping
        runs = [_Run(scene) for scene in scenes]
        wall.nodes = lattice.nodes
        most_steps = 1
        while any(run.status == RUNNING for run in runs):
            lattice.pause.from_numpy(np.array([run.next_snapshot for run in runs]))
            start = time.perf_counter()
            advance(lattice, most_steps)
            ti.sync()
            took = time.perf_counter() - start
            wall.seconds += took
            most_steps = _steps_for_call(most_steps, took)
            _collect(lattice, runs, wall)
            yield runs


def _steps_for_call(most_steps: int, took: float) -> int:
    """Steps of the next call: towards CALL_SECONDS, at most doubling."""
    wanted = most_steps * CALL_SECONDS / max(took, 1e-6)
    return int(np.clip(wanted, 1, min(2 * most_steps, MOST_STEPS)))


def _collect(lattice: Lattice, runs: list[_Run], wall: _Wall) -> None:
    """Take the rows that a call has left, and the snapshots that are due."""
    clocks = lattice.clock.to_numpy()
    history = lattice.history.to_numpy()
    due = []
    for b, run in enumerate(runs):
        was_running = run.status == RUNNING
        run.status, run.time = int(clocks["status"][b]), float(clocks["time"][b])
        run.bad_node = int(clocks["bad_node"][b])
        if clocks["rows"][b]:
            run.rows.append(history[b, : clocks["rows"][b]].copy())
        if was_running and (run.status != RUNNING or run.time >= run.next_snapshot):
            due.append(b)
    lattice.clock.get_member_field("rows").fill(0)
    if due:
        snapshots = lattice.snapshots()
        for b in due:
            kept = runs[b].snapshots
            if kept and kept[-1].time == snapshots[b].time:
                kept.pop()  # the run has ended where its last snapshot was due
            kept.append(snapshots[b])
    wall.clocks = clocks
    wall.steps = int(clocks["steps"].sum())
    wall.max_overlap = lattice.column_overlap.to_numpy().max(axis=1)


def _result(run: _Run, wall: _Wall, b: int, interrupted: bool) -> Result:
    rows: dict[str, np.ndarray] = dict(zip(ROW_COLUMNS, np.concatenate(run.rows).T, strict=True))
    clocks = wall.clocks
    assert wall.max_overlap is not None
    return Result(
        scene=run.scene,
        history=_history(run.scene, rows),
        snapshots=run.snapshots,
        run={
            "ended_by": ENDINGS[run.status],
            "interrupted": interrupted and run.status == RUNNING,
            "steps": int(clocks["steps"][b]),
            "dt_min_s": float(clocks["shortest"][b]),
            "dt_max_s": float(clocks["longest"][b]),
            "max_overlap_m": float(wall.max_overlap[b]),
            "batch": len(clocks["steps"]),
            "wall_s": wall.seconds,
            "node_stages_per_s": 4 * wall.nodes * wall.steps / max(wall.seconds, 1e-9),
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


def _raise_on_failure(runs: list[_Run], results: Sequence[Result] = ()) -> None:
    """Say when and where a run failed, with what it left."""
    for run in runs:
        if run.status in (NOT_FINITE, CROWDED):
            raise RunError(_failure(run), list(results))


def _failure(run: _Run) -> str:
    last = run.snapshots[-1]
    if run.status == CROWDED:
        return (
            f"{run.scene.name}: at {run.time * 1e3:.4f} ms more pieces touch than the neighbour "
            "list holds; set model.self_contact = false or take a finer lattice"
        )
    return (
        f"{run.scene.name}: went astray at {run.time * 1e3:.4f} ms, first at node "
        f"({run.bad_node // last.position.shape[1]}, {run.bad_node % last.position.shape[1]}): "
        "values that are not finite, or beyond all measure; take a smaller numerics.dt, or 'auto'"
    )
