"""Films and frames of a stored run."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from imageio_ffmpeg import count_frames_and_secs
from PIL import Image

from taichi_foam import Result
from taichi_foam.picture import films, raster


@pytest.fixture(scope="module")
def result(study) -> Result:
    return Result.load(study.folder / "wedge-2.86")


def wanting(result: Result, **output: object) -> Result:
    scene = result.scene
    wanted = scene.output.model_copy(update=output)
    return replace(result, scene=scene.model_copy(update={"output": wanted}))


@pytest.mark.parametrize(
    ("film", "frames"), [(True, True), (True, False), (False, True), (False, False)]
)
def test_what_the_scene_asks_for_is_written(
    result: Result, tmp_path: Path, film: bool, frames: bool
) -> None:
    asked = wanting(replace(result, snapshots=result.snapshots[:5]), film=film, frames=frames)
    drawn: list[None] = []
    reel = films.Reel.of(asked)
    written = reel.write(tmp_path, lambda: drawn.append(None))
    assert set(written) == set(tmp_path.iterdir())
    names = {"film.gif": film, "film.mp4": film, "frames": frames}
    assert {path.name for path in written} == {name for name in names if names[name]}
    assert len(drawn) == reel.frames_to_draw()
    if frames:
        pictures = sorted((tmp_path / "frames").glob("*.png"))
        assert [path.name for path in pictures] == [f"frame_{n:05d}.png" for n in range(5)]
        with Image.open(pictures[0]) as picture:
            assert picture.size == (320, 180)
    if film:
        assert count_frames_and_secs(str(tmp_path / "film.mp4"))[0] == 5


def test_both_films_and_the_frames_show_each_instant_in_order(
    result: Result, tmp_path: Path
) -> None:
    """Made in one pass, each is as it is alone; the frames are those that are drawn afresh."""
    asked = wanting(replace(result, snapshots=result.snapshots[:9]), film=True, frames=True)
    (tmp_path / "alone").mkdir()
    films.Reel.of(asked).write(tmp_path)
    for names in (films.Names(mp4="film.mp4"), films.Names(gif="film.gif")):
        (path,) = films.Reel.of(asked).write(tmp_path / "alone", names=names)
        assert path.read_bytes() == (tmp_path / path.name).read_bytes()
    for number, snapshot in enumerate(asked.snapshots):
        sunk = asked.displacement(snapshot)
        fresh = raster.frame(snapshot, asked.scene, (320, 180), displacement=sunk)
        with Image.open(tmp_path / "frames" / f"frame_{number:05d}.png") as stored:
            np.testing.assert_array_equal(np.asarray(stored), fresh)


def test_pictures_take_no_more_room_than_foretold(study, result: Result) -> None:
    for case in ("rectangular-3.03", "wedge-2.86"):
        stored = [study.folder / case / name for name in ("film.gif", "film.mp4")]
        assert sum(path.stat().st_size for path in stored) < films.storage_bytes(result.scene)
