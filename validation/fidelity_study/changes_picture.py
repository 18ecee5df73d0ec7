"""What each choice does, as a picture: a row for each change, a panel for each figure."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from statistics import fmean
from typing import NamedTuple

import matplotlib as mpl
from ensembles import ORDER
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from fidelity_study.changes import CALIBRATED, Outcome
from fidelity_study.members import TITLES
from taichi_foam.analysis.measures import Quantity
from taichi_foam.picture import style
from taichi_foam.picture.style import BLUE, GREEN, GREY, INK, VERMILION
from taichi_foam.shim2000.compare import TOLERANCE

REACH = 0.4
"""Errors beyond this are arrows at the edge."""


class Mark(NamedTuple):
    """How an impactor's tests are drawn; `offset` in rows keeps the impactors apart."""

    label: str
    shape: str
    colour: str
    offset: float


MARKS = {
    "rectangular": Mark("flat", "s", BLUE, -0.24),
    "cylinder": Mark("cylinder", "o", VERMILION, 0.0),
    "wedge": Mark("wedge", "^", GREEN, 0.24),
}


def draw(found: Sequence[Outcome], path: Path) -> None:
    """Save the picture as PNG and SVG: calibrated on top, then what moves the figures most."""
    rows = _sorted(found)
    with mpl.rc_context(style.STYLE):
        figure = style.blank(14.0, 0.32 * len(rows) + 1.7)
        axes = figure.subplots(1, len(ORDER), sharex=True, sharey=True)
        for axis, mark, quantity, title in zip(axes, "abcd", ORDER, TITLES, strict=False):
            _panel(axis, rows, quantity)
            axis.set_title(f"({mark}) {title}")
            axis.set_xlabel("error (%)")
        axes[0].set_yticks(range(len(rows)), [row.change.label for row in rows])
        axes[0].set_ylim(len(rows) - 0.5, -0.5)
        figure.legend(handles=_key(), loc="outside upper center", ncols=6, frameon=False)
        path.parent.mkdir(parents=True, exist_ok=True)
        style.save(figure, path, svg=True)


def _sorted(found: Sequence[Outcome]) -> list[Outcome]:
    calibrated = [outcome for outcome in found if outcome.change == CALIBRATED]
    others = [outcome for outcome in found if outcome.change != CALIBRATED]
    if calibrated:
        others.sort(key=lambda outcome: _moved(outcome, calibrated[0]), reverse=True)
    return [*calibrated, *others]


def _moved(outcome: Outcome, calibrated: Outcome) -> float:
    """Mean distance of the medians from the calibrated ones, as drawn."""
    distances = [
        abs(_place(entry["error"][q.key]) - _place(calibrated.entries[test]["error"][q.key]))
        for test, entry in outcome.entries.items()
        if test in calibrated.entries
        for q in ORDER
    ]
    return fmean(distances) if distances else 0.0


def _place(error: float | None) -> float:
    """Where an error is drawn: within the panel, and on the right where there is no answer."""
    return REACH if error is None else min(max(error, -REACH), REACH)


def _panel(axis: Axes, rows: Sequence[Outcome], quantity: Quantity) -> None:
    tolerance = 100 * TOLERANCE
    axis.axvspan(-tolerance, tolerance, color=GREY, alpha=0.22, linewidth=0)
    axis.axvline(0.0, color=INK, linewidth=1.0)
    for place, outcome in enumerate(rows):
        axis.axhline(place + 0.5, color=INK if place == 0 else "#D5D5D0", linewidth=0.8)
        for test, entry in outcome.entries.items():
            _mark(axis, place, test, entry["error"][quantity.key])
    axis.set_xlim(-104 * REACH, 104 * REACH)
    axis.set_xticks(range(-40, 41, 20))
    axis.grid(visible=False, axis="y")
    axis.tick_params(axis="y", length=0)


def _mark(axis: Axes, row: int, test: str, error: float | None) -> None:
    _, shape, colour, offset = MARKS[test.removeprefix("paper/").partition("-")[0]]
    if error is None:
        shape = "x"
    elif abs(error) > REACH:
        shape = ">" if error > 0 else "<"
    axis.plot(
        100 * _place(error),
        row + offset,
        shape,
        color=colour,
        markersize=6.5 if shape in "sox" else 8,  # triangles fill half their square
        markeredgecolor=colour if shape == "x" else "white",
        markeredgewidth=1.5 if shape == "x" else 0.5,
        clip_on=False,
    )


def _key() -> list[Line2D | Patch]:
    dot = {"linestyle": "", "markersize": 9}
    tests = [
        Line2D([], [], marker=mark.shape, color=mark.colour, label=mark.label, **dot)
        for mark in MARKS.values()
    ]
    return [
        *tests,
        Line2D([], [], marker=">", color=INK, label=f"beyond {100 * REACH:.0f} %", **dot),
        Line2D([], [], marker="x", color=INK, markeredgewidth=2, label="no answer", **dot),
        Patch(color=GREY, alpha=0.3, linewidth=0, label=f"±{100 * TOLERANCE:.0f} %"),
    ]
