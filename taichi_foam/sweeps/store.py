"""The folder of a sweep: what is on disk, and whether it belongs to a plan.

    sweep.json       the plan, its hash, and what it is computed with; it marks the folder
    chunks/          a Parquet file for each chunk that is complete: its drops' rows; the name says
                     which is the first of them, and which the last
    histories/       the same of their histories, if the plan keeps them
    runs/            whole results of chosen drops, each a folder
    lost/            reasons, for chunks that could not be computed
    results.parquet, results.csv
                     all rows in one table, as of the last time that the sweep ended

A chunk is complete when its file is in `chunks/`: that one is written last, and all files appear
whole under their names. Chunks may overlap, as when a worker of a cluster has gone on after its
client; their rows are then the same.
"""

from __future__ import annotations

import contextlib
import json
import os
import re
import shutil
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

from taichi_foam.errors import UserError
from taichi_foam.results.files import LEFTOVER, whole_file, write_json
from taichi_foam.results.locks import LOCK, is_locked, locked
from taichi_foam.sweeps.plan import Plan
from taichi_foam.sweeps.sampling import Design
from taichi_foam.sweeps.table import Shard
from taichi_foam.version import version

MARK = "sweep.json"
SCRATCH = ".workers"
"""Name of the folder in which workers keep what they need while they live."""

_CHUNK = re.compile(r"(\d{8})-(\d{8})")

CHUNKS, HISTORIES, RUNS, LOST = "chunks", "histories", "runs", "lost"
_FORMAT = 2


@dataclass(frozen=True)
class Store:
    """The folder of a sweep, and its plan."""

    folder: Path
    plan: Plan
    points: str
    made_with: dict[str, str]

    @classmethod
    def open(cls, folder: str | Path) -> Store:
        """The sweep in a folder. Raises UserError: there is none, or it is damaged."""
        root = Path(folder)
        mark = root / MARK
        try:
            data = json.loads(mark.read_text(encoding="utf-8"))
            if data["format"] != _FORMAT:
                raise ValueError(
                    f"format {data['format']}; Fix: read its results.parquet or results.csv, and "
                    "compute it anew in another folder"
                )
            plan = Plan.checked(data["plan"], str(mark))
            return cls(root, plan, data["points"], dict(data["made_with"]))
        except FileNotFoundError:
            raise UserError(f"{root}: no folder of a sweep; it has no {MARK}") from None
        except (OSError, ValueError, KeyError, TypeError, RecursionError) as error:
            raise UserError(f"{mark}: damaged, or of another version ({error})") from None

    @cached_property
    def design(self) -> Design:
        return Design(self.plan)

    def check_versions(self) -> None:
        """Refuse to compute with other versions than those that it was begun with, as UserError."""
        for name, here in versions(self.made_with["arch"]).items():
            was = self.made_with.get(name)
            if was != here:
                raise UserError(
                    f"{self.folder}: it was begun with {name} {was}, and this is {here}: the "
                    "numbers would not belong together. Fix: choose another folder, or continue "
                    f"it with {name} {was}."
                )
        if self.points != self.design.fingerprint:
            raise UserError(
                f"{self.folder}: the plan's values come out otherwise here than where it was "
                "begun. Fix: continue it with the NumPy and SciPy that it was begun with."
            )

    def chunk_file(self, chunk: range) -> Path:
        return self.folder / CHUNKS / f"{_name(chunk)}.parquet"

    def history_file(self, chunk: range) -> Path:
        return self.folder / HISTORIES / f"{_name(chunk)}.parquet"

    def run_folder(self, number: int) -> Path:
        return self.folder / RUNS / f"{number:08d}"

    def lost_file(self, chunk: range) -> Path:
        return self.folder / LOST / f"{_name(chunk)}.txt"

    def finished(self) -> list[range]:
        """The chunks that are complete, in order."""
        return _chunks(self.folder / CHUNKS, ".parquet")

    def shards(self) -> list[Shard]:
        """Where the rows of all chunks that are complete are, each drop's once, in order."""
        found, end = [], 0
        for chunk in self.finished():
            if chunk.stop > end:
                found.append(Shard(self.chunk_file(chunk), max(0, end - chunk.start)))
                end = chunk.stop
        return found

    def lost(self) -> dict[range, str]:
        """Why members could not be computed that are still missing."""
        if not (noted := _chunks(self.folder / LOST, ".txt")):
            return {}
        missing = self.missing()
        found: dict[range, str] = {}
        end = 0  # notes may overlap, as chunks may
        for chunk in noted:
            reason = self.lost_file(chunk).read_text(encoding="utf-8").strip()
            for row in missing:
                both = range(max(row.start, chunk.start, end), min(row.stop, chunk.stop))
                if both:
                    found[both] = reason
            end = max(end, chunk.stop)
        return found

    def missing(self) -> list[range]:
        """Rows of members that are yet to be computed, those that were lost once among them."""
        found, end = [], 0
        for chunk in [*self.finished(), range(len(self.design), len(self.design))]:
            if chunk.start > end:
                found.append(range(end, chunk.start))
            end = max(end, chunk.stop)
        return found

    def forget_lost(self) -> None:
        """Remove the notes of chunks that were lost once and have been computed since."""
        missing = self.missing()
        for chunk in _chunks(self.folder / LOST, ".txt"):
            if not any(row.start < chunk.stop and chunk.start < row.stop for row in missing):
                self.lost_file(chunk).unlink(missing_ok=True)

    def drop_damaged(self) -> list[range]:
        """Remove chunks that cannot be read, as a crash of the machine may leave them."""
        import pyarrow as pa
        import pyarrow.parquet as pq

        damaged = []
        for chunk in self.finished():
            paths = [self.chunk_file(chunk)]
            if self.plan.keep.histories != "none":
                paths.append(self.history_file(chunk))
            try:
                for path in paths:
                    pq.read_metadata(path)
            except (OSError, pa.ArrowException):
                self.chunk_file(chunk).unlink()
                damaged.append(chunk)
        return damaged

    def lose(self, chunk: range, reason: str) -> None:
        """Note that a chunk could not be computed, and why."""
        path = self.lost_file(chunk)
        path.parent.mkdir(exist_ok=True)
        with whole_file(path) as partial:
            partial.write_text(reason + "\n", encoding="utf-8")

    @property
    def is_at_work(self) -> bool:
        """Whether a process computes it now."""
        return is_locked(self.folder)


@contextlib.contextmanager
def claimed(folder: Path, plan: Plan, arch: str) -> Iterator[Store]:
    """The folder of a sweep for as long as the block computes in it; nobody else does then.

    What a killed sweep has left under temporary names is removed.

    Raises UserError: somebody is at work in it, it holds something else, or another sweep (the
    message says in what they differ).
    """
    if folder.exists() and not folder.is_dir():
        raise UserError(f"{folder}: that is a file. Fix: choose another folder.")
    if folder.is_dir() and not (folder / MARK).exists():
        found = sorted(p.name for p in folder.iterdir() if not _is_ours_before_the_mark(p))
        if found:
            raise UserError(
                f"{folder}: it is not empty and no sweep's ({MARK} is missing). "
                "Fix: choose another folder."
            )
    made = [path for path in (folder, *folder.parents) if not path.exists()]
    folder.mkdir(parents=True, exist_ok=True)
    try:
        with locked(folder):
            if (folder / MARK).exists():
                store = Store.open(folder)
                _check_same(store, plan, arch)
                store = replace(store, plan=plan)  # which may deal its drops out otherwise
            else:
                store = Store(folder, plan, Design(plan).fingerprint, versions(arch))
                with whole_file(folder / MARK) as partial:
                    write_json(
                        partial,
                        {
                            "format": _FORMAT,
                            "hash": plan.hash,
                            "members": plan.count,
                            "made_with": store.made_with,
                            "points": store.points,
                            "plan": plan.data(),
                        },
                    )
            _remove_leftovers(folder)
            (folder / CHUNKS).mkdir(exist_ok=True)
            try:
                yield store
            finally:
                _remove_leftovers(folder)
                with contextlib.suppress(OSError):  # one that is open cannot be removed everywhere
                    (folder / LOCK).unlink()
    finally:
        # An empty folder that was made for this goes again; one with a sweep in it stays.
        if not (folder / MARK).exists():
            for path in made:
                with contextlib.suppress(OSError):
                    path.rmdir()


def versions(arch: str) -> dict[str, str]:
    """What the numbers of a sweep hang on besides its plan."""
    from taichi_foam import backend  # takes long to load

    return {
        "taichi_foam": version(),
        "taichi": backend.version(),
        "arch": arch,
    }


def _check_same(store: Store, plan: Plan, arch: str) -> None:
    """Refuse to continue a sweep with another plan or another version."""
    changed = plan.differences(store.plan.data())
    if changed:
        listed = "\n".join(f"  {line}" for line in changed)
        raise UserError(
            f"{store.folder}: it holds a sweep of another plan:\n{listed}\n"
            "Fix: choose another folder, or go back to that plan."
        )
    if store.made_with["arch"] != arch:
        raise UserError(
            f"{store.folder}: it is computed on {store.made_with['arch']}. "
            "Fix: choose that, or another folder."
        )
    store.check_versions()


def _name(chunk: range) -> str:
    """What the files of a chunk are called: by its first member and its last."""
    return f"{chunk[0]:08d}-{chunk[-1]:08d}"


def _chunks(folder: Path, suffix: str) -> list[range]:
    """The chunks that a folder has files of, in order."""
    if not folder.is_dir():
        return []
    with os.scandir(folder) as entries:
        found = [_CHUNK.fullmatch(e.name.removesuffix(suffix)) for e in entries]
    rows = [range(int(each[1]), int(each[2]) + 1) for each in found if each]
    return sorted(rows, key=lambda row: (row.start, row.stop))


def _remove_leftovers(folder: Path) -> None:
    """Remove what killed processes were writing."""
    runs = folder / RUNS
    places = [folder, *(folder / name for name in (CHUNKS, HISTORIES, LOST))]
    places += runs.iterdir() if runs.is_dir() else []
    for place in places:
        for path in place.iterdir() if place.is_dir() else ():
            if path.name == SCRATCH or LEFTOVER.match(path.name):
                if path.is_dir():
                    shutil.rmtree(path, ignore_errors=True)
                else:
                    path.unlink(missing_ok=True)


def _is_ours_before_the_mark(path: Path) -> bool:
    """Whether a sweep that was killed before it had marked its folder may have left it."""
    return path.name == LOCK or bool(LEFTOVER.match(path.name))
