"""What a user waits for before anything happens: imports, compilation, memory."""

from __future__ import annotations

import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable

from .subjects import SMALL, Mode
from .workers import BENCHMARKS, EFFORT

IMPORT = "import time; t = time.perf_counter(); import taichi_foam; print(time.perf_counter() - t)"
SMALL_RUN = ("run", "paper/wedge-2.86", "--no-film")
BIG_RUN = (*SMALL_RUN, "--set", "block.columns=400", "--set", "block.rows=200")
IMPORTS = 5


def starts(mode: Mode, on_next: Callable[[str], None]) -> dict[str, float]:
    """Seconds that `import taichi_foam` takes, and until the first step, cold and warm.

    Cold: with an empty folder for compiled kernels, as after installing; the same folder is then
    warm. Without warm starts to measure there is one, with the folder that everybody uses.
    Compiling is a ratio, see `timing.compiling`.
    """
    found: dict[str, float] = {}
    on_next("import taichi_foam")
    found["import"] = statistics.median(
        _number([sys.executable, "-c", IMPORT]) for _ in range(IMPORTS if mode.warm_starts else 1)
    )
    if not mode.warm_starts:
        on_next("first step")
        return {**found, "as it is": _first_step("", SMALL_RUN)}
    with tempfile.TemporaryDirectory(prefix="taichi_foam_cache_") as cache:
        on_next("first step, cold")
        found["cold"] = _first_step(cache, SMALL_RUN)
        on_next("first step, warm")
        found["warm"] = statistics.median(
            _first_step(cache, SMALL_RUN) for _ in range(mode.warm_starts)
        )
        on_next("compiling the nine tests' kernels")
        found["compiling"] = _number([sys.executable, "-m", "timing.compiling"])
        if mode.all_sizes:
            on_next("first step of 80,000 nodes, cold")
            found["cold, 80,000 nodes"] = _first_step(cache, BIG_RUN)
            on_next("first step of 80,000 nodes, warm")
            found["warm, 80,000 nodes"] = _first_step(cache, BIG_RUN)
    return found


def _first_step(cache: str, arguments: tuple[str, ...]) -> float:
    with tempfile.TemporaryDirectory(prefix="taichi_foam_first_") as folder:
        call = ["timing.first_step", repr(time.time()), *arguments]
        kept = {"TI_OFFLINE_CACHE_FILE_PATH": cache} if cache else {}
        return _number([sys.executable, "-m", *call], folder, **kept)


def memory(mode: Mode, threads: int) -> float:
    """Bytes per node of a big lattice that has stepped, beyond what a small one's process takes."""
    found = {}
    for counts in {SMALL, mode.large}:
        # the first may compile, which takes memory, too; nobody looks at what a short form finds
        for _ in range(2 if mode.warm_starts else 1):
            found[counts] = _number(
                [sys.executable, "-m", "timing.resident", str(threads), *map(str, counts)]
            )
    return (found[mode.large] - found[SMALL]) / (mode.large[0] * mode.large[1])


def _number(call: list[str], folder: str | None = None, **variables: str) -> float:
    """What a process prints last; it compiles as a user's does unless `variables` say otherwise.

    Raises:
        RuntimeError: it ends with an error.
    """
    paths = [str(BENCHMARKS), os.environ.get("PYTHONPATH", "")]
    kept = {name: value for name, value in os.environ.items() if name != EFFORT}
    environment = {**kept, "PYTHONPATH": os.pathsep.join(filter(None, paths)), **variables}
    answer = subprocess.run(
        call, capture_output=True, text=True, env=environment, cwd=folder, check=False
    )
    if answer.returncode != 0:
        lines = answer.stderr.strip().splitlines() or [f"status {answer.returncode}"]
        raise RuntimeError(f"{' '.join(call[1:4])}: {lines[-1]}")
    return float(answer.stdout.split()[-1])
