"""Films read back by another reader than the one that wrote them."""

from __future__ import annotations

import gc
import weakref
from collections.abc import Callable, Iterable, Iterator
from contextlib import AbstractContextManager
from pathlib import Path

import imageio.v3 as iio
import numpy as np
import pytest
from picture_states import dented, scene_of
from PIL import Image
from PIL.GifImagePlugin import GifImageFile

from taichi_foam.errors import UserError
from taichi_foam.picture import films, raster


def plain(count: int = 5, width: int = 64, height: int = 48) -> Iterator[np.ndarray]:
    """Frames of one grey each, growing lighter by 40, from black again after the sixth."""
    for k in range(count):
        yield np.full((height, width, 3), 40 * (k % 6), dtype=np.uint8)


def saved(
    kind: Callable[..., AbstractContextManager[films.Film]],
    pictures: Iterable[np.ndarray],
    path: Path,
    **options: int,
) -> Path:
    """Write a film of `kind`, `films.mp4` or `films.gif`, of all pictures."""
    with kind(path, **options) as film:
        for picture in pictures:
            film.send(picture)
    return path


def test_an_mp4_holds_the_frames_it_was_given(tmp_path: Path) -> None:
    path = saved(films.mp4, plain(), tmp_path / "film.mp4", fps=10)
    read = iio.imread(path, plugin="FFMPEG")
    assert read.shape == (5, 48, 64, 3)
    for k, frame in enumerate(read):
        assert np.abs(frame.astype(int) - 40 * k).max() <= 6
    assert iio.immeta(path, plugin="FFMPEG")["fps"] == 10
    assert iio.immeta(path, plugin="FFMPEG")["pix_fmt"].startswith("yuv420p")


def test_a_gif_holds_the_frames_it_was_given_and_repeats(tmp_path: Path) -> None:
    path = saved(films.gif, plain(), tmp_path / "film.gif", fps=20)
    with GifImageFile(path) as film:
        assert film.n_frames == 5
        assert film.size == (64, 48)
        assert film.info["loop"] == 0
        for k in range(5):
            film.seek(k)
            assert np.abs(np.asarray(film.convert("RGB")).astype(int) - 40 * k).max() <= 3
            assert film.info["duration"] == (50 if k < 4 else 1000)


def test_a_gif_is_scaled_down_to_its_width(tmp_path: Path) -> None:
    path = saved(films.gif, plain(2, 200, 100), tmp_path / "film.gif", width=100)
    with Image.open(path) as film:
        assert film.size == (100, 50)


def test_a_film_of_a_run_is_small_and_shows_the_frames(tmp_path: Path) -> None:
    scene = scene_of()
    run = [dented(scene, 0.0012 * k, time=0.001 * k) for k in range(50)]
    pictures = (raster.frame(snapshot, scene, (640, 360)) for snapshot in run)
    path = saved(films.gif, pictures, tmp_path / "film.gif")
    assert path.stat().st_size < 1.5e6
    with GifImageFile(path) as film:
        assert film.n_frames == 50
        film.seek(30)
        shown = np.asarray(film.convert("RGB")).astype(int)
    exact = raster.frame(run[30], scene, (640, 360)).astype(int)
    assert np.abs(shown - exact).mean() < 2


@pytest.mark.usefixtures("quick_collections")
def test_frames_are_taken_one_at_a_time(tmp_path: Path) -> None:
    seen: list[weakref.ref[np.ndarray]] = []
    most = 0

    def watched() -> Iterator[np.ndarray]:
        nonlocal most
        for frame in plain(40):
            seen.append(weakref.ref(frame))
            gc.collect()
            most = max(most, sum(one() is not None for one in seen))
            yield frame

    saved(films.mp4, watched(), tmp_path / "film.mp4")
    assert most <= 4


@pytest.mark.parametrize("size", [(63, 48), (64, 47)])
def test_an_odd_size_is_refused(tmp_path: Path, size: tuple[int, int]) -> None:
    with pytest.raises(UserError, match="must be even, such as 64 x 48"):
        saved(films.mp4, plain(3, *size), tmp_path / "film.mp4")
    assert list(tmp_path.iterdir()) == []


def test_other_bad_requests_are_refused(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="no frames"):
        saved(films.mp4, [], tmp_path / "film.mp4")
    with pytest.raises(UserError, match=r"end in \.gif"):
        saved(films.gif, plain(), tmp_path / "film.mp4")
    with pytest.raises(UserError, match="no folder"):
        saved(films.mp4, plain(), tmp_path / "absent" / "film.mp4")
    with pytest.raises(UserError, match="size changes"):
        saved(films.mp4, [*plain(2), *plain(1, 32)], tmp_path / "film.mp4")
    assert list(tmp_path.iterdir()) == []


def test_a_failure_leaves_the_older_film_alone(tmp_path: Path) -> None:
    path = saved(films.mp4, plain(3), tmp_path / "film.mp4")
    before = path.read_bytes()

    def broken() -> Iterator[np.ndarray]:
        yield from plain(2)
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        saved(films.mp4, broken(), path)
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]


def test_an_encoder_that_crashes_says_why_and_leaves_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(films, "_MP4", ("-c:v", "libx264", "-preset", "no-such"))
    with pytest.raises(UserError, match=r"film\.mp4: it could not be written \(.+\); check"):
        saved(films.mp4, plain(200, 320, 240), tmp_path / "film.mp4")
    assert list(tmp_path.iterdir()) == []


def test_an_encoder_that_is_killed_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    send = films.Film.send

    def killed(film: films.Film, picture: np.ndarray) -> None:
        send(film, picture)
        film._process.kill()

    monkeypatch.setattr(films.Film, "send", killed)
    with pytest.raises(UserError, match=r"could not be written \(ffmpeg ended with code"):
        saved(films.mp4, plain(100, 320, 240), tmp_path / "film.mp4")
    assert list(tmp_path.iterdir()) == []


def test_a_film_with_a_frame_lost_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(films, "_MP4", (*films._MP4, "-frames:v", "3"))
    with pytest.raises(UserError, match="holds 3 of 5 frames"):
        saved(films.mp4, plain(), tmp_path / "film.mp4")
    assert list(tmp_path.iterdir()) == []


def test_no_encoder_is_left_behind(tmp_path: Path) -> None:
    """After a film, and after one that was given up."""
    encoders = []
    for error in (None, KeyboardInterrupt):
        try:
            with films.gif(tmp_path / "film.gif") as film:
                for picture in plain():
                    film.send(picture)
                encoders.append(film._process)
                if error:
                    raise error
        except KeyboardInterrupt:
            pass
    assert [encoder.poll() is not None for encoder in encoders] == [True, True]


@pytest.mark.parametrize(("kind", "name"), [(films.mp4, "film.mp4"), (films.gif, "film.gif")])
def test_a_film_that_does_not_fit_is_reported(tmp_path: Path, kind: Callable, name: str) -> None:
    """A limit on the size of files, which the encoder inherits, stands in for a full disk."""
    resource = pytest.importorskip("resource")
    noise = np.random.default_rng(1).integers(0, 256, (12, 240, 320, 3), dtype=np.uint8)
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (4096, hard))
    try:
        with pytest.raises(UserError, match="could not be written"):
            saved(kind, noise, tmp_path / name)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert list(tmp_path.iterdir()) == []
