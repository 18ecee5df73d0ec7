"""A run in a process of its own: what a viewer can ask of it, and how either end may vanish."""

from __future__ import annotations

import multiprocessing
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bench import assert_same
from processes import PATIENCE, until
from sessions import ENDLESS, drop_of

from taichi_foam.live import session as session_module
from taichi_foam.live.messages import Died, Ended, Frame, Keeping, Pace, Pause, Refused, Step
from taichi_foam.live.session import Session
from taichi_foam.records.history import row_columns
from taichi_foam.simulation.simulate import run

ROW = row_columns(turns=False)

on_linux = pytest.mark.skipif(sys.platform != "linux", reason="looks into /proc")


@pytest.fixture
def session(session: Session) -> Session:
    """It has begun, with nothing left to tell."""
    look(session)
    return session


def ask(session: Session) -> None:
    """Ask for a frame, of a drop at rest, too."""
    if not session._is_asked:
        session._is_asked = True
        session._send("ask")


def wait_for(session: Session, is_it: Callable[[Any], bool]) -> Any:
    """The first event that `is_it`, asking for frames."""

    def found() -> Any:
        ask(session)
        return next((event for event in session.poll(0.05) if is_it(event)), None)

    return until(found, "it did not come")


def frame_when(session: Session, is_it: Callable[[Frame], Any]) -> Frame:
    """The first frame that `is_it`."""
    return wait_for(session, lambda event: isinstance(event, Frame) and is_it(event))


def look(session: Session) -> Frame:
    """A frame of now, not one that was asked for earlier."""
    until(lambda: not session._is_asked, "no frame came", turn=session.poll)
    return frame_when(session, lambda frame: True)


def worker_of(session: Session) -> int:
    """The worker's process number."""
    process = session._worker.process
    assert process in multiprocessing.active_children()
    assert process.pid is not None
    return process.pid


def cpu_seconds(pid: int) -> float:
    """Processor time that a process has taken so far [s]."""
    values = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(values[11]) + int(values[12])) / os.sysconf("SC_CLK_TCK")


def wait_to_take(pid: int, seconds: float) -> None:
    """Until a process has taken so much more processor time [s]."""
    goal = cpu_seconds(pid) + seconds
    until(lambda: cpu_seconds(pid) >= goal, "it does not go on")


def test_frames_come_when_asked_for(session: Session) -> None:
    assert not [event for event in session.poll(0.1) if isinstance(event, Frame)]
    first = look(session)
    assert (first.drop, first.ended, first.paused) == (session.number, False, False)
    time.sleep(0.1)
    second = look(session)
    assert session.frame is second
    assert second.snapshot.time > first.snapshot.time
    assert second.steps > first.steps
    assert second.wall > first.wall
    times = session.rows[:, ROW.index("clock.time")]
    assert np.all(np.diff(times) > 0)
    assert times[0] == 0.0
    assert times[-1] <= second.snapshot.time


def test_no_rows_have_as_many_columns_as_rows(session: Session) -> None:
    session.drop(ENDLESS)
    assert session.rows.shape == (0, len(ROW))


@on_linux
def test_a_pause_holds_time_and_takes_no_processor(session: Session) -> None:
    session.tell(Pause(True))
    before = look(session)
    assert before.paused
    taken = cpu_seconds(worker_of(session))
    time.sleep(0.5)
    assert cpu_seconds(worker_of(session)) - taken <= 0.02
    assert look(session).snapshot.time == before.snapshot.time
    session.tell(Pause(False))
    held = before.snapshot.time
    after = frame_when(session, lambda frame: frame.snapshot.time > held)
    assert not after.paused


def test_a_frame_is_of_an_instant_that_the_history_holds(session: Session) -> None:
    rows: list[np.ndarray] = []
    for pace in (None, 1e-2, 1e-3):
        session.tell(Pace(pace))
        for _ in range(4):
            frame = look(session)
            rows.append(frame.rows)
            times = np.concatenate(rows)[:, ROW.index("clock.time")]
            assert frame.snapshot.time in times[-3:]
    session.tell(Pause(True))
    # at rest it is the latest, and stays so
    frames = [look(session) for _ in range(4)]
    assert len({frame.snapshot.time for frame in frames[2:]}) == 1
    assert frames[-1].snapshot.time == session.rows[-1, ROW.index("clock.time")]


def test_a_step_goes_as_far_as_asked_and_stays_paused(session: Session) -> None:
    """From row to row of the history, which lie up to a step of 13 us after they are due; what is
    asked for twice adds up."""
    session.tell(Pace(None))
    session.tell(Pause(True))
    start = look(session).snapshot.time
    session.tell(Step(2e-3))
    frame = frame_when(session, lambda frame: frame.paused)
    assert abs(frame.snapshot.time - start - 2e-3) < 2e-5
    session.tell(Step(30e-3))
    session.tell(Step(30e-3))
    start = frame.snapshot.time
    while not session.settled:
        frame = look(session)
    assert frame.paused
    assert abs(frame.snapshot.time - start - 60e-3) < 2e-5


def test_a_pace_is_kept(session: Session) -> None:
    """Within a tenth: frames are up to 10 ms old. A pause does not make it jump."""
    session.tell(Pace(0.05))
    first = look(session)
    session.tell(Pause(True))
    time.sleep(0.3)
    held = look(session)
    session.tell(Pause(False))
    assert held.snapshot.time - first.snapshot.time < 0.05 * 0.6
    first, start = look(session), time.monotonic()
    time.sleep(1.5)
    last, end = look(session), time.monotonic()
    went = last.snapshot.time - first.snapshot.time
    assert went == pytest.approx(0.05 * (end - start), rel=0.1)


def test_another_scene_may_start_at_any_time(session: Session) -> None:
    old = session.number
    look(session)
    session.drop(drop_of(10.0, "impactor.velocity=1.0"))
    assert (session.frame, len(session.rows)) == (None, 0)
    frame = frame_when(session, lambda frame: len(frame.rows))
    assert frame.drop == session.number == old + 1
    assert frame.rows[0, ROW.index("body.v")] == -1.0
    assert session.result is None


def test_finish_gives_what_there_is(session: Session) -> None:
    frame_when(session, lambda frame: frame.snapshot.time > 0.01)
    assert session.finish()
    result = session.result
    assert result is not None
    assert result.run["interrupted"]
    assert result.history["time_s"][-1] > 0.01
    assert len(result.snapshots) > 1
    assert session.ended
    assert not session.finish()  # it is over
    assert session.result is result
    assert look(session).ended


def test_finish_before_anything_gives_nothing(session: Session) -> None:
    pid = worker_of(session)
    os.kill(pid, signal.SIGSTOP)  # so that it hears of all before it computes
    session.drop(ENDLESS)
    session.tell(Pause(True))
    assert not session.finish()  # nothing to wait for
    session._send("finish")
    os.kill(pid, signal.SIGCONT)
    ended = wait_for(session, lambda event: isinstance(event, Ended))
    assert (ended.result, session.result, session.state) == (None, None, "cut short")


def test_an_ended_run_is_the_run_to_the_last_bit(session: Session) -> None:
    scene = drop_of(0.03, "output.snapshot_interval=2e-3")
    session.tell(Pace(None))
    session.drop(scene)
    result = wait_for(session, lambda event: isinstance(event, Ended)).result
    whole = run(scene)
    assert result.scene == scene
    assert_same(whole, result)
    last = look(session)
    assert last.ended
    assert last.fraction == 1.0
    np.testing.assert_array_equal(session.rows[:, ROW.index("clock.time")], whole.history["time_s"])


@on_linux
def test_a_viewer_that_takes_nothing_holds_nothing_up(session: Session) -> None:
    """Frames with thousands of rows do not fit into the pipe.

    Ctrl-C, a closed terminal and the end of a service are the viewer's to answer.
    """
    pid = worker_of(session)
    session.tell(Pace(None))
    wait_to_take(pid, 0.6)
    ask(session)
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        os.kill(pid, number)
    wait_to_take(pid, 0.3)
    assert len(look(session).rows) < len(session.rows)
    assert session.rows.nbytes > 250_000


def test_an_absent_device_is_refused() -> None:
    with Session(ENDLESS, arch="metal") as session:
        refused = wait_for(session, lambda event: isinstance(event, Refused))
        assert "arch = 'metal'" in refused.message
        assert not session.finish()
        assert session.alive


@on_linux
def test_a_worker_that_does_not_leave_is_ended(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(session_module, "GRACE", 0.2)
    session = Session(ENDLESS)
    session.drop(ENDLESS)
    pid = worker_of(session)
    os.kill(pid, signal.SIGSTOP)
    session.close()
    assert not session.alive
    assert session.poll(0.1) == []
    assert pid not in [each.pid for each in multiprocessing.active_children()]


# A script without a guard, as people write them.
VIEWER = """
import time
from taichi_foam.live.session import Session
from sessions import ENDLESS
from test_session import look, worker_of
session = Session(ENDLESS)
session.drop(ENDLESS)
look(session)
print(worker_of(session), flush=True)
"""


@on_linux
@pytest.mark.parametrize("is_killed", [False, True])
def test_a_viewer_that_closes_nothing_leaves_no_process_behind(
    tmp_path: Path, is_killed: bool
) -> None:
    """Neither at the end of its script nor by SIGKILL.

    The worker heeds no polite signal, as which multiprocessing would wait for it for ever.
    """
    script = tmp_path / "viewer.py"
    script.write_text(f"{VIEWER}time.sleep({600 if is_killed else 0})\n")
    viewer = subprocess.Popen(
        [sys.executable, str(script)],
        stdout=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
    )
    assert viewer.stdout is not None
    worker = Path(f"/proc/{int(viewer.stdout.readline())}")
    if is_killed:
        modules = (worker / "maps").read_text()
        assert "taichi_python" in modules
        assert "matplotlib" not in modules
        viewer.kill()
    assert viewer.wait(PATIENCE) == (-signal.SIGKILL if is_killed else 0)
    until(lambda: not worker.exists(), "the worker goes on")


@pytest.mark.parametrize(
    ("module", "absent"),
    [
        ("session", ("matplotlib", "typer")),
        ("worker", ("taichi", "matplotlib", "numpy", "pydantic")),  # before it ignores Ctrl-C
    ],
)
def test_what_takes_long_to_load_is_not_loaded(module: str, absent: tuple[str, ...]) -> None:
    code = f"import sys, taichi_foam.live.{module}\nprint(set({absent}) & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["set()"]


@on_linux
def test_a_drop_that_is_killed_goes_on_from_its_checkpoint_to_the_last_bit(tmp_path: Path) -> None:
    scene = drop_of(0.12, "output.snapshot_interval=5e-3")
    whole = run(scene)

    goes_on = True
    keeping = lambda _: Keeping(tmp_path, 0.05, goes_on)  # noqa: E731
    with Session(scene, pace=0.05, keeping=keeping) as session:
        frame_when(session, lambda frame: frame.snapshot.time > 0.03)
        os.kill(worker_of(session), signal.SIGKILL)
        wait_for(session, lambda event: isinstance(event, Died))
        session.drop(scene)
        assert look(session).snapshot.time > 0.0
        frame_when(session, lambda frame: frame.snapshot.time > 0.06)
        session.finish()  # as when a window is closed: what there is is kept, too
        session.tell(Pace(None))
        session.drop(scene)
        result = wait_for(session, lambda event: isinstance(event, Ended)).result
        assert result.run["resumed"] == 2
        assert_same(whole, result)
        # who drops again begins at the start
        goes_on = False
        session.tell(Pace(0.05))
        session.drop(scene)
        assert look(session).snapshot.time < 1e-3
