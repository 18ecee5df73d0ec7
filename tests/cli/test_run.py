"""`run`, `scenes`, `reproduce` and scripts, from the outside."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from command_line import COARSE, COARSE_OPTIONS, call
from processes import ENVIRONMENT

from taichi_foam import Result, Scene, load_scene
from taichi_foam.cli import run_script
from taichi_foam.errors import RunError, UserError
from taichi_foam.results.manifest import MANIFEST
from taichi_foam.results.result import OUTPUTS
from taichi_foam.scene import Cylinder
from taichi_foam.shim2000 import impacts
from taichi_foam.shim2000 import reproduce as study
from taichi_foam.simulation import simulate
from taichi_foam.version import version

WEDGE = "paper/wedge-2.86"

#: What the summary of a run has at least.
KEYS = {
    "scene",
    "impact_duration_s",
    "max_displacement_m",
    "plateau_deceleration_m_s2",
    "initial_peak_m_s2",
    "energy_absorbed_J",
    "crushed_volume_m3",
    "energy_per_volume_J_m3",
    "rebound_velocity_m_s",
    "pieces",
    "crack_lowest_height_m",
    "broken_bonds",
    "energy_residual",
    "steps",
    "dt_min_s",
    "dt_max_s",
    "wall_s",
    "node_stages_per_s",
}


def summary_of(folder: Path) -> dict:
    return json.loads((folder / "summary.json").read_text())


def test_version(invoke: Callable) -> None:
    assert invoke("--version").stdout == f"taichi-foam {version()}\n"


def completed(words: str, cwd: Path) -> list[str]:
    """What the shell's completion offers for the last of these words."""
    asked = {
        "_TAICHI_FOAM_COMPLETE": "complete_bash",
        "COMP_WORDS": words,
        "COMP_CWORD": str(words.count(" ")),
    }
    done = subprocess.run(
        [sys.executable, "-m", "taichi_foam"],
        cwd=cwd, env=ENVIRONMENT | asked, capture_output=True, text=True, timeout=60, check=True,
    )  # fmt: skip
    return done.stdout.split()


def test_the_shell_completes_commands_scenes_and_foams(invoke: Callable, tmp_path: Path) -> None:
    assert "--install-completion" in invoke("--help").stdout
    assert completed("taichi-foam re", tmp_path) == ["resume", "render", "reproduce"]
    wedges = [name for name in impacts.NAMES if name.startswith("paper/wedge")]
    assert completed("taichi-foam run paper/w", tmp_path) == wedges
    assert completed("taichi-foam serve gallery/own", tmp_path) == ["gallery/own-foam"]
    assert completed("taichi-foam foam show shim", tmp_path) == ["shim2000-pu"]


def test_scenes_lists_every_built_in_scene_on_a_line(invoke: Callable) -> None:
    lines = invoke("scenes").stdout.splitlines()
    names = [line.split()[0] for line in lines]
    assert set(impacts.NAMES) < set(names)
    for name in names:
        assert isinstance(load_scene(name), Scene)


def test_a_run_writes_its_folder_and_shows_its_figures(invoke: Callable, tmp_path: Path) -> None:
    result = invoke("run", WEDGE, *COARSE_OPTIONS, "--frames")
    assert result.exit_code == 0, result.output
    (folder,) = (tmp_path / "runs").iterdir()
    found = summary_of(folder)
    assert set(found) >= KEYS
    assert found["interrupted"] is False
    stored = Result.load(folder)
    assert len(list((folder / "frames").glob("*.png"))) == len(stored.snapshots)
    assert (folder / "film.gif").stat().st_size > 1000
    assert (folder / "film.mp4").stat().st_size > 1000
    # The table: computed beside measured, in people's units.
    row = next(line for line in result.stdout.splitlines() if "maximum displacement" in line)
    assert f"{100 * found['max_displacement_m']:.2f}" in row
    assert "7.50" in row
    assert f"runs/{folder.name}" in result.stdout
    assert re.search(r"computing paper/wedge-2\.86: .* steps/s", result.stderr)


def test_options_come_in_order(
    invoke: Callable, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Scene < --choices < --dt < --set, and later --set beats earlier."""
    scenes: list[Scene] = []

    def record(scene: Scene, on_progress: object, **more: object) -> Result:
        scenes.append(scene)
        raise RunError("recorded")

    monkeypatch.setattr(simulate, "run", record)
    (tmp_path / "own.toml").write_text(
        'name = "own"\n[impactor]\nshape = "wedge"\nfriction = 0.7\n[numerics]\ndt = 5e-6\n'
    )
    invoke("run", "own.toml")
    invoke("run", "own.toml", "--choices", "paper-literal", "--dt", "1e-6", "--no-film")
    first, last = ["--set", "numerics.dt=3e-6"], ["--set", "numerics.dt=2e-6"]
    held = ["--set", "base.kind=floor", "--set", "output.film=true"]
    literal = ["--choices", "paper-literal"]
    invoke("run", "own.toml", *first, *last, *held, "--no-film", "--dt", "auto", *literal)
    steps = [scene.numerics.dt for scene in scenes]
    assert steps == [5e-6, 1e-6, 2e-6]
    assert [s.impactor.friction for s in scenes if s.impactor] == [0.7, 0.0, 0.0]
    assert [s.base.kind for s in scenes] == ["gripped", "held", "floor"]
    assert [s.output.film for s in scenes] == [True, False, True]


def test_a_failed_run_is_saved(invoke: Callable, tmp_path: Path) -> None:
    """With six times the step that is stable."""
    wild = ["--dt", "1e-4", "--set", "numerics.end=0.01"]
    result = invoke("run", WEDGE, *COARSE_OPTIONS, *wild, "--out", "wild")
    assert result.exit_code == 1, result.output
    assert re.search(r"diverged at [0-9.]+ ms, first at node \(\d+, \d+\)", result.stderr)
    assert "numerics.dt" in result.stderr
    assert "Traceback" not in result.stderr
    assert summary_of(tmp_path / "wild")["run"]["ended_by"] == "diverged"
    assert len(Result.load(tmp_path / "wild").history["time_s"]) >= 1


def test_a_run_that_makes_energy_is_not_passed_over(invoke: Callable) -> None:
    """A step of twice the stable one: the values stay finite, but wrong."""
    between = ["--dt", "1.6e-5"]
    result = invoke(
        "run", WEDGE, *COARSE_OPTIONS, *between, "--set", "numerics.end=0.01", "--no-film"
    )
    assert result.exit_code == 0, result.output
    assert "of the impact energy is unaccounted for" in result.stderr
    assert "times the stable step" in result.stderr
    assert result.stderr.count("set numerics.dt = 'auto'") == 3
    assert "RunWarning" not in result.stderr  # told once, not by Python too


def test_a_script_runs_by_itself_with_the_same_options(tmp_path: Path) -> None:
    (tmp_path / "drop.py").write_text(
        "from taichi_foam.scene import Cylinder, Scene\n"
        "scene = Scene(name='My drop / 1', impactor=Cylinder(velocity=3.0))\n"
        "if __name__ == '__main__':\n"
        "    from taichi_foam.cli import run_script\n"
        "    run_script(scene)\n"
    )
    short = ["--set", "numerics.end=3e-3", "--no-film"]
    done = call("drop.py", *COARSE_OPTIONS, *short, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    (folder,) = (tmp_path / "runs").iterdir()
    assert folder.name == "My-drop-1-block.columns-20-block.rows-10-numerics.end-0.003"
    names = {path.name for path in folder.iterdir()}
    assert names == {*OUTPUTS, MANIFEST} - {"compression.csv"}
    again = load_scene(folder / "scene.toml")
    assert again == load_scene(
        tmp_path / "drop.py", overrides=[*COARSE, "numerics.end=3e-3", "output.film=false"]
    )


def test_a_script_is_refused_with_the_same_words(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", ["drop.py", "--set", "block.rows=0", "--out", "x"])
    with pytest.raises(SystemExit) as ended:
        run_script(Scene(name="refused", impactor=Cylinder()))
    assert ended.value.code == 2
    assert "block.rows = 0" in capsys.readouterr().err


def test_options_of_reproduce_reach_the_study(
    invoke: Callable, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What it computes and prints is tested in tests/shim2000."""
    asked: dict[str, Any] = {}

    def record(out: str, cases: list[str], **options: object) -> None:
        asked.update(options, out=out, cases=cases)
        raise UserError("recorded")

    monkeypatch.setattr(study, "reproduce", record)
    invoke("reproduce", "--ensemble", "16", "--cases", "wedge-2.86", "--out", "many", "--no-films")
    assert (asked["ensemble"], asked["out"], asked["films"]) == (16, "many", False)
    assert asked["cases"] == ["wedge-2.86"]
    invoke("reproduce")
    assert asked["ensemble"] is None
