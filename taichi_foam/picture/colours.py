"""The colours of the pictures: one perceptually even map for the foam, a few fixed tones."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

Rgb = tuple[int, int, int]

PAGE: Rgb = (243, 242, 238)
FIELD: Rgb = (255, 255, 255)
FRAME: Rgb = (196, 194, 188)
INK: Rgb = (32, 33, 36)
SOFT_INK: Rgb = (88, 88, 92)
FLOOR: Rgb = (92, 92, 96)
CRACK: Rgb = (46, 34, 30)
STEEL: Rgb = (158, 166, 176)
STEEL_EDGE: Rgb = (56, 64, 74)

#: Strain at the dark end of the key: the locking strain of the paper's foam (Table 6).
KEY_STRAIN = 0.95
#: The map ends short of black, so that grid lines and steel stay apart from crushed foam.
_MAP, _DARKEST = "magma_r", 0.90


@lru_cache(maxsize=1)
def strain_map() -> NDArray[np.uint8]:
    """Colours (256, 3) from no compression (light) to KEY_STRAIN (dark)."""
    from matplotlib import colormaps

    rgba = colormaps[_MAP](np.linspace(0.0, _DARKEST, 256))
    return np.round(255 * rgba[:, :3]).astype(np.uint8)


def strain_levels(worst: NDArray[np.float64]) -> NDArray[np.intp]:
    """Index into `strain_map` for compressive strains (<= 0), of the same shape."""
    share = np.clip(worst * (-255.0 / KEY_STRAIN), 0.0, 255.0)
    return np.rint(share).astype(np.intp)


def packed(colours: NDArray[np.uint8]) -> NDArray[np.int32]:
    """Colours (n, 3) as 0xRRGGBB integers (n,)."""
    wide = colours.astype(np.int32)
    return (wide[..., 0] << 16) | (wide[..., 1] << 8) | wide[..., 2]


@lru_cache(maxsize=64)
def packed_strain_map() -> NDArray[np.int32]:
    """`strain_map` as 0xRRGGBB integers (256,)."""
    return packed(strain_map())


@lru_cache(maxsize=64)
def grid_line_map(strength: float) -> NDArray[np.int32]:
    """Colour (256,) of the grid line on each colour of the map, as 0xRRGGBB.

    Lines darken light foam and lighten dark foam, by `strength` in 0..1.
    """
    base = strain_map().astype(float)
    light = base @ np.array([0.299, 0.587, 0.114]) > 95.0
    towards = np.where(light[:, None], np.array(CRACK, float), np.array(STEEL, float))
    share = strength * np.where(light, 0.50, 0.45)[:, None]
    return packed(np.round(base + share * (towards - base)).astype(np.uint8))
