"""The last bit does not depend on how a lattice is stepped: alone, in a batch, fused, staged."""

import functools
import hashlib
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bench import assert_same, bench, small_scene

from taichi_foam.engine import cpu, kernel_cache, runtime
from taichi_foam.results.result import Result
from taichi_foam.results.snapshot_file import values_of
from taichi_foam.scene import Block, FlatBlock, Foam, Model, Numerics, Output, Scene, Start, Wedge
from taichi_foam.scene.files import scene_to_toml
from taichi_foam.shim2000.impacts import paper_scene
from taichi_foam.simulation.simulate import run, run_many

STEPS = 800  # foam breaks, and pieces touch

# Every option that acts on forces or on what breaks.
EVERYTHING = {
    "foam": Foam(
        rate=300.0, rate_exponent=2.0, overshoot_strain=0.02, strength_scatter=0.2, strength_seed=4
    ),
    "model": Model(shear_failure="angle", piece_size=0.8, piece_friction=0.3, shear_yield=True),
    "start": Start(cuts=((-0.011, 0.02, 0.004, 0.07),)),
}


def impacts() -> list[Scene]:
    """Four impacts that differ in everything that is data, and break and touch."""
    output = Output(history_interval=1e-4, snapshot_interval=1e-3)
    return [
        small_scene(impactor=impactor, numerics=Numerics(end=5e-3), output=output, **parts)
        for impactor, parts in (
            (Wedge(angle_deg=60, shank_width=0.02, mass=0.1, velocity=15.0), {}),
            (
                FlatBlock(width=0.02, mass=0.2, velocity=8.0),
                {"dx": 0.004, "model": Model(shear="face")},
            ),
            (FlatBlock(width=0.02, mass=0.1, velocity=12.0, rotation_deg=20), {"dy": 0.004}),
            (Wedge(angle_deg=60, shank_width=0.02, mass=0.1, velocity=14.0), EVERYTHING),
        )
    ]


def held(scene: Scene, *, staged: bool) -> dict[str, Any]:
    """All that a lattice holds after STEPS, what its columns have booked, and its sweeps."""
    with bench(scene) as loaded:
        snapshot = loaded.step(STEPS, cpu.advance_staged if staged else cpu.advance_fused)
        sweeps = loaded.lattice.counts[None].sweeps
        return {**values_of(snapshot), "work": loaded.work, "sweeps": sweeps}


@functools.cache
def stepped(which: int, *, staged: bool) -> dict[str, Any]:
    return held(impacts()[which], staged=staged)


def assert_equal(one: dict[str, Any], other: dict[str, Any]) -> None:
    assert one.keys() == other.keys()
    for name, values in one.items():
        np.testing.assert_array_equal(values, other[name], err_msg=name)


@pytest.mark.parametrize("which", [0, 1, 2, 3])
def test_fused_and_staged_stepping_agree(which: int) -> None:
    fused = stepped(which, staged=False)
    assert fused["sweeps"] > 1
    assert_equal(fused, stepped(which, staged=True))
    assert sum(np.isfinite(fused[f"break_time_{axis}"]).sum() for axis in "ab") > 5


def test_many_sweeps_agree_with_one() -> None:
    """A wider block, whose columns are dealt out to more sweeps."""
    scene = Scene(
        block=Block(mass_points="cells", width=0.15, height=0.05, columns=30, rows=10),
        impactor=Wedge(angle_deg=60, shank_width=0.02, mass=0.1, velocity=14.0),
        numerics=Numerics(end=5e-3),
        **{**EVERYTHING, "start": Start(cuts=((-0.011, 0.01, 0.004, 0.035),))},
    )
    fused = held(scene, staged=False)
    assert fused["sweeps"] >= 4
    assert_equal(fused, held(scene, staged=True))
    assert sum((fused[f"break_time_{axis}"] > 0).sum() for axis in "ab") > 5


def test_a_batch_gives_what_each_gives_alone() -> None:
    scenes = impacts()
    for scene, together in zip(scenes, run_many(scenes), strict=True):
        alone = run(scene)
        assert alone.history["broken_bonds"][-1] > 5
        assert_same(alone, together)


def test_a_lattice_that_is_lent_again_forgets_what_it_held() -> None:
    scene = impacts()[0]
    first = run(scene)
    run(impacts()[1])
    assert_same(first, run(scene))


def digest() -> str:
    """Of all that two lattices hold, divided among sweeps: by faces, and by everything."""
    found = hashlib.sha256()
    for which in (1, 3):
        for values in stepped(which, staged=True).values():
            if values is not None:  # what is not kept has no bytes of its own
                found.update(np.asarray(values).tobytes())
    return found.hexdigest()


_WITH_THREADS = """
import sys
sys.path[:0] = {paths!r}
import conftest
from taichi_foam.engine import runtime
runtime.start(threads={threads})
from test_same_numbers import digest
print(digest())
"""


def test_one_and_two_threads_agree() -> None:
    """In a fresh process, as a process has one thread count.

    Where a lattice is not divided, one thread has all of it.
    """
    here = Path(__file__).parent
    threads = 2 if runtime.settings()["threads"] == 1 else 1
    paths = [str(here.parent), str(here)]
    program = _WITH_THREADS.format(threads=threads, paths=paths)
    process = subprocess.Popen(
        [sys.executable, "-c", program], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        cwd=here.parents[1],
    )  # fmt: skip
    mine = digest()
    out, err = process.communicate(timeout=900)
    assert process.returncode == 0, err
    assert out.split() == [mine]


_AS_SHIPPED = """
import sys
from pathlib import Path
import taichi_foam as tf
from taichi_foam.engine import effort
from taichi_foam.engine.features import features_of
from taichi_foam.engine.lattice import borrowed
scene = tf.load_scene(Path(sys.argv[1]))
block, features = scene.block, features_of(scene)
with borrowed(1, block.columns, block.rows, features) as lattice:
    room = lattice.size.room()
    assert effort.is_thorough(room, features, effort.name_of(room, features, lattice.place))
tf.run(scene).save(sys.argv[2])
"""


@pytest.mark.skipif(
    kernel_cache.archive() is None, reason="no kernels come with it for this platform"
)
def test_kernels_of_long_use_give_the_same_numbers(tmp_path: Path) -> None:
    """Those that come with the package have been through all of Taichi's passes, others not."""
    scene = paper_scene("paper/wedge-2.86").with_values(
        block__columns=20, block__rows=10, impactor__velocity=9.0, numerics__end=4e-3
    )
    (tmp_path / "scene.toml").write_text(scene_to_toml(scene), encoding="utf-8")
    environment = {k: v for k, v in os.environ.items() if k != "TI_ADVANCED_OPTIMIZATION"}
    done = subprocess.run(
        [sys.executable, "-c", _AS_SHIPPED, str(tmp_path / "scene.toml"), str(tmp_path / "run")],
        env=environment, capture_output=True, text=True, check=False,
        cwd=Path(__file__).parents[2],
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    here = run(scene)
    assert here.history["broken_bonds"][-1] > 5
    assert_same(here, Result.load(tmp_path / "run"), but=("stress",))
