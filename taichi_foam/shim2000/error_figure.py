"""All figures of an ensemble at a glance: errors of the medians, with their bands."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from taichi_foam.picture.style import BLUE, GREEN, INK, STYLE, VERMILION, beside, blank

if TYPE_CHECKING:
    from matplotlib.axes import Axes

#: Errors beyond this are drawn at the edge, with their number.
EDGE = 0.5
#: The scale reaches at least this far either way.
_LEAST = 0.3


@dataclass(frozen=True)
class Whisker:
    """Relative errors of one figure of one test: of the median, and of the ends of its band.

    inf where the impactor never stopped; `held_out`: the test was left out of the score of choices.
    """

    test: str
    low: float
    median: float
    high: float
    held_out: bool = False


def errors(panels: Mapping[str, Sequence[Whisker]], tolerance: float) -> Figure:
    """Errors of medians as dots and their 5-95 % bands as whiskers, a panel for each figure.

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
                _draw(axis, row, whisker, tolerance, reach)
            axis.set_title(f"({mark}) {name}")
            axis.set_xlabel("error (%)")
            axis.set_xlim(-103 * reach, 103 * reach)
            axis.grid(visible=False, axis="y")
        axes[0].set_yticks(range(len(tests)), [_name(whisker) for whisker in tests])
        axes[0].set_ylabel("test, velocity (m/s)")
        axes[0].set_ylim(len(tests) - 0.4, -0.6)
        figure.legend(
            handles=_key(tolerance), loc="outside upper right", ncols=5, frameon=False, fontsize=12
        )
    return figure


def _reach(whiskers: Sequence[Whisker]) -> float:
    """Half the width of the scale: what there is, in steps of 10 %, but not beyond `EDGE`."""
    ends = [abs(end) for w in whiskers for end in (w.low, w.median, w.high)]
    furthest = max((end for end in ends if end <= EDGE), default=0.0)
    return min(EDGE, max(_LEAST, np.ceil(10 * furthest + 0.2) / 10))


def _name(whisker: Whisker) -> str:
    return f"{whisker.test}, held out" if whisker.held_out else whisker.test


def _draw(axis: Axes, row: int, whisker: Whisker, tolerance: float, reach: float) -> None:
    low, at, high = np.clip([whisker.low, whisker.median, whisker.high], -reach, reach)
    missed = not abs(whisker.median) <= tolerance
    colour, shape = (VERMILION, "D") if missed else (BLUE, "o")
    axis.plot([100 * low, 100 * high], [row, row], color=colour, linewidth=3, alpha=0.55)
    for end, arrow in ((whisker.low, "<"), (whisker.high, ">")):
        if abs(end) > reach:  # the band goes on beyond the scale
            edge = np.copysign(100 * reach, end)
            axis.plot(edge, row, arrow, color=colour, markersize=8, clip_on=False)
    axis.plot(
        100 * at,
        row,
        shape,
        color=colour,
        markersize=9,
        markeredgewidth=2.2,
        markerfacecolor="white" if whisker.held_out else colour,
        clip_on=False,
    )
    if missed:
        _say_error(axis, row, whisker.median, low, high, reach)


def _say_error(axis: Axes, row: int, median: float, low: float, high: float, reach: float) -> None:
    """A miss in figures: at the end of its band further from zero, if there is room."""
    right = median > 0
    if abs(high if right else low) > 0.45 * reach:
        right = not right
    text = f"{100 * median:+.0f} %".replace("-", "−") if np.isfinite(median) else "no stop"
    at, gap, side = (high, 11, "left") if right else (low, -11, "right")
    beside(axis, 100 * at, row, text, VERMILION, (gap, 0), "center", side)


def _key(tolerance: float) -> list[Line2D | Patch]:
    dot = {"linestyle": "", "markersize": 9, "markeredgewidth": 2.2}
    span = f"±{100 * tolerance:.0f} %"
    return [
        Patch(color=GREEN, alpha=0.2, linewidth=0, label=span),
        Line2D([], [], marker="o", color=BLUE, label=f"median within {span}", **dot),
        Line2D([], [], marker="D", color=VERMILION, label="median beyond", **dot),
        Line2D([], [], marker="o", color=INK, markerfacecolor="white", label="held out", **dot),
        Line2D([], [], color=BLUE, linewidth=3, alpha=0.55, label="5–95 % of the runs"),
    ]
