"""Films and frames of a run, as its scene asks, and films of runs side by side."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import AbstractContextManager, ExitStack, contextmanager
from dataclasses import dataclass, replace
from itertools import count
from math import ceil, prod, sqrt
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from taichi_foam.picture import comparison, movie, raster
from taichi_foam.picture.comparison import Lineup
from taichi_foam.picture.inset import Curve
from taichi_foam.picture.view import Box, Window, window
from taichi_foam.records.snapshot import Snapshot
from taichi_foam.results.folders import output_folder
from taichi_foam.results.result import Result
from taichi_foam.scene import Scene
from taichi_foam.scene.options import Output

Image8 = NDArray[np.uint8]

#: GIFs count in hundredths of a second, and viewers slow down those of more frames per second.
GIF_FPS = 25

#: A GIF of several runs has at most as many pixels as this.
LINEUP_GIF = (960, 540)

# Generous bytes per pixel of one frame: as a PNG, and in both films together.
_PNG_BYTES, _FILM_BYTES = 0.3, 0.05


def storage_bytes(scene: Scene) -> int:
    """The most that the pictures of a run will take (bytes)."""
    output = scene.output
    frames = scene.numerics.latest_end / output.snapshot_interval + 2
    each = _PNG_BYTES * output.frames + _FILM_BYTES * output.film
    return int(frames * output.width * output.height * each)


@dataclass(frozen=True)
class Names:
    """What pictures in motion are called in their folder; None: not wanted.

    frames is a folder, with frame_00000.png and so on.
    """

    mp4: str | None = None
    gif: str | None = None
    frames: str | None = None

    @classmethod
    def of(cls, output: Output) -> Names:
        """What a scene asks for."""
        mp4, gif = ("film.mp4", "film.gif") if output.film else (None, None)
        return cls(mp4, gif, "frames" if output.frames else None)


LINEUP_NAMES = Names(mp4="comparison.mp4", gif="comparison.gif")


@dataclass(frozen=True)
class _Screen:
    """Where frames of one size are wanted.

    size   [pixels]
    every  of how many instants one is shown
    take   each gets the frames
    """

    size: tuple[int, int]
    every: int
    take: list[Callable[[Image8], object]]


@dataclass(frozen=True)
class _Reel:
    """What a film shows: its instants in order, and how one is drawn at some sizes [pixels].

    gif_width  of its GIF [pixels]
    """

    output: Output
    instants: Sequence[Any]
    draw: Callable[[Any, Sequence[tuple[int, int]]], Iterable[Image8]]
    gif_width: int = movie.GIF_WIDTH

    @property
    def stride(self) -> int:
        """Of how many instants a GIF shows one."""
        return ceil(self.output.fps / GIF_FPS)

    def frames_to_draw(self, names: Names) -> int:
        """Those of MP4 and GIF are drawn apart, so that both are sharp."""
        full = len(self.instants) if names.mp4 or names.frames else 0
        return full + (len(self.instants[:: self.stride]) if names.gif else 0)

    @contextmanager
    def drawn(
        self,
        folder: Path,
        names: Names,
        on_frame: Callable[[], object],
        overwrite: bool,
        gif_every: int = 1,
    ) -> Iterator[list[Path]]:
        """Draw all that has a name; each appears at the block's end, complete or not at all.

        All films are made in one pass, encoders working while the next frames are drawn, and on
        while the block lasts. The GIF shows one of every `gif_every` of its frames.
        """
        if not self.instants:
            yield []
            return
        output, stride = self.output, self.stride * gif_every
        full = _Screen((output.width, output.height), 1, [])
        small = _Screen(scaled(*full.size, self.gif_width), stride, [])
        written, open_films = [], []
        with ExitStack() as open_:
            if names.frames:
                written.append(folder / names.frames)
                full.take.append(open_.enter_context(_stored(written[-1], overwrite)))
            if names.mp4:
                written.append(folder / names.mp4)
                film = movie.mp4(written[-1], output.fps)
                open_films.append(open_.enter_context(film))
                full.take.append(open_films[-1].send)
            if names.gif:
                written.append(folder / names.gif)
                fps = max(1, round(output.fps / stride))  # the pace stays that of the film
                film = movie.gif(written[-1], fps, self.gif_width)
                open_films.append(open_.enter_context(film))
                small.take.append(open_films[-1].send)
            self._show([screen for screen in (full, small) if screen.take], on_frame)
            for film in open_films:
                film.end()
            yield written

    def _show(self, screens: list[_Screen], on_frame: Callable[[], object]) -> None:
        """Draw all instants that any of the screens shows."""
        for number, instant in enumerate(self.instants):
            due = [screen for screen in screens if number % screen.every == 0]
            pictures = self.draw(instant, [screen.size for screen in due])
            for screen, picture in zip(due, pictures, strict=True):
                on_frame()
                for take in screen.take:
                    take(picture)


def frames_to_draw(result: Result, names: Names | None = None) -> int:
    """How many frames `write` draws."""
    return _reel(result).frames_to_draw(names or Names.of(result.scene.output))


def drawn(
    result: Result,
    folder: Path,
    on_frame: Callable[[], object] = lambda: None,
    names: Names | None = None,
    overwrite: bool = False,
    title: str | None = None,
) -> AbstractContextManager[list[Path]]:
    """Draw a run into an existing folder; the context's value are the paths.

    Once all is drawn the block begins; encoders work on meanwhile. At its end each film and the
    folder of frames appears when it is complete or not at all. Size, pace, mode and theme are
    those of `result.scene.output`.

    Args:
        on_frame: called after each frame drawn, `frames_to_draw` times.
        names: what to draw; default what `result.scene.output` asks for.
        overwrite: replace a folder of frames that has content; older films are always replaced.
        title: text above each picture; default the name of the scene.

    Raises:
        UserError: a film that cannot be written, a folder of frames that may not be replaced.
        OSError: a frame that cannot be written.
    """
    names = names or Names.of(result.scene.output)
    return _reel(result, title).drawn(folder, names, on_frame, overwrite)


def write(
    result: Result,
    folder: Path,
    on_frame: Callable[[], object] = lambda: None,
    names: Names | None = None,
    overwrite: bool = False,
    title: str | None = None,
) -> list[Path]:
    """Draw a run, to the end; return the paths. Arguments and errors as for `drawn`."""
    with drawn(result, folder, on_frame, names, overwrite, title) as written:
        pass
    return written


def write_gif(result: Result, path: Path, width: int, every: int, title: str | None = None) -> Path:
    """Write a run as a GIF that repeats, `width` pixels wide, of every so many frames."""
    reel, names = replace(_reel(result, title), gif_width=width), Names(gif=path.name)
    with reel.drawn(path.parent, names, lambda: None, overwrite=False, gif_every=every):
        pass
    return path


def lineup_frames_to_draw(lineup: Lineup, names: Names = LINEUP_NAMES) -> int:
    """How many frames `write_lineup` draws."""
    return _lineup_reel(lineup).frames_to_draw(names)


def write_lineup(
    lineup: Lineup,
    folder: Path,
    on_frame: Callable[[], object] = lambda: None,
    names: Names = LINEUP_NAMES,
) -> list[Path]:
    """Draw runs side by side into an existing folder, as `write` does one; return the paths.

    Size, pace, mode and theme are those of the first run's scene.
    """
    with _lineup_reel(lineup).drawn(folder, names, on_frame, overwrite=False) as written:
        pass
    return written


def _reel(result: Result, title: str | None = None) -> _Reel:
    scene = result.scene
    with_curve = scene.output.curve and scene.is_slowed
    curve = Curve.of(result.history) if with_curve else None
    world = window(scene, result.snapshots)
    if with_curve and scene.is_tilted:
        world = _clear_of_curve(
            world, raster.Layout((scene.output.width, scene.output.height)).field
        )

    def draw(snapshot: Snapshot, sizes: Sequence[tuple[int, int]]) -> Iterator[Image8]:
        so_far = curve and curve.until(snapshot.time)
        sunk, shown = result.displacement(snapshot), raster.Shown.of(snapshot, scene)
        for size in sizes:
            yield raster.frame(
                snapshot, scene, size, title=title, displacement=sunk, world=world,
                curve=so_far, shown=shown,
            )  # fmt: skip

    return _Reel(scene.output, result.snapshots, draw)


def _clear_of_curve(world: Window, field: Box) -> Window:
    """A window whose spare width lies all on the left, where the diagram stands."""
    width = (world.y_max - world.y_min) * field.width / field.height
    return replace(world, x_min=min(world.x_min, world.x_max - width))


def _lineup_reel(lineup: Lineup) -> _Reel:
    output = lineup.runs[0].scene.output
    share = sqrt(prod(LINEUP_GIF) / (output.width * output.height))
    width = scaled(output.width, output.height, round(share * output.width))[0]

    def draw(time: float, sizes: Sequence[tuple[int, int]]) -> Iterator[Image8]:
        return (comparison.frame(lineup, time, size) for size in sizes)

    return _Reel(output, lineup.times, draw, width)


def scaled(width: int, height: int, wanted: int) -> tuple[int, int]:
    """A size of the same shape, at most `wanted` wide, even, and not too small to draw."""
    share, (narrowest, lowest) = min(1.0, wanted / width), raster.SMALLEST
    return max(narrowest, 2 * round(share * width / 2)), max(lowest, 2 * round(share * height / 2))


@contextmanager
def _stored(folder: Path, overwrite: bool) -> Iterator[Callable[[Image8], object]]:
    """Write a PNG of each picture that is handed over."""
    with output_folder(folder, overwrite) as staging:
        numbers = count()

        def store(picture: Image8) -> None:
            name = f"frame_{next(numbers):05d}.png"
            Image.fromarray(picture).save(staging / name, compress_level=3)

        yield store
