"""The paper's tests in cells of 10 to 1.25 mm: `python validation/cells.py`.

Parts: cells (the calibrated choices as they are), readings (other ways to carry strength and rate
over to other cells) and mechanisms (each switched off, to see what moves with the cell). They stand
in cells_study.py. Every run's figures are kept as they come, in results/cells.json, by a
digest of its scene; another engine needs --fresh. Some 350 impacts, an hour of two cores, most of
it for cells of 2.5 and 1.25 mm; Ctrl-C keeps what has ended.
"""

from __future__ import annotations

from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated

import typer
from cells_study import JUDGED, TESTS, Variant, variants, write
from ensembles import full_names
from fidelity_study import members
from pages import FIGURES, RESULTS, Page
from rich.console import Console
from store import Compute, Figures, Fresh, Out, Smoke, Store, chosen, computed, leave

from taichi_foam.simulation.progress import Bars

PARTS = ("cells", "readings", "mechanisms")


def smoke() -> None:
    """A coarse impact, and the page of figures that are made up: whether it all still works.

    Raises AssertionError or whatever goes wrong; writes nothing that stays.
    """
    bars = Bars()
    with TemporaryDirectory() as folder:
        store = Store.open(Path(folder) / "smoke.json")
        coarse = Variant("cells", "coarse", (0.010,), {0.010: 2})
        members.compute("cells", list(coarse.ensembles(TESTS[:1])), store, bars)
        assert coarse.ensemble(TESTS[0], 0.010).runs(store.part("cells"))
        store.forget("cells")
        for variant in variants():
            for ensemble in variant.ensembles(TESTS):
                for n, name in enumerate(ensemble.members):
                    made_up = {quantity.key: 1.0 + 0.01 * n for quantity in JUDGED}
                    store.part(variant.part)[name] = {"figures": made_up, "criteria": {}}
        text = write(store, Page(Path(folder) / "cells.md", Path(folder)))
        assert "- 4 mm: 9 of 9 medians within 6 %" in text
        assert all(variant.label in text for variant in variants()[1:])


def main(
    parts: Annotated[
        str | None, typer.Option(help="cells, readings, mechanisms; none: all.")
    ] = None,
    only: Annotated[str, typer.Option(help="Compute only what has this in its label.")] = "",
    finest: Annotated[
        float, typer.Option(help="Compute no cells smaller than this, in mm.")
    ] = 1.25,
    cases: Annotated[
        str | None, typer.Option(help="Compute these tests only, as in wedge-2.86,cylinder-2.94.")
    ] = None,
    fresh: Fresh = False,
    compute: Compute = True,
    out: Out = RESULTS / "cells.md",
    figures: Figures = FIGURES,
    smoke_test: Smoke = False,
) -> None:
    """Compute what is missing, and write and print the page of all that is there."""
    if smoke_test:
        smoke()
        return
    bars = Bars(Console(highlight=False))
    store = Store.open(out.with_suffix(".json"))
    tests = [test for test in full_names(cases) if test in TESTS]

    def compute_part(part: str) -> None:
        for variant in variants():
            if variant.part == part and only in variant.label:
                for cell in variant.cells:
                    if cell >= 0.999e-3 * finest:
                        asked = [variant.ensemble(test, cell) for test in tests]
                        members.compute(part, asked, store, bars)

    wanted = chosen(parts, PARTS) if compute else []
    whole = computed(store, {part: partial(compute_part, part) for part in wanted}, fresh)
    typer.echo(write(store, Page(out, figures)))
    leave(bars, out, whole)


if __name__ == "__main__":
    typer.run(main)
