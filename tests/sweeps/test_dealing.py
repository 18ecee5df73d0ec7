"""Chunks: how long they take, and that nothing of the numbers hangs on where they end."""

from __future__ import annotations

from pathlib import Path

import pytest
import sweeps
from drops import Solver, axis, ending, plan_of

import taichi_foam as tf
from taichi_foam.errors import RunError
from taichi_foam.sweeps import dealing, store
from taichi_foam.sweeps.dealing import Dealer
from taichi_foam.sweeps.plan import Plan, work
from taichi_foam.sweeps.run import Sweep
from taichi_foam.sweeps.sampling import Design
from taichi_foam.sweeps.table import seconds_of

PLAN = plan_of(axis(count=48), chunk=None, keep={"histories": "float64"})


def dealt(plan: dict, pace: float, **more: int) -> list[tuple[range, float]]:
    """All chunks of a sweep, with how long each takes on a machine of that pace [s/node step]."""
    design = Design(Plan.load(plan))
    dealer = Dealer(design, [range(len(design))], **more)
    found = []
    while (chunk := dealer.next()) is not None:
        ends = {work(design.member(number).scene) for number in (chunk[0], chunk[-1])}
        if len(ends) == 1:  # all between have this lattice, too
            seconds = pace * len(chunk) * ends.pop()
        else:
            seconds = pace * sum(work(design.member(number).scene) for number in chunk)
        dealer.learn(chunk, seconds)
        found.append((chunk, seconds))
    return found


@pytest.mark.parametrize("machine", [0.25, 4.0])
@pytest.mark.parametrize(("rows", "count"), [(10, 500), (40, 60)])
def test_no_chunk_of_several_drops_takes_more_than_half_a_minute(
    machine: float, rows: int, count: int
) -> None:
    """On machines a quarter to four times as fast as the first guess takes for granted."""
    plan = plan_of(
        axis(count=count), chunk=None, set={"block.rows": rows, "block.columns": 2 * rows}
    )
    found = dealt(plan, 7.5e-8 / machine)
    assert [number for chunk, _ in found for number in chunk] == list(range(count))
    assert all(seconds <= 30.0 or len(chunk) == 1 for chunk, seconds in found)
    longest = max(seconds for _, seconds in found)
    assert longest > 5.0 or len(found[-1][0]) >= dealing.MOST // 2  # and no crumbs
    # few sizes of batches: kernels are compiled for each power of two
    assert len({(len(chunk) - 1).bit_length() for chunk, _ in found[:-1]}) <= 4


def test_lattices_of_more_nodes_come_in_smaller_chunks() -> None:
    rows = {"key": "block.rows", "values": [5, 80]}
    found = dealt(plan_of(axis(count=100), rows, chunk=None, set={"block.columns": 40}), 7.5e-8)
    small = [chunk for chunk, _ in found if chunk.stop <= 100]
    large = [chunk for chunk, _ in found if chunk.start >= 100]
    assert max(map(len, large)) < max(map(len, small))
    assert all(seconds <= 30.0 or len(chunk) == 1 for chunk, seconds in found)


def test_every_worker_has_something_to_do_and_none_more_than_the_plan_says() -> None:
    assert len(dealt(PLAN, 1e-12, workers=4)[0][0]) <= 12
    assert max(len(chunk) for chunk, _ in dealt({**PLAN, "chunk": 5}, 1e-12)) == 5
    # of drops that last long each thread has one
    assert {len(chunk) for chunk, _ in dealt(PLAN, 1e-3, side_by_side=6)[1:]} == {6}


def test_a_small_sweep_that_is_ended_early_has_what_was_done(tmp_path: Path) -> None:
    """48 drops of 4 s each: three quarters of them are there after 160 s."""
    with pytest.raises(KeyboardInterrupt):
        tf.sweep(PLAN, tmp_path / "s", solve=Solver(before=ending(40), seconds=4.0))
    half = Sweep.open(tmp_path / "s")
    assert 40 - 30 / 4 <= half.standing.done <= 40
    chunks = half.finished()
    assert seconds_of(half.chunk_file(chunks[0])) == pytest.approx(4.0 * len(chunks[0]), 0.1)


def test_a_sweep_goes_on_in_chunks_of_any_size(tmp_path: Path) -> None:
    with pytest.raises(KeyboardInterrupt):
        tf.sweep({**PLAN, "chunk": 5}, tmp_path / "s", solve=Solver(before=ending(17)))
    before = sweeps.chunk_files(tmp_path / "s")
    done = Sweep.open(tmp_path / "s").standing.done
    assert 12 <= done <= 17
    rest = Solver()
    tf.sweep({**PLAN, "chunk": 7}, tmp_path / "s", solve=rest)
    assert len(rest.asked) == 48 - done
    after = sweeps.chunk_files(tmp_path / "s")
    assert {name: after[name] for name in before} == before
    tf.sweep({**PLAN, "chunk": 5}, tmp_path / "t", solve=Solver())
    assert sweeps.compare(tmp_path / "t", tmp_path / "s") == []


def test_chunks_that_overlap_give_each_row_once(tmp_path: Path) -> None:
    """A worker of a cluster has completed a chunk after its client, while another one began."""
    swept = tf.sweep({**PLAN, "chunk": 8}, tmp_path / "s", solve=Solver())
    other = tf.sweep({**PLAN, "chunk": 5}, tmp_path / "t", solve=Solver())
    for name in (store.CHUNKS, store.HISTORIES):
        for path in (other.folder / name).iterdir():
            path.rename(swept.folder / name / path.name)
    (swept.folder / "results.parquet").unlink()
    found = tf.sweep({**PLAN, "chunk": 8}, swept.folder, solve=Solver())
    assert found.to_pandas()["member"].tolist() == list(range(48))
    assert found.standing.done == 48
    assert len(found.histories(6)) == 3


def test_what_was_lost_is_forgotten_when_chunks_of_another_size_have_it(tmp_path: Path) -> None:
    with pytest.raises(RunError):
        tf.sweep(
            {**PLAN, "chunk": 2}, tmp_path / "s", solve=Solver(before=ending(3, MemoryError()))
        )
    half = Sweep.open(tmp_path / "s")
    assert {range(2, 4)} <= half.lost().keys()
    # one of the two is there now, of the other it is still said
    half.chunk_file(range(0, 2)).rename(half.chunk_file(range(2, 3)))
    assert {range(3, 4)} <= half.lost().keys()
    half.chunk_file(range(2, 3)).unlink()
    # lost again in a larger chunk: each drop is told once
    half.lose(range(2, 5), "killed")
    told = [number for row in half.lost() for number in row]
    assert sorted(told) == sorted(set(told))
    assert {2, 3, 4} <= set(told)
    whole = tf.sweep({**PLAN, "chunk": 5}, tmp_path / "s", solve=Solver())
    assert whole.standing.lost == 0
    assert list((tmp_path / "s" / "lost").iterdir()) == []
