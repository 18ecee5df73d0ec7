"""This engine against others, on this machine: `python benchmarks/compare.py [--quick]`.

README.md beside it says what is compared, and how.
"""

from __future__ import annotations

import time
from pathlib import Path
from typing import Annotated

import typer
from peers import Skipped
from peers.check import bare
from peers.flops import flops
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn
from timing import tables
from timing.limits import Limits
from timing.rounds import Record, measure, prepare
from timing.starts import memory, starts
from timing.subjects import CASE, subjects
from timing.workers import WorkerError, Workers

from taichi_foam.shim2000.tests import MEASURED, paper_scene

RESULTS = Path(__file__).parent / "results"
ROUNDS = {"full": 9, "quick": 3}
TESTS = {"full": tuple(MEASURED), "quick": ("paper/rectangular-3.03", "paper/wedge-2.86")}
TEST_ROUNDS = {"full": 3, "quick": 1}


class Bar:
    """One bar, drawn only between measurements: drawing takes a processor from them."""

    def __init__(self, console: Console, total: int) -> None:
        self.progress = Progress(
            TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn(),
            console=console, auto_refresh=False, transient=True, disable=not console.is_terminal,
        )  # fmt: skip
        self._task = self.progress.add_task("preparing: kernels compile", total=total)

    def step(self, what: str, done: int = 1) -> None:
        """Say what comes next, with `done` more pieces of work behind."""
        self.progress.update(self._task, description=what, advance=done, refresh=True)


def main(
    quick: Annotated[
        bool, typer.Option("--quick", help="A minute and a half, fewer of all.")
    ] = False,
    rounds: Annotated[int | None, typer.Option(min=1, help="Rounds of measurements.")] = None,
    threads: Annotated[int, typer.Option(min=1, help="Threads of what has many.")] = 2,
    name: Annotated[
        str | None, typer.Option(help="Name of the results; default: the machine's.")
    ] = None,
    out: Annotated[Path, typer.Option(help="Folder for the results.")] = RESULTS,
) -> None:
    """Time the engine and its peers side by side, and write the tables to a folder."""
    mode = "quick" if quick else "full"
    terminal = Console(highlight=False)
    console = terminal if terminal.is_terminal else Console(highlight=False, width=120)
    record = Record(subjects(quick, threads))
    rounds = rounds or ROUNDS[mode]
    start = time.perf_counter()
    interrupted = False
    total = len(record.subjects) * (rounds + 1) + len(TESTS[mode]) * TEST_ROUNDS[mode] + 10
    bar = Bar(console, total)
    try:
        with bar.progress:
            _everything(record, mode, rounds, threads, bar)
    except KeyboardInterrupt:
        interrupted = True
    tables.show(console, record, threads)
    console.print(f"{time.perf_counter() - start:.0f} s" + ", interrupted" * interrupted)
    if record.rounds:
        ending = "-interrupted" if interrupted else "-quick" if quick else ""
        page = tables.save(record, threads, out, (name or tables.machine_name()) + ending)
        console.print(f"written to {page} and .json", soft_wrap=True)
    raise typer.Exit(130 if interrupted else 0)


def _everything(record: Record, mode: str, rounds: int, threads: int, bar: Bar) -> None:
    quick = mode == "quick"
    counted = flops(bare(paper_scene(CASE)))
    if isinstance(counted, Skipped):
        record.skipped["operations"] = counted.reason
    else:
        record.found["flops"] = sum(counted.values())
    with Workers() as workers:
        prepare(workers, record, lambda done: bar.step("preparing: kernels compile", done))
        measure(workers, record, Limits(threads), rounds, bar.step)
        _tests(workers, record, mode, bar)
        _big(workers, record, threads, bar)
    try:
        record.found["starts"] = starts(quick, bar.step)
        bar.step("memory per node")
        record.found["memory"] = memory(threads)
    except RuntimeError as error:
        record.skipped["starts and memory"] = str(error)


def _tests(workers: Workers, record: Record, mode: str, bar: Bar) -> None:
    """The paper's tests, whole runs without contact of pieces and with it, side by side."""
    found: dict[str, list] = record.found.setdefault("tests", {})
    for _ in range(TEST_ROUNDS[mode]):
        for case in TESTS[mode]:
            bar.step(case)
            try:
                pair = [
                    workers["engine-1"].ask("whole", case=case, contact=contact)
                    for contact in (False, True)
                ]
            except WorkerError as failure:
                record.skipped[case] = str(failure)
                continue
            found.setdefault(case, []).append(pair)


def _big(workers: Workers, record: Record, threads: int, bar: Bar) -> None:
    """Snapshots of the big lattices, and what a stage of theirs moves."""
    for subject in record.subjects:
        if subject.key not in (f"middle on {threads}", f"large on {threads}"):
            continue
        if subject.key in record.skipped:
            continue
        bar.step(f"snapshots of {subject.nodes:,} nodes")
        worker = workers[subject.worker]
        try:
            snapshot = worker.ask("snapshot", subject)
            record.found["traffic"] = worker.ask("traffic", subject)
        except WorkerError as failure:
            record.skipped[f"snapshots of {subject.nodes:,} nodes"] = str(failure)
            continue
        walls = record.values(
            subject.key, lambda measured: measured["wall"] / measured["node_stages"]
        )
        between = sorted(walls)[len(walls) // 2] * 4 * subject.nodes * snapshot["steps"]
        shares = record.found.setdefault("snapshots", {})
        shares[f"{subject.nodes:,} nodes"] = snapshot["wall"] / (snapshot["wall"] + between)


if __name__ == "__main__":
    typer.run(main)
