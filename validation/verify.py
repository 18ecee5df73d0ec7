"""The lattice against theory: `python validation/verify.py`, or some parts of it.

Parts: shock (compaction fronts), convergence (the paper's impacts in ever smaller cells),
cantilever (energy release of a crack) and waves. Every run's figures are kept as they come, in
results/verification.json; runs whose figures are there are not computed again, unless --fresh. The
impacts in cells of 1.25 mm take most of the time, minutes each; Ctrl-C keeps what there is.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated, Any

import typer
from rich.console import Console
from store import SMOKE_HELP, Store, chosen, computed, leave
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


def smoke() -> None:
    """A short run of each study, and the page of what is kept: whether it all still works.

    Raises AssertionError or whatever goes wrong; writes nothing that stays.
    """
    kept = Store.open(RESULTS / "verification.json")
    first = convergence.CASES[0]
    strip = cantilever.Strip(
        0.010, 0.03, 0.15, 0.08, 0.01, travel=0.06, speed=1.0, tensile_strain=0.02
    )
    found = {
        "shock": shock.compute(shock.Shock(shock.PAPER, 150.0, 0.010, length=0.4)),
        # no longer than what else runs, so that its kernels serve
        "waves": waves.compute((waves.LENGTH / 48, 0.0)),
        "cantilever": cantilever.compute(strip),
        "smooth": smooth.compute(smooth.Smooth(first, convergence.CELLS[0])),
        "convergence": convergence.compute(
            convergence.Impact(first, convergence.CELLS[0], convergence.STRENGTHS[0])
        ),
    }
    for part, figures in found.items():
        known = [set(each) for each in kept.part(part).values()]
        assert set(figures) in known, f"{part}: {sorted(figures)} is not what is kept of its runs"
    with TemporaryDirectory() as folder:
        page.write(kept, Path(folder) / "verification.md", Path(folder))


def _bound(compute: Callable[[Any], Any], plan: Mapping[str, Any]) -> dict[str, Compute]:
    return {name: (lambda each=each: compute(each)) for name, each in plan.items()}


def main(
    parts: Annotated[str | None, typer.Option(help="Parts, as in shock,waves; none: all.")] = None,
    fresh: Annotated[bool, typer.Option("--fresh", help="Compute again what is kept.")] = False,
    compute: Annotated[bool, typer.Option(help="Compute what is missing, or only write.")] = True,
    threads: Annotated[int, typer.Option(min=1, help="CPU threads.")] = 1,
    out: Annotated[Path, typer.Option(help="Where the page goes.")] = RESULTS / "verification.md",
    figures: Annotated[Path, typer.Option(help="Where the pictures go.")] = FIGURES,
    smoke_test: Annotated[bool, typer.Option("--smoke", help=SMOKE_HELP)] = False,
) -> None:
    """Compute what is missing, and write page and pictures."""
    if smoke_test:
        smoke()
        return
    bars = Bars(Console(highlight=False))
    store = Store.open(out.with_suffix(".json"))
    wanted = [(name, runs) for part in chosen(parts, PARTS) for name, runs in runs_of(part).items()]

    def compute_part(name: str, runs: Mapping[str, Compute]) -> None:
        runtime.start(threads=threads)
        with bars.counting(name, name, len(runs), "runs") as on_run:
            for run, figures_of_run in runs.items():
                store.figures(name, run, figures_of_run)
                on_run()

    tasks = {name: partial(compute_part, name, runs) for name, runs in wanted if compute}
    whole = computed(store, tasks, fresh)
    page.write(store, out, figures)
    leave(bars, out, whole)


if __name__ == "__main__":
    typer.run(main)
