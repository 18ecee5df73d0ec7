"""What drops have given is saved, even if a disk refuses it at first; slow viewers are let go."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from processes import until

from taichi_foam.errors import UserError
from taichi_foam.live.page import archive as archive_module
from taichi_foam.live.page import viewers
from taichi_foam.live.page.archive import MOST_CURVES, MOST_LISTED, MOST_WAITING, Archive, Finished
from taichi_foam.live.page.view import ViewState
from taichi_foam.records.history import HISTORY_COLUMNS
from taichi_foam.results.result import Result
from taichi_foam.shim2000.impacts import paper_scene

SCENE = paper_scene("paper/wedge-2.86")


def a_result() -> Result:
    """One that has come to nothing."""
    history = {name: np.linspace(0.0, 1e-3, 11) for name in HISTORY_COLUMNS}
    return Result(SCENE, history, [], {"interrupted": True})


def test_folders_are_numbered_on(tmp_path: Path) -> None:
    (tmp_path / "paper-wedge-2.86-007").mkdir()
    archive = Archive(tmp_path, lambda: None)
    archive.add(1, ["velocity 3 m/s"], "cut short", a_result())
    archive.add(2, [], "rebound", a_result())
    assert archive.close() == []
    names = ["paper-wedge-2.86-007", "paper-wedge-2.86-008", "paper-wedge-2.86-009"]
    assert sorted(path.name for path in tmp_path.iterdir()) == names
    assert Result.load(tmp_path / names[1]).scene == SCENE
    told = archive.told()["drops"]
    assert [drop["number"] for drop in told] == [2, 1]
    assert told[1]["about"] == ["velocity 3 m/s"]


def test_the_list_is_bounded(tmp_path: Path) -> None:
    archive = Archive(tmp_path, lambda: None)
    for number in range(MOST_LISTED + 5):
        archive.add(number, [], "rebound", a_result())
        until(lambda: not archive._waiting(), "it is not saved")
    assert len(archive.told()["drops"]) == MOST_LISTED
    assert len(archive.curves()["curves"]) == MOST_CURVES
    assert archive.find(0) is None
    archive.close()
    assert len(list(tmp_path.iterdir())) == MOST_LISTED + 5


def test_what_a_disk_refuses_is_kept_and_saved_later(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(archive_module, "TRY_AGAIN", 1000.0)
    out = tmp_path / "out"
    archive = Archive(out, lambda: None)
    archive.check(SCENE)
    out.write_text("in the way")
    for number in range(MOST_WAITING):
        archive.add(number, [], "rebound", a_result())
    until(lambda: all(drop["problem"] for drop in archive.told()["drops"]), "no problem told")
    assert "a file, not a folder" in archive.told()["drops"][0]["problem"]
    # no further drop begins, so that no result has to be thrown away
    with pytest.raises(UserError, match="4 drops are waiting to be saved"):
        archive.check(SCENE)
    out.unlink()
    archive.try_again()
    until(lambda: all(drop["folder"] for drop in archive.told()["drops"]), "not all are saved")
    archive.check(SCENE)
    assert archive.close() == []
    assert len(list(out.iterdir())) == MOST_WAITING


def test_what_is_not_saved_stays_however_many_follow(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(archive_module, "TRY_AGAIN", 1000.0)
    monkeypatch.setattr(archive_module, "MOST_LISTED", 2)
    save = Result.save
    broken = [True]

    def moody(result: Result, folder: Path) -> Path:
        if result.run.get("number") == 1 and broken:
            raise ZeroDivisionError("nobody has thought of this")
        return save(result, folder)

    monkeypatch.setattr(Result, "save", moody)
    archive = Archive(tmp_path, lambda: None)
    for number in range(1, 6):
        result = a_result()
        result.run["number"] = number
        archive.add(number, [], "rebound", result)
        until(lambda: len(archive._waiting()) == 1, "others wait, too")
    assert [drop["number"] for drop in archive.told()["drops"]] == [5, 4, 1]
    assert archive.told()["drops"][-1]["problem"].startswith("ZeroDivisionError: nobody")
    broken.clear()
    archive.try_again()
    until(lambda: not archive._waiting(), "it is not saved")
    assert [drop["number"] for drop in archive.told()["drops"]] == [5, 4]
    assert archive.close() == []
    assert len(list(tmp_path.iterdir())) == 5


def test_who_waits_for_a_film_when_the_server_ends_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def for_ever(path: Path) -> None:
        await asyncio.Event().wait()

    monkeypatch.setattr(archive_module, "_drawn_apart", for_ever)
    archive = Archive(tmp_path, lambda: None)
    drop = Finished(1, [], "rebound", None, folder=tmp_path)

    async def ask() -> None:
        films = archive_module.Films(archive)
        for is_closed in (True, False):  # or its asker is cancelled
            asking = asyncio.create_task(films.film(drop, "film.gif"))
            await asyncio.sleep(0.01)
            if is_closed:
                await films.close()
            else:
                asking.cancel()
            with pytest.raises(UserError, match="the server is shutting down"):
                await asking
        await films.close()

    asyncio.run(ask())


def test_closing_tells_what_could_not_be_saved(tmp_path: Path) -> None:
    out = tmp_path / "out"
    out.write_text("in the way")
    archive = Archive(out, lambda: None)
    archive.add(1, [], "rebound", a_result())
    (lost,) = archive.close()
    assert lost.problem is not None
    assert lost.result is not None


class _Socket:
    """A viewer's end that takes everything, or nothing, and says only what it is told to."""

    def __init__(self, takes: bool) -> None:
        self.takes, self.sent, self.closed = takes, [], None
        self.says: asyncio.Queue[dict[str, Any]] = asyncio.Queue()

    async def accept(self) -> None:
        watch = '{"do": "watch", "on": true, "tone": "light"}'
        self.says.put_nowait({"type": "websocket.receive", "text": watch})

    async def receive(self) -> dict[str, Any]:
        return await self.says.get()

    async def send_text(self, content: Any) -> None:
        self.sent.append(content)
        if not self.takes:
            await asyncio.Event().wait()

    send_bytes = send_text

    async def close(self, code: int, reason: str) -> None:
        self.closed = code


class _View:
    def __init__(self) -> None:
        self.view_state = ViewState()
        self.view_state.post("scene", {"drop": 1})
        self.view_state.set_picture("light", b"picture")


@pytest.mark.parametrize("takes", [True, False])
def test_a_viewer_that_does_not_answer_is_let_go(
    monkeypatch: pytest.MonkeyPatch, takes: bool
) -> None:
    monkeypatch.setattr(viewers, "MOST_WAIT", 0.2)

    async def visit() -> _Socket:
        socket, view = _Socket(takes), _View()
        viewer = viewers.Viewer(socket, view)
        view.view_state.wake = viewer.wake
        visiting = asyncio.create_task(viewer.serve())
        for _ in range(500):  # thousands of pictures pass it by
            for _ in range(10):
                view.view_state.set_picture("light", b"picture" * 100)
            await asyncio.sleep(0.001)
            if visiting.done():
                break
        await asyncio.wait_for(visiting, 10.0)
        return socket

    socket = asyncio.run(visit())
    assert socket.closed == viewers.TOO_SLOW
    assert sum(isinstance(each, bytes) for each in socket.sent) == int(takes)
