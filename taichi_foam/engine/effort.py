"""How much effort goes into compiling a lattice's kernels.

Taichi's advanced passes take two thirds of the time that compiling takes, and kernels run a fifth
faster for it; every number is the same. Kernels that come with the package have been through them.
Others are compiled without, so that a first run begins soon, until they have been used for so long
that the passes would have paid. Which those are is kept beside the kernels on disk, for other
processes too.
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
"""Seconds of use after which kernels are compiled again: a fifth of it is what the passes take."""

_used: dict[tuple[Size, Features], float] = {}


def pays(room: Size, features: Features) -> bool:
    """Whether kernels of lattices like this have been used for so long in this process."""
    return _used.get((room, features), 0.0) >= PAYS_AFTER


def name_of(room: Size, features: Features, place: tuple[int, ...]) -> str:
    """A short name of what kernels are compiled for, the same in every process.

    Kernels on disk serve fields at the same `place` among all that were made.
    """
    distance = features.distance
    words = vars(features) | {"distance": f"{distance.__module__}.{distance.__qualname__}"}
    return hashlib.sha256(repr((room, words, place)).encode()).hexdigest()[:16]


def is_thorough(room: Size, features: Features, name: str) -> bool:
    """Whether all passes are to be taken for kernels of this name.

    Big blocks take longer than `PAYS_AFTER` in any case. TI_ADVANCED_OPTIMIZATION=1 takes them for
    all, 0 for none. On a GPU they never are, see `runtime.passes`.
    """
    given = os.environ.get("TI_ADVANCED_OPTIMIZATION")
    if given is not None:
        return given != "0"
    return room.nodes >= SMALL_BLOCK or pays(room, features) or kernel_cache.is_marked(name)


@contextlib.contextmanager
def spent(room: Size, features: Features, place: tuple[int, ...]) -> Iterator[None]:
    """Compile with all passes or without while a lattice is used, and count for how long it is."""
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
