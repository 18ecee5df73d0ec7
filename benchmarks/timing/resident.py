"""How much memory a process uses that has stepped one lattice: `THREADS COLUMNS ROWS`."""

import sys

from taichi_foam.engine import runtime

from .engine import stepped
from .subjects import Subject

threads, columns, rows = map(int, sys.argv[1:])
runtime.start(threads=threads)
print(stepped(Subject("", "", "", counts=(columns, rows), contact=True)))
