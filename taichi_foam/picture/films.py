"""Films and frames of a run, as its scene requests, and films of runs side by side.

MP4 and GIF are encoded by the ffmpeg that comes with imageio. Frames are passed to it one at a
time, so a film of any length needs the memory of only a few frames, and ffmpeg works on another
core while the next frame is drawn. A file appears under its name only when it is complete.
"""

from __future__ import annotations

import contextlib
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import count
from math import ceil, prod, sqrt
from pathlib import Path
from typing import IO, Any

import numpy as np
from PIL import Image

from taichi_foam.errors import UserError
from taichi_foam.picture import comparison, raster
from taichi_foam.picture.annotate import Image8
from taichi_foam.picture.comparison import Lineup
from taichi_foam.picture.inset import Curve
from taichi_foam.picture.view import Box, Window, window
from taichi_foam.records.snapshot import Snapshot
from taichi_foam.results.files import whole_file
from taichi_foam.results.folders import output_folder
from taichi_foam.results.result import Result
from taichi_foam.scene import Scene
from taichi_foam.scene.options import Output

GIF_WIDTH = 640
#: How long a GIF holds its last frame before it repeats [s].
GIF_PAUSE = 1.0

# With flat colours, the motion search of `veryfast` costs most and gains least: without its finer
# steps a film takes two thirds of the time, and is 4 % larger at the same quality.
_MP4 = ("-c:v", "libx264", "-pix_fmt", "yuv420p", "-preset", "veryfast", "-crf", "20",
        "-x264-params", "me=dia:subme=1", "-movflags", "+faststart")  # fmt: skip
# ffmpeg gets its own process group or session, since Ctrl-C in a terminal reaches a whole group,
# and this process decides what becomes of a film.
_APART = (
    subprocess.CREATE_NEW_PROCESS_GROUP | subprocess.CREATE_NO_WINDOW
    if sys.platform == "win32"
    else 0
)

#: GIFs count in hundredths of a second, and viewers slow down those with higher frame rates.
GIF_FPS = 25

#: A GIF of several runs has at most this many pixels (width, height).
LINEUP_GIF = (960, 540)

# Upper estimates of bytes per pixel of one frame: as a PNG, and in both films together.
_PNG_BYTES, _FILM_BYTES = 0.3, 0.05


def storage_bytes(scene: Scene) -> int:
    """Upper bound on the size of a run's pictures (bytes)."""
    output = scene.output
    each = _PNG_BYTES * output.frames + _FILM_BYTES * output.film
    return int(scene.most_snapshots * output.width * output.height * each)


@dataclass(frozen=True)
class Names:
    """File names of films and frames in their folder; None: not wanted.

    frames is a folder, with frame_00000.png and so on.
    """

    mp4: str | None = None
    gif: str | None = None
    frames: str | None = None

    @classmethod
    def of(cls, output: Output) -> Names:
        """The names for what a scene requests."""
        mp4, gif = ("film.mp4", "film.gif") if output.film else (None, None)
        return cls(mp4, gif, "frames" if output.frames else None)


@dataclass(frozen=True)
class _Screen:
    """Consumers of frames of one size.

    size   size of the frames [pixels]
    every  one of every so many instants is shown
    take   functions that each receive the frames
    """

    size: tuple[int, int]
    every: int
    take: list[Callable[[Image8], object]]


@dataclass(frozen=True)
class Reel:
    """The content of a film: its instants in order, and how one is drawn at given sizes [pixels].

    output     size and pace; `of` and `of_lineup` also take mode and theme from it
    gif_width  width of its GIF [pixels]
    gif_every  the GIF shows one of so many of its frames
    """

    output: Output
    instants: Sequence[Any]
    draw: Callable[[Any, Sequence[tuple[int, int]]], Iterable[Image8]]
    gif_width: int = GIF_WIDTH
    gif_every: int = 1

    @classmethod
    def of(cls, result: Result, title: str | None = None) -> Reel:
        """A run as its scene requests; `title` above each picture, default the scene's name."""
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

        return cls(scene.output, result.snapshots, draw)

    @classmethod
    def of_lineup(cls, lineup: Lineup) -> Reel:
        """Runs side by side, as the first one's scene requests."""
        output = lineup.runs[0].scene.output
        share = sqrt(prod(LINEUP_GIF) / (output.width * output.height))
        width = scaled(output.width, output.height, round(share * output.width))[0]

        def draw(time: float, sizes: Sequence[tuple[int, int]]) -> Iterator[Image8]:
            return (comparison.frame(lineup, time, size) for size in sizes)

        return cls(output, lineup.times, draw, width)

    @property
    def stride(self) -> int:
        """The GIF shows one of every so many instants."""
        return ceil(self.output.fps / GIF_FPS) * self.gif_every

    def frames_to_draw(self, names: Names | None = None) -> int:
        """Number of frames; those of MP4 and GIF are drawn separately, so that both are sharp."""
        names = names or Names.of(self.output)
        full = len(self.instants) if names.mp4 or names.frames else 0
        return full + (len(self.instants[:: self.stride]) if names.gif else 0)

    @contextlib.contextmanager
    def drawn(
        self,
        folder: Path,
        on_frame: Callable[[], object] = lambda: None,
        names: Names | None = None,
        overwrite: bool = False,
    ) -> Iterator[list[Path]]:
        """Draw into an existing folder; a context manager that yields the paths.

        All films are made in one pass. The block begins once all frames are drawn; encoders
        continue during it. When it ends, each film and the folder of frames appears, complete or
        not at all.

        Args:
            on_frame: called after each frame drawn, `frames_to_draw` times.
            names: what to draw; default what `output` requests.
            overwrite: replace a folder of frames that has content; older films are always replaced.

        Raises:
            UserError: a film cannot be written, or the folder of frames may not be replaced.
            OSError: a frame cannot be written.
        """
        if not self.instants:
            yield []
            return
        output, names = self.output, names or Names.of(self.output)
        full = _Screen((output.width, output.height), 1, [])
        small = _Screen(scaled(*full.size, self.gif_width), self.stride, [])
        written, open_films = [], []
        with contextlib.ExitStack() as open_:
            if names.frames:
                written.append(folder / names.frames)
                full.take.append(open_.enter_context(_stored(written[-1], overwrite)))
            if names.mp4:
                written.append(folder / names.mp4)
                film = mp4(written[-1], output.fps)
                open_films.append(open_.enter_context(film))
                full.take.append(open_films[-1].send)
            if names.gif:
                written.append(folder / names.gif)
                fps = max(1, round(output.fps / self.stride))  # the pace stays that of the film
                film = gif(written[-1], fps, self.gif_width)
                open_films.append(open_.enter_context(film))
                small.take.append(open_films[-1].send)
            self._show([screen for screen in (full, small) if screen.take], on_frame)
            for film in open_films:
                film.end()
            yield written

    def write(
        self,
        folder: Path,
        on_frame: Callable[[], object] = lambda: None,
        names: Names | None = None,
        overwrite: bool = False,
    ) -> list[Path]:
        """Draw, and return the paths. Arguments and errors as for `drawn`."""
        with self.drawn(folder, on_frame, names, overwrite) as written:
            pass
        return written

    def _show(self, screens: list[_Screen], on_frame: Callable[[], object]) -> None:
        """Draw every instant that at least one of the screens shows."""
        for number, instant in enumerate(self.instants):
            due = [screen for screen in screens if number % screen.every == 0]
            pictures = self.draw(instant, [screen.size for screen in due])
            for screen, picture in zip(due, pictures, strict=True):
                on_frame()
                for take in screen.take:
                    take(picture)


def _clear_of_curve(world: Window, field: Box) -> Window:
    """A window with all spare width on the left, where the diagram is."""
    width = (world.y_max - world.y_min) * field.width / field.height
    return replace(world, x_min=min(world.x_min, world.x_max - width))


def scaled(width: int, height: int, wanted: int) -> tuple[int, int]:
    """A size of the same aspect ratio, at most `wanted` wide, even, and not too small to draw."""
    share, (narrowest, lowest) = min(1.0, wanted / width), raster.SMALLEST
    return max(narrowest, 2 * round(share * width / 2)), max(lowest, 2 * round(share * height / 2))


@contextlib.contextmanager
def _stored(folder: Path, overwrite: bool) -> Iterator[Callable[[Image8], object]]:
    """Yield a function that writes each picture it is given as a PNG."""
    with output_folder(folder, overwrite) as staging:
        numbers = count()

        def store(picture: Image8) -> None:
            name = f"frame_{next(numbers):05d}.png"
            Image.fromarray(picture).save(staging / name, compress_level=3)

        yield store


# --- encoders -----------------------------------------------------------------------------------


class Film:
    """An ffmpeg process that takes frames; the first frame starts it and sets the size."""

    def __init__(
        self, target: Path, partial: Path, fps: int, options: tuple[str, ...], words: IO[bytes]
    ) -> None:
        """`partial` is the path used until `target` is complete; `words` receives error output."""
        self._target, self._partial, self._fps, self._options = target, partial, fps, options
        self._words = words
        self._shape: tuple[int, ...] = ()
        self._count = 0
        self._process: subprocess.Popen[bytes] | None = None

    def send(self, picture: Image8) -> None:
        """Send a frame, uint8 (h, w, 3), of the same size as the first.

        Raises:
            UserError: an odd or changing size.
            OSError: ffmpeg accepts no more frames.
        """
        if self._process is None:
            self._process = self._started(picture.shape)
        elif picture.shape != self._shape:
            raise UserError(
                f"film {self._target}: the size changes from {self._shape} to {picture.shape}"
            )
        assert self._process.stdin is not None  # it is a pipe
        try:
            self._process.stdin.write(np.ascontiguousarray(picture, dtype=np.uint8).data)
        except OSError:
            raise self._failure() from None
        self._count += 1

    def end(self) -> None:
        """Tell ffmpeg that there are no more frames; several films can then finish in parallel."""
        if self._process is not None and self._process.stdin is not None:
            with contextlib.suppress(OSError):  # `finish` says why
                self._process.stdin.close()

    def finish(self) -> None:
        """Wait until the file is complete. Raises UserError without frames, and OSError."""
        if self._process is None:
            raise UserError(f"film {self._target}: there are no frames to write")
        self.end()
        if self._process.wait() != 0:
            raise self._failure()
        # on a full disk ffmpeg may leave a torn file and say nothing
        if (found := _frames_in(self._partial)) != self._count:
            raise OSError(f"{self._target.name} holds {found} of {self._count} frames")

    def close(self) -> None:
        """Stop ffmpeg if it still runs."""
        if self._process is not None:
            self._process.kill()
            self._process.wait()
            self.end()

    def _started(self, shape: tuple[int, ...]) -> subprocess.Popen[bytes]:
        from imageio_ffmpeg import get_ffmpeg_exe

        self._shape = shape
        height, width = shape[:2]
        if width % 2 or height % 2:
            raise UserError(
                f"film {self._target}: frames of {width} x {height} pixels; width and height must "
                f"be even, such as {width + width % 2} x {height + height % 2}"
            )
        frames = ("-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{width}x{height}",
                  "-r", str(self._fps), "-i", "-")  # fmt: skip
        return subprocess.Popen(
            [get_ffmpeg_exe(), "-v", "error", "-y", *frames, *self._options, str(self._partial)],
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=self._words,
            creationflags=_APART,
            start_new_session=True,
        )

    def _failure(self) -> OSError:
        """The error of an ffmpeg that has ended."""
        assert self._process is not None  # it was started
        code = self._process.wait()
        self._words.seek(0)
        words = self._words.read().decode(errors="replace").strip().splitlines()
        return OSError(words[-1] if words else f"ffmpeg ended with code {code}")


def mp4(path: str | Path, fps: int = 25) -> contextlib.AbstractContextManager[Film]:
    """Write an MP4 (H.264, yuv420p, which every browser plays) from the frames sent to it.

        with mp4("film.mp4") as film:
            film.send(picture)

    If the block fails, no file appears, and an older one stays unchanged.

    Args:
        path: file ending in .mp4, in an existing folder; an older file is replaced.
        fps: frames per second of playback.

    Raises:
        UserError: no pictures, an odd or changing size, a wrong file extension, or a file that
            cannot be written.
    """
    return _film(path, ".mp4", fps, _MP4)


def gif(
    path: str | Path, fps: int = 20, width: int = GIF_WIDTH
) -> contextlib.AbstractContextManager[Film]:
    """Write a GIF that repeats forever, with one palette for all frames.

    Wider pictures are scaled down to `width`; pictures drawn at that size are sharper.
    Other arguments and errors as for `mp4`.
    """
    # Flat colours need no dithering; its noise would make the file several times larger.
    palette = (
        f"scale='min({width},iw)':-2:flags=area,split[a][b];[a]palettegen=stats_mode=full[p];"
        "[b][p]paletteuse=dither=none:diff_mode=rectangle"
    )
    pause = ("-final_delay", str(round(100 * GIF_PAUSE)), "-loop", "0")
    return _film(path, ".gif", fps, ("-filter_complex", palette, "-pix_fmt", "pal8", *pause))


@contextlib.contextmanager
def _film(path: str | Path, ending: str, fps: int, options: tuple[str, ...]) -> Iterator[Film]:
    target = Path(path)
    if target.suffix.lower() != ending:
        raise UserError(f"film {target}: the name must end in {ending}")
    if not target.parent.is_dir():
        raise UserError(f"film {target}: there is no folder {target.parent}; make it first")
    try:
        with (
            whole_file(target) as partial,
            tempfile.TemporaryFile() as words,
            contextlib.closing(Film(target, partial, fps, options, words)) as film,
        ):
            yield film
            film.finish()
    except OSError as error:
        reason = str(error).strip() or type(error).__name__
        raise UserError(
            f"film {target}: it could not be written ({reason}); "
            "check the free space and the permissions of its folder"
        ) from error


def _frames_in(path: Path) -> int:
    """Number of frames in a film, from its index, without decoding. Raises OSError."""
    from imageio_ffmpeg import get_ffmpeg_exe

    copied = ("-map", "0:v:0", "-c", "copy", "-f", "null", "-progress", "-", "-")
    told = subprocess.run(
        [get_ffmpeg_exe(), "-v", "error", "-nostdin", "-i", str(path), *copied],
        stdin=subprocess.DEVNULL,
        capture_output=True,
        check=False,
        creationflags=_APART,
        start_new_session=True,
    )
    counts = [line[6:] for line in told.stdout.splitlines() if line.startswith(b"frame=")]
    if told.returncode != 0 or not counts:
        raise OSError("it cannot be read back")
    return int(counts[-1])
