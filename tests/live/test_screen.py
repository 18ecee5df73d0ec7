"""What is done to a drop, what becomes of it, and what one person sees of it, without a window.

All tests share one process that computes; the test that kills it has it replaced.
"""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable
from itertools import pairwise

import numpy as np
import pytest
from processes import PATIENCE, until
from sessions import PACE, Keeper, drop_of

from taichi_foam.errors import UserError
from taichi_foam.live import screen as screen_module
from taichi_foam.live.messages import Died, Pause
from taichi_foam.live.screen import FPS, VELOCITY_STEP, Screen, pace_words, panel, strip
from taichi_foam.live.session import PACES, WAITING, Session
from taichi_foam.picture.look import THEMES
from taichi_foam.picture.modes import MODES
from taichi_foam.records.ending import Ending
from taichi_foam.results.result import Result
from taichi_foam.scene import Scene

SIZE = (640, 360)
GOING = pace_words(PACE)


@pytest.fixture
def screen(session: Session) -> Screen:
    return Screen(session)


def wait(screen: Screen, is_it: Callable[[], bool]) -> None:
    until(is_it, "it did not come to that", turn=screen.update)


def begin(screen: Screen, scene: Scene) -> None:
    """Drop a scene as soon as the drop that is being prepared lets it."""
    screen.session.drop(scene)
    wait(screen, lambda: screen.session.scene == scene)


def field(screen: Screen) -> np.ndarray:
    """The picture without its title line and what stands beside the field."""
    return screen.picture(SIZE)[40:340, 12:500]


def test_the_start_is_shown_before_anything_is_computed(
    screen: Screen, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert screen.state == "preparing"
    assert screen.session.waiting == WAITING
    said: list[str] = []
    with monkeypatch.context() as patch:
        patch.setattr(screen_module, "strip", lambda image, text, theme: said.append(text))
        before = screen.picture(SIZE)
    assert said == [WAITING]
    wait(screen, lambda: screen.state == GOING)
    assert screen.session.waiting == ""
    assert np.any(screen.picture(SIZE) != before)


def test_looks_change_the_picture_and_come_round_again(screen: Screen, session: Session) -> None:
    """Forwards through all modes, back by one, both themes, the grid and the curve."""
    wait(screen, lambda: screen.state == GOING)
    screen.toggle_pause()
    wait(screen, lambda: session.settled)
    first = screen.picture(SIZE)
    seen = []
    for _ in MODES:
        seen.append(screen.picture(SIZE))
        screen.next_mode()
    assert all(np.any(a != b) for a, b in pairwise(seen))
    np.testing.assert_array_equal(screen.picture(SIZE), first)
    screen.next_mode(-1)
    np.testing.assert_array_equal(screen.picture(SIZE), seen[-1])
    screen.next_mode()
    for change in (screen.next_theme, screen.toggle_grid, screen.toggle_curve):
        change()
        assert np.any(screen.picture(SIZE) != first)
        change()
        np.testing.assert_array_equal(screen.picture(SIZE), first)
    assert len(THEMES) == 2


def test_the_pace_goes_up_and_down_and_stops_at_both_ends(session: Session) -> None:
    for _ in PACES:
        session.change_pace(1)
    assert session.pace is None
    for _ in PACES:
        session.change_pace(-1)
    assert session.pace == PACES[0]
    assert pace_words(session.pace) == "1:1000 of real time"


def test_a_faster_impactor_and_another_shape_drop_again_under_a_name_of_their_own(
    screen: Screen, session: Session
) -> None:
    """Their figures are not to be compared with what was measured at another velocity."""
    wait(screen, lambda: screen.state == GOING)
    screen.change_velocity(1)
    assert session.next.impactor.velocity == pytest.approx(2.32 + VELOCITY_STEP)
    assert session.next.name == "cylinder, 2.42 m/s"
    assert screen.state == "preparing"
    screen.next_shape()
    assert session.next.name == "wedge, 2.42 m/s"
    wait(screen, lambda: screen.state == GOING)


def test_a_change_that_cannot_be_is_said_and_nothing_is_dropped(
    screen: Screen, session: Session
) -> None:
    wait(screen, lambda: screen.state == GOING)
    for _ in range(23):
        screen.change_velocity(-1)
    wait(screen, lambda: screen.state == GOING and session.scene == session.next)
    number = session.number
    screen.change_velocity(-1)
    assert session.next.impactor.velocity == pytest.approx(0.02)
    assert "impactor.velocity" in screen.message
    assert "must be above 0" in screen.message
    assert session.number == number
    screen.dismiss()
    assert screen.message == ""


def test_a_drop_at_its_end_is_kept_once_and_stays_in_view(
    screen: Screen, session: Session, kept: list[Result]
) -> None:
    scene = drop_of(end=0.002)
    begin(screen, scene)
    wait(screen, lambda: session.ended)
    assert screen.state == "ended"
    session.finish()
    assert not session.was_cut
    screen.update(0.5)
    assert np.ptp(field(screen)) > 0
    assert [result.run["ended_by"] for result in kept] == [Ending.END_TIME]


def test_a_drop_that_is_finished_early_is_kept_as_it_is(
    screen: Screen, session: Session, kept: list[Result]
) -> None:
    wait(screen, lambda: screen.state == GOING)
    screen.update(0.3)
    session.finish()
    assert session.was_cut
    assert [result.run["interrupted"] for result in kept] == [True]
    assert len(kept[0].history["time_s"]) > 1


def test_a_step_goes_on_by_a_frame_and_stays_paused(screen: Screen, session: Session) -> None:
    wait(screen, lambda: screen.state == GOING)
    screen.toggle_pause()
    wait(screen, lambda: session.settled)
    before = session.snapshot.time
    screen.step()
    interval = PACE / FPS
    # from row to row of the history, either of them up to a step of 13 us late
    wait(screen, lambda: session.snapshot.time >= before + interval - 2e-5)
    screen.update(0.3)
    assert session.snapshot.time < before + 1.2 * interval
    assert screen.state == "paused"


def test_what_cannot_be_kept_stays_until_it_can_and_nothing_is_dropped_meanwhile(
    screen: Screen, session: Session, keeper: Keeper
) -> None:
    """A full disk: the result is not lost, and no further one joins it."""
    is_full = True

    def refuse() -> None:
        if is_full:
            raise UserError("output folder x: cannot be written, the disk is full.")

    keeper.first = refuse
    begin(screen, drop_of(end=0.002))
    number = session.number
    wait(screen, lambda: session.ended)
    assert "the disk is full" in screen.message
    session.restart()
    assert session.number == number
    is_full = False
    session.restart()
    assert screen.message == ""
    assert len(keeper.kept) == 1
    assert session.number == number + 1
    is_full = True
    wait(screen, lambda: session.ended)
    session.finish()
    assert [outcome.result.scene for outcome in session.unkept] == [session.scene]
    assert "the disk is full" in session.problem


def test_ctrl_c_while_a_result_is_written_waits_until_it_is_whole(
    screen: Screen, session: Session, keeper: Keeper
) -> None:
    def press() -> None:
        os.kill(os.getpid(), signal.SIGINT)
        time.sleep(0.05)

    keeper.first = press
    begin(screen, drop_of(end=0.002))
    with pytest.raises(KeyboardInterrupt):
        wait(screen, lambda: session.ended and bool(keeper.kept))
    assert len(keeper.kept) == 1
    assert session.unkept == []


def test_a_key_that_is_held_down_piles_up_no_drops(screen: Screen, session: Session) -> None:
    """While one is prepared, the last change waits."""
    number = session.number
    for _ in range(200):
        session.restart()
    screen.next_shape()
    assert session.number == number
    wait(screen, lambda: session.number == number + 1)
    assert session.scene.impactor.shape == "wedge"


def test_a_run_that_goes_astray_is_kept_and_told_of(
    screen: Screen, session: Session, kept: list[Result]
) -> None:
    """With six times the step that is stable."""
    begin(screen, drop_of(0.01, "numerics.dt=1e-4"))
    wait(screen, lambda: session.ended)
    assert screen.state == "failed"
    assert "diverged" in screen.message
    assert session.failures == [screen.message]
    assert [result.run["ended_by"] for result in kept] == [Ending.DIVERGED]
    assert session.result is kept[0]
    assert session.alive


def test_a_worker_that_dies_is_told_of_once_and_replaced(screen: Screen, session: Session) -> None:
    wait(screen, lambda: screen.state == GOING)
    number, told = session.number, []
    session._worker.process.kill()
    until(lambda: session.ended, "not told", turn=lambda wait: told.extend(session.poll(wait)))
    (died,) = [event for event in told if isinstance(event, Died)]
    assert "signal 9" in died.message
    assert "signal 9" in screen.message
    assert screen.state == "failed"
    assert not session.alive
    session.tell(Pause(True))
    session._send("ask")
    start = time.monotonic()
    assert not session.finish()
    assert time.monotonic() - start < 0.1 * PATIENCE  # nobody is there to wait for
    assert session.poll(0.1) == []
    session.restart()  # by another one
    assert (session.number, session.alive) == (number + 1, True)
    wait(screen, lambda: screen.state == GOING)


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
