"""Several impacts on each block of a sweep."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import taichi_foam as tf
from taichi_foam.scene import Block, FlatBlock, Output, Scene
from taichi_foam.sweeps import dealing
from taichi_foam.sweeps.plan import Plan
from taichi_foam.sweeps.sampling import Design

SCENE = Scene(
    name="pad",
    block=Block(width=0.02, height=0.05, depth=0.1, columns=4, rows=11),
    foam={"curve": {"strain": (0.0, 0.04, 0.5, 0.9), "stress": (0.0, 1e5, 1.4e5, 1e6)}},
    impactor=FlatBlock(width=0.04, mass=0.8, velocity=2.0),
    output=Output(film=False),
)


def test_impacts_in_a_row_are_those_of_run_drops(tmp_path: Path) -> None:
    """To the last bit, though each time all blocks are hit side by side."""
    masses = [0.6, 0.8, 1.0]
    axes = [
        {"key": "impactor.mass", "values": masses},
        {"key": "impactor.velocity", "values": [2.0, 2.0, 1.5]},
    ]
    plan = {"scene": SCENE, "axes": axes, "paired": True, "drops": 3}
    keep = {"histories": "float64", "measures": ["peak_deceleration_g", "contact_height_m"]}
    done = tf.sweep({**plan, "keep": keep}, tmp_path / "s", threads=2)
    table = pd.read_parquet(done.folder / "results.parquet")
    assert len(table) == 3
    assert "max_strain" not in table  # only the measures that the plan keeps
    alone = tf.run_drops(done.member(1).scene, 3)
    histories = done.histories(1)
    for drop, result in enumerate(alone, 1):
        head = "" if drop == 1 else f"drop_{drop}_"
        assert table[f"{head}peak_deceleration_g"][1] == result.summary["peak_deceleration_g"]
        history = histories[histories["drop"] == drop]
        np.testing.assert_array_equal(history["contact_force_N"], result.history["contact_force_N"])
    second, third = (float(table[f"drop_{n}_contact_height_m"][1]) for n in (2, 3))
    assert third < second < 0.05


def test_progress_and_cost_count_every_impact(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An interrupted sweep says so in the drops that its bar has counted."""
    plan = {"scene": SCENE, "axes": [{"key": "impactor.mass", "values": [0.6, 0.8]}], "drops": 3}
    assert dealing.room(Design.of(Plan.load(plan))).drops == 6

    def stop(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("taichi_foam.sweeps.run.compute", stop)
    with pytest.raises(KeyboardInterrupt, match="0 of 6 drops are in"):
        tf.sweep(plan, tmp_path / "s", threads=2)
