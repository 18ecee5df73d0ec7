"""A design: the answer, its files, its verification by runs, and requests that are refused."""

from __future__ import annotations

import csv
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import designs
import pytest
from typer.testing import CliRunner

import taichi_foam as tf
from taichi_foam.cli import app
from taichi_foam.cushions import checks, sizing, verify
from taichi_foam.cushions.design import Design
from taichi_foam.cushions.shown import UNITS
from taichi_foam.cushions.sizing import Pad
from taichi_foam.cushions.verify import Runs
from taichi_foam.errors import UserError


@pytest.fixture
def invoke(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable:
    monkeypatch.chdir(tmp_path)
    runner = CliRunner()
    return lambda *arguments: runner.invoke(app._app, ["design", *arguments])


def pretended(pad: Pad, g: float) -> Runs:
    """Runs of a pad that all have one peak."""
    return Runs(pad, [3.86] * 4, [g] * 4, [g] * 4, [0.5] * 4, [4.5] * 4, [])


def test_the_runs_of_a_pad_hold_and_half_the_thickness_fails(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A product of the study in its short form.

    EPS has no rate in its curve: run and formula agree within 2 % left of the optimum.
    """
    seen: list[Runs] = []
    original = verify.runs

    def watched(*given: Any, **options: Any) -> Runs:
        seen.append(original(*given, **options))
        return seen[-1]

    monkeypatch.setattr(verify, "runs", watched)
    designs.smoke()
    *_, chosen, half = seen
    pad = chosen.pad
    assert chosen.below == 2
    assert chosen.raw == pytest.approx([pad.g] * 2, rel=0.02)
    assert chosen.strain == pytest.approx([pad.strain] * 2, rel=0.02)
    assert half.pad == replace(pad, thickness=pad.thickness / 2)
    assert half.below == 0


def test_the_files_say_what_the_answer_says(tmp_path: Path) -> None:
    found = tf.design(5.0, 40.0, foams=["eps-18.4", "eps-28.8"], runs=0, out=tmp_path / "out")
    names = {path.name for path in (tmp_path / "out").iterdir()}
    assert {"design.csv", "report.html", "cushion-curve.pdf", "thickness.svg"} <= names
    with (tmp_path / "out" / "design.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [float(row["thickness_m"]) for row in rows] == [p.thickness for p in found.candidates]
    assert [row["foam"] for row in rows] == found.table["foam"]
    page = (tmp_path / "out" / "report.html").read_text()
    for words in ("ISTA 1A", "ETHAFOAM", "CFC 180", "three-dimensional", "ASTM D6817"):
        assert words in page
    assert "60 mm thick" in found.answer


def test_a_pad_that_does_not_hold_is_followed_by_a_thicker_one(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    peaks = iter([41.0, 39.0])
    monkeypatch.setattr(verify, "runs", lambda pad, *_, **__: pretended(pad, next(peaks)))
    found = tf.design(5.0, 40.0, foams=["eps-18.4"])
    first, second = (runs.pad.thickness for runs in found.tried)
    assert second > first
    assert found.chosen is found.tried[1]
    assert len(found.table["foam"]) == 2


def test_ctrl_c_keeps_the_candidates_and_the_same_call_goes_on(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    def press(pad: Pad, *_: Any, checkpoint: Path, **__: Any) -> Runs:
        checkpoint.mkdir()
        raise KeyboardInterrupt

    wanted: dict[str, Any] = {"foams": ["eps-28.8"], "out": tmp_path / "out"}
    monkeypatch.setattr(verify, "runs", press)
    with pytest.raises(KeyboardInterrupt, match="the same command goes on"):
        tf.design(5.0, 40.0, **wanted)
    assert (tmp_path / "out" / "design.csv").is_file()
    seen = []

    def hold(pad: Pad, *_: Any, checkpoint: Path, **__: Any) -> Runs:
        seen.append(checkpoint.is_dir())
        return pretended(pad, 39.0)

    monkeypatch.setattr(verify, "runs", hold)
    assert tf.design(5.0, 40.0, **wanted).chosen is not None
    assert seen == [True]
    assert "4 of 4 runs" in (tmp_path / "out" / "report.html").read_text()


def test_a_drop_below_the_critical_velocity_change_needs_no_cushion() -> None:
    found = tf.design(5.0, 40.0, 0.3, dv_critical=5.0, runs=0)  # it changes by 4.85 m/s at most
    assert found.harmless
    assert "No cushion is needed" in found.answer
    assert not tf.design(5.0, 40.0, 0.33, dv_critical=5.0, runs=0).harmless


def test_checks_name_their_limits() -> None:
    pad = tf.design(5.0, 40.0, foams=["eps-18.4"], runs=0).candidates[0]

    def verdicts(pad: Pad, temperature: float | None = None) -> list[bool | None]:
        wish = pad.wish.with_computed(temperature=temperature)
        return [each.holds for each in checks.checks(replace(pad, wish=wish), UNITS["si"])]

    assert verdicts(pad) == [True, True, None]
    assert verdicts(pad, 25.0) == [True, True, True]
    assert verdicts(pad, 60.0) == [True, True, None]
    assert verdicts(pad, 80.0) == [True, True, False]
    tall = replace(pad, thickness=1.01 * pad.area**0.5 / sizing.SLENDER)
    heavy = replace(pad, area=pad.wish.weight / (1.01 * sizing.CREEP * pad.foam.plateau))
    assert verdicts(tall)[1] is False
    assert verdicts(heavy)[0] is False


def test_us_units_are_those_of_the_same_pad(invoke: Callable) -> None:
    done = invoke(
        "--mass", "11.0231", "--drop", "29.921", "--fragility", "40", "--foam", "eps-18.4",
        "--stock", "2.7559", "--runs", "0", "--units", "us",
    )  # fmt: skip
    assert done.exit_code == 0
    si = tf.design(5.0, 40.0, foams=["eps-18.4"], stock=[0.07], runs=0)
    assert f"{si.candidates[0].area / 0.0254**2:.3g} in²" in done.stdout
    assert "2.76 in thick" in done.stdout


def test_numbers_may_carry_their_unit(invoke: Callable) -> None:
    foam = ("--fragility", "40", "--foam", "eps-18.4", "--runs", "0")
    bare = invoke("--mass", "5", "--drop", "0.76", "--stock", "70", "--max-area", "600", *foam)
    given = invoke(
        "--mass", "5000g", "--drop", "76 cm", "--stock", "7cm", "--max-area", "0.06m2",
        "--overwrite", *foam,
    )  # fmt: skip
    assert (bare.exit_code, given.exit_code) == (0, 0)
    assert given.stdout == bare.stdout


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("--mass", "5", "--fragility", "0.5"), "at least 1 g"),
        (("--mass", "5", "--fragility", "nan"), "at least 1 g"),
        (("--mass", "5", "--fragility", "40", "--drop", "0"), "--drop 0: 0 must be above 0"),
        (("--mass", "-5", "--fragility", "40"), "--mass -5: -5 must be above 0"),
        (("--mass", "80", "--fragility", "40"), "ISTA 1A"),
        (("--mass", "5", "--fragility", "40", "--foam", "eps18"), "did you mean"),
        (("--mass", "5", "--fragility", "40", "--stock", "25,thick"), "'thick' is no number"),
        (("--mass", "5stone", "--fragility", "40"), "with a unit (kg, g, lb, oz)"),
        (("--mass", "5", "--fragility", "40", "--stock", "25,-5"), "must be above 0"),
        (("--mass", "5", "--fragility", "40", "--units", "metric"), "si or us"),
        (("--mass", "5", "--fragility", "40", "--shape", "corner"), "flat, edge, rib"),
        (("--mass", "5", "--fragility", "40", "--drops", "0"), "at least 1"),
        (("--mass", "5", "--fragility", "40", "--tests", "none.csv"), "none.csv"),
    ],
)
def test_bad_input_is_refused_with_a_remedy(
    invoke: Callable, arguments: tuple[str, ...], said: str, tmp_path: Path
) -> None:
    done = invoke(*arguments)
    assert done.exit_code == 2
    assert said in " ".join(done.stderr.split())
    assert list(tmp_path.iterdir()) == []


def test_nothing_that_fits_is_an_answer(invoke: Callable) -> None:
    done = invoke("--mass", "5", "--fragility", "40", "--max-thickness", "20", "--runs", "0")
    assert done.exit_code == 0
    text = " ".join(done.stdout.split())
    assert "Nothing fits" in text
    assert "a fragility of" in text
    assert "room for" in text


def test_a_number_of_runs_out_of_range_is_refused() -> None:
    with pytest.raises(UserError, match="runs = 1"):
        tf.design(5.0, 40.0, runs=1)


def test_the_object_draws_and_reports(tmp_path: Path) -> None:
    found: Design = tf.design(5.0, 40.0, foams=["eps-18.4"], runs=0)
    assert found.plot().axes[0].get_ylabel() == "peak deceleration (g)"
    assert found.report(tmp_path / "page.html").is_file()
