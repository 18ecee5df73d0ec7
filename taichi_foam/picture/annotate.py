"""Text, colour key, scale bar and floor of a picture, drawn with Pillow.

Sizes are in pixels of the picture; callers scale them with the picture's height.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from taichi_foam.picture.look import THEMES, Rgb, Theme, shades
from taichi_foam.picture.modes import Key
from taichi_foam.picture.view import Box, View
from taichi_foam.scene.outlines import Corners

Image8 = NDArray[np.uint8]

_LIGHT = THEMES["light"]
_SMALLEST_TEXT = 8
_ELLIPSIS = "…"


@lru_cache(maxsize=64)
def font(size: float, bold: bool = False) -> ImageFont.FreeTypeFont:
    """DejaVu Sans, which comes with every Matplotlib, at `size` pixels."""
    import matplotlib

    name = "DejaVuSans-Bold.ttf" if bold else "DejaVuSans.ttf"
    path = Path(matplotlib.get_data_path()) / "fonts" / "ttf" / name
    return ImageFont.truetype(str(path), max(_SMALLEST_TEXT, round(size)))


def shortened(string: str, face: ImageFont.FreeTypeFont, width: float) -> str:
    """`string`, cut with an ellipsis if it would be wider than `width` pixels."""
    if face.getlength(string) <= width:
        return string
    while string and face.getlength(string + _ELLIPSIS) > width:
        string = string[:-1]
    return string.rstrip() + _ELLIPSIS


def write(
    image: Image8,
    xy: tuple[float, float],
    string: str,
    face: ImageFont.FreeTypeFont,
    *,
    anchor: str = "ls",
    colour: Rgb = _LIGHT.ink,
) -> None:
    """Write one line of text into `image` (h, w, 3), in place; `anchor` as in Pillow.

    Only the area under the text is copied, so that a label costs far less than a frame.
    """
    x, y = round(xy[0]), round(xy[1])
    left, top, right, bottom = face.getbbox(string, anchor=anchor)
    height, width = image.shape[:2]
    c0, c1 = max(0, x + math.floor(left) - 1), min(width, x + math.ceil(right) + 1)
    r0, r1 = max(0, y + math.floor(top) - 1), min(height, y + math.ceil(bottom) + 1)
    if c0 >= c1 or r0 >= r1:
        return
    patch = Image.fromarray(np.ascontiguousarray(image[r0:r1, c0:c1]))
    ImageDraw.Draw(patch).text((x - c0, y - r0), string, fill=colour, font=face, anchor=anchor)
    image[r0:r1, c0:c1] = np.asarray(patch)


def blank(width: int, height: int, colour: Rgb = _LIGHT.page) -> Image8:
    """A picture (height, width, 3) of a single colour."""
    image = np.empty((height, width, 3), dtype=np.uint8)
    image[:] = colour
    return image


def field(
    image: Image8,
    view: View,
    line: float,
    tones: Theme = _LIGHT,
    support: Corners | None = None,
) -> None:
    """Prepare the view's box: empty, with a hatched floor below y = 0 and a thin frame.

    A support with an outline, corners [x, y] [m], is drawn in place of the floor.
    """
    box = view.box
    rectangle(image, box, tones.field)
    ground = round(view.y_zero)
    if support is not None:
        _body(image, view, line, tones, support)
    elif box.top < ground < box.bottom:
        _hatch(image, Box(box.left, ground, box.right, box.bottom), line, tones)
    _outline(image, box, tones.frame, max(1, round(line)))


def sheet(image: Image8, box: Box, line: float, tones: Theme) -> None:
    """Draw an empty page in `box`, with a frame [pixels] along its inside; it may be cut off."""
    edge = max(1, round(line))
    rectangle(image, box, tones.frame)
    inner = Box(box.left + edge, box.top + edge, box.right - edge, box.bottom - edge)
    rectangle(image, inner, tones.page)


def rectangle(image: Image8, box: Box, colour: Rgb) -> None:
    """Fill `box` with `colour`."""
    image[max(0, box.top) : max(0, box.bottom), max(0, box.left) : max(0, box.right)] = colour


def _body(image: Image8, view: View, line: float, tones: Theme, corners: Corners) -> None:
    """Draw a rigid body, as far as it is in the view's box, with a line along its outline."""
    fine, box = 4, view.box  # as for the floor's strokes
    left, top = max(0, box.left), max(0, box.top)
    seen = image[top : max(0, box.bottom), left : max(0, box.right)]
    if seen.size == 0:
        return
    patch = Image.new("RGB", (seen.shape[1] * fine, seen.shape[0] * fine), tones.field)
    x, y = np.array(corners).T
    column = fine * (view.x_zero + view.scale * x - left)
    row = fine * (view.y_zero - view.scale * y - top)
    points = [*zip(column.tolist(), row.tolist(), strict=True)]
    draw = ImageDraw.Draw(patch)
    draw.polygon(points, fill=tones.frame)
    draw.line([*points, points[0]], fill=tones.floor, width=max(1, round(2 * line * fine)))
    seen[:] = np.array(patch.resize((seen.shape[1], seen.shape[0]), Image.Resampling.BOX))


def _hatch(image: Image8, box: Box, line: float, tones: Theme) -> None:
    """Draw a floor line along the top of `box` and short slanted strokes below it."""
    fine = 4  # Pillow's lines have no smooth edges, so they are drawn larger and averaged
    depth = min(box.height, max(3, round(11 * line)))
    patch = Image.new("RGB", (box.width * fine, depth * fine), tones.field)
    draw = ImageDraw.Draw(patch)
    pitch = max(4, round(12 * line)) * fine
    for x in range(pitch // 2, (box.width + depth) * fine, pitch):
        start, end = (x, 0), (x + 0.8 * depth * fine, depth * fine)
        draw.line((start, end), fill=tones.frame, width=max(1, round(1.4 * line * fine)))
    strokes = np.array(patch.resize((box.width, depth), Image.Resampling.BOX))
    # Strokes lean away from the middle on both sides: the floor is symmetric, like the block.
    right = strokes[:, : (box.width + 1) // 2]
    strokes[:, box.width // 2 :], strokes[:, : right.shape[1]] = right, right[:, ::-1].copy()
    image[box.top : box.top + depth, box.left : box.right] = strokes
    thick = max(1, round(2 * line))
    rectangle(image, Box(box.left, box.top, box.right, box.top + thick), tones.floor)


def upright_key(image: Image8, box: Box, size: float, key: Key, tones: Theme) -> None:
    """Draw the colour key in `box` with its low end on top; text of `size` pixels."""
    face = font(size)
    y = box.top
    for word in key.words:
        write(image, (box.left, y), word, face, anchor="la", colour=tones.ink)
        y += round(1.25 * size)
    y += round(0.6 * size)
    bar = Box(box.left, y, box.left + round(1.3 * size), box.bottom - round(0.5 * size))
    steps = np.linspace(0, 255, bar.height).round().astype(int)
    image[bar.top : bar.bottom, bar.left : bar.right] = shades(key.shades)[steps][:, None]
    _outline(image, bar, tones.soft_ink)
    for tick, text in key.ticks:
        row = bar.top + round(key.share(tick) * (bar.height - 1))
        mark = Box(bar.right, row, bar.right + max(3, round(0.35 * size)), row + 1)
        rectangle(image, mark, tones.ink)
        place = (mark.right + 0.3 * size, row)
        write(image, place, text, face, anchor="lm", colour=tones.ink)


def level_key(
    image: Image8, box: Box, size: float, key: Key, tones: Theme = _LIGHT, *, under: bool = False
) -> None:
    """Draw the colour key across `box`: title on the left, bar with ticks below it on the right.

    With `under` the bar is as wide as the box, and below its title.
    """
    face = font(size)
    title = " ".join(key.words)
    middle = (box.top + box.bottom) / 2 - 0.65 * size
    if under:
        write(image, (box.left, middle - 1.5 * size), title, face, anchor="lm", colour=tones.ink)
        # The first tick's text is centred on the bar's end.
        start = box.left + math.ceil(face.getlength(key.ticks[0][1]) / 2)
    else:
        write(image, (box.left, middle), title, face, anchor="lm", colour=tones.ink)
        start = box.left + math.ceil(face.getlength(title) + 0.9 * size)
    bar = Box(start, round(middle - 0.55 * size), box.right, round(middle + 0.55 * size))
    steps = np.linspace(0, 255, bar.width).round().astype(int)
    image[bar.top : bar.bottom, bar.left : bar.right] = shades(key.shades)[steps][None]
    _outline(image, bar, tones.soft_ink)
    columns = [bar.left + round(key.share(tick) * (bar.width - 1)) for tick, _ in key.ticks]
    texts = [text for _, text in key.ticks]
    legible = _apart(columns, [face.getlength(text) + 0.4 * size for text in texts])
    for number, (column, text) in enumerate(zip(columns, texts, strict=True)):
        mark = Box(column, bar.bottom, column + 1, bar.bottom + max(3, round(0.3 * size)))
        rectangle(image, mark, tones.ink)
        if number in legible:
            place = (column, mark.bottom + 0.15 * size)
            write(image, place, text, face, anchor="ma", colour=tones.ink)


def _apart(middles: Sequence[float], widths: Sequence[float]) -> list[int]:
    """Which texts of a row can be written without overlap: the ends, and those between that fit."""
    last = len(middles) - 1
    kept = [0]
    for n in range(1, last):
        beside = (kept[-1], last)
        if all(abs(middles[n] - middles[k]) >= 0.5 * (widths[n] + widths[k]) for k in beside):
            kept.append(n)
    return [*kept, last] if last else kept


def scale_bar(
    image: Image8,
    left: float,
    baseline: float,
    scale: float,
    longest: float,
    size: float,
    tones: Theme,
) -> None:
    """Draw a bar of a round length, at most `longest` pixels, with its length above it.

    Args:
        left, baseline: lower left end of the bar.
        scale: pixels per metre in the picture beside it.
        size: size of the text in pixels.
    """
    length = round_length(longest / scale)
    thick = max(2, round(0.22 * size))
    bar = Box(round(left), round(baseline) - thick, round(left + length * scale), round(baseline))
    rectangle(image, bar, tones.ink)
    tall = max(1, round(0.12 * size))
    for column in (bar.left, bar.right - tall):
        rectangle(image, Box(column, bar.top - 2 * tall, column + tall, bar.bottom), tones.ink)
    place = (bar.left, bar.top - 0.45 * size)
    write(image, place, length_text(length), font(size), anchor="ls", colour=tones.ink)


def round_length(longest: float) -> float:
    """The largest of 1, 2, 5 times a power of ten that is not above `longest` [m]."""
    power = 10.0 ** math.floor(math.log10(longest))
    return max(step * power for step in (1, 2, 5) if step * power <= longest * (1 + 1e-12))


def length_text(length: float) -> str:
    """A length [m] in a convenient unit."""
    if length < 0.01:
        return f"{1e3 * length:g} mm"
    return f"{1e2 * length:g} cm" if length < 1 else f"{length:g} m"


def time_text(time: float, interval: float) -> str:
    """A time [s] of a run with snapshots `interval` [s] apart, such that no two texts are equal.

    At least one decimal of a millisecond; more to show the interval exactly or to distinguish.
    """
    apart = 1e3 * interval
    fewest = max(1, math.ceil(-math.log10(apart) - 1e-9))
    exact = (d for d in range(fewest, fewest + 3) if math.isclose(apart, round(apart, d)))
    return f"{1e3 * time:.{next(exact, fewest)}f} ms"


def _outline(image: Image8, box: Box, colour: Rgb, edge: int = 1) -> None:
    """Draw a line of `edge` pixels along the inside of `box`."""
    part = image[box.top : box.bottom, box.left : box.right]
    part[:edge], part[-edge:], part[:, :edge], part[:, -edge:] = (colour,) * 4
