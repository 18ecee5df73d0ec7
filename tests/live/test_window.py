"""The window on a virtual screen: opened, driven by keys, looked at, closed."""

from __future__ import annotations

import contextlib
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from bench import assert_same
from PIL import Image, ImageGrab
from processes import PATIENCE
from typer.testing import CliRunner

from taichi_foam.cli import app
from taichi_foam.picture import raster
from taichi_foam.picture.inset import Curve
from taichi_foam.picture.look import THEMES
from taichi_foam.results.result import Result
from taichi_foam.simulation.simulate import resume, run

SIZE = (1280, 720)
#: A cylinder on a coarse block: 3 ms at 1:100 is over in a third of a second, 10 s never.
COARSE = ["--set", "block.columns=20", "--set", "block.rows=10", "--set", "output.film=false"]

pytestmark = pytest.mark.skipif(
    not (shutil.which("Xvfb") and shutil.which("xdotool")),
    reason="needs Xvfb and xdotool (Debian: xvfb, xdotool)",
)


@pytest.fixture(scope="module")
def display() -> Iterator[str]:
    """A virtual screen of the window's size and a little more.

    It does not start anew when its last client leaves (`-noreset`): every screenshot is a client
    that leaves, and a window that opens at that moment would be refused.
    """
    reading, writing = os.pipe()
    screen = ["-screen", "0", "1400x900x24", "-nolisten", "tcp", "-noreset"]
    server = subprocess.Popen(
        ["Xvfb", "-displayfd", str(writing), *screen],
        pass_fds=[writing],
        stderr=subprocess.DEVNULL,
    )
    os.close(writing)
    try:
        with os.fdopen(reading) as told:
            yield f":{told.readline().strip()}"
    finally:
        server.terminate()
        server.wait()


class Shown:
    """`taichi-foam run --live` in a window on the virtual screen."""

    def __init__(self, display: str, folder: Path, *options: str, slash: bool = False) -> None:
        self.display, self.folder = display, folder
        self._place: tuple[slice, slice] | None = None  # of the window, once it is there
        self._environment = {**os.environ, "DISPLAY": display, "SDL_VIDEODRIVER": "x11"}
        command = [sys.executable, "-m", "taichi_foam", "run", "paper/cylinder-2.32", "--live"]
        self.process = subprocess.Popen(
            [*command, *COARSE, "--out", f"{folder}{'/' if slash else ''}", *options],
            env=self._environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )

    def press(self, *keys: str) -> None:
        subprocess.run(["xdotool", "key", *keys], env=self._environment, check=True)

    def screen(self) -> np.ndarray:
        """The window as it is on the screen, uint8 (h, w, 3)."""
        whole = np.asarray(ImageGrab.grab(xdisplay=self.display).convert("RGB"))
        if self._place is None:
            rows, columns = np.nonzero(whole.max(axis=-1))  # the screen around it is black
            if not len(rows):
                return np.zeros((0, 0, 3), dtype=np.uint8)
            self._place = slice(rows[0], rows[0] + SIZE[1]), slice(columns.min(), None)
        return whole[self._place][:, : SIZE[0]]

    def wait(self, until: Callable[[], bool], what: str) -> None:
        end = time.monotonic() + PATIENCE
        while not until():
            assert self.process.poll() is None, self.process.communicate()
            assert time.monotonic() < end, what
            time.sleep(0.05)

    def wait_for_motion(self, share: float = 0.01) -> None:
        """Until the foam has been dented: the field is not that of the start any more.

        What the window waits for stands across the start, and is gone when it begins to move.
        """
        self.wait(lambda: self.screen().shape == (SIZE[1], SIZE[0], 3), "no window came up")
        for most in (0.01, share):
            first = self.screen()
            self.wait(
                lambda first=first, most=most: share_that_differs(first, self.screen()) > most,
                "nothing moved",
            )

    def wait_for_rest(self, looks: int = 4, every: float = 0.15) -> np.ndarray:
        """Until so many looks, `every` [s], are the same; what is then on the screen."""
        seen, same = self.screen(), 1

        def is_still() -> bool:
            nonlocal seen, same
            time.sleep(every)
            before, seen = seen, self.screen()
            same = same + 1 if share_that_differs(before, seen) == 0.0 else 1
            return same == looks

        self.wait(is_still, "it went on moving")
        return seen

    def press_and_see(self, key: str, seen: np.ndarray) -> np.ndarray:
        """Paused, a key changes what is `seen` by 0.5 % at least, in one picture."""
        self.press(key)
        self.wait(lambda: share_that_differs(seen, self.screen()) > 0.005, f"{key} did nothing")
        return self.wait_for_rest(looks=2, every=0.05)

    def close(self) -> tuple[int, str, str]:
        self.press("q")
        out, err = self.process.communicate(timeout=PATIENCE)
        return self.process.returncode, out, err


@pytest.fixture
def show(display: str, tmp_path: Path) -> Iterator[Callable[..., Shown]]:
    shown: list[Shown] = []

    def start(*options: str, slash: bool = False) -> Shown:
        shown.append(Shown(display, tmp_path / "run", *options, slash=slash))
        return shown[-1]

    yield start
    for each in shown:
        each.process.kill()
        each.process.wait()


def share_that_differs(a: np.ndarray, b: np.ndarray, by: int = 2) -> float:
    """The share of pixels that are apart by more than `by` of 255 in any colour."""
    if a.shape != b.shape:
        return 1.0
    return float(np.mean(np.any(np.maximum(a, b) - np.minimum(a, b) > by, axis=-1)))


def test_keys_do_what_the_help_says_and_closing_keeps_what_there_is(
    show: Callable[..., Shown],
) -> None:
    """Screens are compared by the share of pixels that differ by more than 2 of 255.

    Paused, none may; another mode, theme or panel must change at least 0.5 %. Screenshots lie
    beside the run: inside a folder given with a slash at its end they would keep it from its place.
    """
    window = show("--set", "numerics.end=10", slash=True)
    window.wait_for_motion(0.15)  # so far that there is energy to show
    window.press("space")
    paused = window.wait_for_rest()
    time.sleep(0.5)
    assert share_that_differs(paused, window.screen()) == 0.0

    window.press("Right")
    window.wait(lambda: share_that_differs(paused, window.screen()) > 0.0, "no step")
    stepped = window.wait_for_rest()
    assert 0.0 < share_that_differs(paused, stepped) < 0.2  # a step is a third of a millisecond

    shots = Path(f"{window.folder}-shots")
    for count in (1, 2):
        window.press("s")
        window.wait(lambda count=count: len(list(shots.glob("*.png"))) == count, "no screenshot")
    seen = window.wait_for_rest()
    saved = np.asarray(Image.open(shots / "shot-001.png"))
    below_title = slice(60, None)  # beside the title stands another hint
    assert share_that_differs(saved[below_title], seen[below_title]) < 1e-3
    (shots / "shot-001.png").unlink()
    window.press("s")
    window.wait((shots / "shot-003.png").is_file, "a number was given twice")

    seen = window.wait_for_rest()
    for key in ("h", "h", "shift+m", "m", "t", "t", "g", "c"):
        seen = window.press_and_see(key, seen)

    dark = window.press_and_see("t", seen)
    assert tuple(dark[715, 5]) == THEMES["dark"].page

    code, _, err = window.close()
    assert code == 130, err
    assert "closed before the end of the drop" in err
    result = Result.load(window.folder)
    assert result.run["interrupted"]
    assert len(result.snapshots) >= 2


def test_the_window_shows_what_it_saves_and_another_shape_and_speed_are_kept_beside_it(
    show: Callable[..., Shown],
) -> None:
    """At its end, against the stored run drawn afresh: 1 % of the pixels may be apart.

    The curve is cut and smoothed from the same rows; text is drawn by the same fonts.
    """
    window = show("--set", "numerics.end=0.003")
    window.wait((window.folder / "manifest.json").is_file, "it was not kept at its end")
    seen = window.wait_for_rest()
    window.press("i")
    window.wait(Path(f"{window.folder}-2", "manifest.json").is_file, "the second drop was not kept")
    window.press("Up")
    window.wait(Path(f"{window.folder}-3", "manifest.json").is_file, "the third drop was not kept")
    code, out, err = window.close()
    assert code == 0, err
    assert "maximum displacement" in out or "energy unaccounted for" in out
    results = [Result.load(f"{window.folder}{end}") for end in ("", "-2", "-3")]
    found = [result.scene.impactor for result in results]
    assert [impactor.shape for impactor in found] == ["cylinder", "wedge", "wedge"]
    assert found[2].velocity == pytest.approx(2.42)
    result = results[0]
    assert not result.run["interrupted"]
    curve = Curve.of(result.history, last=0.01)
    peak, in_g = (result.summary[f"peak_deceleration_cfc180_{unit}"] for unit in ("m_s2", "g"))
    note = f"ended · peak {peak:.1f} m/s², {in_g:.1f} g (CFC 180) · H help"
    last = raster.frame(result.snapshots[-1], result.scene, SIZE, note=note, curve=curve)
    assert share_that_differs(seen, last) < 0.01


def test_ctrl_c_closes_the_window_and_keeps_what_there_is(show: Callable[..., Shown]) -> None:
    window = show("--set", "numerics.end=10")
    window.wait_for_motion()
    window.process.send_signal(signal.SIGINT)
    _, err = window.process.communicate(timeout=PATIENCE)
    assert window.process.returncode == 130, err
    assert "closed before the end of the drop" in err
    assert "Traceback" not in err
    assert Result.load(window.folder).run["interrupted"]


@pytest.mark.skipif(sys.platform != "linux", reason="looks into /proc")
def test_what_is_killed_goes_on_with_the_same_command(show: Callable[..., Shown]) -> None:
    """SIGKILL to both processes, then SIGTERM, then `resume`: as one unbroken run."""
    settings = ("--set", "numerics.end=0.06", "--checkpoint", "0.1")
    window = show(*settings)
    checkpoint = window.folder / "unfinished" / "checkpoint.npz"
    window.wait(checkpoint.is_file, "no checkpoint came")
    children = Path(f"/proc/{window.process.pid}/task/{window.process.pid}/children").read_text()
    for pid in (window.process.pid, *map(int, children.split())):
        with contextlib.suppress(ProcessLookupError):
            os.kill(pid, signal.SIGKILL)
    window.process.communicate(timeout=PATIENCE)
    window = show(*settings)
    window.wait_for_motion()
    window.process.send_signal(signal.SIGTERM)
    _, err = window.process.communicate(timeout=PATIENCE)
    assert window.process.returncode == 143, err
    assert "closed before the end of the drop" in err
    cut = Result.load(window.folder)
    assert cut.run["interrupted"]
    assert cut.run["resumed"] == 1
    result = resume(window.folder)
    assert result.run["resumed"] == 2
    assert_same(run(result.scene), result)


def test_a_run_that_fails_says_so_and_ends_with_1(show: Callable[..., Shown]) -> None:
    window = show("--dt", "1e-4")
    window.wait((window.folder / "manifest.json").is_file, "what there was is not kept")
    window.wait_for_rest()
    code, _, err = window.close()
    assert code == 1
    assert "diverged" in err
    assert Result.load(window.folder).run["ended_by"] == "diverged"


def test_a_display_that_does_not_answer_is_told(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "taichi_foam", "run", "paper/cylinder-2.32", "--live"]
    without = {k: v for k, v in os.environ.items() if k != "WAYLAND_DISPLAY"}
    done = subprocess.run(
        [*command, "--out", str(tmp_path / "run")], env={**without, "DISPLAY": ":4242"},
        capture_output=True, text=True, timeout=PATIENCE, check=False,
    )  # fmt: skip
    assert done.returncode == 2
    assert "taichi-foam serve" in done.stderr


def test_without_a_display_the_page_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("DISPLAY", "WAYLAND_DISPLAY", "SDL_VIDEODRIVER"):
        monkeypatch.delenv(name, raising=False)
    out = str(tmp_path / "run")
    done = CliRunner().invoke(app._app, ["run", "paper/cylinder-2.32", "--live", "--out", out])
    assert done.exit_code == 2
    assert "taichi-foam serve" in done.stderr
    assert not (tmp_path / "run").exists()
