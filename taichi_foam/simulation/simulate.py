"""Run scenes, one or many.

    from taichi_foam import paper_scene, run
    result = run(paper_scene("paper/wedge-2.86"))

`simulate` yields snapshots of one scene as they come, `simulate_many` results of many scenes as
they come; `run` and `run_many` return results, `run_drops` those of drops on one block, one after
the other. All take `arch` and `threads`, which start Taichi as
`init` does; None takes what already runs, else the CPU with all its cores.
"""

import contextlib
import hashlib
from collections.abc import Callable, Generator, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import psutil

from taichi_foam.engine import runtime
from taichi_foam.errors import Interrupted, RunError, UserError, warn_of_run
from taichi_foam.records.ending import Ending
from taichi_foam.records.snapshot import Snapshot
from taichi_foam.results.folders import Claim, claimed
from taichi_foam.results.result import Result, request_of, snapshots_bytes
from taichi_foam.scene import Scene
from taichi_foam.scene.files import scene_to_toml
from taichi_foam.simulation import batches
from taichi_foam.simulation.after import After
from taichi_foam.simulation.batches import Run, Wall
from taichi_foam.simulation.checkpoint import Checkpoint, Checkpoints, work_in


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
    for (run,) in batches.advance_all([scene], Wall()):
        assert isinstance(run.snapshots, list)
        yield from run.snapshots
        run.snapshots.clear()  # they are the caller's now
        _raise_on_failure([run])


def simulate_many(
    scenes: Sequence[Scene],
    on_progress: ProgressCallback | None = None,
    *,
    checkpoint: str | Path | Claim | None = None,
    every: float | None = None,
    arch: str | None = None,
    threads: int | None = None,
) -> Generator[tuple[int, Result], None, None]:
    """Run scenes side by side, yielding each one's place in `scenes` and its result as it ends.

    They may differ in everything. Those with the same lattice counts share a batch, one lattice on
    each CPU thread, and a lattice that has ended makes room for the next. Nothing is kept of what
    has been yielded. A result does not depend, to the last bit, on what else is run.

    A run that fails is yielded like any other; its `ending` says so. Ctrl-C is heard when all that
    has ended has been yielded.

    Args:
        scenes: what to run.
        on_progress: called after each call of the engine.
        checkpoint: folder for checkpoints, or a claim of one that is held. Runs go on from those
            that are there; what has ended is yielded and not computed again.
        every, arch, threads: as `run`.

    Raises:
        UserError: as `run`.
    """
    init(arch, threads)
    if checkpoint is None:
        _check_memory(scenes[:1])  # how many are held at a time is the caller's
    with _claimed(checkpoint, lambda: _requests_of(scenes)) as claim:
        kept = _numbered(claim, len(scenes), every)
        for _, ended in _advanced(scenes, Wall(), on_progress, kept):
            yield from ended.items()


def run(
    scene: Scene,
    on_progress: ProgressCallback | None = None,
    *,
    after: Result | str | Path | After | None = None,
    checkpoint: str | Path | Claim | None = None,
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
        after: the result of a run, or its folder, on whose block this one is to go on: it starts
            as that has ended, to the last bit. The impactor, which may be another one, or none,
            starts its gap above the foam as it lies. Block, foam, model, base and start have to be
            those of that run. None: a fresh block.
        checkpoint: folder for a checkpoint of the run, from which it goes on if there is one:
            written every `every` seconds of wall time, when it is interrupted and when it ends.
            Snapshots lie there too, instead of in memory. The folder is that of the result to come:
            `Result.save` to it takes the checkpoint away. A claim that is held will do too.
        every: see `checkpoint` [s]; None: a minute; inf: only when it ends or is interrupted.
        arch, threads: as `init`.

    Raises:
        UserError: as `init`, a checkpoint cannot be continued, or the run cannot follow `after`.
        RunError: as `simulate`; its `results` hold what came before.
    """
    if after is not None and not isinstance(after, After):
        after = After.of(scene, after)
    with _claimed(checkpoint, lambda: request_of(scene, after and after.told)) as claim:
        kept = None if claim is None else Checkpoints([claim.work], every)
        return _run_one(scene, on_progress, kept, arch, threads, after)


def run_drops(
    scene: Scene,
    count: int,
    on_progress: ProgressCallback | None = None,
    *,
    checkpoint: str | Path | Claim | None = None,
    every: float | None = None,
    arch: str | None = None,
    threads: int | None = None,
) -> list[Result]:
    """Drop the impactor `count` times on one block, and return the results in order.

    Each drop starts as the one before has left the block, as `run` does `after` it. Ctrl-C ends the
    series early: the last result is then an interrupted one.

    Args:
        scene: of the first drop.
        count: how many drops, 1 to MOST_DROPS.
        on_progress: called after each call of the engine; the drops that are over count as
            finished.
        checkpoint: folder for checkpoints of the series, or a claim of one that is held. Drops go
            on from those that are there; what has ended is not computed again.
        every, arch, threads: as `run`.

    Raises:
        UserError: as `run`, or a count that cannot be.
        RunError: as `run`; its `results` are those of all drops so far.
    """
    check_drops(count)
    results: list[Result] = []
    over, latest = Progress(0.0, 0.0, 0, 0.0), Progress(0.0, 0.0, 0, 0.0)

    def tell(progress: Progress) -> None:
        nonlocal latest
        latest = replace(
            progress,
            fraction=(len(results) + progress.fraction) / count,
            steps=over.steps + progress.steps,
            wall=over.wall + progress.wall,
            finished=len(results),
            of=count,
        )
        if on_progress is not None:
            on_progress(latest)

    with _claimed(checkpoint, lambda: drops_request(scene, count)) as claim:
        while len(results) < count and not (results and results[-1].ending is Ending.INTERRUPTED):
            over = latest
            kept = claim and Checkpoints([claim.work / drop_name(len(results) + 1)], every)
            try:
                after = After.of(scene, results[-1]) if results else None
            except UserError as error:
                raise RunError(f"drop {len(results) + 1}: {error}", results) from None
            try:
                results.append(_run_one(scene, tell, kept, arch, threads, after))
            except RunError as error:
                raise RunError(str(error), [*results, *error.results]) from None
    return results


MOST_DROPS = 1000


def check_drops(count: int) -> None:
    """Refuse a number of drops that cannot be. Raises UserError."""
    if not 1 <= count <= MOST_DROPS:
        raise UserError(f"drops = {count}: must be at least 1 and at most {MOST_DROPS}")


def drops_request(scene: Scene, count: int) -> dict[str, Any]:
    """What stands for a series of drops where a folder is claimed for it."""
    return {**request_of(scene), "drops": count}


def drop_name(number: int) -> str:
    """Folder of a drop of a series, counted from 1."""
    return f"drop-{number}"


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
    scene, kept_arch, told = Checkpoint.head(work_in(Path(path)))
    return run(
        scene,
        on_progress,
        after=None if told is None else After(told),
        checkpoint=path,
        every=every,
        arch=arch or kept_arch,
        threads=threads,
    )


def run_many(
    scenes: Sequence[Scene],
    on_progress: ProgressCallback | None = None,
    *,
    checkpoint: str | Path | Claim | None = None,
    every: float | None = None,
    arch: str | None = None,
    threads: int | None = None,
) -> list[Result]:
    """Run scenes as `simulate_many` does, and return their results in order.

    Arguments as for `simulate_many`.

    Raises:
        UserError: as `run`.
        Interrupted: Ctrl-C; its `results` hold those of the scenes that were begun, by place; the
            ending of those that had not ended is INTERRUPTED.
        RunError: as `run`, once all others have ended; its `results` hold everything.
    """
    with _claimed(checkpoint, lambda: _requests_of(scenes)) as claim:
        kept = _numbered(claim, len(scenes), every)
        return _run_all(scenes, on_progress, kept, arch, threads)


@contextlib.contextmanager
def _claimed(
    checkpoint: str | Path | Claim | None, request: Callable[[], dict[str, Any]]
) -> Iterator[Claim | None]:
    """The claim of a folder for checkpoints, which may be held already. None: none are wanted."""
    if checkpoint is None or isinstance(checkpoint, Claim):
        yield checkpoint
        return
    with claimed(checkpoint, request()) as claim:
        yield claim


def _requests_of(scenes: Sequence[Scene]) -> dict[str, Any]:
    """What stands for many scenes where a folder is claimed for their checkpoints."""
    digest = hashlib.sha256()
    for scene in scenes:
        digest.update(scene_to_toml(scene).encode())
    return {"scenes": len(scenes), "scenes_sha256": digest.hexdigest()}


def _numbered(claim: Claim | None, count: int, every: float | None) -> Checkpoints | None:
    """Folders for the checkpoints of many scenes, named by their places."""
    if claim is None:
        return None
    return Checkpoints([claim.work / f"{n:05d}" for n in range(count)], every)


def _run_one(
    scene: Scene,
    on_progress: ProgressCallback | None,
    checkpoints: Checkpoints | None,
    arch: str | None,
    threads: int | None,
    after: After | None,
) -> Result:
    """The result of one scene, which Ctrl-C may have ended early."""
    try:
        return _run_all([scene], on_progress, checkpoints, arch, threads, after)[0]
    except Interrupted as interrupted:
        return interrupted.results[0]


def _run_all(
    scenes: Sequence[Scene],
    on_progress: ProgressCallback | None,
    checkpoints: Checkpoints | None,
    arch: str | None,
    threads: int | None,
    after: After | None = None,
) -> list[Result]:
    """All results in order. Raises Interrupted once there is anything."""
    init(arch, threads)
    if checkpoints is None:
        _check_memory(scenes)
    wall = Wall()
    begun: dict[int, Run] = {}
    results: dict[int, Result] = {}
    try:
        for runs, ended in _advanced(scenes, wall, on_progress, checkpoints, after):
            begun.update((run.index, run) for run in runs)
            results.update(ended)
    except KeyboardInterrupt:
        for index, run in begun.items():
            if index not in results and run.rows:
                results[index] = batches.result_of(run, wall)
        if not results:
            raise
        raise Interrupted(results) from None
    ordered = [results[index] for index in sorted(results)]
    for result in ordered:
        _warn(result)
    _raise_on_failure(list(begun.values()), ordered)
    return ordered


def _advanced(
    scenes: Sequence[Scene],
    wall: Wall,
    on_progress: ProgressCallback | None,
    checkpoints: Checkpoints | None,
    after: After | None = None,
) -> Iterator[tuple[list[Run], dict[int, Result]]]:
    """After each call of the engine the runs on the device, and results of those that ended.

    Progress is told when both have been taken.
    """
    finished = 0
    for runs in batches.advance_all(scenes, wall, checkpoints, after):
        ended = {run.index: batches.result_of(run, wall) for run in runs if run.ended}
        yield runs, ended
        finished += len(ended)
        if on_progress is not None:
            on_progress(_progress(runs, wall, finished, len(scenes)))


def _warn(result: Result) -> None:
    """Warn once of what there is to say against a result."""
    if not result.warnings or (result.ending is not None and result.ending.failed):
        return  # of a failure its error tells
    warn_of_run("\n  ".join((f"{result.scene.name}:", *result.warnings)))


def _check_memory(scenes: Sequence[Scene]) -> None:
    """Refuse snapshots that would not fit into memory. Raises UserError."""
    needed, free = sum(map(snapshots_bytes, scenes)), psutil.virtual_memory().available
    if needed > free:
        raise UserError(
            f"output.snapshot_interval: the snapshots need about {needed / 1e9:.1f} GB, and "
            f"{free / 1e9:.1f} GB of memory are free. Fix: pass checkpoint=FOLDER, so that they "
            "are stored as they come, make output.snapshot_interval longer, or set "
            'output.snapshot_precision = "single"'
        )


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
