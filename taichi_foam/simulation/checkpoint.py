"""Checkpoints: the state of a run, stored so that another process can continue it.

A checkpoint is a file, `checkpoint.npz`, in the run's own folder, always replaced as a whole. It
holds the scene, the state of the lattice, and the rows so far. Snapshots are written beside it, to
`snapshots.bin`, as they are recorded; the checkpoint stores how many of them belong to it. A run
continued from a checkpoint equals an uninterrupted run to the last bit, for any number of threads,
alone or in a batch.
"""

from __future__ import annotations

import contextlib
import json
import time
import zipfile
import zlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from taichi_foam.engine.state import RUNNING, State
from taichi_foam.errors import UserError
from taichi_foam.results.files import whole_file
from taichi_foam.results.folders import UNFINISHED, differences, request_in
from taichi_foam.results.manifest import Manifest
from taichi_foam.results.snapshot_file import SnapshotFile
from taichi_foam.scene import Scene
from taichi_foam.scene.files import scene_from_text, scene_to_toml
from taichi_foam.scene.paths import by_key
from taichi_foam.simulation.after import After
from taichi_foam.version import version

FORMAT = 9

CHECKPOINT, SNAPSHOTS = "checkpoint.npz", "snapshots.bin"
"""Names of the two files in a folder of checkpoints."""

EVERY = 60.0
"""Default wall time between two checkpoints, and before the first [s]."""

LARGEST_SHARE = 0.05
"""Largest share of the time spent on writing: checkpoints of large runs are rarer."""

_DAMAGE = (OSError, EOFError, ValueError, KeyError, TypeError, zipfile.BadZipFile, zlib.error)


@dataclass(frozen=True)
class Checkpoint:
    """A run between two calls of the engine.

    arch         device that computes: states of a CPU and of a GPU are laid out differently
    rows         (n, `row_columns`) of the history so far
    snapshots    snapshots so far, on disk
    seconds      wall time that the engine has taken
    node_stages  number of node stages computed
    resumed      how often the run has been continued
    after        the previous run on its block, as in `Record.run`; None on a fresh block
    """

    scene: Scene
    state: State
    arch: str
    rows: NDArray[np.float64]
    snapshots: SnapshotFile
    seconds: float
    node_stages: int
    resumed: int
    after: Mapping[str, Any] | None = None

    def save(self, folder: Path) -> None:
        """Write it into `folder`, which is created if necessary. Raises OSError."""
        folder.mkdir(parents=True, exist_ok=True)
        arrays: dict[str, Any] = {
            "format": FORMAT,
            "version": version(),
            "scene": scene_to_toml(self.scene),
            "arch": self.arch,
            "rows": self.rows,
            "counts": np.array([self.seconds, self.node_stages, self.resumed]),
            "snapshots": len(self.snapshots),
            "after": json.dumps(self.after and dict(self.after)),
            "ended": self.state.clock["status"] != RUNNING,
        }
        self.snapshots.sync()  # the snapshots that the checkpoint counts must be on disk
        arrays |= {f"state.{name}": array for name, array in self.state.to_arrays().items()}
        with whole_file(folder / CHECKPOINT) as partial:
            np.savez(partial, **arrays)

    @staticmethod
    def head(folder: Path) -> tuple[Scene, str, Mapping[str, Any] | None]:
        """Scene, arch and `after` of the checkpoint in `folder`; the rest is not read.

        Raises as `load`.
        """
        with _opened(folder) as archive:
            scene = scene_from_text(str(archive["scene"]), str(folder / CHECKPOINT))
            return scene, str(archive["arch"]), json.loads(str(archive["after"]))

    @classmethod
    def load(cls, folder: Path) -> Checkpoint:
        """Read the checkpoint in `folder`.

        Raises UserError: it is missing or damaged, or was written by another version.
        """
        path = folder / CHECKPOINT
        with _opened(folder) as archive:
            arrays = dict(archive)
            scene = scene_from_text(str(arrays["scene"]), str(path))
            seconds, node_stages, resumed = arrays["counts"].tolist()
            return cls(
                scene=scene,
                state=State.from_arrays(_parts(arrays, "state.")),
                arch=str(arrays["arch"]),
                rows=arrays["rows"],
                snapshots=SnapshotFile(folder / SNAPSHOTS, scene, int(arrays["snapshots"])),
                seconds=seconds,
                node_stages=int(node_stages),
                resumed=int(resumed),
                after=json.loads(str(arrays["after"])),
            )


@contextlib.contextmanager
def _opened(folder: Path) -> Iterator[Any]:
    """The archive of the checkpoint in `folder`. Raises UserError as `Checkpoint.load`."""
    path = folder / CHECKPOINT
    try:
        with np.load(path) as archive:
            written = int(archive["format"]), str(archive["version"])
            if written != (FORMAT, version()):
                raise UserError(
                    f"{path}: written by taichi_foam {written[1]} (format {written[0]}); "
                    f"{version()} (format {FORMAT}) cannot continue it bit for bit. Fix: continue "
                    f"with {written[1]}, or run the scene again."
                )
            yield archive
    except _DAMAGE as error:
        raise UserError(
            f"{path}: not a complete checkpoint ({error}). Fix: remove the file and run the scene "
            "again."
        ) from error


def _parts(arrays: dict[str, Any], prefix: str) -> dict[str, Any]:
    return {
        name.removeprefix(prefix): array
        for name, array in arrays.items()
        if name.startswith(prefix)
    }


def work_in(folder: Path) -> Path:
    """The folder of the checkpoint of the run in `folder`.

    Raises UserError if there is none, with the reason.
    """
    work = folder / UNFINISHED
    if (work / CHECKPOINT).is_file():
        return work
    if not folder.is_dir():
        reason = "there is no such folder. Fix: name the folder of a run"
    elif request_in(folder) is not None:
        reason = (
            "the run in it has not written a checkpoint yet. Fix: run its scene again, as before"
        )
    elif Manifest.read(folder) is not None:
        reason = "the run in it has ended; there is nothing to continue"
    else:
        reason = "holds no checkpoint: nothing to continue. Fix: run the scene again"
    raise UserError(f"{folder}: {reason}.")


class Checkpoints:
    """Where the runs of a batch keep their checkpoints, and when.

    folders  a folder for each scene, in order
    every    wall time between two checkpoints [s], by default EVERY
    """

    def __init__(self, folders: Sequence[Path], every: float | None = None) -> None:
        """Raises UserError if `every` is not above 0."""
        every = EVERY if every is None else every
        if not every > 0:
            raise UserError(
                f"checkpoint interval = {every:g}: must be above 0 s; inf writes one only when a "
                "run is interrupted"
            )
        self.folders, self.every = list(folders), every
        self._next = time.perf_counter() + every

    def has_ended(self, index: int) -> bool:
        """Whether scene number `index` has a checkpoint, and its run had ended.

        Raises UserError: it is damaged, or from another version.
        """
        folder = self.folders[index]
        if not (folder / CHECKPOINT).is_file():
            return False
        with _opened(folder) as archive:
            return bool(archive["ended"])

    def stored(
        self, index: int, scene: Scene, arch: str, after: After | None = None
    ) -> Checkpoint | None:
        """The checkpoint of scene number `index`, None if there is none.

        Raises UserError: it is damaged, or from another version, scene, block or kind of device.
        """
        folder = self.folders[index]
        if not (folder / CHECKPOINT).is_file():
            return None
        found = Checkpoint.load(folder)
        if found.scene != scene:
            first, *_ = differences(by_key(found.scene.model_dump()), by_key(scene.model_dump()))
            raise UserError(
                f"{folder / CHECKPOINT}: belongs to another scene, with {first}. Fix: choose "
                "another folder, or remove the file."
            )
        states = [told and told["state_sha256"] for told in (found.after, after and after.told)]
        if states[0] != states[1]:
            raise UserError(
                f"{folder / CHECKPOINT}: belongs to a run that started on a block in another "
                "state. Fix: choose another folder, or remove the file."
            )
        if (found.arch == "cpu") != (arch == "cpu"):
            raise UserError(
                f"{folder / CHECKPOINT}: was computed on {found.arch}; {arch} cannot continue it "
                f"bit for bit. Fix: continue with arch='{found.arch}'."
            )
        return found

    def snapshots(self, index: int, scene: Scene) -> SnapshotFile:
        """The file for snapshots of scene number `index`, whose run begins. Raises OSError."""
        folder = self.folders[index]
        folder.mkdir(parents=True, exist_ok=True)
        return SnapshotFile(folder / SNAPSHOTS, scene)

    def are_due(self) -> bool:
        """Whether it is time for the next checkpoints."""
        return time.perf_counter() >= self._next

    def save(self, checkpoints: Sequence[tuple[int, Checkpoint]]) -> None:
        """Write checkpoints, each with its scene's number. Disk errors do not stop the run."""
        start = time.perf_counter()
        for index, checkpoint in checkpoints:
            with contextlib.suppress(OSError):  # the run itself matters more
                checkpoint.save(self.folders[index])
        now = time.perf_counter()
        self._next = now + max(self.every, (now - start) / LARGEST_SHARE)
