"""What the report shows of ensembles only: texts, row by row, and the errors to draw."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from taichi_foam.analysis.measures import ENERGY_PER_VOLUME, Quantity
from taichi_foam.shim2000.compare import criteria_met
from taichi_foam.shim2000.error_figure import Whisker
from taichi_foam.shim2000.report_pictures import short
from taichi_foam.shim2000.report_tables import Row, hit
from taichi_foam.shim2000.scores import HELD_OUT, SCORED, SHARE


def headline(content: Mapping[str, Any]) -> list[Row]:
    """The score of ensembles, as cards; none where settings have changed every test."""
    ensemble = content["ensemble"]
    if not ensemble["all"]["of"]:
        return []
    cards = [
        hit("figures: durations, displacements and plateaus", ensemble["all"]),
        {
            "large": _error(ensemble["all"]["median_absolute_error"]),
            "small": "",
            "label": f"median of these {ensemble['all']['of']} absolute errors",
        },
        hit(ENERGY_PER_VOLUME.label, content["within_tolerance"][ENERGY_PER_VOLUME.key]),
    ]
    if content["criteria"]:
        words = f"criteria met by at least {100 * SHARE:.0f} % of the runs"
        cards.append(hit(words, criteria_met(content)))
    return cards


def groups(content: Mapping[str, Any]) -> list[Row]:
    """Fitted and held-out tests beside each other; a group without a test is left out."""
    titles = {"fitted": "fitted", "held_out": "held out"}
    found = {title: content["ensemble"][key] for key, title in titles.items()}
    return [
        {
            "title": title,
            "tests": ", ".join(map(short, group["cases"])),
            "within": f"{group['within']} of {group['of']}",
            "error": _error(group["median_absolute_error"]),
        }
        for title, group in found.items()
        if group["cases"]
    ]


def whiskers(content: Mapping[str, Any]) -> dict[str, Sequence[Whisker]]:
    """Errors of the medians and of the ends of their bands, by figure; {} without a test."""
    tests = [case for case in content["cases"] if case["test"]]
    return {q.label: [_whisker(q, case) for case in tests] for q in SCORED} if tests else {}


def _whisker(quantity: Quantity, case: Mapping[str, Any]) -> Whisker:
    measured = case["measured"][quantity.key]
    found = [case[part][quantity.key] for part in ("low", "simulated", "high")]
    errors = [math.inf if value is None else value / measured - 1.0 for value in found]
    return Whisker(short(case["name"]), *errors, held_out=case["test"] in HELD_OUT)


def _error(value: float | None) -> str:
    return "no answer" if value is None else f"{100 * value:.1f} %"
