"""`run` and `resume`: one scene computed, saved, drawn and told."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console

from taichi_foam.analysis import balance
from taichi_foam.catalogue import load_scene
from taichi_foam.cli.films import draw_films
from taichi_foam.cli.outcome import say_assumed, say_warnings, say_where
from taichi_foam.errors import RunError, UserError
from taichi_foam.interrupts import held_interrupts
from taichi_foam.records.ending import Ending
from taichi_foam.results.files import file_name
from taichi_foam.results.folders import Claim, claimed, size_text
from taichi_foam.results.result import Result, request_of, storage_bytes
from taichi_foam.scene import Scene, block
from taichi_foam.scene.values import settings
from taichi_foam.simulation.progress import Bars

if TYPE_CHECKING:
    from taichi_foam.simulation.simulate import ProgressCallback

# A run that may take more than this is told before it begins [bytes].
_WORTH_SAYING = 1e9
# The default folder's name says what was changed, up to so many letters.
_LONGEST_CHANGES = 60


def run(
    source: str | Scene,
    out: str | None,
    choices: str | None,
    overrides: list[str],
    arch: str,
    threads: int | None,
    overwrite: bool,
    live: bool,
    every: float | None,
    after: str | None,
    drops: int | None,
    bars: Bars,
    console: Console,
    errors: Console,
) -> None:
    """`run`: load, check, compute, save, show. Raises UserError, RunError, KeyboardInterrupt."""
    scene = load_scene(source, choices, overrides)
    _check_combination(live, after, drops)
    for said in (balance.doubt(scene), block.advice(scene.block)):
        if said is not None:
            errors.print(f"note: {said}", soft_wrap=True, markup=False)
    words = [] if after is None else [f"after-{Path(after).resolve().name}"]
    words += [] if drops is None else [f"{drops}-drops"]
    folder = _default_folder(scene, choices, overrides, words) if out is None else out
    # Names and values are right: now what needs Taichi, and costs its import.
    if live:
        from taichi_foam.cli.live import run_live

        run_live(scene, folder, overwrite, every, arch, threads, bars, console, errors)
        return
    if drops is not None:
        from taichi_foam.cli.series import run_series

        run_series(scene, drops, folder, arch, threads, overwrite, every, bars, console, errors)
        return
    from taichi_foam.engine import runtime
    from taichi_foam.picture import films
    from taichi_foam.simulation import simulate
    from taichi_foam.simulation.after import After

    before = None if after is None else After.of(scene, after)
    needed = storage_bytes(scene) + films.storage_bytes(scene)
    request = request_of(scene, before and before.told)
    with claimed(folder, request, overwrite, needed) as claim:
        runtime.start(arch, threads)  # before the bar: what is wrong with it is no failed run
        if needed > _WORTH_SAYING:
            bars.say(f"{folder} may take up to {size_text(needed)} on the disk")
        _compute_and_save(
            scene.name,
            lambda on_progress: simulate.run(
                scene, on_progress, after=before, checkpoint=claim, every=every
            ),
            claim, folder, bars, console, errors,
        )  # fmt: skip


def resume(
    folder: str,
    threads: int | None,
    every: float | None,
    bars: Bars,
    console: Console,
    errors: Console,
) -> None:
    """`resume`: as `run`, from the checkpoint in a folder, and of its scene."""
    from taichi_foam.engine import runtime
    from taichi_foam.simulation import simulate
    from taichi_foam.simulation.after import After
    from taichi_foam.simulation.checkpoint import Checkpoint, work_in

    scene, arch, told = Checkpoint.head(work_in(Path(folder)))
    with claimed(folder, request_of(scene, told)) as claim:
        runtime.start(arch, threads)
        _compute_and_save(
            scene.name,
            lambda on_progress: simulate.run(
                scene,
                on_progress,
                after=None if told is None else After(told),
                checkpoint=claim,
                every=every,
            ),
            claim, folder, bars, console, errors,
        )  # fmt: skip


def _default_folder(
    scene: Scene, choices: str | None, overrides: list[str], more: Sequence[str]
) -> str:
    """A folder of its own for a scene and each way to change it; what is drawn does not count."""
    values = {key: v for key, v in settings(overrides).items() if not key.startswith("output.")}
    words = [*([choices] if choices else []), *more]
    words += [f"{key}-{value}" for key, value in sorted(values.items())]
    name, changes = file_name(scene.name), file_name("-".join(words)) if words else ""
    if len(changes) > _LONGEST_CHANGES:
        changes = hashlib.sha256(changes.encode()).hexdigest()[:12]
    return f"runs/{name}-{changes}" if changes else f"runs/{name}"


def _check_combination(live: bool, after: str | None, drops: int | None) -> None:
    """Refuse options that do not go together. Raises UserError."""
    if live and (after is not None or drops is not None):
        option = "--after" if drops is None else "--drops"
        raise UserError(
            f"--live: shows drops on fresh blocks only, not {option}; leave out one of the two"
        )
    if after is not None and drops is not None:
        raise UserError("--drops: a series begins on a fresh block; leave out --after")


def _compute_and_save(
    name: str,
    compute: Callable[[ProgressCallback], Result],
    claim: Claim,
    folder: str,
    bars: Bars,
    console: Console,
    errors: Console,
) -> None:
    """Compute with a progress bar, write the folder, draw films, show the figures."""
    failure = None
    with bars.computing(name) as on_progress:
        try:
            result = compute(on_progress)
        except RunError as error:
            if not error.results:
                raise
            result, failure = error.results[0], error
    with held_interrupts() as pressed, claim.publishing() as staging:
        result.write(staging)
    cut = pressed.is_set() or result.ending is Ending.INTERRUPTED
    no_film = None if cut or failure else draw_films(result, claim.folder, bars)
    if not cut and not isinstance(no_film, KeyboardInterrupt):
        claim.finish()
    try:
        # measures take a while to load: after the run, not before it
        from taichi_foam.cli import tables

        console.print(tables.key_figures(result.scene, result.summary))
    except Exception as error:
        told = f"{type(error).__name__}: {error}"
        raise RunError(
            f"the run could not be measured ({told}); its data are in {folder}"
        ) from error
    say_assumed(console, result, folder)
    say_where(console, folder)
    if failure is None:
        say_warnings(errors, result)
    if failure is not None:
        raise RunError(f"{failure}; what was computed until then is in {folder}")
    if cut:
        raise KeyboardInterrupt(
            f"what there was is in {folder}; the same command goes on from there, and so does "
            f"`taichi-foam resume {folder}`"
        )
    if isinstance(no_film, KeyboardInterrupt):
        raise KeyboardInterrupt(
            f"the run is in {folder}, films may be missing; the same command draws them, and so "
            f"does `taichi-foam resume {folder}`"
        )
    if no_film is not None:
        raise RunError(f"{no_film}; the run itself is complete in {folder}")
