"""The last bit does not depend on how a lattice is stepped: alone, in a batch, fused, staged."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from bench import bench, small_scene

from taichi_foam.engine import stepper
from taichi_foam.result import Result, Snapshot
from taichi_foam.scene import FlatBlock, Numerics, Output, Scene, Wedge
from taichi_foam.simulation import run, run_many

STEPS = 1500


def impacts() -> list[Scene]:
    """Three impacts that differ in everything that is data, and break and touch."""
    output = Output(history_interval=1e-4, snapshot_interval=1e-3)
    return [
        small_scene(impactor=impactor, numerics=Numerics(end=5e-3), output=output, **parts)
        for impactor, parts in (
            (Wedge(angle_deg=60, shank_width=0.02, mass=0.1, velocity=15.0), {}),
            (FlatBlock(width=0.02, mass=0.2, velocity=8.0), {"dx": 0.004}),
            (FlatBlock(width=0.02, mass=0.1, velocity=12.0, rotation_deg=20), {"dy": 0.004}),
        )
    ]


def assert_same_snapshots(one: Snapshot, other: Snapshot) -> None:
    for name in ("time", "impactor_y", "position", "velocity", "e_min_a", "e_min_b"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name), err_msg=name)
    np.testing.assert_array_equal(one.break_time_a, other.break_time_a)
    np.testing.assert_array_equal(one.break_time_b, other.break_time_b)


def assert_same_results(one: Result, other: Result) -> None:
    for name, column in one.history.items():
        np.testing.assert_array_equal(column, other.history[name], err_msg=name)
    assert len(one.snapshots) == len(other.snapshots)
    for a, b in zip(one.snapshots, other.snapshots, strict=True):
        assert_same_snapshots(a, b)


@pytest.mark.parametrize("which", [0, 1, 2])
def test_fused_and_staged_stepping_agree(which: int) -> None:
    scene = impacts()[which]
    states = []
    for advance in (stepper.advance_fused, stepper.advance_staged):
        with bench(scene) as loaded:
            states.append(loaded.step(STEPS, advance))
            history = loaded.lattice.strip_work.to_numpy()
        states[-1] = (states[-1], history)
    (fused, fused_work), (staged, staged_work) = states
    assert_same_snapshots(fused, staged)
    np.testing.assert_array_equal(fused_work, staged_work)
    assert fused.broken_a.sum() + fused.broken_b.sum() > 5


def test_a_batch_gives_what_each_gives_alone() -> None:
    scenes = impacts()
    for scene, together in zip(scenes, run_many(scenes), strict=True):
        alone = run(scene)
        assert alone.history["broken_connections"][-1] > 5
        assert_same_results(alone, together)


def test_a_lattice_that_is_lent_again_forgets_what_it_held() -> None:
    scene = impacts()[0]
    first = run(scene)
    run(impacts()[1])
    assert_same_results(first, run(scene))


_WITH_THREADS = """
import hashlib, sys
sys.path.insert(0, {tests!r})
sys.path.insert(0, {engine!r})
import numpy as np
from taichi_foam.engine import loading, runtime, stepper
runtime.start(threads={threads})
from bench import bench
from test_same_numbers import STEPS, impacts
for advance in (stepper.advance_fused, stepper.advance_staged):
    with bench(impacts()) as loaded:
        loaded.step(STEPS, advance)
        digest = hashlib.sha256()
        for b in range(3):
            for values in vars(loading.snapshot(loaded.lattice, b)).values():
                digest.update(np.asarray(values).tobytes())
        digest.update(loaded.lattice.strip_work.to_numpy().tobytes())
        print(digest.hexdigest())
"""


def test_one_and_two_threads_agree() -> None:
    """In fresh processes, as a process has one thread count; fused and staged, three lattices."""
    here = Path(__file__).parent
    processes = [
        subprocess.Popen(
            [sys.executable, "-c", _WITH_THREADS.format(
                threads=threads, tests=str(here.parent), engine=str(here))],
            stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=here.parents[1],
        )
        for threads in (1, 2)
    ]  # fmt: skip
    digests = []
    for process in processes:
        out, err = process.communicate(timeout=300)
        assert process.returncode == 0, err
        digests += out.split()
    assert len(digests) == 4
    assert len(set(digests)) == 1
