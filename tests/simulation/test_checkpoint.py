"""Runs that are cut off and continued end as if nothing had happened, to the last bit."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from bench import assert_same_run, assert_same_snapshots, bench, interrupt_at, small_scene
from processes import ENVIRONMENT
from typer.testing import CliRunner

from taichi_foam.cli import app
from taichi_foam.engine import cpu, transfer
from taichi_foam.engine.state import State
from taichi_foam.errors import Interrupted, UserError
from taichi_foam.records.ending import Ending
from taichi_foam.results.folders import UNFINISHED
from taichi_foam.results.result import Result
from taichi_foam.scene import Foam, Model, Numerics, Output, Scene, Wedge
from taichi_foam.simulation import batches
from taichi_foam.simulation import checkpoint as checkpoint_module
from taichi_foam.simulation.checkpoint import CHECKPOINT
from taichi_foam.simulation.simulate import Progress, resume, run, run_many


def impact(velocity: float = 15.0, end: float = 5e-3, **parts: object) -> Scene:
    """A wedge that breaks and crushes a small block, whose pieces touch."""
    wedge = Wedge(angle_deg=60, shank_width=0.02, mass=0.1, velocity=velocity, friction=0.5)
    given: dict[str, object] = {
        "impactor": wedge,
        "foam": Foam(densification_b=2.0),  # as in other tests, whose kernels these are
        "model": Model(shear_failure="always"),
        "numerics": Numerics(end=end),
        "output": Output(history_interval=5e-5, snapshot_interval=1e-3),
    }
    return small_scene(**{**given, **parts})


@pytest.mark.parametrize("advance", [cpu.advance_fused, cpu.advance_staged])
def test_a_state_is_all_that_a_lattice_needs(advance: Callable) -> None:
    """Taken, turned into arrays and back, put into a lattice that held something else."""
    scene = impact()
    with bench(scene) as loaded:
        loaded.step(900, advance)
        kept = transfer.take(loaded.lattice, 0)
        whole = loaded.step(600, advance)
        work = loaded.work
        neighbours = kept.neighbours
    assert len(neighbours["pairs"]) > 0
    assert kept.clock["broken"] > 5
    again = State.from_arrays(kept.to_arrays())
    with bench(impact(9.0)) as loaded:
        loaded.step(300)
        transfer.load(loaded.lattice, 0, scene, again)
        transfer.set_pause(loaded.lattice, np.full(1, 1e30))
        np.testing.assert_array_equal(transfer.take(loaded.lattice, 0).position, kept.position)
        other = cpu.advance_staged if advance is cpu.advance_fused else cpu.advance_fused
        continued = loaded.step(600, other)
        assert_same_snapshots(whole, continued)
        np.testing.assert_array_equal(loaded.work, work)


# foam that flows, and options whose state is more than the defaults'
OPTIONS = {
    "default": {},
    "rate and scatter": {
        "foam": Foam(rate=3000.0, rate_exponent=2.0, overshoot_strain=0.02, strength_scatter=0.2),
        "model": Model(shear_failure="angle", shear_yield=True, piece_friction=0.3),
    },
    "no contact": {"model": Model(self_contact=False)},
}


@pytest.mark.parametrize("options", OPTIONS)
def test_an_interrupted_run_goes_on_as_if_it_had_not_been(options: str, tmp_path: Path) -> None:
    scene = impact(**OPTIONS[options])
    whole = run(scene)
    for fraction in (0.2, 0.55):  # the second interrupts what continued the first
        cut = run(scene, interrupt_at(fraction), checkpoint=tmp_path)
        assert cut.ending is Ending.INTERRUPTED
        assert len(cut.history["time_s"]) < len(whole.history["time_s"])
    continued = resume(tmp_path)
    assert_same_run(whole, continued)
    assert continued.run["resumed"] == 2
    assert whole.run["resumed"] == 0


def test_a_run_that_was_interrupted_before_its_first_row_goes_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def press(*_: object) -> bool:
        raise KeyboardInterrupt

    scene = impact(numerics=Numerics(end="rebound"))
    with monkeypatch.context() as held:
        held.setattr(batches.Slots, "advance", press)
        with pytest.raises(KeyboardInterrupt):
            run(scene, checkpoint=tmp_path)
    assert run(scene, interrupt_at(0.1), checkpoint=tmp_path).run["resumed"] == 1


def test_runs_of_a_batch_go_on_together_or_alone(tmp_path: Path) -> None:
    """One has ended when the others are interrupted."""
    scenes = [impact(15.0), impact(14.0, end=1e-3), impact(13.0), impact(12.0)]
    alone = [run(scene) for scene in scenes]
    with pytest.raises(Interrupted) as interrupted:
        run_many(scenes, interrupt_at(0.6), checkpoint=tmp_path)
    endings = {place: result.ending for place, result in interrupted.value.results.items()}
    assert endings[1] is Ending.END_TIME
    assert endings[0] is endings[2] is Ending.INTERRUPTED
    together = run_many(scenes, checkpoint=tmp_path)
    for one, other in zip(alone, together, strict=True):
        assert_same_run(one, other)


def test_checkpoints_come_as_time_goes_by(tmp_path: Path) -> None:
    seen: list[float] = []

    def watch(progress: Progress) -> None:
        file = tmp_path / UNFINISHED / CHECKPOINT
        if file.is_file():
            seen.append(file.stat().st_mtime_ns)

    scene = impact(end=0.02)
    run(scene, watch, checkpoint=tmp_path, every=1e-3)
    assert len(set(seen)) > 1
    assert_same_run(run(scene), resume(tmp_path))


def cut_off(folder: Path) -> Scene:
    scene = impact()
    run(scene, interrupt_at(0.3), checkpoint=folder)
    return scene


def test_another_scene_is_refused_with_what_differs(tmp_path: Path) -> None:
    scene = cut_off(tmp_path)
    with pytest.raises(UserError, match=r"impactor\.mass = 0\.1 instead of 0\.2"):
        run(scene.with_values(impactor__mass=0.2), checkpoint=tmp_path)


def test_another_version_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    cut_off(tmp_path)
    monkeypatch.setattr(checkpoint_module, "version", lambda: "99.0")
    with pytest.raises(UserError, match=r"written by taichi_foam .* 99\.0"):
        resume(tmp_path)


def test_what_is_no_checkpoint_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="no such folder"):
        resume(tmp_path / "nowhere")
    with pytest.raises(UserError, match="holds no checkpoint"):
        resume(tmp_path)
    file = tmp_path / UNFINISHED / CHECKPOINT
    cut_off(tmp_path)
    whole = file.read_bytes()
    for damaged in (b"", b"no zip file", whole[: len(whole) // 2]):
        file.write_bytes(damaged)
        with pytest.raises(UserError, match="not a complete checkpoint"):
            resume(tmp_path)
    with pytest.raises(UserError, match="checkpoint interval = 0"):
        run(impact(), checkpoint=tmp_path / "new", every=0.0)


# foam and sizes whose kernels come with the package: one drop first, then a batch
LEFT_HALF_DONE = """
import taichi_foam as tf
long = tf.load_scene("paper/wedge-2.86", overrides=["block.columns=20", "block.rows=10"])
snapshots = tf.simulate(long)
next(snapshots)
scenes = [long.with_values(numerics__end=1e-3), long]
runs = tf.simulate_many(scenes, checkpoint="many")
assert next(runs)[0] == 0
"""


def test_a_script_that_ends_half_way_keeps_what_it_has_computed(tmp_path: Path) -> None:
    """Its generators are closed before modules are taken away: no traceback, all is saved."""
    done = subprocess.run(
        [sys.executable, "-c", LEFT_HALF_DONE], cwd=tmp_path, env=ENVIRONMENT,
        capture_output=True, text=True, timeout=300, check=False,
    )  # fmt: skip
    assert (done.returncode, "ignored" in done.stderr) == (0, False), done.stderr
    assert len(list((tmp_path / "many").rglob(CHECKPOINT))) == 2


def test_what_else_lies_in_the_folder_is_kept(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    scene = cut_off(folder)
    (folder / "notes.txt").write_text("mine")
    done = CliRunner().invoke(app._app, ["resume", str(folder)])
    assert done.exit_code == 0, done.output
    assert (folder / "notes.txt").read_text() == "mine"
    assert not (folder / UNFINISHED).exists()
    assert_same_run(Result.load(folder), run(scene))


def test_a_result_saved_where_its_checkpoint_lies_takes_that_away(tmp_path: Path) -> None:
    scene = impact(end=1e-3)
    cut_off(tmp_path)
    with pytest.raises(UserError, match="unfinished work of another command"):
        run(scene).save(tmp_path)
    kept = tmp_path / "kept"
    result = run(scene, checkpoint=kept)
    assert_same_run(result, run(scene, checkpoint=kept))  # taken from the checkpoint
    result.save(kept)
    assert UNFINISHED not in os.listdir(kept)
    assert_same_run(result, Result.load(kept))  # snapshots that lay on disk can still be read


def test_snapshots_in_32_bits_are_those_in_64_rounded(tmp_path: Path) -> None:
    scene = impact(end=1e-3)
    single = scene.with_values(output__snapshot_precision="single")
    exact, held, stored = run(scene), run(single), run(single, checkpoint=tmp_path)
    assert_same_run(held, stored)
    for one, other in zip(exact.snapshots, held.snapshots, strict=True):
        assert other.position.dtype == np.float32
        np.testing.assert_array_equal(one.position.astype(np.float32), other.position)
        assert one.time == other.time


def test_snapshots_that_memory_cannot_hold_are_refused_or_stored() -> None:
    huge = impact(end=0.1, output=Output(history_interval=1e-7, snapshot_interval=1e-7))
    huge = huge.with_values(block__columns=2000, block__rows=2000)
    with pytest.raises(UserError, match=r"GB of memory are free\. Fix: pass checkpoint=FOLDER"):
        run(huge)
