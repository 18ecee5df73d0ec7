"""One small study for all tests: two tests of the paper on a coarse lattice."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from taichi_foam.study.reproduce import reproduce

COARSE = ("block.columns=20", "block.rows=10", "output.width=320", "output.height=180")


@dataclass(frozen=True)
class Study:
    folder: Path
    content: dict[str, Any]


@pytest.fixture(scope="session")
def study(tmp_path_factory: pytest.TempPathFactory) -> Study:
    folder = tmp_path_factory.mktemp("study") / "out"
    content = reproduce(folder, ["paper/rectangular-3.03", "wedge-2.86"], overrides=COARSE)
    return Study(folder, content)
