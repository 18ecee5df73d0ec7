"""How much memory a process uses that has stepped one lattice [bytes]: `THREADS COLUMNS ROWS`.

What Python has freed, and glibc keeps for later, is not in use: how much that is depends on the
order of allocations.
"""

import contextlib
import ctypes
import sys

import psutil

from .engine import Loaded, start_taichi
from .subjects import LEAST_STEPS, Subject

threads, columns, rows = map(int, sys.argv[1:])
start_taichi(threads=threads)
scene = Subject("", "", "", counts=(columns, rows), extent="whole").scene()
with contextlib.ExitStack() as stack:
    loaded = Loaded(stack, 1, scene)
    loaded.start([scene])
    loaded.run_steps(LEAST_STEPS)
    with contextlib.suppress(OSError, AttributeError):  # another system, or another libc
        ctypes.CDLL("libc.so.6").malloc_trim(0)
    print(psutil.Process().memory_info().rss)
