"""A sweep in a process of its own, to be killed: `python slow_sweep.py FOLDER`."""

from __future__ import annotations

import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

from drops import Solver, axis, plan_of

import taichi_foam as tf

PLAN = plan_of(axis(low=2.0, high=2.9, count=40), keep={"histories": "float64"})


def pause(asked: int) -> None:
    time.sleep(0.05)


if __name__ == "__main__":
    tf.sweep(PLAN, sys.argv[1], workers=2, solve=Solver(before=pause))
