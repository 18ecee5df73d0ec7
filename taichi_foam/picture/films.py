"""Films and frames of a run, as its scene asks, and films of runs side by side."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from contextlib import ExitStack, closing
from dataclasses import dataclass, replace
from functools import partial
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


@dataclass(frozen=True)
class _Reel:
    """What a film shows: its instants in order, and how one is drawn at a size [pixels].

    gif_width  of its GIF [pixels]
    """

    output: Output
    instants: Sequence[Any]
    draw: Callable[[Any, tuple[int, int]], Image8]
    gif_width: int = movie.GIF_WIDTH

    @property
    def stride(self) -> int:
        """Of how many instants a GIF shows one."""
        return ceil(self.output.fps / GIF_FPS)

    def frames_to_draw(self, names: Names) -> int:
        """Those of MP4 and GIF are drawn apart, so that both are sharp."""
        full = len(self.instants) if names.mp4 or names.frames else 0
        return full + (len(self.instants[:: self.stride]) if names.gif else 0)

    def frames(
        self, every: int, size: tuple[int, int], on_frame: Callable[[], object]
    ) -> Iterator[Image8]:
        """Every so many instants, drawn as they are asked for."""
        for instant in self.instants[::every]:
            picture = self.draw(instant, size)
            on_frame()
            yield picture

    def write(
        self, folder: Path, names: Names, on_frame: Callable[[], object], overwrite: bool
    ) -> list[Path]:
        """Write all that has a name; each appears when it is complete or not at all."""
        if not self.instants:
            return []
        output, written = self.output, []
        if names.mp4 or names.frames:
            pictures = self.frames(1, (output.width, output.height), on_frame)
            with ExitStack() as open_:
                if names.frames:
                    written.append(folder / names.frames)
                    pictures = open_.enter_context(
                        closing(_stored(pictures, written[0], overwrite))
                    )
                if names.mp4:
                    written.append(movie.save_mp4(pictures, folder / names.mp4, output.fps))
                else:
                    for _ in pictures:
                        pass
        if names.gif:
            written.append(self.write_gif(folder / names.gif, 1, on_frame))
        return written

    def write_gif(self, path: Path, every: int, on_frame: Callable[[], object]) -> Path:
        """Write a GIF of every so many of its frames."""
        output, stride = self.output, self.stride * every
        fps = max(1, round(output.fps / stride))  # the pace stays that of the film
        size = scaled(output.width, output.height, self.gif_width)
        return movie.save_gif(self.frames(stride, size, on_frame), path, fps, self.gif_width)


def frames_to_draw(result: Result, names: Names | None = None) -> int:
    """How many frames `write` draws."""
    return _reel(result).frames_to_draw(names or Names.of(result.scene.output))


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
    names = names or Names.of(result.scene.output)
    return _reel(result, title).write(folder, names, on_frame, overwrite)


def write_gif(result: Result, path: Path, width: int, every: int, title: str | None = None) -> Path:
    """Write a run as a GIF that repeats, `width` pixels wide, of every so many frames."""
    return replace(_reel(result, title), gif_width=width).write_gif(path, every, lambda: None)


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
    return _lineup_reel(lineup).write(folder, names, on_frame, overwrite=False)


def _reel(result: Result, title: str | None = None) -> _Reel:
    scene = result.scene
    with_curve = scene.output.curve and scene.is_slowed
    curve = Curve.of(result.history) if with_curve else None
    world = window(scene, result.snapshots)
    if with_curve and scene.is_tilted:
        world = _clear_of_curve(
            world, raster.Layout((scene.output.width, scene.output.height)).field
        )

    def draw(snapshot: Snapshot, size: tuple[int, int]) -> Image8:
        so_far = curve and curve.until(snapshot.time)
        sunk = result.displacement(snapshot)
        return raster.frame(
            snapshot, scene, size, title=title, displacement=sunk, world=world, curve=so_far
        )

    return _Reel(scene.output, result.snapshots, draw)


def _clear_of_curve(world: Window, field: Box) -> Window:
    """A window whose spare width lies all on the left, where the diagram stands."""
    width = (world.y_max - world.y_min) * field.width / field.height
    return replace(world, x_min=min(world.x_min, world.x_max - width))


def _lineup_reel(lineup: Lineup) -> _Reel:
    output = lineup.runs[0].scene.output
    share = sqrt(prod(LINEUP_GIF) / (output.width * output.height))
    width = scaled(output.width, output.height, round(share * output.width))[0]
    return _Reel(output, lineup.times, partial(comparison.frame, lineup), width)


def scaled(width: int, height: int, wanted: int) -> tuple[int, int]:
    """A size of the same shape, at most `wanted` wide, even, and not too small to draw."""
    share, (narrowest, lowest) = min(1.0, wanted / width), raster.SMALLEST
    return max(narrowest, 2 * round(share * width / 2)), max(lowest, 2 * round(share * height / 2))


def _stored(
    pictures: Iterable[Image8], folder: Path, overwrite: bool
) -> Generator[Image8, None, None]:
    """Write each picture as a PNG on its way."""
    with output_folder(folder, overwrite) as staging:
        for number, picture in enumerate(pictures):
            Image.fromarray(picture).save(staging / f"frame_{number:05d}.png", compress_level=3)
            yield picture
