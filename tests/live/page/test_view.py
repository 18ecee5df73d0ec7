"""The page's view with a session that computes nothing: commands, their limits, their errors."""

from __future__ import annotations

import io
import json
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from processes import ENVIRONMENT, until

from taichi_foam.engine.state import initial_state
from taichi_foam.live import session as session_module
from taichi_foam.live.messages import Command, Ended, Event, Frame, Pace, Pause, Start
from taichi_foam.live.page import commands
from taichi_foam.live.page.commands import MOST_AT_ONCE, MOST_OF_ONE, Inbox
from taichi_foam.live.page.view import LENGTH, PageView
from taichi_foam.live.session import MOST_SIZES, WAITING
from taichi_foam.picture.look import THEMES
from taichi_foam.records.history import row_columns
from taichi_foam.shim2000.impacts import paper_scene


class _Worker:
    """Computes nothing, whatever it is told: shows the start of a drop, or not even that."""

    begun: list[_Worker]
    fails = False
    shows = False

    def __init__(self, arch: str, threads: int | None) -> None:
        if self.fails:
            raise OSError("no process to be had")
        self.begun.append(self)
        self.alive = True
        self.drops: list[int] = []
        self.told: list[Event] = []

    def send(self, command: Command) -> None:
        match command:
            case Start(drop, scene):
                self.drops.append(drop)
                if self.shows:
                    start = initial_state(scene).snapshot()
                    rows = np.empty((0, len(row_columns(turns=False))))
                    self.told.append(Frame(drop, start, rows, 0.0, 0, 0.0, False, False))
            case "finish":
                self.told.append(Ended(self.drops[-1], None))

    def events(self, wait: float) -> list[Event]:
        if not self.told:
            time.sleep(min(wait, 0.01))
        told, self.told = self.told, []
        return told

    def close(self) -> None:
        self.alive = False


@pytest.fixture
def view(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[PageView]:
    _Worker.begun, _Worker.fails, _Worker.shows = [], False, False
    monkeypatch.setattr(session_module, "_Worker", _Worker)
    found = PageView(paper_scene("paper/wedge-2.86"), tmp_path)
    yield found
    found.close()


def is_told(view: PageView, word: str) -> bool:
    return word in view.view_state.notes.get("numbers", (0, ""))[1]


def let(rows: int) -> commands.Drop:
    return commands.Drop("wedge", {"block.rows": rows})


def moved(**values: float) -> commands.Set:
    return commands.Set("wedge", {f"impactor.{key}": value for key, value in values.items()})


def test_the_start_is_drawn_before_anybody_comes_and_anything_is_computed(view: PageView) -> None:
    view.start()
    until(lambda: "light" in view.view_state.pictures, "nothing is drawn")
    until(lambda: "numbers" in view.view_state.notes, "nothing is told")
    told = json.loads(view.view_state.notes["numbers"][1])
    assert (told["state"], told["waiting"]) == ("preparing", WAITING)
    packed = view.view_state.pictures["light"][1]
    start = LENGTH.size + LENGTH.unpack_from(packed)[0]
    assert json.loads(packed[LENGTH.size : start])["time"] == 0.0
    picture = np.asarray(Image.open(io.BytesIO(packed[start:])).convert("RGB"))
    for colour in (THEMES["light"].steel, THEMES["light"].field):
        assert np.any(np.all(picture == colour, axis=2))


_FIRST_PICTURE = """
import sys
from pathlib import Path
from taichi_foam.live.page.view import PageView
from taichi_foam.shim2000.impacts import paper_scene

view = PageView(paper_scene("paper/wedge-2.86"), Path())
view._draw()
assert view.view_state.pictures
print(*sorted({"scipy.signal", "taichi_foam.engine.cpu", "taichi"} & set(sys.modules)))
"""


def test_the_first_picture_waits_for_no_stepping_and_no_filter() -> None:
    done = subprocess.run(
        [sys.executable, "-c", _FIRST_PICTURE],
        env=ENVIRONMENT, capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert done.stdout.split() == ["taichi"]


def test_a_process_computes_lattices_of_few_sizes(view: PageView) -> None:
    _Worker.shows = True
    view.start()
    until(lambda: _Worker.begun, "no process is started")
    problems: list[str] = []
    for count in range(2 * MOST_SIZES):
        view.tell(let(rows=31 + count // 2), problems.append)  # each size twice
        until(lambda count=count: view.session.number == count + 2, "it does not drop")
    # with the size that the scene has itself there are one more than a process has room for
    assert problems == []
    assert [len(each.drops) for each in _Worker.begun] == [1 + 2 * (MOST_SIZES - 1), 2]
    assert [each.alive for each in _Worker.begun] == [False, True]


def test_a_process_that_cannot_be_started_is_told_and_started_with_the_next_drop(
    view: PageView,
) -> None:
    _Worker.fails = True
    view.start()
    until(lambda: is_told(view, '"died"'), "that nothing computes is not told")
    assert "no process to be had" in view.view_state.notes["numbers"][1]
    problems: list[str] = []
    for command in (Pause(True), Pace(None)):
        view.tell(command, problems.append)
    _Worker.fails = False
    view.tell(commands.Reset(), problems.append)
    until(lambda: _Worker.begun, "no process is started")
    until(lambda: is_told(view, '"preparing"'), "it does not drop")
    assert problems == []


def test_what_a_command_brings_about_is_told_to_its_sender_alone(
    view: PageView, monkeypatch: pytest.MonkeyPatch
) -> None:
    def check(*_: Any) -> None:
        raise OverflowError("nobody has thought of this")

    view.start()
    until(lambda: is_told(view, '"preparing"'), "it does not drop")
    monkeypatch.setattr(view.controls, "check", check)
    problems: list[str] = []
    view.tell(moved(mass=1), problems.append)
    until(lambda: problems, "no problem is told")
    assert problems == ["OverflowError: nobody has thought of this"]
    assert (view.session.state, view.session.message) == ("preparing", "")


def test_little_of_each_viewer_waits() -> None:
    inbox = Inbox()
    one, other = [], []
    # a slider that moves takes one place
    for number in range(1000):
        assert inbox.put(moved(mass=number), one.append)
    # but what another command relies on stays before it
    assert inbox.put(let(rows=9), one.append)
    for number in range(1000):
        assert inbox.put(moved(mass=number), one.append)
    assert inbox.put(moved(velocity=1), one.append)
    came = [inbox.put(let(rows=9), one.append) for _ in range(1000)]
    assert sum(came) == MOST_OF_ONE - 4
    assert inbox.put(let(rows=9), other.append)
    taken = inbox.take()
    assert len(taken) == MOST_AT_ONCE
    first = [moved(mass=999), let(rows=9), moved(mass=999), moved(velocity=1)]
    assert [command for command, _ in taken[:4]] == first
    assert [whose for _, whose in inbox.take()] == [other.append]


def test_of_the_charts_that_one_asks_for_only_the_last_is_drawn() -> None:
    inbox, one, other = Inbox(), [], []
    charts = [commands.Cushion("eps-20", 1e-3 * mm, 0.76, None, None) for mm in range(20, 60)]
    assert all(inbox.put(chart, one.append) for chart in charts)
    assert inbox.put(charts[0], other.append)
    assert [command for command, _ in inbox.take()] == [charts[-1], charts[0]]


def test_measured_figures_go_with_the_test_not_with_the_name(tmp_path: Path) -> None:
    view = PageView(paper_scene("paper/wedge-2.86"), tmp_path)  # never started

    def told(scene: Any) -> dict[str, Any]:
        view.session.scene = scene
        view._post_scene()
        return json.loads(view.view_state.notes["scene"][1])

    given = view.controls.given
    assert told(given)["name"] == "wedge, 2.86 m/s"
    assert told(given)["measured"]["max_displacement_m"] == 0.075
    finer = view.controls.scene_of("wedge", {"block.rows": 30})
    assert (told(finer)["name"], told(finer)["measured"]["test"]) == ("wedge, 2.86 m/s", given.name)
    heavier = view.controls.scene_of("wedge", {"impactor.mass": 7.0})
    assert (told(heavier)["changes"], told(heavier)["measured"]) == (["mass 7 kg"], None)
