"""Whoever sets measured figures, criteria or titles beside a run asks whether it is the test."""

from __future__ import annotations

import json
from pathlib import Path

from lattices import TINY
from tables_shown import printed

from taichi_foam import Result, Scene, load_scene
from taichi_foam.cli import tables
from taichi_foam.live.notebook import result_html
from taichi_foam.scene import Base, Wedge
from taichi_foam.shim2000 import impacts
from taichi_foam.shim2000.reproduce import reproduce
from taichi_foam.shim2000.study import Case

WEDGE, TITLE = "paper/wedge-2.86", "wedge, 2.86 m/s"
SHORT = (*TINY, "numerics.end=2e-3")


def changed() -> Scene:
    return load_scene(WEDGE, overrides=["impactor.mass=5"])


def written_by_hand() -> Scene:
    """The same test as somebody would write it, under a name of their own."""
    impactor = Wedge(velocity=2.86, angle_deg=90.0, shank_width=0.05)
    return Scene(name="my wedge", impactor=impactor, base=Base(stops_impactor=False))


def test_a_case_knows_whether_it_is_still_the_test(make_result) -> None:
    case = Case(changed(), make_result(scene=changed()))
    assert (case.name, case.test) == (WEDGE, None)
    case = Case(written_by_hand(), make_result(scene=written_by_hand()))
    assert case.test is impacts.TESTS[WEDGE]


def test_the_table_in_the_terminal(make_result, study) -> None:
    figures = study.content["cases"][1]["simulated"]
    assert "measured" in printed(tables.key_figures(load_scene(WEDGE), figures))
    own = printed(tables.key_figures(written_by_hand(), figures))
    assert "my wedge" in own
    assert " 7.50 " in own
    other = printed(tables.key_figures(changed(), figures))
    assert f"{WEDGE}, changed" in other
    assert "measured" not in other
    assert " 7.50 " not in other


def test_a_notebook(make_result) -> None:
    assert "measured" not in result_html(make_result(scene=changed()))
    assert "7.50" in result_html(make_result(scene=written_by_hand()))


def test_a_report_of_changed_tests_sets_nothing_measured_beside_them(
    tmp_path: Path, written: list
) -> None:
    content = reproduce(tmp_path / "out", ["wedge-2.86"], overrides=[*SHORT, "impactor.mass=5"])
    (case,) = content["cases"]
    assert case["test"] is None
    assert set(case["measured"].values()) == set(case["error"].values()) == {None}
    assert {hit["of"] for hit in content["within_tolerance"].values()} == {0}
    words = [text for _, text, _ in written]
    page = (tmp_path / "out" / "report.html").read_text()
    assert "Not the paper's tests" in page.replace("&#39;", "'")
    assert "Wedge 2.86, changed" in page
    assert "Medians within" not in page
    assert (tmp_path / "out" / "tables.csv").read_text().count("\n") == 1
    assert f"{WEDGE}, changed" in words  # the title of its film
    assert not any("Measured" in text or TITLE in text.lower() for text in words)
    shown = printed(tables.study(content))
    assert "wedge-2.86, changed" in shown
    assert "%" not in shown.partition("changed")[2].partition("\n")[0]


def test_an_ensemble_of_changed_tests_has_no_score(tmp_path: Path) -> None:
    settings = [*SHORT, "impactor.mass=5"]
    content = reproduce(
        tmp_path / "out", ["wedge-2.86"], ensemble=2, overrides=settings, films=False
    )
    assert content["ensemble"]["all"] == {"within": 0, "of": 0, "median_absolute_error": None}
    assert content["criteria"] == []
    assert json.loads((tmp_path / "out" / "summary.json").read_text())["cases"][0]["test"] is None
    assert not (tmp_path / "out" / "figures" / "errors.png").exists()
    printed(tables.study(content))
    printed(tables.scores(content))


def test_pictures_of_a_test_have_its_title(tmp_path: Path, written: list, study) -> None:
    """Those that are drawn again, too: the command line passes it on."""
    from typer.testing import CliRunner

    from taichi_foam.cli.app import _app

    folder = tmp_path / "run"
    Result.load(study.folder / "wedge-2.86").save(folder)
    size = ("--size", "640x360")
    assert CliRunner().invoke(_app, ["render", str(folder), "--png", *size]).exit_code == 0
    assert TITLE in {text for _, text, _ in written}
    written.clear()
    runs = [str(study.folder / "wedge-2.86"), str(study.folder / "rectangular-3.03")]
    out = ("--out", str(tmp_path / "both"))
    assert CliRunner().invoke(_app, ["compare", *runs, "--png", *size, *out]).exit_code == 0
    assert {TITLE, "flat block, 3.03 m/s"} <= {text for _, text, _ in written}
