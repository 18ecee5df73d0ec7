"""`taichi-foam serve`: a scene as a page in the browser."""

from __future__ import annotations

import contextlib
import threading
from typing import Annotated

import typer
from rich.console import Console

from taichi_foam.cli.options import Arch, Choices, Dt, SceneName, Set, Threads
from taichi_foam.cli.outcome import INTERRUPTED, exit_codes
from taichi_foam.errors import installed


def serve_command(
    scene: SceneName,
    host: Annotated[
        str, typer.Option(help="Address to serve on; 0.0.0.0 lets other machines in, too.")
    ] = "127.0.0.1",
    port: Annotated[int, typer.Option(help="Port; 0 takes any that is free.")] = 8000,
    out: Annotated[str, typer.Option(help="Folder for the folders of drops.")] = "runs/served",
    set_: Set = None,
    choices: Choices = None,
    dt: Dt = None,
    arch: Arch = "cpu",
    threads: Threads = None,
    no_open: Annotated[bool, typer.Option("--no-open", help="Open no browser.")] = False,
) -> None:
    """Show a scene in the browser while it computes: picture, curve, controls, downloads."""
    console, errors = Console(highlight=False), Console(stderr=True, highlight=False)
    with exit_codes(errors):
        from taichi_foam.catalogue import load_scene

        overrides = [] if dt is None else [f"numerics.dt={dt}"]
        checked = load_scene(scene, choices, [*overrides, *(set_ or [])])
        # the scene is right: now what brings Taichi along
        with installed("a live page", "taichi-foam[live]"):
            from taichi_foam.live.page.server import Server, open_browser

        server = Server(checked, out, host, port, arch, threads)

        def ready() -> None:
            console.print(f"{server.address} (Ctrl-C ends it)", soft_wrap=True, markup=False)
            if not no_open:
                # it may take its time, or all of it
                threading.Thread(target=open_browser, args=[server.address], daemon=True).start()

        if server.is_open:
            errors.print(
                f"warning: whoever reaches {host} and has the token in the address can drop "
                "things, and fill the disk; the connection is not encrypted",
                soft_wrap=True,
            )
        if server.run(ready):
            with contextlib.suppress(OSError):  # the terminal may be what has gone
                errors.print(f"interrupted: what there was is in {out}", soft_wrap=True)
            raise typer.Exit(INTERRUPTED)
