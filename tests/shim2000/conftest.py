"""Two small studies for all tests, on coarse lattices: single runs, and an ensemble."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from lattices import COARSE, TINY

from taichi_foam.shim2000.reproduce import reproduce


@dataclass(frozen=True)
class Study:
    folder: Path
    content: dict[str, Any]


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
