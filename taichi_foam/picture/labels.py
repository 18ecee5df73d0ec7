"""Labels of Matplotlib figures: beside their curves, and clear of one another."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.patheffects import withStroke

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def spread(wanted: Sequence[float], apart: float) -> list[float]:
    """Positions as near as possible to `wanted` (any order), at least `apart` from one another."""
    order = np.argsort(wanted, kind="stable")
    # Clusters [sum of (wanted - offset), count] are merged while they would overlap.
    clusters: list[list[float]] = []
    for k in order:
        clusters.append([float(wanted[k]), 1.0])
        while len(clusters) > 1:
            (a, n), (b, m) = clusters[-2], clusters[-1]
            if b / m - (m - 1) * apart / 2 >= a / n + (n - 1) * apart / 2 + apart:
                break
            clusters[-2:] = [[a + b, n + m]]
    ends: list[float] = []
    for total, count in clusters:
        start = total / count - (count - 1) * apart / 2
        ends.extend(start + apart * k for k in range(int(count)))
    placed = [0.0] * len(wanted)
    for k, end in zip(order, ends, strict=True):
        placed[k] = end
    return placed


def beside(
    axis: Axes,
    x: float,
    y: float,
    text: str,
    colour: str,
    offset: tuple[float, float],
    vertical: str,
    horizontal: str = "left",
) -> None:
    """A label in the colour of its curve, `offset` points from (x, y), on a white halo."""
    axis.annotate(
        text,
        (x, y),
        xytext=offset,
        textcoords="offset points",
        ha=horizontal,
        va=vertical,
        color=colour,
        fontweight="bold",
        path_effects=[withStroke(linewidth=3, foreground="white")],
    )
