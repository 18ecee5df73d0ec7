"""`reproduce` from the outside; what it computes is tested in tests/study."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from taichi_foam import Scene, load_scene
from taichi_foam.errors import UserError
from taichi_foam.shim2000 import reproduce as study

SHORT = ["block.columns=16", "block.rows=8", "numerics.time_limit=0.06"]


def test_options_reach_the_study(invoke: Callable, monkeypatch: pytest.MonkeyPatch) -> None:
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


def test_an_ensemble_shows_medians_bands_and_scores(
    invoke: Callable, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def small(name: str, choices: str) -> Scene:
        return load_scene(name, choices, [*SHORT, "impactor.friction=0.6"])  # it comes to rest

    monkeypatch.setattr(study, "paper_scene", small)
    asked = ["--ensemble", "2", "--cases", "wedge-2.10", "--out", "two", "--no-films"]
    result = invoke("reproduce", *asked)
    assert result.exit_code == 0, result.output
    (case,) = json.loads((tmp_path / "two" / "summary.json").read_text())["cases"]
    lines = result.stdout.splitlines()
    assert max(map(len, lines)) <= 80
    assert lines[0].startswith("median of 2 runs, and its error (calibrated)")
    row = next(line for line in lines if line.startswith("wedge-2.10"))
    assert f"{100 * case['simulated']['max_displacement_m']:.2f}" in row
    band = next(line for line in lines if line.startswith("  5 to 95 %"))
    assert f"{100 * case['low']['max_displacement_m']:.2f} to" in band
    assert next(line for line in lines if line.startswith("  measured")).split()[1] == "4.60"
    assert any(line.startswith("fitted") for line in lines)
    assert "in two: report.html" in lines[-1]
