"""The page's view with a session that computes nothing: commands, their limits, their errors."""

from __future__ import annotations

import io
import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

import taichi_foam
from taichi_foam.live import controller as controller_module
from taichi_foam.live.controller import MOST_SIZES, WAITING
from taichi_foam.live.messages import Frame
from taichi_foam.live.page import commands
from taichi_foam.live.page.commands import MOST_AT_ONCE, MOST_OF_ONE, Inbox
from taichi_foam.live.page.view import PageView
from taichi_foam.live.pictures import LENGTH
from taichi_foam.picture.colours import THEMES
from taichi_foam.records.history import ROW_COLUMNS
from taichi_foam.shim2000.impacts import paper_scene


class _Session:
    """Stands still, whatever it is told."""

    begun: list[_Session]
    fails = False

    def __init__(self, arch: str, threads: int | None, drops: int) -> None:
        if self.fails:
            raise OSError("no process to be had")
        self.begun.append(self)
        self.alive = self.ended = True
        self.last: Frame | None = None
        self.paused = self.settled = False
        self.rows = np.empty((0, len(ROW_COLUMNS)))
        self.before, self.drops = drops, 0

    def start(self, scene: Any, keeping: Any) -> int:
        self.drops += 1
        return self.before + self.drops

    def poll(self, wait: float) -> list[Any]:
        time.sleep(min(wait, 0.01))
        return []

    def ask(self) -> None:
        pass

    def close(self) -> None:
        self.alive = False


@pytest.fixture
def view(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[PageView]:
    _Session.begun, _Session.fails = [], False
    monkeypatch.setattr(controller_module, "Session", _Session)
    found = PageView(paper_scene("paper/wedge-2.86"), tmp_path)
    yield found
    found.close()


def wait_until(is_it: Callable[[], Any]) -> None:
    until = time.monotonic() + 30.0
    while not is_it():
        assert time.monotonic() < until
        time.sleep(0.005)


def let(**values: int) -> commands.Drop:
    named = {f"block.{key}": value for key, value in values.items()}
    return commands.Drop(do="drop", shape="wedge", values=named)


def moved(**values: float) -> commands.Set:
    named = {f"impactor.{key}": value for key, value in values.items()}
    return commands.Set(do="set", shape="wedge", values=named)


def test_the_start_is_drawn_before_anybody_comes_and_anything_is_computed(view: PageView) -> None:
    view.start()
    wait_until(lambda: "light" in view.view_state.pictures)
    wait_until(lambda: "numbers" in view.view_state.notes)
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
    root = str(Path(taichi_foam.__file__).parents[1])
    done = subprocess.run(
        [sys.executable, "-c", _FIRST_PICTURE],
        env={**os.environ, "PYTHONPATH": root}, capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert done.stdout.split() == ["taichi"]


def test_a_process_computes_lattices_of_few_sizes(view: PageView) -> None:
    view.start()
    wait_until(lambda: _Session.begun)
    problems: list[str] = []
    for count in range(2 * MOST_SIZES):
        view.tell(let(rows=31 + count // 2), problems.append)  # each size twice
        wait_until(lambda count=count: view.controller.number == count + 2)
    # with the size that the scene has itself there are one more than a process has room for
    assert problems == []
    assert [each.drops for each in _Session.begun] == [1 + 2 * (MOST_SIZES - 1), 2]
    assert [each.alive for each in _Session.begun] == [False, True]


def test_a_process_that_cannot_be_started_is_told_and_started_with_the_next_drop(
    view: PageView,
) -> None:
    _Session.fails = True
    view.start()
    wait_until(lambda: '"died"' in view.view_state.notes.get("numbers", (0, ""))[1])
    assert "no process to be had" in view.view_state.notes["numbers"][1]
    problems: list[str] = []
    for command in (commands.Pause(do="pause", on=True), commands.Pace(do="pace", rate=None)):
        view.tell(command, problems.append)
    _Session.fails = False
    view.tell(commands.Reset(do="reset"), problems.append)
    wait_until(lambda: _Session.begun)
    wait_until(lambda: '"preparing"' in view.view_state.notes["numbers"][1])
    assert problems == []


def test_what_a_command_brings_about_is_told_to_its_sender_alone(
    view: PageView, monkeypatch: pytest.MonkeyPatch
) -> None:
    def check(*_: Any) -> None:
        raise OverflowError("nobody has thought of this")

    view.start()
    wait_until(lambda: '"preparing"' in view.view_state.notes.get("numbers", (0, ""))[1])
    monkeypatch.setattr(view.controls, "check", check)
    problems: list[str] = []
    view.tell(moved(mass=1), problems.append)
    wait_until(lambda: problems)
    assert problems == ["OverflowError: nobody has thought of this"]
    assert (view.controller.state, view.controller.message) == ("preparing", "")


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
    assert [command for command, _ in taken[:4]] == [
        moved(mass=999),
        let(rows=9),
        moved(mass=999),
        moved(velocity=1),
    ]
    assert [whose for _, whose in inbox.take()] == [other.append]


def test_measured_figures_go_with_the_test_not_with_the_name(tmp_path: Path) -> None:
    view = PageView(paper_scene("paper/wedge-2.86"), tmp_path)  # never started

    def told(scene: Any) -> dict[str, Any]:
        view.controller.scene = scene
        view._post_scene()
        return json.loads(view.view_state.notes["scene"][1])

    given = view.controls.given
    assert told(given)["name"] == "wedge, 2.86 m/s"
    assert told(given)["measured"]["max_displacement_m"] == 0.075
    finer = view.controls.scene_of("wedge", {"block.rows": 30})
    assert (told(finer)["name"], told(finer)["measured"]["test"]) == ("wedge, 2.86 m/s", given.name)
    heavier = view.controls.scene_of("wedge", {"impactor.mass": 7.0})
    assert (told(heavier)["changes"], told(heavier)["measured"]) == (["mass 7 kg"], None)
