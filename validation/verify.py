"""The lattice against theory: `python validation/verify.py`, or some parts of it.

Parts: shock (compaction fronts), convergence (the paper's impacts in ever smaller cells),
cantilever (energy release of a crack) and waves. Every run's figures are kept as they come, in
results/verification.json; runs whose figures are there are not computed again, unless --fresh. The
impacts in cells of 1.25 mm take most of the time, minutes each; Ctrl-C keeps what there is.
"""

from __future__ import annotations

from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from types import ModuleType
from typing import Annotated

import typer
from pages import FIGURES, RESULTS, Page, headed
from rich.console import Console
from store import Compute, Figures, Fresh, Out, Smoke, Store, chosen, computed, leave
from verification import (
    cantilever,
    cantilever_page,
    convergence,
    convergence_page,
    shock,
    shock_page,
    smooth,
    waves,
    waves_page,
)

from taichi_foam.engine import runtime
from taichi_foam.simulation.progress import Bars

PARTS = {
    "shock": {"shock": shock},
    "waves": {"waves": waves},
    "cantilever": {"cantilever": cantilever},
    "convergence": {"smooth": smooth, "convergence": convergence},
}
"""What each part computes: studies with `plan` and `compute`, by where they are kept."""


def write(store: Store, page: Page) -> None:
    """Write the page and the pictures of all parts that have anything."""
    parts = [
        *shock_page.section(store.part("shock"), page),
        *convergence_page.section(store.part("convergence"), store.part("smooth"), page),
        *cantilever_page.section(store.part("cantilever"), page),
        *waves_page.section(store.part("waves"), page),
    ]
    page.write(headed("The lattice against theory", "verify.py", parts))


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
        write(kept, Page(Path(folder) / "verification.md", Path(folder)))


def main(
    parts: Annotated[str | None, typer.Option(help="Parts, as in shock,waves; none: all.")] = None,
    fresh: Fresh = False,
    compute: Compute = True,
    threads: Annotated[int, typer.Option(min=1, help="CPU threads.")] = 1,
    out: Out = RESULTS / "verification.md",
    figures: Figures = FIGURES,
    smoke_test: Smoke = False,
) -> None:
    """Compute what is missing, and write page and pictures."""
    if smoke_test:
        smoke()
        return
    bars = Bars(Console(highlight=False))
    store = Store.open(out.with_suffix(".json"))
    wanted = {name: study for part in chosen(parts, PARTS) for name, study in PARTS[part].items()}

    def compute_all(name: str, study: ModuleType) -> None:
        runtime.start(threads=threads)
        plan = study.plan()
        with bars.counting(name, name, len(plan), "runs") as on_run:
            for run, asked in plan.items():
                if run not in store.part(name):
                    store.keep(name, run, study.compute(asked))
                on_run()

    tasks = {name: partial(compute_all, name, study) for name, study in wanted.items() if compute}
    whole = computed(store, tasks, fresh)
    write(store, Page(out, figures))
    leave(bars, out, whole)


if __name__ == "__main__":
    typer.run(main)
