"""`compare`: stored runs side by side, in files of their own."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable
from pathlib import Path

import imageio.v3 as iio
import pytest
from command_line import COARSE, assert_refused, tree
from PIL import Image
from PIL.GifImagePlugin import GifImageFile

from taichi_foam import Result, load_scene, run
from taichi_foam.errors import UserError
from taichi_foam.picture.comparison import Lineup


@pytest.fixture(scope="module")
def stored(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Runs on a coarse lattice: 6 ms of a wedge, and 9 ms of one that is faster."""
    base = tmp_path_factory.mktemp("runs")
    for name, settings in (
        ("slow", ["numerics.end=6e-3"]),
        ("fast", ["numerics.end=9e-3", "impactor.velocity=5"]),
    ):
        scene = load_scene("paper/wedge-2.86", overrides=[*COARSE, *settings])
        run(scene).save(base / name)
    return base


@pytest.fixture
def runs(stored: Path, tmp_path: Path) -> Path:
    """Copies of both in the current folder."""
    for name in ("slow", "fast"):
        shutil.copytree(stored / name, tmp_path / name)
    return tmp_path


def test_films_without_a_kind_named(invoke: Callable, runs: Path) -> None:
    before = tree(runs)
    result = invoke("compare", "slow", "fast")
    assert result.exit_code == 0, result.output
    names = ["comparison-worst-strain.mp4", "comparison-worst-strain.gif"]
    assert result.stdout == f"in comparison: {', '.join(names)}\n"
    after = tree(runs)
    assert {name: after[name] for name in before} == before
    assert sorted(os.listdir(runs / "comparison")) == sorted(names)
    count = len(Result.load(runs / "fast").snapshots)
    assert f"({2 * count} pictures)" in result.stderr
    film = iio.imread(runs / "comparison" / names[0], plugin="FFMPEG")
    assert film.shape == (count, 180, 320, 3)
    with GifImageFile(runs / "comparison" / names[1]) as gif:
        assert (gif.n_frames, gif.size) == (count, (320, 180))


def test_names_size_and_pace_are_as_asked(invoke: Callable, runs: Path) -> None:
    """What stands in the pictures is tested in tests/picture/test_comparison.py."""
    options = "--mode speed --theme dark --size 1280x480 --fps 10 --mp4 --gif --png --out three"
    result = invoke("compare", "slow", "fast", "slow", *options.split())
    assert result.exit_code == 0, result.output
    names = {f"comparison-speed.{kind}" for kind in ("mp4", "gif", "png")}
    assert set(os.listdir(runs / "three")) == names
    count = len(Result.load(runs / "fast").snapshots)
    meta = iio.immeta(runs / "three" / "comparison-speed.mp4", plugin="FFMPEG")
    assert (meta["fps"], meta["size"]) == (10, (1280, 480))
    with GifImageFile(runs / "three" / "comparison-speed.gif") as gif:
        assert gif.n_frames == count
        width, height = gif.size
        assert width * height <= 1.01 * 960 * 540
        assert width / height == pytest.approx(1280 / 480, rel=0.01)
    with Image.open(runs / "three" / "comparison-speed.png") as picture:
        assert picture.width == 1280


def test_what_is_there_is_replaced_only_when_asked(invoke: Callable, runs: Path) -> None:
    assert invoke("compare", "slow", "fast", "--png").exit_code == 0
    assert os.listdir(runs / "comparison") == ["comparison-worst-strain.png"]
    before = tree(runs)
    refused = invoke("compare", "slow", "fast", "--png", "--gif")
    assert_refused(refused, "comparison/comparison-worst-strain.png", "--overwrite")
    assert tree(runs) == before
    dark = ["--png", "--theme", "dark", "--overwrite"]
    assert invoke("compare", "slow", "fast", *dark).exit_code == 0
    name = "comparison/comparison-worst-strain.png"
    assert tree(runs)[name] != before[name]


@pytest.mark.parametrize(
    ("arguments", "fragment"),
    [
        (["slow", "nowhere"], "nowhere: there is no such folder"),
        (["slow"], "runs to compare: 1 given, must be 2 to 4"),
        (["slow", "fast", "slow", "fast", "slow"], "runs to compare: 5 given, must be 2 to 4"),
        ([], "RUN"),
        (["slow", "fast", "--mode", "heat"], "output.mode = 'heat'"),
        (["slow", "fast", "--size", "63x63"], "output.width = 63"),
        (["slow", "fast", "--fps", "0"], "output.fps = 0"),
        (["slow", "fast", "--png", "--size", "64x64"], "must be at least 640"),
        (["slow", "fast", "--png", "--fps", "20"], "--fps: has no effect on what is to be written"),
        (["slow", "fast", "--out", "slow/scene.toml"], "scene.toml: is a file"),
        (["slow", "torn"], "not as they were written: history.csv"),
    ],
)
def test_bad_requests_are_refused_before_drawing(
    arguments: list[str], fragment: str, ask_undrawn: Callable, runs: Path
) -> None:
    shutil.copytree(runs / "fast", runs / "torn")
    (runs / "torn" / "history.csv").unlink()
    before = tree(runs)
    assert_refused(ask_undrawn("compare", *arguments), fragment)
    assert tree(runs) == before


def test_runs_are_called_by_their_folders_wherever_one_stands(
    invoke: Callable, runs: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen: list[str] = []

    def see(cls: type, results: list, folders: list[str], captions: list) -> None:
        assert [each.scene.impactor.velocity == 5 for each in results] == [
            folder.endswith("fast") for folder in folders
        ]
        seen.extend(folders)
        raise UserError("seen")

    monkeypatch.setattr(Lineup, "of", classmethod(see))
    monkeypatch.chdir(runs / "slow")
    shutil.copytree(runs / "slow", runs / "other" / "slow")
    for arguments, names in (
        ((".", "../fast"), ["slow", "fast"]),
        (("../fast/", "."), ["fast", "slow"]),
        ((".", "../other/slow"), [f"{runs.name}/slow", "other/slow"]),
        ((".", "."), ["slow", "slow"]),
    ):
        seen.clear()
        assert_refused(invoke("compare", *arguments), "seen")
        assert seen == names


def test_ctrl_c_keeps_what_was_complete(
    invoke: Callable, runs: Path, press_after: Callable
) -> None:
    press_after(2 * 2 * len(Result.load(runs / "fast").snapshots) + 3)  # runs, films
    result = invoke("compare", "slow", "fast", "--mp4", "--gif", "--png")
    assert result.exit_code == 130, result.output
    names = ["comparison-worst-strain.mp4", "comparison-worst-strain.gif"]
    assert f"what was finished is in comparison: {', '.join(names)}" in result.stderr
    assert sorted(os.listdir(runs / "comparison")) == sorted(names)
