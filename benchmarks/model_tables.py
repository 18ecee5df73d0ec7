"""The tables of docs/model.md and of README.md: `python benchmarks/model_tables.py`.

Ninety runs of the nine tests, some two minutes of two cores. Ctrl-C keeps the tables that are done.
What each choice does is a study of its own, fidelity.py.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer
from ensembles import (
    ORDER,
    Figures,
    figures_of,
    full_names,
    median_and_range,
    percent,
    scene_of,
    short,
    table,
)
from rich.console import Console

from taichi_foam.paper import MEASURED
from taichi_foam.progress import Bars
from taichi_foam.scene import Scene
from taichi_foam.study.compare import (
    DISPLACEMENT,
    DURATION,
    ENERGY,
    PLATEAU,
    TOLERANCE,
    Quantity,
    relative_error,
)
from taichi_foam.study.ensemble import factors

RESULTS = Path(__file__).parent / "results"

# Of a figure in the README's table: title, decimals as computed, and as measured.
README_ORDER = (
    (DISPLACEMENT, "displacement, cm", 2, 1),
    (DURATION, "duration, ms", 1, 0),
    (PLATEAU, "plateau, m/s²", 0, 0),
    (ENERGY, "energy/volume, 10⁵ J/m³", 2, 2),
)


def error(name: str, value: float | None, quantity: Quantity) -> float | None:
    return relative_error(value, getattr(MEASURED[name], quantity.key))


def run_all(scenes: Sequence[Scene], what: str, bars: Bars) -> list[Figures]:
    found: dict[int, Figures] = {}
    with bars.computing(what) as on_progress:
        found.update(figures_of(scenes, on_progress))
    return [found[place] for place in range(len(scenes))]


def spread(names: Sequence[str], velocities: int, bars: Bars) -> tuple[str, str]:
    """How far chance goes; and the README's table, of medians, with single runs counted below."""
    asked = [(name, f) for name in names for f in (None, *factors(velocities))]
    scenes = [scene_of(name, f or 1.0) for name, f in asked]
    found = run_all(scenes, "ensembles", bars)
    single = {n: figures for (n, f), figures in zip(asked, found, strict=True) if f is None}
    ensemble = {
        name: [figures for (n, f), figures in zip(asked, found, strict=True) if n == name and f]
        for name in names
    }
    return _chance(ensemble), _readme(single, ensemble)


def _chance(ensemble: Mapping[str, Sequence[Figures]]) -> str:
    rows = []
    for name, runs in ensemble.items():
        cells = [short(name)]
        for quantity in ORDER:
            errors = median_and_range([error(name, run[quantity.key], quantity) for run in runs])
            least, middle, largest = map(percent, errors)
            cells.append(f"{middle} ({least} to {largest})")
        cells.append(", ".join(str(run["pieces"]) for run in runs))
        cells.append(", ".join(_crack(run) for run in runs))
        rows.append(cells)
    header = ["test", "duration", "displacement", "plateau", "energy/volume", "pieces"]
    return table([*header, "crack to [mm]"], rows)


def _crack(run: Figures) -> str:
    height = run["crack_lowest_height_m"]
    return "-" if height is None else f"{1e3 * height:.0f}"


def _readme(single: Mapping[str, Figures], ensemble: Mapping[str, Sequence[Figures]]) -> str:
    rows, within, alone = [], [0] * len(README_ORDER), [0] * len(README_ORDER)
    for name, runs in ensemble.items():
        cells = [short(name)]
        for place, (quantity, _, digits, known) in enumerate(README_ORDER):
            measured = asdict(MEASURED[name])[quantity.key]
            middle = median_and_range([run[quantity.key] for run in runs]).median
            text = f"{quantity.factor * middle:.{digits}f} ({quantity.factor * measured:.{known}f})"
            near = abs(middle / measured - 1.0) <= TOLERANCE
            lone = relative_error(single[name][quantity.key], measured)
            within[place] += near
            alone[place] += lone is not None and abs(lone) <= TOLERANCE
            cells.append(text if near else f"**{text}**")
        rows.append(cells)
    count = len(ensemble)
    rows.append(["within 12 %", *(f"{n} of {count}" for n in within)])
    header = ["test", *(title for _, title, *_ in README_ORDER)]
    singles = f"Single runs within 12 %: {', '.join(f'{n} of {count}' for n in alone)}."
    return f"{table(header, rows)}\n{singles}\n"


def literal(names: Sequence[str], bars: Bars) -> str:
    """The set paper-literal, with the automatic step."""
    scenes = [scene_of(name, choices="paper-literal") for name in names]
    found = run_all(scenes, "paper-literal", bars)
    rows = []
    for name, figures in zip(names, found, strict=True):
        errors = [error(name, figures[quantity.key], quantity) for quantity in ORDER]
        left = abs(figures["energy_residual"])
        rows.append([short(name), *(f"{percent(e)} %" for e in errors), f"{100 * left:.1f} %"])
    header = ["test", "duration", "displacement", "plateau", "energy/volume", "unaccounted energy"]
    return table(header, rows)


def main(
    cases: Annotated[
        str | None, typer.Option(help="Tests, as in wedge-2.86,cylinder-3.32.")
    ] = None,
    velocities: Annotated[int, typer.Option(min=1, help="Velocities of each ensemble.")] = 8,
    out: Annotated[Path, typer.Option(help="Where the page goes.")] = RESULTS / "model_tables.md",
) -> None:
    """Compute the tables and write them to one page."""
    bars, names = Bars(Console(highlight=False)), full_names(cases)
    parts = ["# Tables of docs/model.md and README.md\n"]
    interrupted = False
    try:
        chance, readme = spread(names, velocities, bars)
        parts += ["## README\n", readme, "## How far chance goes\n", chance]
        parts += ["## paper-literal\n", literal(names, bars)]
    except KeyboardInterrupt:
        interrupted = True
    out.parent.mkdir(parents=True, exist_ok=True)
    out.write_text("\n".join(parts), encoding="utf-8")
    bars.say(f"written to {out}" + ", interrupted" * interrupted)
    raise typer.Exit(130 if interrupted else 0)


if __name__ == "__main__":
    typer.run(main)
