"""How much memory a process uses that has stepped one lattice: `THREADS COLUMNS ROWS`."""

import sys

from .engine import start_taichi, stepped
from .subjects import Subject

threads, columns, rows = map(int, sys.argv[1:])
start_taichi(threads=threads)
print(stepped(Subject("", "", "", counts=(columns, rows), extent="whole")))
