"""Pictures of a drop that goes on: with words for window and cell, the field alone for the page."""

from __future__ import annotations

import io
import struct
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageFont

from taichi_foam.picture import annotate, raster
from taichi_foam.picture.look import THEMES, Look, Theme, shades
from taichi_foam.picture.view import Box, window

if TYPE_CHECKING:
    from taichi_foam.records.snapshot import Snapshot
    from taichi_foam.scene import Scene

Image8 = NDArray[np.uint8]

#: Lines of a strip at most: what is longer is cut.
_MOST_LINES = 6

#: Pixels of a page's picture, and how wide it may be for its height and the other way round.
PIXELS, WIDEST, TALLEST = 960 * 540, 2.4, 0.8
#: Colours that the gradient of the page's colour key is made of.
STOPS = 24
#: In front of a page's picture: the bytes of the JSON that comes first; little endian.
LENGTH = struct.Struct("<I")


def panel(image: Image8, rows: Sequence[tuple[str, str]], theme: str) -> None:
    """A panel of keys and what they do over the middle of `image` (h, w, 3), in place."""
    height, width = image.shape[:2]
    tones, unit = THEMES[theme], min(width / 1280, height / 720)
    size = 22 * unit
    bold, plain = annotate.font(size, bold=True), annotate.font(size)
    left = max(bold.getlength(key) for key, _ in rows)
    right = max(plain.getlength(words) for _, words in rows)
    gap, line = 1.2 * size, 1.55 * size
    wide, high = round(left + right + 3 * gap), round((len(rows) + 0.9) * line)
    x, y = (width - wide) // 2, (height - high) // 2
    _sheet(image, Box(x, y, x + wide, y + high), tones, unit)
    for k, (key, words) in enumerate(rows):
        base = y + (k + 1.1) * line
        annotate.write(image, (x + gap, base), key, bold, colour=tones.ink)
        annotate.write(image, (x + 2 * gap + left, base), words, plain, colour=tones.ink)


def strip(image: Image8, text: str, theme: str) -> None:
    """A strip with `text` in whole lines across the foot of `image` (h, w, 3), in place."""
    height, width = image.shape[:2]
    tones, unit = THEMES[theme], min(width / 1280, height / 720)
    size = 20 * unit
    face, gap, line = annotate.font(size), 0.9 * size, 1.4 * size
    lines = _wrapped(text, face, width - 2 * gap)
    top = height - round(len(lines) * line + gap)
    _sheet(image, Box(0, top, width, height), tones, unit)
    for k, words in enumerate(lines):
        base = top + 0.5 * gap + (k + 0.75) * line
        annotate.write(image, (gap, base), words, face, colour=tones.ink)


def _sheet(image: Image8, box: Box, tones: Theme, unit: float) -> None:
    """An empty sheet with an edge."""
    edge = max(1, round(2 * unit))
    annotate.rectangle(image, box, tones.frame)
    inner = Box(box.left + edge, box.top + edge, box.right - edge, box.bottom - edge)
    annotate.rectangle(image, inner, tones.page)


def _wrapped(text: str, face: ImageFont.FreeTypeFont, room: float) -> list[str]:
    """`text` in lines of at most `room` pixels, broken between words."""
    lines = [""]
    for word in text.split():
        longer = f"{lines[-1]} {word}".strip()
        if lines[-1] and face.getlength(longer) > room:
            lines.append(word)
        else:
            lines[-1] = longer
    shown = lines[:_MOST_LINES]
    return [annotate.shortened(each, face, room) for each in shown]


def field_size(scene: Scene) -> tuple[int, int]:
    """Width and height [pixels] that show the whole window of a scene with little around it."""
    world = window(scene)
    shape = (world.x_max - world.x_min) / (world.y_max - world.y_min)
    width = (PIXELS * min(max(shape, TALLEST), WIDEST)) ** 0.5
    return 2 * round(width / 2), 2 * round(PIXELS / width / 2)


def field_png(snapshot: Snapshot, scene: Scene, look: Look, readouts: str) -> bytes:
    """A picture as the page gets it: `LENGTH`, the JSON of what is read out beside it, then a PNG.

    They travel together, so that all that is shown is of one instant.

    At 960 x 540 and its like a PNG takes 36 kB and 8 ms, a JPEG as sharp 95 kB and 3 ms, a WebP
    that blurs lines 47 kB and 8 ms: flat colours suit PNG, and a phone or a tunnel feels the bytes.
    """
    image = raster.frame(snapshot, scene, field_size(scene), look=look, threads=1)
    head = readouts.encode()
    file = io.BytesIO()
    file.write(LENGTH.pack(len(head)) + head)
    Image.fromarray(image).save(file, "PNG", compress_level=1)
    return file.getvalue()


def colour_key(scene: Scene, mode: str) -> dict[str, Any]:
    """The colour key: words, colours from nothing to the most, and where ticks stand (0 to 1)."""
    key = Look(mode=mode).shown.key(scene)
    colours = shades(key.shades)
    picked = [colours[round(255 * k / (STOPS - 1))] for k in range(STOPS)]
    return {
        "words": " ".join(key.words),
        "colours": [f"#{r:02x}{g:02x}{b:02x}" for r, g, b in picked],
        "ticks": [[round(key.share(value), 4), text] for value, text in key.ticks],
    }
