"""What the report's tables show: texts, row by row."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from taichi_foam.analysis import measures as q
from taichi_foam.analysis.measures import DURATION, Quantity
from taichi_foam.parts import described
from taichi_foam.records.history import LEDGER
from taichi_foam.scene import Cylinder, Scene
from taichi_foam.shim2000.compare import JUDGED, criteria_met, is_miss, median_and_allowed, theirs
from taichi_foam.shim2000.report_pictures import KINDS, short
from taichi_foam.shim2000.study import Case

#: Error at the ends of the small error scale.
SCALE = 0.30

Row = dict[str, Any]


def table(quantity: Quantity, content: Mapping[str, Any]) -> Row:
    """One figure in all cases in which it was measured."""
    entries = [case for case in content["cases"] if case["measured"][quantity.key] is not None]
    return {
        "label": quantity.label[0].upper() + quantity.label[1:],
        "unit": quantity.unit,
        "rows": [_compared(quantity, case) for case in entries],
        "has_theirs": quantity is DURATION,
        "has_band": content["ensemble"] is not None,
    }


def _compared(quantity: Quantity, case: Mapping[str, Any]) -> Row:
    """One figure of one case beside the measured one; of an ensemble its median and band."""
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
    """Where an error lies on the small scale [% of its width]."""
    return 50 + 50 * max(-1.0, min(1.0, error / SCALE))


def headline(content: Mapping[str, Any]) -> list[Row]:
    """The score of single runs: in how many tests each judged figure lies within the tolerance.

    And how many criteria hold.
    """
    found = [(quantity.label, content["within_tolerance"][quantity.key]) for quantity in JUDGED]
    if content["criteria"]:
        found.append(("criteria", criteria_met(content)))
    return [hit(label, count) for label, count in found if count["of"]]


def criteria(content: Mapping[str, Any]) -> list[Row]:
    """What the paper says of the crushed foam: each criterion, and how many runs meet it."""
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


def hit(label: str, found: Mapping[str, Any]) -> Row:
    """A count as a card: large number, small number, words."""
    return {"large": found["within"], "small": f"of {found['of']}", "label": label}


def kind(key: str, group: Sequence[Case]) -> Row:
    """What a section about one impactor shows."""
    return {
        "key": key,
        "name": KINDS[key].name,
        "rows": [_damage(case) for case in group],
    }


def _damage(case: Case) -> Row:
    """How a block looks at the end of its run, in words for one row of a table."""
    found = case.figures

    def text(quantity: Quantity) -> str:
        value = found[quantity.key]
        return quantity.text(value) + (f" {quantity.unit}" if value is not None else "")

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


def ledger(cases: Sequence[Case]) -> Row:
    """Energies at the end of each run [J], the parts named as in the figures."""
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


BEYOND_THE_PAPER = (
    "rate", "rate_exponent", "crush_band", "fracture_energy",
    "shear_fracture_energy", "softening", "strength_scatter",
)  # fmt: skip
"""What the foam of a scene may do besides Table 1."""


def choices(cases: Sequence[Case]) -> list[Row]:
    """Every choice of model and numerics, with its meaning from the scene's own description."""
    if not cases:
        return []
    scene = cases[0].scene
    rows = [_choice(scene, "impactor", "friction")]
    rounds = [case.scene for case in cases if isinstance(case.scene.impactor, Cylinder)]
    rows += [_choice(cylinder, "impactor", "radius") for cylinder in rounds[:1]]
    rows += [_choice(scene, "foam", field) for field in BEYOND_THE_PAPER]
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


def run(case: Case) -> Row:
    """How one case was computed."""
    run, block = case.result.run, case.scene.block
    overlap = run["max_overlap_m"] / min(block.dx, block.dy)
    low, high = 1e6 * run["dt_min_s"], 1e6 * run["dt_max_s"]
    return {
        "case": short(case.name, case.test is not None),
        "steps": f"{run['steps']:,}",
        "dt": f"{low:.3g}" if f"{low:.3g}" == f"{high:.3g}" else f"{low:.3g} to {high:.3g}",
        "overlap": f"{100 * overlap:.2f} %",
        "ended_by": run["ended_by"],
    }


def _scientific(value: float | None) -> str:
    if value is None:
        return "–"
    mantissa, _, power = f"{value:.1e}".partition("e")
    superscript = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
    return f"{mantissa} · 10{str(int(power)).translate(superscript)}".replace("-", "−")
