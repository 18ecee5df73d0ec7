"""What a run leaves: its scene, histories, snapshots and run figures, in memory and on disk.

A result folder holds

    scene.toml     the resolved scene; it runs again by itself
    history.csv    one row per history interval, one column per entry of HISTORY_COLUMNS; every
                   number written so that it reads back exactly
    snapshots.npz  the lattice at N instants (NumPy's open zip format); block of I x J mass points
        format        ()            1
        time          (N,)          s
        impactor_y    (N,)          m     height of the impactor's lowest point, NaN without one
        position      (N,I,J,2)     m     x, y of mass point (i, j)
        velocity      (N,I,J,2)     m/s
        e_min_a       (N,I-1,J)     -     worst compressive strain so far of A(i,j), <= 0
        e_min_b       (N,I,J-1)     -     the same of B(i,j)
        break_time_a  (N,I-1,J)     s     when A(i,j) broke, NaN while intact
        break_time_b  (N,I,J-1)     s     the same of B(i,j)
    cracks.json    the crack path at the last snapshot: broken bonds as polylines, points
                   (x, y) in m in the reference configuration, the longest first
    summary.json   the measures (`analysis.measures.summary`), and `run`: how it was computed
"""

from __future__ import annotations

import csv
import json
import math
import zipfile
import zlib
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from taichi_foam.errors import UserError
from taichi_foam.records.history import COLUMNS, HISTORY_COLUMNS, History
from taichi_foam.records.record import Record
from taichi_foam.records.snapshot import Snapshot
from taichi_foam.results.folders import output_folder
from taichi_foam.scene import Scene
from taichi_foam.scene.files import scene_from_toml, scene_to_toml

_FORMAT = 1
# What the readers of csv, npz and json raise on a file that is missing, cut or something else.
_DAMAGE = (
    OSError,
    EOFError,
    ValueError,
    KeyError,
    TypeError,
    csv.Error,
    zipfile.BadZipFile,
    zlib.error,
)
_SNAPSHOT_FIELDS = (
    "time",
    "impactor_y",
    "position",
    "velocity",
    "e_min_a",
    "e_min_b",
    "break_time_a",
    "break_time_b",
)


class Result(Record):
    """A `Record` that measures itself, and can be stored and loaded."""

    @cached_property
    def summary(self) -> dict[str, Any]:
        """Its measures by the keys of summary.json; see `analysis.measures.summary`."""
        from taichi_foam.analysis.measures import summary

        return summary(self)

    @cached_property
    def warnings(self) -> list[str]:
        """Sentences about what makes its figures doubtful; see `analysis.soundness.warnings_of`."""
        from taichi_foam.analysis.soundness import warnings_of

        return warnings_of(self)

    def save(self, folder: str | Path, overwrite: bool = False) -> Path:
        """Write the five files into a new folder, all or nothing, and return its path.

        Raises UserError as `taichi_foam.results.folders.output_folder` does.
        """
        with output_folder(folder, overwrite) as staging:
            self.write(staging)
        return Path(folder)

    def write(self, folder: Path) -> None:
        """Write the five files into an existing folder (one yielded by `output_folder`)."""
        # Here, since measures bring SciPy along, which takes half a second to load.
        from taichi_foam.analysis.fragments import cracks

        (folder / "scene.toml").write_text(scene_to_toml(self.scene), encoding="utf-8")
        _write_history(folder / "history.csv", self.history)
        _write_snapshots(folder / "snapshots.npz", self.snapshots, self.scene)
        paths = cracks(self.snapshots[-1], self.scene.block) if self.snapshots else []
        write_json(folder / "cracks.json", {"polylines_m": paths})
        write_json(folder / "summary.json", {**self.summary, "run": self.run})

    @classmethod
    def load(cls, folder: str | Path) -> Result:
        """Read a folder that `save` wrote. Raises UserError: files missing, damaged or foreign."""
        root = Path(folder)
        if not root.is_dir():
            raise UserError(f"result folder {root}: there is no such folder.")
        scene = scene_from_toml(root / "scene.toml")
        try:
            history = _read_history(root / "history.csv")
            snapshots = _read_snapshots(root / "snapshots.npz", scene)
            run = json.loads((root / "summary.json").read_text(encoding="utf-8"))["run"]
            return cls(scene, history, snapshots, run)
        except _DAMAGE as error:
            raise UserError(
                f"result folder {root}: not a complete result of this version ({error}). "
                f"Fix: run {root / 'scene.toml'} again."
            ) from error


load = Result.load
"""Read a folder that a result was saved to; see `Result.load`."""


def write_json(path: Path, value: Any) -> None:
    """Write JSON, indented; NumPy values become plain ones, and NaN and infinity null."""
    text = json.dumps(plain(value), indent=2, allow_nan=False, ensure_ascii=False)
    path.write_text(text + "\n", encoding="utf-8")


def storage_bytes(scene: Scene) -> int:
    """The most that a run's five files can take (bytes), before compression, frames and films."""
    block, output = scene.block, scene.output
    seconds = scene.numerics.latest_end
    snapshots = seconds / output.snapshot_interval + 2
    rows = seconds / output.history_interval + 2
    doubles = 8 * block.columns * block.rows  # 2 positions, 2 velocities, A and B twice
    return int(8 * doubles * snapshots + 25 * len(HISTORY_COLUMNS) * rows) + 100_000


def plain(value: Any, digits: int | None = None) -> Any:
    """A value that JSON can hold: NumPy's become Python's, what is not finite None.

    `digits` are those that floats keep; default all.
    """
    if isinstance(value, dict):
        return {str(key): plain(item, digits) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(item, digits) for item in value]
    if isinstance(value, (np.generic, np.ndarray)):
        return plain(value.tolist(), digits)
    if isinstance(value, float):
        if not math.isfinite(value):
            return None
        return value if digits is None else float(f"{value:.{digits}g}")
    return value


def _write_history(path: Path, history: History) -> None:
    columns = []
    for name, column in COLUMNS.items():
        # tolist gives Python floats, whose repr is the shortest text that reads back the same.
        values = np.asarray(history[name], dtype=np.float64).tolist()
        columns.append(map(int if column.is_integer else repr, values))
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(HISTORY_COLUMNS)
        writer.writerows(zip(*columns, strict=True))


def _read_history(path: Path) -> History:
    with path.open(newline="", encoding="utf-8") as file:
        header, *rows = csv.reader(file)
    if any(len(row) != len(header) for row in rows):
        raise ValueError("history.csv has a row that is too short or too long")
    table = np.array(rows, dtype=np.float64).reshape(len(rows), len(header))
    return History({name: table[:, k].copy() for k, name in enumerate(header)})


def _field_shapes(scene: Scene) -> dict[str, tuple[int, ...]]:
    """Shape of each array of a snapshot."""
    columns, rows = scene.block.columns, scene.block.rows
    nodes, a, b = (columns, rows, 2), (columns - 1, rows), (columns, rows - 1)
    return dict(zip(_SNAPSHOT_FIELDS, ((), (), nodes, nodes, a, b, a, b), strict=True))


def _write_snapshots(path: Path, snapshots: list[Snapshot], scene: Scene) -> None:
    arrays: dict[str, Any] = {
        name: np.array([getattr(s, name) for s in snapshots], np.float64).reshape(-1, *shape)
        for name, shape in _field_shapes(scene).items()
    }
    np.savez_compressed(path, format=np.int64(_FORMAT), **arrays)


def _read_snapshots(path: Path, scene: Scene) -> list[Snapshot]:
    with np.load(path) as archive:
        if archive["format"] != _FORMAT:
            raise ValueError(f"snapshots.npz has format {archive['format']}, not {_FORMAT}")
        arrays = {name: archive[name] for name in _SNAPSHOT_FIELDS}
    count = len(arrays["time"])
    for name, shape in _field_shapes(scene).items():
        if arrays[name].shape != (count, *shape):
            raise ValueError(f"{name} in snapshots.npz has the shape {arrays[name].shape}")
    return [
        Snapshot(
            float(arrays["time"][n]),
            float(arrays["impactor_y"][n]),
            *(arrays[name][n] for name in _SNAPSHOT_FIELDS[2:]),
        )
        for n in range(count)
    ]
