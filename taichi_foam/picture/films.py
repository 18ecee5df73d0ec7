"""Films and frames of a run, as its scene asks, and films of runs side by side."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from contextlib import ExitStack, closing
from dataclasses import dataclass
from math import ceil, prod, sqrt
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from taichi_foam.picture import comparison, movie, raster
from taichi_foam.picture.comparison import Lineup
from taichi_foam.picture.inset import Curve
from taichi_foam.picture.look import Look
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
    count = scene.numerics.latest_end / output.snapshot_interval + 2
    each = _PNG_BYTES * output.frames + _FILM_BYTES * output.film
    return int(count * output.width * output.height * each)


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


def frames_to_draw(result: Result, names: Names | None = None) -> int:
    """How many frames `write` draws: those of MP4 and GIF apart, so that both are sharp."""
    output = result.scene.output
    return _count(names or Names.of(output), result.snapshots, output.fps)


def write(
    result: Result,
    folder: Path,
    on_frame: Callable[[], object] = lambda: None,
    names: Names | None = None,
    overwrite: bool = False,
    title: str | None = None,
) -> list[Path]:
    """Draw a run into an existing folder; return the paths.

    Size, pace, mode and theme are those of `result.scene.output`. Each film and the folder of
    frames appears when it is complete or not at all.

    Args:
        on_frame: called after each frame drawn, `frames_to_draw` times.
        names: what to draw; default what `result.scene.output` asks for.
        overwrite: replace a folder of frames that has content; older films are always replaced.
        title: text above each picture; default the name of the scene.

    Raises:
        UserError: a film that cannot be written, a folder of frames that may not be replaced.
        OSError: a frame that cannot be written.
    """
    output = result.scene.output
    names = names or Names.of(output)
    if not result.snapshots:
        return []
    written: list[Path] = []
    if names.mp4 or names.frames:
        pictures = _drawn(result, result.snapshots, (output.width, output.height), on_frame, title)
        with ExitStack() as open_:
            if names.frames:
                written.append(folder / names.frames)
                stored = _stored(pictures, written[0], overwrite)
                pictures = open_.enter_context(closing(stored))
            if names.mp4:
                written.append(movie.save_mp4(pictures, folder / names.mp4, output.fps))
            else:
                for _ in pictures:
                    pass
    if names.gif:
        written.append(write_gif(result, folder / names.gif, on_frame=on_frame, title=title))
    return written


def write_gif(
    result: Result,
    path: Path,
    width: int = movie.GIF_WIDTH,
    every: int = 1,
    on_frame: Callable[[], object] = lambda: None,
    title: str | None = None,
) -> Path:
    """Write a run as a GIF that repeats, `width` pixels wide, of every so many frames."""
    output = result.scene.output
    stride = _stride(output.fps) * every
    fps = max(1, round(output.fps / stride))  # the pace stays that of the film
    size = scaled(output.width, output.height, width)
    pictures = _drawn(result, result.snapshots[::stride], size, on_frame, title)
    return movie.save_gif(pictures, path, fps, width)


def lineup_frames_to_draw(lineup: Lineup, names: Names = LINEUP_NAMES) -> int:
    """How many frames `write_lineup` draws."""
    return _count(names, lineup.times, lineup.runs[0].scene.output.fps)


def write_lineup(
    lineup: Lineup,
    folder: Path,
    on_frame: Callable[[], object] = lambda: None,
    names: Names = LINEUP_NAMES,
) -> list[Path]:
    """Draw runs side by side as an MP4 and a GIF into an existing folder; return the paths.

    Size, pace, mode and theme are those of the first run's scene. Older films are replaced.

    Args:
        on_frame: called after each frame drawn, `lineup_frames_to_draw` times.
        names: of the films; frames are not written.

    Raises:
        UserError: a film that cannot be written.
    """
    first = lineup.runs[0].scene
    output, look = first.output, Look.of(first)

    def drawn(times: Sequence[float], size: tuple[int, int]) -> Iterator[Image8]:
        for time in times:
            picture = comparison.frame(lineup, time, size, look=look)
            on_frame()
            yield picture

    written: list[Path] = []
    size, stride = (output.width, output.height), _stride(output.fps)
    if names.mp4:
        frames = drawn(lineup.times, size)
        written.append(movie.save_mp4(frames, folder / names.mp4, output.fps))
    if names.gif:
        share = sqrt(prod(LINEUP_GIF) / prod(size))
        small = scaled(*size, round(share * size[0]))
        frames = drawn(lineup.times[::stride], small)
        fps = max(1, round(output.fps / stride))
        written.append(movie.save_gif(frames, folder / names.gif, fps, small[0]))
    return written


def _count(names: Names, instants: Sequence[object], fps: int) -> int:
    full = len(instants) if names.mp4 or names.frames else 0
    return full + (len(instants[:: _stride(fps)]) if names.gif else 0)


def _stride(fps: int) -> int:
    return ceil(fps / GIF_FPS)


def scaled(width: int, height: int, wanted: int) -> tuple[int, int]:
    """A size of the same shape, at most `wanted` wide, even, and not too small to draw."""
    share, (narrowest, lowest) = min(1.0, wanted / width), raster.SMALLEST
    return max(narrowest, 2 * round(share * width / 2)), max(lowest, 2 * round(share * height / 2))


def _drawn(
    result: Result,
    snapshots: Iterable[Snapshot],
    size: tuple[int, int],
    on_frame: Callable[[], object],
    title: str | None,
) -> Iterator[Image8]:
    scene = result.scene
    curve = None
    if scene.output.curve and scene.impactor is not None:
        curve = Curve.of(result.history)
    for picture in movie.frames(snapshots, scene, size, title=title, curve=curve):
        on_frame()
        yield picture


def _stored(
    pictures: Iterable[Image8], folder: Path, overwrite: bool
) -> Generator[Image8, None, None]:
    """Write each picture as a PNG on its way."""
    with output_folder(folder, overwrite) as staging:
        for number, picture in enumerate(pictures):
            Image.fromarray(picture).save(staging / f"frame_{number:05d}.png", compress_level=3)
            yield picture
