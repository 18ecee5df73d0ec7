"""What a sweep costs besides its drops, and what it survives.

    python benchmarks/sweeps.py                 # 100,000 drops that only wait, on 8 workers
    python benchmarks/sweeps.py --real 1000     # drops of the paper's block, beside simulate_many
    python benchmarks/sweeps.py --chart         # a cushion chart, beside simulate_many
    python benchmarks/sweeps.py --kills 10      # SIGKILL at random instants, then continued

The first gives figures of scheduling alone: its solver sleeps, for times that are log-normal.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import psutil
import pyarrow as pa
import pyarrow.parquet as pq
from rich.console import Console

import taichi_foam as tf
from taichi_foam.cushions.scenes import cushion_scene
from taichi_foam.records.history import HISTORY_COLUMNS, History
from taichi_foam.results.result import Result
from taichi_foam.scene import Scene
from taichi_foam.simulation.progress import Bars
from taichi_foam.simulation.simulate import simulate_many
from taichi_foam.sweeps.dealing import bytes_in
from taichi_foam.sweeps.table import MACHINE

# Durations of drops that only wait: exp(N(log median, sigma)).
MEDIAN_S, SIGMA = 5e-3, 1.0

PATIENCE_S = 20.0
"""How long a worker may live on without its client: a kernel that compiles cannot be left."""

FIGURES = 25
"""Measures of a drop that only waits, about as many as a real one has."""


class Waited(Result):
    """A drop that was not computed."""

    @property
    def summary(self) -> dict[str, Any]:
        """Figures without a meaning."""
        assert self.scene.impactor is not None
        return {f"figure_{n}": self.scene.impactor.velocity * n for n in range(FIGURES)}


@dataclass(frozen=True)
class Waiting:
    """Sleeps instead of computing, for a time that the scene decides."""

    scale: float = 1.0

    def __call__(self, scenes: Sequence[Scene]) -> Iterator[tuple[int, Result]]:
        empty = History({name: np.zeros(1) for name in HISTORY_COLUMNS})
        for place, scene in enumerate(scenes):
            time.sleep(self.scale * duration(scene))
            yield place, Waited(scene, empty, [], {"ended_by": "end time"})


def duration(scene: Scene) -> float:
    """How long a drop that only waits takes [s], log-normal over velocities."""
    assert scene.impactor is not None
    velocity = int(1e9 * scene.impactor.velocity)
    return float(MEDIAN_S * np.exp(SIGMA * np.random.default_rng(velocity).standard_normal()))


@contextmanager
def memory(every: float = 0.2) -> Iterator[list[float]]:
    """Resident memory of this process [MB], as it was every so often."""
    seen: list[float] = []
    ended = threading.Event()

    def look() -> None:
        while not ended.wait(every):
            seen.append(psutil.Process().memory_info().rss / 1e6)

    thread = threading.Thread(target=look, daemon=True)
    thread.start()
    try:
        yield seen
    finally:
        ended.set()
        thread.join()


def growth(seen: Sequence[float]) -> str:
    """Memory over the middle of a run: its first tenth and its last."""
    if len(seen) < 10:
        return "too short to say"
    tenth = len(seen) // 10
    first, last = np.mean(seen[tenth : 2 * tenth]), np.mean(seen[-2 * tenth : -tenth])
    return f"{first:.0f} MB after a tenth, {last:.0f} MB near the end, {max(seen):.0f} MB at most"


def scheduling(drops: int, workers: int, chunk: int | None, folder: Path) -> None:
    """Drops that only wait: what all else takes."""
    plan = {
        "scene": "paper/wedge-2.86",
        "axes": [{"key": "impactor.velocity", "from": 1.0, "to": 5.0, "count": drops}],
        "chunk": chunk or 64,
    }
    velocities = np.linspace(1.0, 5.0, drops)
    scene = tf.paper_scene("paper/wedge-2.86")
    shown = velocities[:: max(1, drops // 1000)]
    mean = np.mean([duration(scene.with_values(impactor__velocity=float(v))) for v in shown])
    ideal = float(mean) * drops / workers
    begun = time.perf_counter()
    with memory() as seen:
        done = tf.sweep(
            plan, folder, workers=workers, solve=Waiting(), bars=Bars(Console(stderr=True))
        )
    took = time.perf_counter() - begun
    assert done.standing.done == drops
    begun = time.perf_counter()
    tf.sweep(plan, folder, workers=workers, solve=Waiting())
    again = time.perf_counter() - begun
    chunks = len(done.finished())
    files = sum(1 for path in folder.rglob("*") if path.is_file())
    print(
        f"{drops:,} drops that only wait, {MEDIAN_S * 1e3:g} ms in the median, in {chunks:,} "
        f"chunks on {workers} workers of {os.cpu_count()} cores (figures of scheduling):\n"
        f"  {took:.1f} s; the waits alone {ideal:.1f} s; "
        f"{1e3 * (took - ideal) * workers / drops:.2f} ms of a worker more for each drop\n"
        f"  client and scheduler: {growth(seen)}\n"
        f"  the same call again, all being there: {again:.1f} s\n"
        f"  {files:,} files, {bytes_in(folder) / 1e6:.1f} MB"
    )


def real(drops: int, rows: int, folder: Path) -> None:
    """Real drops, three shapes with velocities and masses, beside `simulate_many`."""
    shapes = ["flat", "cylinder", "wedge"]
    plan = {
        "scene": "paper/wedge-2.86",
        "set": {"block.columns": 2 * rows, "block.rows": rows, "impactor.mass": 3.0},
        "axes": [
            {"key": "impactor.shape", "values": shapes},
            {"key": "impactor.velocity", "from": 2.0, "to": 3.5},
            {"key": "impactor.mass", "from": 3.0, "to": 6.0},
        ],
        "sample": {"method": "latin-hypercube", "count": -(-drops // len(shapes))},
    }
    from taichi_foam.sweeps.plan import Plan
    from taichi_foam.sweeps.sampling import Design

    design = Design(Plan.load(plan))
    scenes = [design.member(number).scene for number in range(len(design))]
    # kernels of every shape, for the sizes of batches that come
    for start in range(len(shapes)):
        first = start * (len(scenes) // len(shapes))
        some = [s.with_values(numerics__end=2e-3) for s in scenes[first : first + 64]]
        for _ in simulate_many(some):
            pass
    begun, begun_cpu = time.perf_counter(), time.process_time()
    for _ in simulate_many(scenes):
        pass
    alone, alone_cpu = time.perf_counter() - begun, time.process_time() - begun_cpu
    begun, begun_cpu = time.perf_counter(), time.process_time()
    with memory() as seen:
        done = tf.sweep(plan, folder, bars=Bars(Console(stderr=True)))
    took, cpu = time.perf_counter() - begun, time.process_time() - begun_cpu
    assert done.standing.done == len(scenes)
    print(
        f"{len(scenes):,} drops of {2 * rows} x {rows} mass points, in "
        f"{len(done.finished())} chunks, in this process:\n"
        f"  simulate_many {alone:.1f} s, the sweep {took:.1f} s: {took / alone:.3f} times\n"
        f"  processor time {alone_cpu:.1f} s and {cpu:.1f} s: {cpu / alone_cpu:.3f} times\n"
        f"  memory: {growth(seen)}"
    )


THICKNESSES = [0.03, 0.04, 0.05, 0.065, 0.08]
FOAM = Path(__file__).parents[1] / "scenes" / "own_foam.csv"


def chart(
    rounds: int, runs: int, points: int, folder: Path, thicknesses: Sequence[float] = THICKNESSES
) -> None:
    """A chart with its files, and its drops at once through `simulate_many`, in turns."""
    ask = {"foam": FOAM, "thickness": thicknesses, "drop_height": 0.76}
    tf.cushion_curve(**ask, runs=1, points=3)  # kernels
    shares = []
    for number in range(rounds):
        out = folder / f"chart-{number}"
        begun, begun_cpu = time.perf_counter(), time.process_time()
        found = tf.cushion_curve(**ask, runs=runs, points=points, out=out, bars=Bars())
        took, cpu = time.perf_counter() - begun, time.process_time() - begun_cpu
        begun = time.perf_counter()
        scenes = [
            cushion_scene(FOAM, drop.pad.thickness, drop.pad.drop_height, drop.static_stress)
            .with_values(impactor__velocity=drop.velocity, impactor__drop_height=None)
            for drop in found.drops
        ]  # fmt: skip
        built = time.perf_counter() - begun
        begun, begun_cpu = time.perf_counter(), time.process_time()
        for _ in simulate_many(scenes):
            pass
        alone, alone_cpu = time.perf_counter() - begun, time.process_time() - begun_cpu
        shares.append((took / alone, cpu / alone_cpu, took / (built + alone)))
        print(
            f"{len(scenes)} drops: the chart with its files {took:.1f} s (processor {cpu:.1f} s), "
            f"simulate_many {alone:.1f} s ({alone_cpu:.1f} s), building its scenes {built:.1f} s",
            flush=True,
        )
    wall, cpu, with_scenes = np.median(shares, axis=0)
    print(
        f"the chart over simulate_many: {wall:.3f} times, in processor time {cpu:.3f} times; over "
        f"simulate_many and building its scenes {with_scenes:.3f} times"
    )


KILL_PLAN = """
scene = "paper/wedge-2.86"
set = {"block.columns" = 20, "block.rows" = 10}
chunk = 2
[[axes]]
key = "impactor.velocity"
from = 2.0
to = 4.0
count = DROPS
[keep]
histories = "float32"
full = [1]
"""


def kills(count: int, drops: int, folder: Path, seed: int) -> None:
    """SIGKILL of clients, schedulers and workers at random instants; then the sweep continued."""
    plan = folder / "plan.toml"
    plan.write_text(KILL_PLAN.replace("DROPS", str(drops)), encoding="utf-8")
    begun = time.perf_counter()
    run_to_end(plan, folder / "unbroken", [])
    print(f"unbroken, in one process: {time.perf_counter() - begun:.1f} s", flush=True)
    draw = random.Random(seed)
    out = folder / "killed"
    told = {"client": kill_client, "worker": kill_worker, "scheduler": kill_scheduler}
    for number in range(count):
        victim = tuple(told)[number % 3]
        # any instant, the start among them, or one at which chunks come
        moment = Moment(draw.random() < 0.7, draw.uniform(0.3, 6.0))
        before = chunk_files(out)
        told[victim](plan, out, moment)
        after = chunk_files(out)
        again = [name for name, found in before.items() if after.get(name) != found]
        assert not again, f"computed twice: {again}"
        print(f"kill {number + 1}: {victim}; {len(before)} chunks, {len(after)} now", flush=True)
    before = chunk_files(out)
    run_to_end(plan, out, ["--workers", "2"])
    after = chunk_files(out)
    assert all(after[name] == found for name, found in before.items()), "computed twice"
    differences = compare(folder / "unbroken", out)
    assert not differences, differences
    print(f"{count} kills: bit-identical to the unbroken sweep, no chunk twice, nothing left over")


def command(plan: Path, out: Path, options: Sequence[str]) -> list[str]:
    return [
        sys.executable, "-m", "taichi_foam", "sweep", str(plan), "--out", str(out), *options,
    ]  # fmt: skip


def run_to_end(plan: Path, out: Path, options: Sequence[str]) -> None:
    done = subprocess.run(
        command(plan, out, options), capture_output=True, text=True, check=False, env=environment()
    )
    assert done.returncode == 0, done.stderr


def environment() -> dict[str, str]:
    return {**os.environ, "PYTHONPATH": str(Path(tf.__file__).parents[1])}


@contextmanager
def started(words: Sequence[str]) -> Iterator[subprocess.Popen]:
    """A process in a session of its own; whatever is left of the session is an error."""
    process = subprocess.Popen(
        words, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True,
        env=environment(),
    )  # fmt: skip
    try:
        yield process
    finally:
        process.kill()
        process.wait()
        begun = time.perf_counter()
        while (left := session(process.pid)) and time.perf_counter() - begun < PATIENCE_S:
            time.sleep(0.2)
        for pid in left:
            os.kill(pid, signal.SIGKILL)
        assert not left, f"processes outlive the one that started them: {left}"


def session(leader: int) -> list[int]:
    """The living processes of a session."""
    found = []
    for process in psutil.process_iter():
        with suppress(ProcessLookupError, psutil.NoSuchProcess):  # it has ended meanwhile
            if os.getsid(process.pid) == leader and process.status() != psutil.STATUS_ZOMBIE:
                found.append(process.pid)
    return found


def workers_of(leader: int) -> list[int]:
    """The processes of a session in which Dask computes."""
    found = []
    for pid in session(leader):
        with suppress(psutil.NoSuchProcess):
            if "spawn_main" in " ".join(psutil.Process(pid).cmdline()):
                found.append(pid)
    return found


@dataclass(frozen=True)
class Moment:
    """When to kill: so many seconds [s] after the start, or after the first new chunk."""

    after_news: bool
    seconds: float

    def wait(self, client: subprocess.Popen, out: Path) -> None:
        there = len(chunk_files(out))
        while self.after_news and client.poll() is None and len(chunk_files(out)) == there:
            time.sleep(0.02)
        sleep_or_end(client, self.seconds)


def kill_client(plan: Path, out: Path, moment: Moment) -> None:
    with started(command(plan, out, ["--workers", "2"])) as client:
        moment.wait(client, out)


def kill_worker(plan: Path, out: Path, moment: Moment) -> None:
    """One of two, and some seconds later the client, too."""
    with started(command(plan, out, ["--workers", "2"])) as client:
        moment.wait(client, out)
        for pid in workers_of(client.pid)[:1]:
            os.kill(pid, signal.SIGKILL)
        sleep_or_end(client, moment.seconds)  # Dask gives its chunk to another


def kill_scheduler(plan: Path, out: Path, moment: Moment) -> None:
    """Scheduler and workers as processes of their own, as on a cluster."""
    dask = [sys.executable, "-m", "dask"]
    with tempfile.TemporaryDirectory() as scratch:
        told = Path(scratch) / "scheduler.json"
        where = ["--scheduler-file", str(told)]
        with started(
            [*dask, "scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard", *where]
        ) as scheduler:
            while not told.exists():
                time.sleep(0.1)
            worker = [
                *dask, "worker", "--nthreads", "1", "--nworkers", "2", "--no-dashboard",
                "--death-timeout", "60", "--host", "127.0.0.1", "--local-directory", scratch,
                *where,
            ]  # fmt: skip
            address = json.loads(told.read_text(encoding="utf-8"))["address"]
            with (
                started(worker) as workers,
                started(command(plan, out, ["--scheduler", address])) as client,
            ):
                moment.wait(client, out)
                scheduler.kill()
                client.wait(timeout=60)  # it says that the scheduler is gone
                workers.wait(timeout=120)


def sleep_or_end(process: subprocess.Popen, seconds: float) -> None:
    try:
        process.wait(timeout=seconds)
    except subprocess.TimeoutExpired:
        return


def chunk_files(out: Path) -> dict[str, tuple[int, int]]:
    """The chunks that are complete, each with what tells that it was not written again."""
    folder = out / "chunks"
    if not folder.is_dir():
        return {}
    return {
        path.name: (path.stat().st_ino, path.stat().st_mtime_ns)
        for path in folder.iterdir()
        if not path.name.startswith(".")
    }


# Files with wall times in them; the numbers of the first are those of the Parquet file.
_TIMED = ("results.csv", "summary.json", "manifest.json")


def compare(one: Path, other: Path) -> list[str]:
    """In what two sweeps differ on disk, wall times and where their chunks end apart."""
    names, others = _names(one), _names(other)
    found = [f"only in one: {name}" for name in sorted(names ^ others)]
    if not _histories(one).equals(_histories(other)):
        found.append("histories")
    for name in sorted(names & others):
        first, second = one / name, other / name
        if name.endswith(".parquet"):
            same = _stable(first).equals(_stable(second))
        elif first.is_dir() or first.name in _TIMED:
            continue
        else:
            same = first.read_bytes() == second.read_bytes()
        if not same:
            found.append(name)
    return found


def _names(folder: Path) -> set[str]:
    """All that a sweep has on disk but its chunks, whose rows are in results.parquet, too."""
    names = {str(path.relative_to(folder)) for path in folder.rglob("*")}
    return {name for name in names if not name.startswith(("chunks/", "histories/"))}


def _histories(folder: Path) -> pa.Table:
    """Those of all members in one table."""
    paths = sorted((folder / "histories").glob("*.parquet"))
    return pa.concat_tables(map(pq.read_table, paths)) if paths else pa.table({})


def _stable(path: Path) -> Any:
    table = pq.read_table(path)
    return table.drop_columns([name for name in MACHINE if name in table.column_names])


def main() -> None:
    """Measure what is asked for, and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--drops", type=int, default=100_000, help="that only wait")
    parser.add_argument("--workers", type=int, default=8, help="for these")
    parser.add_argument("--chunk", type=int, help="drops of a task, for these; default 64")
    parser.add_argument("--real", type=int, metavar="N", help="N real drops instead")
    parser.add_argument("--rows", type=int, default=20, help="of their lattices")
    parser.add_argument("--chart", action="store_true", help="a chart of 200 drops instead")
    parser.add_argument("--rounds", type=int, default=3, help="of the chart")
    parser.add_argument("--kills", type=int, metavar="N", help="N kills instead")
    parser.add_argument("--seed", type=int, default=0, help="of the instants of kills")
    parser.add_argument("--folder", type=Path, help="to work in; default a temporary one")
    parser.add_argument("--smoke", action="store_true", help="a few drops of everything")
    options = parser.parse_args()
    folder = options.folder or Path(tempfile.mkdtemp(prefix="sweeps-"))
    folder.mkdir(parents=True, exist_ok=True)
    try:
        if options.smoke:
            scheduling(100, 2, 10, folder / "waiting")
            real(3, 5, folder / "real")
            chart(1, 1, 3, folder, THICKNESSES[:1])
        elif options.real:
            real(options.real, options.rows, folder / "real")
        elif options.chart:
            chart(options.rounds, 4, 10, folder)
        elif options.kills:
            kills(options.kills, 300, folder, options.seed)
        else:
            scheduling(options.drops, options.workers, options.chunk, folder / "waiting")
    finally:
        if options.folder is None:
            shutil.rmtree(folder, ignore_errors=True)


if __name__ == "__main__":
    main()
