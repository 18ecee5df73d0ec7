"""What `reproduce` writes, and what it does when a case fails or Ctrl-C comes."""

from __future__ import annotations

import contextlib
import json
import os
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import pytest
from imageio_ffmpeg import count_frames_and_secs
from PIL import Image

from taichi_foam import Result, UserError
from taichi_foam.errors import Interrupted, RunError
from taichi_foam.picture import films, raster
from taichi_foam.records.ending import Ending
from taichi_foam.results import manifest
from taichi_foam.results.folders import UNFINISHED
from taichi_foam.results.result import OUTPUTS
from taichi_foam.shim2000.impacts import NAMES, case_names
from taichi_foam.shim2000.reproduce import reproduce
from taichi_foam.simulation import simulate
from taichi_foam.simulation.progress import Bars

CASES = ["rectangular-3.03", "wedge-2.86"]
SMALL = ("block.columns=12", "block.rows=6", "numerics.end=3e-3")


def test_case_names_with_and_without_prefix() -> None:
    assert case_names(None) == list(NAMES)
    found = case_names(["wedge-2.86", " paper/wedge-2.86 ", "cylinder-2.32"])
    assert found == ["paper/wedge-2.86", "paper/cylinder-2.32"]
    with pytest.raises(UserError, match=r"did you mean cylinder-2\.32"):
        case_names(["cylinder-2.23"])


def test_the_folder_holds_all_of_it(study) -> None:
    names = {path.name for path in study.folder.iterdir()}
    written = {"report.html", "tables.csv", "summary.json", manifest.MANIFEST, "figures"}
    assert names == written | set(CASES)
    data = {*OUTPUTS, manifest.MANIFEST} - {"compression.csv"}
    for case in CASES:
        names = {path.name for path in (study.folder / case).iterdir()}
        assert names == data | {"film.gif", "film.mp4"}
        with Image.open(study.folder / case / "film.gif") as film:
            assert film.size == (320, 180)


def test_summary_has_the_cases_with_the_same_keys(study) -> None:
    content = json.loads((study.folder / "summary.json").read_text())
    assert [case["name"] for case in content["cases"]] == [f"paper/{case}" for case in CASES]
    assert content["choices"] == "calibrated"
    assert content["interrupted"] is False
    assert {"processor", "cores"} <= set(content["machine"])
    for case in content["cases"]:
        own = json.loads((study.folder / case["name"][6:] / "summary.json").read_text())
        assert own.pop("run")["batch"] == 2
        assert case["simulated"] == own
        assert set(case["measured"]) == set(case["error"]) == set(own)


def test_errors_are_relative_to_the_tables(study) -> None:
    """Against figures read from Tables 2, 4 and 5 of the paper."""
    flat, wedge = study.content["cases"]
    for case, key, measured in (
        (flat, "impact_duration_s", 0.042),
        (flat, "max_displacement_m", 0.065),
        (flat, "initial_peak_m_s2", 97.0),
        (wedge, "plateau_deceleration_m_s2", 66.0),
        (wedge, "energy_per_volume_J_m3", 1.36e5),
    ):
        assert case["measured"][key] == pytest.approx(measured)
        simulated = case["simulated"][key]
        assert case["error"][key] == pytest.approx((simulated - measured) / measured)
    assert wedge["measured"]["initial_peak_m_s2"] is None
    assert wedge["error"]["initial_peak_m_s2"] is None
    assert flat["measured"]["rebound_velocity_m_s"] is None


def test_tables_repeat_the_summary(study) -> None:
    rows = study.rows("tables.csv")
    by_name = {case["name"]: case for case in study.content["cases"]}
    assert len(rows) == 7 + 5  # a flat block has an initial peak and its time
    for row in rows:
        case, key = by_name[row["case"]], row["quantity"]
        assert float(row["measured"]) == pytest.approx(case["measured"][key], rel=1e-5)
        assert float(row["simulated"]) == pytest.approx(case["simulated"][key], rel=1e-5)
        assert row["miss"] == str(int(abs(case["error"][key]) > 0.10))
    theirs = {row["case"]: row["paper_simulation"] for row in rows if row["paper_simulation"]}
    assert theirs == {"paper/rectangular-3.03": "0.0402", "paper/wedge-2.86": "0.0483"}


def altered(change: Callable[[list[Result]], list[Result]]) -> Callable:
    """`run_many`, with a change to what it gives."""
    original = simulate.run_many
    return lambda scenes, on_progress, **more: change(original(scenes, on_progress))


def cut(result: Result) -> Result:
    return replace(result, run={**result.run, "interrupted": True, "ended_by": Ending.INTERRUPTED})


def test_ctrl_c_keeps_the_finished_cases(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupt(results: list[Result]) -> list[Result]:
        raise Interrupted({0: results[0], 1: cut(results[1])})

    monkeypatch.setattr(simulate, "run_many", altered(interrupt))
    content = reproduce(tmp_path / "out", CASES, overrides=SMALL)
    assert content["interrupted"] is True
    assert content["not_finished"] == ["paper/wedge-2.86"]
    assert [case["name"] for case in content["cases"]] == ["paper/rectangular-3.03"]
    assert not (tmp_path / "out" / "wedge-2.86").exists()
    report = (tmp_path / "out" / "report.html").read_text()
    assert "<b>Interrupted.</b>" in report
    assert "Wedge 2.86" in report


class Pressed(Bars):
    """Ctrl-C once the impacts have come half way."""

    @contextlib.contextmanager
    def computing(self, what: str) -> Iterator[Callable]:
        def press(progress: simulate.Progress) -> None:
            if progress.fraction > 0.5:
                raise KeyboardInterrupt

        yield press


def test_the_same_call_goes_on_where_ctrl_c_came(tmp_path: Path) -> None:
    given = {"overrides": (*SMALL, "impactor.mass=5.0"), "films": False}
    with pytest.raises(KeyboardInterrupt, match="no case had finished"):
        reproduce(tmp_path / "cut", CASES, bars=Pressed(), **given)
    assert os.listdir(tmp_path / "cut") == [UNFINISHED]
    with pytest.raises(UserError, match=r"of another command, with impactor\.mass = 5\.0 instead"):
        reproduce(tmp_path / "cut", CASES, overrides=SMALL, films=False)
    for out in ("cut", "whole"):
        content = reproduce(tmp_path / out, CASES, **given)
        assert content["interrupted"] is False
    for case in CASES:
        cut_, whole = tmp_path / "cut" / case, tmp_path / "whole" / case
        assert (cut_ / "history.csv").read_bytes() == (whole / "history.csv").read_bytes()
        assert Result.load(cut_).run["resumed"] == 1
    assert sorted(os.listdir(tmp_path / "cut")) == sorted(os.listdir(tmp_path / "whole"))


def test_ctrl_c_among_the_films_keeps_the_results_and_whole_films(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It comes in the first frame of the second test, while the films of the first are encoded."""

    paint = raster.paint

    def pressed(*arguments: object, **options: object) -> None:
        monkeypatch.setattr(raster, "paint", paint)  # the report has pictures, too
        raise KeyboardInterrupt

    draw, begun = films.Reel.drawn, []

    def drawn(reel: films.Reel, folder: Path, *arguments: object, **options: object) -> object:
        begun.append(folder)
        if len(begun) == 2:
            monkeypatch.setattr(raster, "paint", pressed)
        return draw(reel, folder, *arguments, **options)

    monkeypatch.setattr(films.Reel, "drawn", drawn)
    content = reproduce(tmp_path / "out", CASES, overrides=SMALL)
    assert content["interrupted"] is True
    assert content["not_finished"] == []
    first, second = begun
    assert count_frames_and_secs(str(first / "film.mp4"))[0] == len(Result.load(first).snapshots)
    assert {"film.mp4", "film.gif"} <= set(manifest.Manifest.read(first).files)
    assert [name for name in os.listdir(second) if "film" in name] == []
    assert Result.load(second).scene.name == f"paper/{second.name}"


def test_a_failed_case_is_kept_apart_and_the_others_reported(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(results: list[Result]) -> list[Result]:
        bad = replace(results[1], run={**results[1].run, "ended_by": Ending.DIVERGED})
        raise RunError("wedge: not finite at 1 ms", [results[0], bad])

    monkeypatch.setattr(simulate, "run_many", altered(fail))
    with pytest.raises(RunError, match="not finite at 1 ms"):
        reproduce(tmp_path / "out", CASES, overrides=SMALL, films=False)
    content = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert content["failed"] == ["paper/wedge-2.86"]
    assert [case["name"] for case in content["cases"]] == ["paper/rectangular-3.03"]
    assert (tmp_path / "out" / "wedge-2.86" / "history.csv").is_file()
    assert "not finite at 1 ms" in (tmp_path / "out" / "report.html").read_text()
