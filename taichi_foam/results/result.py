"""The result of a run: scene, history, snapshots and run figures, in memory and on disk.

`OUTPUTS` lists the files of a result's folder; docs/architecture.md (Files) describes each file.
"""

from __future__ import annotations

import csv
import json
import math
import zipfile
import zlib
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from taichi_foam.errors import UserError
from taichi_foam.records.cushion import Cushion, absent_of, shapes_of
from taichi_foam.records.history import COLUMNS, History
from taichi_foam.records.record import Record
from taichi_foam.records.snapshot import Snapshot
from taichi_foam.results.files import drop_name, write_csv, write_json
from taichi_foam.results.folders import claimed, request_in
from taichi_foam.results.manifest import Manifest
from taichi_foam.results.snapshot_file import record_type, shapes, snapshot_of, values_of
from taichi_foam.scene import Scene
from taichi_foam.scene.files import scene_from_toml, scene_to_toml
from taichi_foam.scene.paths import by_key

_FORMAT = 2
_STATE = "state.npz"
# What the readers of csv, npz and json raise on a missing, truncated or foreign file.
_DAMAGE = (
    OSError,
    EOFError,
    ValueError,
    KeyError,
    TypeError,
    RecursionError,
    csv.Error,
    zipfile.BadZipFile,
    zlib.error,
)


class Result(Record):
    """A `Record` with measures, which can be saved and loaded."""

    @cached_property
    def summary(self) -> dict[str, Any]:
        """Measures by the keys of summary.json; see `analysis.measures.summary`."""
        from taichi_foam.analysis.measures import summary

        return summary(self)

    def measured(self, keys: Iterable[str]) -> dict[str, Any]:
        """Some entries of `summary`, without the work for the others."""
        from taichi_foam.analysis.measures import Figures

        figures = Figures(self)
        return {key: figures[key] for key in keys}

    @cached_property
    def warnings(self) -> list[str]:
        """What makes its figures doubtful, in sentences; see `analysis.soundness.warnings_of`."""
        from taichi_foam.analysis.soundness import warnings_of

        return warnings_of(self)

    def save(self, folder: str | Path, overwrite: bool = False) -> Path:
        """Write the files of a run into a new folder, all or nothing, and return its path.

        Removes a checkpoint of the run in that folder. Raises UserError as
        `taichi_foam.results.folders.claimed` does.
        """
        with claimed(folder, request_of(self.scene, self.run.get("after")), overwrite) as claim:
            with claim.publishing() as staging:
                self.write(staging)
            claim.finish()
        return Path(folder)

    def write(self, folder: Path) -> None:
        """Write `OUTPUTS` into an existing, empty folder (one yielded by `output_folder`)."""
        for name, output in OUTPUTS.items():
            output.write(self, folder / name)
        Manifest.of(folder).write(folder)

    @classmethod
    def load(cls, folder: str | Path) -> Result:
        """Read a folder that `save` wrote.

        Raises UserError: files are missing, foreign, or not as they were written.
        """
        root = Path(folder)
        if not root.is_dir():
            raise UserError(f"result folder {root}: there is no such folder.")
        _check_whole(root)
        scene = scene_from_toml(root / "scene.toml")
        try:
            history = _read_history(root / "history.csv")
            snapshots = _read_snapshots(root / "snapshots.npz", scene)
            run, cushion = _read_run(root / "summary.json"), _read_cushion(root / _STATE, scene)
            return cls(scene, history, snapshots, run, cushion)
        except _DAMAGE as error:
            raise UserError(
                f"result folder {root}: not a complete result of this version ({_words(error)}). "
                f"Fix: run {root / 'scene.toml'} again."
            ) from error


load = Result.load
"""Read a folder that a result was saved to; see `Result.load`."""


def request_of(scene: Scene, after: Mapping[str, Any] | None = None) -> dict[str, Any]:
    """The request that identifies a run when its folder is claimed: the scene's values, by key.

    For a run on a block that another run has left, it includes the hash of the block's state;
    `after` is `run["after"]`.
    """
    wanted = by_key(scene.model_dump(mode="json"))
    return wanted if after is None else {**wanted, "after": after["state_sha256"]}


def storage_bytes(scene: Scene) -> int:
    """Upper bound on the size of a run's files, without frames and films (bytes).

    Snapshots count twice: they are first stored as they are recorded, then packed.
    """
    state = 8 * sum(map(math.prod, shapes_of(Cushion, scene).values()))
    rows = 25 * len(COLUMNS) * scene.most_rows
    return 2 * snapshots_bytes(scene) + state + rows + 100_000


def snapshots_bytes(scene: Scene) -> int:
    """Upper bound on the size of a run's snapshots, in memory or as a file (bytes)."""
    return scene.most_snapshots * record_type(scene).itemsize


def _check_whole(root: Path) -> None:
    """Raise UserError if the folder holds no complete result."""
    manifest = Manifest.read(root)
    if manifest is None:
        reason = "the run in it has not ended. Fix: continue it with `taichi-foam resume`"
        if request_in(root) is None:
            reason = "it does not hold a complete result of this version. Fix: run its scene again"
        raise UserError(f"result folder {root}: {reason}.")
    needed = [name for name, output in OUTPUTS.items() if output.needed]
    changed = [name for name in (*needed, _STATE) if name in manifest.files]
    changed = [name for name in changed if not manifest.files[name].fits(root / name)]
    first = root / drop_name(1)
    if not changed and first.is_dir():
        raise UserError(f"{root}: holds a series of drops; give one of them, such as {first}")
    if changed or not {*needed} <= {*manifest.files}:
        raise UserError(
            f"result folder {root}: its files are not as they were written: "
            f"{', '.join(changed) or 'some are missing'}. Fix: run its scene again."
        )


def _write_scene(result: Result, path: Path) -> None:
    path.write_text(scene_to_toml(result.scene), encoding="utf-8")


def _write_history(result: Result, path: Path) -> None:
    columns = {}
    for name, each in result.history.items():
        # tolist gives Python floats, whose repr is the shortest text that reads back the same.
        values = np.asarray(each, dtype=np.float64).tolist()
        is_integer = name in COLUMNS and COLUMNS[name].is_integer
        columns[name] = map(int, values) if is_integer else values
    write_csv(path, columns)


def _write_curve(result: Result, path: Path) -> None:
    """Write a compression test as `foam.curve` and `taichi-foam foam import` accept it."""
    from taichi_foam.analysis.loads import compression_curve

    if curve := compression_curve(result):
        strain, stress = curve
        write_csv(path, {"strain [-]": strain.tolist(), "stress [Pa]": stress.tolist()})


def _write_state(result: Result, path: Path) -> None:
    if result.cushion is not None:
        arrays: dict[str, Any] = result.cushion.to_arrays()
        np.savez_compressed(path, format=_FORMAT, **arrays)


def _write_cracks(result: Result, path: Path) -> None:
    from taichi_foam.analysis.fragments import cracks

    try:
        found = cracks(result.snapshots[-1], result.scene.block) if result.snapshots else []
    except Exception:  # the summary reports it
        found = []
    write_json(path, {"polylines_m": found})


def _write_summary(result: Result, path: Path) -> None:
    """Write the measures, or, if measuring fails, the reason as `not_measured`."""
    try:
        measures = result.summary
    except Exception as error:  # no error here may cost hours of computing
        reason = f"{type(error).__name__}: {error}"
        measures = {"scene": result.scene.name, "not_measured": reason}
    write_json(path, {**measures, "run": result.run})


def _read_history(path: Path) -> History:
    with path.open(newline="", encoding="utf-8") as file:
        header, *rows = csv.reader(file)
    if any(len(row) != len(header) for row in rows):
        raise ValueError("history.csv has a row that is too short or too long")
    table = np.array(rows, dtype=np.float64).reshape(len(rows), len(header))
    return History({name: table[:, k].copy() for k, name in enumerate(header)})


def _read_run(path: Path) -> dict[str, Any]:
    summary = json.loads(path.read_bytes())
    if not (isinstance(summary, dict) and isinstance(summary.get("run"), dict)):
        raise ValueError("summary.json has no table `run`")
    return summary["run"]


def _read_cushion(path: Path, scene: Scene) -> Cushion | None:
    """The block as the run has left it, or None.

    Also None if another version stored less of it, so that the rest of its result still loads;
    arrays whose values are then known may be missing, see `Per.absent`.
    """
    if not path.is_file():
        return None
    try:
        arrays = _read_arrays(path, shapes_of(Cushion, scene), absent_of(Cushion))
        return Cushion.from_arrays(arrays)
    except KeyError:
        return None


def _words(error: BaseException) -> str:
    """A reader's message, shortened, since it may repeat what it has read."""
    text = str(error) or type(error).__name__
    return text if len(text) <= 300 else text[:297] + "..."


def _write_snapshots(result: Result, path: Path) -> None:
    """Write an .npz array by array, instant by instant: one snapshot is in memory at a time."""
    snapshots, scene = result.snapshots, result.scene
    record = record_type(scene)
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        with archive.open("format.npy", "w") as file:
            np.lib.format.write_array(file, np.array(_FORMAT))
        for name, shape in shapes(scene).items():
            kind = record[name].base
            with archive.open(f"{name}.npy", "w", force_zip64=True) as file:
                header = {
                    "descr": np.lib.format.dtype_to_descr(kind),
                    "fortran_order": False,
                    "shape": (len(snapshots), *shape),
                }
                np.lib.format.write_array_header_1_0(file, header)
                for snapshot in snapshots:
                    file.write(np.asarray(values_of(snapshot)[name], kind).tobytes())


def _read_snapshots(path: Path, scene: Scene) -> list[Snapshot]:
    arrays = _read_arrays(path, shapes(scene), absent_of(Snapshot), "time")
    return [
        snapshot_of(dict(zip(arrays, values, strict=True)))
        for values in zip(*arrays.values(), strict=True)
    ]


def _read_arrays(
    path: Path,
    shapes: Mapping[str, tuple[int, ...]],
    absent: Mapping[str, float | None],
    series: str | None = None,
) -> dict[str, NDArray[Any]]:
    """Arrays of numbers from an .npz; their first axis is as long as the array `series`, if given.

    `absent` has the values of arrays that may be missing.

    Raises ValueError, KeyError, zipfile.BadZipFile, zlib.error, OSError: it is damaged, or holds
    other arrays.
    """
    with zipfile.ZipFile(path) as archive:
        if (written := _read_array(archive, "format", ())) != _FORMAT:
            raise ValueError(f"{path.name} has format {written}, not {_FORMAT}")
        count = _read_array(archive, series).shape[:1] if series else ()
        there = {name.removesuffix(".npy") for name in archive.namelist()}
        return {
            name: _read_array(archive, name, (*count, *shape))
            if name in there or absent.get(name) is None
            else np.full((*count, *shape), absent[name])
            for name, shape in shapes.items()
        }


def _read_array(
    archive: zipfile.ZipFile, name: str, shape: tuple[int, ...] | None = None
) -> NDArray[Any]:
    """One array. An array larger than `shape` is not unpacked."""
    entry = archive.getinfo(f"{name}.npy")
    if shape is not None and entry.file_size > 8 * math.prod(shape) + 1000:
        raise ValueError(f"{name} is longer than its shape {shape}")
    with archive.open(entry) as file:
        array = np.lib.format.read_array(file)
        if array.dtype.kind not in "fi" or file.read(1):
            raise ValueError(f"{name} does not hold numbers of its shape")
    if shape is not None and array.shape != shape:
        raise ValueError(f"{name} has the shape {array.shape}, not {shape}")
    return array


@dataclass(frozen=True)
class RunFile:
    """One file of a run's folder.

    write   function that writes it, or nothing if there is nothing to store
    needed  whether a result is invalid without it
    link    link text for downloads; empty: no link
    about   what it holds, shown with the link
    """

    write: Callable[[Result, Path], None]
    needed: bool = False
    link: str = ""
    about: str = ""


# The measures import SciPy, which takes half a second to load: these functions import them late.
OUTPUTS: dict[str, RunFile] = {
    "history.csv": RunFile(_write_history, True, "CSV", "histories"),
    "scene.toml": RunFile(_write_scene, True, "TOML", "the complete scene, ready to be run again"),
    "snapshots.npz": RunFile(_write_snapshots, True, "NPZ", "snapshots of the lattice, for NumPy"),
    "compression.csv": RunFile(_write_curve),
    _STATE: RunFile(_write_state),
    "cracks.json": RunFile(_write_cracks, True),
    "summary.json": RunFile(_write_summary, True, "JSON", "all measures"),
}
"""Files of a run's folder besides its manifest, by name, in order."""
