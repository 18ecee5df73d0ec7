"""Filling polygons with samples: a small scanline rasteriser as one Taichi kernel."""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from taichi_foam.backend import ti
from taichi_foam.engine import runtime
from taichi_foam.picture.look import THEMES, Theme, packed_one
from taichi_foam.picture.view import View

#: Samples along each side of a pixel; `_average` lists the four explicitly.
FINE = 2
#: Horizontal bands per thread, each drawn by one thread: two distribute the work more evenly.
BANDS = 2
#: Columns of `inks`, which say how a quadrilateral is painted.
FILL, EDGE, CRACK, SIDES, STROKES = range(5)
#: The bits for strokes of grid lines and layers are shifted by this much from those of crack lines.
GRID_BITS, LAYER_BITS = 4, 8
#: Width of a grid line's stroke in samples: thin, and equally strong at any position.
GRID_STROKE = 2.02
#: Taichi gives each CPU thread at least this many iterations of a parallel loop.
STRIDE = 512


def paint(
    image: NDArray[np.uint8],
    view: View,
    shapes: NDArray[np.float64],
    inks: NDArray[np.int32],
    order: NDArray[np.int32],
    *,
    grid_line: float = 0.0,
    crack_line: float = 0.0,
    shape: NDArray[np.float64],
    shape_line: float = 0.0,
    theme: Theme = THEMES["light"],
    threads: int | None = None,
) -> None:
    """Fill quadrilaterals and one outline over `image`, in place.

    Args:
        image: uint8 (h, w, 3).
        view: world to pixels; nothing is drawn outside its box.
        shapes: quadrilaterals (n, 4, 2) [m]: lower left, lower right, upper right, upper left.
        inks: how each is painted (n, 5), by the columns

            FILL, EDGE, CRACK  colours of the cell, its grid line and its crack lines, 0xRRGGBB
            SIDES              sides that get a crack line inside the cell (`LEFT` and so on)
            STROKES            sides that get a line centred on the edge, on top of all cells, for
                               cells of any size: bits as in SIDES for crack lines, shifted by
                               GRID_BITS for grid lines, by LAYER_BITS for faces between layers
        order: indices in painting order, later ones on top, (n,).
        grid_line, crack_line: widths [pixels]; half of a grid line lies on either cell. With a
            width of 0 cells have no grid lines inside them.
        shape: outline (m, 2) [m], convex or not, on top of everything; m may be 0.
        shape_line: width of the line inside its edge [pixels].
        theme: colours of the outline.
        threads: CPU threads to draw with; default all that Taichi was started with.
    """
    runtime.start()  # a runtime on another architecture also works
    height, width = image.shape[:2]
    box = view.box
    outline = np.zeros((2, 1, 2))  # an array without elements cannot be passed
    if len(shape):
        outer = _to_samples(shape, view)
        outline = np.stack([outer, _inset(outer, FINE * shape_line)])
    tones = (theme.soft_ink, theme.steel_edge, theme.steel)
    _paint(
        image,
        _scratch(height, width),
        np.ascontiguousarray(shapes),
        np.ascontiguousarray(inks),
        order,
        np.empty((len(shapes), 2), dtype=np.int32),
        outline,
        len(shape),
        [FINE * view.scale, FINE * view.x_zero, FINE * view.y_zero],
        [FINE * grid_line / 2, FINE * crack_line],
        [max(0, box.left), max(0, box.top), min(width, box.right), min(height, box.bottom)],
        _bands(height, threads),
        [packed_one(tone) for tone in tones],
    )


@lru_cache(maxsize=2)
def _scratch(height: int, width: int) -> NDArray[np.int64]:
    """The samples, kept between frames: allocating new memory costs as much as filling it.

    The two samples of a row in one pixel are the halves of one number, the first the lower half:
    most of the work is storing samples, so they are stored two at a time.
    """
    return np.empty((FINE * height, width), dtype=np.int64)


def _bands(height: int, threads: int | None) -> list[int]:
    """Number of bands that the picture is cut into, and loop iterations per band."""
    settings = runtime.settings()
    if settings["arch"] == "cpu":
        # a single band stays on a single thread
        count = 1 if threads == 1 else BANDS * (threads or int(settings["threads"]))
        return [min(count, height), STRIDE]
    return [height, 1]  # a graphics device has threads for every row


def _to_samples(points: NDArray[np.float64], view: View) -> NDArray[np.float64]:
    """World points (n, 2) [m] in samples, rows downwards."""
    flip = np.array([view.scale, -view.scale])
    return FINE * (np.array([view.x_zero, view.y_zero]) + points * flip)


def _inset(outline: NDArray[np.float64], by: float) -> NDArray[np.float64]:
    """An outline with each edge moved inwards by `by` (any unit)."""
    ahead = np.roll(outline, -1, axis=0) - outline
    ahead /= np.linalg.norm(ahead, axis=1, keepdims=True)
    area = np.sum(outline[:, 0] * np.roll(outline[:, 1], -1))
    area -= np.sum(outline[:, 1] * np.roll(outline[:, 0], -1))
    normal = np.sign(area) * np.column_stack([-ahead[:, 1], ahead[:, 0]])
    before = np.roll(normal, 1, axis=0)
    # The corner of two shifted edges; a sharp corner would move far, so the shift is limited.
    corner = (normal + before) / np.maximum(1 + np.sum(normal * before, axis=1), 0.1)[:, None]
    return outline + by * corner


@ti.func
def _sample(edge: ti.f64) -> ti.i32:
    """First sample whose centre is at or beyond `edge`."""
    return ti.cast(ti.ceil(ti.min(ti.max(edge, -1e6), 1e6) - 0.5), ti.i32)


@ti.func
def _crossing(points: ti.template(), which: int, a: int, b: int, y: ti.f64) -> ti.f64:
    """Where the edge between two corners crosses row `y`: the same number from either end."""
    xa, ya = points[which, a, 0], points[which, a, 1]
    xb, yb = points[which, b, 0], points[which, b, 1]
    swap = ya > yb
    x0, y0 = ti.select(swap, xb, xa), ti.select(swap, yb, ya)
    x1, y1 = ti.select(swap, xa, xb), ti.select(swap, ya, yb)
    return x0 + (y - y0) / (y1 - y0) * (x1 - x0)


@ti.func
def _fill_row(samples: ti.template(), row: int, start: float, end: float, clip, colour: int):
    first, last = ti.max(clip[0], _sample(start)), ti.min(clip[2], _sample(end))
    if first < last:
        lower = ti.cast(colour, ti.i64)
        upper = lower << 32
        keep_upper = ti.cast(-1, ti.i64) << 32
        if first & 1 == 1:
            samples[row, first >> 1] = upper | (samples[row, first >> 1] & ~keep_upper)
        for column in range((first + 1) >> 1, last >> 1):
            samples[row, column] = upper | lower
        if last & 1 == 1:
            samples[row, last >> 1] = (samples[row, last >> 1] & keep_upper) | lower


@ti.func
def _fill_quad(samples: ti.template(), x, y, clip, colour: int):
    """Fill a convex quadrilateral with corners x, y (4-vectors) in samples, within `clip`."""
    # Each edge from its upper end: both cells that share it get the same crossing in each row.
    start_x, start_y, slope = ti.Vector([0.0] * 4), ti.Vector([0.0] * 4), ti.Vector([0.0] * 4)
    for k in ti.static(range(4)):
        n = ti.static((k + 1) % 4)
        swap = y[k] > y[n]
        start_x[k], start_y[k] = ti.select(swap, x[n], x[k]), ti.select(swap, y[n], y[k])
        end_x, end_y = ti.select(swap, x[k], x[n]), ti.select(swap, y[k], y[n])
        slope[k] = (end_x - start_x[k]) / ti.max(end_y - start_y[k], 1e-30)
    for row in range(ti.max(clip[1], _sample(y.min())), ti.min(clip[3], _sample(y.max()))):
        level = row + 0.5
        start, end = 1e9, -1e9
        for k in ti.static(range(4)):
            if (y[k] <= level) != (y[ti.static((k + 1) % 4)] <= level):
                at = start_x[k] + (level - start_y[k]) * slope[k]
                start, end = ti.min(start, at), ti.max(end, at)
        if start < end:
            _fill_row(samples, row, start, end, clip, colour)


@ti.func
def _fill_outline(
    samples: ti.template(), points: ti.template(), which: int, n: int, clip, colour: int
):
    """Fill one outline `which` of `points` (2, n, 2) in samples, within `clip`.

    A row is filled between its crossings, taken in pairs from the left.
    """
    lowest, highest = 1e9, -1e9
    for k in range(n):
        lowest, highest = ti.min(lowest, points[which, k, 1]), ti.max(highest, points[which, k, 1])
    for row in range(ti.max(clip[1], _sample(lowest)), ti.min(clip[3], _sample(highest))):
        level = row + 0.5
        before, last, inside = -1e9, -1, False
        for _ in range(n):
            start, edge = 1e9, -1  # the next crossing: further right, or equal with a later edge
            for k in range(n):
                m = (k + 1) % n
                if (points[which, k, 1] <= level) != (points[which, m, 1] <= level):
                    at = _crossing(points, which, k, m, level)
                    if (at > before or (at == before and k > last)) and at < start:
                        start, edge = at, k
            if edge < 0:
                break
            if inside:
                _fill_row(samples, row, before, start, clip, colour)
            before, last, inside = start, edge, not inside


@ti.func
def _paint_cell(samples: ti.template(), x, y, clip, fill, edge, sides, grid, crack, crack_colour):
    """One cell: grid line and colour, then a crack line inside each open side.

    Lines are strips in the cell's own coordinates, each a bounded share of its width or height:
    they get thinner as a cell is crushed flat, and leave its colour visible.
    """
    across, upright, width, height = 0.0, 0.0, 1.0, 1.0
    first, last = 1, 2
    if grid > 0 or sides != 0:
        first, last = 0, 6
        width = 0.5 * (
            ti.sqrt((x[1] - x[0]) ** 2 + (y[1] - y[0]) ** 2)
            + ti.sqrt((x[2] - x[3]) ** 2 + (y[2] - y[3]) ** 2)
        )
        height = 0.5 * (
            ti.sqrt((x[3] - x[0]) ** 2 + (y[3] - y[0]) ** 2)
            + ti.sqrt((x[2] - x[1]) ** 2 + (y[2] - y[1]) ** 2)
        )
        across = ti.min(0.25, crack / ti.max(width, 1e-9))
        upright = ti.min(0.25, crack / ti.max(height, 1e-9))
    for part in range(first, last):
        wanted = grid > 0 or part == 1
        if part >= 2:
            wanted = (sides >> (part - 2)) & 1 == 1
        if wanted:
            u0, u1, v0, v1 = 0.0, 1.0, 0.0, 1.0
            colour = edge
            if part == 1:
                colour = fill
                u0 = ti.min(0.2, grid / ti.max(width, 1e-9))
                v0 = ti.min(0.2, grid / ti.max(height, 1e-9))
                u1, v1 = 1 - u0, 1 - v0
            elif part >= 2:
                colour = crack_colour
                if part == 2:
                    u1 = across
                elif part == 3:
                    u0 = 1 - across
                elif part == 4:
                    v1 = upright
                else:
                    v0 = 1 - upright
            u, v = ti.Vector([u0, u1, u1, u0]), ti.Vector([v0, v0, v1, v1])
            px = (1 - v) * ((1 - u) * x[0] + u * x[1]) + v * ((1 - u) * x[3] + u * x[2])
            py = (1 - v) * ((1 - u) * y[0] + u * y[1]) + v * ((1 - u) * y[3] + u * y[2])
            _fill_quad(samples, px, py, clip, colour)


@ti.func
def _stroke(samples: ti.template(), x, y, side, width, clip, colour: int):
    """A line of `width` samples along one side of a cell, centred on the edge.

    It extends half its width beyond both ends, so that sides shorter than a sample join up.
    """
    start_x, start_y, end_x, end_y = x[0], y[0], x[3], y[3]
    for n in ti.static(range(1, 4)):
        a, b = ti.static(((0, 3), (1, 2), (0, 1), (3, 2))[n])
        if side == n:
            start_x, start_y, end_x, end_y = x[a], y[a], x[b], y[b]
    along_x, along_y = end_x - start_x, end_y - start_y
    length = ti.max(ti.sqrt(along_x**2 + along_y**2), 1e-9)
    along_x, along_y = 0.5 * width * along_x / length, 0.5 * width * along_y / length
    start_x, start_y, end_x, end_y = (
        start_x - along_x, start_y - along_y, end_x + along_x, end_y + along_y,
    )  # fmt: skip
    px = ti.Vector([start_x - along_y, start_x + along_y, end_x + along_y, end_x - along_y])
    py = ti.Vector([start_y + along_x, start_y - along_x, end_y - along_x, end_y + along_x])
    _fill_quad(samples, px, py, clip, colour)


@ti.func
def _corners(shapes: ti.template(), p, place):
    """Corners of a quadrilateral in samples: x, y (4-vectors)."""
    x, y = ti.Vector([0.0] * 4), ti.Vector([0.0] * 4)
    for k in ti.static(range(4)):
        x[k] = place[1] + place[0] * shapes[p, k, 0]
        y[k] = place[2] - place[0] * shapes[p, k, 1]
    return x, y


@ti.func
def _average(image: ti.template(), samples: ti.template(), row, column):
    """The mean of a pixel's samples, with the picture below for empty samples."""
    above, under = samples[FINE * row, column], samples[FINE * row + 1, column]
    c0, c1 = ti.cast(above, ti.i32), ti.cast(above >> 32, ti.i32)
    c2, c3 = ti.cast(under, ti.i32), ti.cast(under >> 32, ti.i32)
    if above == under and c0 == c1:
        if c0 >= 0:
            for band in ti.static(range(3)):
                image[row, column, band] = ti.cast((c0 >> (16 - 8 * band)) & 255, ti.u8)
    else:
        for band in ti.static(range(3)):
            below = ti.cast(image[row, column, band], ti.i32)
            total = 2  # half of four: rounds
            for c in ti.static((c0, c1, c2, c3)):
                total += ti.select(c >= 0, (c >> (16 - 8 * band)) & 255, below)
            image[row, column, band] = ti.cast(total >> 2, ti.u8)


@ti.kernel
def _paint(
    image: ti.types.ndarray(dtype=ti.u8, ndim=3),
    samples: ti.types.ndarray(dtype=ti.i64, ndim=2),
    shapes: ti.types.ndarray(dtype=ti.f64, ndim=3),
    inks: ti.types.ndarray(dtype=ti.i32, ndim=2),
    order: ti.types.ndarray(dtype=ti.i32, ndim=1),
    span: ti.types.ndarray(dtype=ti.i32, ndim=2),
    outline: ti.types.ndarray(dtype=ti.f64, ndim=3),  # outer, inner
    outline_points: ti.i32,
    place: ti.types.vector(3, ti.f64),  # scale, x_zero, y_zero
    lines: ti.types.vector(2, ti.f64),  # widths of grid lines, half of each, and of crack lines
    box: ti.types.vector(4, ti.i32),  # left, top, right, bottom
    cut: ti.types.vector(2, ti.i32),  # bands, iterations for each
    tones: ti.types.vector(3, ti.i32),  # of faces of layers, the outline's line and its inside
):
    """Sample every band in painter's order, then average the samples into its pixels.

    A sample of -1 shows the image below. A pixel's value does not depend on how the picture
    is cut into bands, so any number of threads gives the same picture.
    """
    for p in range(shapes.shape[0]):
        _, y = _corners(shapes, p, place)
        span[p, 0], span[p, 1] = _sample(y.min()), _sample(y.max())

    bands, stride = cut[0], cut[1]
    grid, crack_line = lines[0], lines[1]
    reach = ti.cast(crack_line + GRID_STROKE, ti.i32)
    for q in range(bands * stride):
        if q % stride == 0:
            band = q // stride
            first = ti.max(box[1], band * image.shape[0] // bands)
            last = ti.min(box[3], (band + 1) * image.shape[0] // bands)
            clip = ti.Vector([FINE * box[0], FINE * first, FINE * box[2], FINE * last])
            for row in range(clip[1], clip[3]):
                for column in range(clip[0] // FINE, clip[2] // FINE):
                    samples[row, column] = -1
            # the painted range, in samples: only this is averaged, half of a typical frame
            low, high = ti.Vector([1e9, 1e9]), ti.Vector([-1e9, -1e9])
            for s in range(shapes.shape[0]):
                p = order[s]
                if span[p, 0] < clip[3] and span[p, 1] > clip[1]:
                    x, y = _corners(shapes, p, place)
                    low = ti.min(low, ti.Vector([x.min(), y.min()]))
                    high = ti.max(high, ti.Vector([x.max(), y.max()]))
                    _paint_cell(
                        samples, x, y, clip, inks[p, FILL], inks[p, EDGE], inks[p, SIDES],
                        grid, crack_line, inks[p, CRACK],
                    )  # fmt: skip
            for kind in range(3):  # cracks over faces of layers over the grid
                width = ti.select(kind == 0, GRID_STROKE, crack_line)
                shift = ti.select(kind == 0, GRID_BITS, ti.select(kind == 1, LAYER_BITS, 0))
                for s in range(shapes.shape[0]):
                    p = order[s]
                    sides = (inks[p, STROKES] >> shift) & 15
                    if sides != 0 and span[p, 0] - reach < clip[3] and span[p, 1] + reach > clip[1]:
                        x, y = _corners(shapes, p, place)
                        low = ti.min(low, ti.Vector([x.min(), y.min()]))
                        high = ti.max(high, ti.Vector([x.max(), y.max()]))
                        own = ti.select(kind == 0, inks[p, EDGE], inks[p, CRACK])
                        colour = ti.select(kind == 1, tones[0], own)
                        for side in range(4):
                            if (sides >> side) & 1 == 1:
                                _stroke(samples, x, y, side, width, clip, colour)
            if outline_points > 0:
                _fill_outline(samples, outline, 0, outline_points, clip, tones[1])
                _fill_outline(samples, outline, 1, outline_points, clip, tones[2])
            for k in range(outline_points):
                for n in ti.static(range(2)):
                    corner = ti.Vector([outline[n, k, 0], outline[n, k, 1]])
                    low, high = ti.min(low, corner), ti.max(high, corner)
            for row in range(
                ti.max(clip[1], _sample(low[1]) - reach) // FINE,
                (ti.min(clip[3], _sample(high[1]) + reach) + FINE - 1) // FINE,
            ):
                for column in range(
                    ti.max(clip[0], _sample(low[0]) - reach) // FINE,
                    (ti.min(clip[2], _sample(high[0]) + reach) + FINE - 1) // FINE,
                ):
                    _average(image, samples, row, column)
