"""The pictures of a run in its folder: frames/*.png, film.mp4 and film.gif, as its scene asks."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from math import ceil
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from taichi_foam.picture import movie, raster
from taichi_foam.picture.inset import Curve
from taichi_foam.result import Result, Snapshot
from taichi_foam.scene import Scene

Image8 = NDArray[np.uint8]

#: GIFs count in hundredths of a second, and viewers slow down those of more frames per second.
GIF_FPS = 25

# Generous bytes per pixel of one frame: as a PNG, and in both films together.
_PNG_BYTES, _FILM_BYTES = 0.3, 0.05


def storage_bytes(scene: Scene) -> int:
    """The most that the pictures of a run will take (bytes)."""
    output = scene.output
    count = scene.numerics.latest_end / output.snapshot_interval + 2
    each = _PNG_BYTES * output.frames + _FILM_BYTES * output.film
    return int(count * output.width * output.height * each)


def frames_to_draw(result: Result) -> int:
    """How many frames `write` draws: those of MP4 and GIF apart, so that both are sharp."""
    output = result.scene.output
    snapshots = len(result.snapshots)
    full = snapshots if output.film or output.frames else 0
    return full + (len(_thinned(result)) if output.film else 0)


def write(
    result: Result, folder: Path, on_frame: Callable[[], object] = lambda: None
) -> list[Path]:
    """Draw what `result.scene.output` asks for into an existing folder; return the paths.

    Args:
        on_frame: called after each frame drawn, `frames_to_draw` times.

    Raises:
        UserError: a film that cannot be written.
        OSError: a frame that cannot be written.
    """
    output = result.scene.output
    if not result.snapshots:
        return []
    written: list[Path] = []
    pictures = _drawn(result, result.snapshots, (output.width, output.height), on_frame)
    if output.frames:
        written.append(folder / "frames")
        pictures = _stored(pictures, written[0])
    if output.film:
        written.append(movie.save_mp4(pictures, folder / "film.mp4", output.fps))
        written.append(write_gif(result, folder / "film.gif", on_frame=on_frame))
    else:
        for _ in pictures if output.frames else ():
            pass
    return written


def write_gif(
    result: Result,
    path: Path,
    width: int = movie.GIF_WIDTH,
    every: int = 1,
    on_frame: Callable[[], object] = lambda: None,
) -> Path:
    """Write a run as a GIF that repeats, `width` pixels wide, of every so many frames."""
    output = result.scene.output
    snapshots = _thinned(result)[::every]
    # The pace stays that of the film.
    fps = max(1, round(output.fps / (_stride(output.fps) * every)))
    size = _scaled(output.width, output.height, width)
    pictures = _drawn(result, snapshots, size, on_frame)
    return movie.save_gif(pictures, path, fps, width)


def _thinned(result: Result) -> list[Snapshot]:
    return result.snapshots[:: _stride(result.scene.output.fps)]


def _stride(fps: int) -> int:
    return ceil(fps / GIF_FPS)


def _scaled(width: int, height: int, wanted: int) -> tuple[int, int]:
    """A size of the same shape, at most `wanted` wide, even, and not too small to draw."""
    share, (narrowest, lowest) = min(1.0, wanted / width), raster.SMALLEST
    return max(narrowest, 2 * round(share * width / 2)), max(lowest, 2 * round(share * height / 2))


def _drawn(
    result: Result,
    snapshots: Iterable[Snapshot],
    size: tuple[int, int],
    on_frame: Callable[[], object],
) -> Iterator[Image8]:
    scene = result.scene
    curve = None
    if scene.output.curve and scene.impactor is not None:
        curve = Curve.of(result.history)
    for picture in movie.frames(snapshots, scene, size, curve=curve):
        on_frame()
        yield picture


def _stored(pictures: Iterable[Image8], folder: Path) -> Iterator[Image8]:
    """Write each picture as a PNG on its way."""
    folder.mkdir()
    for number, picture in enumerate(pictures):
        Image.fromarray(picture).save(folder / f"frame_{number:05d}.png", compress_level=3)
        yield picture
