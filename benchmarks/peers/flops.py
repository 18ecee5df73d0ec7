"""How many floating-point operations the plain peer does per node and stage.

`python -m peers.flops` in benchmarks/ prints them, counted by plain.cpp itself: flops.cpp compiles
it with a number that keeps count. What a compiler drops or fuses counts in full.
"""

from __future__ import annotations

import ctypes

from taichi_foam.scene import Scene

from .constants import Skipped
from .native import Plain
from .scenes import scene_with

OPERATIONS = ("add", "multiply", "divide", "root", "compare", "exp")


class _Counting(Plain):
    """The plain peer, slower and counting."""

    name = "C++, counting"
    source = "flops.cpp"

    def counts(self) -> list[int]:
        """Operations since the last call."""
        values = (ctypes.c_long * len(OPERATIONS))()
        self._library.read_counts(values)
        return list(values)


def flops(scene: Scene, warm_up: int = 1000, steps: int = 200) -> dict[str, float] | Skipped:
    """Operations per node and stage, by kind, on average over `steps` steps after `warm_up`."""
    peer = _Counting.load()
    if isinstance(peer, Skipped):
        return peer
    peer.prepare(scene)
    peer.advance(warm_up)
    peer.counts()
    peer.advance(steps)
    stages = 4 * steps * scene.block.columns * scene.block.rows
    return {name: count / stages for name, count in zip(OPERATIONS, peer.counts(), strict=True)}


if __name__ == "__main__":
    found = flops(scene_with("calibrated"))
    if isinstance(found, Skipped):
        print(f"skipped: {found.reason}")
    else:
        for name, count in found.items():
            print(f"{count:8.2f}  {name}")
        print(f"{sum(found.values()):8.2f}  all")
