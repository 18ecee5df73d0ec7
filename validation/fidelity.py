"""The choices that the paper leaves open, against its tests: `python validation/fidelity.py`.

Parts: select (choices fitted to six tests and judged by the three held out; its grid stands in
fidelity_study/grid.py) and choices (one change at a time from the calibrated set; they stand in
fidelity_study/changes.py). Every run's figures are kept as they come, in results/fidelity.json, by
a digest of the run's scene: another calibration computes what it changes, another engine needs
--fresh. Some two thousand impacts, half an hour of two cores; Ctrl-C keeps what has ended.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated

import typer
from ensembles import COARSE, full_names
from fidelity_study import changes, changes_page, grid, members
from pages import FIGURES, RESULTS, Page, headed
from rich.console import Console
from store import Compute, Figures, Fresh, Out, Smoke, Store, chosen, computed, leave

from taichi_foam.shim2000.impacts import TESTS
from taichi_foam.shim2000.scores import HELD_OUT
from taichi_foam.simulation.progress import Bars

PARTS = ("select", "choices")
VELOCITIES = {"select": grid.VELOCITIES, "choices": changes.VELOCITIES}


@dataclass(frozen=True)
class Asked:
    """What of a part is to be computed now: some tests, and labels that have one of `only`."""

    tests: Sequence[str]
    only: Sequence[str]
    velocities: dict[str, int]

    def names(self, label: str) -> bool:
        """Whether this change or candidate is asked for."""
        return not self.only or any(text in label for text in self.only)


def select(asked: Asked, store: Store, bars: Bars) -> None:
    """The fitted tests of all candidates; and then the held-out ones of the best."""
    velocities = asked.velocities["select"]
    fitted = [test for test in asked.tests if test in grid.FITTED]
    wanted = [each for each in grid.candidates() if asked.names(each.label)]
    ensembles = [run for each in wanted for run in each.ensembles(fitted, velocities)]
    members.compute("select", ensembles, store, bars)
    best = grid.winner(velocities, store.part("select"))
    if best is not None:
        members.compute("select", best.ensembles(HELD_OUT, velocities), store, bars)


def choices(asked: Asked, store: Store, bars: Bars) -> None:
    """All tests of all changes, and of the calibrated set."""
    wanted = [c for c in changes.changes() if c == changes.CALIBRATED or asked.names(c.label)]
    velocities = asked.velocities["choices"]
    ensembles = [run for each in wanted for run in each.ensembles(asked.tests, velocities)]
    members.compute("choices", ensembles, store, bars)


COMPUTE = {"select": select, "choices": choices}


def write(store: Store, velocities: Mapping[str, int], page: Page) -> str:
    """Write page and picture of what there is of both parts; the text comes back."""
    parts = [
        *grid.section(velocities["select"], store.part("select")),
        *changes_page.section(velocities["choices"], store.part("choices"), page),
    ]
    text = headed("The choices that the paper leaves open", "fidelity.py", parts)
    page.write(text)
    return text


def smoke() -> None:
    """A few coarse impacts, and the page of figures that are made up: whether it all still works.

    Raises AssertionError or whatever goes wrong; writes nothing that stays.
    """
    bars = Bars()
    with TemporaryDirectory() as folder:
        store = Store.open(Path(folder) / "smoke.json")
        coarse = members.Ensemble("paper/rectangular-3.03", COARSE, 2)
        members.compute("choices", [coarse], store, bars)
        assert members.entry(coarse, store.part("choices"))
        assert members.shares(coarse, store.part("choices"))
        store.forget("choices")
        tests = [*grid.FITTED, *HELD_OUT]
        asked = {
            "select": [run for c in grid.candidates() for run in c.ensembles(tests, 1)],
            "choices": [run for c in changes.changes() for run in c.ensembles(tests, 1)],
        }
        for part, ensembles in asked.items():
            for each in ensembles:
                known = TESTS[each.test].measured
                made_up = {q.key: 1.05 * known[q.key] for q in members.JUDGED if q.key in known}
                for name in each.members:
                    store.part(part)[name] = {"figures": made_up, "criteria": {"all": True}}
        page = Page(Path(folder) / "fidelity.md", Path(folder))
        text = write(store, dict.fromkeys(PARTS, 1), page)
        assert "### The held-out tests of the best" in text
        assert text.count("27 of 27") > len(changes.VALUES)


def main(
    parts: Annotated[str | None, typer.Option(help="select or choices; none: both.")] = None,
    cases: Annotated[
        str | None, typer.Option(help="Compute these tests only, as in wedge-2.86,cylinder-3.32.")
    ] = None,
    only: Annotated[
        list[str] | None,
        typer.Option(help="Compute only what has this in its label; may be given repeatedly."),
    ] = None,
    velocities: Annotated[
        int | None,
        typer.Option(min=1, help="Velocities of each ensemble; use another --out with it."),
    ] = None,
    fresh: Fresh = False,
    compute: Compute = True,
    out: Out = RESULTS / "fidelity.md",
    figures: Figures = FIGURES,
    smoke_test: Smoke = False,
) -> None:
    """Compute what is missing, and write and print the page of all that is there."""
    if smoke_test:
        smoke()
        return
    bars = Bars(Console(highlight=False))
    store = Store.open(out.with_suffix(".json"))
    counts = {part: velocities or VELOCITIES[part] for part in PARTS}
    asked = Asked(full_names(cases), only or [], counts)
    wanted = chosen(parts, PARTS) if compute else []
    tasks = {part: partial(COMPUTE[part], asked, store, bars) for part in wanted}
    whole = computed(store, tasks, fresh)
    typer.echo(write(store, counts, Page(out, figures)))
    leave(bars, out, whole)


if __name__ == "__main__":
    typer.run(main)
