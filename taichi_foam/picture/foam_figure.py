"""A foam's compression test, and what is made of it: curve, landmarks, energy efficiency."""

from __future__ import annotations

from typing import TYPE_CHECKING

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke
from matplotlib.ticker import LogLocator, NullLocator
from numpy.typing import NDArray

from taichi_foam.laws.bond.fit import CrushableFit
from taichi_foam.laws.bond.tabulated import TabulatedFoam
from taichi_foam.picture.style import BLUE, GREEN, GREY, INK, STYLE, VERMILION, blank
from taichi_foam.units import si_scale

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Array = NDArray[np.float64]

_BESIDE, _UPPER = 0.04, 0.55
"""How wide in strain a landmark's name is, and above which part of the height it stands."""

_PLATEAUS, _ROOM = 2.0, 1.25
"""The left panel ends at so many plateaus, or so far above the stress where densification begins.
What comes above would flatten it."""

_DECADES = (0.1, 3.0)
"""Ends of the logarithmic panel: such a part of the plateau, so many times the largest stress."""

_APART = 0.12
"""Strains of landmarks that are nearer than this have their names on sides of their own."""


def compression_test(
    strain: Array,
    stress: Array,
    loading: NDArray[np.bool_],
    foam: TabulatedFoam,
    fit: CrushableFit,
    title: str,
) -> Figure:
    """A compression test: stress over strain to the left, energy efficiency to the right.

    Left the plateau, in the middle the whole test on a logarithmic axis: on one axis densification
    flattens the plateau.

    Args:
        strain, stress: points of the test (n,), fractions and Pa, compression positive.
        loading: which of them the curve is made of (n,); the others are unloading and reloading.
        foam: the foam by the curve that was made of them.
        fit: Eq. 26 fitted to that curve.
        title: what foam it is.
    """
    marks = foam.landmarks
    densified = float(foam.curve.stress_at(np.array(-marks.crush_end)))
    top = max(_PLATEAUS * marks.plateau_stress, _ROOM * densified)
    largest = max(float(stress.max()), foam.curve.stress[-1])
    with mpl.rc_context(STYLE):
        figure = blank(16.0, 5.8)
        left, middle, right = figure.subplots(1, 3, width_ratios=(1.6, 1.0, 1.0))
        scale, prefix = si_scale(top)
        left.set_ylim(0, top / scale)
        _stresses(left, strain, stress, loading, foam, fit, scale)
        _names(left, foam, fit, scale)
        left.set_ylabel(f"compressive stress ({prefix}Pa)", labelpad=7)
        scale, prefix = si_scale(largest)
        middle.set_yscale("log")
        middle.set_ylim(_DECADES[0] * marks.plateau_stress / scale, _DECADES[1] * largest / scale)
        middle.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        middle.yaxis.set_major_formatter("{x:g}")
        middle.yaxis.set_minor_locator(NullLocator())
        _stresses(middle, strain, stress, loading, foam, fit, scale)
        middle.set_ylabel(f"the whole test, logarithmic ({prefix}Pa)", labelpad=7)
        _efficiency(right, foam)
        for axis in (left, middle, right):
            axis.set_xlabel("compressive strain (%)")
            axis.set_xlim(0, 103)
        figure.legend(
            *left.get_legend_handles_labels(), loc="outside upper left", ncols=5, frameon=False,
            fontsize=11, handlelength=2.0, columnspacing=1.4,
            title=_cut(title), title_fontproperties={"weight": "bold", "size": 15},
            alignment="left",
        )  # fmt: skip
    return figure


def _stresses(
    axis: Axes,
    strain: Array,
    stress: Array,
    loading: NDArray[np.bool_],
    foam: TabulatedFoam,
    fit: CrushableFit,
    scale: float,
) -> None:
    """The points, the curve with its continuation, the fit, and lines at landmarks."""
    curve, marks, table = foam.curve, foam.landmarks, foam.table[:, 0]
    if not loading.all():
        axis.plot(
            100 * strain[~loading], stress[~loading] / scale, ".", color=GREY, markersize=5, mew=0,
            label=f"unloading and reloading, {np.count_nonzero(~loading):,} points",
        )  # fmt: skip
    axis.plot(
        100 * strain[loading], stress[loading] / scale, "o", color=GREY, markersize=6, alpha=0.5,
        mew=0, label=f"test, {np.count_nonzero(loading):,} points, to {_pressure(stress.max())}",
    )  # fmt: skip
    along = np.linspace(0.0, 1.0, table.size)
    beyond = along >= curve.tested
    tested = np.array([curve.tested, curve.stress[-1]])
    axis.plot(100 * curve.points[0], curve.points[1] / scale, color=BLUE, label="curve used")
    axis.plot(
        100 * np.append(tested[0], along[beyond]),
        np.append(tested[1], table[beyond]) / scale,
        color=BLUE, linestyle=(0, (3, 2)), label="continued beyond the test",
    )  # fmt: skip
    # as far as the law is the test's: beyond it each goes its own way
    fine = np.linspace(0.0, curve.tested, 800)
    axis.plot(
        100 * fine, fit.foam.loading(fine) / scale, color=VERMILION, linewidth=1.5,
        label=f"Eq. 26 fitted, median error {100 * fit.error:.2g} %",
    )  # fmt: skip
    for at in (marks.crush_start, marks.crush_end, marks.limit):
        axis.axvline(-100 * at, color=INK, linewidth=1.0, linestyle=(0, (1, 2)))


def _names(axis: Axes, foam: TabulatedFoam, fit: CrushableFit, scale: float) -> None:
    """What the landmarks are called, and the plateau's stress."""
    marks = foam.landmarks
    start, end, limit = (-100 * s for s in (marks.crush_start, marks.crush_end, marks.limit))
    ends = f"densification, {end:.3g} %" if fit.densifies else f"test ends, {end:.3g} %"
    _landmark(axis, foam, scale, start, f"crush starts, {start:.2g} %", to_the_right=True)
    _landmark(axis, foam, scale, end, ends, to_the_right=end < start + 100 * _APART)
    _landmark(axis, foam, scale, limit, f"locking, {limit:.3g} %", to_the_right=False)
    _plateau(axis, foam, fit, scale)


def _plateau(axis: Axes, foam: TabulatedFoam, fit: CrushableFit, scale: float) -> None:
    """The plateau's stress, over the middle of the plateau; under it where there is no room."""
    plateau = foam.landmarks.plateau_stress
    middle = 0.5 * (-foam.landmarks.crush_start + foam.curve.densification)
    covered = np.linspace(middle - 0.2, min(middle + 0.2, foam.curve.tested), 50)
    lines = np.concatenate([foam.curve.stress_at(covered), fit.foam.loading(covered)]) / scale
    below = lines.max() > 0.88 * axis.get_ylim()[1]
    axis.annotate(
        f"plateau {_pressure(plateau)}",
        (100 * middle, float(lines.min() if below else lines.max())),
        xytext=(0, -9 if below else 7), textcoords="offset points",
        ha="center", va="top" if below else "bottom", color=BLUE, fontweight="bold",
        path_effects=[withStroke(linewidth=3, foreground="white")],
    )  # fmt: skip


def _landmark(
    axis: Axes, foam: TabulatedFoam, scale: float, at: float, text: str, *, to_the_right: bool
) -> None:
    """A landmark's name along its line at a strain [%], where the curve is not."""
    side = np.linspace(0.0, _BESIDE if to_the_right else -_BESIDE, 20) + at / 100
    side = np.clip(side, 0.0, 1.0)
    height = np.interp(side, np.linspace(0.0, 1.0, len(foam.table)), foam.table[:, 0]) / scale
    crossed = height[height < axis.get_ylim()[1]]  # what leaves the panel is not in the way
    low = crossed.size > 0 and crossed.max() > _UPPER * axis.get_ylim()[1]
    axis.annotate(
        text, (at, 0.02 if low else 0.985), xycoords=axis.get_xaxis_transform(),
        xytext=(4 if to_the_right else -4, 0), textcoords="offset points", rotation=90,
        ha="left" if to_the_right else "right", va="bottom" if low else "top", color=INK,
        fontsize=11, path_effects=[withStroke(linewidth=3, foreground="white")],
    )  # fmt: skip


def _pressure(stress: float) -> str:
    scale, prefix = si_scale(stress, digits=3)
    return f"{stress / scale:.3g} {prefix}Pa"


def _efficiency(axis: Axes, foam: TabulatedFoam) -> None:
    """Energy taken over stress, with its maximum: there densification begins."""
    curve = foam.curve
    strain, values = curve.points[0], curve.efficiency
    top = int(np.argmax(values))
    axis.plot(100 * strain, 100 * values, color=GREEN)
    axis.plot(100 * strain[top], 100 * values[top], "o", color=GREEN, markersize=9, mec="white")
    axis.annotate(
        f"largest: {100 * values[top]:.3g} %\nat {100 * strain[top]:.3g} % of strain",
        (100 * strain[top], 100 * values[top]), xytext=(0, 10), textcoords="offset points",
        ha="right" if strain[top] > 0.5 else "center" if strain[top] > 0.25 else "left",
        va="bottom", color=GREEN, fontweight="bold",
    )  # fmt: skip
    axis.set_ylim(0, 122 * values[top])
    axis.set_ylabel("energy efficiency: energy over stress (%)", labelpad=7)


def _cut(title: str, most: int = 100) -> str:
    """A title within the figure's width; signs that Matplotlib would read as formulas stay text."""
    text = title if len(title) <= most else title[: most - 3] + "..."
    return text.replace("$", r"\$")
