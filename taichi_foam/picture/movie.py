"""Films: frames in, one MP4 or GIF out, encoded by the ffmpeg that imageio brings along.

Frames are handed over one at a time as they lie in memory, so a film of any length needs the memory
of a few frames, and ffmpeg works on another core while the next one is drawn. The file appears
under its name only when it is complete.
"""

from __future__ import annotations

import contextlib
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import IO

import numpy as np
from numpy.typing import NDArray

from taichi_foam.errors import UserError
from taichi_foam.results.files import whole_file

Image8 = NDArray[np.uint8]

GIF_WIDTH = 640
#: The last frame of a GIF stays for this long before it starts again [s].
GIF_PAUSE = 1.0

# Of what `veryfast` does, the search for motion takes most and gains least in flat colours: without
# its finer steps a film takes two thirds of the time, and is 4 % larger at the same quality.
_MP4 = ("-c:v", "libx264", "-pix_fmt", "yuv420p", "-preset", "veryfast", "-crf", "20",
        "-x264-params", "me=dia:subme=1", "-movflags", "+faststart")  # fmt: skip
# A process group or session of its own: Ctrl-C in a terminal reaches all of a group, and what
# becomes of a film is decided here.
_APART = (
    subprocess.CREATE_NEW_PROCESS_GROUP | subprocess.CREATE_NO_WINDOW
    if sys.platform == "win32"
    else 0
)


class Film:
    """An ffmpeg that takes frames; it starts with the first, which tells the size."""

    def __init__(
        self, target: Path, partial: Path, fps: int, options: tuple[str, ...], words: IO[bytes]
    ) -> None:
        """`partial` is what `target` is called until it is complete; `words` take errors."""
        self._target, self._partial, self._fps, self._options = target, partial, fps, options
        self._words = words
        self._shape: tuple[int, ...] = ()
        self._count = 0
        self._process: subprocess.Popen[bytes] | None = None

    def send(self, picture: Image8) -> None:
        """Hand over a frame, uint8 (h, w, 3), of the size of the first.

        Raises:
            UserError: an odd or changing size.
            OSError: ffmpeg takes no more.
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
        """Tell ffmpeg that there are no more frames; films that end together end side by side."""
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
        """Stop ffmpeg where it still works."""
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
        """What an ffmpeg that has ended had to say."""
        assert self._process is not None  # it was started
        code = self._process.wait()
        self._words.seek(0)
        words = self._words.read().decode(errors="replace").strip().splitlines()
        return OSError(words[-1] if words else f"ffmpeg ended with code {code}")


def mp4(path: str | Path, fps: int = 25) -> contextlib.AbstractContextManager[Film]:
    """Write an MP4 (H.264, yuv420p, which every browser plays) of the frames that are sent.

        with mp4("film.mp4") as film:
            film.send(picture)

    When the block fails, no file appears, and an older one is as before.

    Args:
        path: file ending in .mp4, in an existing folder; an older file is replaced.
        fps: frames per second of watching.

    Raises:
        UserError: no pictures, an odd or changing size, a wrong ending, or a file that cannot be
            written.
    """
    return _film(path, ".mp4", fps, _MP4)


def gif(
    path: str | Path, fps: int = 20, width: int = GIF_WIDTH
) -> contextlib.AbstractContextManager[Film]:
    """Write a GIF that repeats for ever, with one palette chosen for all of it.

    Wider pictures are scaled down to `width`; pictures drawn at that size come out sharper.
    Other arguments and errors as for `mp4`.
    """
    # Flat colours need no dithering, whose noise would make the file several times larger.
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
    """How many frames a film holds, by its index and without decoding them. Raises OSError."""
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
