"""report.html: everything that a study found, in one file that needs nothing else."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from datetime import datetime
from functools import partial
from pathlib import Path
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined

from taichi_foam.analysis.loads import PLATEAU_END_FRACTION
from taichi_foam.analysis.measures import PEAK, PEAK_TIME, SLOPE
from taichi_foam.scene import Scene
from taichi_foam.shim2000 import report_ensembles, report_pictures, report_tables
from taichi_foam.shim2000.compare import COMPARED, JUDGED, is_miss
from taichi_foam.shim2000.ensemble import WITHIN
from taichi_foam.shim2000.report_pictures import short
from taichi_foam.shim2000.scores import SHARE
from taichi_foam.shim2000.study import Case
from taichi_foam.simulation.progress import Bars

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
        cases: what was computed.
        content: of summary.json so far; its cases stand in the same order.
        bars: shows progress, and knows how long the stages before took.
        begun: when the study began, by `time.perf_counter`.
        with_films: whether films can be drawn; without them the page shows the stills alone.
    """
    figures = folder / "figures"
    figures.mkdir()
    groups = report_pictures.grouped(cases)
    left_out = () if with_films else [f"{key}-film" for key in groups]
    jobs = report_pictures.jobs(figures, groups)
    panels = report_ensembles.whiskers(content) if content["ensemble"] else {}
    if panels:
        draw_errors = report_pictures.errors_at_a_glance
        jobs["errors"] = partial(draw_errors, figures, panels, content["tolerance"])
    with bars.counting("report", "writing the report", len(jobs), "figures") as on_picture:
        drawn = {}
        for name, draw in jobs.items():
            if name not in left_out:
                drawn[name] = draw()
            on_picture()
        page = _template().render(
            content=content,
            tests=_tests(len(cases)),
            created=datetime.now().astimezone().strftime("%Y-%m-%d %H:%M %Z"),
            judged=[report_tables.table(quantity, content) for quantity in JUDGED],
            slope=report_tables.table(SLOPE, content),
            peaks=[report_tables.table(quantity, content) for quantity in (PEAK, PEAK_TIME)],
            tolerance=f"{100 * content['tolerance']:.0f} %",
            plateau_end=f"{100 * PLATEAU_END_FRACTION:.0f} %",
            hits=(report_ensembles if content["ensemble"] else report_tables).headline(content),
            misses=_misses(content),
            changed=[short(case.name) for case in cases if case.test is None],
            groups=report_ensembles.groups(content) if content["ensemble"] else [],
            criteria=report_tables.criteria(content),
            kinds=[report_tables.kind(key, group) for key, group in groups.items()],
            pictures=drawn,
            ledger=report_tables.ledger(cases),
            choices=report_tables.choices(cases),
            runs=[report_tables.run(case) for case in cases],
            batch=cases[0].result.run if cases else None,
            seconds={_STAGES.get(stage, stage): took for stage, took in bars.seconds.items()}
            | {"in all, up to this report": time.perf_counter() - begun},
            bonds=_bonds(cases[0].scene) if cases else 0,
            short=short,
            within=f"{100 * WITHIN:g} %",
            share=f"{100 * SHARE:.0f} %",
            scatters=any(case.scene.foam.strength_scatter > 0.0 for case in cases),
        )
        (folder / "report.html").write_text(page, encoding="utf-8")


def _misses(content: Mapping[str, Any]) -> int:
    return sum(is_miss(case, q.key) for case in content["cases"] for q in COMPARED)


def _template() -> Any:
    environment = Environment(
        loader=PackageLoader("taichi_foam.shim2000", "."),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template("report.html.j2")


def _tests(count: int) -> str:
    return f"{_NUMBERS[count]} drop test{'' if count == 1 else 's'}"


def _bonds(scene: Scene) -> int:
    columns, rows = scene.block.columns, scene.block.rows
    return (columns - 1) * rows + columns * (rows - 1)
