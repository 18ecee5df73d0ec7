"""`render` and `compare`: pictures of stored runs, without computing them again."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console

from taichi_foam.cli.options import Fps, Gif, Mode, Mp4, OverwriteFiles, Size, Theme
from taichi_foam.cli.outcome import exit_codes
from taichi_foam.errors import UserError
from taichi_foam.simulation.progress import Bars

if TYPE_CHECKING:
    from collections.abc import Callable

    import numpy as np
    from matplotlib.figure import Figure
    from numpy.typing import NDArray

    from taichi_foam.cli.delivery import Job
    from taichi_foam.results.result import Result

_RUN = "Folder of a stored run."


def render_command(
    run_dir: Annotated[str, typer.Argument(metavar="RUN_DIR", help=_RUN)],
    mode: Mode = None,
    theme: Theme = None,
    size: Size = None,
    fps: Fps = None,
    curve: Annotated[
        bool | None,
        typer.Option("--curve/--no-curve", help="Draw the deceleration so far into each frame."),
    ] = None,
    gif: Gif = False,
    mp4: Mp4 = False,
    png: Annotated[bool, typer.Option("--png", help="Write eight instants as a PNG.")] = False,
    frames: Annotated[bool, typer.Option("--frames", help="Write each frame as a PNG.")] = False,
    pdf: Annotated[
        bool, typer.Option("--pdf", help="Write eight instants and the curves as PDFs for print.")
    ] = False,
    svg: Annotated[bool, typer.Option("--svg", help="Write the same two as SVGs.")] = False,
    column: Annotated[
        str | None,
        typer.Option(
            metavar="single|double",
            help="Width of --pdf and --svg: a column of 84 mm or of 174 mm; default double for "
            "the instants, single for the curves.",
        ),
    ] = None,
    out: Annotated[str | None, typer.Option(help="Folder for the files; default RUN_DIR.")] = None,
    overwrite: OverwriteFiles = False,
) -> None:
    """Draw a stored run again: films, frames, figures for print; without a kind, GIF and MP4."""
    console, errors = Console(highlight=False), Console(stderr=True, highlight=False)
    with exit_codes(errors):
        if not (gif or mp4 or png or frames or pdf or svg):
            gif = mp4 = True
        film = gif or mp4
        _check_effect("--fps", fps, film, "--gif or --mp4")
        _check_effect("--curve", curve, film or frames, "--gif, --mp4 or --frames")
        _check_effect("--column", column, pdf or svg, "--pdf or --svg")
        on_screen = film or frames or png
        for option, given in (("--size", size), ("--theme", theme)):
            _check_effect(option, given, on_screen, "--gif, --mp4, --frames or --png")
        result = _loaded(run_dir, mode, theme, size, fps, curve)
        # names and values are right: now what loads Matplotlib
        from taichi_foam.catalogue import title as title_of
        from taichi_foam.cli.delivery import Job
        from taichi_foam.picture import films, montage, printed

        title = title_of(result.scene)
        shown, jobs = result.scene.output.mode, []
        if film or frames:
            names = films.Names(
                mp4=f"film-{shown}.mp4" if mp4 else None,
                gif=f"film-{shown}.gif" if gif else None,
                frames=f"frames-{shown}" if frames else None,
            )
            written = [name for name in (names.mp4, names.gif) if name]
            written += [f"{names.frames}/"] if frames else []
            pieces = films.frames_to_draw(result, names)
            write = partial(films.write, result, names=names, overwrite=overwrite, title=title)
            jobs.append(Job(tuple(written), pieces, write))
        if png:
            width = result.scene.output.width if size else montage.WIDTH
            montage.check_width(width)
            draw = partial(
                montage.montage, result.snapshots, result.scene, width=width, title=title
            )
            jobs.append(_still(f"montage-{shown}.png", draw))
        if pdf or svg:
            instants = partial(printed.montage, result.snapshots, result.scene)
            for name, figure, usual in (
                (f"montage-{shown}", instants, "double"),
                ("curves", partial(printed.curves, result.history, result.scene), "single"),
            ):
                wide = usual if column is None else column
                printed.column_width(wide)
                endings = [e for e, wanted in ((".pdf", pdf), (".svg", svg)) if wanted]
                jobs += [_figure(name + e, partial(figure, column=wide)) for e in endings]
        _deliver(jobs, run_dir if out is None else out, overwrite, console, errors)


def compare_command(
    runs: Annotated[
        list[str],
        typer.Argument(metavar="RUN", help="Folders of two to four stored runs."),
    ],
    mode: Mode = None,
    theme: Theme = None,
    size: Size = None,
    fps: Fps = None,
    gif: Gif = False,
    mp4: Mp4 = False,
    png: Annotated[bool, typer.Option("--png", help="Write four instants as a PNG.")] = False,
    out: Annotated[str, typer.Option(help="Folder for the files.")] = "comparison",
    overwrite: OverwriteFiles = False,
) -> None:
    """Show two to four stored runs side by side in time; without a kind, as GIF and MP4."""
    console, errors = Console(highlight=False), Console(stderr=True, highlight=False)
    with exit_codes(errors):
        if not (gif or mp4 or png):
            gif = mp4 = True
        _check_effect("--fps", fps, gif or mp4, "--gif or --mp4")
        results = [_loaded(runs[0], mode, theme, size, fps), *map(_loaded, runs[1:])]
        from taichi_foam.catalogue import caption
        from taichi_foam.cli.delivery import Job
        from taichi_foam.picture import comparison, films, montage

        captions = [caption(result.scene) for result in results]
        lineup = comparison.Lineup.of(results, _folder_names(runs), captions)
        output = results[0].scene.output
        name = f"comparison-{output.mode}"
        jobs = []
        if gif or mp4:
            names = films.Names(f"{name}.mp4" if mp4 else None, f"{name}.gif" if gif else None)
            written = tuple(each for each in (names.mp4, names.gif) if each)
            pieces = films.lineup_frames_to_draw(lineup, names)
            jobs.append(Job(written, pieces, partial(films.write_lineup, lineup, names=names)))
        if png:
            width = output.width if size else montage.WIDTH
            montage.check_width(width)
            jobs.append(_still(f"{name}.png", partial(comparison.instants, lineup, width=width)))
        _deliver(jobs, out, overwrite, console, errors)


def _check_effect(option: str, given: object, wanted: bool, kinds: str) -> None:
    """Raises UserError for an option that would do nothing among what is asked for."""
    if given is not None and not wanted:
        raise UserError(
            f"{option}: it has no effect on what is asked for. Fix: add {kinds}, or leave it out."
        )


def _folder_names(runs: list[str]) -> list[str]:
    """What the runs' folders are called, with as many parents as tell them apart."""
    parts = [Path(run).resolve().parts for run in runs]
    for count in range(1, max(map(len, parts))):
        names = ["/".join(own[-count:]) for own in parts]
        if len(set(names)) == len(set(parts)):
            return names
    return runs


def _loaded(
    folder: str,
    mode: str | None = None,
    theme: str | None = None,
    size: str | None = None,
    fps: int | None = None,
    curve: bool | None = None,
) -> Result:
    """A stored run, its scene asking for the pictures that the options give."""
    from taichi_foam.results.result import Result

    result = Result.load(folder)
    if not result.snapshots:
        raise UserError(f"{folder}: the run has no snapshots to draw. Fix: run its scene again.")
    given: dict[str, object] = {"mode": mode, "theme": theme, "fps": fps, "curve": curve}
    if size is not None:
        parts = re.fullmatch(r"([0-9]{1,9})[x×]([0-9]{1,9})", size.strip().lower())
        if parts is None:
            raise UserError(f"size = {size!r}: must read WIDTHxHEIGHT in pixels, e.g. 1280x720")
        given["width"], given["height"] = int(parts[1]), int(parts[2])
    values = {f"output.{key}": value for key, value in given.items() if value is not None}
    return replace(result, scene=result.scene.with_values(values))


def _still(name: str, draw: Callable[[], NDArray[np.uint8]]) -> Job:
    """A picture as a PNG."""
    from taichi_foam.cli.delivery import Job

    def write(folder: Path, on_piece: Callable[[], None]) -> None:
        from PIL import Image

        from taichi_foam.results.files import whole_file

        picture = Image.fromarray(draw())
        with whole_file(folder / name) as partial_:
            picture.save(partial_, optimize=True)
        on_piece()

    return Job((name,), 1, write)


def _figure(name: str, draw: Callable[[], Figure]) -> Job:
    """A figure for print."""
    from taichi_foam.cli.delivery import Job

    def write(folder: Path, on_piece: Callable[[], None]) -> None:
        from taichi_foam.picture import style

        style.save(draw(), folder / name, look=style.PRINT)
        on_piece()

    return Job((name,), 1, write)


def _deliver(
    jobs: list[Job], folder: str, overwrite: bool, console: Console, errors: Console
) -> None:
    """Draw, and name what was written."""
    from taichi_foam.cli.delivery import deliver

    names = deliver(jobs, folder, overwrite, Bars(errors))
    console.print(f"in {folder}: {', '.join(names)}", soft_wrap=True, markup=False)
