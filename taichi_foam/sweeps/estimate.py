"""What a sweep will take: time, from a short trial, and room on the disk."""

from __future__ import annotations

import os
import shutil
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from taichi_foam.errors import UserError
from taichi_foam.records.history import HISTORY_COLUMNS
from taichi_foam.results.result import storage_bytes
from taichi_foam.scene import Scene
from taichi_foam.sweeps.chunk import Solve
from taichi_foam.sweeps.dealing import chunks_at_most
from taichi_foam.sweeps.plan import Plan, work
from taichi_foam.sweeps.sampling import Design
from taichi_foam.sweeps.store import MARK
from taichi_foam.units import si_scale

# Members that are looked at for a mean.
_LOOKED_AT = 200

# A row in its shard, in results.parquet and in results.csv; a shard besides its rows [bytes].
_ROW, _SHARD = 2_000, 40_000


@dataclass(frozen=True)
class Estimate:
    """What a sweep needs: drops, bytes on disk; seconds on one core, if they were tried."""

    drops: int
    bytes: int
    core_seconds: float | None = None


def room(design: Design) -> Estimate:
    """How many drops a sweep has, and how much disk it takes at most (before compression)."""
    plan, size = design.plan, 0.0
    some = _some(design, _LOOKED_AT)
    if plan.keep.histories != "none":
        width = 4 if plan.keep.histories == "float32" else 8
        rows = np.mean([s.numerics.latest_end / s.output.history_interval + 2 for s in some])
        size += len(design) * rows * (8 + width * len(HISTORY_COLUMNS))
    full = len(design) if plan.keep.full == "all" else len(plan.keep.full)
    size += full * float(np.mean([storage_bytes(scene) for scene in some]))
    size += _ROW * len(design) + _SHARD * chunks_at_most(design)
    return Estimate(len(design), int(size))


def trial(design: Design, solve: Solve, on_drop: Callable[[], None], drops: int = 2) -> Estimate:
    """The same, and how long it takes: from a few drops, taken to last as their scenes' work says.

    `solve` is called for each of the drops alone. A first call is not counted: kernels compile.
    """
    found = room(design)
    chosen = _some(design, drops)
    paces = []
    for count, scene in enumerate([chosen[0], *chosen]):
        begun = time.perf_counter()
        for _, result in solve([scene]):
            _ = result.summary
        if count:
            paces.append((time.perf_counter() - begun) / work(scene))
            on_drop()
    mean = float(np.mean([work(scene) for scene in _some(design, _LOOKED_AT)]))
    seconds = len(design) * mean * float(np.mean(paces))
    return Estimate(found.drops, found.bytes, seconds)


def check_room(folder: Path, plan: Plan) -> None:
    """Refuse a sweep that the disk cannot hold, as UserError. What is there of it counts."""
    found = room(Design(plan))
    place = next(path for path in (folder, *folder.parents) if path.is_dir())
    there = bytes_in(folder) if (folder / MARK).is_file() else 0
    free = shutil.disk_usage(place).free + there
    if free < found.bytes:
        raise UserError(
            f"{folder}: the sweep needs about {size_text(found.bytes)}, but the disk has "
            f"{size_text(free)} free. Fix: free some space, choose another disk, or keep less."
        )


def bytes_in(folder: Path) -> int:
    """What a folder takes on disk."""
    return sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())


def size_text(count: float) -> str:
    """A number of bytes for people."""
    scale, prefix = si_scale(count, least=0, digits=3)
    return f"{count / scale:.3g} {prefix}B"


def cores(workers: int | None, threads: int | None) -> int:
    """How many cores of this machine compute."""
    here = os.cpu_count() or 1
    return min(here, (workers or 1) * (threads or (1 if workers else here)))


def _some(design: Design, most: int) -> list[Scene]:
    """Scenes of members, spread evenly; those that cannot be are left out."""
    numbers = np.unique(np.linspace(0, len(design) - 1, min(most, len(design))).astype(int))
    scenes = []
    for number in numbers:
        try:
            scenes.append(design.member(int(number)).scene)
        except UserError:
            continue
    if not scenes:
        design.member(0)  # says what is wrong with it
    return scenes
