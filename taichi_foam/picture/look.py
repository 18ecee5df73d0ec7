"""Colours of a picture: perceptually uniform colour maps for the foam, two themes, and the look.

The maps are those of Matplotlib that readers with any colour vision can order. They do not depend
on the theme: the same colour means the same value on a light page and on a dark one.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from taichi_foam.errors import UserError
from taichi_foam.picture.modes import MODES, Mode

if TYPE_CHECKING:
    from taichi_foam.scene import Scene

Rgb = tuple[int, int, int]
Ints = NDArray[np.int32]


@dataclass(frozen=True)
class Theme:
    """The colours of everything except foam."""

    page: Rgb
    field: Rgb
    frame: Rgb
    ink: Rgb
    soft_ink: Rgb
    floor: Rgb
    crack: Rgb
    crack_on_dark: Rgb  # the line of a crack through foam in a dark colour
    steel: Rgb
    steel_edge: Rgb
    curves: tuple[Rgb, Rgb, Rgb, Rgb]  # of runs side by side; a single run has the first


THEMES = {
    "light": Theme(
        page=(243, 242, 238),
        field=(255, 255, 255),
        frame=(196, 194, 188),
        ink=(32, 33, 36),
        soft_ink=(88, 88, 92),
        floor=(92, 92, 96),
        crack=(46, 34, 30),
        crack_on_dark=(46, 34, 30),
        steel=(158, 166, 176),
        steel_edge=(56, 64, 74),
        # blue, vermillion, bluish green and reddish purple of Okabe & Ito, the last a little darker
        curves=((0, 114, 178), (213, 94, 0), (0, 158, 115), (194, 108, 157)),
    ),
    "dark": Theme(
        page=(22, 24, 28),
        field=(36, 39, 45),
        frame=(78, 82, 90),
        ink=(232, 233, 236),
        soft_ink=(172, 175, 182),
        floor=(150, 153, 160),
        crack=(46, 34, 30),
        crack_on_dark=(186, 176, 190),
        steel=(120, 130, 144),
        steel_edge=(206, 214, 224),
        curves=((86, 180, 233), (240, 170, 60), (0, 158, 115), (204, 121, 167)),
    ),
}

# Maps of Matplotlib by the name that modes use, from the light end (nothing) to the dark one.
# They end short of black, so that grid lines and steel differ from crushed foam.
_MAPS = {
    "heat": ("magma_r", 0.0, 0.90),
    "cool": ("viridis_r", 0.0, 1.0),
    # dark at both ends, light in the middle: blue below zero, red above
    "both": ("RdBu_r", 0.03, 0.97),
}

# Luma below which a colour counts as dark.
_DARK = 95.0


@lru_cache(maxsize=4)
def shades(name: str) -> NDArray[np.uint8]:
    """Colours (256, 3) of a map, from zero (light) to the maximum (dark)."""
    from matplotlib import colormaps

    source, start, end = _MAPS[name]
    rgba = colormaps[source](np.linspace(start, end, 256))
    return np.round(255 * rgba[:, :3]).astype(np.uint8)


def levels(values: NDArray[np.float64], top: float, bottom: float = 0.0) -> NDArray[np.intp]:
    """Indices into `shades` for values from `bottom` to `top`, of the same shape; clipped."""
    share = np.clip((values - bottom) * (255.0 / (top - bottom)), 0.0, 255.0)
    return np.rint(share).astype(np.intp)


def packed(colours: NDArray[np.uint8]) -> Ints:
    """Colours (n, 3) as 0xRRGGBB integers (n,)."""
    wide = colours.astype(np.int32)
    return (wide[..., 0] << 16) | (wide[..., 1] << 8) | wide[..., 2]


def packed_one(colour: Rgb) -> int:
    """One colour as 0xRRGGBB."""
    return int(packed(np.array(colour, dtype=np.uint8)))


@lru_cache(maxsize=4)
def packed_shades(name: str) -> Ints:
    """`shades` as 0xRRGGBB integers (256,)."""
    return packed(shades(name))


@lru_cache(maxsize=64)
def grid_line_map(name: str, strength: float) -> Ints:
    """Colour (256,) of the grid line on each colour of a map, as 0xRRGGBB.

    Lines darken light foam and lighten dark foam, by `strength` in 0..1.
    """
    light = THEMES["light"]
    base, dark = shades(name).astype(float), _is_dark(name)
    towards = np.where(dark[:, None], np.array(light.steel, float), np.array(light.crack, float))
    share = strength * np.where(dark, 0.45, 0.50)[:, None]
    return packed(np.round(base + share * (towards - base)).astype(np.uint8))


@lru_cache(maxsize=8)
def crack_line_map(name: str, theme: str) -> Ints:
    """Colour (256,) of a crack's line on each colour of a map, as 0xRRGGBB."""
    tones = THEMES[theme]
    dark = _is_dark(name)[:, None]
    lines = np.where(dark, np.array(tones.crack_on_dark), np.array(tones.crack))
    return packed(lines.astype(np.uint8))


def _is_dark(name: str) -> NDArray[np.bool_]:
    """Whether each colour (256,) of a map is dark."""
    return shades(name).astype(float) @ np.array([0.299, 0.587, 0.114]) <= _DARK


@dataclass(frozen=True)
class Look:
    """How pictures are drawn.

    mode   key of `modes.MODES`: the quantity that the colours show
    theme  key of `THEMES`
    grid   whether to draw the deformed grid of the foam
    words  whether to draw title, values and key beside the field; else the field fills the picture

    Raises UserError for an unknown name.
    """

    mode: str = "worst-strain"
    theme: str = "light"
    grid: bool = True
    words: bool = True

    def __post_init__(self) -> None:
        for name, given, known in (("mode", self.mode, MODES), ("theme", self.theme, THEMES)):
            if given not in known:
                raise UserError(f"{name} = {given!r}: must be one of {', '.join(known)}")

    @classmethod
    def of(cls, scene: Scene) -> Look:
        """The look that the scene requests."""
        return cls(scene.output.mode, scene.output.theme)

    @property
    def tones(self) -> Theme:
        return THEMES[self.theme]

    @property
    def shown(self) -> Mode:
        """The quantity that the colours show."""
        return MODES[self.mode]
