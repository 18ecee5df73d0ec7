"""What a command has computed survives signals, kills, and what fails after it."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from command_line import COARSE_OPTIONS, assert_refused, call
from processes import ENVIRONMENT

from taichi_foam import Result
from taichi_foam.analysis import measures
from taichi_foam.errors import UserError
from taichi_foam.picture import films
from taichi_foam.results.folders import UNFINISHED, claimed
from taichi_foam.results.manifest import MANIFEST, Manifest
from taichi_foam.results.result import OUTPUTS
from taichi_foam.scene import Scene
from taichi_foam.simulation import simulate
from taichi_foam.simulation.checkpoint import CHECKPOINT

WEDGE = "paper/wedge-2.86"
SHORT = ["run", WEDGE, *COARSE_OPTIONS, "--set", "numerics.end=3e-3"]
LONG = ["run", WEDGE, *COARSE_OPTIONS, "--no-film", "--set", "numerics.end=5.0"]
DATA = {*OUTPUTS, MANIFEST} - {"compression.csv"}


@pytest.fixture
def process(tmp_path: Path) -> Iterator[Callable[..., subprocess.Popen]]:
    """Starts the command line; what still runs at the end is killed."""
    begun = []

    def start(*arguments: str) -> subprocess.Popen:
        begun.append(
            subprocess.Popen(
                [sys.executable, "-m", "taichi_foam", *arguments],
                cwd=tmp_path,
                env=ENVIRONMENT,
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                text=True,
            )
        )
        return begun[-1]

    yield start
    for each in begun:
        each.kill()
        each.communicate()


def wait_for(folder: Path, name: str, process: subprocess.Popen) -> None:
    """Until a process has made a file in a folder, whose name may have wildcards."""
    while not any(folder.glob(name)):
        assert process.poll() is None, process.communicate()[1]
        time.sleep(0.01)


def assert_kept(said: str, folder: Path) -> np.ndarray:
    """A run of LONG into `cut` was interrupted and kept what there was; the times of its rows."""
    assert "interrupted: what was computed is in cut; the same command continues" in said
    assert "Traceback" not in said
    stored = Result.load(folder / "cut")
    assert stored.summary["interrupted"] is True
    time = stored.history["time_s"]
    assert time[-1] < 5.0
    assert np.all(np.diff(time) > 0)
    assert set(os.listdir(folder / "cut")) == (DATA - {"state.npz"}) | {UNFINISHED}
    assert os.listdir(folder) == ["cut"]
    return time


def test_ctrl_c_five_times_keeps_what_there_is(tmp_path: Path, process: Callable) -> None:
    """However soon the next one comes: what follows the first is saving."""
    running = process(*LONG, "--out", "cut", "--checkpoint", "0.1")
    wait_for(tmp_path / "cut", f"{UNFINISHED}/{CHECKPOINT}", running)
    for _ in range(5):
        running.send_signal(signal.SIGINT)
        time.sleep(0.05)
    _, said = running.communicate(timeout=120)
    assert running.returncode == 130, said
    assert len(assert_kept(said, tmp_path)) >= 1


@pytest.mark.skipif(not hasattr(signal, "SIGHUP"), reason="this system has no SIGHUP")
@pytest.mark.parametrize(("names", "code"), [("SIGTERM", 143), ("SIGHUP, SIGTERM", 129)])
def test_other_signals_keep_what_there_is(
    invoke: Callable, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, names: str, code: int
) -> None:
    """The first one comes while it steps, the other one while it saves."""
    first, *others = [signal.Signals[name] for name in names.split(", ")]
    begin, write = simulate.run, OUTPUTS["history.csv"].write

    def run(scene: Scene, on_progress: Callable, **more: object) -> Result:
        def pressed(progress: simulate.Progress) -> None:
            on_progress(progress)
            if progress.time > 2e-3:
                signal.raise_signal(first)

        return begin(scene, pressed, **more)

    def disturbed(result: Result, path: Path) -> None:
        for number in others:
            signal.raise_signal(number)
        write(result, path)

    monkeypatch.setattr(simulate, "run", run)
    monkeypatch.setitem(OUTPUTS, "history.csv", replace(OUTPUTS["history.csv"], write=disturbed))
    result = invoke(*LONG, "--out", "cut")
    assert result.exit_code == code, result.output
    assert assert_kept(result.stderr, tmp_path)[-1] > 1e-3


def test_resume_and_the_same_command_go_on_after_a_kill(
    tmp_path: Path, process: Callable, invoke: Callable
) -> None:
    """Killed while it computes; continued on another number of threads, and killed while it draws.

    The unbroken one comes first: it leaves its kernels to those that are killed.
    """
    every = ("--checkpoint", "0.02", "--threads")
    command = [*SHORT, "--dt", "1e-6", "--frames", *every, "2", "--out"]

    def finish(out: str) -> None:
        done = call("-m", "taichi_foam", *command, out, cwd=tmp_path)
        assert done.returncode == 0, done.stderr

    finish("whole")
    for arguments, sign in (
        ([*command, "cut"], f"{UNFINISHED}/{CHECKPOINT}"),
        (["resume", "cut", *every, "1"], ".film.*.partial.*"),
    ):
        running = process(*arguments)
        wait_for(tmp_path / "cut", sign, running)
        running.kill()
        assert running.wait() == -signal.SIGKILL
        running.communicate()
        assert (tmp_path / "cut" / UNFINISHED / CHECKPOINT).exists()
    finish("cut")
    cut, whole = tmp_path / "cut", tmp_path / "whole"
    names = {str(path.relative_to(whole)) for path in whole.rglob("*")}
    assert {str(path.relative_to(cut)) for path in cut.rglob("*")} == names
    for name in ("history.csv", "cracks.json", "frames/frame_00003.png"):
        assert (cut / name).read_bytes() == (whole / name).read_bytes(), name
    assert Manifest.read(cut).changed(cut) == []
    resumed = json.loads((cut / "summary.json").read_text())["run"]["resumed"]
    assert resumed == 1  # what was drawn had been computed
    assert_refused(invoke("resume", "cut"), "has ended")


@pytest.mark.parametrize(
    "trouble",
    [UserError("film: no encoder"), OSError(28, "No space left on device"), RuntimeError("odd")],
    ids=["no encoder", "full disk", "a fault of ours"],
)
def test_pictures_that_fail_leave_the_data(
    invoke: Callable, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, trouble: Exception
) -> None:
    def fail(*arguments: object, **options: object) -> None:
        raise trouble

    monkeypatch.setattr(films.Reel, "write", fail)
    result = invoke(*SHORT, "--out", "out")
    assert result.exit_code == 1, result.output
    assert "the run itself is complete in out" in result.stderr
    assert "Traceback" not in result.stderr
    assert set(os.listdir(tmp_path / "out")) == DATA
    assert Result.load(tmp_path / "out").summary["interrupted"] is False


def test_an_encoder_that_is_missing_leaves_the_data(
    invoke: Callable, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("IMAGEIO_FFMPEG_EXE", "/bin/false")
    result = invoke(*SHORT, "--out", "out")
    assert result.exit_code == 1, result.output
    assert "could not be written" in result.stderr
    assert set(os.listdir(tmp_path / "out")) == DATA


def test_measures_that_fail_leave_the_data(
    invoke: Callable, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(record: object) -> None:
        raise ZeroDivisionError("no such thing")

    monkeypatch.setattr(measures, "summary", fail)
    result = invoke(*SHORT, "--no-film", "--out", "out")
    assert result.exit_code == 1, result.output
    assert (
        "the measures of the run could not be computed (ZeroDivisionError: no such thing)"
        in result.stderr
    )
    assert len(Result.load(tmp_path / "out").history["time_s"]) > 1


def test_two_runs_into_one_folder(invoke: Callable, monkeypatch: pytest.MonkeyPatch) -> None:
    """The second is refused before it computes anything."""
    monkeypatch.setattr(simulate, "run", lambda *_, **__: pytest.fail("it computed"))
    with claimed("out", {"command": "another"}):
        for overwrite in ([], ["--overwrite"]):
            refused = invoke(*SHORT, "--out", "out", *overwrite)
            assert_refused(refused, "another process is working in it")


def test_every_setting_has_a_default_folder_of_its_own(
    invoke: Callable, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folders = []

    def record(*_: object, checkpoint, **__: object) -> None:
        folders.append(checkpoint.folder.name)
        raise UserError("recorded")

    monkeypatch.setattr(simulate, "run", record)
    many = [word for n in range(8) for word in ("--set", f"foam.rate={n}00.0")]
    for given in (
        ["--set", "output.width=640", "--no-film"],
        ["--set", "impactor.mass=5", "--set", "block.rows=10"],
        ["--dt", "1e-7", "--choices", "paper-literal"],
        ["--set", f"start.cuts={[[0.0, 0.0, 0.01 * n, 0.05] for n in range(9)]}"],
        many,
    ):
        invoke("run", WEDGE, *given)
    name = "paper-wedge-2.86"
    assert folders[:3] == [
        name,
        f"{name}-block.rows-10-impactor.mass-5",
        f"{name}-paper-literal-numerics.dt-1e-07",
    ]
    assert len(folders[3]) == len(name) + 1 + 12
    assert folders[4] == f"{name}-foam.rate-700.0"  # the last one is what counts
    assert not (tmp_path / "runs").exists()
