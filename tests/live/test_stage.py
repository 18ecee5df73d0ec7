"""What one viewer sees of a drop, and what the keys do to it, without a window."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable, Iterator
from itertools import pairwise

import numpy as np
import pytest

import taichi_foam as tf
from taichi_foam.errors import UserError
from taichi_foam.live.overlay import panel, strip
from taichi_foam.live.stage import PACES, VELOCITY_STEP, Stage, pace_words
from taichi_foam.picture.colours import THEMES
from taichi_foam.picture.modes import MODES
from taichi_foam.records.ending import Ending
from taichi_foam.results.result import Result
from taichi_foam.scene import Scene

SIZE = (640, 360)
PATIENCE = 120.0  # a busy machine that compiles [s]


def scene_of(end: float = 10.0) -> Scene:
    coarse = ("block.columns=10", "block.rows=5", f"numerics.end={end}")
    return tf.load_scene("paper/wedge-2.86", overrides=coarse)


@pytest.fixture
def kept() -> list[Result]:
    return []


@pytest.fixture
def stage(kept: list[Result]) -> Iterator[Stage]:
    with Stage(scene_of(), kept.append, pace=None) as stage:
        yield stage


def wait(stage: Stage, until: Callable[[], bool]) -> None:
    end = time.monotonic() + PATIENCE
    while not until():
        assert time.monotonic() < end, stage.state
        stage.update(0.02)


def field(stage: Stage) -> np.ndarray:
    """The picture without its title line and what stands beside the field."""
    return stage.picture(SIZE)[40:340, 12:500]


def test_the_start_is_shown_before_anything_is_computed(stage: Stage) -> None:
    assert stage.state == "preparing"
    before = stage.picture(SIZE)
    wait(stage, lambda: stage.state == "full speed")
    assert np.any(stage.picture(SIZE) != before)


def test_looks_change_the_picture_and_come_round_again(stage: Stage) -> None:
    """Forwards through all modes, back by one, both themes, the grid and the curve."""
    wait(stage, lambda: stage.state == "full speed")
    stage.toggle_pause()
    wait(stage, lambda: stage.session.last.paused)
    first = stage.picture(SIZE)
    seen = []
    for _ in MODES:
        seen.append(stage.picture(SIZE))
        stage.next_mode()
    assert all(np.any(a != b) for a, b in pairwise(seen))
    np.testing.assert_array_equal(stage.picture(SIZE), first)
    stage.next_mode(-1)
    np.testing.assert_array_equal(stage.picture(SIZE), seen[-1])
    stage.next_mode()
    for change in (stage.next_theme, stage.toggle_grid, stage.toggle_curve):
        change()
        assert np.any(stage.picture(SIZE) != first)
        change()
        np.testing.assert_array_equal(stage.picture(SIZE), first)
    assert len(THEMES) == 2


def test_the_pace_goes_up_and_down_and_stops_at_both_ends(stage: Stage) -> None:
    assert stage.pace is None
    stage.change_pace(1)
    assert stage.pace is None
    for _ in PACES:
        stage.change_pace(-1)
    assert stage.pace == PACES[0]
    assert pace_words(stage.pace) == "1:1000 of real time"


def test_a_faster_impactor_and_another_shape_drop_again_under_a_name_of_their_own(
    stage: Stage,
) -> None:
    """Their figures are not to be compared with what was measured at another velocity."""
    wait(stage, lambda: stage.state == "full speed")
    stage.change_velocity(1)
    assert stage.scene.impactor.velocity == pytest.approx(2.86 + VELOCITY_STEP)
    assert stage.scene.name == "paper/wedge-2.86: wedge, 2.96 m/s"
    assert stage.state == "preparing"
    stage.next_shape()
    assert stage.scene.name == "paper/wedge-2.86: flat, 2.96 m/s"
    wait(stage, lambda: stage.state == "full speed")


def test_a_change_that_cannot_be_is_said_and_nothing_is_dropped(stage: Stage) -> None:
    wait(stage, lambda: stage.state == "full speed")
    for _ in range(28):
        stage.change_velocity(-1)
    wait(stage, lambda: stage.state == "full speed" and stage.scene == stage.session.scene)
    stage_drops = stage.session.drop
    stage.change_velocity(-1)
    assert stage.scene.impactor.velocity == pytest.approx(0.06)
    assert "impactor.velocity" in stage.message
    assert "must be above 0" in stage.message
    assert stage.session.drop == stage_drops
    stage.dismiss()
    assert stage.message == ""


def test_a_drop_at_its_end_is_kept_once_and_stays_in_view(kept: list[Result]) -> None:
    scene = scene_of(end=0.002)
    with Stage(scene, kept.append, pace=None) as stage:
        wait(stage, lambda: stage.ended)
        assert stage.state == "at its end"
        stage.finish()
        assert not stage.was_cut
        stage.update(0.5)
        assert np.ptp(field(stage)) > 0
    assert [result.run["ended_by"] for result in kept] == [Ending.END_TIME]


def test_a_drop_that_is_finished_early_is_kept_as_it_is(stage: Stage, kept: list[Result]) -> None:
    wait(stage, lambda: stage.state == "full speed")
    stage.update(0.3)
    stage.finish()
    assert stage.was_cut
    assert [result.run["interrupted"] for result in kept] == [True]
    assert len(kept[0].history["time_s"]) > 1


def test_a_step_goes_on_by_a_frame_and_stays_paused(stage: Stage) -> None:
    wait(stage, lambda: stage.state == "full speed")
    stage.toggle_pause()
    wait(stage, lambda: stage.session.last.paused)
    before = stage.session.last.snapshot.time
    stage.step()
    interval = stage.scene.output.snapshot_interval
    wait(stage, lambda: stage.session.last.snapshot.time >= before + interval)
    stage.update(0.3)
    assert stage.session.last.snapshot.time < before + 1.2 * interval
    assert stage.state == "paused"


def test_a_worker_that_dies_is_told_of_and_replaced(stage: Stage) -> None:
    wait(stage, lambda: stage.state == "full speed")
    stage.session._process.kill()
    wait(stage, lambda: "signal 9" in stage.message)
    assert stage.state == "failed"
    stage.again()
    wait(stage, lambda: stage.state == "full speed")


def test_what_cannot_be_kept_stays_until_it_can_and_nothing_is_dropped_meanwhile() -> None:
    """A full disk: the result is not lost, and no further one joins it."""
    kept: list[Result] = []
    is_full = True

    def keep(result: Result) -> None:
        if is_full:
            raise UserError("output folder x: cannot be written, the disk is full.")
        kept.append(result)

    with Stage(scene_of(end=0.002), keep, pace=None) as stage:
        wait(stage, lambda: stage.ended)
        assert "the disk is full" in stage.message
        stage.again()
        assert stage.session.drop == 1
        is_full = False
        stage.again()
        assert stage.message == ""
        assert len(kept) == 1
        assert stage.session.drop == 2
        is_full = True
        wait(stage, lambda: stage.ended)
        stage.finish()
        assert [result.scene for result in stage.unkept] == [stage.scene]
        assert "the disk is full" in stage.problem


def test_ctrl_c_while_a_result_is_written_waits_until_it_is_whole() -> None:
    kept: list[Result] = []

    def keep(result: Result) -> None:
        os.kill(os.getpid(), signal.SIGINT)
        time.sleep(0.05)
        kept.append(result)

    with Stage(scene_of(end=0.002), keep, pace=None) as stage:
        with pytest.raises(KeyboardInterrupt):
            wait(stage, lambda: stage.ended and bool(kept))
        assert len(kept) == 1
        assert stage.unkept == []


def test_a_key_that_is_held_down_piles_up_no_drops(stage: Stage, kept: list[Result]) -> None:
    """While one is prepared, the last change waits."""
    for _ in range(200):
        stage.again()
    stage.next_shape()
    assert stage.session.drop == 1
    wait(stage, lambda: stage.session.drop == 2)
    assert stage.session.scene.impactor.shape == "flat"


def test_a_run_that_goes_astray_is_kept_and_told_of(kept: list[Result]) -> None:
    coarse = ("block.columns=20", "block.rows=10", "numerics.dt=1e-4")
    scene = tf.load_scene("paper/wedge-2.86", overrides=coarse)
    with Stage(scene, kept.append, pace=None) as stage:
        wait(stage, lambda: stage.ended)
        assert stage.state == "failed"
        assert "diverged" in stage.message
        assert stage.failures == [stage.message]
    assert [result.run["ended_by"] for result in kept] == [Ending.DIVERGED]


def test_a_long_message_is_a_strip_at_the_foot_with_whole_lines() -> None:
    image = np.zeros((360, 640, 3), dtype=np.uint8)
    strip(image, "a message of many words that says what is wrong " * 4, "light")
    rows, columns = np.nonzero(image.any(axis=-1))
    assert rows.max() == 359
    assert rows.min() > 200
    assert np.ptp(columns) == 639
    words = np.all(image < 100, axis=-1) & image.any(axis=-1)
    assert words[:, 10:630].any()
    assert not words[:, 632:].any()


def test_the_panel_lies_in_the_middle_and_holds_its_words() -> None:
    image = np.zeros((720, 1280, 3), dtype=np.uint8)
    panel(image, [("A", "first"), ("Space", "second, which is longer")], "light")
    rows, columns = np.nonzero(image.any(axis=-1))
    assert rows.min() + rows.max() == pytest.approx(719, abs=1)
    assert columns.min() + columns.max() == pytest.approx(1279, abs=1)
    words = np.all(image < 100, axis=-1) & image.any(axis=-1)
    assert words.any()
    assert not words[:, columns.max() - 15 :].any()
