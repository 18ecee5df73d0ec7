"""Sweeps in other processes: the same bits, whoever dies meanwhile."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

import pytest
import sweeps
from drops import Solver, axis, plan_of
from processes import until
from slow_sweep import PLAN

import taichi_foam as tf
from taichi_foam.errors import RunError, UserError
from taichi_foam.results.result import Result
from taichi_foam.scene import Scene
from taichi_foam.sweeps.run import Sweep

#: Drops that take some milliseconds each; every process compiles their kernels once.
REAL = {
    "scene": "paper/wedge-2.86",
    "set": {"block.columns": 10, "block.rows": 5, "numerics.end": 2e-3},
    "chunk": 2,
    "axes": [{"key": "impactor.mass", "values": [3.0, 6.0]}, axis(count=2)],
    "repeats": {"count": 2},
    "keep": {"histories": "float32", "full": [3]},
}


@pytest.fixture(scope="module")
def unbroken(tmp_path_factory: pytest.TempPathFactory) -> Sweep:
    return tf.sweep(REAL, tmp_path_factory.mktemp("unbroken") / "s")


def test_a_member_computed_again_has_the_numbers_of_its_row(unbroken: Sweep) -> None:
    row = unbroken.to_pandas().set_index("member").loc[5]
    again = unbroken.again(5)
    assert again.snapshots
    same = [key for key in again.summary if key in row and key not in ("scene", *sweeps.MACHINE)]
    assert len(same) > 15
    for key in same:
        value = again.summary[key]
        value = "; ".join(value) if isinstance(value, list) else value
        assert row[key] == value or (value is None and row[key] != row[key]), key
    assert row["scene"] == unbroken.member(5).hash
    history = unbroken.histories(5)["strain_J"].to_numpy()
    assert (history == again.history["strain_J"].astype("float32")).all()


def test_a_whole_result_is_kept_of_chosen_members(unbroken: Sweep) -> None:
    kept = tf.load(unbroken.run_folder(3))
    assert kept.scene == unbroken.member(3).scene
    assert kept.summary["steps"] == unbroken.to_pandas()["steps"][3]


def test_two_workers_write_what_one_process_writes(unbroken: Sweep, tmp_path: Path) -> None:
    found = tf.sweep({**REAL, "chunk": 1}, tmp_path / "s", workers=2)
    assert found.standing == unbroken.standing
    assert len(sweeps.chunk_files(tmp_path / "s")) == 8
    # the plan says that the chunks are smaller, and nothing else differs
    assert sweeps.compare(unbroken.folder, tmp_path / "s") == ["sweep.json"]


@contextlib.contextmanager
def cluster(scratch: Path) -> Iterator[tuple[subprocess.Popen, str]]:
    """A scheduler and a worker with two threads, as processes of their own; its address."""
    told = scratch / "scheduler.json"
    dask, where = [sys.executable, "-m", "dask"], ["--scheduler-file", str(told)]
    serving = [*dask, "scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard", *where]
    with sweeps.started(serving) as scheduler:
        while not told.exists():
            time.sleep(0.1)
        working = [
            *dask, "worker", "--nthreads", "2", "--no-dashboard", "--death-timeout", "60",
            "--host", "127.0.0.1", "--local-directory", str(scratch), *where,
        ]  # fmt: skip
        with sweeps.started(working):
            yield scheduler, json.loads(told.read_text(encoding="utf-8"))["address"]


def test_a_cluster_that_runs_already_writes_the_same_until_it_is_lost(
    unbroken: Sweep, tmp_path: Path
) -> None:
    """Its worker has two threads, of which one at a time may call Taichi."""
    with cluster(tmp_path) as (scheduler, address):
        found = tf.sweep(REAL, tmp_path / "s", scheduler=address)
        assert found.standing == unbroken.standing
        assert sweeps.compare(unbroken.folder, tmp_path / "s") == []

        script = Path(__file__).with_name("slow_sweep.py")
        client = subprocess.Popen(
            [sys.executable, str(script), str(tmp_path / "t"), address],
            stderr=subprocess.PIPE, text=True, env=sweeps.environment(),
        )  # fmt: skip
        wait_for_chunks(tmp_path / "t", 2)
        scheduler.kill()
        _, err = client.communicate(timeout=60)
    assert client.returncode == 1, err
    assert len(err.splitlines()) == 1, err
    (line,) = err.splitlines()
    assert line.startswith("error: the scheduler no longer answers; what is complete is in ")
    half = Sweep.open(tmp_path / "t")
    # the worker may have completed a chunk after its scheduler, and the client, had gone
    assert 4 <= len(half.to_pandas()) <= half.standing.done < 40
    assert tf.sweep(PLAN, tmp_path / "t", solve=Solver()).standing.done == 40


def test_nobody_at_the_address_of_a_scheduler(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("taichi_foam.sweeps.compute._PATIENCE", 1)
    with pytest.raises(UserError, match=r"tcp://127\.0\.0\.1:9: does not answer"):
        tf.sweep(REAL, tmp_path / "s", scheduler="tcp://127.0.0.1:9")
    assert not any(path.name == "lock" for path in (tmp_path / "s").iterdir())


def wait_for_chunks(folder: Path, count: int) -> None:
    until(lambda: len(sweeps.chunk_files(folder)) >= count, "no chunk comes")


def test_sigkill_of_a_worker_and_of_the_client_costs_only_what_was_in_flight(
    tmp_path: Path,
) -> None:
    script = [sys.executable, str(Path(__file__).with_name("slow_sweep.py")), str(tmp_path / "s")]
    with sweeps.started(script) as client:  # sees to it that nothing of it lives on
        wait_for_chunks(tmp_path / "s", 2)
        os.kill(sweeps.workers_of(client.pid)[0], signal.SIGKILL)
        wait_for_chunks(tmp_path / "s", 6)
        os.kill(client.pid, signal.SIGKILL)
        client.wait()
    before = sweeps.chunk_files(tmp_path / "s")
    assert 6 <= len(before) < 20
    solver = Solver()
    whole = tf.sweep(PLAN, tmp_path / "s", solve=solver)
    after = sweeps.chunk_files(tmp_path / "s")
    assert {name: after[name] for name in before} == before
    assert len(solver.asked) == 40 - 2 * len(before)
    other = tf.sweep(PLAN, tmp_path / "t", solve=Solver())
    assert whole.standing == other.standing
    assert sweeps.compare(tmp_path / "t", tmp_path / "s") == []


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="asks the system to see to it")
def test_a_worker_that_lets_no_thread_run_ends_with_its_client(tmp_path: Path) -> None:
    """As one that compiles a kernel, which takes a minute on a busy machine."""
    holds = tmp_path / "holds"
    client = subprocess.Popen(
        [sys.executable, str(Path(__file__).with_name("slow_sweep.py")), str(tmp_path / "s")],
        stderr=subprocess.DEVNULL, start_new_session=True,
        env={**sweeps.environment(), "HOLD": str(holds)},
    )  # fmt: skip
    until(holds.exists, "no worker has begun")
    workers = sweeps.workers_of(client.pid)
    os.kill(client.pid, signal.SIGKILL)
    client.wait()

    def left() -> set[int]:
        return set(workers) & set(sweeps.session(client.pid))

    try:
        until(lambda: not left(), "a worker goes on alone", patience=5)
    finally:
        for pid in left():
            os.kill(pid, signal.SIGKILL)


class Deadly(Solver):
    """Ends its process at a certain velocity, as a fault of a library would."""

    def __call__(self, scenes: Sequence[Scene]) -> Iterator[tuple[int, Result]]:
        if any(scene.impactor.velocity == 2.5 for scene in scenes):
            os._exit(139)
        return super().__call__(scenes)


def test_a_chunk_that_kills_its_worker_is_given_up_and_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("taichi_foam.sweeps.compute._MOST_DEATHS", 2)
    plan = plan_of(axis(count=9))
    with pytest.raises(RunError, match="1 chunk could not be computed"):
        tf.sweep(plan, tmp_path / "s", workers=1, solve=Deadly())
    found = Sweep.open(tmp_path / "s")
    assert (found.standing.done, found.standing.lost) == (7, 2)
    assert found.lost()[range(2, 4)].startswith("its worker died 2 times")
    whole = tf.sweep(plan, tmp_path / "s", solve=Solver())
    assert (whole.standing.done, whole.standing.lost) == (9, 0)
    assert not list((tmp_path / "s" / "lost").iterdir())


def test_ctrl_c_at_a_terminal_ends_client_and_workers_with_130(tmp_path: Path) -> None:
    plan = tmp_path / "plan.toml"
    plan.write_text(
        'scene = "paper/wedge-2.86"\nchunk = 1\n'
        'set = {"block.columns" = 40, "block.rows" = 20}\n'
        '[[axes]]\nkey = "impactor.velocity"\nfrom = 2.0\nto = 4.0\ncount = 500\n'
    )
    words = sweeps.command(plan, tmp_path / "s", ["--workers", "1"])
    client = subprocess.Popen(
        words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        start_new_session=True, env=sweeps.environment(),
    )  # fmt: skip
    until(lambda: sweeps.workers_of(client.pid), "no worker is started")
    os.killpg(client.pid, signal.SIGINT)
    out, err = client.communicate(timeout=60)
    assert client.returncode == 130, err
    assert out == ""
    (line,) = err.splitlines()
    assert line.startswith("interrupted: 0 of 500 drops are in ")
    assert line.endswith("; the same command continues")
    assert sorted(path.name for path in (tmp_path / "s").iterdir()) == ["chunks", "sweep.json"]
    until(lambda: not sweeps.session(client.pid), "a process lives on", sweeps.PATIENCE_S)
