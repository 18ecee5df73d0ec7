"""The commands. Each checks its whole request before it computes anything."""

from __future__ import annotations

import contextlib
import threading
from typing import TYPE_CHECKING, Annotated

import typer

from taichi_foam import version as package
from taichi_foam.cli import calibrate, cushion, design, efficiency, foam, replay, sweep
from taichi_foam.cli.options import (
    Arch,
    Checkpoint,
    Choices,
    Dt,
    Overwrite,
    RunRequest,
    SceneName,
    Set,
    Threads,
    overrides_of,
    spread,
)
from taichi_foam.cli.outcome import INTERRUPTED, command
from taichi_foam.errors import UserError, installed

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
    @spread
    def run_it(asked: RunRequest) -> None:
        _run(scene, asked)

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
            "--version", callback=_show_version, is_eager=True, help="Show the version and exit."
        ),
    ] = False,
) -> None:
    """Hold the options that belong to no command."""


def _run(scene: str | Scene, asked: RunRequest) -> None:
    with command() as terminal:
        from taichi_foam.cli.run import run

        run(scene, asked, terminal)


@_app.command("run")
@spread
def run_command(scene: SceneName, asked: RunRequest) -> None:
    """Run one scene and write its result: histories, snapshots, measures, a GIF and an MP4."""
    _run(scene, asked)


@_app.command("resume")
def resume_command(
    folder: Annotated[str, typer.Argument(metavar="RUN_DIR", help="Folder of a run.")],
    threads: Threads = None,
    checkpoint: Checkpoint = None,
) -> None:
    """Continue a run that was killed or interrupted, from the checkpoint in its folder."""
    with command() as terminal:
        from taichi_foam.cli.run import resume

        resume(folder, RunRequest(threads=threads, checkpoint=checkpoint), terminal)


@_app.command("scenes")
def scenes_command() -> None:
    """List the built-in scenes."""
    from taichi_foam.catalogue import list_scenes

    known = list_scenes()
    width = max(map(len, known)) + 2
    for name, about in known.items():
        typer.echo(f"{name:<{width}}{about}")


@_app.command("keys")
def keys_command(
    part: Annotated[
        str | None,
        typer.Argument(metavar="PART", help="Part of a scene, or one key; default: all."),
    ] = None,
    markdown: Annotated[
        bool, typer.Option("--markdown", help="Print the page docs/scene.md instead.")
    ] = False,
) -> None:
    """List the keys of a scene: unit (-: dimensionless), default, allowed values, meaning."""
    with command() as terminal:
        from taichi_foam.cli import reference

        if markdown and part is not None:
            raise UserError("--markdown: writes the page of all keys; leave PART out")
        if markdown:
            typer.echo(reference.page(), nl=False)
        else:
            terminal.show(*reference.tables_of(part))


_app.command("render")(replay.render_command)
_app.command("compare")(replay.compare_command)


@_app.command("serve")
def serve_command(
    scene: SceneName,
    host: Annotated[
        str, typer.Option(help="Address to serve on; 0.0.0.0 also admits other machines.")
    ] = "127.0.0.1",
    port: Annotated[int, typer.Option(help="Port; 0: any free one.")] = 8000,
    out: Annotated[
        str, typer.Option(help="Folder in which each drop gets its own folder.")
    ] = "runs/served",
    set_: Set = None,
    choices: Choices = None,
    dt: Dt = None,
    arch: Arch = "cpu",
    threads: Threads = None,
    no_open: Annotated[bool, typer.Option("--no-open", help="Do not open a browser.")] = False,
) -> None:
    """Show a scene in the browser while it computes: picture, curve, controls, downloads."""
    with command() as terminal:
        from taichi_foam.catalogue import load_scene

        checked = load_scene(scene, choices, overrides_of(dt, set_))
        # the scene is valid: now import modules that load Taichi
        with installed("a live page", "taichi-foam[live]"):
            from taichi_foam.live.page.server import Server, open_browser

        server = Server(checked, out, host, port, arch, threads)

        def ready() -> None:
            terminal.line(f"{server.address} (Ctrl-C to stop)")
            if not no_open:
                # it may be slow, or never return
                threading.Thread(target=open_browser, args=[server.address], daemon=True).start()

        if server.is_open:
            terminal.warn(
                [
                    f"anyone who can reach {host} and has the token in the address can run drops "
                    "and fill the disk; the connection is not encrypted"
                ]
            )
        if server.run(ready):
            with contextlib.suppress(OSError):  # the terminal itself may be gone
                terminal.warn([f"what was computed is in {out}"], "interrupted")
            raise typer.Exit(INTERRUPTED)


_app.add_typer(sweep.app, name="sweep")
_app.add_typer(foam.app, name="foam")
_app.command("efficiency")(efficiency.efficiency_command)
_app.command("cushion")(cushion.cushion_command)
_app.command("design")(design.design_command)
_app.command("calibrate")(calibrate.calibrate_command)


@_app.command("reproduce")
def reproduce_command(
    out: Annotated[str, typer.Option(help="Folder for report, tables and runs.")] = "reproduction",
    cases: Annotated[
        str | None,
        typer.Option(metavar="NAME,...", help="One or more of the nine tests; default: all."),
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
    no_films: Annotated[bool, typer.Option("--no-films", help="Write no GIFs or MP4s.")] = False,
) -> None:
    """Run the paper's nine impacts and write a report: tables, curves, pictures."""
    with command() as terminal:
        from taichi_foam.cli import tables
        from taichi_foam.shim2000.impacts import brief
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
            bars=terminal.bars,
        )
        terminal.show(tables.study(content))
        if content["ensemble"]:
            terminal.show(tables.scores(content))
        if content["criteria"]:
            terminal.show(tables.criteria(content))
        terminal.where(out)
        terminal.warn(content["warnings"])
        if content["interrupted"]:
            missing = ", ".join(map(brief, content["not_finished"]))
            left = (
                f"left out because they had not finished: {missing}"
                if missing
                else "films may be missing"
            )
            raise KeyboardInterrupt(
                f"what has finished is kept; {left}; the same command continues from there"
            )
