"""Standard output and error of any encoding, closed or full: nothing is lost, no traceback."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from command_line import COARSE_OPTIONS, fill_disk
from processes import ENVIRONMENT
from typer.testing import CliRunner

from taichi_foam.cli import app
from taichi_foam.results.result import OUTPUTS, Result, RunFile

SHORT = ["--set", "numerics.end=1e-3", "--no-film"]
RUN = f"run paper/wedge-2.86 {' '.join([*COARSE_OPTIONS, *SHORT])}"


@pytest.fixture(scope="module")
def computed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a run for which only the disk had no room: it has to be written."""
    folder = tmp_path_factory.mktemp("full")
    full = RunFile(lambda result, path: fill_disk(path))
    with pytest.MonkeyPatch.context() as patched:
        patched.chdir(folder)
        patched.setitem(OUTPUTS, "snapshots.npz", full)
        result = CliRunner().invoke(app._app, [*RUN.split(), "--out", "run"])
    assert "the disk is full" in result.stderr
    return folder / "run"


@pytest.fixture
def unwritten(computed: Path, tmp_path: Path) -> None:
    """A copy of it, called `run`."""
    shutil.copytree(computed, tmp_path / "run")


def shell(line: str, cwd: Path, **environment: str) -> subprocess.CompletedProcess[bytes]:
    """A line of the shell, in which `foam` is the command line."""
    if "/dev/full" in line and not Path("/dev/full").exists():
        pytest.skip("this system has no /dev/full")
    return subprocess.run(
        line.replace("foam ", f"{sys.executable} -m taichi_foam ", 1),
        shell=True,
        cwd=cwd,
        env={**ENVIRONMENT, "PYTHONWARNINGS": "ignore", **environment},
        capture_output=True,
        timeout=240,
        check=False,
    )


@pytest.mark.usefixtures("unwritten")
@pytest.mark.parametrize(
    ("encoding", "redirected", "shown"),
    [
        ("ascii", "2>/dev/full", b"J/m?"),
        ("cp1252", "2>&-", "J/m\N{SUPERSCRIPT THREE}".encode("cp1252")),
    ],
)
def test_a_run_that_cannot_say_all(
    encoding: str, redirected: str, shown: bytes, tmp_path: Path
) -> None:
    done = shell(f"foam {RUN} --out run {redirected}", tmp_path, PYTHONIOENCODING=encoding)
    assert (done.returncode, done.stderr) == (0, b"")
    assert shown in done.stdout
    assert b"in run: summary.json" in done.stdout
    assert Result.load(tmp_path / "run").ending is not None


@pytest.mark.usefixtures("unwritten")
def test_a_run_that_can_say_nothing(tmp_path: Path) -> None:
    """What the process opens first must not get the number of standard error."""
    done = shell(f"foam {RUN} --out run <&- >&- 2>&-", tmp_path)
    assert done.returncode == 0
    assert Result.load(tmp_path / "run").ending is not None


def test_standard_output_that_is_full_is_told(tmp_path: Path) -> None:
    done = shell("foam scenes >/dev/full", tmp_path)
    assert done.returncode == 1
    assert done.stderr == (b"error: standard output cannot be written: No space left on device\n")


@pytest.mark.parametrize("redirected", ["2>/dev/full", "2>&-"])
def test_a_refusal_that_nobody_can_read(redirected: str, tmp_path: Path) -> None:
    done = shell(f"foam run nowhere.toml {redirected}", tmp_path)
    assert (done.returncode, done.stdout, done.stderr) == (2, b"", b"")


def test_a_reader_that_has_gone(tmp_path: Path) -> None:
    done = shell("foam scenes | head -n 1", tmp_path)
    assert done.stdout.startswith(b"paper/")
    assert done.stderr == b""
