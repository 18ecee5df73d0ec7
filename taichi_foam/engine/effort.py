"""Whether a lattice's kernels are compiled with Taichi's advanced passes.

The advanced passes take two thirds of the compile time and make kernels a fifth faster; results are
identical. Kernels that come with the package were compiled with them. Others are first compiled
without, so that a first run begins soon, until they have been used long enough for the passes to
pay off. This is recorded beside the kernels on disk, for other processes too.
"""

import contextlib
import hashlib
import os
import time
from collections.abc import Iterator

from taichi_foam.engine import kernel_cache, runtime
from taichi_foam.engine.features import Features
from taichi_foam.engine.layout import SMALL_BLOCK, Size

PAYS_AFTER = 120.0
"""Seconds of use after which kernels are compiled again; the passes take about a fifth of that."""

PAYS_FROM = SMALL_BLOCK
"""Nodes of a batch from which kernels are compiled with the passes at once: runs take longer."""

_used: dict[tuple[Size, Features], float] = {}


def pays(room: Size, features: Features) -> bool:
    """Whether kernels of such lattices have been used for PAYS_AFTER in this process."""
    return _used.get((room, features), 0.0) >= PAYS_AFTER


def name_of(room: Size, features: Features, place: tuple[int, ...]) -> str:
    """A short name of what kernels are compiled for, the same in every process.

    Kernels on disk only fit fields at the same `place`, see `Lattice`. Features that are off are
    left out, so that a new one does not rename the kernels that lack it.
    """
    distance = features.distance
    words = {name: value for name, value in vars(features).items() if value is not False}
    words["distance"] = f"{distance.__module__}.{distance.__qualname__}"
    return hashlib.sha256(repr((room, words, place)).encode()).hexdigest()[:16]


def is_thorough(room: Size, features: Features, name: str) -> bool:
    """Whether kernels of this name are compiled with all passes.

    Those of big blocks always are, see `PAYS_FROM`.
    TI_ADVANCED_OPTIMIZATION=1 turns the passes on for all kernels, 0 turns them off. On a GPU they
    are always off, see `runtime.passes`.
    """
    given = os.environ.get("TI_ADVANCED_OPTIMIZATION")
    if given is not None:
        return given != "0"
    return room.nodes >= PAYS_FROM or pays(room, features) or kernel_cache.is_marked(name)


@contextlib.contextmanager
def spent(room: Size, features: Features, place: tuple[int, ...]) -> Iterator[None]:
    """While a lattice is used, compile with or without all passes, and record the time of use."""
    name, started = name_of(room, features, place), time.perf_counter()
    thorough = is_thorough(room, features, name)
    with runtime.passes(thorough):
        try:
            yield
        finally:
            now = _used.get((room, features), 0.0) + time.perf_counter() - started
            _used[room, features] = now
            if thorough or pays(room, features):
                kernel_cache.mark(name)
