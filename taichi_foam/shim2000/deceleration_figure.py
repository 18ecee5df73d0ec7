"""Decelerations with the measured figures marked on them, like the paper's Figs 21, 23 and 25."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from taichi_foam.picture.style import BLUE, ORANGE, STYLE, VERMILION, beside, blank

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from taichi_foam.shim2000.tests import Measured

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Deceleration:
    """One impact's deceleration with what was measured in it.

    velocity [m/s] and time [s], deceleration [m/s2] arrays (n,), from first contact; measured
    and plateau_start [s] (end of the initial rise) as the measured plateau is drawn from there.
    Of an ensemble, deceleration is the median and `band` its lower and upper bound (n,) [m/s2].
    """

    velocity: float
    time: Array
    deceleration: Array
    measured: Measured | None = None
    plateau_start: float = 3e-3
    band: tuple[Array, Array] | None = None


def decelerations(impacts: Sequence[Deceleration], title: str = "") -> Figure:
    """Computed decelerations with the measured figures marked on them (Figs 21, 23, 25).

    One panel an impact. Of the tests only tabled figures are known, not the curves: the plateau
    is a band of +-5 % about the measured mean, the impact duration a dashed line, and the initial
    peak, where there is one, a ring. An ensemble's band lies behind its median.
    """
    with mpl.rc_context(STYLE):
        figure = blank(4.6 * max(1, len(impacts)), 4.4)
        axes = figure.subplots(1, len(impacts), sharey=True, squeeze=False)[0]
        if title:
            figure.suptitle(title, x=0.01, ha="left", fontweight="bold")
        top = _top(impacts)
        last = max(_latest(impact) for impact in impacts)
        for k, (axis, impact) in enumerate(zip(axes, impacts, strict=True)):
            _draw(axis, impact)
            if impact.measured is not None:
                _mark_measured(axis, impact, impact.measured, top)
            axis.set_title(f"({'abcdefghi'[k]}) {impact.velocity:.2f} m/s")
            axis.set_xlabel("time (ms)")
            axis.set_xlim(0, 1e3 * last * 1.06)
            axis.set_ylim(0, top)
            _mark_what_is_off(axis, impact, top)
        axes[0].set_ylabel("deceleration (m/s²)")
        _explain(figure, axes[0])
    return figure


def _explain(figure: Figure, axis: Axes) -> None:
    """The legend, beside the title, in as many rows as it takes; the figure grows by them."""
    handles, labels = axis.get_legend_handles_labels()
    columns = max(1, int((figure.get_figwidth() - 1.6) / 2.4))
    figure.set_figheight(figure.get_figheight() + 0.3 * math.ceil(len(labels) / columns))
    figure.legend(
        handles, labels, loc="outside upper right", ncols=columns, frameon=False, fontsize=12
    )


def _draw(axis: Axes, impact: Deceleration) -> None:
    time, label = 1e3 * impact.time, "computed"
    if impact.band is not None:
        label = "median"
        axis.fill_between(
            time, *impact.band, color=BLUE, alpha=0.25, linewidth=0, label="5–95 % of the runs"
        )
    axis.plot(time, impact.deceleration, color=BLUE, linewidth=1.8, label=label)


def _top(impacts: Sequence[Deceleration]) -> float:
    """Top of the scale: a blow on the support must not flatten everything that was measured."""
    tallest = max(float(np.nanmax(impact.deceleration)) for impact in impacts)
    measured = [impact.measured for impact in impacts if impact.measured]
    if not measured:
        return 1.25 * tallest or 1.0
    known = max(max(m.initial_peak_m_s2 or 0.0, m.plateau_deceleration_m_s2) for m in measured)
    return 1.25 * min(max(tallest, known), 2.0 * known)


def _mark_what_is_off(axis: Axes, impact: Deceleration, top: float) -> None:
    """Say how high a curve goes that leaves the scale, left of where it does."""
    height = float(np.nanmax(impact.deceleration))
    if height <= top:
        return
    upper = impact.deceleration if impact.band is None else impact.band[1]
    leaves = 1e3 * float(impact.time[np.argmax(upper > top)])
    beside(axis, leaves, 0.62 * top, f"to {height:.0f} m/s²", BLUE, (-6, 0), "center", "right")


def _latest(impact: Deceleration) -> float:
    duration = impact.measured.impact_duration_s if impact.measured else 0.0
    return max(float(impact.time[-1]), duration)


def _mark_measured(axis: Axes, impact: Deceleration, measured: Measured, top: float) -> None:
    duration, level = 1e3 * measured.impact_duration_s, measured.plateau_deceleration_m_s2
    span = [1e3 * impact.plateau_start, 0.85 * duration]
    axis.fill_between(span, 0.95 * level, 1.05 * level, color=ORANGE, alpha=0.35, linewidth=0)
    axis.plot(span, [level, level], color=VERMILION, linewidth=2.4, label="measured plateau ± 5 %")
    # The figure stands towards the end, since the initial peak has its figure near the start,
    # and on that side of the band where less of the curve is in its way.
    at = span[0] + 0.7 * (span[1] - span[0])
    beyond = impact.deceleration[np.abs(1e3 * impact.time - at) < 0.1 * duration] - level
    below = float(np.sum(np.maximum(beyond, 0))) > float(np.sum(np.maximum(-beyond, 0)))
    edge, gap, side = (0.95, -4, "top") if below else (1.05, 4, "bottom")
    beside(axis, at, edge * level, f"{level:.0f} m/s²", VERMILION, (0, gap), side, "center")
    dashes = (0, (5, 3))
    axis.plot(
        [duration, duration],
        [0, 0.88 * top],
        color=VERMILION,
        linewidth=1.6,
        linestyle=dashes,
        label="measured duration",
    )
    beside(axis, duration, 0.89 * top, f"{duration:.0f} ms", VERMILION, (0, 0), "bottom", "center")
    peak, when = measured.initial_peak_m_s2, measured.initial_peak_time_s
    if peak is not None and when is not None:
        ring = {"linestyle": "", "marker": "o", "mfc": "none", "mec": VERMILION, "mew": 2.2}
        axis.plot([1e3 * when], [peak], markersize=9, label="measured initial peak", **ring)
        beside(axis, 1e3 * when, peak, f"{peak:.0f} m/s²", VERMILION, (10, 0), "center")
