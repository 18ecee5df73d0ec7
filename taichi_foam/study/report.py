"""report.html: everything that a study found, in one file that needs nothing else."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from datetime import datetime
from pathlib import Path
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined

from taichi_foam.measures import PLATEAU_END_FRACTION
from taichi_foam.paper import SIMULATED_DURATION, describe
from taichi_foam.picture.figures import LEDGER
from taichi_foam.progress import Bars
from taichi_foam.result import Result
from taichi_foam.scene import Cylinder, Scene
from taichi_foam.study import plates
from taichi_foam.study.compare import (
    COMPARED,
    DURATION,
    ENERGY,
    JUDGED,
    PEAK,
    PEAK_TIME,
    SLOPE,
    TOLERANCE,
    Quantity,
    is_miss,
)

#: Error at the ends of the small error scale.
SCALE = 0.30

Row = dict[str, Any]

_NUMBERS = ("no", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine")
_STAGES = {"computing": "compiling and computing", "films": "drawing and encoding films"}


def write(
    folder: Path, results: Sequence[Result], content: Mapping[str, Any], bars: Bars, begun: float
) -> None:
    """Write figures/ and report.html into `folder`.

    Args:
        results: the finished runs.
        content: of summary.json so far; its cases stand in the order of `results`.
        bars: shows progress, and knows how long the stages before took.
        begun: when the study began, by `time.perf_counter`.
    """
    pictures = folder / "figures"
    pictures.mkdir()
    groups = plates.grouped(results)
    jobs = plates.jobs(pictures, groups)
    with bars.counting("report", "writing the report", len(jobs), "figures") as on_plate:
        drawn = {}
        for name, draw in jobs.items():
            drawn[name] = draw()
            on_plate()
        page = _template().render(
            content=content,
            tests=_tests(len(results)),
            created=datetime.now().astimezone().strftime("%Y-%m-%d %H:%M %Z"),
            judged=[_table(quantity, content["cases"]) for quantity in JUDGED],
            slope=_table(SLOPE, content["cases"]),
            peaks=[_table(quantity, content["cases"]) for quantity in (PEAK, PEAK_TIME)],
            tolerance=f"{100 * TOLERANCE:.0f} %",
            plateau_end=f"{100 * PLATEAU_END_FRACTION:.0f} %",
            hits=[_hit(quantity, content) for quantity in JUDGED],
            misses=sum(is_miss(c, q.key) for c in content["cases"] for q in COMPARED),
            kinds=[_kind(key, group, content["cases"]) for key, group in groups.items()],
            plates=drawn,
            ledger=_ledger(results, content["cases"]),
            choices=_choices(results),
            runs=[_run(result) for result in results],
            batch=results[0].run if results else None,
            seconds={_STAGES.get(stage, stage): took for stage, took in bars.seconds.items()}
            | {"in all, up to this report": time.perf_counter() - begun},
            connections=_connections(results[0].scene) if results else 0,
            short=_short,
        )
        (folder / "report.html").write_text(page, encoding="utf-8")


def _template() -> Any:
    environment = Environment(
        loader=PackageLoader("taichi_foam.study", "."),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template("report.html.j2")


def _tests(count: int) -> str:
    return f"{_NUMBERS[count]} drop test{'' if count == 1 else 's'}"


def _connections(scene: Scene) -> int:
    columns, rows = scene.block.columns, scene.block.rows
    return (columns - 1) * rows + columns * (rows - 1)


def _short(name: str) -> str:
    """ "paper/wedge-2.86" as people read it."""
    kind, _, velocity = name.removeprefix("paper/").partition("-")
    return f"{plates.KINDS[kind].name} {velocity}"


def _table(quantity: Quantity, cases: Sequence[Mapping[str, Any]]) -> Row:
    """One figure in all cases in which it was measured."""
    rows = []
    for case in cases:
        measured, error = case["measured"][quantity.key], case["error"][quantity.key]
        if measured is None:
            continue
        theirs = SIMULATED_DURATION.get(case["name"]) if quantity is DURATION else None
        rows.append(
            {
                "case": _short(case["name"]),
                "measured": quantity.text(measured),
                "theirs": quantity.text(theirs),
                "simulated": quantity.text(case["simulated"][quantity.key]),
                **_error(error),
                "miss": is_miss(case, quantity.key),
            }
        )
    return {
        "label": quantity.label[0].upper() + quantity.label[1:],
        "unit": quantity.unit,
        "rows": rows,
        "has_theirs": quantity is DURATION,
        "is_ratio": quantity is ENERGY,
    }


def _error(error: float | None) -> Row:
    """An error as text, and where it lies on the scale [% of its width]."""
    if error is None:
        return {"error": "no answer", "at": None}
    at = 50 + 50 * max(-1.0, min(1.0, error / SCALE))
    # A true minus sign, as wide as the plus.
    return {"error": f"{100 * error:+.1f} %".replace("-", "−"), "at": at}


def _hit(quantity: Quantity, content: Mapping[str, Any]) -> Row:
    return {"label": quantity.label, **content["within_tolerance"][quantity.key]}


def _kind(key: str, group: Sequence[Result], cases: Sequence[Mapping[str, Any]]) -> Row:
    """What a section about one impactor shows."""
    found = {case["name"]: case["simulated"] for case in cases}
    return {
        "key": key,
        "name": plates.KINDS[key].name,
        "about": describe(plates.shown(key, group).scene.name),
        "rows": [_damage(r.scene.name, found[r.scene.name]) for r in group],
    }


def _damage(name: str, found: Mapping[str, Any]) -> Row:
    """How a block looks at the end of its run, in words for one row of a table."""
    crack, start = found["crack_lowest_height_m"], found["crack_start_height_m"]
    region = "none"
    if found["crushed_width_m"] is not None:
        width, height = 1e2 * found["crushed_width_m"], 1e2 * found["crushed_height_m"]
        region = f"{width:.1f} × {height:.1f} cm"
    return {
        "case": _short(name),
        "pieces": found["pieces"],
        "region": region,
        "crack": "none"
        if crack is None
        else f"at {1e2 * start:.1f} cm, {1e3 * found['crack_start_time_s']:.1f} ms",
        "depth": "–" if crack is None else f"{1e2 * crack:.1f} cm",
        "broken": found["broken_connections"],
        "rebound": "–"
        if found["rebound_velocity_m_s"] is None
        else f"{found['rebound_velocity_m_s']:.2f} m/s",
    }


def _ledger(results: Sequence[Result], cases: Sequence[Mapping[str, Any]]) -> Row:
    """Energies at the end of each run [J], the parts named as in the figures."""
    rows = []
    for result, case in zip(results, cases, strict=True):
        h = result.history
        parts = [sum(float(h[column][-1]) for column in columns) for columns, _, _ in LEDGER]
        rows.append(
            {
                "case": _short(case["name"]),
                "impact": f"{h['impactor_kinetic_J'][0]:.2f}",
                # Adding 0 turns -0.00 into 0.00.
                "parts": [f"{round(part, 2) + 0.0:.2f}".replace("-", "−") for part in parts],
                "residual": _scientific(case["simulated"]["energy_residual"]),
            }
        )
    return {"names": [name for _, name, _ in LEDGER], "rows": rows}


def _choices(results: Sequence[Result]) -> list[Row]:
    """Every choice of model and numerics, with its meaning from the scene's own description."""
    if not results:
        return []
    scene = results[0].scene
    rows = [_choice(scene, "impactor", "friction")]
    rounds = [r.scene for r in results if isinstance(r.scene.impactor, Cylinder)]
    rows += [_choice(cylinder, "impactor", "radius") for cylinder in rounds[:1]]
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
    meaning = type(owner).model_fields[field].description or ""
    return {"key": f"{part}.{field}", "value": text, "meaning": meaning}


def _run(result: Result) -> Row:
    run, block = result.run, result.scene.block
    overlap = run["max_overlap_m"] / min(block.dx, block.dy)
    low, high = 1e6 * run["dt_min_s"], 1e6 * run["dt_max_s"]
    return {
        "case": _short(result.scene.name),
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
