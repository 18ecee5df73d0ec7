"""Montages: which instants are shown, where, and how."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from picture_states import alone, dented, intact, scene_of

from taichi_foam import load_scene
from taichi_foam.errors import UserError
from taichi_foam.picture import annotate
from taichi_foam.picture.comparison import Lineup, instants
from taichi_foam.picture.look import THEMES
from taichi_foam.picture.montage import choose, montage
from taichi_foam.records.snapshot import Snapshot
from taichi_foam.scene import Block, FlatBlock, Output, Scene


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
    drawn = np.any(image != THEMES["light"].page, axis=-1)
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


def test_a_montage_is_called_by_its_scene_or_by_the_title_given() -> None:
    scene = load_scene("paper/wedge-2.86", overrides=["block.columns=20", "block.rows=10"])
    runs = run_of(scene_of(20, 10), 2)
    default, given, name = (
        montage(runs, scene, n=2, width=900, title=title)
        for title in (None, "wedge, 2.86 m/s", scene.name)
    )
    np.testing.assert_array_equal(default, name)
    assert np.any(default != given)


CORNERED = {
    "no impactor": alone(20, 10),
    "a platen": scene_of(20, 10, impactor=FlatBlock(width=0.3, height=0.2)),
    "a tall block": Scene(
        block=Block(width=0.05, height=0.5, columns=10, rows=100), impactor=FlatBlock(width=0.2)
    ),
    "the paper's": scene_of(20, 10),
}


@pytest.mark.parametrize("kind", CORNERED)
def test_times_stand_on_the_empty_field(kind: str, monkeypatch, make_result) -> None:
    scene = CORNERED[kind]
    grounds = []
    write = annotate.write

    def look_under(image, xy, string, face, **options) -> None:
        if string.endswith(" ms"):
            left, top, right, bottom = (int(v) for v in face.getbbox(string, anchor="ls"))
            x, y = round(xy[0]), round(xy[1])
            grounds.append(image[y + top : y + bottom + 1, x + left : x + right + 1].copy())
        write(image, xy, string, face, **options)

    monkeypatch.setattr(annotate, "write", look_under)
    run = [replace(intact(scene), time=1e-3 * k) for k in range(3)]
    montage(run, scene, n=3, width=900)
    instants(Lineup.of([make_result(scene, snapshots=run)] * 2), n=3, width=900)
    assert len(grounds) == 3 + 2 * 3
    for ground in grounds:
        assert np.all(ground == THEMES["light"].field)


def test_foam_in_the_corner_of_one_instant_makes_room_in_all() -> None:
    """A fragment that flies past; beyond the panel it is in nobody's way."""
    scene = scene_of(20, 10)
    heights = []
    for place in ((0.0, 0.05), (-0.11, 0.135), (-0.11, 0.5)):
        flown = replace(intact(scene), time=1e-3)
        flown.position[0, -1] = place
        heights.append(montage([intact(scene), flown], scene, n=2, width=900).shape[0])
    assert heights[0] == heights[2] < heights[1]


def test_instants_of_a_fine_run_read_differently(written: list) -> None:
    scene = scene_of(20, 10, output=Output(history_interval=1e-5, snapshot_interval=2.5e-5))
    montage([dented(scene, time=2.5e-5 * k) for k in range(4)], scene, n=4)
    times = [text for _, text, _ in written if text.endswith(" ms")]
    assert times == ["0.000 ms", "0.025 ms", "0.050 ms", "0.075 ms"]
