"""Comparison of simulated with measured figures: which are compared, and what counts as a miss."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from taichi_foam.analysis import measures as q
from taichi_foam.analysis.bands import Band
from taichi_foam.results.files import write_csv
from taichi_foam.scene.reference import Reference
from taichi_foam.shim2000.impacts import TESTS

TOLERANCE = 0.10
"""A simulated figure further than this from the measured one, relatively, is a miss."""

JUDGED = (q.DISPLACEMENT, q.DURATION, q.PLATEAU, q.ENERGY_PER_VOLUME)
"""The four figures that the paper gives for every test."""

COMPARED = (*JUDGED, q.SLOPE, q.PEAK, q.PEAK_TIME)
"""All figures that the paper gives. Both energies are compared with the slopes of Table 5."""


def at_rest(summary: Mapping[str, Any]) -> dict[str, Any]:
    """A run's summary as the paper measures it: a displacement counts only if it came to rest."""
    if summary.get("came_to_rest") is False:
        return {**summary, q.DISPLACEMENT.key: None}
    return dict(summary)


def comparison(
    name: str, reference: Reference | None, summary: Mapping[str, Any]
) -> dict[str, Any]:
    """One entry of `cases`: name, test, and measured, simulated and error with the same keys.

    error is simulated / measured - 1; measured and error are None if nothing was measured; test,
    the reference's name, is None without a reference.
    """
    measured = {key: reference and reference.figures.get(key) for key in summary}
    judged = at_rest(summary)
    error = {key: relative_error(value, measured[key]) for key, value in judged.items()}
    return {
        "name": name,
        "test": reference and reference.name,
        "measured": measured,
        "simulated": dict(summary),
        "error": error,
    }


def comparison_of_medians(
    name: str, reference: Reference | None, found: Mapping[str, Band], runs: int
) -> dict[str, Any]:
    """The same for an ensemble: simulated and error are those of the medians.

    low and high, with the same keys, are the ends of the bands; None if the band includes runs
    without a value. runs is the number of finished runs.
    """
    medians = {key: _known(one.median) for key, one in found.items()}
    ends = {
        "low": {key: _known(one.low) for key, one in found.items()},
        "high": {key: _known(one.high) for key, one in found.items()},
    }
    return {**comparison(name, reference, medians), **ends, "runs": runs}


def relative_error(simulated: Any, measured: float | None) -> float | None:
    """simulated / measured - 1, or None where either is missing."""
    return None if simulated is None or measured is None else simulated / measured - 1.0


def is_miss(case: Mapping[str, Any], key: str) -> bool:
    """Whether a figure was measured, and the simulated one is beyond TOLERANCE or missing."""
    error = case["error"][key]
    return case["measured"][key] is not None and (error is None or abs(error) > TOLERANCE)


def hits(cases: Sequence[Mapping[str, Any]]) -> dict[str, dict[str, int]]:
    """For each judged figure, the number of tests in which it is not a miss, and of all tests."""
    tests = [case for case in cases if case["test"]]
    return {
        quantity.key: {
            "within": sum(not is_miss(case, quantity.key) for case in tests),
            "of": len(tests),
        }
        for quantity in JUDGED
    }


def criteria_met(content: Mapping[str, Any]) -> dict[str, int]:
    """How many of the criteria in a study's summary.json are met."""
    found = content["criteria"]
    return {"within": sum(criterion["holds"] for criterion in found), "of": len(found)}


def median_and_allowed(found: Mapping[str, Any]) -> tuple[str, str]:
    """The median and the limits of an entry of `criteria`, as readable text."""
    unit = "" if found["unit"] == "-" or found["unit"] in found["allowed"] else f" {found['unit']}"
    median = "–" if found["median"] is None else f"{found['median']:.3g}{unit}"
    return median, found["allowed"] + unit


def theirs(quantity: q.Quantity, case: Mapping[str, Any]) -> float | None:
    """The paper's own simulated value for a figure of an entry of `cases`, if it gives one."""
    known = quantity is q.DURATION and case["test"]
    return TESTS[case["test"]].simulated_duration if known else None


def write_tables(path: Path, cases: Sequence[Mapping[str, Any]]) -> None:
    """Write tables.csv: a row for each case and compared figure that was measured, in SI units.

    For ensembles, simulated is the median, and low and high are the ends of its band.
    """
    ends = [end for end in ("low", "high") if any(end in case for case in cases)]
    head = ("case", "quantity", "measured", "paper_simulation", "simulated", *ends, "error", "miss")
    rows = []
    for case in cases:
        for quantity in COMPARED:
            key = quantity.key
            if case["measured"][key] is None:
                continue
            found = [case[part][key] for part in ("simulated", *ends, "error")]
            values = [case["measured"][key], theirs(quantity, case), *found]
            texts = ["" if value is None else f"{value:.6g}" for value in values]
            rows.append([case["name"], key, *texts, int(is_miss(case, key))])
    write_csv(path, {name: [row[k] for row in rows] for k, name in enumerate(head)})


def _known(value: float) -> float | None:
    return value if math.isfinite(value) else None
