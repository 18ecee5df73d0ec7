"""Drops on a block that another drop has left."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import shapely
from bench import assert_same_run, interrupt_at, small_scene

import taichi_foam as tf
from taichi_foam.analysis.impact import height_beneath
from taichi_foam.engine import transfer
from taichi_foam.engine.features import features_of
from taichi_foam.engine.lattice import borrowed
from taichi_foam.engine.state import state_after
from taichi_foam.errors import UserError
from taichi_foam.records.ending import Ending
from taichi_foam.results.result import Result
from taichi_foam.scene import (
    Base,
    Cylinder,
    FlatBlock,
    Foam,
    Impactor,
    IShape,
    Model,
    Numerics,
    Output,
    Wedge,
)
from taichi_foam.simulation.simulate import resume, run, run_drops

SAVED = Output(history_interval=5e-5, snapshot_interval=1e-3, film=False)
# a wedge that breaks and crushes a small block, whose pieces touch, on a floor with friction
BREAKING = small_scene(
    name="breaking",
    impactor=Wedge(
        angle_deg=80, shank_width=0.02, mass=0.1, velocity=16.0, friction=0.22, gap=0.001
    ),
    base=Base(kind="floor"),
    foam=Foam(densification_b=2.0),  # as in other tests, whose kernels these are
    model=Model(shear_failure="always"),
    numerics=Numerics(end=1.45e-3),
    output=SAVED,
)
# a plate that crushes it evenly, and comes up again
CUSHION = small_scene(
    name="cushion",
    impactor=FlatBlock(width=0.08, mass=0.5, drop_height=0.35, friction=0.0),
    numerics=Numerics(),
    output=SAVED,
)


@pytest.fixture(scope="module")
def broken() -> Result:
    return run(BREAKING)


@pytest.fixture(scope="module")
def again(broken: Result) -> Result:
    return run(BREAKING, after=broken)


@pytest.fixture(scope="module")
def drops() -> list[Result]:
    return run_drops(CUSHION, 3)


def test_a_run_starts_as_the_one_before_has_ended(broken: Result, again: Result) -> None:
    last, first = broken.snapshots[-1], again.snapshots[0]
    assert last.broken_a.sum() + last.broken_b.sum() > 20
    for name in ("position", "velocity", "e_min_a", "e_min_b", "broken_a", "broken_b"):
        np.testing.assert_array_equal(getattr(last, name), getattr(first, name), err_msg=name)
    assert first.time == 0.0
    assert again.history["broken_bonds"][0] == broken.history["broken_bonds"][-1]
    assert again.run["after"]["state_sha256"] == broken.cushion.sha256


def test_all_of_the_block_comes_to_the_device_and_back(broken: Result) -> None:
    """What snapshots do not show too: springs of the floor, room, hold, surfaces, intact shares."""
    block, cushion = BREAKING.block, broken.cushion
    assert np.ptp(cushion.floor_stretch) > 0
    assert cushion.hold.min() < 1
    assert cushion.surface.max() > 0
    assert cushion.room.min() < 1
    assert cushion.intact_b.min() < 1
    with borrowed(1, block.columns, block.rows, features_of(BREAKING)) as lattice:
        transfer.load(lattice, 0, BREAKING, state_after(BREAKING, cushion))
        found = transfer.take(lattice, 0).cushion()
        transfer.unload(lattice, 0)
    for name, values in cushion.to_arrays().items():
        np.testing.assert_array_equal(values, found.to_arrays()[name], err_msg=name)
    assert found.sha256 == cushion.sha256


def test_the_impactor_starts_its_gap_above_the_block_as_it_lies(again: Result) -> None:
    """It touches nothing at its height, and does a little below."""
    start, wedge = again.snapshots[0], BREAKING.impactor
    at_touch = again.contact_height
    assert start.impactor_y == at_touch + wedge.gap
    assert at_touch < BREAKING.contact_height
    x = start.position[..., 0] - wedge.x
    lower = np.abs(x) / np.tan(np.radians(0.5 * wedge.angle_deg))
    clearance = (start.position[..., 1] - at_touch - lower)[np.abs(x) < 0.01]
    assert clearance.max() == pytest.approx(0.0, abs=1e-12)
    assert again.history["displacement_m"][0] == 0.0


def test_height_beneath_a_plate_is_that_of_the_highest_point() -> None:
    position = np.array([[[-0.02, 0.5], [0.0, 0.3]], [[0.004, 0.4], [0.02, 0.9]]])
    there, none = np.ones((2, 2), dtype=bool), np.zeros((2, 2))
    assert height_beneath(position, FlatBlock(width=0.02), none, there) == 0.4
    there[1, 0] = False
    assert height_beneath(position, FlatBlock(width=0.02), none, there) == 0.3
    with pytest.raises(ValueError, match="beneath"):
        height_beneath(position, FlatBlock(width=0.02, x=1.0), none, there)


@pytest.mark.parametrize(
    "impactor",
    [
        FlatBlock(width=0.02),
        FlatBlock(width=0.02, rotation_deg=30.0),
        Wedge(angle_deg=60, shank_width=0.03),
        Cylinder(radius=0.02),
        IShape(width=0.05, height=0.05, flange=0.01, web=0.01),
    ],
    ids=lambda impactor: impactor.shape,
)
def test_height_beneath_an_impactor_that_touches_the_foam_around_a_point(
    impactor: Impactor,
) -> None:
    """Foam reaches 3 mm around a point: at this height the outline is 3 mm away from it."""
    there, reach = np.ones((1, 1), dtype=bool), np.full((1, 1), 0.003)
    for x in (-0.009, 0.001, 0.011, 0.012):
        point = np.array([[[x, 0.1]]])
        height = height_beneath(point, impactor, reach, there)
        outline = shapely.Polygon(impactor.outline_at(height))
        assert outline.distance(shapely.Point(*point[0, 0])) == pytest.approx(0.003, rel=1e-9)
    point = np.array([[[0.001, 0.1]]])  # and where it ends 3 mm before the point, or sooner
    outline = shapely.Polygon(impactor.outline_at(height_beneath(point, impactor, -reach, there)))
    assert outline.covers(shapely.Point(*point[0, 0]))
    assert outline.exterior.distance(shapely.Point(*point[0, 0])) <= 0.003 + 1e-12


def test_the_ledger_of_a_later_drop_closes(broken: Result, drops: list[Result]) -> None:
    """It counts from its own first row. What breaks and slides costs the step's accuracy."""
    fine = run(BREAKING.with_values(numerics__safety=0.2), after=broken)
    for result, limit in ((fine, 1e-4), (drops[-1], 1e-4)):
        assert abs(result.summary["energy_residual"]) < limit
        assert result.history["base_J"][0] == result.history["friction_J"][0] == 0.0
        assert not result.warnings


def test_crushed_foam_stops_a_later_drop_harder(drops: list[Result]) -> None:
    peaks = [result.summary["peak_deceleration_cfc180_g"] for result in drops]
    assert peaks[0] < peaks[1] < peaks[2]
    heights = [result.summary["rest_height_m"] for result in drops]
    assert heights[0] > heights[1] > heights[2]
    assert [result.summary["drop"] for result in drops] == [1, 2, 3]
    for before, after in pairwise(drops):
        assert after.contact_height == before.summary["rest_height_m"]
        assert after.summary["max_strain"] > before.summary["max_strain"]
    first = drops[0].summary  # strain: of the thickness between first and last row
    thickness = CUSHION.block.height - CUSHION.block.dy
    assert first["max_strain"] == pytest.approx(first["max_displacement_m"] / thickness)


def test_a_series_is_run_after_run(drops: list[Result], tmp_path: Path) -> None:
    drops[0].save(tmp_path / "first")
    assert_same_run(run(CUSHION, after=tmp_path / "first"), drops[1])
    stored = tf.load(tmp_path / "first")
    assert stored.cushion.sha256 == drops[0].cushion.sha256
    assert_same_run(run(CUSHION, after=stored), drops[1])


def test_an_interrupted_run_after_another_goes_on(
    broken: Result, again: Result, tmp_path: Path
) -> None:
    cut = run(BREAKING, interrupt_at(0.4), after=broken, checkpoint=tmp_path)
    assert cut.ending is Ending.INTERRUPTED
    assert cut.cushion is None
    with pytest.raises(UserError, match="unfinished work of another command, with after = "):
        run(BREAKING, checkpoint=tmp_path)
    with pytest.raises(UserError, match="left no block"):
        run(BREAKING, after=cut)
    assert_same_run(resume(tmp_path), again)


def test_an_interrupted_series_goes_on_where_it_stopped(
    drops: list[Result], tmp_path: Path
) -> None:
    cut = run_drops(CUSHION, 3, interrupt_at(0.5), checkpoint=tmp_path)
    assert [result.ending for result in cut] == [Ending.REBOUND, Ending.INTERRUPTED]
    steps: dict[int, int] = {}
    found = run_drops(
        CUSHION, 3, lambda p: steps.update({p.finished: p.steps}), checkpoint=tmp_path
    )
    assert steps[0] == 0  # the first drop is not computed again
    assert 0 < steps[1] < drops[1].run["steps"]
    assert steps[2] == steps[1] + drops[2].run["steps"]
    for one, other in zip(found, drops, strict=True):
        assert_same_run(one, other)


def test_without_an_impactor_the_block_settles(broken: Result) -> None:
    quiet = run(BREAKING.with_values(impactor=None, numerics__end=2e-3), after=broken)
    np.testing.assert_array_equal(quiet.snapshots[0].position, broken.snapshots[-1].position)
    energy = quiet.history["foam_kinetic_J"] + quiet.history["strain_J"]
    assert energy[-1] < energy[0]
    assert abs(quiet.summary["energy_residual"]) < 1e-3
    assert quiet.drop == 2


def test_what_cannot_follow_is_refused(broken: Result, tmp_path: Path) -> None:
    other = BREAKING.with_values({"block.density": 30.0, "base.kind": "held"})
    with pytest.raises(UserError, match=r"block.density = 25.6 instead of 30.0.*base.kind"):
        run(other, after=broken)
    lighter = BREAKING.with_values({"impactor.mass": 0.01, "numerics.end": 1e-4})
    assert run(lighter, after=broken).run["after"]["drop"] == 2
    with pytest.raises(UserError, match="there is no such folder"):
        run(BREAKING, after=tmp_path / "nowhere")
    for count in (0, 1001):
        with pytest.raises(UserError, match="at least 1 and at most 1000"):
            run_drops(CUSHION, count)
