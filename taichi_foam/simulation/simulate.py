"""Run scenes, one or many.

    from taichi_foam import paper_scene, run
    result = run(paper_scene("paper/wedge-2.86"))

`simulate` yields snapshots of one scene as they are recorded, and `simulate_many` results of many
scenes as the scenes end. `run` and `run_many` return results; `run_drops` returns the results of
successive drops on one block. All take `arch` and `threads`, which start Taichi as `init` does;
None keeps what already runs, else uses the CPU with all its cores.
"""

import atexit
import contextlib
import functools
import hashlib
import weakref
from collections.abc import Callable, Generator, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

import psutil

from taichi_foam.engine import runtime
from taichi_foam.errors import Interrupted, RunError, UserError, warn_of_run
from taichi_foam.records.ending import Ending
from taichi_foam.records.snapshot import Snapshot
from taichi_foam.results.files import drop_name
from taichi_foam.results.folders import Claim, claimed
from taichi_foam.results.result import Result, request_of, snapshots_bytes
from taichi_foam.scene import Scene
from taichi_foam.scene.files import scene_to_toml
from taichi_foam.simulation import batches
from taichi_foam.simulation.after import After
from taichi_foam.simulation.batches import Afters, Run, Wall
from taichi_foam.simulation.checkpoint import Checkpoint, Checkpoints, work_in


@dataclass(frozen=True)
class Progress:
    """How far a run or a batch of runs is; reported after each call of the engine."""

    time: float  # of the slowest lattice on the device [s]
    fraction: float  # 0 to 1; an impact ends when its velocity is spent
    steps: int  # of all lattices together
    wall: float  # [s]
    finished: int = 0
    of: int = 1


ProgressCallback = Callable[[Progress], None]


def init(arch: str | None = None, threads: int | None = None) -> None:
    """Choose the device for all runs of this process; without this call the first run decides.

    Args:
        arch: "cpu", "cuda", "vulkan" or "metal"; None: what already runs, else the CPU.
        threads: CPU threads; None: what already runs, else all cores.

    Raises:
        UserError: the arch is unknown or not available here, the number of threads is invalid, or
            this process already runs with other settings.
    """
    runtime.start(arch, threads)


def check_scenes(scenes: object) -> None:
    """Raise UserError unless `scenes` is a sequence of scenes."""
    if not isinstance(scenes, Sequence) or isinstance(scenes, str):
        raise UserError(f"scenes: must be a list of scenes, not {type(scenes).__name__}")
    for each in scenes:
        if isinstance(each, Scene):
            continue
        if isinstance(each, str | Path):
            found = str(each)
            raise UserError(f"scene = {found!r}: must be a Scene. Fix: tf.load_scene({found!r})")
        raise UserError(f"scene: must be a Scene, not {type(each).__name__}")


P = ParamSpec("P")
T = TypeVar("T")

_open: weakref.WeakSet[Generator[Any, None, None]] = weakref.WeakSet()


@atexit.register
def _close_open() -> None:
    """Close what a script has left half done, while its modules and the device still exist."""
    for left in list(_open):
        with contextlib.suppress(ValueError):  # another thread is in it
            left.close()


def _closed_at_exit(
    function: Callable[P, Generator[T, None, None]],
) -> Callable[P, Generator[T, None, None]]:
    """Close the function's generators at the end of the program, where the caller did not."""

    @functools.wraps(function)
    def opened(*args: P.args, **kwargs: P.kwargs) -> Generator[T, None, None]:
        generator = function(*args, **kwargs)
        _open.add(generator)
        return generator

    return opened


@_closed_at_exit
def simulate(
    scene: Scene, *, arch: str | None = None, threads: int | None = None
) -> Generator[Snapshot, None, None]:
    """Step through `scene`, yielding a snapshot every `output.snapshot_interval`.

    Raises:
        UserError: as `init`.
        RunError: the run diverged, or too many pieces touch in one place.
    """
    check_scenes([scene])
    init(arch, threads)
    for (run,) in batches.advance_all([scene], Wall()):
        assert isinstance(run.snapshots, list)
        yield from run.snapshots
        run.snapshots.clear()  # the caller has them now
        _raise_on_failure([run])


@_closed_at_exit
def simulate_many(
    scenes: Sequence[Scene],
    on_progress: ProgressCallback | None = None,
    *,
    after: Sequence[Result | str | Path | After | None] = (),
    checkpoint: str | Path | Claim | None = None,
    every: float | None = None,
    arch: str | None = None,
    threads: int | None = None,
) -> Generator[tuple[int, Result], None, None]:
    """Run scenes side by side, yielding each one's place in `scenes` and its result as it ends.

    Scenes may differ in everything. Those with equal lattice sizes share a batch, one lattice on
    each CPU thread, and a lattice that has ended makes room for the next. Yielded results are not
    kept. A result does not depend, to the last bit, on what else is run.

    A run that fails is yielded like any other; its `ending` says so. Ctrl-C takes effect once all
    runs that have ended have been yielded.

    Args:
        scenes: what to run.
        on_progress: called after each call of the engine.
        after: for each scene the earlier run that left its block, as in `run`, or None for a fresh
            one; empty: all are fresh.
        checkpoint: folder for checkpoints, or a claim that is already held on one. Runs continue
            from the checkpoints in it; runs that have ended are yielded, not computed again.
        every, arch, threads: as `run`.

    Raises:
        UserError: as `run`.
    """
    check_scenes(scenes)
    init(arch, threads)
    if after and len(after) != len(scenes):
        raise UserError(f"after: {len(after)} earlier runs for {len(scenes)} scenes; give one each")
    afters = [_after(scene, before) for scene, before in zip(scenes, after, strict=False)]
    if checkpoint is None:
        _check_memory(scenes[:1])  # the caller decides how many are held at a time
    with _claimed(checkpoint, lambda: _requests_of(scenes, afters)) as claim:
        kept = _numbered(claim, len(scenes), every)
        for _, ended in _advanced(scenes, Wall(), on_progress, kept, afters):
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
    """Run `scene` to its end and return its result.

    Ctrl-C ends it early: the result then holds what was computed so far, and its ending is
    INTERRUPTED. A `RunWarning` says what makes its figures doubtful, if anything does
    (`Result.warnings`).

    Args:
        scene: what to run.
        on_progress: called after each call of the engine.
        after: the result of an earlier run, or its folder. This run continues on the same block,
            which starts exactly (to the last bit) as that run left it. The impactor may be a
            different one, or none; it starts its gap above the foam as it lies. Block, foam, model,
            base and start must be those of the earlier run. None: a fresh block.
        checkpoint: folder for a checkpoint of the run. The run continues from a checkpoint that is
            there. One is written every `every` seconds of wall time, on interruption and at the
            end. Snapshots are stored there too, instead of in memory. Use the folder that the
            result will be saved to: `Result.save` then removes the checkpoint. May also be a claim
            that is already held.
        every: see `checkpoint` [s]; None: a minute; inf: only on interruption and at the end.
        arch, threads: as `init`.

    Raises:
        UserError: as `init`, a checkpoint cannot be continued, or the run cannot follow `after`.
        RunError: as `simulate`; its `results` hold what came before.
    """
    check_scenes([scene])
    begun = _after(scene, after)
    with _claimed(checkpoint, lambda: request_of(scene, begun and begun.told)) as claim:
        init(arch, threads)
        kept = None if claim is None else Checkpoints([claim.work], every)
        return _run_one(scene, on_progress, kept, begun)


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

    Each drop starts with the block as the previous drop left it, as with `after` in `run`. Ctrl-C
    ends the series early; the last result is then an interrupted one.

    Args:
        scene: scene of the first drop.
        count: how many drops, 1 to MOST_DROPS.
        on_progress: called after each call of the engine; the drops that are over count as
            finished.
        checkpoint: folder for checkpoints of the series, or a claim that is already held on one.
            Drops continue from the checkpoints in it; those that have ended are not computed again.
        every, arch, threads: as `run`.

    Raises:
        UserError: as `run`, or the count is out of range.
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
        init(arch, threads)
        while len(results) < count and not (results and results[-1].ending is Ending.INTERRUPTED):
            over = latest
            kept = claim and Checkpoints([claim.work / drop_name(len(results) + 1)], every)
            try:
                after = After.of(scene, results[-1]) if results else None
            except UserError as error:
                raise RunError(f"drop {len(results) + 1}: {error}", results) from None
            try:
                results.append(_run_one(scene, tell, kept, after))
            except RunError as error:
                raise RunError(str(error), [*results, *error.results]) from None
    return results


MOST_DROPS = 1000


def check_drops(count: int) -> None:
    """Raise UserError if the number of drops is out of range."""
    if not 1 <= count <= MOST_DROPS:
        raise UserError(f"drops = {count}: must be at least 1 and at most {MOST_DROPS}")


def drops_request(scene: Scene, count: int) -> dict[str, Any]:
    """The request that identifies a series of drops when a folder is claimed for it."""
    return {**request_of(scene), "drops": count}


def resume(
    path: str | Path,
    on_progress: ProgressCallback | None = None,
    *,
    every: float | None = None,
    arch: str | None = None,
    threads: int | None = None,
) -> Result:
    """Continue the run whose checkpoint lies in the folder `path`, and return its result.

    The result equals that of an uninterrupted run to the last bit. `arch` defaults to that of the
    checkpoint.

    Raises:
        UserError: there is no checkpoint, it is damaged, or it comes from another version or kind
            of device.
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
        Interrupted: on Ctrl-C. Its `results` hold the results of all scenes that had begun, by
            place; unfinished ones have the ending INTERRUPTED.
        RunError: as `run`, once all others have ended; its `results` hold everything.
    """
    check_scenes(scenes)
    with _claimed(checkpoint, lambda: _requests_of(scenes)) as claim:
        init(arch, threads)
        kept = _numbered(claim, len(scenes), every)
        return _run_all(scenes, on_progress, kept)


@contextlib.contextmanager
def _claimed(
    checkpoint: str | Path | Claim | None, request: Callable[[], dict[str, Any]]
) -> Iterator[Claim | None]:
    """The claim on a folder for checkpoints, which may be held already; None if none are wanted."""
    if checkpoint is None or isinstance(checkpoint, Claim):
        yield checkpoint
        return
    with claimed(checkpoint, request()) as claim:
        yield claim


def _after(scene: Scene, before: Result | str | Path | After | None) -> After | None:
    """A run of `scene` on the block that an earlier run left; None: on a fresh one."""
    return before if before is None or isinstance(before, After) else After.of(scene, before)


def _requests_of(scenes: Sequence[Scene], afters: Afters = ()) -> dict[str, Any]:
    """The request that identifies many scenes when a folder is claimed for their checkpoints."""
    digest = hashlib.sha256()
    for scene in scenes:
        digest.update(scene_to_toml(scene).encode())
    for after in afters:
        digest.update(repr(after and sorted(after.told.items())).encode())
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
    after: After | None,
) -> Result:
    """The result of one scene; an interrupted one after Ctrl-C."""
    try:
        return _run_all([scene], on_progress, checkpoints, [after])[0]
    except Interrupted as interrupted:
        return interrupted.results[0]


def _run_all(
    scenes: Sequence[Scene],
    on_progress: ProgressCallback | None,
    checkpoints: Checkpoints | None,
    after: Afters = (),
) -> list[Result]:
    """All results in order. On Ctrl-C raises Interrupted if there are any results."""
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
    after: Afters = (),
) -> Iterator[tuple[list[Run], dict[int, Result]]]:
    """Yield, after each call of the engine, the runs on the device and the results of ended runs.

    Progress is reported once the caller has taken both.
    """
    finished = 0
    for runs in batches.advance_all(scenes, wall, checkpoints, after):
        ended = {run.index: batches.result_of(run, wall) for run in runs if run.ended}
        yield runs, ended
        finished += len(ended)
        if on_progress is not None:
            on_progress(_progress(runs, wall, finished, len(scenes)))


def _warn(result: Result) -> None:
    """Warn once of everything that makes a result doubtful."""
    if not result.warnings or result.failure:
        return  # a failure is reported by its error
    warn_of_run("\n  ".join((f"{result.scene.name}:", *result.warnings)))


def _check_memory(scenes: Sequence[Scene]) -> None:
    """Raise UserError if the snapshots would not fit into memory."""
    needed, free = sum(map(snapshots_bytes, scenes)), psutil.virtual_memory().available
    if needed > free:
        raise UserError(
            f"output.snapshot_interval: the snapshots need about {needed / 1e9:.1f} GB, and "
            f"{free / 1e9:.1f} GB of memory are free. Fix: pass checkpoint=FOLDER, so that they "
            "are written to disk as they are taken, make output.snapshot_interval longer, or set "
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
    """Raise RunError if a run failed: when and where, with the results so far."""
    for run in runs:
        if run.failure is not None:
            raise RunError(run.failure, list(results))
