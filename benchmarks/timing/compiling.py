"""Prints how long the nine tests' kernels take to compile, over a fixed loop in Python.

Processor time of a process that has no compiled kernels. All nine tests have the same, so that one
test counts.
"""

from __future__ import annotations

import os
import time

os.environ["TI_OFFLINE_CACHE"] = "0"

from taichi_foam import init, load_scene, run

TEST = "paper/rectangular-3.03"
INSTANT = {"numerics.time_limit": 1e-5, "output.history_interval": 1e-5}


def loop() -> float:
    """Seconds of some ten million operations of the interpreter."""
    start, total = time.process_time(), 0
    for number in range(10_000_000):
        total += number & 3
    return time.process_time() - start


def main() -> None:
    init(threads=1)
    before = loop()
    start = time.process_time()
    run(load_scene(TEST).with_values(INSTANT))
    took = time.process_time() - start
    print(took / (0.5 * (before + loop())))


if __name__ == "__main__":
    main()
