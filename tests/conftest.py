"""What every test may share: one Taichi runtime for the whole session, and what is made by hand.

Hand-made histories and lattices have answers that are known without a simulation.
"""

from __future__ import annotations

import gc
import os
import signal
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import taichi as ti

from taichi_foam.engine import effort, lattice, layout, runtime
from taichi_foam.picture import annotate, inset, raster
from taichi_foam.records.history import HISTORY_COLUMNS
from taichi_foam.records.snapshot import Snapshot
from taichi_foam.results.result import Result
from taichi_foam.scene import Block, FlatBlock, Scene

MakeSnapshot = Callable[..., Snapshot]
MakeResult = Callable[..., Result]

# The tests use many lattices, most of them again and again. Nearly all of them, and batches, have
# the same room, so that what is compiled for one serves the others.
lattice.MOST_IDLE = 10_000
layout.ROOM_LATTICES = (16, 64)
layout.ROOM_COLUMNS, layout.ROOM_PACKS = 96, 12
effort.PAYS_AFTER = effort.PAYS_FROM = float("inf")  # for none of them do all passes pay

# Each test has one core or so. Processes that tests start use no other for linear algebra: threads
# that wait for such work are busy.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# A shell that starts a job in the background has it ignore Ctrl-C, `nohup` has it ignore a hang-up,
# and so all that these start; the tests of both need them.
signal.signal(signal.SIGINT, signal.default_int_handler)
if hasattr(signal, "SIGHUP"):
    signal.signal(signal.SIGHUP, signal.SIG_DFL)


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    """Deal each worker of `-n` one long run of neighbouring tests; who is done first takes more.

    Neighbours need the same kernels and fixtures. pytest-xdist by itself deals out handfuls: every
    worker then compiles nearly every kernel and makes nearly every fixture.
    """
    if config.getoption("dist") != "load":
        return None  # somebody has chosen otherwise
    from xdist.scheduler import WorkStealingScheduling

    return WorkStealingScheduling(config, log)


# Folders and files whose tests step lattices in this process: half of all the time, most of it
# compiling. Hardly any of FIRST has the kernels of one of LAST.
TESTS = Path(__file__).parent
FIRST = ("analysis", "conservation", "engine", "scenes", "simulation", "picture")
LAST = ("test_peers.py", "test_gpu.py", "laws", "validation", "live")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Order the tests so that two workers, who begin at the start and half way, share few kernels.

    What one of them has left when the other is done lies between, where nothing is compiled.
    """

    def place(item: pytest.Item) -> int:
        # LAST is asked first: the device's file lies in the engine's folder
        for names, begin in ((LAST, len(FIRST) + 1), (FIRST, 0)):
            for n, name in enumerate(names):
                if name in item.path.relative_to(TESTS).parts:
                    return begin + n
        return len(FIRST)

    items.sort(key=place)


@pytest.fixture(scope="session", autouse=True)
def taichi_runtime() -> None:
    """Start Taichi as a run would, in the thread that computes: no other one can make fields.

    It is the one that first lets Taichi compute, not the one that first asks for it. Once in each
    process: with pytest-xdist every worker has its own runtime and its own fields.
    """
    runtime.start()
    ti.sync()


def intact_snapshot(block: Block) -> Snapshot:
    """The block at rest and unbroken at t = 0."""
    columns, rows = block.columns, block.rows
    position = block.positions
    return Snapshot(
        time=0.0,
        impactor_y=float(position[..., 1].max()),
        position=position,
        velocity=np.zeros_like(position),
        e_min_a=np.zeros((columns - 1, rows)),
        e_min_b=np.zeros((columns, rows - 1)),
        break_time_a=np.full((columns - 1, rows), np.nan),
        break_time_b=np.full((columns, rows - 1), np.nan),
        shear_set=np.zeros((columns - 1, rows - 1)),
    )


@pytest.fixture
def quick_collections() -> Iterator[None]:
    """`gc.collect()` looks at what the test itself makes only, not at all of a long session's."""
    gc.collect()
    gc.freeze()
    yield
    gc.unfreeze()


@pytest.fixture
def make_snapshot() -> MakeSnapshot:
    def make(
        block: Block,
        a: Iterable[tuple[int, int]] = (),
        b: Iterable[tuple[int, int]] = (),
        times: Callable[[int, int], float] = lambda i, j: 1e-3,
        **fields: Any,
    ) -> Snapshot:
        """An undeformed block with the bonds A in `a` and B in `b` broken at `times`."""
        snapshot = replace(intact_snapshot(block), **fields)
        for array, broken in ((snapshot.break_time_a, a), (snapshot.break_time_b, b)):
            for i, j in broken:
                array[i, j] = times(i, j)
        return snapshot

    return make


@pytest.fixture
def make_result() -> MakeResult:
    def make(
        scene: Scene | None = None,
        time: Any = (0.0, 1e-4),
        snapshots: Iterable[Snapshot] = (),
        run: dict[str, Any] | None = None,
        **columns: Any,
    ) -> Result:
        """A result with the given history columns, the others zero."""
        time = np.asarray(time, dtype=float)
        history = {name: np.zeros_like(time) for name in HISTORY_COLUMNS}
        history["time_s"] = time
        for name, values in columns.items():
            history[name] = np.broadcast_to(np.asarray(values, dtype=float), time.shape).copy()
        scene = scene or Scene(name="hand-made", impactor=FlatBlock())
        return Result(scene, history, list(snapshots), run or {})

    return make


@pytest.fixture
def written(monkeypatch: pytest.MonkeyPatch) -> Iterator[list]:
    """(picture, words, box) of every text that is written."""
    texts: list[tuple[np.ndarray, str, tuple[float, float, float, float]]] = []
    write = annotate.write

    def record(image, xy, string, face, *, anchor="ls", colour=(0, 0, 0)) -> None:
        left, top, right, bottom = face.getbbox(string, anchor=anchor)
        x, y = round(xy[0]), round(xy[1])
        texts.append((image, string, (x + left, y + top, x + right, y + bottom)))
        write(image, xy, string, face, anchor=anchor, colour=colour)

    monkeypatch.setattr(annotate, "write", record)
    inset._panel.cache_clear()
    raster._page.cache_clear()
    yield texts
    inset._panel.cache_clear()
    raster._page.cache_clear()
