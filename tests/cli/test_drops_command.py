"""`run --after` and `run --drops`."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from bench import interrupt_at
from command_line import assert_refused, tree

from taichi_foam.results.result import Result
from taichi_foam.simulation import simulate

SCENE = """name = "pad"
foam = "shim2000-pu"
[block]
width = 0.05
height = 0.05
columns = 10
rows = 10
[impactor]
shape = "flat"
width = 0.08
mass = 0.5
drop_height = 0.3
[output]
film = false
"""


@pytest.fixture
def scene(tmp_path: Path) -> str:
    (tmp_path / "pad.toml").write_text(SCENE)
    return "pad.toml"


def test_a_series_has_a_folder_for_each_drop_and_a_table(
    invoke: Callable, scene: str, tmp_path: Path
) -> None:
    found = invoke("run", scene, "--drops", "2")
    assert found.exit_code == 0, found.output
    (folder,) = (tmp_path / "runs").iterdir()
    assert folder.name == "pad-2-drops"
    assert {path.name for path in folder.iterdir()} == {
        "drop-1", "drop-2", "drops.csv", "drops.png", "manifest.json",
    }  # fmt: skip
    with (folder / "drops.csv").open() as file:
        rows = list(csv.DictReader(file))
    for number, row in enumerate(rows, 1):
        figures = json.loads((folder / f"drop-{number}" / "summary.json").read_text())
        assert int(row["drop"]) == number == figures["drop"]
        for key in ("peak_deceleration_g", "max_strain", "restitution", "rest_height_m"):
            assert float(row[key]) == figures[key]
        assert f"{figures['peak_deceleration_cfc180_g']:.1f}" in found.stdout
    # as run after run
    after = invoke("run", scene, "--after", "runs/pad-2-drops/drop-1", "--out", "again")
    assert after.exit_code == 0, after.output
    one, other = Result.load(folder / "drop-2"), Result.load(tmp_path / "again")
    for name, column in one.history.items():
        np.testing.assert_array_equal(column, other.history[name], err_msg=name)
    assert one.run["after"] == other.run["after"]
    before = tree(tmp_path)
    assert_refused(invoke("run", scene, "--drops", "2"), "already holds a result", "--overwrite")
    assert tree(tmp_path) == before


def test_a_series_that_is_interrupted_goes_on(
    invoke: Callable, scene: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = invoke("run", scene, "--drops", "2", "--out", "whole")
    assert whole.exit_code == 0, whole.output
    original = simulate.run_drops

    def cut(*arguments: object, **more: object) -> list[Result]:
        return original(*arguments[:2], interrupt_at(0.7), **more)

    with monkeypatch.context() as patched:
        patched.setattr(simulate, "run_drops", cut)
        found = invoke("run", scene, "--drops", "2", "--out", "cut")
    assert found.exit_code == 130, found.output
    assert "the same command continues from there" in found.stderr
    assert Result.load(tmp_path / "cut" / "drop-1").run["ended_by"] == "rebound"
    found = invoke("run", scene, "--drops", "2", "--out", "cut")
    assert found.exit_code == 0, found.output
    for number in (1, 2):
        name = f"drop-{number}/history.csv"
        assert (tmp_path / "cut" / name).read_bytes() == (tmp_path / "whole" / name).read_bytes()
    assert Result.load(tmp_path / "cut" / "drop-2").run["resumed"] == 1


def test_another_block_is_refused(invoke: Callable, scene: str, tmp_path: Path) -> None:
    assert invoke("run", scene, "--out", "first").exit_code == 0
    before = tree(tmp_path)
    found = invoke(
        "run", scene, "--after", "first", "--set", "block.rows=12", "--set", "foam.softening=false"
    )
    assert_refused(found, "block.rows = 10 instead of 12", "foam.softening", "Fix: ")
    assert_refused(invoke("run", scene, "--after", "nowhere"), "nowhere", "no such folder")
    assert_refused(invoke("run", scene, "--after", "first", "--drops", "2"), "--after")
    assert_refused(invoke("run", scene, "--drops", "0"), "at least 1")
    assert_refused(invoke("run", scene, "--drops", "2", "--live"), "--drops")
    assert tree(tmp_path) == before


def test_a_block_that_was_tampered_with_is_refused(
    invoke: Callable, scene: str, tmp_path: Path
) -> None:
    assert invoke("run", scene, "--out", "first").exit_code == 0
    state = tmp_path / "first" / "state.npz"
    state.write_bytes(state.read_bytes()[:-40])
    assert_refused(invoke("run", scene, "--after", "first"), "not as they were written: state.npz")
