"""One scene a little at a time: as a whole run to the last bit, and what it tells on its way."""

import math

import numpy as np
import pytest
from bench import assert_same, assert_same_snapshots, small_scene
from test_same_numbers import impacts

from taichi_foam.analysis.columns import history_of
from taichi_foam.errors import RunError
from taichi_foam.records.ending import Ending
from taichi_foam.records.history import HISTORY_COLUMNS, row_columns
from taichi_foam.scene import FlatBlock, Numerics, Output
from taichi_foam.simulation.simulate import run
from taichi_foam.simulation.stepwise import Drop


@pytest.mark.parametrize("which", [0, 3])
def test_dribs_and_drabs_give_the_whole_run(which: int) -> None:
    """Pauses at odd times, calls of odd lengths, and looks in between; then again in one go."""
    scene = impacts()[which]
    whole = run(scene)
    with Drop(scene) as drop:
        until = 0.0
        for seconds in 100 * (0.0, 1e-6, 3e-4, 7e-3):
            until += 1.7e-5 + 0.5 * seconds
            drop.advance(seconds, until)
            drop.now()
        drop.advance(math.inf)
        assert drop.ended_by == whole.run["ended_by"] == "end time"
        assert_same(whole, drop.result())
        assert_same_snapshots(whole.snapshots[-1], drop.now())
        assert (drop.steps, drop.fraction, drop.failure) == (whole.run["steps"], 1.0, None)
    with Drop(scene) as drop:
        drop.advance(math.inf)
    assert_same(whole, drop.result())


def test_it_goes_on_to_the_time_asked_for_past_snapshots_and_full_rows() -> None:
    """Snapshots at every tenth of a millisecond, more rows than the device holds."""
    scene = small_scene(
        impactor=FlatBlock(width=0.03, mass=0.2, velocity=5.0),
        numerics=Numerics(end=5e-3),
        output=Output(history_interval=1e-5, snapshot_interval=1e-4),
    )
    with Drop(scene) as drop:
        drop.advance(math.inf, until=4.05e-3)
        assert not drop.ended
        assert drop.ended_by is None
        assert 4.05e-3 <= drop.time < 4.05e-3 + 2e-5
        assert 0.8 < drop.fraction < 0.9
        assert drop.wall > 0.0
        cut = drop.result()
        assert cut.run["interrupted"]
        assert cut.run["ended_by"] == Ending.INTERRUPTED
        assert len(cut.snapshots) == 41
        now = drop.now()
        assert now.time == drop.time
        rows = drop.rows()
        assert len(rows) > 256
        np.testing.assert_array_equal(drop.rows(since=123), rows[123:])
        assert drop.rows(since=len(rows)).shape == (0, len(row_columns(turns=False)))
        history = history_of(scene, rows)
    whole = run(scene)
    for name in HISTORY_COLUMNS:
        if name != "deceleration_smoothed_m_s2":  # which looks ahead
            np.testing.assert_array_equal(history[name], whole.history[name][: len(rows)])


def test_an_advance_takes_about_the_time_it_is_given() -> None:
    with Drop(small_scene(numerics=Numerics(end=10.0))) as drop:
        drop.advance(0.05)  # finds out how fast it goes
        before = drop.wall
        for _ in range(10):
            drop.advance(0.02)
        assert 0.1 < drop.wall - before < 0.6  # a busy machine takes longer


def test_history_of_nothing_is_empty() -> None:
    scene = small_scene(impactor=FlatBlock(width=0.03, mass=0.2, velocity=5.0))
    with Drop(scene) as drop:
        history = history_of(scene, drop.rows())
        assert set(history) == set(HISTORY_COLUMNS)
        assert all(column.shape == (0,) for column in history.values())
        with pytest.raises(ValueError, match="nothing has been computed"):
            drop.result()


def test_a_failure_is_told_as_a_run_tells_it() -> None:
    absurd = small_scene(
        name="absurd",
        impactor=FlatBlock(width=0.03, velocity=5.0),
        numerics=Numerics(dt=1e-4, end=0.05),
    )
    with pytest.raises(RunError) as failure:
        run(absurd)
    with Drop(absurd) as drop:
        drop.advance(math.inf)
        assert drop.ended
        assert drop.failure == str(failure.value)
        assert_same(failure.value.results[0], drop.result())


def test_a_closed_drop_gives_its_lattice_back_and_keeps_what_it_has() -> None:
    scene = impacts()[0]
    drop = Drop(scene)
    drop.advance(math.inf, until=1e-3)
    drop.close()
    drop.close()
    whole = run(scene)  # on the same lattice
    rows = drop.rows()
    np.testing.assert_array_equal(
        drop.result().history["velocity_m_s"], whole.history["velocity_m_s"][: len(rows)]
    )
    for use in (drop.now, lambda: drop.advance(1.0)):
        with pytest.raises(ValueError, match="closed"):
            use()
