"""How an ensemble's medians fare against the measurements: counts and errors, all in one place."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from taichi_foam.analysis.quantities import DISPLACEMENT, DURATION, PLATEAU
from taichi_foam.shim2000.bands import ENDS, quantile
from taichi_foam.shim2000.compare import is_miss
from taichi_foam.shim2000.ensemble import WITHIN
from taichi_foam.shim2000.study import Case

if TYPE_CHECKING:
    from taichi_foam.shim2000.criteria import Criterion

SCORED = (DURATION, DISPLACEMENT, PLATEAU)
"""The figures that the headline counts: 27 in the nine tests."""

HELD_OUT = ("paper/rectangular-3.03", "paper/cylinder-2.94", "paper/wedge-2.86")
"""The middle velocity of each impactor: the score that chooses constants leaves these tests out."""

SHARE = 0.8
"""A criterion is met when at least this share of the runs meets it."""


def score(entries: Sequence[Mapping[str, Any]], tolerance: float) -> dict[str, Any]:
    """How many figures `SCORED` of these cases lie within the tolerance, and the median error.

    The median is that of the absolute relative errors; a figure without an answer counts as inf,
    and the median is None when it is that.
    """
    judged = [entry for entry in entries if entry["test"]]
    errors = [entry["error"][quantity.key] for entry in judged for quantity in SCORED]
    misses = sum(is_miss(entry, q.key, tolerance) for entry in judged for q in SCORED)
    median = quantile([None if e is None else abs(e) for e in errors], 0.5) if errors else math.inf
    return {
        "within": len(errors) - misses,
        "of": len(errors),
        "median_absolute_error": median if math.isfinite(median) else None,
    }


def scores(
    cases: Sequence[Case], entries: Sequence[Mapping[str, Any]], runs: int, tolerance: float
) -> dict[str, Any]:
    """The part `ensemble` of summary.json.

    Args:
        cases: the ensembles.
        entries: of summary.json's `cases`, of the same tests.
        runs: how many of each test were asked for.
        tolerance: errors up to this, relatively, are hits.
    """
    held_out = [entry for entry in entries if entry["test"] in HELD_OUT]
    fitted = [entry for entry in entries if entry["test"] and entry not in held_out]
    return {
        "runs": runs,
        "velocities_within": WITHIN,
        "quantiles": list(ENDS),
        "all": score(entries, tolerance),
        "fitted": _group(fitted, tolerance),
        "held_out": _group(held_out, tolerance),
        "criteria": [entry for case in cases for entry in _criteria(case)],
    }


def _group(entries: Sequence[Mapping[str, Any]], tolerance: float) -> dict[str, Any]:
    return {"cases": [entry["name"] for entry in entries], **score(entries, tolerance)}


def _criteria(case: Case) -> list[dict[str, Any]]:
    """For each of a test's criteria, how many of its members meet it."""
    by_key: dict[str, list[Criterion]] = {}
    for member in case.members:
        for criterion in member.criteria:
            by_key.setdefault(criterion.key, []).append(criterion)
    return [_share(case.name, group) for group in by_key.values()]


def _share(name: str, group: Sequence[Criterion]) -> dict[str, Any]:
    """Of one criterion: how many members meet it; the median of the values that there are."""
    first = group[0]
    met = sum(criterion.holds for criterion in group)
    values = [criterion.value for criterion in group if criterion.value is not None]
    return {
        "case": name,
        **{field: getattr(first, field) for field in ("key", "text", "source", "unit", "allowed")},
        "median": quantile(values, 0.5) if values else None,
        "met": met,
        "of": len(group),
        "holds": met / len(group) >= SHARE,
    }
