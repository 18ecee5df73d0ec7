"""One task of a sweep: a chunk of drops, computed and written where the worker is.

`compute_chunk` runs in whatever process the scheduler chose. Nothing travels back.
"""

from __future__ import annotations

import functools
import socket
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

from taichi_foam.errors import UserError
from taichi_foam.records.ending import Ending
from taichi_foam.records.record import Record
from taichi_foam.results.folders import UNFINISHED
from taichi_foam.results.manifest import MANIFEST
from taichi_foam.results.result import Result
from taichi_foam.scene import Scene
from taichi_foam.simulation import simulate
from taichi_foam.sweeps import table
from taichi_foam.sweeps.sampling import Member
from taichi_foam.sweeps.store import Store

Solve = Callable[[Sequence[Scene]], Iterable[tuple[int, Result]]]
"""Computes scenes, and gives each one's place and result as it ends."""


@dataclass(frozen=True)
class Engine:
    """`simulate_many` on a device; it can be sent to other processes.

    Raises UserError as `simulate_many`.
    """

    arch: str
    threads: int | None

    def __call__(self, scenes: Sequence[Scene]) -> Iterable[tuple[int, Result]]:
        return simulate.simulate_many(scenes, arch=self.arch, threads=self.threads)


def compute_chunk(folder: str, plan_hash: str, chunk: range, solve: Solve) -> None:
    """Compute some members of the sweep in a folder and write them, complete or not at all.

    A drop that fails, or whose values make no scene, has a row with the reason.

    Raises:
        UserError: the folder is not seen from here, or not by the same versions.
        OSError: it cannot be written.
    """
    store = _opened(folder, plan_hash)
    members: list[Member] = []
    rows: dict[int, dict[str, Any]] = {}
    for number in chunk:
        try:
            members.append(store.design.member(number))
        except UserError as error:
            rows[number] = table.row_without_scene(store.design, number, str(error))
    kept = store.plan.keep
    histories: dict[int, Record] = {}
    seconds = 0.0
    for place, result in solve([member.scene for member in members]):
        if result.ending is Ending.INTERRUPTED:
            raise KeyboardInterrupt
        begun = time.perf_counter()
        member = members[place]
        rows[member.number] = table.row(member, result)
        if kept.histories != "none":
            histories[member.number] = result
        if kept.full == "all" or member.number in kept.full:
            _save(store, member.number, result)
        seconds += _share(result) + time.perf_counter() - begun
    if len(rows) < len(chunk):
        raise RuntimeError("the solver has not given a result for every scene")
    if kept.histories != "none":
        table.write_histories(store.history_file(chunk), histories, kept.histories)
    table.write_rows(store.chunk_file(chunk), [rows[number] for number in sorted(rows)], seconds)
    store.lost_file(chunk).unlink(missing_ok=True)


def _share(result: Result) -> float:
    """What a drop has taken of a chunk's time [s], without what its kernels took to compile."""
    return result.run.get("wall_s", 0.0) / result.run.get("batch", 1)


@functools.lru_cache(maxsize=1)
def _opened(folder: str, plan_hash: str) -> Store:
    """The sweep, read from its folder once in each process."""
    store = Store.open(folder)
    if store.plan.hash != plan_hash:
        raise UserError(f"{folder}: {socket.gethostname()} sees another sweep there")
    store.check_versions()
    return store


def _save(store: Store, number: int, result: Result) -> None:
    """Keep a whole result; one that a killed chunk had saved has the same bits already."""
    folder = store.run_folder(number)
    if not (folder / MANIFEST).is_file() or (folder / UNFINISHED).exists():
        result.save(folder, overwrite=True)
