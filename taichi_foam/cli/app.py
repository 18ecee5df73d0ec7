"""The commands. Each checks everything that could go wrong before it computes anything."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console

from taichi_foam import version as package
from taichi_foam.cli import foam, keys, replay, serve, sweep
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
from taichi_foam.cli.outcome import exit_codes, say_where
from taichi_foam.simulation.progress import Bars

if TYPE_CHECKING:
    from taichi_foam.scene import Scene

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
    with exit_codes(errors):
        from taichi_foam.cli.run import resume

        resume(folder, threads, checkpoint, Bars(errors), console, errors)


@_app.command("scenes")
def scenes_command() -> None:
    """List the built-in scenes."""
    from taichi_foam.catalogue import list_scenes

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
    console, errors = Console(highlight=False), Console(stderr=True, highlight=False)
    with exit_codes(errors):
        from taichi_foam.cli.run import run

        run(
            source, out, choices, overrides, arch, threads, overwrite, live, every, after, drops,
            Bars(errors), console, errors,
        )  # fmt: skip
