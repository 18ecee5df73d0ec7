"""`render`: a stored run drawn again, what it is called, and what is refused."""

from __future__ import annotations

import os
import re
import shutil
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import imageio.v3 as iio
import numpy as np
import pytest
from command_line import COARSE, assert_refused, tree
from PIL import Image
from PIL.GifImagePlugin import GifImageFile
from processes import without_rights

from taichi_foam import Result, load_scene, run
from taichi_foam.picture import raster
from taichi_foam.picture.look import Look
from taichi_foam.results.manifest import Manifest


@pytest.fixture(scope="module")
def stored(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run of 8 ms on a coarse lattice, whose scene asks for 320 x 180 pixels."""
    settings = [*COARSE, "numerics.end=8e-3", "output.film=false"]
    result = run(load_scene("paper/wedge-2.86", overrides=settings))
    return result.save(tmp_path_factory.mktemp("runs") / "wedge")


@pytest.fixture
def folder(stored: Path, tmp_path: Path) -> Path:
    """A copy of that run, called `run`."""
    return Path(shutil.copytree(stored, tmp_path / "run"))


def test_films_without_a_kind_named_beside_the_run(invoke: Callable, folder: Path) -> None:
    before, count = tree(folder), len(Result.load(folder).snapshots)
    result = invoke("render", "run", "--mode", "broken")
    assert result.exit_code == 0, result.output
    assert result.stdout == "in run: film-broken.mp4, film-broken.gif\n"
    assert f"({2 * count} pictures)" in result.stderr
    after = tree(folder)
    assert set(after) - set(before) == {"film-broken.mp4", "film-broken.gif"}
    old = set(before) - {"manifest.json"}
    assert {name: after[name] for name in old} == {name: before[name] for name in old}
    assert Manifest.read(folder).changed(folder) == []
    assert {"film-broken.mp4", "film-broken.gif"} <= set(Manifest.read(folder).files)
    film = iio.imread(folder / "film-broken.mp4", plugin="FFMPEG")
    assert film.shape == (count, 180, 320, 3)
    with GifImageFile(folder / "film-broken.gif") as gif:
        assert gif.n_frames == count
        assert gif.size == (320, 180)


def test_size_pace_mode_and_theme_are_as_asked(invoke: Callable, folder: Path) -> None:
    options = "--mode speed --theme dark --size 512x288 --fps 50 --mp4 --gif --frames --out new/one"
    result = invoke("render", "run", *options.split())
    assert result.exit_code == 0, result.output
    out = folder.parent / "new" / "one"
    assert set(os.listdir(out)) == {"film-speed.mp4", "film-speed.gif", "frames-speed"}
    stored = Result.load(folder)
    meta = iio.immeta(out / "film-speed.mp4", plugin="FFMPEG")
    assert (meta["fps"], meta["size"]) == (50, (512, 288))
    with GifImageFile(out / "film-speed.gif") as gif:
        assert gif.n_frames == -(-len(stored.snapshots) // 2)  # every second one at 25/s
        assert gif.info["duration"] == 40
    frames = sorted((out / "frames-speed").glob("*.png"))
    assert len(frames) == len(stored.snapshots)
    look, title = Look("speed", "dark"), "wedge, 2.86 m/s"
    wanted = raster.frame(stored.snapshots[5], stored.scene, (512, 288), look=look, title=title)
    np.testing.assert_array_equal(np.asarray(Image.open(frames[5])), wanted)


def test_the_curve_comes_and_goes(invoke: Callable, folder: Path) -> None:
    for option, name in (("--curve", "with"), ("--no-curve", "without")):
        size = ("--size", "640x360")
        assert invoke("render", "run", "--frames", option, *size, "--out", name).exit_code == 0
    names = [folder.parent / name / "frames-worst-strain" for name in ("with", "without")]
    last = [np.asarray(Image.open(sorted(name.glob("*.png"))[-1])) for name in names]
    corner = raster.Layout((640, 360)).curve
    assert corner is not None
    differs = np.any(last[0] != last[1], axis=-1)
    assert differs[corner.top : corner.bottom, corner.left : corner.right].mean() > 0.2
    differs[corner.top : corner.bottom, corner.left : corner.right] = False
    assert not differs.any()


def test_stills_are_named_by_their_mode(invoke: Callable, folder: Path) -> None:
    options = "--png --pdf --svg --mode broken --out stills"
    result = invoke("render", "run", *options.split())
    assert result.exit_code == 0, result.output
    names = {"montage-broken.png", "montage-broken.pdf", "montage-broken.svg",
             "curves.pdf", "curves.svg"}  # fmt: skip
    stills = folder.parent / "stills"
    assert set(os.listdir(stills)) == names
    with Image.open(stills / "montage-broken.png") as picture:
        assert picture.width == 1800
    assert width_mm(stills / "montage-broken.pdf") == pytest.approx(174, abs=0.1)
    assert width_mm(stills / "curves.pdf") == pytest.approx(84, abs=0.1)
    wide = invoke("render", "run", "--pdf", "--column", "double", "--out", "wide")
    assert wide.exit_code == 0, wide.output
    assert width_mm(folder.parent / "wide" / "curves.pdf") == pytest.approx(174, abs=0.1)


def width_mm(pdf: Path) -> float:
    """The width of a PDF's page."""
    box = re.search(rb"/MediaBox \[ ?0 0 ([0-9.]+)", pdf.read_bytes())
    assert box is not None
    return float(box[1]) * 25.4 / 72


def test_what_is_there_is_replaced_only_when_asked(invoke: Callable, folder: Path) -> None:
    assert invoke("render", "run", "--png", "--frames").exit_code == 0
    (folder / "frames-worst-strain" / "note").write_text("mine")
    before = tree(folder)
    result = invoke("render", "run", "--png")
    assert_refused(result, "run/montage-worst-strain.png: already exists", "--overwrite")
    assert_refused(invoke("render", "run", "--frames"), "frames-worst-strain", "--overwrite")
    # one of two is enough, and the other is not written either
    assert_refused(invoke("render", "run", "--gif", "--png"), "montage-worst-strain.png")
    assert tree(folder) == before
    again = invoke("render", "run", "--png", "--frames", "--theme", "dark", "--overwrite")
    assert again.exit_code == 0, again.output
    after = tree(folder)
    assert after["montage-worst-strain.png"] != before["montage-worst-strain.png"]
    assert after["frames-worst-strain/note"] == b"mine"
    assert set(before) == set(after)


BAD = {
    "no folder": (["nowhere"], "nowhere: there is no such folder"),
    "a file": (["note"], "note: there is no such folder"),
    "mode": (["run", "--mode", "heat"], "output.mode = 'heat': must be 'worst-strain', 'strain'"),
    "theme": (["run", "--theme", "grey"], "output.theme = 'grey': must be 'light' or 'dark'"),
    "too small": (["run", "--size", "63x63"], "output.width = 63: must be even, at least 64"),
    "no size": (["run", "--size", "big"], "size = 'big': must read WIDTHxHEIGHT"),
    "no pace": (["run", "--fps", "0"], "output.fps = 0: must be at least 1 and at most 120"),
    "pace in words": (["run", "--fps", "fast"], "--fps"),
    "column": (["run", "--pdf", "--column", "wide"], "column = 'wide': must be one of single"),
    "narrow": (["run", "--png", "--size", "320x180"], "width = 320 pixels; must be at least 640"),
    "column of what is not printed": (
        ["run", "--png", "--column", "single"],
        "--column: has no effect on what is to be written. Fix: add "
        "--pdf or --svg, or leave it out.",
    ),
    "curve in stills": (["run", "--png", "--curve"], "add --gif, --mp4 or --frames"),
    "no curve in figures": (["run", "--pdf", "--no-curve"], "--curve: has no effect"),
    "pace of stills": (["run", "--png", "--pdf", "--fps", "20"], "add --gif or --mp4"),
    "size on paper": (["run", "--pdf", "--size", "640x360"], "--size: has no effect"),
    "theme on paper": (["run", "--svg", "--theme", "dark"], "--theme: has no effect"),
    "out is a file": (["run", "--out", "note"], "note: is a file"),
    "out below a file": (["run", "--out", "note/here"], "output folder note/here"),
    "empty out": (["run", "--out", ""], "not a path"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_requests_are_refused_before_drawing(
    case: str, ask_undrawn: Callable, folder: Path, tmp_path: Path
) -> None:
    (tmp_path / "note").write_text("mine")
    before = tree(tmp_path)
    arguments, fragment = BAD[case]
    assert_refused(ask_undrawn("render", *arguments), fragment)
    assert tree(tmp_path) == before


@pytest.mark.parametrize("name", ["scene.toml", "history.csv", "snapshots.npz", "summary.json"])
@pytest.mark.parametrize("damage", ["missing", "cut"])
def test_a_damaged_run_is_refused(
    name: str, damage: str, ask_undrawn: Callable, folder: Path
) -> None:
    path = folder / name
    content = path.read_bytes()
    path.unlink()
    if damage == "cut":
        # in the middle of a line: half a number would still be one
        path.write_bytes(content[: len(content) // 2].rstrip(b"0123456789.\n") + b"[")
    before = tree(folder)
    assert_refused(ask_undrawn("render", "run"), "error: ")
    assert tree(folder) == before


def test_a_run_without_snapshots_is_refused(ask_undrawn: Callable, folder: Path) -> None:
    empty = replace(Result.load(folder), snapshots=[])
    empty.save("empty")
    assert_refused(ask_undrawn("render", "empty"), "empty: the run has no snapshots to draw")


def test_a_folder_or_file_in_the_way_is_not_replaced(ask_undrawn: Callable, folder: Path) -> None:
    (folder / "film-worst-strain.gif").mkdir()
    (folder / "frames-worst-strain").write_text("mine")
    before = tree(folder)
    assert_refused(
        ask_undrawn("render", "run", "--gif", "--overwrite"), "film-worst-strain.gif: is a folder"
    )
    assert_refused(
        ask_undrawn("render", "run", "--frames", "--overwrite"), "frames-worst-strain: is a file"
    )
    assert tree(folder) == before


@pytest.fixture
def read_only(stored: Path) -> Iterator[Path]:
    """The run in a folder that may be read but not written to, even by root."""
    base = Path(tempfile.mkdtemp(prefix="taichi-foam-test-"))
    folder = Path(shutil.copytree(stored, base / "run"))
    base.chmod(0o755)
    folder.chmod(0o555)
    with without_rights():
        yield folder
    folder.chmod(0o755)
    shutil.rmtree(base)


def test_a_read_only_run_needs_another_place(ask_undrawn: Callable, read_only: Path) -> None:
    before = tree(read_only)
    assert_refused(ask_undrawn("render", str(read_only)), "permission denied", "--out")
    assert tree(read_only) == before


def test_ctrl_c_keeps_what_was_complete(
    invoke: Callable, folder: Path, press_after: Callable
) -> None:
    before = tree(folder)
    count = len(Result.load(folder).snapshots)
    press_after(count // 2)
    result = invoke("render", "run", "--mp4", "--frames")
    assert result.exit_code == 130, result.output
    assert "nothing was written" in result.stderr
    assert tree(folder) == before
    press_after(2 * count + 2)
    result = invoke("render", "run", "--mp4", "--gif", "--png")
    assert result.exit_code == 130, result.output
    names = {"film-worst-strain.mp4", "film-worst-strain.gif"}
    assert "interrupted: what was finished is in run: film-worst-strain.mp4" in result.stderr
    assert set(tree(folder)) - set(before) == names
    press_after(0)
    assert invoke("render", "run", "--out", "deep/new").exit_code == 130
    assert not Path("deep").exists()
