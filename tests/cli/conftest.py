"""The command line called within the tests' own process."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from typer.testing import CliRunner

from taichi_foam.cli import app
from taichi_foam.picture import raster


@pytest.fixture
def invoke(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable:
    """Call the command line in an empty current folder; gives exit_code, stdout and stderr."""
    monkeypatch.chdir(tmp_path)
    runner = CliRunner()
    return lambda *arguments: runner.invoke(app._app, list(arguments))


@pytest.fixture
def ask_undrawn(invoke: Callable, monkeypatch: pytest.MonkeyPatch) -> Callable:
    """Call the command line; any drawing fails the test."""

    def refuse(*arguments: object, **options: object) -> None:
        raise AssertionError("the request should have been refused before drawing")

    monkeypatch.setattr(raster, "draw", refuse)
    return invoke


@pytest.fixture
def press_after(monkeypatch: pytest.MonkeyPatch) -> Callable[[int], None]:
    """Press Ctrl-C at the drawing after so many more."""
    draw = raster.draw

    def press_after(count: int) -> None:
        left = count

        def press(*arguments: object, **options: object) -> None:
            nonlocal left
            left -= 1
            if left < 0:
                raise KeyboardInterrupt
            draw(*arguments, **options)

        monkeypatch.setattr(raster, "draw", press)

    return press_after
