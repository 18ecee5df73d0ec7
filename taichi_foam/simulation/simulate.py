"""Run scenes, one or many.

    from taichi_foam import run
    from taichi_foam.shim2000.tests import paper_scene
    result = run(paper_scene("paper/wedge-2.86"))

`simulate` yields snapshots of one scene as they come, `simulate_many` results of many scenes as
they come; `run` and `run_many` return results. All take `arch` and `threads`, which start Taichi as
`init` does; None takes what already runs, else the CPU with all its cores.
"""

from collections.abc import Callable, Generator, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from taichi_foam.engine import runtime
from taichi_foam.errors import RunError, warn_of_run
from taichi_foam.records.snapshot import Snapshot
from taichi_foam.results.result import Result
from taichi_foam.scene import Scene
from taichi_foam.simulation import batches
from taichi_foam.simulation.batches import Run, Wall
from taichi_foam.simulation.checkpoint import Checkpoint, Checkpoints


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


def init(arch: str | None = None, threads: int | None = None) -> None:
    """Say what to compute on, for all runs of this process; without it the first run decides.

    Args:
        arch: "cpu", "cuda", "vulkan" or "metal"; None: what already runs, else the CPU.
        threads: CPU threads; None: what already runs, else all cores.

    Raises:
        UserError: an arch that is unknown or cannot be had here, a bad number of threads, or others
            than those that this process already runs with.
    """
    runtime.start(arch, threads)


def simulate(
    scene: Scene, *, arch: str | None = None, threads: int | None = None
) -> Iterator[Snapshot]:
    """Step through `scene`, yielding a snapshot every `output.snapshot_interval`.

    Raises:
        UserError: as `init`.
        RunError: the run diverged, or too many pieces touch in one place.
    """
    init(arch, threads)
    given = 0
    for runs in batches.advance_all([scene], Wall()):
        yield from runs[0].snapshots[given:]
        given = len(runs[0].snapshots)
        _raise_on_failure(runs)


def simulate_many(
    scenes: Sequence[Scene],
    on_progress: ProgressCallback | None = None,
    *,
    arch: str | None = None,
    threads: int | None = None,
) -> Generator[tuple[int, Result], None, None]:
    """Run scenes side by side, yielding each one's place in `scenes` and its result as it ends.

    They may differ in everything. Those with the same lattice counts share a batch, one lattice on
    each CPU thread, and a lattice that has ended makes room for the next. Nothing is kept of what
    has been yielded. A result does not depend, to the last bit, on what else is run.

    A run that fails is yielded like any other; its `ending` says so.

    Raises:
        UserError: as `init`.
    """
    init(arch, threads)
    wall = Wall()
    finished = 0
    for runs in batches.advance_all(scenes, wall):
        ended = [run for run in runs if run.ended]
        finished += len(ended)
        if on_progress is not None:
            on_progress(_progress(runs, wall, finished, len(scenes)))
        for run in ended:
            yield run.index, batches.result_of(run, wall)


def run(
    scene: Scene,
    on_progress: ProgressCallback | None = None,
    *,
    checkpoint: str | Path | None = None,
    every: float | None = None,
    arch: str | None = None,
    threads: int | None = None,
) -> Result:
    """Run `scene` to its end and return everything it gave.

    Ctrl-C ends it early: the result then holds what there is, and its ending is INTERRUPTED. A
    `RunWarning` says what makes its figures doubtful, if anything does (`Result.warnings`).

    Args:
        scene: what to run.
        on_progress: called after each call of the engine.
        checkpoint: folder for a checkpoint of the run, from which it goes on if there is one:
            written every `every` seconds of wall time, and when it is interrupted.
        every: see `checkpoint` [s]; None: a minute; inf: only when it is interrupted.
        arch, threads: as `init`.

    Raises:
        UserError: as `init`, or a checkpoint cannot be continued.
        RunError: as `simulate`; its `results` hold what came before.
    """
    kept = None if checkpoint is None else Checkpoints([Path(checkpoint)], every)
    return _run_all([scene], on_progress, kept, arch, threads)[0]


def resume(
    path: str | Path,
    on_progress: ProgressCallback | None = None,
    *,
    every: float | None = None,
    arch: str | None = None,
    threads: int | None = None,
) -> Result:
    """Continue the run whose checkpoint lies in the folder `path`, and return its result.

    It is the result of an unbroken run, to the last bit; `arch` is by default that of the run.

    Raises:
        UserError: there is no checkpoint, it is damaged, or of another version or kind of device.
        RunError: as `run`.
    """
    scene, kept_arch = Checkpoint.head(Path(path))
    return run(
        scene, on_progress, checkpoint=path, every=every, arch=arch or kept_arch,
        threads=threads,
    )  # fmt: skip


def run_many(
    scenes: Sequence[Scene],
    on_progress: ProgressCallback | None = None,
    *,
    checkpoint: str | Path | None = None,
    every: float | None = None,
    arch: str | None = None,
    threads: int | None = None,
) -> list[Result]:
    """Run scenes as `simulate_many` does, and return their results in order.

    Ctrl-C ends it early: there are then results of the scenes that were begun; the ending of those
    that had not ended is INTERRUPTED.

    Args:
        scenes: what to run.
        on_progress: called after each call of the engine.
        checkpoint: folder for checkpoints, a folder in it for each scene, named by its place. Runs
            go on from those that are there; what has ended is not computed again.
        every, arch, threads: as `run`.

    Raises:
        UserError: as `run`.
        RunError: as `run`, once all others have ended; its `results` hold everything.
    """
    kept = None
    if checkpoint is not None:
        kept = Checkpoints([Path(checkpoint) / f"{n:05d}" for n in range(len(scenes))], every)
    return _run_all(scenes, on_progress, kept, arch, threads)


def _run_all(
    scenes: Sequence[Scene],
    on_progress: ProgressCallback | None,
    checkpoints: Checkpoints | None,
    arch: str | None,
    threads: int | None,
) -> list[Result]:
    init(arch, threads)
    wall = Wall()
    begun: dict[int, Run] = {}
    results: dict[int, Result] = {}
    try:
        for runs in batches.advance_all(scenes, wall, checkpoints):
            begun.update((run.index, run) for run in runs)
            for run in runs:
                if run.ended:
                    results[run.index] = batches.result_of(run, wall)
            if on_progress is not None:
                on_progress(_progress(runs, wall, len(results), len(scenes)))
    except KeyboardInterrupt:
        for index, run in begun.items():
            if index not in results and run.rows:
                results[index] = batches.result_of(run, wall)
        if not results:
            raise
    ordered = [results[index] for index in sorted(results)]
    for result in ordered:
        _warn(result)
    _raise_on_failure(list(begun.values()), ordered)
    return ordered


def _warn(result: Result) -> None:
    """Warn once of what there is to say against a result."""
    if not result.warnings or (result.ending is not None and result.ending.failed):
        return  # of a failure its error tells
    warn_of_run("\n  ".join((f"{result.scene.name}:", *result.warnings)))


def _progress(runs: list[Run], wall: Wall, finished: int, of: int) -> Progress:
    running = [run for run in runs if not run.ended]
    return Progress(
        time=min(run.time for run in runs),
        fraction=(finished + sum(run.fraction for run in running)) / of,
        steps=wall.steps,
        wall=wall.seconds,
        finished=finished,
        of=of,
    )


def _raise_on_failure(runs: Sequence[Run], results: Sequence[Result] = ()) -> None:
    """Say when and where a run failed, with what it left."""
    for run in runs:
        if run.failure is not None:
            raise RunError(run.failure, list(results))
