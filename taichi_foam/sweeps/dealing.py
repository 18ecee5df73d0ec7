"""How the drops that are yet to be computed are dealt out: chunks that take about so long each.

A chunk is a row of consecutive members. Nothing but how much a kill loses hangs on where it ends:
a drop has the same numbers in any.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from taichi_foam.errors import UserError
from taichi_foam.sweeps.plan import work
from taichi_foam.sweeps.sampling import Design

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
            try:
                total += work(self._design.member(number).scene)
            except UserError:
                continue
        return max(1.0, total / len(numbers))


def chunks_at_most(design: Design) -> int:
    """About how many chunks there are at most: as many as on one core, if none ever grows."""
    dealer = Dealer(design, [range(len(design))])
    first = dealer.next()
    return -(-len(design) // len(first)) if first else 0
