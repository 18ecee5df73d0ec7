"""Every benchmark script does a few steps of all that it measures, and says so when it cannot.

A change of the scene's choices or of the engine's fields breaks benchmarks first; here it shows.
"""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import compare
import frames
import gpu
import pytest
import sweeps
from peers import EXTENTS
from processes import ENVIRONMENT
from timing import tables
from timing.goals import figures
from timing.rounds import Record, measure, prepare
from timing.subjects import MODES, subjects
from timing.workers import EFFORT, AbsentError, WorkerError, Workers
from typer.testing import CliRunner

BENCHMARKS = Path(compare.__file__).parent
RESULTS = BENCHMARKS / "results"
CONTENT = {"wall": 2e-3, "cpu": 1e-3, "node_stages": 1e4, "simulated": 1e-3}


def run_script(name: str, *options: str, **variables: str) -> str:
    """What a script prints in a process of its own; nothing may appear among the results."""
    before = sorted(RESULTS.iterdir())
    done = subprocess.run(
        [sys.executable, str(BENCHMARKS / name), "--smoke", *options],
        capture_output=True, text=True, env={**ENVIRONMENT, **variables}, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr
    assert sorted(RESULTS.iterdir()) == before
    return done.stdout


# Kernels that do not come with the package compile three times as fast without all passes.
FAST = {EFFORT: "0"}


def test_compare_steps_every_subject_that_is_installed(tmp_path: Path) -> None:
    named = ("--name", "smoke", "--out", str(tmp_path))
    run_script("compare.py", "--threads", "1", *named, **FAST)
    content = json.loads((tmp_path / "smoke-smoke.json").read_text(encoding="utf-8"))
    assert content["failed"] == {}
    missing = ("not installed", "no C++ compiler", "no MPICH")
    assert all(any(word in why for word in missing) for why in content["skipped"].values())
    (measured,) = content["rounds"]
    wanted = {subject.key for subject in subjects(MODES["smoke"], 1)}
    assert wanted == measured.keys() | (wanted & content["skipped"].keys())
    assert all(each["node_stages"] > 0 for each in measured.values())
    assert content["found"].keys() >= {"tests", "snapshots", "traffic", "starts", "memory"}


def test_parts_times_every_part_of_a_step() -> None:
    shown = run_script("parts.py")
    assert "energies of a row" in shown
    assert "a whole run of the whole model" in shown


def test_batches_steps_the_engine_and_the_prototype() -> None:
    shown = run_script("batches.py", **FAST)
    (row,) = [line for line in shown.splitlines() if line.startswith("| rectangular-3.03")]
    assert "skipped" in shown or " |  |" not in row, "a figure is missing"


@pytest.fixture
def call(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Callable:
    """What a script prints that runs here, with kernels of other tests."""

    def called(script: ModuleType, *options: str) -> str:
        before = sorted(RESULTS.iterdir())
        monkeypatch.setattr(sys, "argv", [str(script.__file__), "--smoke", *options])
        script.main()
        assert sorted(RESULTS.iterdir()) == before
        return capsys.readouterr().out

    return called


def test_frames_draws_and_watches(call: Callable) -> None:
    shown = call(frames)
    assert "| 3,360 |" in shown
    assert "| frames drawn |" in shown


def test_gpu_steps_a_batch(call: Callable) -> None:
    assert "| 2 | 840 |" in call(gpu, "--arch", "cpu")


def test_sweeps_waits_and_computes(call: Callable) -> None:
    shown = call(sweeps)
    assert "100 drops that only wait" in shown
    assert "3 drops of 10 x 5 mass points" in shown
    assert "3 drops: the chart with its files" in shown


class _Workers(Workers):
    """Workers whose answers are known."""

    def __init__(self, failing: dict[str, WorkerError]) -> None:
        super().__init__()
        self.failing = failing

    def __getitem__(self, name: str) -> _Workers:
        return self

    def ask(self, do: str, subject=None, **more: object) -> object:
        if subject.key in self.failing:
            raise self.failing[subject.key]
        return {"prepare": None, "measure": CONTENT}[do]


def test_subject_that_cannot_run_is_an_error_unless_something_is_not_installed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    failing = {
        "plain": WorkerError("CompileError: g++ cannot compile plain.cpp"),
        "numba": AbsentError("Numba: not installed"),
    }

    def everything(record: Record, mode, rounds: int, threads: int, bar) -> None:
        workers = _Workers(failing)
        prepare(workers, record, lambda done: None)
        measure(workers, record, None, rounds, lambda what: None)

    monkeypatch.setattr(compare, "_everything", everything)
    app = compare.typer.Typer()
    app.command()(compare.main)
    answer = CliRunner().invoke(app, ["--smoke"])
    assert answer.exit_code == 1
    assert answer.stderr == (
        "error: plain could not be measured: CompileError: g++ cannot compile plain.cpp\n"
    )
    assert "FAILED (plain)" in answer.stdout
    assert "skipped (numba): Numba: not installed" in answer.stdout
    del failing["plain"]
    answer = CliRunner().invoke(app, ["--smoke"])
    assert answer.exit_code == 0, answer.stderr
    assert answer.stderr == ""


def test_every_goal_is_among_the_figures() -> None:
    mode = MODES["full"]
    record = Record(subjects(mode, 2))
    record.rounds = [{subject.key: CONTENT for subject in record.subjects}] * mode.rounds
    record.found = {
        "tests": {case: [dict.fromkeys(EXTENTS, CONTENT)] for case in mode.tests},
        "snapshots": {"80,000 nodes": 0.01, "2,000,000 nodes": 0.01},
        "starts": {"import": 0.1, "cold": 7.0, "warm": 2.0, "compiling": 60.0},
        "memory": 240.0,
        "flops": 200.0,
        "traffic": 230.0,
    }
    record.limits = [{1: {"bandwidth": 1e10, "arithmetic": 5e10}, 2: {"bandwidth": 2e10}}]
    goals = {figure.name: figure.goal for figure in figures(record, 2) if figure.goal}
    assert goals == {
        "800 nodes: fused / plain C++": "≤ 0.6",
        "800 nodes: fused / C++ vectors": "≤ 1.3",
        "800 nodes: fused / C++ vectors, room and softening": "≤ 1.15",
        "800 nodes: LAMMPS bpm/rotational / fused": "≥ 10",
        "batch of 8: throughput of 2 threads / 1": "≥ 1.9",
        "batch of 64: throughput of 2 threads / 1": "≥ 1.9",
        "2,000,000 nodes, 2 threads": "≤ 12 ns",
        "2,000,000 nodes, 2 threads, whole": "≤ 12 ns",
        "energy ledger, fused run": "≤ 10 %",
        "contact of pieces, the paper's tests": "≤ 15 %",
        "contact of pieces, the worst test": "≤ 20 %",
        "room and softening, the paper's tests": "≤ 15 %",
        "room and softening, the worst test": "≤ 20 %",
        "snapshots at the default interval, 80,000 nodes": "≤ 5 %",
        "snapshots at the default interval, 2,000,000 nodes": "≤ 5 %",
        "memory per node at 2,000,000 nodes": "≤ 250 bytes",
        "import taichi_foam": "≤ 0.3 s",
        "first step of a run, cold": "≤ 8 s",
        "compiling the nine tests' kernels / a loop in Python": "≤ 28",
        "first step of a run, warm": "≤ 3 s",
    }
    page = tables.markdown(record, 2)
    assert all(subject.name in page for subject in record.subjects)
