"""What the machine could do at best: memory bandwidth and arithmetic, and where a subject stands.

With a C++ compiler both come from `limits.cpp`; without one the bandwidth comes from NumPy.
"""

from __future__ import annotations

import subprocess
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
from peers.compile import build, compiler

SOURCE = Path(__file__).with_suffix(".cpp")
FLAGS = ("-O3", "-march=native", "-std=c++17", "-ffp-contract=fast")
ELEMENTS = 1 << 24
PASSES = 3


class Limits:
    """Measures bandwidth [bytes/s], counted as what moves, and arithmetic [operations/s]."""

    def __init__(self, threads: int) -> None:
        self._counts = sorted({1, threads})
        self._folder = tempfile.TemporaryDirectory(prefix="taichi_foam_limits_")
        self._program = self._compiled()

    def measure(self) -> dict[int, dict[str, float]]:
        """By the number of threads: `bandwidth`, and `arithmetic` where there is a compiler."""
        return {threads: self._measured(threads) for threads in self._counts}

    def _compiled(self) -> Path | None:
        command = compiler()
        if command is None:
            return None
        program = Path(self._folder.name, "limits")
        build([*command, *FLAGS], SOURCE, program)
        return program

    def _measured(self, threads: int) -> dict[str, float]:
        if self._program is None:
            return {"bandwidth": _triad(threads)}
        answer = subprocess.run(
            [str(self._program), str(threads)], capture_output=True, text=True, check=True
        )
        bandwidth, arithmetic, _ = map(float, answer.stdout.split())
        return {"bandwidth": bandwidth, "arithmetic": arithmetic}


def _triad(threads: int) -> float:
    """a = b + 3 c in NumPy, which lets go of the interpreter meanwhile [bytes/s]."""
    a, b, c = np.zeros(ELEMENTS), np.ones(ELEMENTS), np.ones(ELEMENTS)
    edges = np.linspace(0, ELEMENTS, threads + 1).astype(int)

    def part(k: int) -> None:
        own = slice(edges[k], edges[k + 1])
        np.multiply(c[own], 3.0, out=a[own])
        np.add(a[own], b[own], out=a[own])

    walls = []
    with ThreadPoolExecutor(threads) as pool:
        for _ in range(PASSES):
            start = time.perf_counter()
            list(pool.map(part, range(threads)))
            walls.append(time.perf_counter() - start)
    moved = 3 + 3  # numbers for each element: a write first fetches its line, unless it was read
    return 8.0 * moved * ELEMENTS / min(walls)
