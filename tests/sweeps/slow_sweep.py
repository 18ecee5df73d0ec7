"""A sweep in a process of its own, to be killed: `python slow_sweep.py FOLDER [SCHEDULER]`.

With HOLD in the environment a worker lets no other thread run, as while a kernel compiles.
"""

from __future__ import annotations

import ctypes
import os
import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

import cloudpickle
import drops
from drops import Solver, axis, plan_of

import taichi_foam as tf
from taichi_foam.errors import RunError

PLAN = plan_of(axis(low=2.0, high=2.9, count=40), keep={"histories": "float64"})


def pause(asked: int) -> None:
    time.sleep(0.05)
    if asked == 1 and "HOLD" in os.environ:
        Path(os.environ["HOLD"]).touch()
        ctypes.PyDLL(None).sleep(60)  # holds the lock of the interpreter


if __name__ == "__main__":
    cloudpickle.register_pickle_by_value(drops)  # workers of a cluster have no tests
    where = {"scheduler": sys.argv[2]} if len(sys.argv) > 2 else {"workers": 2}
    try:
        tf.sweep(PLAN, sys.argv[1], solve=Solver(before=pause), **where)
    except RunError as error:
        sys.exit(f"error: {error}")
