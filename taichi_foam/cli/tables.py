"""Tables of figures: of a run, of drops, of a whole study, and those of reports."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.markup import escape
from rich.table import Table
from rich.text import Text

from taichi_foam.analysis import measures as q
from taichi_foam.analysis.measures import Quantity, shown_in
from taichi_foam.catalogue import reference_of, title
from taichi_foam.cli.outcome import columns
from taichi_foam.records.history import FILTER
from taichi_foam.results.files import write_csv
from taichi_foam.results.result import Result
from taichi_foam.scene import Scene
from taichi_foam.shim2000.compare import (
    JUDGED,
    comparison,
    criteria_met,
    is_miss,
    median_and_allowed,
)
from taichi_foam.shim2000.impacts import brief

if TYPE_CHECKING:
    from taichi_foam.picture import document

_OF_DROPS = {
    "drop": "drop",
    q.CREST_G.key: f"peak g\n{FILTER}",
    q.RAW_CREST_G.key: "raw",
    q.STRAIN.key: "strain\n%",
    q.DISPLACEMENT.key: "",
    q.DURATION.key: "",
    q.RESTITUTION.key: "restitution",
    "contact_height_m": "",
    q.REST.key: "rest height\ncm",
    "bottomed_out": "",
    q.BROKEN.key: "broken\nbonds",
    q.RESIDUAL.key: "",
    "interrupted": "",
}
"""Columns of the CSV of a series of drops, keys of summary.json; for those that the terminal shows
as numbers, a header short enough for 80 columns."""


def key_figures(scene: Scene, summary: Mapping[str, Any]) -> Table:
    """The main figures of one run, beside measured values if there are any.

    Below them a sentence says how the impact ended.
    """
    reference = reference_of(scene)
    case = comparison(scene.name, reference, summary)
    known = reference is not None
    table = _table(title(scene), "", ">simulated", *((">measured", ">error") if known else ()))
    table.add_column("unit", style="dim", no_wrap=True)
    for quantity in shown_in("run"):
        value, measured = summary[quantity.key], case["measured"][quantity.key]
        if value is None and measured is None:
            continue
        row: list[str | Text] = [quantity.label, quantity.text(value)]
        if known:
            shown = "" if measured is None else quantity.text(measured)
            row += [shown, _error(case, quantity.key)]
        table.add_row(*row, quantity.unit)
    table.caption, table.caption_justify = summary["statement"], "left"
    return table


def drops(results: Sequence[Result]) -> Table:
    """The figures of drops on one block, one row each; fits 80 columns."""
    shown = {key: head for key, head in _OF_DROPS.items() if head}
    heads = (f">{words}" for words in (*shown.values(), ""))
    table = _table(f"{results[0].scene.name}: drops on one block", *heads)
    for result in results:
        found = result.summary
        said = "interrupted" if found["interrupted"] else ""
        said = "bottomed out" if found["bottomed_out"] else said
        table.add_row(*(q.MEASURES[key].text(found[key]) for key in shown), said)
    table.caption, table.caption_justify = (
        "rest height: height of the impactor's lowest point where it would rest on the final "
        "block", "left"
    )  # fmt: skip
    return table


def write_drops(path: Path, results: Sequence[Result]) -> None:
    """Write a CSV of drops, one row each; undefined measures are empty. Raises OSError."""

    def word(value: Any) -> Any:
        return str(value).lower() if isinstance(value, bool) else value

    found = [result.summary for result in results]
    write_csv(path, {key: [word(each[key]) for each in found] for key in _OF_DROPS})


def study(content: Mapping[str, Any]) -> Table:
    """The judged figures of all cases of a study, each with its error; fits 80 columns.

    For ensembles, the medians, and below them the bands and the measured values.
    """
    tolerance = f"{100 * content['tolerance']:.0f} %"
    ensemble = content["ensemble"]
    what = "simulated" if ensemble is None else f"median of {_runs(content['cases'])}"
    heads = (f">{quantity.name}\n{quantity.unit}" for quantity in JUDGED)
    table = _table(f"{what}, and its error ({content['choices']})", "", *heads)
    table.caption = f"* a miss: more than {tolerance} from the measured figure"
    table.caption_justify = "left"
    for case in content["cases"]:
        cells = [_judged(case, quantity) for quantity in JUDGED]
        changed = "" if case["test"] else ", changed"
        table.add_row(brief(case["name"]) + changed, *cells)
        if ensemble is not None:
            bands = [one.span(case["low"][one.key], case["high"][one.key]) for one in JUDGED]
            measured = [one.text(case["measured"][one.key]) for one in JUDGED]
            table.add_row("  5 to 95 %", *(f"{text} " for text in bands), style="dim")
            if case["test"]:
                table.add_row("  measured", *(f"{text} " for text in measured), style="dim")
    hits = [content["within_tolerance"][quantity.key] for quantity in JUDGED]
    table.add_section()
    table.add_row(f"within {tolerance}", *(f"{hit['within']} of {hit['of']} " for hit in hits))
    return table


def scores(content: Mapping[str, Any]) -> Table:
    """The scores of an ensemble: duration, displacement and plateau together."""
    ensemble, tolerance = content["ensemble"], f"{100 * content['tolerance']:.0f} %"
    heads = ("", f">within {tolerance}", ">median absolute error")
    table = _table("durations, displacements, plateaus", *heads)
    for key, words in (("all", "all tests"), ("fitted", "fitted"), ("held_out", "held out")):
        found = ensemble[key]
        error = found["median_absolute_error"]
        shown = "no answer" if error is None else f"{100 * error:.1f} %"
        if found["of"]:
            table.add_row(words, f"{found['within']} of {found['of']}", shown)
    return table


def criteria(content: Mapping[str, Any]) -> Table | Text:
    """The number of criteria of a study that are met, and those that are not; fits 80 columns."""
    found = criteria_met(content)
    words = f"criteria of the crushed foam: {found['within']} of {found['of']} met"
    missed = [criterion for criterion in content["criteria"] if not criterion["holds"]]
    if not missed:
        return Text(words, style="bold")
    table, many = _table(words), content["ensemble"] is not None
    table.add_column("not met")
    for head in ("median", "allowed", "runs") if many else ("value", "allowed"):
        table.add_column(head, justify="right", no_wrap=True)
    for each in missed:
        name = "" if each["case"] is None else f"{brief(each['case'])}: "
        runs = [f"{each['met']} of {each['of']}"] if many else []
        table.add_row(name + each["text"], *median_and_allowed(each), *runs)
    return table


def reported(found: document.Table, words: str | None = None) -> Table:
    """A table of a report, with a title if there are `words`."""
    table = _table(words)
    for place, head in enumerate(found.head):
        justify = "left" if place == 0 or found.is_text else "right"
        table.add_column(head.replace(" (", "\n("), justify=justify, overflow="fold")
    for row in found.rows:
        table.add_row(*map(escape, row))
    return table


def _runs(cases: Sequence[Mapping[str, Any]]) -> str:
    """Number of finished runs per case: equal for all cases, unless Ctrl-C came."""
    counts = sorted({case["runs"] for case in cases})
    span = " to ".join(str(count) for count in dict.fromkeys((counts[0], counts[-1])))
    return f"{span} run{'' if span == '1' else 's'}"


def _judged(case: Mapping[str, Any], quantity: Quantity) -> Text:
    """A figure and, if it was measured, its error; a miss has an asterisk."""
    error = case["error"][quantity.key]
    if case["measured"][quantity.key] is None:
        return Text(quantity.text(case["simulated"][quantity.key]))
    shown = "no answer" if error is None else f"{100 * error:+4.0f} %"
    miss = is_miss(case, quantity.key)
    shown, style = (shown + "*", "bold") if miss else (shown + " ", "")
    return Text(f"{quantity.text(case['simulated'][quantity.key])} {shown}", style)


def _table(words: str | None, *heads: str) -> Table:
    return columns(*heads, title=words, title_justify="left", title_style="bold")


def _error(case: Mapping[str, Any], key: str) -> Text:
    """An error in per cent; a miss is marked by a word, not only by its style."""
    error = case["error"][key]
    text = f"{100 * error:+.1f} %" if error is not None else "no answer"
    if case["measured"][key] is None:
        return Text("")
    return Text(f"miss {text}", style="bold") if is_miss(case, key) else Text(text)
