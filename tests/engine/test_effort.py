"""Kernels are compiled quickly first, and thoroughly once they have been used for long."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest

from taichi_foam import load_scene
from taichi_foam.engine import effort, kernel_cache
from taichi_foam.engine.features import features_of
from taichi_foam.engine.layout import SMALL_BLOCK, Size
from taichi_foam.laws.shape.kinds.bodies import Ellipse

ROOM = Size(1, 48, 24)
FEATURES = features_of(load_scene("paper/wedge-2.86"))
FIRST, SECOND = (1, 4), (4, 462)


@pytest.fixture
def folder(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """An empty folder of kernels, and nothing used yet."""
    monkeypatch.delenv("TI_ADVANCED_OPTIMIZATION", raising=False)
    monkeypatch.setattr(kernel_cache, "_prepared", tmp_path)
    monkeypatch.setattr(effort, "_used", {})
    return tmp_path


def is_thorough(place: tuple[int, int] = FIRST, room: Size = ROOM) -> bool:
    return effort.is_thorough(room, FEATURES, effort.name_of(room, FEATURES, place))


def use(place: tuple[int, int] = FIRST) -> None:
    with effort.spent(ROOM, FEATURES, place):
        pass


def test_kernels_of_long_use_are_compiled_thoroughly_in_later_processes_too(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    use()
    assert not is_thorough()
    assert list(folder.iterdir()) == []
    monkeypatch.setattr(effort, "PAYS_AFTER", 0.0)
    use()
    assert is_thorough(SECOND), "in this process wherever their fields are"
    monkeypatch.setattr(effort, "PAYS_AFTER", 120.0)
    monkeypatch.setattr(effort, "_used", {})  # as in another process
    assert is_thorough()
    assert not is_thorough(SECOND)


def test_big_blocks_are_at_once(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(effort, "PAYS_FROM", SMALL_BLOCK)
    assert is_thorough(room=Size(1, SMALL_BLOCK // 20, 20))


@pytest.mark.parametrize(("given", "thorough"), [("0", False), ("1", True)])
def test_the_environment_decides_for_all(
    folder: Path, monkeypatch: pytest.MonkeyPatch, given: str, thorough: bool
) -> None:
    monkeypatch.setenv("TI_ADVANCED_OPTIMIZATION", given)
    assert is_thorough() == is_thorough(room=Size(1, SMALL_BLOCK, 20)) == thorough


def test_without_a_folder_nothing_is_kept(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(kernel_cache, "_prepared", None)
    monkeypatch.setenv("TI_ADVANCED_OPTIMIZATION", "1")
    use()
    monkeypatch.delenv("TI_ADVANCED_OPTIMIZATION")
    assert not is_thorough()


def test_names_tell_rooms_features_and_places_apart_and_nothing_else() -> None:
    again = features_of(load_scene("paper/wedge-3.60"))
    name = effort.name_of(ROOM, FEATURES, FIRST)
    assert name == effort.name_of(ROOM, again, FIRST)
    others = {
        effort.name_of(ROOM, FEATURES, SECOND),
        effort.name_of(replace(ROOM, columns=96), FEATURES, FIRST),
        effort.name_of(ROOM, replace(FEATURES, scattered=True), FIRST),
        effort.name_of(ROOM, replace(FEATURES, distance=Ellipse.distance), FIRST),
        effort.name_of(ROOM, features_of(load_scene("gallery/own-foam")), FIRST),
    }
    assert len(others | {name}) == 6


def test_a_new_feature_renames_only_the_kernels_that_have_it() -> None:
    known = effort.name_of(ROOM, FEATURES, FIRST)
    for on, same in ((False, True), (True, False)):
        later = SimpleNamespace(**vars(FEATURES), later=on)
        assert (effort.name_of(ROOM, later, FIRST) == known) == same  # type: ignore[arg-type]
