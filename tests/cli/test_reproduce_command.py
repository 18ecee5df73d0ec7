"""`reproduce` from the outside; what it computes and prints is tested in tests/shim2000."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from taichi_foam.errors import UserError
from taichi_foam.shim2000 import reproduce as study


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
