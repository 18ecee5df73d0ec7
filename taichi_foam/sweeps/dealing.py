"""The cost of drops: it determines the sizes of chunks, and the estimate for a sweep.

A chunk is a range of consecutive members. Its size affects only how much is lost when a worker is
killed: a drop's numbers do not depend on its chunk.
"""

from __future__ import annotations

import contextlib
import math
import os
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from taichi_foam.errors import UserError
from taichi_foam.records.history import HISTORY_COLUMNS
from taichi_foam.results.folders import check_writable, explained
from taichi_foam.results.result import Result, storage_bytes
from taichi_foam.scene import Scene
from taichi_foam.sweeps.plan import work
from taichi_foam.sweeps.sampling import Design
from taichi_foam.sweeps.store import MARK

Solve = Callable[..., Iterable[tuple[int, Result]]]
"""Computes a sequence of scenes, yielding each one's index and result as it ends.

For impacts on blocks that have been hit before, it is also given `after`, as `simulate_many` takes
it.
"""

LIMIT_S = 30.0
"""Longest time that a chunk of several drops should take [s]; a kill loses no more per worker."""

# Target time of a chunk: drops vary in length, and machines may be busy.
_AIM_S = LIMIT_S / 2
# Chunk sizes stay while their times lie between these: each batch size needs its own kernels.
_KEPT_S = (_AIM_S / 3, LIMIT_S * 0.75)

# Work of a first chunk on one core [node steps]: a quarter of the limit on a core of about 2020.
_FIRST_WORK = 1e8

MOST = 256
"""Most drops of a chunk whose size is not given: the overhead per chunk is then negligible."""

TRIED = 2
"""Drops of a trial, at most."""

# A chunk has at most this many times the drops of earlier chunks that kept the limit.
_GROWTH = 4

# Number of members sampled for a mean.
_LOOKED_AT = 200

# Bytes of a row in its shard, results.parquet and results.csv together; overhead of a shard.
_ROW, _SHARD = 2_000, 40_000


class Dealer:
    """Divides the missing members into chunks, sized by the times that earlier ones took."""

    def __init__(
        self, design: Design, missing: Sequence[range], side_by_side: int = 1, workers: int = 1
    ) -> None:
        """
        Args:
            design: the drops of the sweep.
            missing: ranges of members to be computed, in order.
            side_by_side: number of drops that a worker computes together in the time of one.
            workers: number of workers; each gets work from the start.
        """
        self._design = design
        self._missing = list(missing)[::-1]
        most = min(design.plan.chunk or MOST, -(-sum(map(len, missing)) // workers))
        self._most = max(1, most)
        self._least = min(side_by_side, self._most)
        self._first_work = _FIRST_WORK * side_by_side
        self._size = 0
        self._pace: float | None = None  # seconds per node step

    def next(self) -> range | None:
        """The next chunk; None if there are no more."""
        if not self._missing:
            return None
        row = self._missing.pop()
        size = self._evenly(row, self._sized(self._work(row[0])))
        last = self._work(row[size - 1])
        if last > self._work(row[0]):  # larger lattices begin in it
            size = min(size, self._evenly(row, self._sized(last)))
        if len(row) > size:
            self._missing.append(row[size:])
        return row[:size]

    def learn(self, chunk: range, seconds: float) -> None:
        """Use the time that a chunk has taken, without compiling its kernels [s]."""
        self._size = max(self._size, len(chunk))
        self._pace = seconds / (len(chunk) * self._work(chunk[0], chunk[-1]))

    def _sized(self, each: float) -> int:
        """Drops in the next chunk, at `each` node steps per drop: a power of two, or a limit."""
        if self._pace is None:
            wanted = self._first_work / each
        else:
            pace = max(self._pace * each, 1e-9)
            if _KEPT_S[0] <= self._size * pace <= _KEPT_S[1]:
                wanted = self._size
            else:
                wanted = min(_AIM_S / pace, _GROWTH * self._size)
        size = 1 << math.floor(math.log2(max(1.0, min(wanted, MOST))))
        return max(self._least, min(size, self._most))

    def _evenly(self, row: range, size: int) -> int:
        """The size that divides the row into equal chunks, as many as `size` would give."""
        return -(-len(row) // -(-len(row) // size))

    def _work(self, *numbers: int) -> float:
        """Mean work of members [node steps]; zero for values that make an invalid scene."""
        total = 0.0
        for number in numbers:
            with contextlib.suppress(UserError):
                total += work(self._design.member(number).scene) * self._design.plan.impacts
        return max(1.0, total / len(numbers))


@dataclass(frozen=True)
class Estimate:
    """Cost of a sweep: drops, bytes on disk, and seconds on one core if there was a trial."""

    drops: int
    bytes: int
    core_seconds: float | None = None


def room(design: Design) -> Estimate:
    """Number of drops of a sweep, and an upper bound on its disk space (before compression)."""
    plan, size = design.plan, 0.0
    some = _some(design, _LOOKED_AT)
    if plan.keep.has_histories:
        width = 4 if plan.keep.histories == "float32" else 8
        rows = np.mean([scene.most_rows for scene in some])
        size += len(design) * plan.impacts * rows * (8 + width * len(HISTORY_COLUMNS))
    full = len(design) if plan.keep.full == "all" else len(plan.keep.full)
    size += full * plan.impacts * float(np.mean([storage_bytes(scene) for scene in some]))
    # upper estimate of the number of chunks: that on one core, if they never grow
    first = Dealer(design, [range(len(design))]).next() or range(1)
    size += _ROW * len(design) * plan.impacts + _SHARD * math.ceil(len(design) / len(first))
    return Estimate(len(design) * plan.impacts, int(size))


def trial(design: Design, solve: Solve, on_drop: Callable[[], None]) -> Estimate:
    """As `room`, with the time, extrapolated from `TRIED` drops by the work of their scenes.

    `solve` is called for each of these drops separately. A first call, which compiles kernels, is
    not counted.
    """
    found = room(design)
    chosen = _some(design, TRIED)
    paces = []
    for count, scene in enumerate([chosen[0], *chosen]):
        begun = time.perf_counter()
        for _, result in solve([scene]):
            _ = result.summary
        if count:
            paces.append((time.perf_counter() - begun) / work(scene))
            on_drop()
    mean = float(np.mean([work(scene) for scene in _some(design, _LOOKED_AT)]))
    seconds = len(design) * design.plan.impacts * mean * float(np.mean(paces))
    return Estimate(found.drops, found.bytes, seconds)


def check_room(folder: Path, design: Design) -> None:
    """Raise UserError if the disk cannot hold a sweep; the space it already takes is included."""
    there = bytes_in(folder) if (folder / MARK).is_file() else 0
    with explained(folder):
        check_writable(folder, room(design).bytes, "the sweep", "or keep less", there)


def bytes_in(folder: Path) -> int:
    """Disk space of a folder."""
    return sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())


def cores(workers: int | None, threads: int | None) -> int:
    """Number of cores of this machine in use."""
    here = os.cpu_count() or 1
    return min(here, (workers or 1) * (threads or (1 if workers else here)))


def _some(design: Design, most: int) -> list[Scene]:
    """Scenes of evenly spread members; invalid ones are left out."""
    scenes = []
    for number in design.spread(most):
        with contextlib.suppress(UserError):
            scenes.append(design.member(number).scene)
    if not scenes:
        design.member(0)  # raises the error
    return scenes
