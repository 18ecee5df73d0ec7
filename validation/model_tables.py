"""The tables of README.md, docs/fidelity.md and docs/model.md, from a study's folder.

taichi-foam reproduce --ensemble 16 --out ensemble
taichi-foam reproduce --choices paper-literal --no-films --out literal
python validation/model_tables.py ensemble literal
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated, Any

import typer
from ensembles import COARSE, ORDER, percent, short
from pages import table
from store import Smoke

from taichi_foam.analysis.measures import (
    DISPLACEMENT,
    DURATION,
    ENERGY_PER_VOLUME,
    PLATEAU,
    Quantity,
)
from taichi_foam.shim2000.compare import TOLERANCE, is_miss
from taichi_foam.shim2000.reproduce import reproduce

# Of a figure in the README's table: title, decimals as computed, and as measured.
README_ORDER = (
    (DISPLACEMENT, "displacement, cm", 2, 1),
    (DURATION, "duration, ms", 1, 0),
    (PLATEAU, "plateau, m/s²", 0, 0),
    (ENERGY_PER_VOLUME, "energy/volume, 10⁵ J/m³", 2, 2),
)

Entry = Mapping[str, Any]


def readme(entries: Sequence[Entry]) -> str:
    """Medians with the measured figures in brackets, misses in bold."""
    rows = []
    for entry in entries:
        cells = [short(entry["name"])]
        for quantity, _, digits, known in README_ORDER:
            value, measured = entry["simulated"][quantity.key], entry["measured"][quantity.key]
            shown = "–" if value is None else f"{quantity.factor * value:.{digits}f}"
            text = f"{shown} ({quantity.factor * measured:.{known}f})"
            cells.append(f"**{text}**" if is_miss(entry, quantity.key) else text)
        rows.append(cells)
    within = [
        sum(not is_miss(entry, quantity.key) for entry in entries) for quantity, *_ in README_ORDER
    ]
    rows.append([f"within {100 * TOLERANCE:.0f} %", *(f"{n} of {len(entries)}" for n in within)])
    return table(["test", *(title for _, title, *_ in README_ORDER)], rows)


def errors(entries: Sequence[Entry], held_out: Sequence[str]) -> str:
    """Error of each median with its band; tests that were held out are marked."""
    rows = []
    for entry in entries:
        mark = " *" if entry["name"] in held_out else ""
        rows.append([short(entry["name"]) + mark, *(_band(entry, q) for q in ORDER)])
    return table(["test", "duration", "displacement", "plateau", "energy/volume"], rows)


def _band(entry: Entry, quantity: Quantity) -> str:
    """As in "+3 (-2 to +7)", in per cent of the measured figure; a dash is no answer."""
    measured = entry["measured"][quantity.key]
    values = [entry[part][quantity.key] for part in ("simulated", "low", "high")]
    middle, low, high = (percent(None if v is None else v / measured - 1) for v in values)
    return f"{middle} ({low} to {high})"


def peaks(entries: Sequence[Entry]) -> str:
    """The flat impactor's initial peak and when it comes."""
    rows = []
    for entry in entries:
        measured, found, error = entry["measured"], entry["simulated"], entry["error"]
        if measured["initial_peak_m_s2"] is None:
            continue
        if found["initial_peak_m_s2"] is None:
            rows.append([short(entry["name"]), "–", "–"])
            continue
        height = f"{found['initial_peak_m_s2']:.0f} ({measured['initial_peak_m_s2']:.0f})"
        time, known = found["initial_peak_time_s"], measured["initial_peak_time_s"]
        rows.append(
            [
                short(entry["name"]),
                f"{height}, {100 * error['initial_peak_m_s2']:+.0f} %",
                f"{1e3 * time:.1f} ({1e3 * known:.1f}), {1e3 * (time - known):+.1f}",
            ]
        )
    return table(["test", "initial peak, m/s²", "its time, ms"], rows)


def _with_unit(value: float | None, unit: str) -> str:
    return "–" if value is None else f"{value:.3g} {unit}".removesuffix(" -")


def criteria(found: Sequence[Mapping[str, Any]]) -> str:
    """What the paper says of the crushed foam, and in how many runs it holds."""
    rows = [
        [
            "several" if each["case"] is None else short(each["case"]),
            each["source"],
            each["text"],
            _with_unit(each["median"], each["unit"]),
            each["allowed"],
            f"{each['met']} of {each['of']}" if each["holds"] else f"**{each['met']}**",
        ]
        for each in found
    ]
    return table(["test", "source", "criterion", "median", "allowed", "runs"], rows)


def literal(entries: Sequence[Entry]) -> str:
    """Errors of the set paper-literal, single runs, and the energy that is unaccounted for."""
    rows = []
    for entry in entries:
        left = abs(entry["simulated"]["energy_residual"])
        values = (percent(entry["error"][quantity.key]) for quantity in ORDER)
        rows.append([short(entry["name"]), *(f"{v} %" for v in values), f"{100 * left:.1f} %"])
    header = ["test", "duration", "displacement", "plateau", "energy/volume", "unaccounted energy"]
    return table(header, rows)


def smoke() -> None:
    """The tables of two coarse studies: whether it all still works. Writes nothing that stays."""
    with TemporaryDirectory() as folder:
        coarse: dict[str, Any] = {"overrides": COARSE, "films": False}
        ensemble, plain = Path(folder) / "ensemble", Path(folder) / "literal"
        reproduce(ensemble, ["rectangular-3.03"], ensemble=2, **coarse)
        reproduce(plain, ["rectangular-3.03"], choices="paper-literal", **coarse)
        tables(ensemble, plain)


def main(
    ensemble: Annotated[Path | None, typer.Argument(help="Folder of reproduce --ensemble.")] = None,
    paper_literal: Annotated[
        Path | None, typer.Argument(help="Folder of --choices paper-literal.")
    ] = None,
    smoke_test: Smoke = False,
) -> None:
    """Print the tables, as Markdown."""
    if smoke_test:
        smoke()
    elif ensemble is None or paper_literal is None:
        raise typer.BadParameter("give the folders of both studies")
    else:
        tables(ensemble, paper_literal)


def tables(ensemble: Path, paper_literal: Path) -> None:
    """Print the tables of two studies' folders."""
    found = json.loads((ensemble / "summary.json").read_text(encoding="utf-8"))
    entries, groups = found["cases"], found["ensemble"]
    typer.echo(f"## README\n\n{readme(entries)}")
    typer.echo(f"## Errors\n\n{errors(entries, groups['held_out']['cases'])}")
    for name in ("all", "fitted", "held_out"):
        group = groups[name]
        middle = group["median_absolute_error"]
        shown = "none" if middle is None else f"{100 * middle:.1f} %"
        typer.echo(f"{name}: {group['within']} of {group['of']}, median {shown}")
    typer.echo(f"\n## Initial peaks\n\n{peaks(entries)}")
    typer.echo(f"## Criteria\n\n{criteria(found['criteria'])}")
    plain = json.loads((paper_literal / "summary.json").read_text(encoding="utf-8"))
    typer.echo(f"## paper-literal\n\n{literal(plain['cases'])}")


if __name__ == "__main__":
    typer.run(main)
