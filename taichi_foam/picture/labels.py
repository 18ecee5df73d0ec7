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
    from scipy.optimize import isotonic_regression

    order = np.argsort(wanted, kind="stable")
    steps = apart * np.arange(len(order))
    placed = np.empty(len(order))
    placed[order] = isotonic_regression(np.asarray(wanted)[order] - steps).x + steps
    return placed.tolist()


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
