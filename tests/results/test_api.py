"""What people type: where to compute, what a result shows, and no word of the command line."""

from __future__ import annotations

import inspect
import json
from pathlib import Path

import pytest

import taichi_foam as tf
from taichi_foam.engine import runtime
from taichi_foam.scene import Block, FlatBlock, Numerics


@pytest.fixture
def scene() -> tf.Scene:
    block, numerics = Block(columns=6, rows=4), Numerics(end=2e-4)
    return tf.Scene(name="small", block=block, impactor=FlatBlock(), numerics=numerics)


@pytest.mark.parametrize("call", [tf.run, tf.run_many, tf.simulate, tf.simulate_many])
def test_all_that_compute_take_arch_and_threads_alike(call) -> None:
    found = inspect.signature(call).parameters
    for name in ("arch", "threads"):
        assert found[name].default is None
        assert found[name].kind is inspect.Parameter.KEYWORD_ONLY


@pytest.mark.parametrize(
    "call",
    [tf.run, lambda found: next(tf.simulate(found)), tf.watch, lambda found: tf.run_many([found])],
)
def test_what_is_no_scene_is_refused(call) -> None:
    for found in ("paper/wedge-2.86", Path("paper/wedge-2.86")):
        with pytest.raises(
            tf.UserError, match=r"'paper/wedge-2.86': .* Fix: tf.load_scene\('paper"
        ):
            call(found)
    with pytest.raises(tf.UserError, match="must be a Scene, not dict"):
        call({"impactor": {"shape": "wedge"}})


def test_one_scene_is_no_list_of_scenes(scene: tf.Scene) -> None:
    for many in (tf.run_many, lambda found: next(tf.simulate_many(found))):
        for found in (scene, "paper/wedge-2.86", (each for each in [scene])):
            with pytest.raises(tf.UserError, match="must be a list of scenes, not "):
                many(found)


def test_what_runs_already_is_kept_and_another_is_refused(scene: tf.Scene) -> None:
    tf.init()
    here = runtime.settings()
    threads = int(here["threads"])
    result = tf.run(scene, arch="cpu", threads=threads)
    assert result.run["threads"] == threads
    other = threads % 2 + 1
    for compute in (
        lambda: tf.init(threads=other),
        lambda: tf.run(scene, threads=other),
        lambda: tf.run_many([scene], threads=other),
        lambda: next(iter(tf.simulate(scene, threads=other))),
        lambda: next(tf.simulate_many([scene], threads=other)),
    ):
        with pytest.raises(tf.UserError, match="start a new process"):
            compute()
    with pytest.raises(tf.UserError, match="choose one of cpu, cuda"):
        tf.run(scene, arch="abacus")


def test_a_result_has_its_measures_and_its_ending(scene: tf.Scene, tmp_path: Path) -> None:
    result = tf.run(scene)
    assert result.ending is tf.Ending.END_TIME
    assert result.run["ended_by"] == "end time"
    assert result.summary == tf.summary(result)
    assert result.summary is result.summary
    some = ["max_strain", "statement", "peak_deceleration_g"]
    assert result.measured(some) == {key: result.summary[key] for key in some}
    again = tf.load(result.save(tmp_path / "run"))
    assert isinstance(again, tf.Result)
    stored = json.loads((tmp_path / "run" / "summary.json").read_text())
    assert {**again.summary, "run": again.run} == stored


def test_values_show_themselves_in_a_line(scene: tf.Scene) -> None:
    result = tf.run(scene)
    rows, snapshots = len(result.history.time_s), len(result.snapshots)
    assert repr(result) == (
        f"<Result of 'small': {rows} rows, {snapshots} snapshots, ended by: end time>"
    )
    last = result.history.time_s[-1]
    assert repr(result.history) == f"<History of {rows} rows until {last:.4g} s, 25 columns>"
    assert repr(result.snapshots[0]) == "<Snapshot of 6 x 4 mass points at 0 s>"


def test_the_library_does_not_speak_of_options(make_result, tmp_path: Path) -> None:
    make_result().save(tmp_path / "run")
    with pytest.raises(tf.UserError) as caught:
        make_result().save(tmp_path / "run")
    assert "pass overwrite=True" in str(caught.value)
    assert caught.value.argument == "overwrite=True"
    with pytest.raises(tf.UserError) as caught:
        tf.load_scene("paper/wedge-2.86", overrides=["block.rows"])
    assert "--" not in str(caught.value)
    package = Path(tf.__file__).parent
    for file in package.rglob("*.py"):
        if "cli" not in file.relative_to(package).parts:
            assert not any(
                f"--{option}" in file.read_text(encoding="utf-8")
                for option in ("overwrite", "arch", "threads", "set ", "out", "port", "host")
            ), file
