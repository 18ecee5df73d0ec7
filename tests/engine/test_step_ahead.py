"""The automatic step where stiffness jumps, motion is fast, or the impactor is light.

Without looking ahead the first two of these runs diverged, and of the light impactors' energy a
quarter to a half was unaccounted for.
"""

from __future__ import annotations

import numpy as np
import pytest

from taichi_foam.engine.model import MOST_WAY
from taichi_foam.scene import Scene
from taichi_foam.shim2000.impacts import paper_scene
from taichi_foam.simulation.simulate import run_many

SMALL = {
    "block.columns": 20, "block.rows": 10, "output.snapshot_interval": 1e-3,
    "output.history_interval": 1e-5, "numerics.end": 1e-3,
}  # fmt: skip

CASES = {
    "100 m/s": {"impactor.velocity": 100.0, "numerics.end": 2.5e-3},
    "300 m/s": {"impactor.velocity": 300.0},
    "1e-4 kg": {"impactor.mass": 1e-4},
    "1e-6 kg": {"impactor.mass": 1e-6},
    "1e-6 kg on springs": {"impactor.mass": 1e-6, "numerics.contact_damping": 0.0},
    "soft": {"foam.youngs_modulus": 1e3, "foam.shear_modulus": 1e3, "numerics.end": 5e-3},
}


@pytest.fixture(scope="module")
def runs(taichi_runtime) -> dict:
    """All cases in one batch of one kernel."""
    results = run_many([scene_of(name) for name in CASES])
    return dict(zip(CASES, results, strict=True))


def scene_of(name: str) -> Scene:
    return paper_scene("paper/rectangular-3.03").with_values(SMALL | CASES[name])


@pytest.mark.filterwarnings("ignore::taichi_foam.errors.RunWarning")
@pytest.mark.parametrize("name", CASES)
def test_the_ledger_closes(runs: dict, name: str) -> None:
    assert abs(runs[name].summary["energy_residual"]) < 1e-2
    assert all(np.isfinite(column).all() for column in runs[name].history.values())


def test_nothing_moves_by_more_than_half_the_skin_in_a_step(runs: dict) -> None:
    """Before anything moves faster than the impactor, its speed decides; it loses a little."""
    result = runs["300 m/s"]
    cell = min(result.scene.block.dx, result.scene.block.dy)
    assert result.history["dt_s"][0] == pytest.approx(MOST_WAY * cell / 300.0)
    assert result.run["dt_max_s"] <= 1.03 * MOST_WAY * cell / 300.0


def test_a_light_impactor_bounces_off_as_it_came(runs: dict) -> None:
    """A milligram cannot crush anything: the contact is all there is.

    It swings on the springs of four points on the block's top, half cells of 20 K Z each, for half
    a period, and hardly moves the points, of 73 mg. The overlap is that of the stages, which look
    ahead a little too far.
    """
    result = runs["1e-6 kg on springs"]
    scene = result.scene
    stiffness = 2 * scene.numerics.contact_stiffness * scene.foam.youngs_modulus * 0.057
    swing = np.sqrt(stiffness / scene.impactor.mass)
    assert result.summary["rebound_velocity_m_s"] == pytest.approx(3.03, rel=0.01)
    assert result.run["max_overlap_m"] == pytest.approx(3.03 / swing, rel=0.03)
    assert result.run["dt_max_s"] * swing < 0.6


def test_foam_that_densifies_within_a_step_shortens_it_before(runs: dict) -> None:
    result = runs["100 m/s"]
    assert result.run["dt_min_s"] < 0.1 * result.history["dt_s"][0]
    assert result.run["dt_min_s"] < 0.9 * result.run["dt_stable_min_s"]


def test_alone_and_in_a_batch_the_steps_are_the_same(runs: dict) -> None:
    alone = run_many([scene_of("100 m/s")])[0]
    for name, column in runs["100 m/s"].history.items():
        np.testing.assert_array_equal(alone.history[name], column, err_msg=name)
