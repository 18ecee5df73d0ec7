"""Many scenes at a time: order, room for the next, progress, Ctrl-C, failures."""

import numpy as np
import pytest
from bench import assert_same, small_scene
from test_same_numbers import impacts

from taichi_foam.errors import Interrupted, RunError
from taichi_foam.scene import Block, FlatBlock, Numerics, Output, Scene, Wedge
from taichi_foam.simulation import batches
from taichi_foam.simulation.simulate import Progress, run, run_many, simulate_many


@pytest.fixture
def two_at_a_time(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(batches, "MOST_LATTICES", {"cpu": 2, "gpu": 2})


def drops(*ends: float) -> list[Scene]:
    """Impacts that end at the given times [s], so that the order of their ends is known."""
    return [
        small_scene(
            name=f"drop {n}",
            impactor=FlatBlock(width=0.03, mass=0.2, velocity=5.0 + 0.1 * n),
            numerics=Numerics(end=end),
        )
        for n, end in enumerate(ends)
    ]


def other_counts() -> Scene:
    """A drop on a block of other lattice counts."""
    return Scene(
        name="other counts",
        block=Block(mass_points="cells", width=0.05, height=0.05, columns=10, rows=10),
        impactor=FlatBlock(width=0.03, mass=0.2, velocity=5.0),
        numerics=Numerics(end=1e-3),
    )


@pytest.mark.usefixtures("two_at_a_time")
def test_a_lattice_that_has_ended_makes_room_and_leaves_no_trace() -> None:
    """Seven impacts, two at a time where they share kernels: each as if it had been alone."""
    scenes = [*impacts(), *drops(1e-3, 3e-3), other_counts()]
    together = run_many(scenes)
    assert [result.run["batch"] for result in together] == [2, 1, 2, 1, 2, 2, 1]
    for scene, result in zip(scenes, together, strict=True):
        assert result.scene == scene
        assert_same(run(scene), result)


def test_a_higher_block_leaves_no_trace_in_a_lower_one() -> None:
    """They have the same fields. The lower one's top row is alone in its pack, where the higher one
    had cells that were sheared."""

    def indented(rows: int) -> Scene:
        block = Block(width=0.06, height=5e-3 * (rows - 1), columns=12, rows=rows)
        wedge = Wedge(angle_deg=90, mass=0.2, velocity=4.0)
        return small_scene(block=block, impactor=wedge, numerics=Numerics(end=4e-3))

    before = run(indented(21))
    run(indented(24))
    assert_same(before, run(indented(21)))


def test_some_of_many_end_before_others_begin(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of 40 scenes on one thread eight are on the device: Ctrl-C after a while finds results."""
    monkeypatch.setattr(batches.runtime, "settings", lambda: {"arch": "cpu", "threads": 1})
    assert batches._batch_size(40, 800) == 8
    monkeypatch.setattr(batches.runtime, "settings", lambda: {"arch": "cpu", "threads": 2})
    assert batches._batch_size(40, 800) == 16
    assert batches._batch_size(3, 800) == 4
    assert batches._batch_size(40, 100_000) == 2
    monkeypatch.setattr(batches.runtime, "settings", lambda: {"arch": "cpu", "threads": 64})
    assert batches._batch_size(1000, 800) == 64


@pytest.mark.usefixtures("two_at_a_time")
def test_results_come_as_they_end(monkeypatch: pytest.MonkeyPatch) -> None:
    """The second of two ends first; the third then has 2 ms, and ends before the first."""
    monkeypatch.setattr(batches, "CALL_SECONDS", 3e-4)
    places = [place for place, _ in simulate_many(drops(4e-3, 1e-3, 2e-3, 4e-3))]
    assert places == [1, 2, 0, 3]


@pytest.mark.usefixtures("two_at_a_time")
def test_progress_counts_up_to_all_of_them() -> None:
    seen: list[Progress] = []
    run_many([*drops(1e-3, 2e-3, 1e-3), other_counts()], seen.append)
    fractions = [each.fraction for each in seen]
    assert fractions == sorted(fractions)
    assert fractions[-1] == 1.0
    assert (seen[-1].finished, seen[-1].of) == (4, 4)
    assert all(each.steps > 0 for each in seen)


@pytest.mark.usefixtures("two_at_a_time")
def test_ctrl_c_keeps_what_has_ended_and_what_was_begun() -> None:
    scenes = drops(5e-4, 20e-3, 20e-3, 5e-4)

    def press(progress: Progress) -> None:
        if progress.finished == 1 and progress.fraction > 0.3:
            raise KeyboardInterrupt

    with pytest.raises(Interrupted) as interrupted:
        run_many(scenes, press)
    results = interrupted.value.results  # by place
    assert {place: result.scene.name for place, result in results.items()} == {
        0: "drop 0", 1: "drop 1", 2: "drop 2"
    }  # fmt: skip
    assert [results[place].run["interrupted"] for place in range(3)] == [False, True, True]
    whole = run(scenes[1])
    cut = results[1].history["displacement_m"]
    np.testing.assert_array_equal(cut, whole.history["displacement_m"][: len(cut)])


def test_a_generator_that_is_dropped_frees_its_lattices() -> None:
    scenes = drops(1e-3, 3e-3)
    results = simulate_many(scenes)
    next(results)
    results.close()
    for scene, result in zip(scenes, run_many(scenes), strict=True):
        assert_same(run(scene), result)


def test_one_failure_stops_no_other() -> None:
    """It is said once all have ended, with the results of all."""
    absurd = small_scene(
        name="absurd",
        impactor=FlatBlock(width=0.03, velocity=5.0),
        numerics=Numerics(dt=1e-4, end=0.05),
    )
    sound = drops(1e-3)[0]
    with pytest.raises(RunError, match="absurd") as failure:
        run_many([absurd, sound])
    assert failure.value.results[1].run["ended_by"] == "end time"
    assert_same(run(sound), failure.value.results[1])


def test_no_scenes_give_no_results() -> None:
    assert run_many([]) == []
    assert list(simulate_many([])) == []


def test_a_step_as_long_as_the_interval_of_snapshots_ends_too() -> None:
    """Rounding lets steps pass over an instant now and then."""
    scene = small_scene(
        numerics=Numerics(end=3e-5, dt=1e-6),
        output=Output(history_interval=1e-6, snapshot_interval=1e-6),
    )
    times = [snapshot.time for snapshot in run(scene).snapshots]
    assert times == sorted(set(times))
    assert len(times) >= 25
