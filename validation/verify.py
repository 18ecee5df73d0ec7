"""The lattice against theory: `python validation/verify.py`, or some parts of it.

Parts: shock (compaction fronts), convergence (the paper's impacts in ever smaller cells),
cantilever (energy release of a crack) and waves. Every run's figures are kept as they come, in
results/verification.json; runs whose figures are there are not computed again, unless --fresh. The
impacts in cells of 1.25 mm take most of the time, minutes each; Ctrl-C keeps what there is.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console
from store import Store, chosen
from verification import cantilever, convergence, page, shock, smooth, waves

from taichi_foam.engine import runtime
from taichi_foam.simulation.progress import Bars

HERE = Path(__file__).parent
RESULTS = HERE / "results"
FIGURES = HERE.parent / "docs" / "figures"

Compute = Callable[[], Any]


def runs_of(part: str) -> Mapping[str, Mapping[str, Compute]]:
    """What a part computes: by the name under which it is kept, and by the run's."""
    plans: dict[str, dict[str, Mapping[str, Compute]]] = {
        "shock": {"shock": _bound(shock.compute, shock.plan())},
        "cantilever": {"cantilever": _bound(cantilever.compute, cantilever.plan())},
        "waves": {"waves": _bound(waves.compute, waves.plan())},
        "convergence": {
            "smooth": _bound(smooth.compute, smooth.plan()),
            "convergence": _bound(
                convergence.compute, {each.name: each for each in convergence.impacts()}
            ),
        },
    }
    return plans[part]


PARTS = ("shock", "waves", "cantilever", "convergence")


def _bound(compute: Callable[[Any], Any], plan: Mapping[str, Any]) -> dict[str, Compute]:
    return {name: (lambda each=each: compute(each)) for name, each in plan.items()}


def main(
    parts: Annotated[str | None, typer.Option(help="Parts, as in shock,waves; none: all.")] = None,
    fresh: Annotated[bool, typer.Option("--fresh", help="Compute again what is kept.")] = False,
    compute: Annotated[bool, typer.Option(help="Compute what is missing, or only write.")] = True,
    threads: Annotated[int, typer.Option(min=1, help="CPU threads.")] = 1,
    out: Annotated[Path, typer.Option(help="Where the page goes.")] = RESULTS / "verification.md",
    figures: Annotated[Path, typer.Option(help="Where the pictures go.")] = FIGURES,
) -> None:
    """Compute what is missing, and write page and pictures."""
    bars = Bars(Console(highlight=False))
    store = Store.open(out.with_suffix(".json"))
    wanted = [(name, runs) for part in chosen(parts, PARTS) for name, runs in runs_of(part).items()]
    interrupted = False
    try:
        if compute:
            runtime.start(threads=threads)
        for name, runs in wanted if compute else []:
            if fresh:
                store.forget(name)
            with bars.counting(name, name, len(runs), "runs") as on_run:
                for run, figures_of_run in runs.items():
                    store.figures(name, run, figures_of_run)
                    on_run()
    except KeyboardInterrupt:
        interrupted = True
    page.write(store, out, figures)
    bars.say(f"written to {out}" + ", interrupted" * interrupted)
    raise typer.Exit(130 if interrupted else 0)


if __name__ == "__main__":
    typer.run(main)
