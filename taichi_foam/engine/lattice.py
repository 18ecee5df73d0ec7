"""A batch of lattices with the same counts and features: model, state and scratch on the device."""

import contextlib
from collections.abc import Iterator

import taichi as ti

from taichi_foam.engine import runtime
from taichi_foam.engine.features import Features
from taichi_foam.engine.layout import Layout
from taichi_foam.engine.model import ModelFields
from taichi_foam.engine.scratch import ScratchFields
from taichi_foam.engine.state import EMPTY, StateFields

LAST_STAGE = 3  # of the classical Runge-Kutta method, counted from 0


@ti.data_oriented
class Lattice:
    """Fields for `batch` lattices of `columns` x `rows` nodes; counts as in `Layout`.

    model     constants of their scenes
    state     what steps change
    scratch   what steps work in
    """

    def __init__(self, batch: int, columns: int, rows: int, features: Features) -> None:
        runtime.start()
        layout = Layout(batch, columns, rows)
        self.features = features
        self.on_gpu, self.blocks = layout.on_gpu, layout.blocks
        self.batch, self.columns, self.rows, self.nodes = batch, columns, rows, layout.nodes
        self.lanes, self.packs = layout.lanes, layout.packs
        self.strips, self.sweeps, self.slots = layout.strips, layout.sweeps, layout.slots
        self.most_pairs, self.most_candidates = layout.most_pairs, layout.most_candidates
        self.bins_x, self.bins_y = layout.bins_x, layout.bins_y
        self.model = ModelFields(layout, features)
        self.law = self.model.law
        self.state = StateFields(layout, features)
        self.scratch = ScratchFields(layout, features)
        layout.finish()
        self.state.clock.get_member_field("status").fill(EMPTY)


MOST_IDLE = 12
"""Lattices that are kept while nobody has them. Each takes some 40 MB with its kernels."""

_idle: dict[tuple[int, int, int, Features], list[Lattice]] = {}
_lent = 0


@contextlib.contextmanager
def borrowed(batch: int, columns: int, rows: int, features: Features) -> Iterator[Lattice]:
    """A lattice of these counts and features for the time of a run.

    Lattices are kept and lent again: Taichi compiles its kernels anew for every new set of
    fields. When many lie idle, all are given up at once: Taichi gives memory of kernels back in no
    other way.
    """
    global _lent
    if not _idle.get((batch, columns, rows, features)):
        _give_up_idle()
    kept = _idle.setdefault((batch, columns, rows, features), [])
    lattice = kept.pop() if kept else Lattice(batch, columns, rows, features)
    _lent += 1
    try:
        yield lattice
    finally:
        _lent -= 1
        kept.append(lattice)


def _give_up_idle() -> None:
    """Forget all lattices, if there are many and none is lent.

    Not where a program has fields of its own, which would be lost too.
    """
    made = sum(map(len, _idle.values()))
    if _lent == 0 and made >= MOST_IDLE and runtime.has_only(trees=made * Layout.TREES):
        _idle.clear()
        runtime.begin_anew()
