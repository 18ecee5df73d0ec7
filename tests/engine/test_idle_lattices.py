"""Lattices of many sizes in one process: memory comes back, and no number changes."""

from __future__ import annotations

import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import taichi_foam

PROGRAM = """
import sys

import taichi as ti

import taichi_foam as tf
from taichi_foam.engine import lattice, runtime

lattice.MOST_IDLE = 1
begun = []
begin_anew = runtime.begin_anew
runtime.begin_anew = lambda: (begun.append(1), begin_anew())
tf.init(threads=2)
mine = None
# there is room for 24, and for 48, and kernels for both come with the package
for columns in (20, 30, 20):
    if sys.argv[1] == "own field" and columns == 30:
        mine = ti.field(ti.f64, shape=3)
        mine.fill(7.0)
    scene = tf.load_scene("paper/wedge-2.86", overrides=[f"block.columns={columns}"])
    result = tf.run(scene.with_values({"numerics.time_limit": 3e-3}))
    print(result.history.strain_J.tobytes().hex(), result.snapshots[-1].position.sum().hex())
if mine is not None:
    assert mine.to_numpy().tolist() == [7.0, 7.0, 7.0]
print("begun anew", len(begun))
"""


def numbers(field: str) -> list[str]:
    """What a process prints that runs three scenes of two sizes and keeps one lattice at most."""
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM, field],
        env={**os.environ, "PYTHONPATH": str(Path(taichi_foam.__file__).parents[1])},
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines()


def test_lattices_that_are_given_up_leave_no_trace() -> None:
    """Where the program has a field of its own none is given up: the numbers are the same."""
    with ThreadPoolExecutor() as side_by_side:
        kept, given_up = side_by_side.map(numbers, ("own field", "none"))
    assert kept[-1] == "begun anew 0"
    assert given_up[-1] == "begun anew 2"
    assert given_up[:-1] == kept[:-1]
    assert kept[0] == kept[2] != kept[1]
