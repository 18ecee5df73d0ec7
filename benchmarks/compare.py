"""This engine against others, on this machine: `python benchmarks/compare.py [--quick | --smoke]`.

README.md beside it says what is compared, and how. Exit code 1: something failed that is not merely
absent; the last lines say what.
"""

from __future__ import annotations

import time
from pathlib import Path
from typing import Annotated

import typer
from peers import EXTENTS, Skipped, scene_with
from peers.flops import flops
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn
from timing import tables
from timing.limits import Limits
from timing.rounds import Record, measure, prepare
from timing.starts import memory, starts
from timing.subjects import MODES, Mode, subjects
from timing.workers import Workers, compile_thoroughly

RESULTS = Path(__file__).parent / "results"


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
    quick: Annotated[bool, typer.Option("--quick", help="Two minutes, fewer of all.")] = False,
    smoke: Annotated[
        bool,
        typer.Option("--smoke", help="A few steps of everything: whether it runs, not how fast."),
    ] = False,
    rounds: Annotated[int | None, typer.Option(min=1, help="Rounds of measurements.")] = None,
    threads: Annotated[int, typer.Option(min=1, help="Threads of what has many.")] = 2,
    name: Annotated[
        str | None, typer.Option(help="Name of the results; default: the machine's.")
    ] = None,
    out: Annotated[
        Path | None, typer.Option(help="Folder for the results; default: results, smoke: none.")
    ] = None,
) -> None:
    """Time the engine and its peers side by side, and write the tables to a folder."""
    kind = "smoke" if smoke else "quick" if quick else "full"
    mode = MODES[kind]
    if not smoke:
        compile_thoroughly()
    terminal = Console(highlight=False)
    console = terminal if terminal.is_terminal else Console(highlight=False, width=120)
    record = Record(subjects(mode, threads))
    rounds = rounds or mode.rounds
    start = time.perf_counter()
    interrupted = False
    total = len(record.subjects) * (rounds + 1) + len(mode.tests) * mode.test_rounds + 10
    bar = Bar(console, total)
    try:
        with bar.progress:
            _everything(record, mode, rounds, threads, bar)
    except KeyboardInterrupt:
        interrupted = True
    tables.show(console, record, threads)
    console.print(f"{time.perf_counter() - start:.0f} s" + ", interrupted" * interrupted)
    folder = out or (None if smoke else RESULTS)
    if record.rounds and folder:
        ending = "-interrupted" if interrupted else "" if kind == "full" else f"-{kind}"
        page = tables.save(record, threads, folder, (name or tables.machine_name()) + ending)
        console.print(f"written to {page} and .json", soft_wrap=True)
    for reason, keys in tables.by_reason(record.failed).items():
        typer.echo(f"error: {keys} could not be measured: {reason}", err=True)
    raise typer.Exit(130 if interrupted else 1 if record.failed else 0)


def _everything(record: Record, mode: Mode, rounds: int, threads: int, bar: Bar) -> None:
    limits = None
    with record.attempt("operations"):
        counted = flops(scene_with("calibrated"), *mode.counted_steps)
        if isinstance(counted, Skipped):
            record.skipped["operations"] = counted.reason
        else:
            record.found["flops"] = sum(counted.values())
    with record.attempt("the machine's limits"):
        limits = Limits(threads)
    with Workers() as workers:
        prepare(workers, record, lambda done: bar.step("preparing: kernels compile", done))
        measure(workers, record, limits, rounds, bar.step)
        _tests(workers, record, mode, bar)
        _big(workers, record, threads, bar)
    with record.attempt("starts"):
        record.found["starts"] = starts(mode, bar.step)
    bar.step("memory per node")
    with record.attempt("memory"):
        record.found["memory"] = memory(mode, threads)


def _tests(workers: Workers, record: Record, mode: Mode, bar: Bar) -> None:
    """The paper's tests, whole runs with ever more of the model, side by side."""
    found: dict[str, list] = record.found.setdefault("tests", {})
    for _ in range(mode.test_rounds):
        for case in mode.tests:
            bar.step(case)
            with record.attempt(case):
                runs = {
                    extent: workers["engine-1"].ask(
                        "whole", case=case, extent=extent, end=mode.test_end
                    )
                    for extent in EXTENTS
                }
                found.setdefault(case, []).append(runs)


def _big(workers: Workers, record: Record, threads: int, bar: Bar) -> None:
    """Snapshots of the big lattices, and what a stage of theirs moves."""
    shares = record.found.setdefault("snapshots", {})
    for subject in record.subjects:
        walls = record.values(subject.key, lambda each: each["wall"] / each["node_stages"])
        if subject.key not in (f"middle on {threads}", f"large on {threads}") or not walls:
            continue
        what = f"{subject.nodes:,} nodes"
        bar.step(f"snapshots of {what}")
        worker = workers[subject.worker]
        with record.attempt(f"snapshots of {what}"):
            snapshot = worker.ask("snapshot", subject)
            record.found["traffic"] = worker.ask("traffic", subject)
            between = sorted(walls)[len(walls) // 2] * 4 * subject.nodes * snapshot["steps"]
            shares[what] = snapshot["wall"] / (snapshot["wall"] + between)


if __name__ == "__main__":
    typer.run(main)
