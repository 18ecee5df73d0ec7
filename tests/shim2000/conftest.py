"""Two small studies for all tests, on coarse lattices: single runs, and an ensemble."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from lattices import COARSE, TINY

from taichi_foam.shim2000.compare import COMPARED
from taichi_foam.shim2000.reproduce import reproduce


@dataclass(frozen=True)
class Study:
    folder: Path
    content: dict[str, Any]

    def rows(self, name: str) -> list[dict[str, str]]:
        """The rows of a table in its folder."""
        with (self.folder / name).open(newline="") as file:
            return list(csv.DictReader(file))

    @property
    def badges(self) -> int:
        """Those of a report: for misses, for criteria that are not met, and one that explains."""
        misses = sum(
            case["measured"][q.key] is not None and not abs(case["error"][q.key] or 1) <= 0.10
            for case in self.content["cases"]
            for q in COMPARED
        )
        return misses + sum(not each["holds"] for each in self.content["criteria"]) + 1


@pytest.fixture(scope="session")
def study(tmp_path_factory: pytest.TempPathFactory) -> Study:
    folder = tmp_path_factory.mktemp("study") / "out"
    content = reproduce(folder, ["paper/rectangular-3.03", "wedge-2.86"], overrides=COARSE)
    return Study(folder, content)


@pytest.fixture(scope="session")
def ensemble(tmp_path_factory: pytest.TempPathFactory) -> Study:
    folder = tmp_path_factory.mktemp("ensemble") / "out"
    content = reproduce(folder, ["rectangular-3.03"], ensemble=2, overrides=TINY)
    return Study(folder, content)
