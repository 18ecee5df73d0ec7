"""The commands. Each checks everything that could go wrong before it computes anything."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Collection
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console

from taichi_foam.catalogue import list_scenes, load_scene
from taichi_foam.cli import replay, serve
from taichi_foam.cli.options import (
    Arch,
    Checkpoint,
    Choices,
    Dt,
    Frames,
    Live,
    NoFilm,
    Out,
    Overwrite,
    Set,
    Threads,
)
from taichi_foam.cli.outcome import INTERRUPTED, exit_codes, say_warnings, say_where
from taichi_foam.errors import RunError
from taichi_foam.records.ending import Ending
from taichi_foam.results.folders import (
    CHECKPOINT,
    RUN_FILES,
    check_output_folder,
    file_name,
    output_folder,
)
from taichi_foam.results.result import Result, storage_bytes
from taichi_foam.scene import Scene
from taichi_foam.simulation.interrupts import held_interrupts
from taichi_foam.simulation.progress import Bars
from taichi_foam.version import __version__

if TYPE_CHECKING:
    from taichi_foam.simulation.simulate import ProgressCallback

_app = typer.Typer(
    add_completion=False,
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
    ) -> None:
        overrides = _overrides(set_, dt, no_film, frames)
        _run(scene, out, choices, overrides, arch, threads, overwrite, live, checkpoint)

    script()


def _show_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"taichi-foam {__version__}")
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
    scene: Annotated[str, typer.Argument(metavar="SCENE", help="Built-in name or file.")],
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
) -> None:
    """Run one scene and write its result: histories, snapshots, measures, a GIF and an MP4."""
    overrides = _overrides(set_, dt, no_film, frames)
    _run(scene, out, choices, overrides, arch, threads, overwrite, live, checkpoint)


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
        from taichi_foam.simulation.checkpoint import Checkpoint as Stored

        scene, arch = Stored.head(Path(folder))
        check_output_folder(folder, needed_bytes=storage_bytes(scene), own=RUN_FILES)
        runtime.start(arch, threads)
        _compute_and_save(
            scene.name,
            lambda on_progress: simulate.resume(folder, on_progress, every=checkpoint),
            folder, False, RUN_FILES, bars, console, errors,
        )  # fmt: skip


@_app.command("scenes")
def scenes_command() -> None:
    """List the built-in scenes."""
    known = list_scenes()
    width = max(map(len, known)) + 2
    for name, about in known.items():
        typer.echo(f"{name:<{width}}{about}")


_app.command("render")(replay.render_command)
_app.command("compare")(replay.compare_command)
_app.command("serve")(serve.serve_command)


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
        say_where(console, out)
        for text in content["warnings"]:
            errors.print(f"warning: {text}", soft_wrap=True, markup=False)
        if content["interrupted"]:
            missing = ", ".join(name.removeprefix("paper/") for name in content["not_finished"])
            left = f"not finished and left out: {missing}" if missing else "films may be missing"
            errors.print(f"interrupted: what has finished is kept; {left}")
            raise typer.Exit(INTERRUPTED)


def _overrides(given: list[str] | None, dt: str | None, no_film: bool, frames: bool) -> list[str]:
    """The options as scene overrides; --set comes last and so has the last word."""
    overrides = [] if dt is None else [f"numerics.dt={dt}"]
    if no_film:
        overrides.append("output.film=false")
    if frames:
        overrides.append("output.frames=true")
    return [*overrides, *(given or [])]


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
) -> None:
    """Load, check, compute, save, show."""
    console, errors = Console(highlight=False), Console(stderr=True, highlight=False)
    bars = Bars(errors)
    with exit_codes(errors):
        scene = load_scene(source, choices, overrides)
        folder = f"runs/{file_name(scene.name)}" if out is None else out
        # Names and values are right: now what needs Taichi, and costs its import.
        if live:
            from taichi_foam.cli.live import run_live

            run_live(scene, folder, overwrite, arch, threads, bars, console, errors)
            return
        from taichi_foam.engine import runtime
        from taichi_foam.picture import films
        from taichi_foam.simulation import simulate

        check_output_folder(folder, overwrite, storage_bytes(scene) + films.storage_bytes(scene))
        runtime.start(arch, threads)  # before the bar: what is wrong with it is no failed run
        (Path(folder) / CHECKPOINT).unlink(missing_ok=True)  # to be overwritten: do not go on
        _compute_and_save(
            scene.name,
            lambda on_progress: simulate.run(scene, on_progress, checkpoint=folder, every=every),
            folder, overwrite, (CHECKPOINT,), bars, console, errors,
        )  # fmt: skip


def _compute_and_save(
    name: str,
    compute: Callable[[ProgressCallback], Result],
    folder: str,
    overwrite: bool,
    own: Collection[str],
    bars: Bars,
    console: Console,
    errors: Console,
) -> None:
    """Compute with a progress bar, write the folder, show the figures."""
    failure = None
    with bars.computing(name) as on_progress:
        try:
            result = compute(on_progress)
        except RunError as error:
            if not error.results:
                raise
            result, failure = error.results[0], error
    # measures take a while to load: after the run, not before it
    from taichi_foam.cli import tables

    cut = _save(result, folder, overwrite, own, bars, with_films=failure is None)
    console.print(tables.key_figures(result.scene, result.summary))
    say_where(console, folder)
    if failure is None:
        say_warnings(errors, result)
    if failure is not None:
        raise RunError(f"{failure}; what was computed until then is in {folder}")
    if cut:
        errors.print(
            f"interrupted: what there was is in {folder}; `taichi-foam resume {folder}` goes on",
            soft_wrap=True,
        )
        raise typer.Exit(INTERRUPTED)


def _save(
    result: Result,
    folder: str,
    overwrite: bool,
    own: Collection[str],
    bars: Bars,
    with_films: bool,
) -> bool:
    """Write the result's folder; return whether Ctrl-C came, in the run or since.

    A run that was interrupted keeps its checkpoint.
    """
    from taichi_foam.picture import films
    from taichi_foam.shim2000 import tests

    with output_folder(folder, overwrite, own) as staging:
        with held_interrupts() as pressed:
            result.write(staging)
            kept = Path(folder) / CHECKPOINT
            if result.ending is Ending.INTERRUPTED and kept.is_file():
                shutil.copy2(kept, staging / CHECKPOINT)
        if pressed.is_set() or result.ending is Ending.INTERRUPTED:
            return True
        frames = films.frames_to_draw(result) if with_films else 0
        if frames == 0:
            return False
        try:
            with bars.counting("films", "drawing pictures", frames, "frames") as on_frame:
                films.write(result, staging, on_frame, title=tests.title(result.scene))
        except KeyboardInterrupt:
            return True
    return False
