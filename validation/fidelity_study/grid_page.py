"""The page's section on the honest split."""

from __future__ import annotations

from collections.abc import Sequence

from ensembles import percent, short
from pages import table

from fidelity_study.grid import (
    FITTED,
    GRID,
    Scored,
    candidates,
    mean_error,
    ranking,
    winner,
)
from fidelity_study.members import JUDGED, TITLES, Entry, Kept
from taichi_foam.shim2000.impacts import NAMES
from taichi_foam.shim2000.scores import HELD_OUT


def section(velocities: int, kept: Kept) -> list[str]:
    """The ranking, and the best candidate's held-out tests once they are there."""
    ranked = ranking(velocities, kept)
    if not ranked:
        return []
    return [
        "## Fitted to six tests, judged by three\n",
        _method(velocities),
        f"{len(ranked)} of {len(candidates())} candidates:\n",
        _ranking_table(ranked),
        *_held_out(ranked[0], velocities, kept),
    ]


def _method(velocities: int) -> str:
    return (
        "Every candidate has what the calibrated set has for all that is not listed; each test "
        f"is run at {velocities} velocities within 0.5 % and judged by its medians. The score is "
        f"the mean absolute error of duration, displacement, plateau and energy per volume in the "
        f"{len(FITTED)} fitted tests and of the initial peak in the flat ones among them; a figure "
        "without an answer counts as 100 %. The middle velocities are held out: they are computed "
        "for the best candidate alone, after all have their scores.\n"
    )


def _ranking_table(ranked: Sequence[Scored]) -> str:
    keys = [key.partition(".")[2].replace("_", " ") for key in GRID]
    header = ["score, %", *keys, *(f"{title}, %" for title in TITLES)]
    rows = [
        [
            f"{100 * each.score:.1f}",
            *map(str, each.candidate.values),
            *(f"{100 * mean_error(each.fitted, [quantity]):.1f}" for quantity in JUDGED),
        ]
        for each in ranked
    ]
    return table(header, rows)


def _held_out(best: Scored, velocities: int, kept: Kept) -> list[str]:
    held_out = best.candidate.entries(HELD_OUT, velocities, kept)
    if best.candidate != winner(velocities, kept) or not held_out:
        return []
    return [
        "### The held-out tests of the best\n",
        f"`{best.candidate.label}`; errors of medians in per cent.\n",
        _split_table(best.fitted, held_out),
    ]


def _split_table(fitted: Sequence[Entry], held_out: Sequence[Entry]) -> str:
    by_name = {each["name"]: each for each in (*fitted, *held_out)}
    rows = []
    for name in NAMES:
        known, errors = by_name[name]["measured"], by_name[name]["error"]
        cells = [percent(errors[q.key]) if known.get(q.key) else "" for q in JUDGED]
        rows.append([short(name), "held out" if name in HELD_OUT else "fitted", *cells])
    for group, entries in (("fitted", fitted), ("held out", held_out)):
        means = [f"{100 * mean_error(entries, [q]):.1f}" for q in JUDGED]
        rows.append(["mean absolute error", group, *means])
    return table(["test", "", *TITLES], rows)
