"""report.html: all results of a study, in one self-contained file."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from datetime import datetime
from functools import partial
from pathlib import Path
from typing import Any

from taichi_foam.analysis import measures as q
from taichi_foam.analysis.loads import PLATEAU_END_FRACTION
from taichi_foam.analysis.measures import Quantity
from taichi_foam.parts import described
from taichi_foam.picture.document import template
from taichi_foam.records.history import LEDGER
from taichi_foam.scene import Cylinder, Scene
from taichi_foam.shim2000 import pictures
from taichi_foam.shim2000.compare import (
    COMPARED,
    JUDGED,
    criteria_met,
    is_miss,
    median_and_allowed,
    theirs,
)
from taichi_foam.shim2000.figures import Whisker
from taichi_foam.shim2000.pictures import KINDS, short
from taichi_foam.shim2000.scores import HELD_OUT, SCORED, SHARE
from taichi_foam.shim2000.study import WITHIN, Case
from taichi_foam.simulation.progress import Bars

Row = dict[str, Any]

_NUMBERS = ("no", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine")
_STAGES = {"computing": "compiling and computing", "films": "drawing and encoding films"}


def write(
    folder: Path,
    cases: Sequence[Case],
    content: Mapping[str, Any],
    bars: Bars,
    begun: float,
    with_films: bool = True,
) -> None:
    """Write figures/ and report.html into `folder`.

    Args:
        cases: the computed cases.
        content: content of summary.json so far, with its cases in the same order.
        bars: shows progress, and has the times of the stages before.
        begun: when the study began, by `time.perf_counter`.
        with_films: whether films can be drawn; otherwise the page shows only stills.
    """
    figures = folder / "figures"
    figures.mkdir()
    groups = pictures.grouped(cases)
    jobs = pictures.jobs(figures, groups, with_films)
    panels = _whiskers(content) if content["ensemble"] else {}
    if panels:
        given = (figures, panels, content["tolerance"])
        jobs["errors"] = partial(pictures.errors_at_a_glance, *given)
    i, j = (cases[0].scene.block.columns, cases[0].scene.block.rows) if cases else (0, 0)
    with bars.counting("report", "writing the report", len(jobs), "figures") as on_picture:
        drawn = {}
        for name, draw in jobs.items():
            drawn[name] = draw()
            on_picture()
        page = template("taichi_foam.shim2000", "report.html.j2").render(
            content=content,
            tests=f"{_NUMBERS[len(cases)]} drop test{'' if len(cases) == 1 else 's'}",
            created=datetime.now().astimezone().strftime("%Y-%m-%d %H:%M %Z"),
            judged=[_table(quantity, content) for quantity in JUDGED],
            slope=_table(q.SLOPE, content),
            peaks=[_table(quantity, content) for quantity in (q.PEAK, q.PEAK_TIME)],
            tolerance=f"{100 * content['tolerance']:.0f} %",
            plateau_end=f"{100 * PLATEAU_END_FRACTION:.0f} %",
            hits=_headline_of_ensembles(content) if content["ensemble"] else _headline(content),
            misses=sum(is_miss(case, each.key) for case in content["cases"] for each in COMPARED),
            changed=[short(case.name) for case in cases if case.test is None],
            groups=_groups(content) if content["ensemble"] else [],
            criteria=_criteria(content),
            kinds=[
                {"key": key, "name": KINDS[key].name, "rows": [_damage(case) for case in group]}
                for key, group in groups.items()
            ],
            pictures=drawn,
            ledger=_ledger(cases),
            choices=_choices(cases),
            runs=[_run(case) for case in cases],
            batch=cases[0].result.run if cases else None,
            seconds={_STAGES.get(stage, stage): took for stage, took in bars.seconds.items()}
            | {"in all, up to this report": time.perf_counter() - begun},
            bonds=(2 * i - 1) * j - i,
            short=short,
            within=f"{100 * WITHIN:g} %",
            share=f"{100 * SHARE:.0f} %",
            scatters=any(case.scene.foam.strength_scatter > 0.0 for case in cases),
        )
        (folder / "report.html").write_text(page, encoding="utf-8")


# --- texts of the tables, row by row --------------------------------------------------------------

#: Error at the ends of the small error scale.
_SCALE = 0.30


def _table(quantity: Quantity, content: Mapping[str, Any]) -> Row:
    """One figure, in all cases in which it was measured."""
    entries = [case for case in content["cases"] if case["measured"][quantity.key] is not None]
    return {
        "label": quantity.label[0].upper() + quantity.label[1:],
        "unit": quantity.unit,
        "rows": [_compared(quantity, case) for case in entries],
        "has_theirs": quantity is q.DURATION,
        "has_band": content["ensemble"] is not None,
    }


def _compared(quantity: Quantity, case: Mapping[str, Any]) -> Row:
    """One figure of one case with the measured one; for an ensemble, its median and band."""
    measured, error = case["measured"][quantity.key], case["error"][quantity.key]
    row = {
        "case": short(case["name"]),
        "measured": quantity.text(measured),
        "theirs": quantity.text(theirs(quantity, case)),
        "simulated": quantity.text(case["simulated"][quantity.key]),
        "error": "no answer" if error is None else _percent(error),
        "at": None if error is None else _place(error),
        "miss": is_miss(case, quantity.key),
        "band": None,
    }
    if "low" in case:
        row["band"] = quantity.span(*(case[end][quantity.key] for end in ("low", "high")))
    return row


def _percent(error: float) -> str:
    """An error with its sign: a true minus, as wide as the plus."""
    return f"{100 * error:+.1f} %".replace("-", "−")


def _place(error: float) -> float:
    """Position of an error on the small scale [% of its width]."""
    return 50 + 50 * max(-1.0, min(1.0, error / _SCALE))


def _headline(content: Mapping[str, Any]) -> list[Row]:
    """The score of single runs.

    For each judged figure, the number of tests within the tolerance; and the number of criteria
    that hold.
    """
    found = [(quantity.label, content["within_tolerance"][quantity.key]) for quantity in JUDGED]
    if content["criteria"]:
        found.append(("criteria", criteria_met(content)))
    return [_hit(label, count) for label, count in found if count["of"]]


def _criteria(content: Mapping[str, Any]) -> list[Row]:
    """The paper's statements on the crushed foam: each criterion, and how many runs meet it."""
    shown = [median_and_allowed(found) for found in content["criteria"]]
    return [
        {
            "case": "several" if found["case"] is None else short(found["case"]),
            "text": found["text"],
            "source": found["source"],
            "median": median,
            "allowed": allowed,
            "met": f"{found['met']} of {found['of']}",
            "miss": not found["holds"],
        }
        for found, (median, allowed) in zip(content["criteria"], shown, strict=True)
    ]


def _hit(label: str, found: Mapping[str, Any]) -> Row:
    """A count as a card: large number, small number, words."""
    return {"large": found["within"], "small": f"of {found['of']}", "label": label}


def _damage(case: Case) -> Row:
    """The block at the end of its run, in words for one row of a table."""
    found = case.figures

    def text(quantity: Quantity) -> str:
        return quantity.words(found[quantity.key])

    has_crack, width = found[q.CRACK.key] is not None, found[q.WIDTH.key]
    return {
        "case": short(case.name, case.test is not None),
        "pieces": found["pieces"],
        "room": text(q.NO_ROOM),
        "region": "none" if width is None else f"{q.WIDTH.text(width)} × {text(q.HEIGHT)}",
        "crack": f"at {text(q.CRACK_START)}, {text(q.CRACK_TIME)}" if has_crack else "none",
        "depth": text(q.CRACK),
        "broken": found["broken_bonds"],
        "rebound": text(q.REBOUND),
        "peak": f"{text(q.CREST)} ({text(q.CREST_G)}) at {text(q.CREST_TIME)}",
        "raw_peak": f"{text(q.RAW_CREST)} ({text(q.RAW_CREST_G)})",
        "statement": found["statement"] or "the impactor never touched the foam",
    }


def _ledger(cases: Sequence[Case]) -> Row:
    """Energies at the end of each run [J], with parts named as in the figures."""
    rows = []
    for case in cases:
        h = case.result.history
        parts = [sum(float(h[name][-1]) for name in layer.columns) for layer in LEDGER]
        rows.append(
            {
                "case": short(case.name, case.test is not None),
                "impact": f"{h['impactor_kinetic_J'][0]:.2f}",
                # Adding 0 turns -0.00 into 0.00.
                "parts": [f"{round(part, 2) + 0.0:.2f}".replace("-", "−") for part in parts],
                "residual": _scientific(case.figures["energy_residual"]),
            }
        )
    return {"names": [layer.label for layer in LEDGER], "rows": rows}


_BEYOND_THE_PAPER = (
    "rate", "rate_exponent", "overshoot_strain", "crush_band", "fracture_energy",
    "shear_fracture_energy", "softening", "strength_scatter",
)  # fmt: skip
"""Keys of a scene's foam that go beyond Table 1."""


def _choices(cases: Sequence[Case]) -> list[Row]:
    """Every choice of model and numerics, with its meaning from the scene's descriptions."""
    if not cases:
        return []
    scene = cases[0].scene
    rows = [_choice(scene, "impactor", "friction")]
    rounds = [case.scene for case in cases if isinstance(case.scene.impactor, Cylinder)]
    rows += [_choice(cylinder, "impactor", "radius") for cylinder in rounds[:1]]
    rows += [_choice(scene, "foam", field) for field in _BEYOND_THE_PAPER]
    for part in ("base", "model", "numerics"):
        rows += [_choice(scene, part, field) for field in type(getattr(scene, part)).model_fields]
    return rows


def _choice(scene: Scene, part: str, field: str) -> Row:
    owner = getattr(scene, part)
    value = getattr(owner, field)
    if isinstance(value, bool):
        text = "true" if value else "false"
    else:
        text = f"{value:.4g}" if isinstance(value, float) else str(value)
    meaning = described(type(owner).model_fields[field])
    return {"key": f"{part}.{field}", "value": text, "meaning": meaning}


def _run(case: Case) -> Row:
    """How one case was computed."""
    run = case.result.run
    low, high = 1e6 * run["dt_min_s"], 1e6 * run["dt_max_s"]
    return {
        "case": short(case.name, case.test is not None),
        "steps": f"{run['steps']:,}",
        "dt": f"{low:.3g}" if f"{low:.3g}" == f"{high:.3g}" else f"{low:.3g} to {high:.3g}",
        "overlap": f"{100 * case.figures['max_overlap_cells']:.2f} %",
        "ended_by": run["ended_by"],
    }


def _scientific(value: float | None) -> str:
    if value is None:
        return "–"
    mantissa, _, power = f"{value:.1e}".partition("e")
    superscript = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
    return f"{mantissa} · 10{str(int(power)).translate(superscript)}".replace("-", "−")


# --- for ensembles only ---------------------------------------------------------------------------


def _headline_of_ensembles(content: Mapping[str, Any]) -> list[Row]:
    """The score of ensembles, as cards; none if settings have changed every test."""
    ensemble = content["ensemble"]
    if not ensemble["all"]["of"]:
        return []
    cards = [
        _hit("figures: durations, displacements and plateaus", ensemble["all"]),
        {
            "large": _median_error(ensemble["all"]["median_absolute_error"]),
            "small": "",
            "label": f"median of these {ensemble['all']['of']} absolute errors",
        },
        _hit(q.ENERGY_PER_VOLUME.label, content["within_tolerance"][q.ENERGY_PER_VOLUME.key]),
    ]
    if content["criteria"]:
        words = f"criteria met by at least {100 * SHARE:.0f} % of the runs"
        cards.append(_hit(words, criteria_met(content)))
    return cards


def _groups(content: Mapping[str, Any]) -> list[Row]:
    """Fitted and held-out tests side by side; a group without a test is left out."""
    titles = {"fitted": "fitted", "held_out": "held out"}
    found = {title: content["ensemble"][key] for key, title in titles.items()}
    return [
        {
            "title": title,
            "tests": ", ".join(map(short, group["cases"])),
            "within": f"{group['within']} of {group['of']}",
            "error": _median_error(group["median_absolute_error"]),
        }
        for title, group in found.items()
        if group["cases"]
    ]


def _whiskers(content: Mapping[str, Any]) -> dict[str, Sequence[Whisker]]:
    """Errors of the medians and of the ends of their bands, by figure; {} without a test."""
    tests = [case for case in content["cases"] if case["test"]]
    return {q.label: [_whisker(q, case) for case in tests] for q in SCORED} if tests else {}


def _whisker(quantity: Quantity, case: Mapping[str, Any]) -> Whisker:
    measured = case["measured"][quantity.key]
    found = [case[part][quantity.key] for part in ("low", "simulated", "high")]
    errors = [math.inf if value is None else value / measured - 1.0 for value in found]
    return Whisker(short(case["name"]), *errors, held_out=case["test"] in HELD_OUT)


def _median_error(value: float | None) -> str:
    return "no answer" if value is None else f"{100 * value:.1f} %"
