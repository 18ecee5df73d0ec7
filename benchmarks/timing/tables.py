"""What compare.py has found, for a terminal, for Markdown and for JSON."""

from __future__ import annotations

import json
import platform
import re
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from peers.compile import compiler_version
from rich.console import Console

from taichi_foam.simulation.provenance import machine, versions

from .goals import costs_of_tests, figures, roofline
from .rounds import Record, Spread, cpu_ns, wall_ns, wall_per_ms
from .subjects import Subject
from .table import Table, write
from .vectors import vectors

LEGEND = (
    "ns: wall time per node-stage, which is one node's part of one of a step's four force"
    " evaluations (LAMMPS has one a step). CPU ns: processor time of all threads. s/ms: wall"
    " seconds per simulated millisecond of one lattice. Medians of {rounds} rounds, with quartiles"
    " (of few rounds: least and largest); ratios are formed within rounds."
)


def timings(record: Record) -> Table:
    """A row for each subject that was measured."""
    table = Table(("nodes", "what", "threads", "ns", "spread", "CPU ns", "s/ms"))
    for subject in record.subjects:
        walls = record.values(subject.key, wall_ns)
        if not walls:
            continue
        spread = Spread.of(walls)
        cpu = "" if "lammps" in subject.key else _mid(record, subject, cpu_ns, ".1f")
        table.rows.append(
            (
                f"{subject.nodes:,}", subject.name, str(subject.threads), f"{spread.median:.1f}",
                f"{spread.low:.1f} to {spread.high:.1f}", cpu,
                _mid(record, subject, wall_per_ms, ".3g"),
            )
        )  # fmt: skip
    return table


def goals(record: Record, threads: int) -> Table:
    """A row for each figure."""
    table = Table(("figure", "median", "spread", "goal", "verdict"))
    for figure in figures(record, threads):
        value = figure.value
        spread = "" if value.low == value.high else f"{value.low:.3g} to {value.high:.3g}"
        table.rows.append(
            (figure.name, f"{value.median:.3g}{figure.unit}", spread, figure.goal, figure.verdict)
        )
    return table


def _mid(record: Record, subject: Subject, of, form: str) -> str:
    return format(Spread.of(record.values(subject.key, of)).median, form)


def show(console: Console, record: Record, threads: int) -> None:
    """Print everything."""
    console.print(timings(record))
    console.print(LEGEND.format(rounds=len(record.rounds)))
    console.print(goals(record, threads))
    for line in [*roofline(record, threads), *notes(record)]:
        console.print(line, highlight=False, markup=False)


def notes(record: Record) -> list[str]:
    """Parts of the model case by case, and what is not there and why."""
    lines = []
    for what, costs in costs_of_tests(record).items():
        each = [f"{case.removeprefix('paper/')} {cost:+.0f} %" for case, cost in costs.items()]
        lines.append(f"{what}, by test: {', '.join(each)}")
    for what, missing in (("skipped", record.skipped), ("FAILED", record.failed)):
        lines += [f"{what} ({keys}): {reason}" for reason, keys in by_reason(missing).items()]
    return lines


def by_reason(missing: dict[str, str]) -> dict[str, str]:
    """Each reason once, with the subjects that it keeps away."""
    found: dict[str, list[str]] = {}
    for key, reason in missing.items():
        found.setdefault(reason, []).append(key)
    return {reason: ", ".join(keys) for reason, keys in found.items()}


def markdown(record: Record, threads: int) -> str:
    """The page for people."""
    about = environment()
    parts = [
        f"{about['processor']}, {about['cores']} cores, {about['vectors']}, {about['system']}; "
        + ", ".join(f"{name} {found}" for name, found in about["versions"].items())
        + ".",
        timings(record).markdown(),
        LEGEND.format(rounds=len(record.rounds)),
        goals(record, threads).markdown(),
        "\n".join(f"- {line}" for line in [*roofline(record, threads), *notes(record)]),
    ]
    return "\n\n".join(part for part in parts if part) + "\n"


def save(record: Record, threads: int, folder: Path, name: str) -> Path:
    """Write NAME.json and NAME.md."""
    content = {
        "environment": environment(),
        "threads": threads,
        "table": timings(record).records(),
        "figures": goals(record, threads).records(),
        "roofline": roofline(record, threads),
        "skipped": record.skipped,
        "failed": record.failed,
        "found": record.found,
        "limits": record.limits,
        "rounds": record.rounds,
    }
    write(folder / f"{name}.json", json.dumps(content, indent=1))
    page = folder / f"{name}.md"
    write(page, markdown(record, threads))
    return page


def environment() -> dict:
    """Machine, width of its kernels' vectors, and versions of all that takes part."""
    found = {**machine(), "vectors": vectors(), "versions": versions()}
    for name in ("numba", "lammps"):
        try:
            found["versions"][name] = version(name)
        except PackageNotFoundError:
            continue
    found["versions"]["compiler"] = compiler_version()
    return found


def machine_name() -> str:
    """A file name for this machine: its processor and cores."""
    about = machine()
    words = f"{about['processor']} {about['cores']} cores {platform.system()}".lower()
    return re.sub(r"[^a-z0-9]+", "-", words).strip("-")
