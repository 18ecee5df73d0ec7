"""What a lattice in each lane would bring to batches: `python benchmarks/batches.py [--smoke]`.

Lattices of 800 nodes whose impactors' velocities differ by up to 3 %, in full impact: this engine's
batches, whose vectors run along a column, and a prototype in C++ whose vectors run across the batch
(`peers/batch.cpp`). Rounds alternate. The table goes to standard output and to results/batches.md.
`--smoke` does a few steps of each, to see whether they run, not how fast, and writes nothing.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass, replace
from pathlib import Path

from peers import CASE, Extent
from timing.rounds import Record, Spread, cpu_ns, measure, prepare
from timing.subjects import Subject
from timing.table import Table, write
from timing.tables import environment
from timing.workers import Workers, compile_thoroughly

RESULTS = Path(__file__).parent / "results" / "batches.md"
WEDGE = "paper/wedge-2.86"
EXTENTS: dict[Extent, str] = {"peers": "without", "room": "with"}  # room and softening
BITS = (256, 512)


@dataclass(frozen=True)
class Mode:
    """How much is measured."""

    rounds: int = 5
    batches: tuple[tuple[str, int, float], ...] = (
        (CASE, 8, 2e-3),
        (WEDGE, 8, 2e-3),
        (CASE, 64, 3e-4),
    )
    """Case, lattices, and simulated time of a measurement [s]."""
    threads: tuple[int, ...] = (1, 2)
    start: float = 8e-3  # s
    extents: tuple[Extent, ...] = tuple(EXTENTS)


# one extent: compare.py runs the other
SMOKE = Mode(
    rounds=1, batches=((CASE, 1, 1e-4),), threads=(1,), start=1e-4, extents=("room",)
)  # fmt: skip


def subjects(mode: Mode) -> list[tuple[Subject, list[Subject]]]:
    """This engine's batches, each with the prototype's at every width."""
    found = []
    for case, batch, span in mode.batches:
        for extent in mode.extents:
            for threads in mode.threads:
                key = f"{case} {extent} {batch} {threads}"
                engine = Subject(
                    key, key, f"engine-{threads}", batch=batch, threads=threads, case=case,
                    extent=extent, start=mode.start, span=span,
                )  # fmt: skip
                lanes = [
                    replace(engine, key=f"{key} {bits}", worker="peers", peer=f"Batch {bits}")
                    for bits in BITS
                ]
                found.append((engine, lanes))
    return found


def table(record: Record, pairs: list[tuple[Subject, list[Subject]]]) -> Table:
    """A row for each batch: ns of processor time per node-stage, by all threads together."""
    heads = ["case", "room and softening", "lattices", "threads", "this engine, ns"]
    found = Table([*heads, *(f"{bits} bits, {what}" for bits in BITS for what in ("ns", "ratio"))])
    for engine, lanes in pairs:
        row = [
            engine.case.removeprefix("paper/"), EXTENTS[engine.extent], str(engine.batch),
            str(engine.threads), _ns(record, engine),
        ]  # fmt: skip
        for subject in lanes:
            ratio = record.ratio(subject.key, engine.key, cpu_ns)
            row += [_ns(record, subject), "" if ratio is None else f"{ratio.median:.2f}"]
        found.rows.append(row)
    return found


def _ns(record: Record, subject: Subject) -> str:
    values = record.values(subject.key, cpu_ns)
    if not values:
        return ""
    spread = Spread.of(values)
    return f"{spread.median:.1f} ({spread.low:.1f} to {spread.high:.1f})"


def main() -> None:
    """Print the table, and write that of a full measurement."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--smoke", dest="mode", action="store_const", const=SMOKE, default=Mode())
    mode = parser.parse_args().mode
    if mode is not SMOKE:
        compile_thoroughly()
    pairs = subjects(mode)
    record = Record([subject for engine, lanes in pairs for subject in (engine, *lanes)])
    with Workers() as workers:
        prepare(workers, record, lambda done: None)
        measure(workers, record, None, mode.rounds, lambda what: None)
    about = environment()
    text = (
        f"{about['processor']}, {about['cores']} cores, {about['versions']['compiler']}; ns of"
        f" processor time for a node and stage, by all threads; medians and quartiles of"
        f" {mode.rounds} rounds.\n\n{table(record, pairs).markdown()}\n"
    )
    print(text)
    for key, reason in record.skipped.items():
        print(f"skipped: {key}: {reason}")
    if record.failed:
        raise SystemExit(f"error: could not be measured: {record.failed}")
    if mode is not SMOKE:
        write(RESULTS, text)


if __name__ == "__main__":
    main()
