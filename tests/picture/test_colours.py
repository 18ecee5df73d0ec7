"""The colours of curves: apart from one another for every reader, and from the page."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from taichi_foam.picture.look import THEMES

# Machado, Oliveira & Fernandes (2009), severity 1.0, in linear RGB.
VISION = {
    "all colours": np.eye(3),
    "no red": np.array(
        [[0.152286, 1.052583, -0.204868],
         [0.114503, 0.786281, 0.099216],
         [-0.003882, -0.048116, 1.051998]]
    ),
    "no green": np.array(
        [[0.367322, 0.860646, -0.227968],
         [0.280085, 0.672501, 0.047413],
         [-0.011820, 0.042940, 0.968881]]
    ),
    "no blue": np.array(
        [[1.255528, -0.076749, -0.178779],
         [-0.078411, 0.930809, 0.147602],
         [0.004733, 0.691367, 0.303900]]
    ),
}  # fmt: skip
# sRGB to CIE XYZ, and the white of D65.
XYZ = np.array([[0.4124564, 0.3575761, 0.1804375],
                [0.2126729, 0.7151522, 0.0721750],
                [0.0193339, 0.1191920, 0.9503041]])  # fmt: skip
WHITE = np.array([0.95047, 1.0, 1.08883])


def linear(colour: tuple[int, int, int]) -> np.ndarray:
    """Linear RGB of an sRGB colour."""
    share = np.array(colour) / 255
    return np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)


def lab(rgb: np.ndarray) -> np.ndarray:
    """CIE L*a*b* of linear RGB."""
    t = XYZ @ np.clip(rgb, 0, 1) / WHITE
    f = np.where(t > 0.008856, np.cbrt(t), 7.787 * t + 16 / 116)
    return np.array([116 * f[1] - 16, 500 * (f[0] - f[1]), 200 * (f[1] - f[2])])


@pytest.mark.parametrize("vision", VISION)
@pytest.mark.parametrize("theme", THEMES)
def test_any_two_curves_differ_for_every_reader(theme: str, vision: str) -> None:
    """By CIE76; a difference of 2.3 is just noticed, and lines need several times that."""
    seen = [lab(VISION[vision] @ linear(tone)) for tone in THEMES[theme].curves]
    assert min(np.linalg.norm(a - b) for a, b in itertools.combinations(seen, 2)) > 15


@pytest.mark.parametrize("theme", THEMES)
def test_names_in_the_colour_of_a_curve_can_be_read(theme: str) -> None:
    """WCAG 2 asks for a contrast of 3 of large bold text."""
    tones = THEMES[theme]
    for tone in tones.curves:
        dark, light = sorted(float(XYZ[1] @ linear(one)) for one in (tone, tones.page))
        assert (light + 0.05) / (dark + 0.05) >= 3
