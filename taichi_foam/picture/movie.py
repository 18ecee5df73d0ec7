"""Films: frames in, one MP4 or GIF out, encoded by the ffmpeg that imageio brings along.

Frames are taken from an iterator one at a time, so a film of any length needs the memory of a
few frames. The file appears under its name only when it is complete.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from taichi_foam.errors import UserError
from taichi_foam.results.files import whole_file

Image8 = NDArray[np.uint8]

GIF_WIDTH = 640
#: The last frame of a GIF stays for this long before it starts again [s].
GIF_PAUSE = 1.0

# The options alone decide on the quality, and ffmpeg keeps the size as it is.
_PLAIN: dict[str, Any] = {"quality": None, "macro_block_size": 1, "ffmpeg_log_level": "error"}
_MP4 = ("-preset", "veryfast", "-crf", "20", "-movflags", "+faststart")


def save_mp4(pictures: Iterable[Image8], path: str | Path, fps: int = 25) -> Path:
    """Write an MP4 (H.264, yuv420p, which every browser plays) and return its path.

    Args:
        pictures: uint8 (h, w, 3), all of one even size.
        path: file ending in .mp4, in an existing folder; an older file is replaced.
        fps: frames per second of watching.

    Raises:
        UserError: no pictures, an odd or changing size, a wrong ending, or a file that cannot be
            written.
    """
    return _encode(pictures, path, ".mp4", fps, codec="libx264", pixels="yuv420p", options=_MP4)


def save_gif(
    pictures: Iterable[Image8], path: str | Path, fps: int = 20, width: int = GIF_WIDTH
) -> Path:
    """Write a GIF that repeats for ever, with one palette chosen for all of it.

    Wider pictures are scaled down to `width`; pictures drawn at that size come out sharper.
    Other arguments and errors as for `save_mp4`.
    """
    # Flat colours need no dithering, whose noise would make the file several times larger.
    palette = (
        f"scale='min({width},iw)':-2:flags=area,split[a][b];[a]palettegen=stats_mode=full[p];"
        "[b][p]paletteuse=dither=none:diff_mode=rectangle"
    )
    pause = ("-final_delay", str(round(100 * GIF_PAUSE)), "-loop", "0")
    options = ("-filter_complex", palette, *pause)
    return _encode(pictures, path, ".gif", fps, codec="gif", pixels="pal8", options=options)


def _encode(
    pictures: Iterable[Image8],
    path: str | Path,
    ending: str,
    fps: int,
    *,
    codec: str,
    pixels: str,
    options: tuple[str, ...],
) -> Path:
    target = Path(path)
    if target.suffix.lower() != ending:
        raise UserError(f"film {target}: the name must end in {ending}")
    if not target.parent.is_dir():
        raise UserError(f"film {target}: there is no folder {target.parent}; make it first")
    try:
        with whole_file(target) as partial:
            count = _feed(_alike(pictures, target), partial, fps, codec, pixels, options)
            _check(partial, count, target)
    except OSError as error:
        reason = str(error).strip().splitlines()[-1] if str(error).strip() else type(error).__name__
        raise UserError(
            f"film {target}: it could not be written ({reason}); "
            "check the free space and the permissions of its folder"
        ) from error
    return target


def _feed(
    pictures: Iterator[Image8],
    partial: Path,
    fps: int,
    codec: str,
    pixels: str,
    options: tuple[str, ...],
) -> int:
    """Send the pictures to ffmpeg and return how many there were."""
    from imageio_ffmpeg import write_frames

    first = next(pictures)
    height, width = first.shape[:2]
    writer = write_frames(
        str(partial),
        (width, height),
        fps=fps,
        codec=codec,
        pix_fmt_out=pixels,
        output_params=list(options),
        **_PLAIN,
    )
    writer.send(None)
    count = 1
    try:
        writer.send(first)
        for picture in pictures:
            writer.send(picture)
            count += 1
    finally:
        writer.close()
    return count


def _alike(pictures: Iterable[Image8], target: Path) -> Iterator[Image8]:
    """Pass the pictures on, contiguous, after a look at their number and size."""
    shape: tuple[int, ...] | None = None
    for picture in pictures:
        if shape is None:
            shape = picture.shape
            height, width = shape[:2]
            if width % 2 or height % 2:
                raise UserError(
                    f"film {target}: frames of {width} x {height} pixels; width and height must "
                    f"be even, such as {width + width % 2} x {height + height % 2}"
                )
        elif picture.shape != shape:
            raise UserError(f"film {target}: the size changes from {shape} to {picture.shape}")
        yield np.ascontiguousarray(picture, dtype=np.uint8)
    if shape is None:
        raise UserError(f"film {target}: there are no frames to write")


def _check(partial: Path, count: int, target: Path) -> None:
    """Read the file back: on a full disk ffmpeg may stop late and leave a torn file."""
    from imageio_ffmpeg import count_frames_and_secs

    try:
        found = count_frames_and_secs(str(partial))[0]
    except (RuntimeError, OSError) as error:
        raise OSError(f"{target.name} cannot be read back") from error
    if found != count:
        raise OSError(f"{target.name} holds {found} of {count} frames")
