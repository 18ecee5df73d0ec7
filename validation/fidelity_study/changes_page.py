"""The page's section on what each choice does: tables, and a picture.

The picture has a row for each change, a panel for each figure.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from statistics import fmean
from typing import NamedTuple

import matplotlib as mpl
from ensembles import ORDER, percent, short
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from pages import Page, table

from fidelity_study.changes import CALIBRATED, Outcome, outcomes
from fidelity_study.members import TITLES, Entry, Kept
from taichi_foam.analysis.measures import Quantity
from taichi_foam.picture import style
from taichi_foam.picture.style import BLUE, GREEN, GREY, INK, VERMILION
from taichi_foam.shim2000.compare import TOLERANCE
from taichi_foam.shim2000.impacts import NAMES
from taichi_foam.shim2000.scores import SHARE

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

WITHIN = f"within {100 * TOLERANCE:.0f} %"


def section(velocities: int, kept: Kept, page: Page) -> list[str]:
    """Errors test by test, and what they come to."""
    found = outcomes(velocities, kept)
    if not found:
        return []
    return [
        "## What each choice does to the nine tests\n",
        f"One change at a time from `calibrated`, medians of {velocities} velocities within 0.5 % "
        "(where strengths scatter, each with a seed of its own). A yield strain of -0.0432 puts "
        "the plateau at the 0.12 MPa that were measured, `shear = face` is Eqs 10 to 13 and 27 as "
        "printed, and a cylinder of 5 cm is section 3.1's.\n",
        f"Figures are durations, displacements and plateaus, 27 in all, and *median error* is "
        f"that of their absolute errors. A criterion of the paper's pictures is met if at least "
        f"{100 * SHARE:.0f} % of the runs meet it; `taichi_foam/shim2000/criteria.py` has each in "
        f"words.\n",
        _summary_table(found),
        page.picture(
            "fidelity-choices",
            "Errors of the nine tests for each change, a panel for each figure",
            partial(draw, found),
        ),
        "A mark for each test's median; below `calibrated`, what moves the medians most comes "
        "first.\n",
        "Errors of duration / largest displacement / plateau / energy per volume, in per cent of "
        "the measured value. A dash: at least half of the runs have no answer.\n",
        _errors_table(found),
    ]


def _summary_table(found: Sequence[Outcome]) -> str:
    header = ["change", f"figures {WITHIN}", "median error, %", f"energies {WITHIN}"]
    header += ["criteria met", "not met"]
    return table(header, [_summary_row(outcome) for outcome in found])


def _summary_row(outcome: Outcome) -> list[str]:
    figures, energy, criteria = outcome.score, outcome.energy, outcome.shares
    middle = figures["median_absolute_error"]
    return [
        outcome.change.label,
        f"{figures['within']} of {figures['of']}",
        "–" if middle is None else f"{100 * middle:.1f}",
        f"{energy['within']} of {energy['of']}",
        f"{len(criteria) - len(outcome.unmet)} of {len(criteria)}" if criteria else "",
        ", ".join(outcome.unmet),
    ]


def _errors_table(found: Sequence[Outcome]) -> str:
    rows = [
        [outcome.change.label, *(_errors(outcome.entries.get(name)) for name in NAMES)]
        for outcome in found
    ]
    return table(["change", *map(short, NAMES)], rows)


def _errors(entry: Entry | None) -> str:
    return " / ".join(percent(entry["error"][q.key]) for q in ORDER) if entry else ""


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
