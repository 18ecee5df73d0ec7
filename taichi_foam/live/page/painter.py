"""Pictures for the page: the field alone, encoded once for all who look; its key apart.

At 960 x 540 and its like a PNG takes 36 kB and 8 ms, a JPEG as sharp 95 kB and 3 ms, a WebP that
blurs lines 47 kB and 8 ms: flat colours suit PNG, and a phone or a tunnel feels the bytes.
"""

from __future__ import annotations

import io
import struct
from typing import TYPE_CHECKING, Any

from PIL import Image

from taichi_foam.picture import raster
from taichi_foam.picture.colours import shades
from taichi_foam.picture.look import Look
from taichi_foam.picture.view import window

if TYPE_CHECKING:
    from taichi_foam.records.snapshot import Snapshot
    from taichi_foam.scene import Scene

#: Pixels of a picture, and how wide it may be for its height and the other way round.
PIXELS, WIDEST, TALLEST = 960 * 540, 2.4, 0.8
#: Colours that the key's gradient is made of.
STOPS = 24

#: In front of a picture: the drop's number, time [s], displacement [m]; little endian.
HEADER = struct.Struct("<3d")


def size_of(scene: Scene) -> tuple[int, int]:
    """Width and height [pixels] that show the whole window of a scene with little around it."""
    world = window(scene)
    shape = (world.x_max - world.x_min) / (world.y_max - world.y_min)
    width = (PIXELS * min(max(shape, TALLEST), WIDEST)) ** 0.5
    return 2 * round(width / 2), 2 * round(PIXELS / width / 2)


def draw(snapshot: Snapshot, scene: Scene, look: Look, drop: int) -> bytes:
    """A picture as it is sent: `HEADER`, then a PNG."""
    image = raster.frame(snapshot, scene, size_of(scene), look=look, threads=1)
    sunk = 0.0 if scene.impactor is None else raster.sunk(snapshot, scene)
    file = io.BytesIO()
    file.write(HEADER.pack(drop, snapshot.time, sunk))
    Image.fromarray(image).save(file, "PNG", compress_level=1)
    return file.getvalue()


def key_of(scene: Scene, mode: str) -> dict[str, Any]:
    """The colour key: words, colours from nothing to the most, and where ticks stand (0 to 1)."""
    key = Look(mode=mode).shown.key(scene)
    colours = shades(key.shades)
    picked = [colours[round(255 * k / (STOPS - 1))] for k in range(STOPS)]
    return {
        "words": " ".join(key.words),
        "colours": [f"#{r:02x}{g:02x}{b:02x}" for r, g, b in picked],
        "ticks": [[round(value / key.top, 4), text] for value, text in key.ticks],
    }
