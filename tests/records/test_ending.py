"""How runs end: words that are stored, and what they mean."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from taichi_foam.engine import state
from taichi_foam.errors import UserError
from taichi_foam.records.ending import Ending
from taichi_foam.results.manifest import Manifest
from taichi_foam.results.result import Result
from taichi_foam.simulation.batches import ENDINGS

DOCS = Path(__file__).parents[2] / "docs" / "results.md"


def test_an_ending_is_its_word() -> None:
    assert Ending.REBOUND == "rebound"
    assert Ending("end time") is Ending.END_TIME
    assert f"{Ending.DIVERGED}" == str(Ending.DIVERGED) == "diverged"
    assert json.dumps({"ended_by": Ending.DIVERGED}) == '{"ended_by": "diverged"}'


def test_what_failed_has_a_remedy() -> None:
    failed = {ending for ending in Ending if ending.failed}
    assert failed == {Ending.DIVERGED, Ending.CROWDED}
    assert all(bool(ending.remedy) == ending.failed for ending in Ending)


def test_every_status_of_the_engine_is_an_ending() -> None:
    assert ENDINGS[state.RUNNING] is Ending.INTERRUPTED
    assert set(ENDINGS.values()) == set(Ending)


def test_a_result_knows_its_ending_and_keeps_it(make_result, tmp_path: Path) -> None:
    result = make_result(run={"ended_by": Ending.REBOUND, "interrupted": False})
    assert result.ending is Ending.REBOUND
    result.save(tmp_path / "run")
    stored = json.loads((tmp_path / "run" / "summary.json").read_text())["run"]
    assert stored["ended_by"] == "rebound"
    assert Result.load(tmp_path / "run").ending is Ending.REBOUND
    assert make_result().ending is None


def test_an_ending_that_nobody_knows_is_refused(make_result, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="old age"):
        make_result(run={"ended_by": "old age"})
    make_result(run={"ended_by": Ending.REBOUND}).save(tmp_path / "run")
    file = tmp_path / "run" / "summary.json"
    file.write_text(file.read_text().replace('"rebound"', '"old age"'))
    Manifest.of(tmp_path / "run").write(tmp_path / "run")
    with pytest.raises(UserError, match="not a complete result"):
        Result.load(tmp_path / "run")


def test_the_docs_have_every_ending() -> None:
    text = DOCS.read_text(encoding="utf-8")
    for ending in Ending:
        assert f"| `{ending.name}` | {ending.value} | {ending.meaning} |" in text
