"""Results survive the way to disk and back, and damage is told."""

from __future__ import annotations

import csv
import json
import math
import os
import shutil
import zipfile
from itertools import product
from pathlib import Path

import numpy as np
import pytest

from taichi_foam.analysis import measures
from taichi_foam.errors import UserError
from taichi_foam.picture.figures import ledger_layers
from taichi_foam.records.cushion import Cushion, shapes_of
from taichi_foam.records.history import COLUMNS, HISTORY_COLUMNS
from taichi_foam.records.snapshot import Snapshot
from taichi_foam.results.files import write_json
from taichi_foam.results.manifest import Manifest
from taichi_foam.results.result import OUTPUTS, Result, snapshots_bytes, storage_bytes
from taichi_foam.scene import Block, Curve, Numerics, Output, RecoveringFoam, Scene, Wedge
from taichi_foam.simulation.after import After

READ_BACK = ["history.csv", "scene.toml", "snapshots.npz", "summary.json"]
FILES = sorted(["cracks.json", "manifest.json", *READ_BACK])


def noisy_result(make_result, make_snapshot, columns: int = 7, rows: int = 5) -> Result:
    """Fifty rows, three snapshots. Every number has all its digits; some are awkward."""
    rng = np.random.default_rng(1)
    block = Block(columns=columns, rows=rows)
    scene = Scene(
        name="noise", block=block, impactor=Wedge(velocity=2.86), output=Output(stress=True)
    )
    t = np.sort(rng.random(50))
    values = {name: rng.standard_normal(50) / 3 for name in HISTORY_COLUMNS[1:]}
    # Not below the smallest normal number: Taichi has its process flush such numbers to zero.
    values["strain_J"][:5] = [math.nan, -0.0, np.finfo(float).tiny, 1.7e308, 1 / 3]
    values |= {name: np.arange(50.0) for name, told in COLUMNS.items() if told.is_integer}
    snapshots = []
    for n in range(3):
        broken = [(i, j) for i in range(columns - 1) for j in range(rows) if (i + j + n) % 3 == 0]
        shape = (columns, rows, 2)
        snapshots.append(
            make_snapshot(
                block,
                a=broken,
                times=lambda i, j: math.pi * (i + j),
                time=n / 3,
                impactor_y=0.1 - n / 7,
                position=rng.standard_normal(shape),
                velocity=rng.standard_normal(shape),
                e_min_a=-rng.random((columns - 1, rows)),
                e_min_b=-rng.random((columns, rows - 1)),
                stress=rng.standard_normal((columns, rows, 3)).astype(np.float32),
            )
        )
    run = {"steps": 12, "wall_s": 0.1, "versions": {"numpy": "2"}, "interrupted": False}
    return make_result(scene, t, snapshots, run, **values)


@pytest.fixture
def noisy(make_result, make_snapshot) -> Result:
    return noisy_result(make_result, make_snapshot)


@pytest.fixture
def saved(noisy: Result, tmp_path: Path) -> Path:
    """The folder of that result."""
    return noisy.save(tmp_path / "run")


def assert_same(a: Result, b: Result) -> None:
    assert a.scene == b.scene
    assert a.run == b.run
    for name in HISTORY_COLUMNS:
        assert a.history[name].tobytes() == b.history[name].tobytes(), name
    assert len(a.snapshots) == len(b.snapshots)
    for one, other in zip(a.snapshots, b.snapshots, strict=True):
        assert one.own == other.own == {}  # what bonds of other laws remember
        for name in Snapshot.__dataclass_fields__.keys() - {"own"}:
            mine, theirs = np.asarray(getattr(one, name)), np.asarray(getattr(other, name))
            kind = np.float32 if name == "stress" else np.float64
            assert mine.dtype == theirs.dtype == kind
            assert np.array_equal(mine, theirs, equal_nan=True), name


def test_round_trip_is_exact(tmp_path: Path, noisy: Result, saved: Path) -> None:
    assert saved == tmp_path / "run"
    assert sorted(os.listdir(saved)) == FILES
    assert_same(Result.load(saved), noisy)


def test_round_trip_of_a_run_stopped_at_once(tmp_path: Path, make_result) -> None:
    result = make_result(time=[])
    result.save(tmp_path / "run")
    assert_same(Result.load(tmp_path / "run"), result)


def test_history_is_plain_csv(noisy: Result, saved: Path) -> None:
    with (saved / "history.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert tuple(rows[0]) == HISTORY_COLUMNS
    assert [float(row["time_s"]) for row in rows] == noisy.history["time_s"].tolist()
    assert [row["broken_bonds"] for row in rows[:3]] == ["0", "1", "2"]


def test_summary_is_strict_json(tmp_path: Path, make_result) -> None:
    nan = math.nan
    result = make_result(
        residual_J=nan, strain_J=1.0, run={"wall_s": math.inf, "steps": np.int64(3)}
    )
    result.save(tmp_path / "run")

    def refuse(word: str) -> None:
        raise AssertionError(f"{word} is not JSON")

    text = (tmp_path / "run" / "summary.json").read_text()
    found = json.loads(text, parse_constant=refuse)
    assert text.startswith('{\n  "scene": "hand-made"')
    assert found["impact_duration_s"] is None
    assert found["energy_residual"] is None
    assert found["run"] == {"wall_s": None, "steps": 3}


def test_json_of_numpy_values(tmp_path: Path) -> None:
    value = {"a": np.array([1.5, np.nan]), "b": (np.bool_(True), np.float64(2)), "µ": "λ"}
    write_json(tmp_path / "x.json", value)
    found = json.loads((tmp_path / "x.json").read_text(encoding="utf-8"))
    assert found == {"a": [1.5, None], "b": [True, 2.0], "µ": "λ"}


def test_an_existing_result_is_kept_unless_overwritten(
    make_result, noisy: Result, saved: Path
) -> None:
    second = make_result()
    with pytest.raises(UserError, match="already holds a result"):
        second.save(saved)
    assert_same(Result.load(saved), noisy)
    second.save(saved, overwrite=True)
    assert_same(Result.load(saved), second)


def test_an_interrupted_write_leaves_the_old_result(
    make_result, noisy: Result, saved: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupt(*args, **kwargs) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr(zipfile.ZipFile, "open", interrupt)
        with pytest.raises(KeyboardInterrupt):
            make_result().save(saved, overwrite=True)
    assert os.listdir(saved.parent) == ["run"]
    assert_same(Result.load(saved), noisy)


def test_columns_must_fit(make_result) -> None:
    good = make_result()
    with pytest.raises(ValueError, match="time_s"):
        Result(good.scene, {k: v for k, v in good.history.items() if k != "time_s"}, [], {})
    with pytest.raises(ValueError, match="length"):
        Result(good.scene, {**good.history, "dt_s": np.zeros(99)}, [], {})


def test_a_result_outlives_its_columns(tmp_path: Path, make_result) -> None:
    """One that another version has written lacks a column of this one and has one more."""
    now = make_result(impactor_kinetic_J=2.0, crushing_J=1.0)
    there = {k: v for k, v in now.history.items() if k != "folding_J"} | {"wetting_J": np.arange(2)}
    Result(now.scene, there, [], {}).save(tmp_path / "run")
    other = Result.load(tmp_path / "run")
    assert [*other.history] == [*there]
    np.testing.assert_array_equal(other.history.wetting_J, [0.0, 1.0])
    assert other.history.units["wetting_J"] == ""
    with pytest.raises(UserError, match=r"no column 'folding_J'.*run its scene again"):
        other.history["folding_J"]
    assert other.warnings == now.warnings
    assert other.summary == now.summary
    names, layers, _ = ledger_layers(other.history)
    assert dict(zip(names, (layer[-1] for layer in layers), strict=True)) == {
        "motion of the impactor": 2.0,
        "crushing": 1.0,
    }


def test_a_result_of_version_0_2_loads() -> None:
    """It stays in the tests as it was written."""
    result = Result.load(Path(__file__).parent / "kept")
    told = json.loads((Path(__file__).parent / "kept" / "summary.json").read_text())
    assert result.run == told["run"]
    assert result.summary["max_displacement_m"] == told["max_displacement_m"]
    assert result.snapshots[-1].time == result.history.time_s[-1] >= result.scene.numerics.end
    assert result.cushion is not None


def test_a_result_whose_block_remembers_less_loads_without_it(tmp_path: Path) -> None:
    """As when a later version remembers more of a block; only an impact on it is refused."""
    run = shutil.copytree(Path(__file__).parent / "kept", tmp_path / "run")
    with np.load(run / "state.npz") as archive:
        arrays = {name: array for name, array in archive.items() if name != "hold"}
    np.savez(run / "state.npz", **arrays)
    Manifest.of(run).write(run)
    result = Result.load(run)
    assert result.cushion is None
    assert result.snapshots[-1].time == result.history.time_s[-1]
    with pytest.raises(UserError, match=r"left no block to continue with.*with this version"):
        After.of(result.scene, run)


def test_the_docs_have_every_file() -> None:
    text = (Path(__file__).parents[2] / "docs" / "architecture.md").read_text(encoding="utf-8")
    assert all(f"| `{name}` |" in text for name in OUTPUTS)


def test_a_missing_folder_is_told(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="no such folder"):
        Result.load(tmp_path / "nowhere")


@pytest.mark.parametrize(
    ("name", "damage"),
    [
        *product(["history.csv", "snapshots.npz", "summary.json"], ["empty", "cut"]),
        *product(READ_BACK, ["missing", "garbage"]),
        ("snapshots.npz", "flipped"),
    ],
)
def test_damage_is_told(saved: Path, name: str, damage: str) -> None:
    file = saved / name
    whole = file.read_bytes()
    if damage == "missing":
        file.unlink()
    elif damage == "empty":
        file.write_bytes(b"")
    elif damage == "cut":
        file.write_bytes(whole[: len(whole) // 2 - 3])
    elif damage == "flipped":
        middle = len(whole) // 2
        flipped = bytes(byte ^ 0xFF for byte in whole[middle : middle + 50])
        file.write_bytes(whole[:middle] + flipped + whole[middle + 50 :])
    else:
        file.write_bytes(b"\x93\x00\xff garbage = [")
    with pytest.raises(UserError):
        Result.load(saved)


def test_snapshots_of_another_lattice_are_told(saved: Path, make_result, make_snapshot) -> None:
    other = noisy_result(make_result, make_snapshot, columns=8).save(saved.with_name("other"))
    os.replace(other / "snapshots.npz", saved / "snapshots.npz")
    with pytest.raises(UserError, match=r"not as they were written: snapshots\.npz"):
        Result.load(saved)
    Manifest.of(saved).write(saved)
    with pytest.raises(UserError, match="shape"):
        Result.load(saved)


def test_a_cut_history_is_noticed(saved: Path) -> None:
    """Also one that is cut between two rows, which would read well."""
    file = saved / "history.csv"
    file.write_text("".join(file.read_text().splitlines(keepends=True)[:-1]))
    with pytest.raises(UserError, match=r"not as they were written: history\.csv"):
        Result.load(saved)


def test_data_are_whole_although_they_cannot_be_measured(
    tmp_path: Path, noisy: Result, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(record: object) -> None:
        raise ZeroDivisionError("no such thing")

    monkeypatch.setattr(measures, "summary", fail)
    noisy.save(tmp_path / "run")
    assert_same(Result.load(tmp_path / "run"), noisy)
    told = json.loads((tmp_path / "run" / "summary.json").read_text())
    assert told["not_measured"] == "ZeroDivisionError: no such thing"


def test_storage_estimate_is_an_upper_bound(tmp_path: Path, make_result, make_snapshot) -> None:
    """A run of 50 rows and 3 snapshots that do not compress."""
    noise = noisy_result(make_result, make_snapshot, columns=60, rows=40)
    scene = Scene(
        name="noise",
        block=noise.scene.block,
        impactor=Wedge(),
        numerics=Numerics(end=4.9e-3),
        output=Output(history_interval=1e-4, snapshot_interval=2.4e-3),
    )
    Result(scene, noise.history, noise.snapshots, {}).save(tmp_path / "run")
    taken = sum(file.stat().st_size for file in (tmp_path / "run").iterdir())
    assert taken < storage_bytes(scene) < 4 * taken


def test_the_estimate_has_room_for_all_that_bonds_remember(tmp_path: Path, make_result) -> None:
    """Bonds of foam whose gas leaks remember more than their worst strain."""
    scene = Scene(
        name="noise",
        block=Block(columns=200, rows=100),
        impactor=Wedge(),
        foam=RecoveringFoam(
            curve=Curve(strain=(0.0, 0.05, 0.9), stress=(0.0, 1e5, 1e6)),
            gas_pressure=1e5,
            gas_leak_time=1.0,
        ),
        numerics=Numerics(end=1e-3),
        output=Output(history_interval=1e-3),
    )
    rng, shapes = np.random.default_rng(1), shapes_of(Cushion, scene)
    assert any(name.startswith("own.") for name in shapes)
    arrays = {name: rng.standard_normal(shape) for name, shape in shapes.items()}
    result = Result(scene, make_result(scene).history, [], {}, Cushion.from_arrays(arrays))
    state = result.save(tmp_path / "run") / "state.npz"
    assert state.stat().st_size < storage_bytes(scene) - 2 * snapshots_bytes(scene)


def test_the_crack_path_is_kept_as_polylines(noisy: Result, saved: Path) -> None:
    """Every broken bond of the last snapshot is one step of one polyline."""
    lines = json.loads((saved / "cracks.json").read_text())["polylines_m"]
    last = noisy.snapshots[-1]
    assert sum(len(line) - 1 for line in lines) == last.broken_a.sum() + last.broken_b.sum() > 0
