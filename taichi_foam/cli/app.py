"""The commands. Each checks everything that could go wrong before it computes anything."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console

from taichi_foam import version as package
from taichi_foam.analysis import balance
from taichi_foam.catalogue import list_scenes, load_scene
from taichi_foam.cli import foam, keys, replay, serve, sweep
from taichi_foam.cli.films import draw_films
from taichi_foam.cli.options import (
    After,
    Arch,
    Checkpoint,
    Choices,
    Drops,
    Dt,
    Frames,
    Live,
    NoFilm,
    Out,
    Overwrite,
    SceneName,
    Set,
    Threads,
)
from taichi_foam.cli.outcome import exit_codes, say_assumed, say_warnings, say_where
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

_app = typer.Typer(
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)


def main() -> None:
    """Run the command that the process was started with."""
    _app(prog_name="taichi-foam")


def run_script(scene: Scene) -> None:
    """Run `scene` with the options of `run` that the process was started with."""
    script = typer.Typer(
        add_completion=False, pretty_exceptions_enable=False, rich_markup_mode=None
    )

    @script.command(help=f"Run the scene {scene.name!r} of this script.")
    def command(
        out: Out = None,
        set_: Set = None,
        choices: Choices = None,
        dt: Dt = None,
        arch: Arch = "cpu",
        threads: Threads = None,
        overwrite: Overwrite = False,
        no_film: NoFilm = False,
        frames: Frames = False,
        live: Live = False,
        checkpoint: Checkpoint = None,
        after: After = None,
        drops: Drops = None,
    ) -> None:
        overrides = _overrides(set_, dt, no_film, frames)
        _run(
            scene, out, choices, overrides, arch, threads, overwrite, live, checkpoint, after, drops
        )

    script()


def _show_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"taichi-foam {package.version()}")
        raise typer.Exit


@_app.callback(help="Impact on crushable foam: a breakable particle lattice on Taichi.")
def _root(
    version: Annotated[
        bool,
        typer.Option(
            "--version", callback=_show_version, is_eager=True, help="Show the version and leave."
        ),
    ] = False,
) -> None:
    """Hold the options that belong to no command."""


@_app.command("run")
def run_command(
    scene: SceneName,
    out: Out = None,
    set_: Set = None,
    choices: Choices = None,
    dt: Dt = None,
    arch: Arch = "cpu",
    threads: Threads = None,
    overwrite: Overwrite = False,
    no_film: NoFilm = False,
    frames: Frames = False,
    live: Live = False,
    checkpoint: Checkpoint = None,
    after: After = None,
    drops: Drops = None,
) -> None:
    """Run one scene and write its result: histories, snapshots, measures, a GIF and an MP4."""
    overrides = _overrides(set_, dt, no_film, frames)
    _run(scene, out, choices, overrides, arch, threads, overwrite, live, checkpoint, after, drops)


@_app.command("resume")
def resume_command(
    folder: Annotated[str, typer.Argument(metavar="RUN_DIR", help="Folder of a run.")],
    threads: Threads = None,
    checkpoint: Checkpoint = None,
) -> None:
    """Continue a run that was killed or interrupted, from the checkpoint in its folder."""
    console, errors = Console(highlight=False), Console(stderr=True, highlight=False)
    bars = Bars(errors)
    with exit_codes(errors):
        from taichi_foam.engine import runtime
        from taichi_foam.simulation import simulate
        from taichi_foam.simulation.after import After
        from taichi_foam.simulation.checkpoint import Checkpoint as Stored
        from taichi_foam.simulation.checkpoint import work_in

        scene, arch, told = Stored.head(work_in(Path(folder)))
        with claimed(folder, request_of(scene, told)) as claim:
            runtime.start(arch, threads)
            _compute_and_save(
                scene.name,
                lambda on_progress: simulate.run(
                    scene,
                    on_progress,
                    after=None if told is None else After(told),
                    checkpoint=claim,
                    every=checkpoint,
                ),
                claim, folder, bars, console, errors,
            )  # fmt: skip


@_app.command("scenes")
def scenes_command() -> None:
    """List the built-in scenes."""
    known = list_scenes()
    width = max(map(len, known)) + 2
    for name, about in known.items():
        typer.echo(f"{name:<{width}}{about}")


_app.command("keys")(keys.keys_command)
_app.command("render")(replay.render_command)
_app.command("compare")(replay.compare_command)
_app.command("serve")(serve.serve_command)
_app.add_typer(sweep.app, name="sweep")
_app.add_typer(foam.app, name="foam")


@_app.command("reproduce")
def reproduce_command(
    out: Annotated[str, typer.Option(help="Folder for report, tables and runs.")] = "reproduction",
    cases: Annotated[
        str | None, typer.Option(metavar="NAME,...", help="Some of the nine tests; default: all.")
    ] = None,
    ensemble: Annotated[
        int | None,
        typer.Option(
            metavar="N",
            help="Run each test N times with velocities within 0.5 %, and report medians and "
            "5-95 % bands; 16 is a good number. Default: each test once.",
        ),
    ] = None,
    choices: Choices = "calibrated",
    arch: Arch = "cpu",
    threads: Threads = None,
    overwrite: Overwrite = False,
    no_films: Annotated[bool, typer.Option("--no-films", help="Write no GIFs and MP4s.")] = False,
) -> None:
    """Run the paper's nine impacts and write a report: tables, curves, pictures."""
    console, errors = Console(highlight=False), Console(stderr=True, highlight=False)
    with exit_codes(errors):
        from taichi_foam.cli import tables
        from taichi_foam.shim2000.reproduce import reproduce

        content = reproduce(
            out,
            None if cases is None else cases.split(","),
            ensemble=ensemble,
            choices=choices or "calibrated",
            arch=arch,
            threads=threads,
            overwrite=overwrite,
            films=not no_films,
            bars=Bars(errors),
        )
        console.print(tables.study(content))
        if content["ensemble"]:
            console.print(tables.scores(content))
        if content["criteria"]:
            console.print(tables.criteria(content))
        say_where(console, out)
        for text in content["warnings"]:
            errors.print(f"warning: {text}", soft_wrap=True, markup=False)
        if content["interrupted"]:
            missing = ", ".join(name.removeprefix("paper/") for name in content["not_finished"])
            left = f"not finished and left out: {missing}" if missing else "films may be missing"
            raise KeyboardInterrupt(
                f"what has finished is kept; {left}; the same command goes on from there"
            )


def _overrides(given: list[str] | None, dt: str | None, no_film: bool, frames: bool) -> list[str]:
    """The options as scene overrides; --set comes last and so has the last word."""
    overrides = [] if dt is None else [f"numerics.dt={dt}"]
    if no_film:
        overrides.append("output.film=false")
    if frames:
        overrides.append("output.frames=true")
    return [*overrides, *(given or [])]


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


def _run(
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
) -> None:
    """Load, check, compute, save, show."""
    console, errors = Console(highlight=False), Console(stderr=True, highlight=False)
    bars = Bars(errors)
    with exit_codes(errors):
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
