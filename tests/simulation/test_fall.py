"""A fall, computed: what a drop height comes to at first contact."""

from __future__ import annotations

import pytest

from taichi_foam.catalogue import load_scene
from taichi_foam.simulation.simulate import run

COARSE = ["block.columns=20", "block.rows=10", "numerics.end=0.02"]


def test_an_impactor_meets_the_foam_with_the_velocity_of_its_fall() -> None:
    """v^2 = 2 g h. The velocity at contact is that of the last row before it, 0.1 ms at most."""
    fall = ["impactor.drop_height=0.6", "impactor.gap=0.02"]
    result = run(load_scene("paper/rectangular-3.03", overrides=[*COARSE, *fall]))
    row = result.scene.output.history_interval * 9.80665 / 3.43  # of the velocity, relative
    height = result.summary["equivalent_drop_height_m"]
    assert height == pytest.approx(0.6, rel=2 * row + 1e-9)
    assert result.summary["energy_residual"] < 1e-3
