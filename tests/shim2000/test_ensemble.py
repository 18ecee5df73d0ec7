"""Ensembles: their scenes, what is kept of them, and the folder that they end in."""

from __future__ import annotations

import csv
import gc
import json
import weakref
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from inspect import signature
from pathlib import Path
from typing import Any

import pytest
from html_page import Page
from lattices import COARSE
from typer.testing import CliRunner

from taichi_foam import Result, Scene, load_scene
from taichi_foam.cli.app import _app
from taichi_foam.errors import RunError, UserError
from taichi_foam.records.ending import Ending
from taichi_foam.shim2000.reproduce import reproduce
from taichi_foam.shim2000.scores import HELD_OUT, score
from taichi_foam.shim2000.study import WITHIN, check, compute, members_of
from taichi_foam.simulation import simulate
from taichi_foam.simulation.progress import Bars
from taichi_foam.sweeps.sampling import factors

FLAT, WEDGE = "paper/rectangular-3.03", "paper/wedge-2.86"


def test_velocities_are_spread_evenly_within_half_a_per_cent() -> None:
    assert factors(5, WITHIN) == pytest.approx([0.995, 0.9975, 1.0, 1.0025, 1.005])
    members = members_of(load_scene(WEDGE), 3)
    velocities = [m.impactor.velocity for m in members]
    assert velocities == pytest.approx([2.8457, 2.86, 2.8743])
    assert members == members_of(load_scene(WEDGE), 3)
    assert all(m.foam == load_scene(WEDGE).foam for m in members)


def test_each_member_draws_strengths_of_its_own_where_they_scatter() -> None:
    scatter = ["foam.strength_scatter=0.1", "foam.strength_seed=4294967295"]
    members = members_of(load_scene(WEDGE, overrides=scatter), 3)
    assert [m.foam.strength_seed for m in members] == [4294967295, 0, 1]
    assert {m.foam.strength_scatter for m in members} == {0.1}


@pytest.mark.parametrize("count", [-3, 0, 1, 101, 10**30])
def test_a_number_that_makes_no_ensemble_is_refused(count: int) -> None:
    with pytest.raises(UserError, match=rf"ensemble = {count}: must be at least 2 and at most 100"):
        check(count)


def entry(name: str, *errors: float | None) -> dict:
    """A case with errors of duration, displacement and plateau."""
    keys = ("impact_duration_s", "max_displacement_m", "plateau_deceleration_m_s2")
    found = dict(zip(keys, errors, strict=True))
    return {"name": name, "test": name, "measured": dict.fromkeys(keys, 1.0), "error": found}


def test_scores_count_hits_and_take_the_median_of_absolute_errors() -> None:
    """Of 1, 4, 20, 10, 11 % and one without an answer: three hits, and (10 + 11) / 2 %."""
    entries = [entry("a", 0.01, -0.04, 0.20), entry("b", -0.10, 0.11, None)]
    median = pytest.approx(0.105)
    assert score(entries) == {"within": 3, "of": 6, "median_absolute_error": median}
    assert score(entries[1:])["median_absolute_error"] == pytest.approx(0.11)
    lost = [entry("c", None, None, 0.0)]
    assert score(lost) == {"within": 1, "of": 3, "median_absolute_error": None}
    assert score([]) == {"within": 0, "of": 0, "median_absolute_error": None}


def test_the_middle_velocities_are_held_out() -> None:
    assert HELD_OUT == ("paper/rectangular-3.03", "paper/cylinder-2.94", "paper/wedge-2.86")


# --- what is kept, with results that were computed before --------------------------------------


def coarse(name: str) -> Scene:
    return load_scene(name, overrides=COARSE)


Change = Callable[[int, Result], Result]


@pytest.fixture
def give(study, monkeypatch: pytest.MonkeyPatch) -> Callable[..., None]:
    """Have every scene give a stored result; Ctrl-C comes after `until`."""
    stored = Result.load(study.folder / "wedge-2.86")

    def give(until: int | None = None, change: Change = lambda place, result: result) -> None:
        def simulate_many(
            scenes: Sequence[Scene], on_progress: object, **more: object
        ) -> Iterator[tuple[int, Result]]:
            for place, scene in enumerate(scenes):
                if place == until:
                    raise KeyboardInterrupt
                yield place, change(place, replace(stored, scene=scene))

        monkeypatch.setattr(simulate, "simulate_many", simulate_many)

    return give


@pytest.mark.usefixtures("quick_collections")
def test_full_runs_are_let_go_but_for_the_one_to_be_shown(give: Callable) -> None:
    seen: list[weakref.ref] = []

    def watched(place: int, result: Result) -> Result:
        gc.collect()
        # of a test that is complete one is left, and this one's
        assert sum(ref() is not None for ref in seen) <= place // 4 + place % 4 + 1
        seen.append(weakref.ref(result))
        return result

    give(change=watched)
    computed = compute([coarse(WEDGE), coarse(FLAT)], 4, Bars())
    gc.collect()
    assert sum(ref() is not None for ref in seen) == 2
    assert [case.name for case in computed.cases] == [WEDGE, FLAT]
    assert [len(case.members) for case in computed.cases] == [4, 4]
    assert computed.cases[0].velocity == 2.86
    assert not computed.interrupted


def test_ctrl_c_keeps_the_finished_members(give: Callable) -> None:
    give(until=6)
    scenes = [coarse(name) for name in (WEDGE, FLAT, "paper/cylinder-2.94")]
    computed = compute(scenes, 4, Bars())
    assert computed.interrupted
    assert [(case.name, len(case.members)) for case in computed.cases] == [(WEDGE, 4), (FLAT, 2)]
    assert computed.cut == ["paper/cylinder-2.94"]
    velocities = [m.scene.impactor.velocity for m in computed.cases[1].members]
    assert velocities == pytest.approx([3.03 * 0.995, 3.03 * (1 - 0.005 / 3)])


def test_ctrl_c_writes_a_folder_with_what_has_finished(give: Callable, tmp_path: Path) -> None:
    give(until=5)
    content = reproduce(
        tmp_path / "out", ["wedge-2.86", "cylinder-3.32"], ensemble=3, overrides=COARSE
    )
    assert content["interrupted"] is True
    assert [case["runs"] for case in content["cases"]] == [3, 2]
    assert (tmp_path / "out" / "cylinder-3.32" / "history.csv").is_file()
    assert not (tmp_path / "out" / "cylinder-3.32" / "film.mp4").exists()
    report = (tmp_path / "out" / "report.html").read_text()
    assert "<b>Interrupted.</b>" in report
    assert "Of Cylinder 3.32 2 of 3 runs have finished" in report


def test_ctrl_c_before_any_run_has_finished_writes_nothing(give: Callable, tmp_path: Path) -> None:
    give(until=0)
    with pytest.raises(KeyboardInterrupt, match="no run had finished"):
        reproduce(tmp_path / "out", ["wedge-2.86"], ensemble=3)
    assert list(tmp_path.iterdir()) == []


def test_a_run_that_fails_is_left_out_and_told(give: Callable, tmp_path: Path) -> None:
    """The others have the strengths that they draw in any case."""

    def fail(place: int, result: Result) -> Result:
        bad = {**result.run, "ended_by": Ending.CROWDED}
        return replace(result, run=bad) if place == 1 else result

    give(change=fail)
    scattered = [*COARSE, "foam.strength_scatter=0.1", "foam.strength_seed=7"]
    with pytest.raises(RunError, match=r"2\.86\d* m/s: too many neighbours") as raised:
        reproduce(tmp_path / "out", ["wedge-2.86"], ensemble=3, films=False, overrides=scattered)
    assert "run paper/wedge-2.86 with impactor.velocity=2.86" in str(raised.value)
    content = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert content["cases"][0]["runs"] == 2
    report = (tmp_path / "out" / "report.html").read_text()
    assert "too many neighbours" in report
    assert "another draw of the foam's strengths" in report
    with (tmp_path / "out" / "members.csv").open(newline="") as file:
        assert [member["strength_seed"] for member in csv.DictReader(file)] == ["7", "9"]
    shown = Result.load(tmp_path / "out" / "wedge-2.86").scene
    assert shown.foam.strength_seed == (7 if shown.impactor.velocity < 2.86 else 9)


# --- a tiny one from end to end -----------------------------------------------------------------


def test_the_folder_holds_all_of_it(ensemble) -> None:
    names = {path.name for path in ensemble.folder.iterdir()}
    assert names == {
        "report.html", "tables.csv", "members.csv", "summary.json", "figures", "rectangular-3.03",
        "manifest.json",
    }  # fmt: skip
    figures = {path.name for path in (ensemble.folder / "figures").iterdir()}
    assert {"errors.png", "decelerations-rectangular.png", "film-rectangular.gif"} <= figures
    assert (ensemble.folder / "rectangular-3.03" / "film.mp4").is_file()


def test_two_runs_have_their_mean_as_median(ensemble) -> None:
    """Of two, the ends of the band lie a twentieth of their distance within them."""
    members = ensemble.rows("members.csv")
    velocities = [float(member["velocity_m_s"]) for member in members]
    assert velocities == pytest.approx([0.995 * 3.03, 1.005 * 3.03])
    (case,) = json.loads((ensemble.folder / "summary.json").read_text())["cases"]
    assert case["runs"] == 2
    for key in ("impact_duration_s", "max_displacement_m", "initial_peak_m_s2"):
        low, high = sorted(float(member[key]) for member in members)
        assert case["simulated"][key] == pytest.approx((low + high) / 2, rel=1e-5)
        assert case["low"][key] == pytest.approx(low + 0.05 * (high - low), rel=1e-5)
        assert case["high"][key] == pytest.approx(high - 0.05 * (high - low), rel=1e-5)
        error = case["simulated"][key] / case["measured"][key] - 1.0
        assert case["error"][key] == pytest.approx(error)


def test_tables_have_the_bands_and_the_initial_peak(ensemble) -> None:
    rows = {row["quantity"]: row for row in ensemble.rows("tables.csv")}
    assert float(rows["initial_peak_m_s2"]["measured"]) == 97.0
    assert float(rows["initial_peak_time_s"]["measured"]) == 0.002
    (case,) = ensemble.content["cases"]
    for key, row in rows.items():
        assert float(row["low"]) == pytest.approx(case["low"][key], rel=1e-5)
        assert float(row["low"]) <= float(row["simulated"]) <= float(row["high"])
        assert row["miss"] == str(int(abs(case["error"][key]) > 0.10))


def test_the_shown_run_is_one_of_the_members(ensemble) -> None:
    stored = Result.load(ensemble.folder / "rectangular-3.03")
    velocity = stored.scene.impactor.velocity
    assert velocity in [pytest.approx(f * 3.03) for f in (0.995, 1.005)]


def test_scores_and_criteria_stand_in_the_summary(ensemble) -> None:
    found = ensemble.content["ensemble"]
    assert found["runs"] == 2
    assert found["all"]["of"] == 3
    assert found["held_out"]["cases"] == [FLAT]
    assert found["fitted"]["cases"] == []
    judged = ensemble.content["criteria"]
    assert "flat-width" in {criterion["key"] for criterion in judged}, "Fig. 22 shows this test"
    for criterion in judged:
        assert criterion["of"] == 2
        assert criterion["holds"] == (criterion["met"] == 2)  # one of two is half


def test_the_report_has_the_ensembles_sections(ensemble) -> None:
    text = (ensemble.folder / "report.html").read_text()
    page = Page(text)
    page.check(ensemble.folder)
    assert {"tables", "criteria", "rectangular"} <= page.ids
    assert "Each test ran 2 times" in text
    assert "held out" in text
    assert "the run nearest to the medians" in text
    assert page.badges == ensemble.badges


def test_the_command_shows_medians_bands_and_scores(
    ensemble, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What is asked for is what has been computed."""

    def computed(*given: object, **options: object) -> dict[str, Any]:
        asked = signature(reproduce).bind(*given, **options).arguments
        assert (asked["out"], asked["cases"], asked["ensemble"]) == ("out", ["rectangular-3.03"], 2)
        return ensemble.content

    monkeypatch.setattr("taichi_foam.shim2000.reproduce.reproduce", computed)
    monkeypatch.chdir(ensemble.folder.parent)
    asked = ["--ensemble", "2", "--cases", "rectangular-3.03", "--out", "out"]
    result = CliRunner().invoke(_app, ["reproduce", *asked])
    assert result.exit_code == 0, result.output
    (case,) = ensemble.content["cases"]
    lines = result.stdout.splitlines()
    assert max(map(len, lines[:-1])) <= 80
    assert lines[0].startswith("median of 2 runs, and its error (calibrated)")
    row = next(line for line in lines if line.startswith("rectangular-3.03"))
    assert f"{100 * case['simulated']['max_displacement_m']:.2f}" in row
    band = next(line for line in lines if line.startswith("  5 to 95 %"))
    assert f"{100 * case['low']['max_displacement_m']:.2f} to" in band
    assert next(line for line in lines if line.startswith("  measured")).split()[1] == "6.50"
    assert any(line.startswith("held out") for line in lines)
    assert "in out: report.html" in lines[-1]
