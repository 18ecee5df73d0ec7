"""The folder of a sweep: what is on disk, and whether it belongs to a plan.

    sweep.json       the plan, its hash, and the versions it is computed with; marks the folder
    chunks/          a Parquet file with the rows of each complete chunk, named after the first and
                     the last drop
    histories/       likewise their histories, if the plan keeps them
    runs/            whole results of selected drops, each a folder
    lost/            for each chunk that could not be computed, the reason
    results.parquet, results.csv
                     all rows in one table, as of the last time that the sweep ended

A chunk is complete when its file is in `chunks/`: that file is written last, and every file appears
only when complete. Chunks may overlap, as when a cluster's worker has continued after its client
ended; their rows are then the same.
"""

from __future__ import annotations

import contextlib
import json
import re
import shutil
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from taichi_foam.errors import UserError, installed
from taichi_foam.results.files import LEFTOVER, whole_file, write_json
from taichi_foam.results.folders import LOCK, is_locked, locked, made, remove_leftovers
from taichi_foam.results.result import Result
from taichi_foam.simulation import simulate
from taichi_foam.sweeps import table
from taichi_foam.sweeps.plan import Plan
from taichi_foam.sweeps.sampling import Design, Member
from taichi_foam.sweeps.table import Shard
from taichi_foam.version import version

MARK = "sweep.json"
SCRATCH = ".workers"
"""Name of the folder for temporary files of workers."""

_CHUNK = re.compile(r"(\d{8})-(\d{8})")

CHUNKS, HISTORIES, RUNS, LOST = "chunks", "histories", "runs", "lost"
_FORMAT = 2

_TELLING = ("energy_residual", "max_displacement_m", "peak_deceleration_m_s2")
"""If two drops differ at all, at least one of these measures differs."""


@dataclass(frozen=True)
class Standing:
    """The progress of a sweep.

    members  number of members of the plan; each is one drop, or several on one block
    done     members that have a row
    failed   members among these that failed: diverged, or their values make an invalid scene
    lost     members whose chunk could not be computed; the same command tries them again
    at_work  whether a process is computing the sweep now
    """

    members: int
    done: int
    failed: int
    lost: int
    at_work: bool


@dataclass(frozen=True)
class Sweep:
    """A sweep on disk, complete or not: its folder, its plan, and the versions it began with."""

    folder: Path
    plan: Plan = field(repr=False)
    points: str = field(repr=False)
    made_with: dict[str, str]

    @classmethod
    def open(cls, folder: str | Path) -> Sweep:
        """The sweep in a folder. Raises UserError if there is none, or it is damaged."""
        root = Path(folder)
        mark = root / MARK
        try:
            data = json.loads(mark.read_text(encoding="utf-8"))
            if data["format"] != _FORMAT:
                raise ValueError(
                    f"format {data['format']}; Fix: read its results.parquet or results.csv, and "
                    "compute it again in another folder"
                )
            plan = Plan.checked(data["plan"], str(mark))
            return cls(root, plan, data["points"], dict(data["made_with"]))
        except FileNotFoundError:
            raise UserError(f"{root}: is not the folder of a sweep, as it has no {MARK}") from None
        except (OSError, ValueError, KeyError, TypeError, RecursionError) as error:
            raise UserError(f"{mark}: damaged, or written by another version ({error})") from None

    @cached_property
    def design(self) -> Design:
        return Design.of(self.plan)

    def check_versions(self, arch: str | None = None) -> None:
        """Raise UserError if versions, or `arch`, differ from those that the sweep began with."""
        for name, here in versions(arch or self.made_with["arch"]).items():
            was = self.made_with.get(name)
            if was != here:
                raise UserError(
                    f"{self.folder}: was started with {name} = {was}, but this is {here}: the "
                    "results would not be comparable. Fix: choose another folder, or continue it "
                    f"with {name} = {was}."
                )
        if self.points != self.design.fingerprint:
            raise UserError(
                f"{self.folder}: the plan yields other values here than where the sweep was "
                "started. Fix: continue it with the versions of NumPy and SciPy that it was "
                "started with."
            )

    def chunk_file(self, chunk: range) -> Path:
        return self._file(CHUNKS, chunk, ".parquet")

    def history_file(self, chunk: range) -> Path:
        return self._file(HISTORIES, chunk, ".parquet")

    def lost_file(self, chunk: range) -> Path:
        return self._file(LOST, chunk, ".txt")

    def _file(self, name: str, chunk: range, suffix: str) -> Path:
        """The file of a chunk, named after its first and last member."""
        return self.folder / name / f"{chunk[0]:08d}-{chunk[-1]:08d}{suffix}"

    def run_folder(self, number: int) -> Path:
        return self.folder / RUNS / f"{number:08d}"

    def finished(self) -> list[range]:
        """The complete chunks, in order."""
        return _chunks(self.folder / CHUNKS, ".parquet")

    def shards(self) -> list[Shard]:
        """The files of all complete chunks, in order, such that each drop's row is used once."""
        found, end = [], 0
        for chunk in self.finished():
            if chunk.stop > end:
                found.append(Shard(self.chunk_file(chunk), max(0, end - chunk.start)))
                end = chunk.stop
        return found

    def lost(self) -> dict[range, str]:
        """Ranges of missing members that could not be computed, with the reasons."""
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
        """Ranges of members that have yet to be computed, including those lost earlier."""
        found, end = [], 0
        for chunk in [*self.finished(), range(len(self.design), len(self.design))]:
            if chunk.start > end:
                found.append(range(end, chunk.start))
            end = max(end, chunk.stop)
        return found

    def forget_lost(self) -> None:
        """Remove the notes on lost chunks that have been computed since."""
        missing = self.missing()
        for chunk in _chunks(self.folder / LOST, ".txt"):
            if not any(row.start < chunk.stop and chunk.start < row.stop for row in missing):
                self.lost_file(chunk).unlink(missing_ok=True)

    def drop_damaged(self) -> list[range]:
        """Remove and return unreadable chunks, which a crash of the machine may leave."""
        damaged = []
        for chunk in self.finished():
            paths = [self.chunk_file(chunk)]
            if self.plan.keep.has_histories:
                paths.append(self.history_file(chunk))
            try:
                for path in paths:
                    pq.read_metadata(path)
            except (OSError, pa.ArrowException):
                self.chunk_file(chunk).unlink()
                damaged.append(chunk)
        return damaged

    def lose(self, chunk: range, reason: str) -> None:
        """Record that a chunk could not be computed, and why."""
        path = self.lost_file(chunk)
        path.parent.mkdir(exist_ok=True)
        with whole_file(path) as partial:
            partial.write_text(reason + "\n", encoding="utf-8")

    @property
    def notes(self) -> list[str]:
        """Remarks on repeats whose seeds have changed nothing."""
        repeats = self.plan.repeats
        if repeats.count == 1 or repeats.vary != "seed":
            return []
        found = table.read(self.shards(), [table.MEMBER, *_TELLING])
        same = table.same_in_groups(found, repeats.count)
        if not any(same):
            return []
        where = "of all combinations" if all(same) else f"of {sum(same):,} of {len(same):,}"
        where = where if len(same) > 1 else "of the drop"
        return [
            f"repeats.vary = 'seed': the seeds made no difference to the repeats {where}: "
            "scattered strengths matter only where foam breaks or comes close to it. Fix: vary "
            "the velocity"
        ]

    @property
    def standing(self) -> Standing:
        """The progress of the sweep."""
        failures = table.read(self.shards(), ["failure"])
        return Standing(
            members=len(self.design),
            done=len(failures),
            failed=len(failures) - failures["failure"].null_count if len(failures) else 0,
            lost=sum(map(len, self.lost())),
            at_work=is_locked(self.folder),
        )

    def collect(self) -> int:
        """Write results.parquet and results.csv with all rows so far; return the number of rows.

        Raises OSError: they cannot be written.
        """
        more = [
            table.row_without_scene(self.design, number, f"lost: {reason}")
            for chunk, reason in self.lost().items()
            for number in chunk
        ]
        return table.collect(self.shards(), more, self.folder)

    def to_pandas(self) -> Any:
        """The table as a data frame, one row per drop.

        Raises UserError: nothing has been computed yet, or pandas is not installed.
        """
        with installed("a table as a data frame", "pandas"):
            import pandas
        path = self.folder / table.PARQUET
        if not path.is_file():
            raise UserError(f"{self.folder}: has no {table.PARQUET} yet")
        return pandas.read_parquet(path)

    def histories(self, number: int) -> Any:
        """The history of a member as a data frame, if the plan keeps histories.

        Raises UserError: it keeps none, or the member's chunk is not complete.
        """
        with installed("a history as a data frame", "pandas"):
            import pandas
        self._check_number(number)
        chunk = next((each for each in self.finished() if number in each), None)
        path = None if chunk is None else self.history_file(chunk)
        if path is None or not path.is_file():
            raise UserError(
                f"{self.folder}: there is no history of member {number}: it has not been computed "
                "yet, or the plan does not keep histories (keep.histories). Fix: compute it again "
                "in full."
            )
        found = pandas.read_parquet(path, filters=[(table.MEMBER, "==", number)])
        return found.drop(columns=table.MEMBER)

    def traces(self, names: Sequence[str]) -> Iterator[tuple[int, int, list[NDArray[np.float64]]]]:
        """Columns of all histories that are kept; see `table.read_histories`."""
        for chunk in self.finished():
            yield from table.read_histories(self.history_file(chunk), names)

    def again(
        self,
        number: int,
        on_progress: simulate.ProgressCallback | None = None,
        *,
        threads: int | None = None,
    ) -> Result:
        """Compute a member again, with its full result, which equals its row to the last bit.

        Raises UserError: no such member, or versions that differ from the sweep's; RunError as
        `run`.
        """
        scene = self.member(number).scene
        self.check_versions()
        arch = self.made_with["arch"]
        return simulate.run(scene, on_progress, arch=arch, threads=threads)

    def member(self, number: int) -> Member:
        """One drop: its values and its scene. Raises UserError: no such member."""
        self._check_number(number)
        return self.design.member(number)

    def _check_number(self, number: int) -> None:
        if not 0 <= number < len(self.design):
            raise UserError(
                f"member {number}: does not exist; members are numbered 0 to {len(self.design) - 1}"
            )


@contextlib.contextmanager
def claimed(folder: Path, plan: Plan, arch: str) -> Iterator[Sweep]:
    """Lock the folder of a sweep while the block computes in it.

    Temporary files of a killed sweep are removed.

    Raises UserError: another process is at work in it, or it holds something else or another sweep
    (the message says how they differ).
    """
    mark = folder / MARK
    # a sweep that was killed before it had marked the folder has left no other files
    strange = [p for p in folder.glob("*") if p.name != LOCK and not LEFTOVER.match(p.name)]
    if strange and not mark.exists():
        raise UserError(
            f"{folder}: is not empty and does not hold a sweep ({MARK} is missing). Fix: choose "
            "another folder."
        )
    with made(folder), locked(folder):
        try:
            if mark.exists():
                found = Sweep.open(folder)
                _check_same(found, plan, arch)
                found = replace(found, plan=plan)  # its chunks may differ
            else:
                found = Sweep(folder, plan, Design.of(plan).fingerprint, versions(arch))
                told = {
                    "format": _FORMAT,
                    "hash": plan.hash,
                    "members": plan.count,
                    "made_with": found.made_with,
                    "points": found.points,
                    "plan": plan.data(),
                }
                with whole_file(mark) as partial:
                    write_json(partial, told)
            _tidy(folder)
            (folder / CHUNKS).mkdir(exist_ok=True)
            yield found
        finally:
            _tidy(folder)
            with contextlib.suppress(OSError):  # some systems cannot remove an open file
                (folder / LOCK).unlink()


def versions(arch: str) -> dict[str, str]:
    """Versions that the numbers of a sweep depend on besides its plan."""
    from taichi_foam import backend  # takes long to load

    return {
        "taichi_foam": version(),
        "taichi": backend.version(),
        "arch": arch,
    }


def _check_same(found: Sweep, plan: Plan, arch: str) -> None:
    """Raise UserError if a sweep would be continued with another plan or version."""
    changed = plan.differences(found.plan.data())
    if changed:
        listed = "\n".join(f"  {line}" for line in changed)
        raise UserError(
            f"{found.folder}: holds a sweep of another plan:\n{listed}\nFix: choose another "
            "folder, or go back to that plan."
        )
    found.check_versions(arch)


def _chunks(folder: Path, suffix: str) -> list[range]:
    """The chunks that have files in a folder, in order."""
    names = (path.name.removesuffix(suffix) for path in folder.glob(f"*{suffix}"))
    found = (each for name in names if (each := _CHUNK.fullmatch(name)))
    rows = [range(int(each[1]), int(each[2]) + 1) for each in found]
    return sorted(rows, key=lambda row: (row.start, row.stop))


def _tidy(folder: Path) -> None:
    """Remove unfinished files of killed processes."""
    runs = (folder / RUNS).glob("*")
    remove_leftovers([folder, *(folder / name for name in (CHUNKS, HISTORIES, LOST)), *runs])
    shutil.rmtree(folder / SCRATCH, ignore_errors=True)
