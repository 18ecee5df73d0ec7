"""Calibrations from a trace to a folder, with runs whose pulses are known."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from pulses import FIT, SCENE, Solver, measured
from typer.testing import CliRunner

from taichi_foam.calibration.calibrate import calibrate
from taichi_foam.calibration.outcome import Calibration
from taichi_foam.calibration.space import space_of
from taichi_foam.catalogue import load_scene
from taichi_foam.cli.app import _app
from taichi_foam.errors import RunWarning, UserError

TRUTH = {
    "foam.yield_strain": -0.045,
    "foam.densification_strain": -0.75,
    "impactor.friction": 0.2,
}
FITTED = ["--fit", "foam.yield_strain=-0.06..-0.03"]
HOW = {"runs": 32, "waves": 1, "noise": 0.05, "threads": 1}

pytestmark = pytest.mark.filterwarnings("ignore::taichi_foam.errors.RunWarning")


def trace_file(path: Path, unit: str = "g", factor: float = 1 / 9.80665) -> Path:
    time, deceleration = measured(load_scene(SCENE).with_values(TRUTH))
    head = f"time [ms],channel [{unit}]"
    columns = np.stack([1e3 * time, factor * deceleration], axis=1)
    np.savetxt(path, columns, delimiter=",", header=head, comments="")
    return path


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("calibration")


@pytest.fixture(scope="module")
def found(folder: Path) -> Calibration:
    trace = trace_file(folder / "trace.csv")
    return calibrate(trace, SCENE, FIT, folder / "out", solve=Solver(), discrepancy=0.0, **HOW)


def test_intervals_hold_the_truth_and_what_has_no_influence_is_flagged(found: Calibration) -> None:
    for row in found.table[:2]:
        assert row["low_5"] < TRUTH[row["parameter"]] < row["high_95"]
        assert row["verdict"] == "determined"
        assert row["width_over_prior"] < 0.4
    assert found.table[2]["verdict"] == "not determined"
    assert "not determined" in repr(found)


def test_the_predicted_band_holds_the_trace(found: Calibration) -> None:
    own, whole = found.bands
    assert (whole[2] - whole[0] >= own[2] - own[0]).mean() > 0.95
    assert 0.75 < (found.inside_band or 0.0) <= 1.0
    assert all(part > 0.7 for part in found.held_out.values())


def test_the_folder_holds_report_tables_runs_and_figures(found: Calibration, folder: Path) -> None:
    out = folder / "out"
    assert {path.name for path in out.iterdir()} == {
        "report.html", "calibration.csv", "calibration.json", "runs.csv", "figures",
        "manifest.json",
    }  # fmt: skip
    content = json.loads((out / "calibration.json").read_text())
    assert [row["parameter"] for row in content["parameters"]] == [*FIT]
    assert content["filter"] == "CFC 180"
    assert content["figures"][0]["name"] == "peak, CFC 180"
    page = (out / "report.html").read_text()
    assert "impactor.friction is not determined" in page
    assert len((out / "runs.csv").read_text().splitlines()) == 1 + 32 + 32


def test_force_sign_offset_and_key_figures(folder: Path) -> None:
    """A force in kN, negative, on an offset of 5 m/s2, and a key figure that fixes the rest."""
    scene = load_scene(SCENE)
    assert scene.impactor is not None
    time, deceleration = measured(scene.with_values(TRUTH))
    columns = [1e3 * time, -1e-3 * scene.impactor.mass * (deceleration + 5.0)]
    path = folder / "force.csv"
    np.savetxt(path, np.stack(columns, 1), delimiter=";", header="t [ms];load [kN]", comments="")
    one = {"foam.yield_strain": FIT["foam.yield_strain"]}
    found = calibrate(
        path, scene.with_values({"foam.densification_strain": -0.75}), one, solve=Solver(),
        figures={"max_displacement_m": (0.045, 0.0002)}, **HOW,
    )  # fmt: skip
    (row,) = found.table
    assert row["low_5"] < -0.045 < row["high_95"]
    assert any("sign was changed" in note for note in found.notes)
    (offset,) = (note for note in found.notes if note.startswith("offset: "))
    # the mean of some 90 samples of 5 % noise: four standard deviations
    assert float(offset.split()[1]) == pytest.approx(5.0, abs=4 * 0.05 * 260 / np.sqrt(90))
    assert found.names[-1] == "max_displacement_m"


def test_what_fails_is_a_point_and_what_is_interrupted_goes_on(folder: Path) -> None:
    def pressed(count: int) -> None:
        if count == 40:
            raise KeyboardInterrupt

    trace, out = folder / "trace.csv", folder / "interrupted"
    trace_file(trace)
    solver = Solver(before=pressed, fails=lambda scene: scene.foam.densification_strain > -0.68)
    two = {**HOW, "waves": 2, "discrepancy": 0.0}
    pair = {key: FIT[key] for key in ("foam.yield_strain", "foam.densification_strain")}
    with pytest.raises(KeyboardInterrupt, match="the same command goes on"):
        calibrate(trace, SCENE, pair, out, solve=solver, **two)
    assert [scene.name for scene in solver.asked] == [SCENE] * 40
    with pytest.raises(UserError, match="unfinished work of another command"):
        calibrate(trace, SCENE, pair, out, solve=solver, **{**two, "seed": 5})
    solver.before = lambda count: None
    with pytest.warns(RunWarning, match="runs failed, the first because: values are not finite"):
        found = calibrate(trace, SCENE, pair, out, solve=solver, **two)
    # the first wave was complete, and was not computed again
    values = [(scene.foam.yield_strain, scene.foam.densification_strain) for scene in solver.asked]
    assert not {*values[:32]} & {*values[32:]}
    assert len(values) <= 40 + 32 + 32
    assert found.samples[:, 1].max() < -0.68


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (["--fit", "foam.yeld_strain=-0.06..-0.03"], "did you mean foam.yield_strain?"),
        (["--fit", "foam.yield_strain=-0.03..-0.06"], "is not below HIGH"),
        (["--fit", "foam.yield_strain=-0.9..-0.03"], "at least -0.5 and below 0"),
        (["--fit", "foam.yield_strain=low..high"], "must read KEY=LOW..HIGH"),
        (["--fit", "block.rows=8..12"], "only a key that takes any number"),
        ([], "no parameter given"),
        ([*FITTED, "--cfc", "100"], "must be one of 60"),
        ([*FITTED, "--runs", "3"], "choose 12 to"),
        ([*FITTED, "--noise", "5"], "0.05 for 5 %"),
        ([*FITTED, "--cfc", "1000"], "trace.csv: 2500 samples/s"),
        ([*FITTED, "--column", "load"], "'load' in its header"),
    ],
)
def test_bad_input_is_refused_with_a_remedy(options: list[str], says: str, tmp_path: Path) -> None:
    """What is no trace is in tests/scene/test_traces.py."""
    path, out = tmp_path / "trace.csv", tmp_path / "out"
    time, deceleration = (each[::4] for each in measured(load_scene(SCENE)))
    columns = np.stack([1e3 * time, deceleration], 1)
    np.savetxt(path, columns, delimiter=",", header="t [ms],a [m/s2]", comments="")
    asked = CliRunner().invoke(_app, ["calibrate", str(path), SCENE, *options, "--out", str(out)])
    assert asked.exit_code == 2, asked.output
    assert says in " ".join(asked.stderr.split())
    assert not out.exists()


def test_a_range_is_linear_or_logarithmic_and_nothing_else() -> None:
    """In a program as in text: a misspelt word would be linear unseen."""
    scene = load_scene("paper/wedge-2.86")
    assert space_of(scene, {"impactor.mass": (1.0, 5.0, "log")}).ranges[0].log
    with pytest.raises(UserError, match="spacing = 'LOG': must be 'linear' or"):
        space_of(scene, {"impactor.mass": (1.0, 5.0, "LOG")})
