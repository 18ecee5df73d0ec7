"""`run --live`: drops in a window, each kept in a folder of its own as it ends."""

from __future__ import annotations

from itertools import count
from pathlib import Path

import typer
from rich.console import Console

from taichi_foam.cli import tables
from taichi_foam.cli.outcome import INTERRUPTED, say_where, warn_of_residual
from taichi_foam.errors import RunError
from taichi_foam.live import window
from taichi_foam.picture import films
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

    def keep(result: Result) -> None:
        path = _next_folder(Path(folder), len(kept))
        result.save(path, overwrite and not kept)
        kept.append(path)

    shots = Path(f"{Path(folder)}-shots")
    stage = window.watch(scene, keep, arch=arch, threads=threads, shots=shots)
    if not kept and not stage.failures and not stage.unkept:
        raise KeyboardInterrupt("the window was closed before there was anything to save")
    # What has failed or was cut short has no film, as in `run` without a window.
    whole = kept[:-1] if stage.was_cut else kept
    has_films = bool(stage.failures) or _draw_films(whole, bars)
    if kept:
        last = Result.load(kept[-1])
        console.print(tables.key_figures(last.scene, last.summary))
        for path in kept:
            say_where(console, str(path))
        if not stage.failures:
            warn_of_residual(errors, last.summary["energy_residual"])
    if stage.problem:
        raise RunError(f"{stage.unkept[0].scene.name}: {stage.problem}")
    if stage.failures:
        where = "; what was computed is in the folders above" if kept else ""
        raise RunError(f"{stage.failures[-1]}{where}")
    if stage.was_cut:
        errors.print(f"closed before its end: what there was is in {kept[-1]}", soft_wrap=True)
    if stage.was_cut or not has_films:
        raise typer.Exit(INTERRUPTED)


def _next_folder(first: Path, number: int) -> Path:
    """The folder of drop `number`: `first`, or the next of its kind that is free."""
    if number == 0:
        return first
    wanted = (first.with_name(f"{first.name}-{n}") for n in count(number + 1))
    return next(path for path in wanted if not path.exists())


def _draw_films(folders: list[Path], bars: Bars) -> bool:
    """Draw the films of stored runs into their folders; whether Ctrl-C let it."""
    try:
        for folder in folders:
            result = Result.load(folder)
            frames = films.frames_to_draw(result)
            if frames:
                with bars.counting("films", f"films of {folder}", frames, "frames") as on_frame:
                    films.write(result, folder, on_frame, title=tests.title(result.scene))
    except KeyboardInterrupt:
        return False
    return True
