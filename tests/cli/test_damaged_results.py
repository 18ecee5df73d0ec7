"""Result folders that something else has written: words and exit code 2, and nothing unpacked."""

from __future__ import annotations

import io
import resource
import sys
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from command_line import assert_refused

from taichi_foam.errors import UserError
from taichi_foam.results.manifest import Manifest
from taichi_foam.results.result import Result
from taichi_foam.scene import Block, Scene, Wedge


@pytest.fixture
def folder(tmp_path: Path, make_result, make_snapshot) -> Path:
    """A result that can be drawn."""
    block = Block(columns=6, rows=5)
    scene = Scene(name="small", block=block, impactor=Wedge())
    snapshots = [make_snapshot(block, time=t) for t in (0.0, 1e-4)]
    return make_result(scene, (0.0, 1e-4), snapshots, {"steps": 2}).save(tmp_path / "run")


def signed(folder: Path) -> None:
    """A manifest that knows the files as they are: what follows is not kept out by checksums."""
    Manifest.of(folder).write(folder)


SUMMARIES = {
    "a number": "3",
    "a list": "[]",
    "run is a number": '{"run": 3}',
    "run is null": '{"run": null}',
    "run ends oddly": '{"run": {"ended_by": 3}}',
    "run ends in a list": '{"run": {"ended_by": [[]]}}',
    "deep": '{"run": ' + "[" * 100_000 + "]" * 100_000 + "}",
    "deep tables": '{"run": ' * 50_000,
    "digits": '{"run": {"steps": ' + "9" * 5_000 + "}}",
    "another encoding": '{"run": {"ended_by": "ä"}}'.encode("latin-1"),
}


@pytest.mark.parametrize("case", SUMMARIES)
def test_odd_summaries(case: str, folder: Path, invoke: Callable) -> None:
    text = SUMMARIES[case]
    (folder / "summary.json").write_bytes(text if isinstance(text, bytes) else text.encode())
    signed(folder)
    with pytest.raises(UserError) as refusal:
        Result.load(folder)
    assert len(str(refusal.value)) < 1_000
    for command in (["render", "run", "--png"], ["compare", "run", "run", "--png"]):
        assert_refused(invoke(*command), "not a complete result")


def npz(path: Path, **members: bytes) -> None:
    """A zip of `members` in place of some of the arrays of `path`."""
    with zipfile.ZipFile(path) as archive:
        whole = {name: archive.read(name) for name in archive.namelist()}
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in (whole | {f"{k}.npy": v for k, v in members.items()}).items():
            archive.writestr(name, content)
    signed(path.parent)


def npy(array: np.ndarray, **options: bool) -> bytes:
    buffer = io.BytesIO()
    np.save(buffer, array, **options)
    return buffer.getvalue()


class Program:
    """What a pickle can do when it is read."""

    def __reduce__(self):
        return print, ("a pickle has been read",)


NODES = (2, 6, 5, 2)
ARRAYS = {
    "objects": {"position": npy(np.array([Program()], dtype=object), allow_pickle=True)},
    "a pickle": {"time": b"\x80\x04K\x01."},
    "text": {"time": npy(np.array(["a", "b"]))},
    "complex": {"velocity": npy(np.zeros(NODES, complex))},
    "no axis": {"time": npy(np.array(3.0))},
    "another count": {"impactor_y": npy(np.zeros(3))},
    "another shape": {"position": npy(np.zeros((2, 6, 6, 2)))},
    "cut": {"position": npy(np.zeros(NODES))[:-8]},
    "longer": {"position": npy(np.zeros(NODES)) + bytes(8)},
    "a header only": {"e_min_a": npy(np.zeros((2, 5, 5)))[:100]},
    "negative": {"time": npy(np.zeros(2)).replace(b"(2,)", b"(-2)")},
    "a format of many": {"format": npy(np.zeros(1_000_000))},
}


@pytest.mark.parametrize("case", ARRAYS)
def test_odd_snapshots(case: str, folder: Path, invoke: Callable) -> None:
    npz(folder / "snapshots.npz", **ARRAYS[case])
    result = invoke("render", "run", "--png")
    assert_refused(result, "not a complete result")
    assert "a pickle has been read" not in result.output


@pytest.mark.skipif(sys.platform == "win32", reason="memory is counted otherwise")
@pytest.mark.parametrize("honest", [True, False])
def test_a_small_file_that_unpacks_to_200_megabytes(folder: Path, honest: bool) -> None:
    """Its own header may say so, or the zip's directory alone."""
    count = 416_666 if honest else 2
    header = npy(np.zeros(0)).replace(b"(0,)", f"({count}, 6, 5, 2)".encode())[:128]
    path = folder / "snapshots.npz"
    npz(path)
    with zipfile.ZipFile(path) as archive:
        rest = {n: archive.read(n) for n in archive.namelist() if n != "position.npy"}
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in rest.items():
            archive.writestr(name, content)
        with archive.open("position.npy", "w", force_zip64=True) as file:
            file.write(header)
            for _ in range(20):
                file.write(bytes(10_000_000))
    signed(folder)
    assert path.stat().st_size < 1e6
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(UserError, match=r"snapshots\.npz|position"):
        Result.load(folder)
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 100_000  # kB


@pytest.mark.parametrize("name", ["history.csv", "snapshots.npz", "summary.json", "scene.toml"])
def test_files_cut_anywhere(name: str, folder: Path) -> None:
    """A result that is whole, or words."""
    file = folder / name
    whole = file.read_bytes()
    refusals = []
    for length in range(0, len(whole), max(1, len(whole) // 40)):
        file.write_bytes(whole[:length])
        signed(folder)
        try:
            Result.load(folder)
        except UserError as error:
            refusals.append(str(error))
    assert refusals
    assert max(map(len, refusals)) < 5_000


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_any_numbers_can_be_drawn(folder: Path, invoke: Callable) -> None:
    """Positions are data: of a run that has diverged they may be anything."""
    odd = np.zeros(NODES)
    odd[1, 0, 0] = [np.nan, np.inf]
    odd[1, 1, 1] = [1e300, -1e300]
    npz(folder / "snapshots.npz", position=npy(odd))
    result = invoke("render", "run", "--png", "--size", "640x360")
    assert result.exit_code == 0, result.output
    assert list(folder.glob("montage-*.png"))
