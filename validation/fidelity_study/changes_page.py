"""The page's section on what each choice does."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

from ensembles import ORDER, percent, short
from pages import Page, table

from fidelity_study.changes import Outcome, outcomes
from fidelity_study.changes_picture import draw
from fidelity_study.members import Entry, Kept
from taichi_foam.shim2000.compare import TOLERANCE
from taichi_foam.shim2000.impacts import NAMES
from taichi_foam.shim2000.scores import SHARE

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
