"""What is written over a live picture: a panel of keys, a strip for what went wrong."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from PIL import ImageFont

from taichi_foam.picture import annotate
from taichi_foam.picture.colours import THEMES, Theme
from taichi_foam.picture.view import Box

Image8 = NDArray[np.uint8]

#: Lines of a strip at most: what is longer is cut.
_MOST_LINES = 6


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
