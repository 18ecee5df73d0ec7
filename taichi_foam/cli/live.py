"""`run --live`: drops in a window, each kept in a folder of its own as it ends."""

from __future__ import annotations

from pathlib import Path

import typer
from rich.console import Console

from taichi_foam.cli import tables
from taichi_foam.cli.outcome import INTERRUPTED, say_warnings, say_where
from taichi_foam.errors import RunError
from taichi_foam.live import window
from taichi_foam.live.controller import Controller, Outcome
from taichi_foam.picture import films
from taichi_foam.results import manifest
from taichi_foam.results.files import next_numbered
from taichi_foam.results.folders import check_output_folder
from taichi_foam.results.result import Result, storage_bytes
from taichi_foam.scene import Scene
from taichi_foam.shim2000 import tests
from taichi_foam.simulation.progress import Bars


def run_live(
    scene: Scene,
    folder: str,
    overwrite: bool,
    arch: str,
    threads: int | None,
    bars: Bars,
    console: Console,
    errors: Console,
) -> None:
    """Watch drops of `scene` until the window is closed; then draw their films, and say what came.

    The first drop becomes `folder`, the next `folder`-2 and so on.
    """
    window.check_display()
    check_output_folder(folder, overwrite, storage_bytes(scene) + films.storage_bytes(scene))
    kept: list[Path] = []

    def keep(outcome: Outcome) -> None:
        first = Path(folder)
        path = next_numbered(first, digits=1, first=2) if kept else first
        outcome.result.save(path, overwrite and not kept)
        kept.append(path)

    controller = Controller(scene, keep, arch=arch, threads=threads)
    window.show(controller, shots=Path(f"{Path(folder)}-shots"))
    if not kept and not controller.failures and not controller.unkept:
        raise KeyboardInterrupt("the window was closed before there was anything to save")
    # What has failed or was cut short has no film, as in `run` without a window.
    whole = kept[:-1] if controller.was_cut else kept
    has_films = bool(controller.failures) or _draw_films(whole, bars)
    if kept:
        last = Result.load(kept[-1])
        console.print(tables.key_figures(last.scene, last.summary))
        for path in kept:
            say_where(console, str(path))
        if not controller.failures:
            say_warnings(errors, last)
    if controller.problem:
        raise RunError(f"{controller.unkept[0].result.scene.name}: {controller.problem}")
    if controller.failures:
        where = "; what was computed is in the folders above" if kept else ""
        raise RunError(f"{controller.failures[-1]}{where}")
    if controller.was_cut:
        errors.print(f"closed before its end: what there was is in {kept[-1]}", soft_wrap=True)
    if controller.was_cut or not has_films:
        raise typer.Exit(INTERRUPTED)


def _draw_films(folders: list[Path], bars: Bars) -> bool:
    """Draw the films of stored runs into their folders; whether Ctrl-C let it."""
    try:
        for folder in folders:
            result = Result.load(folder)
            frames = films.frames_to_draw(result)
            if frames:
                with bars.counting("films", f"films of {folder}", frames, "frames") as on_frame:
                    drawn = films.write(result, folder, on_frame, title=tests.title(result.scene))
                manifest.add(folder, [path.name for path in drawn])
    except KeyboardInterrupt:
        return False
    return True
