"""Snapshots of a run in progress: appended to one file, read back one at a time.

A run of millions of mass points has more snapshots than fit into memory. Each snapshot is a record
of fixed size: the bytes of its arrays, in native byte order. The file is for work in progress on
one machine; a result has its snapshots in `snapshots.npz`.
"""

from __future__ import annotations

import mmap
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, overload

import numpy as np
from numpy.typing import NDArray

from taichi_foam.records.cushion import shapes_of, with_prefix, without_own
from taichi_foam.records.snapshot import Snapshot
from taichi_foam.results.files import synced
from taichi_foam.scene import Scene


def shapes(scene: Scene) -> dict[str, tuple[int, ...]]:
    """Shape of each number and array of a snapshot, in order.

    Stresses are included if the run keeps them. What the bonds of the scene's law remember
    besides their worst strain is `own.NAME`.
    """
    found, block = shapes_of(Snapshot, scene), scene.block
    return found | ({"stress": (block.columns, block.rows, 3)} if scene.output.keeps_stress else {})


def values_of(snapshot: Snapshot) -> dict[str, Any]:
    """The numbers and arrays of a snapshot by name."""
    plain = {name: value for name, value in vars(snapshot).items() if name != "own"}
    return plain | with_prefix(snapshot.own)


def record_type(scene: Scene) -> np.dtype[Any]:
    """Data type of a snapshot of `scene`: scalars in 64 bits, arrays in the scene's precision.

    Stresses, which are used in pictures only, have 32 bits.
    """
    precise = np.float32 if scene.output.snapshot_precision == "single" else np.float64
    kinds = {"stress": np.float32}
    return np.dtype(
        [
            (name, kinds.get(name, precise) if shape else np.float64, shape)
            for name, shape in shapes(scene).items()
        ]
    )


def rounded(snapshot: Snapshot, scene: Scene) -> Snapshot:
    """The snapshot in its scene's precision."""
    if scene.output.snapshot_precision == "double":
        return snapshot
    values = values_of(snapshot)
    arrays = {name: np.float32(values[name]) for name, shape in shapes(scene).items() if shape}
    return snapshot_of({**values, **arrays})


def snapshot_of(values: Mapping[str, Any]) -> Snapshot:
    """A snapshot from its numbers and arrays by name."""
    others, own = without_own(values)
    given: dict[str, Any] = {
        name: each if each is None or np.ndim(each) else float(each)
        for name, each in others.items()
    }
    return Snapshot(**given, own=own)


class _Records:
    """A growing file of records of one type."""

    def __init__(self, path: Path, kind: np.dtype[Any]) -> None:
        self.path, self.kind = path, kind
        self.names = kind.names or ()
        self._mapped: tuple[mmap.mmap, NDArray[Any]] | None = None

    def count(self) -> int:
        """Number of complete records in the file."""
        return self.path.stat().st_size // self.kind.itemsize if self.path.is_file() else 0

    def write(self, place: int, record: NDArray[Any]) -> None:
        """Write the record at index `place`; later records are dropped. Raises OSError."""
        self._mapped = None
        with self.path.open("r+b" if self.path.is_file() else "w+b") as file:
            file.seek(place * self.kind.itemsize)
            file.write(record.view(np.uint8).data)
            file.truncate()

    def read(self, place: int) -> Any:
        """A record; its data is read from disk on access.

        After the first read, all records stay readable even if the file is removed.
        """
        if self._mapped is None:
            with self.path.open("rb") as file:
                mapping = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
            # a disk that was full, or a kill, may have left part of a record at the end
            self._mapped = mapping, np.frombuffer(mapping, self.kind, self.count())
        mapping, records = self._mapped
        if hasattr(mapping, "madvise"):
            # drop pages from memory; they are read from disk again when accessed
            mapping.madvise(mmap.MADV_DONTNEED)
        return records[place]


class SnapshotFile(Sequence[Snapshot]):
    """The snapshots of a run, on disk. None is held in memory."""

    def __init__(self, path: Path, scene: Scene, count: int = 0) -> None:
        """The first `count` snapshots of the file; any later ones are ignored.

        The folder must exist. Raises OSError; ValueError: the file is shorter.
        """
        self._records = _Records(path, record_type(scene))
        self._chosen = range(count)
        if (has := self._records.count()) < count:
            raise ValueError(f"{path.name} holds {has} of {count} snapshots")

    def __len__(self) -> int:
        return len(self._chosen)

    @overload
    def __getitem__(self, index: int) -> Snapshot: ...
    @overload
    def __getitem__(self, index: slice) -> SnapshotFile: ...
    def __getitem__(self, index: int | slice) -> Snapshot | SnapshotFile:
        if isinstance(index, slice):
            part = object.__new__(SnapshotFile)
            part._records, part._chosen = self._records, self._chosen[index]
            return part
        record = self._records.read(self._chosen[index])
        return snapshot_of({name: record[name] for name in self._records.names})

    def append(self, snapshot: Snapshot) -> None:
        """Append a snapshot. Raises OSError; earlier snapshots then stay intact."""
        record = np.zeros(1, self._records.kind)
        values = values_of(snapshot)
        for name in self._records.names:
            record[name] = values[name]
        self._records.write(len(self), record)
        self._chosen = range(len(self) + 1)

    def sync(self) -> None:
        """Flush to disk, so that the data survives a crash of the machine. Raises OSError."""
        if self._records.path.is_file():
            synced(self._records.path)
