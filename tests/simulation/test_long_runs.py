"""A run of a very great number of steps says so when it begins, and a command prints it."""

from __future__ import annotations

import io

import pytest
from rich.console import Console

from taichi_foam.cli.outcome import exit_codes
from taichi_foam.errors import LongRunWarning
from taichi_foam.scene import Block, FlatBlock, Numerics, Scene
from taichi_foam.simulation import batches
from taichi_foam.simulation.simulate import run

SCENE = Scene(
    name="long", block=Block(columns=10, rows=5), impactor=FlatBlock(), numerics=Numerics(end=2e-4)
)


def test_steps_ahead_are_counted_at_the_shortest() -> None:
    begun = batches.Run(SCENE, 0, batches.Wall(), 1, report={"shortest": 1e-14})
    assert begun.length is not None
    assert begun.length.startswith("long: needs up to 2e+10 steps of 1e-14 s")
    begun.report["shortest"] = 1e-12
    assert begun.length is None


@pytest.mark.usefixtures("taichi_runtime")
def test_it_is_told_once_and_in_a_command_as_a_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(batches, "MANY_STEPS", 1.0)
    with pytest.warns(LongRunWarning, match="needs up to") as caught:
        run(SCENE)
    assert len(caught) == 1
    assert caught[0].filename == __file__
    console = Console(file=io.StringIO(), width=80)
    with exit_codes(console):
        run(SCENE)
    assert console.file.getvalue().startswith("warning: long: needs up to")
    assert console.file.getvalue().count("warning") == 1
