"""The commands of docs/design.md that need no run print what the page says."""

from __future__ import annotations

import re
import shlex
import shutil
from itertools import pairwise
from pathlib import Path

import pytest
from typer.testing import CliRunner

from taichi_foam.cli import app

ROOT = Path(__file__).parents[2]


def plain(text: str) -> str:
    """Words apart from their line breaks and rulers."""
    return " ".join(text.split())


def test_the_page_shows_what_its_commands_print(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "96")
    shutil.copy(ROOT / "scenes" / "own_foam.csv", tmp_path)
    page = (ROOT / "docs" / "design.md").read_text(encoding="utf-8")
    blocks = re.findall(r"^```(\w*)\n(.*?)^```", page, re.MULTILINE | re.DOTALL)
    shown = {
        command.strip(): after if kind == "" else None
        for (language, command), (kind, after) in pairwise(blocks)
        if language == "sh"
    }
    compared = 0
    for command, output in shown.items():
        if not re.search(r"foam import|efficiency|--runs 0", command):
            continue
        done = CliRunner().invoke(app._app, shlex.split(command)[1:])
        assert done.exit_code == 0, done.stderr
        if output is not None:
            assert plain(output) in plain(done.stdout)
            compared += 1
    assert compared == 2
