"""Montages: which instants are shown, where, and how."""

from __future__ import annotations

import numpy as np
import pytest
from picture_states import dented, intact, scene_of

from taichi_foam.errors import UserError
from taichi_foam.picture.montage import choose, montage
from taichi_foam.result import Snapshot
from taichi_foam.scene import Scene


@pytest.fixture
def scene() -> Scene:
    return scene_of(20, 10)


def run_of(scene: Scene, count: int = 21) -> list[Snapshot]:
    return [dented(scene, 0.002 * k, time=0.001 * k) for k in range(count)]


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
    white = np.all(image == 255, axis=-1)
    columns = np.flatnonzero(np.diff(np.r_[0, white.any(axis=0), 0]) == 1)
    assert len(columns) == across
    rows = np.flatnonzero(
        np.diff(np.r_[0, white[:, columns[0] : columns[0] + 3].any(axis=1), 0]) == 1
    )
    assert len(rows) == down
    width = 900 // across // 2
    first = image[rows[0] : rows[0] + 80, columns[0] : columns[0] + width]
    for k in range(1, n):
        top, left = rows[k // across], columns[k % across]
        np.testing.assert_array_equal(image[top : top + 80, left : left + width], first)


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
