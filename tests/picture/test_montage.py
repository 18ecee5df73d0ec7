"""Montages: which instants are shown, where, and how."""

from __future__ import annotations

import numpy as np
import pytest
from picture_states import dented, intact, scene_of

from taichi_foam import load_scene
from taichi_foam.errors import UserError
from taichi_foam.picture import colours
from taichi_foam.picture.montage import choose, montage
from taichi_foam.result import Snapshot
from taichi_foam.scene import Scene


@pytest.fixture
def scene() -> Scene:
    return scene_of(20, 10)


def run_of(scene: Scene, count: int = 21) -> list[Snapshot]:
    return [dented(scene, 0.002 * k, time=0.001 * k) for k in range(count)]


def long_runs(flags: np.ndarray, least: float) -> np.ndarray:
    """Starts of the runs of true flags that are at least so long."""
    steps = np.diff(np.r_[0, flags.astype(int), 0])
    starts, ends = np.flatnonzero(steps == 1), np.flatnonzero(steps == -1)
    return starts[ends - starts >= least]


def test_instants_are_the_snapshots_nearest_to_the_times(scene: Scene) -> None:
    chosen = choose(run_of(scene), times=[0.0, 0.0044, 0.0046, 0.5])
    assert [s.time for s in chosen] == pytest.approx([0.0, 0.004, 0.005, 0.020])


def test_instants_are_spread_from_first_to_last(scene: Scene) -> None:
    chosen = choose(run_of(scene), n=6)
    assert [s.time for s in chosen] == pytest.approx([0.0, 0.004, 0.008, 0.012, 0.016, 0.020])


@pytest.mark.parametrize(
    ("n", "grid"), [(1, (1, 1)), (3, (3, 1)), (6, (3, 2)), (7, (4, 2)), (8, (4, 2))]
)
def test_panels_stand_in_a_grid(scene: Scene, n: int, grid: tuple[int, int]) -> None:
    """The same state n times: each panel repeats the first, apart from nothing."""
    image = montage([intact(scene)] * n, scene, n=n, width=900)
    across, down = grid
    height, width = image.shape[:2]
    drawn = np.any(image != colours.THEMES["light"].page, axis=-1)
    # The panels are the only things as wide or as tall as this.
    columns = long_runs(drawn[height // 3], 0.15 * width)
    assert len(columns) == across
    rows = long_runs(drawn[:, columns[0]], 80)
    assert len(rows) == down
    span = width // across // 2
    first = image[rows[0] : rows[0] + 80, columns[0] : columns[0] + span]
    for k in range(1, n):
        top, left = rows[k // across], columns[k % across]
        panel = image[top : top + 80, left : left + span]
        # A grid line that falls on a sample to the last bit may go either way.
        assert np.mean(panel != first) < 0.005


def test_a_montage_has_an_even_size_and_the_width_asked_for(scene: Scene) -> None:
    for n in (2, 5, 8):
        image = montage(run_of(scene), scene, n=n, width=1000)
        assert image.shape[1:] == (1000, 3)
        assert image.shape[0] % 2 == 0


def test_a_montage_of_nothing_is_refused(scene: Scene) -> None:
    with pytest.raises(UserError, match="no snapshots"):
        montage([], scene)
    with pytest.raises(UserError, match="at least 1"):
        montage(run_of(scene), scene, n=0)
    with pytest.raises(UserError, match="at least one"):
        montage(run_of(scene), scene, times=[])


def test_a_test_of_the_paper_is_called_by_its_title() -> None:
    scene = load_scene("paper/wedge-2.86", overrides=["block.columns=20", "block.rows=10"])
    runs = run_of(scene_of(20, 10), 2)
    default, given, name = (
        montage(runs, scene, n=2, width=900, title=title)
        for title in (None, "wedge, 2.86 m/s", scene.name)
    )
    np.testing.assert_array_equal(default, given)
    assert np.any(default != name)
