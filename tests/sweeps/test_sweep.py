"""A sweep in this process: its folder, its table, and going on where it ended."""

from __future__ import annotations

import errno
import io
import json
import os
import shutil
import warnings
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import pandas as pd
import pyarrow.parquet as pq
import pytest
from drops import Solver, axis, ending, plan_of
from rich.console import Console

import taichi_foam as tf
from taichi_foam.errors import RunError, RunWarning, UserError
from taichi_foam.results.files import whole_file
from taichi_foam.results.folders import locked
from taichi_foam.results.result import Result
from taichi_foam.scene import Scene
from taichi_foam.simulation.progress import Bars
from taichi_foam.sweeps import run, store, table
from taichi_foam.sweeps.plan import Plan
from taichi_foam.sweeps.run import Sweep
from taichi_foam.version import version

PLAN = plan_of(axis(count=9), keep={"histories": "float32"})


@pytest.fixture
def swept(tmp_path: Path) -> Sweep:
    return tf.sweep(PLAN, tmp_path / "s", solve=Solver())


def names(folder: Path) -> set[str]:
    return {str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file()}


def test_the_folder_holds_a_plan_shards_and_one_table(swept: Sweep) -> None:
    ends = [(0, 1), (2, 3), (4, 5), (6, 7), (8, 8)]
    chunks = [f"{first:08d}-{last:08d}.parquet" for first, last in ends]
    assert names(swept.folder) == {
        "sweep.json", "results.csv", "results.parquet",
        *(f"chunks/{name}" for name in chunks),
        *(f"histories/{name}" for name in chunks),
    }  # fmt: skip
    mark = json.loads((swept.folder / "sweep.json").read_text(encoding="utf-8"))
    assert mark["members"] == 9
    assert mark["hash"] == swept.plan.hash
    assert mark["made_with"]["taichi_foam"] == version()


def test_the_table_has_a_row_for_each_drop_and_a_column_for_each_kind(swept: Sweep) -> None:
    found = pd.read_parquet(swept.folder / "results.parquet")
    assert list(found.columns) == [
        "member", "scene", "impactor.velocity", "repeat", "varied", "ending", "failure",
        "max_displacement_m", "pieces", "warnings", "bottomed",
        "peak_deceleration_cfc180_g", "peak_deceleration_g", "peak_resultant_g", "mixed", "wall_s",
    ]  # fmt: skip
    assert found["member"].tolist() == list(range(9))
    by = found.set_index("impactor.velocity")
    assert by.loc[2.25, "max_displacement_m"] == 0.0225
    assert pd.isna(by.loc[4.0, "max_displacement_m"])
    assert by["mixed"].tolist()[:2] == [1.0, 1.0]
    assert by.loc[2.5, "warnings"] == "slow; odd"
    assert by.loc[2.25, "warnings"] == ""
    assert by.loc[3.5, "ending"] == "diverged"
    assert "set numerics.dt = 'auto'" in by.loc[3.5, "failure"]
    # one that cannot be measured loses the others nothing
    assert by.loc[3.0, "failure"] == "no measures: ValueError: no figures"
    assert pd.isna(by.loc[3.0, "pieces"])
    text = pd.read_csv(swept.folder / "results.csv", keep_default_na=False, na_values=[""])
    assert text["scene"].tolist() == found["scene"].tolist()
    assert text["max_displacement_m"].equals(found["max_displacement_m"])
    assert swept.standing == store.Standing(9, 9, failed=2, lost=0, at_work=False)


def test_histories_are_kept_as_asked(swept: Sweep) -> None:
    kept = pq.read_table(swept.history_file(range(2, 4)))
    assert kept["member"].to_pylist() == [2, 2, 2, 3, 3, 3]
    assert str(kept.schema.field("time_s").type) == "float"
    assert swept.histories(3)["time_s"].tolist() == [0.0, 1.0, 2.0]
    with pytest.raises(UserError, match="member 9: does not exist; members are numbered 0 to 8"):
        swept.histories(9)


def test_the_same_call_computes_nothing_twice(swept: Sweep) -> None:
    before = {name: (swept.folder / name).stat().st_mtime_ns for name in names(swept.folder)}
    solver = Solver()
    tf.sweep(PLAN, swept.folder, solve=solver)
    assert solver.asked == []
    shards = [name for name in before if "/" in name]
    assert {n: (swept.folder / n).stat().st_mtime_ns for n in shards} == {
        n: before[n] for n in shards
    }


def test_ctrl_c_keeps_complete_chunks_and_the_same_call_goes_on(tmp_path: Path) -> None:
    with pytest.raises(KeyboardInterrupt) as stopped:
        tf.sweep(PLAN, tmp_path / "s", solve=Solver(before=ending(5)))
    assert "4 of 9 drops are in" in str(stopped.value)
    assert "the same command continues" in str(stopped.value)
    half = Sweep.open(tmp_path / "s")
    assert half.standing == store.Standing(9, 4, failed=0, lost=0, at_work=False)
    assert len(half.to_pandas()) == 4
    assert "lock" not in names(tmp_path / "s")
    rest = Solver()
    whole = tf.sweep(PLAN, tmp_path / "s", solve=rest)
    assert sorted(rest.asked) == [3.0, 3.25, 3.5, 3.75, 4.0]
    unbroken = tf.sweep(PLAN, tmp_path / "t", solve=Solver())
    assert whole.to_pandas().equals(unbroken.to_pandas())
    assert names(tmp_path / "s") == names(tmp_path / "t")


def test_what_a_killed_process_left_is_removed_and_a_cut_shard_computed_again(
    swept: Sweep,
) -> None:
    folder = swept.folder
    litter = [
        ".sweep.0a1b2c3d.partial.json",
        "chunks/.00000002-00000003.0a1b2c3d.partial.parquet",
        "lock",
    ]
    for name in litter:
        (folder / name).write_bytes(b"cut")
    (folder / "runs" / "00000003" / ".unfinished.0a1b2c3d.partial").mkdir(parents=True)
    (folder / ".workers" / "dask-scratch-space").mkdir(parents=True)
    shard = swept.chunk_file(range(4, 6))
    whole = shard.read_bytes()
    shard.write_bytes(whole[:-20])
    solver = Solver()
    tf.sweep(PLAN, folder, solve=solver)
    assert sorted(solver.asked) == [3.0, 3.25]
    assert pq.read_table(shard).equals(pq.read_table(io.BytesIO(whole)))
    assert not [name for name in names(folder) if "partial" in name or name == "lock"]
    assert not [path for path in folder.rglob("*") if path.name.startswith(".")]


def test_another_plan_is_refused_with_the_difference(swept: Sweep) -> None:
    before = {name: (swept.folder / name).read_bytes() for name in names(swept.folder)}
    other = plan_of(axis(count=11), keep={"histories": "none"}, set={"block.rows": 10})
    with pytest.raises(UserError) as refused:
        tf.sweep(other, swept.folder, solve=Solver())
    for line in (
        "axes[impactor.velocity].count: was 9, is 11",
        "keep.histories: was 'float32', is 'none'",
        "scene.block.rows: was 21, is 10",
    ):
        assert line in str(refused.value)
    with pytest.raises(UserError, match="was started with arch = cpu"):
        tf.sweep(PLAN, swept.folder, arch="cuda", solve=Solver())
    del before["sweep.json"]
    assert all((swept.folder / name).read_bytes() == held for name, held in before.items())


def test_another_version_is_refused(swept: Sweep, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(store, "version", lambda: "99.0")
    with pytest.raises(UserError, match=r"started with taichi_foam .*, but this is 99\.0"):
        tf.sweep(PLAN, swept.folder, solve=Solver())


def test_a_folder_of_something_else_is_refused_and_stays(tmp_path: Path) -> None:
    (tmp_path / "thesis.tex").write_text("mine")
    with pytest.raises(UserError, match=r"not empty and does not hold a sweep"):
        tf.sweep(PLAN, tmp_path, solve=Solver())
    assert names(tmp_path) == {"thesis.tex"}
    with pytest.raises(UserError, match=r"thesis\.tex: is a file"):
        tf.sweep(PLAN, tmp_path / "thesis.tex", solve=Solver())


def test_two_sweeps_cannot_share_a_folder(tmp_path: Path, swept: Sweep) -> None:
    solver = Solver()
    with locked(swept.folder), pytest.raises(UserError, match="another process is working in it"):
        tf.sweep(PLAN, swept.folder, solve=solver)
    assert solver.asked == []


def test_a_sweep_that_the_disk_cannot_hold_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    usage = shutil.disk_usage(tmp_path)._replace(free=10_000)
    monkeypatch.setattr("taichi_foam.results.folders.shutil.disk_usage", lambda path: usage)
    with pytest.raises(UserError, match=r"needs about .*B, but the disk has 10 kB free"):
        tf.sweep(PLAN, tmp_path / "s", solve=Solver())
    assert names(tmp_path) == set()


def test_a_disk_that_fills_up_keeps_what_is_complete(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(path: Path):
        if path.name == "00000006-00000007.parquet":
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(path))
        return whole_file(path)

    monkeypatch.setattr(table, "whole_file", full)
    with pytest.raises(
        UserError, match=r"No space left on device\. Fix: free some space; what is comp"
    ):
        tf.sweep(PLAN, tmp_path / "s", solve=Solver())
    # what the worker was given before may come to its end
    there = Sweep.open(tmp_path / "s").standing.done
    assert there in (6, 7)
    monkeypatch.undo()
    solver = Solver()
    assert tf.sweep(PLAN, tmp_path / "s", solve=solver).standing.done == 9
    assert sorted(solver.asked) == [3.5, 3.75, 4.0][: 9 - there]


def test_a_chunk_that_cannot_be_computed_is_told_and_tried_again(tmp_path: Path) -> None:
    with pytest.raises(RunError, match="chunk"):
        tf.sweep(
            PLAN,
            tmp_path / "s",
            solve=Solver(before=ending(3, MemoryError("no room for the lattice"))),
        )
    half = Sweep.open(tmp_path / "s")
    assert half.standing.lost > 0
    assert "MemoryError: no room" in half.lost()[range(2, 4)]
    rows = half.to_pandas().set_index("member")
    assert rows.loc[2, "failure"].startswith("lost: MemoryError")
    assert rows.loc[0, "max_displacement_m"] == 0.02
    whole = tf.sweep(PLAN, tmp_path / "s", solve=Solver())
    assert whole.standing == store.Standing(9, 9, failed=2, lost=0, at_work=False)
    assert whole.to_pandas()["member"].tolist() == list(range(9))


def test_values_that_make_no_scene_in_a_huge_sweep_have_a_row(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # the third of five masses is looked at by nobody, and is above what a mass may be
    monkeypatch.setattr(run, "MOST_CHECKED", 2)
    masses = {"key": "impactor.mass", "values": [3.0, 4.0, -1.0, 5.0, 6.0]}
    found = tf.sweep(plan_of(masses), tmp_path / "s", solve=Solver()).to_pandas()
    assert "impactor.mass = -1.0: must be" in found.loc[2, "failure"]
    assert found["failure"].notna().tolist() == [False, False, True, False, False]


def test_a_folder_that_is_no_sweep_cannot_be_opened(tmp_path: Path, swept: Sweep) -> None:
    with pytest.raises(UserError, match="is not the folder of a sweep"):
        Sweep.open(tmp_path)
    (swept.folder / "sweep.json").write_text('{"format": 1}')
    with pytest.raises(UserError, match="damaged, or written by another version"):
        Sweep.open(swept.folder)


class Seeded(Solver):
    """Drops whose figures hang on the seed above 4 kg: lighter ones break nothing."""

    def __call__(self, scenes: Sequence[Scene]) -> Iterator[tuple[int, Result]]:
        for place, result in super().__call__(scenes):
            breaks = result.scene.impactor.mass > 4.0
            drawn = 1e-9 * result.scene.foam.strength_seed if breaks else 0.0
            yield place, SeededResult(result.scene, result.history, [], {**result.run, "x": drawn})


class SeededResult(Result):
    @property
    def summary(self) -> dict[str, Any]:
        return {"energy_residual": self.run["x"], "max_displacement_m": 0.1}


def seeded(tmp_path: Path, masses: list[float], **more: Any) -> tuple[str, Sweep]:
    log = io.StringIO()
    plan = plan_of(
        {"key": "impactor.mass", "values": masses},
        set={"foam.strength_scatter": 0.1}, repeats={"count": 3, "vary": "seed"}, **more,
    )  # fmt: skip
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RunWarning)
        found = tf.sweep(plan, tmp_path / "s", solve=Seeded(), bars=Bars(Console(file=log)))
    return log.getvalue(), found


def test_seeds_that_have_changed_nothing_are_said(tmp_path: Path) -> None:
    told, found = seeded(tmp_path / "a", [3.0, 6.0, 3.5])
    assert (
        "note: repeats.vary = 'seed': the seeds made no difference to the repeats of 2 of 3" in told
    )
    assert len(found.notes) == 1
    with pytest.warns(RunWarning, match="the seeds made no difference"):
        tf.sweep(found.plan, found.folder, solve=Seeded())
    assert "of all combinations" in seeded(tmp_path / "b", [3.0, 3.5])[0]
    told, found = seeded(tmp_path / "c", [5.0, 6.0])
    assert "note" not in told
    assert found.notes == []


def test_seeds_that_will_change_nothing_are_said_before(tmp_path: Path) -> None:
    plan = plan_of(
        {"key": "foam.strength_scatter", "values": [0.0, 0.1]}, repeats={"count": 3, "vary": "seed"}
    )
    assert Plan.load(plan).notes == [
        "repeats.vary = 'seed': where foam.strength_scatter = 0, all repeats are the same"
    ]
    assert Plan.load({**plan, "repeats": {"count": 3}}).notes == []
