"""What drops take: chunks of about so long each are dealt out by it, and a sweep is estimated.

A chunk is a row of consecutive members. Nothing but how much a kill loses hangs on where it ends:
a drop has the same numbers in any.
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
from taichi_foam.sweeps.plan import Plan, work
from taichi_foam.sweeps.sampling import Design
from taichi_foam.sweeps.store import MARK

Solve = Callable[[Sequence[Scene]], Iterable[tuple[int, Result]]]
"""Computes scenes, and gives each one's place and result as it ends."""

LIMIT_S = 30.0
"""How long a chunk of several drops should take at most; a kill loses no more of a worker."""

# What is aimed at: drops last unevenly, and machines have other things to do.
_AIM_S = LIMIT_S / 2
# As long as the sizes so far keep between these they stay: a kernel is compiled for each batch.
_KEPT_S = (_AIM_S / 3, LIMIT_S * 0.75)

# Work of a first chunk on one core [node steps]: a quarter of the limit on a core of 2020 or so.
_FIRST_WORK = 1e8

MOST = 256
"""Most drops of a chunk that is not given: what a chunk costs besides is then next to nothing."""

# A chunk has at most so many times the drops of those that are known to have kept the limit.
_GROWTH = 4

# Members that are looked at for a mean.
_LOOKED_AT = 200

# A row in its shard, in results.parquet and in results.csv; a shard besides its rows [bytes].
_ROW, _SHARD = 2_000, 40_000


class Dealer:
    """Deals out the members that are missing, in chunks by how long earlier ones have taken."""

    def __init__(
        self, design: Design, missing: Sequence[range], side_by_side: int = 1, workers: int = 1
    ) -> None:
        """
        Args:
            design: the drops of the sweep.
            missing: rows of members that are to be computed, in order.
            side_by_side: how many drops a worker computes at a time, at no more time than one.
            workers: how many there are; each has something to do from the start.
        """
        self._design = design
        self._missing = list(missing)[::-1]
        most = min(design.plan.chunk or MOST, -(-sum(map(len, missing)) // workers))
        self._most = max(1, most)
        self._least = min(side_by_side, self._most)
        self._first_work = _FIRST_WORK * side_by_side
        self._size = 0
        self._pace: float | None = None  # seconds of a node step

    def next(self) -> range | None:
        """The next chunk; None: all have been dealt out."""
        if not self._missing:
            return None
        row = self._missing.pop()
        size = self._evenly(row, self._sized(self._work(row[0])))
        last = self._work(row[size - 1])
        if last > self._work(row[0]):  # other lattices begin in it
            size = min(size, self._evenly(row, self._sized(last)))
        if len(row) > size:
            self._missing.append(row[size:])
        return row[:size]

    def learn(self, chunk: range, seconds: float) -> None:
        """Take note of how long a chunk has taken, without what its kernels took to compile [s]."""
        self._size = max(self._size, len(chunk))
        self._pace = seconds / (len(chunk) * self._work(chunk[0], chunk[-1]))

    def _sized(self, each: float) -> int:
        """Drops of the next chunk, whose work is `each` [node steps]: a power of two or a limit."""
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
        """As many chunks as the size asks for, but of equal sizes: no small one is left over."""
        return -(-len(row) // -(-len(row) // size))

    def _work(self, *numbers: int) -> float:
        """Mean work of members [node steps]; one whose values make no scene takes none."""
        total = 0.0
        for number in numbers:
            with contextlib.suppress(UserError):
                total += work(self._design.member(number).scene)
        return max(1.0, total / len(numbers))


@dataclass(frozen=True)
class Estimate:
    """What a sweep needs: drops, bytes on disk; seconds on one core, if they were tried."""

    drops: int
    bytes: int
    core_seconds: float | None = None


def room(design: Design) -> Estimate:
    """How many drops a sweep has, and how much disk it takes at most (before compression)."""
    plan, size = design.plan, 0.0
    some = _some(design, _LOOKED_AT)
    if plan.keep.histories != "none":
        width = 4 if plan.keep.histories == "float32" else 8
        rows = np.mean([s.numerics.latest_end / s.output.history_interval + 2 for s in some])
        size += len(design) * rows * (8 + width * len(HISTORY_COLUMNS))
    full = len(design) if plan.keep.full == "all" else len(plan.keep.full)
    size += full * float(np.mean([storage_bytes(scene) for scene in some]))
    # about as many chunks at most as on one core, if none ever grows
    first = Dealer(design, [range(len(design))]).next() or range(1)
    size += _ROW * len(design) + _SHARD * math.ceil(len(design) / len(first))
    return Estimate(len(design), int(size))


def trial(design: Design, solve: Solve, on_drop: Callable[[], None], drops: int = 2) -> Estimate:
    """The same, and how long it takes: from a few drops, taken to last as their scenes' work says.

    `solve` is called for each of the drops alone. A first call is not counted: kernels compile.
    """
    found = room(design)
    chosen = _some(design, drops)
    paces = []
    for count, scene in enumerate([chosen[0], *chosen]):
        begun = time.perf_counter()
        for _, result in solve([scene]):
            _ = result.summary
        if count:
            paces.append((time.perf_counter() - begun) / work(scene))
            on_drop()
    mean = float(np.mean([work(scene) for scene in _some(design, _LOOKED_AT)]))
    seconds = len(design) * mean * float(np.mean(paces))
    return Estimate(found.drops, found.bytes, seconds)


def check_room(folder: Path, plan: Plan) -> None:
    """Refuse a sweep that the disk cannot hold, as UserError. What is there of it counts."""
    there = bytes_in(folder) if (folder / MARK).is_file() else 0
    with explained(folder):
        check_writable(folder, room(Design(plan)).bytes, "the sweep", "or keep less", there)


def bytes_in(folder: Path) -> int:
    """What a folder takes on disk."""
    return sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())


def cores(workers: int | None, threads: int | None) -> int:
    """How many cores of this machine compute."""
    here = os.cpu_count() or 1
    return min(here, (workers or 1) * (threads or (1 if workers else here)))


def _some(design: Design, most: int) -> list[Scene]:
    """Scenes of members, spread evenly; those that cannot be are left out."""
    scenes = []
    for number in design.spread(most):
        with contextlib.suppress(UserError):
            scenes.append(design.member(number).scene)
    if not scenes:
        design.member(0)  # says what is wrong with it
    return scenes
