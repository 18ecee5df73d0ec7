"""`render` and `compare`: pictures of stored runs, without computing them again."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from taichi_foam.cli.options import Fps, Gif, Mode, Mp4, OverwriteFiles, Size, Theme
from taichi_foam.cli.outcome import Terminal, check_name, command
from taichi_foam.errors import UserError

if TYPE_CHECKING:
    import numpy as np
    from matplotlib.figure import Figure
    from numpy.typing import NDArray

    from taichi_foam.picture.films import Names, Reel
    from taichi_foam.results.result import Result
    from taichi_foam.scene import Scene

_RUN = "Folder of a stored run."


@dataclass(frozen=True)
class Job:
    """Something to draw.

    names   what it writes: files, or folders, whose names end with /
    pieces  number of pictures to draw
    write   writes it into a folder, each file as a whole, calling back after each picture
    """

    names: tuple[str, ...]
    pieces: int
    write: Callable[[Path, Callable[[], None]], object]


def render_command(
    run_dir: Annotated[str, typer.Argument(metavar="RUN_DIR", help=_RUN)],
    mode: Mode = None,
    theme: Theme = None,
    size: Size = None,
    fps: Fps = None,
    curve: Annotated[
        bool | None,
        typer.Option(
            "--curve/--no-curve", help="Draw the deceleration up to that time into each frame."
        ),
    ] = None,
    gif: Gif = False,
    mp4: Mp4 = False,
    png: Annotated[bool, typer.Option("--png", help="Write eight instants as a PNG.")] = False,
    frames: Annotated[bool, typer.Option("--frames", help="Write each frame as a PNG.")] = False,
    pdf: Annotated[
        bool, typer.Option("--pdf", help="Write eight instants and the curves as PDFs for print.")
    ] = False,
    svg: Annotated[bool, typer.Option("--svg", help="Write the same as SVGs.")] = False,
    column: Annotated[
        str | None,
        typer.Option(
            metavar="single|double",
            help="Width of --pdf and --svg: single (84 mm) or double column (174 mm); default: "
            "double for the instants, single for the curves.",
        ),
    ] = None,
    out: Annotated[str | None, typer.Option(help="Folder for the files; default: RUN_DIR.")] = None,
    overwrite: OverwriteFiles = False,
) -> None:
    """Draw a stored run again: films, frames, figures for print; by default GIF and MP4."""
    with command() as terminal:
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
        # names and values are valid: now import modules that load Matplotlib
        from taichi_foam.catalogue import title as title_of
        from taichi_foam.picture import films, montage, printed

        title = title_of(result.scene)
        shown, jobs = result.scene.output.mode, []
        if film or frames:
            names = films.Names(
                mp4=f"film-{shown}.mp4" if mp4 else None,
                gif=f"film-{shown}.gif" if gif else None,
                frames=f"frames-{shown}" if frames else None,
            )
            jobs.append(_film(films.Reel.of(result, title), names, overwrite))
        if png:
            draw = partial(montage.montage, result.snapshots, result.scene, title=title)
            jobs.append(_still(f"montage-{shown}.png", draw, result.scene, size))
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
        deliver(jobs, run_dir if out is None else out, overwrite, terminal)


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
    """Show two to four stored runs side by side over time; by default as GIF and MP4."""
    with command() as terminal:
        if not (gif or mp4 or png):
            gif = mp4 = True
        _check_effect("--fps", fps, gif or mp4, "--gif or --mp4")
        results = [_loaded(runs[0], mode, theme, size, fps), *map(_loaded, runs[1:])]
        from taichi_foam.catalogue import caption
        from taichi_foam.picture import comparison, films

        captions = [caption(result.scene) for result in results]
        lineup = comparison.Lineup.of(results, _folder_names(runs), captions)
        name = f"comparison-{results[0].scene.output.mode}"
        jobs = []
        if gif or mp4:
            names = films.Names(f"{name}.mp4" if mp4 else None, f"{name}.gif" if gif else None)
            jobs.append(_film(films.Reel.of_lineup(lineup), names, overwrite))
        if png:
            draw = partial(comparison.instants, lineup)
            jobs.append(_still(f"{name}.png", draw, results[0].scene, size))
        deliver(jobs, out, overwrite, terminal)


def _check_effect(option: str, given: object, wanted: bool, kinds: str) -> None:
    """Raise UserError for an option without effect on the requested output."""
    if given is not None and not wanted:
        raise UserError(
            f"{option}: has no effect on what is to be written. Fix: add {kinds}, or leave it out."
        )


def _folder_names(runs: list[str]) -> list[str]:
    """Names of the runs' folders, with as many parents as are needed to distinguish them."""
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
    """A stored run, with the picture options applied to its scene."""
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


def _film(reel: Reel, names: Names, overwrite: bool) -> Job:
    """A job for films and frames."""
    written = [name for name in (names.mp4, names.gif) if name]
    written += [f"{names.frames}/"] if names.frames else []
    write = partial(reel.write, names=names, overwrite=overwrite)
    return Job(tuple(written), reel.frames_to_draw(names), write)


def _still(
    name: str, draw: Callable[..., NDArray[np.uint8]], scene: Scene, size: str | None
) -> Job:
    """A job for a PNG, as wide as the scene's output if `size` was given. Raises UserError."""
    from taichi_foam.picture import montage

    width = scene.output.width if size else montage.WIDTH
    montage.check_width(width)

    def write(folder: Path, on_piece: Callable[[], None]) -> None:
        from PIL import Image

        from taichi_foam.results.files import whole_file

        picture = Image.fromarray(draw(width=width))
        with whole_file(folder / name) as partial_:
            picture.save(partial_, optimize=True)
        on_piece()

    return Job((name,), 1, write)


def _figure(name: str, draw: Callable[[], Figure]) -> Job:
    """A job for a figure for print."""

    def write(folder: Path, on_piece: Callable[[], None]) -> None:
        from taichi_foam.picture import style

        style.save(draw(), folder / name, look=style.PRINT)
        on_piece()

    return Job((name,), 1, write)


def deliver(jobs: Sequence[Job], folder: str, overwrite: bool, terminal: Terminal) -> None:
    """Draw `jobs` into `folder`, which is created if it does not exist, and list what was written.

    Folder and files may exist; each file appears complete or not at all.

    Raises:
        UserError: a name is taken, or the folder cannot be written to; before anything is drawn.
        KeyboardInterrupt: on Ctrl-C, with a message that lists what has been completed.
    """
    from taichi_foam.results import folders, manifest

    place = folders.resolved(folder)
    done: list[str] = []
    with folders.explained(folder, " with --out"):
        _check(Path(folder), [name for job in jobs for name in job.names], overwrite)
        folders.check_writable(place)
    with folders.explained(folder, " with --out"), folders.made(place):
        total = sum(job.pieces for job in jobs)
        try:
            with terminal.bars.counting(
                "pictures", "drawing pictures", total, "pictures"
            ) as on_piece:
                for job in jobs:
                    job.write(place, on_piece)
                    manifest.add(place, [name.rstrip("/") for name in job.names])
                    done += job.names
        except KeyboardInterrupt:
            kept = f"what was finished is in {folder}: {', '.join(done)}"
            raise KeyboardInterrupt(kept if done else "nothing was written") from None
    terminal.line(f"in {folder}: {', '.join(done)}")


def _check(folder: Path, names: Sequence[str], overwrite: bool) -> None:
    """Raise UserError for names that are taken. Raises OSError, too."""
    from taichi_foam.results.folders import check_output_folder

    for name in names:
        path = folder / name
        if not os.path.lexists(path):
            continue
        if path.is_dir() != name.endswith("/"):
            kind = "a folder" if path.is_dir() else "a file"
            raise UserError(f"{path}: is {kind}. Fix: move it, or choose another --out.")
        check_name(path, overwrite, "folder")
        if path.is_dir():
            check_output_folder(path, overwrite)
