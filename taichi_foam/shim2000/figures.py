"""Figures of a study: decelerations with measured figures, errors at a glance, the foam's law."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import NDArray

from taichi_foam.analysis import measures as q
from taichi_foam.analysis.loads import FLAT_RISE_S, PLATEAU_END_FRACTION
from taichi_foam.engine.stresses import normal_stresses
from taichi_foam.picture.style import BLUE, GREEN, INK, ORANGE, STYLE, VERMILION, beside, blank
from taichi_foam.scene import Scene

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Array = NDArray[np.float64]
Branch = tuple[Array, Array]

# --- decelerations with the measured figures marked on them ---------------------------------------


@dataclass(frozen=True)
class Deceleration:
    """One impact's deceleration, with the figures measured in it.

    velocity [m/s]; arrays (n,) of time from first contact [s] and deceleration [m/s2]; measured
    figures, and plateau_start [s], the end of the initial rise, from which the measured plateau is
    drawn. For an ensemble, deceleration is the median and `band` its bounds, each (n,) [m/s2].
    """

    velocity: float
    time: Array
    deceleration: Array
    measured: Mapping[str, float] | None = None
    plateau_start: float = FLAT_RISE_S
    band: tuple[Array, Array] | None = None


def decelerations(impacts: Sequence[Deceleration], title: str = "") -> Figure:
    """Computed decelerations with the measured figures marked on them (Figs 21, 23, 25).

    One panel per impact. Only tabulated figures of the tests are known, not their curves: the
    plateau is a band of +-5 % about the measured mean, the impact duration a dashed line, and the
    initial peak, if there is one, a ring. An ensemble's band is drawn behind its median.
    """
    with mpl.rc_context(STYLE):
        figure = blank(4.6 * max(1, len(impacts)), 4.4)
        axes = figure.subplots(1, len(impacts), sharey=True, squeeze=False)[0]
        if title:
            figure.suptitle(title, x=0.01, ha="left", fontweight="bold")
        top = _top(impacts)
        last = max(_latest(impact) for impact in impacts)
        for k, (axis, impact) in enumerate(zip(axes, impacts, strict=True)):
            _draw_impact(axis, impact)
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
    """Draw the legend beside the title, in as many rows as needed; the figure grows by them."""
    handles, labels = axis.get_legend_handles_labels()
    columns = max(1, int((figure.get_figwidth() - 1.6) / 2.4))
    figure.set_figheight(figure.get_figheight() + 0.3 * math.ceil(len(labels) / columns))
    figure.legend(
        handles, labels, loc="outside upper right", ncols=columns, frameon=False, fontsize=12
    )


def _draw_impact(axis: Axes, impact: Deceleration) -> None:
    time, label = 1e3 * impact.time, "computed"
    if impact.band is not None:
        label = "median"
        axis.fill_between(
            time, *impact.band, color=BLUE, alpha=0.25, linewidth=0, label="5–95 % of the runs"
        )
    axis.plot(time, impact.deceleration, color=BLUE, linewidth=1.8, label=label)


def _top(impacts: Sequence[Deceleration]) -> float:
    """Top of the scale: a peak from hitting the support must not compress the measured range."""
    tallest = max(float(np.nanmax(impact.deceleration)) for impact in impacts)
    measured = [impact.measured for impact in impacts if impact.measured]
    if not measured:
        return 1.25 * tallest or 1.0
    known = max(max(m.get(q.PEAK.key, 0.0), m[q.PLATEAU.key]) for m in measured)
    return 1.25 * min(max(tallest, known), 2.0 * known)


def _mark_what_is_off(axis: Axes, impact: Deceleration, top: float) -> None:
    """Write the peak of a curve that leaves the scale, to the left of the place where it leaves."""
    height = float(np.nanmax(impact.deceleration))
    if height <= top:
        return
    upper = impact.deceleration if impact.band is None else impact.band[1]
    leaves = 1e3 * float(impact.time[np.argmax(upper > top)])
    beside(axis, leaves, 0.62 * top, f"to {height:.0f} m/s²", BLUE, (-6, 0), "center", "right")


def _latest(impact: Deceleration) -> float:
    duration = impact.measured[q.DURATION.key] if impact.measured else 0.0
    return max(float(impact.time[-1]), duration)


def _mark_measured(
    axis: Axes, impact: Deceleration, measured: Mapping[str, float], top: float
) -> None:
    duration, level = 1e3 * measured[q.DURATION.key], measured[q.PLATEAU.key]
    span = [1e3 * impact.plateau_start, PLATEAU_END_FRACTION * duration]
    axis.fill_between(span, 0.95 * level, 1.05 * level, color=ORANGE, alpha=0.35, linewidth=0)
    axis.plot(span, [level, level], color=VERMILION, linewidth=2.4, label="measured plateau ± 5 %")
    # The number is near the end, since that of the initial peak is near the start, and on the side
    # of the band where less of the curve is in the way.
    at = span[0] + 0.7 * (span[1] - span[0])
    beyond = impact.deceleration[np.abs(1e3 * impact.time - at) < 0.1 * duration] - level
    below = float(np.sum(np.maximum(beyond, 0))) > float(np.sum(np.maximum(-beyond, 0)))
    edge, gap, side = (0.95, -4, "top") if below else (1.05, 4, "bottom")
    beside(axis, at, edge * level, f"{level:.0f} m/s²", VERMILION, (0, gap), side, "center")
    axis.plot(
        [duration, duration], [0, 0.88 * top], color=VERMILION, linewidth=1.6,
        linestyle=(0, (5, 3)), label="measured duration",
    )  # fmt: skip
    beside(axis, duration, 0.89 * top, f"{duration:.0f} ms", VERMILION, (0, 0), "bottom", "center")
    peak, when = measured.get(q.PEAK.key), measured.get(q.PEAK_TIME.key)
    if peak is not None and when is not None:
        ring = {"linestyle": "", "marker": "o", "mfc": "none", "mec": VERMILION, "mew": 2.2}
        axis.plot([1e3 * when], [peak], markersize=9, label="measured initial peak", **ring)
        beside(axis, 1e3 * when, peak, f"{peak:.0f} m/s²", VERMILION, (10, 0), "center")


# --- errors of an ensemble's medians, with their bands -------------------------------------------

#: Larger errors are drawn at the edge, with their number.
_EDGE = 0.5
#: The scale reaches at least this far either way.
_LEAST = 0.3


@dataclass(frozen=True)
class Whisker:
    """Relative errors of one figure of one test: of the median, and of the ends of its band.

    inf if the impactor never stopped; `held_out`: see `scores.HELD_OUT`.
    """

    test: str
    low: float
    median: float
    high: float
    held_out: bool = False


def errors(panels: Mapping[str, Sequence[Whisker]], tolerance: float) -> Figure:
    """Errors of medians as dots and their 5-95 % bands as whiskers, one panel per figure.

    Args:
        panels: by the figure's name, its tests; the same tests in each, drawn from top to bottom.
        tolerance: errors up to this, relatively, are hits; the shaded band shows it.
    """
    tests = next(iter(panels.values()))
    with mpl.rc_context(STYLE):
        figure = blank(3.9 * len(panels) + 2.2, 0.42 * len(tests) + 1.9)
        axes = figure.subplots(1, len(panels), sharex=True, sharey=True, squeeze=False)[0]
        reach = _reach([whisker for group in panels.values() for whisker in group])
        for axis, mark, (name, group) in zip(axes, "abcdefghi", panels.items(), strict=False):
            axis.axvspan(-100 * tolerance, 100 * tolerance, color=GREEN, alpha=0.14, linewidth=0)
            axis.axvline(0.0, color=INK, linewidth=1.0)
            for row, whisker in enumerate(group):
                _draw_whisker(axis, row, whisker, tolerance, reach)
            axis.set_title(f"({mark}) {name}")
            axis.set_xlabel("error (%)")
            axis.set_xlim(-103 * reach, 103 * reach)
            axis.grid(visible=False, axis="y")
        names = [f"{each.test}, held out" if each.held_out else each.test for each in tests]
        axes[0].set_yticks(range(len(tests)), names)
        axes[0].set_ylabel("test, velocity (m/s)")
        axes[0].set_ylim(len(tests) - 0.4, -0.6)
        figure.legend(
            handles=_explained(tolerance), loc="outside upper right", ncols=5, frameon=False,
            fontsize=12,
        )  # fmt: skip
    return figure


def _reach(whiskers: Sequence[Whisker]) -> float:
    """Half the width of the scale: the largest error in steps of 10 %, at most `_EDGE`."""
    ends = [abs(end) for w in whiskers for end in (w.low, w.median, w.high)]
    furthest = max((end for end in ends if end <= _EDGE), default=0.0)
    return min(_EDGE, max(_LEAST, np.ceil(10 * furthest + 0.2) / 10))


def _draw_whisker(axis: Axes, row: int, whisker: Whisker, tolerance: float, reach: float) -> None:
    low, at, high = np.clip([whisker.low, whisker.median, whisker.high], -reach, reach)
    missed = not abs(whisker.median) <= tolerance
    colour, shape = (VERMILION, "D") if missed else (BLUE, "o")
    axis.plot([100 * low, 100 * high], [row, row], color=colour, linewidth=3, alpha=0.55)
    for end, arrow in ((whisker.low, "<"), (whisker.high, ">")):
        if abs(end) > reach:  # the band extends beyond the scale
            edge = np.copysign(100 * reach, end)
            axis.plot(edge, row, arrow, color=colour, markersize=8, clip_on=False)
    axis.plot(
        100 * at, row, shape, color=colour, markersize=9, markeredgewidth=2.2,
        markerfacecolor="white" if whisker.held_out else colour, clip_on=False,
    )  # fmt: skip
    if missed:
        _say_error(axis, row, whisker.median, low, high, reach)


def _say_error(axis: Axes, row: int, median: float, low: float, high: float, reach: float) -> None:
    """Write a miss as a number, at the end of its band further from zero if there is room."""
    right = median > 0
    if abs(high if right else low) > 0.45 * reach:
        right = not right
    text = f"{100 * median:+.0f} %".replace("-", "−") if np.isfinite(median) else "no stop"
    at, gap, side = (high, 11, "left") if right else (low, -11, "right")
    beside(axis, 100 * at, row, text, VERMILION, (gap, 0), "center", side)


def _explained(tolerance: float) -> list[Line2D | Patch]:
    dot = {"linestyle": "", "markersize": 9, "markeredgewidth": 2.2}
    span = f"±{100 * tolerance:.0f} %"
    return [
        Patch(color=GREEN, alpha=0.2, linewidth=0, label=span),
        Line2D([], [], marker="o", color=BLUE, label=f"median within {span}", **dot),
        Line2D([], [], marker="D", color=VERMILION, label="median beyond", **dot),
        Line2D([], [], marker="o", color=INK, markerfacecolor="white", label="held out", **dot),
        Line2D([], [], color=BLUE, linewidth=3, alpha=0.55, label="5–95 % of the runs"),
    ]


# --- the foam's law, from the functions that the engine calls (Fig. 19) --------------------------

#: Compressive strain from which the unloading branch starts.
TURN = -0.40
#: Stress at which the loading curve leaves the figure, as a multiple of the plateau's.
TOP = 4.0


def branches(scene: Scene) -> dict[str, Branch]:
    """Loading, unloading from `TURN`, and re-tension to fracture of the scene's foam.

    By name, arrays (n,) of engineering strain and stress [Pa], tension positive. Loading begins at
    fracture in tension and ends where the stress is `TOP` times the plateau's.
    """
    marks = scene.foam.landmarks
    corners = (marks.tensile, marks.crush_start, marks.crush_end)
    # Cosine spacing towards locking, where the curve turns upwards.
    steep = np.cos(np.linspace(0.0, np.pi / 2, 400))
    locking = marks.limit + (marks.crush_end - marks.limit) * steep
    down = np.concatenate([np.linspace(a, b, 60) for a, b in itertools.pairwise(corners)])
    strain = np.concatenate([down, locking[1:]])
    loading = normal_stresses(scene, strain, np.minimum(strain, 0.0))
    shown = -loading <= TOP * marks.plateau_stress

    turn = max(TURN, marks.crush_end)
    unloaded = float(scene.foam.permanent_strain(np.array(turn)))
    back = np.linspace(turn, unloaded, 40)
    again = np.linspace(unloaded, marks.crushed_tensile, 40)
    return {
        "first loading": (strain[shown], loading[shown]),
        f"unloading from {-100 * turn:.0f} %": (back, normal_stresses(scene, back, turn)),
        "tension after crushing": (again, normal_stresses(scene, again, turn)),
    }
