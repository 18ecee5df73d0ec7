"""The same tables for a terminal, for Markdown and for JSON."""

from __future__ import annotations

import json
import os
import platform
import re
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from peers.compile import compiler_version
from rich.console import Console
from rich.table import Table

from taichi_foam.shim2000.machine import machine, versions

from .goals import contact_costs, figures, roofline
from .rounds import Record, Spread, cpu_ns, wall_ns, wall_per_ms
from .subjects import Subject

HEADS = ("nodes", "what", "threads", "ns", "spread", "CPU ns", "s/ms")
LEGEND = (
    "ns: wall time per node-stage, which is one node's part of one of a step's four force"
    " evaluations (LAMMPS has one a step). CPU ns: processor time of all threads. s/ms: wall"
    " seconds per simulated millisecond of one lattice. Medians of {rounds} rounds, with quartiles"
    " (of few rounds: least and largest); ratios are formed within rounds."
)


def rows(record: Record) -> list[tuple[str, ...]]:
    """A row for each subject that was measured."""
    found = []
    for subject in record.subjects:
        walls = record.values(subject.key, wall_ns)
        if not walls:
            continue
        spread = Spread.of(walls)
        cpu = "" if "lammps" in subject.key else _mid(record, subject, cpu_ns, ".1f")
        found.append(
            (
                f"{subject.nodes:,}", subject.name, str(subject.threads), f"{spread.median:.1f}",
                f"{spread.low:.1f} to {spread.high:.1f}", cpu,
                _mid(record, subject, wall_per_ms, ".3g"),
            )
        )  # fmt: skip
    return found


def goal_rows(record: Record, threads: int) -> list[tuple[str, ...]]:
    """A row for each figure."""
    found = []
    for figure in figures(record, threads):
        value = figure.value
        spread = "" if value.low == value.high else f"{value.low:.3g} to {value.high:.3g}"
        found.append(
            (figure.name, f"{value.median:.3g}{figure.unit}", spread, figure.goal, figure.verdict)
        )
    return found


GOAL_HEADS = ("figure", "median", "spread", "goal", "")


def show(console: Console, record: Record, threads: int) -> None:
    """Print everything."""
    _print(console, HEADS, rows(record))
    if record.rounds:
        console.print(LEGEND.format(rounds=len(record.rounds)))
    _print(console, GOAL_HEADS, goal_rows(record, threads))
    for line in [*roofline(record, threads), *notes(record)]:
        console.print(line, highlight=False, markup=False)


def notes(record: Record) -> list[str]:
    """What is not there and why, and the contact of pieces case by case."""
    costs = [
        f"{name.removeprefix('paper/')} {cost:+.0f} %"
        for name, cost in contact_costs(record).items()
    ]
    lines = [f"contact of pieces, by test: {', '.join(costs)}"] if costs else []
    reasons = dict.fromkeys(record.skipped.values())
    for reason in reasons:
        keys = [key for key, why in record.skipped.items() if why == reason]
        lines.append(f"skipped ({', '.join(keys)}): {reason}")
    return lines


def markdown(record: Record, threads: int) -> str:
    """The page for people."""
    about = environment()
    parts = [
        f"{about['processor']}, {about['cores']} cores, {about['system']}; "
        + ", ".join(f"{name} {found}" for name, found in about["versions"].items())
        + ".",
        _table(HEADS, rows(record)),
        LEGEND.format(rounds=len(record.rounds)),
        _table(GOAL_HEADS, goal_rows(record, threads)),
        "\n".join(f"- {line}" for line in [*roofline(record, threads), *notes(record)]),
    ]
    return "\n\n".join(part for part in parts if part) + "\n"


def save(record: Record, threads: int, folder: Path, name: str) -> Path:
    """Write NAME.json and NAME.md; whoever reads meanwhile sees the old ones, whole."""
    folder.mkdir(parents=True, exist_ok=True)
    content = {
        "environment": environment(),
        "threads": threads,
        "table": [dict(zip(HEADS, row, strict=True)) for row in rows(record)],
        "figures": [
            dict(zip((*GOAL_HEADS[:-1], "verdict"), row, strict=True))
            for row in goal_rows(record, threads)
        ],
        "roofline": roofline(record, threads),
        "skipped": record.skipped,
        "found": record.found,
        "limits": record.limits,
        "rounds": record.rounds,
    }
    page = folder / f"{name}.md"
    for path, text in (
        (folder / f"{name}.json", json.dumps(content, indent=1)),
        (page, markdown(record, threads)),
    ):
        staging = path.with_name(f".{path.name}.{os.getpid()}")
        staging.write_text(text, encoding="utf-8")
        staging.replace(path)
    return page


def environment() -> dict:
    """Machine and versions of all that takes part."""
    found = {**machine(), "versions": versions()}
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


def _mid(record: Record, subject: Subject, of, form: str) -> str:
    return format(Spread.of(record.values(subject.key, of)).median, form)


def _print(console: Console, heads: tuple[str, ...], lines: list) -> None:
    table = Table(*heads)
    for line in lines:
        table.add_row(*line)
    if lines:
        console.print(table)


def _table(heads: tuple[str, ...], lines: list) -> str:
    if not lines:
        return ""
    marked = [heads, ("---",) * len(heads), *lines]
    return "\n".join("| " + " | ".join(line) + " |" for line in marked)
