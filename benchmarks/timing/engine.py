"""The engine as the benchmarks see it: all that they know of its insides, but for parts.py.

`Loaded` is a lattice or a batch that takes steps. The rest is a subject inside a worker process.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from contextlib import ExitStack
from typing import Any

import numpy as np
import taichi as ti
from taichi.lang.util import to_numpy_type

from taichi_foam.engine import runtime, transfer
from taichi_foam.engine.features import features_of
from taichi_foam.engine.lattice import borrowed
from taichi_foam.engine.state import RUNNING
from taichi_foam.records.snapshot import Snapshot
from taichi_foam.scene import Scene

from .subjects import Extent, Measurement, Subject, better_steps, scene_with, updated

ALL = 1_000_000  # steps: as far as the lattice's pause

start_taichi, settings = runtime.start, runtime.settings


class Loaded:
    """One lattice or batch on the device, for scenes like one, and how far it has come."""

    def __init__(self, stack: ExitStack, batch: int, scene: Scene) -> None:
        counts = (scene.block.columns, scene.block.rows)
        self._lattice = stack.enter_context(borrowed(batch, *counts, features_of(scene)))
        self._advance = transfer.advance_of(self._lattice)
        self._standing: dict[str, np.ndarray] = {}
        self.batch, self.nodes = batch, counts[0] * counts[1]
        self.holds = ""

    def start(self, scenes: Sequence[Scene], name: str = "") -> None:
        """Set each lattice to the start of its scene."""
        for b, scene in enumerate(scenes):
            transfer.load(self._lattice, b, scene)
        self.holds = name
        self._standing, _ = transfer.harvest(self._lattice)

    @property
    def time(self) -> float:
        """Simulated time [s] of the lattice that is furthest."""
        return float(self._standing["time"].max())

    @property
    def is_running(self) -> bool:
        """Whether the first lattice has not come to its end."""
        return bool(self._standing["status"][0] == RUNNING)

    @property
    def longest_step(self) -> float:
        """The longest step of the first lattice so far [s]."""
        return float(self._standing["longest"][0])

    def run_to(self, moment: float) -> Measurement:
        """Step all lattices to a simulated time [s], or until a history is full."""
        transfer.set_pause(self._lattice, np.full(self.batch, moment))
        return self._timed(ALL)

    def run_steps(self, steps: int) -> Measurement:
        """Step all lattices `steps` times."""
        transfer.set_pause(self._lattice, np.full(self.batch, 1e30))
        return self._timed(steps)

    def snapshot(self) -> Snapshot:
        """The first lattice's state, copied from the device."""
        return transfer.snapshot(self._lattice, 0)

    def bytes_per_node_stage(self) -> float:
        """What a stage of a lattice beyond the caches has to move, by node.

        Counted from the fields as they are: each stage reads the trial and the accepted state, the
        bonds and what cells carry, reads and writes the weighted sums, and writes the trial state;
        a step's first stage writes the bonds' history too, its last the accepted state. Then the
        bonds are read once more, for the cells between them.
        """
        state = self._lattice.state
        motion, rate = _bytes(state.motion), _bytes(state.increment)
        bonds, cells = sum(_bytes(bond) for bond in state.bonds), _item(state.grip.dtype)
        return 3 * motion + bonds + cells + 2 * rate + (2 * bonds + motion) / 4

    def _timed(self, steps: int) -> Measurement:
        before = self._standing
        ti.sync()
        cpu, wall = time.process_time(), time.perf_counter()
        self._advance(self._lattice, steps)
        ti.sync()
        wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
        self._standing, _ = transfer.harvest(self._lattice)
        taken = (self._standing["steps"] - before["steps"]).sum()
        simulated = (self._standing["time"] - before["time"]).sum()
        return Measurement(wall, cpu, float(4.0 * self.nodes * taken), float(simulated))


def _bytes(record: Any) -> int:
    """Of one node in a record of packs: each member holds a number for every node."""
    return sum(_item(record.get_member_field(name).dtype) for name in record.keys)


def _item(kind: Any) -> int:
    return np.dtype(to_numpy_type(kind)).itemsize


class Engine:
    """The lattices of one worker, each made when something first needs it."""

    def __init__(self) -> None:
        self._stack = ExitStack()
        self._lattices: dict[tuple, Loaded] = {}
        self._steps: dict[str, int] = {}

    def _loaded(self, batch: int, scene: Scene) -> Loaded:
        key = (batch, (scene.block.columns, scene.block.rows), features_of(scene))
        if key not in self._lattices:
            self._lattices[key] = Loaded(self._stack, batch, scene)
        return self._lattices[key]

    def _holding(self, subject: Subject) -> Loaded:
        """The subject's lattice, at least where its measurements begin."""
        loaded = self._loaded(subject.batch, subject.scene())
        if loaded.holds != subject.key:
            self._begin(loaded, subject)
        return loaded

    def _begin(self, loaded: Loaded, subject: Subject) -> None:
        loaded.start(subject.scenes(), subject.key)
        if subject.span:
            loaded.run_to(subject.start)
        else:
            loaded.run_steps(2)  # the first writes a row and lists neighbours

    def prepare(self, subject: Subject) -> None:
        """Compile, and bring the subject where measurements begin."""
        loaded = self._holding(subject)
        if not subject.span:
            wall = loaded.run_steps(1).wall
            self._steps[subject.key] = better_steps(1, wall, subject.seconds)

    def measure(self, subject: Subject) -> Measurement:
        """One measurement, after going back to the start if need be."""
        loaded = self._holding(subject)
        if not subject.span:
            steps = self._steps[subject.key]
            result = loaded.run_steps(steps)
            self._steps[subject.key] = better_steps(steps, result.wall, subject.seconds)
            return result
        end = loaded.time + subject.span
        if end > 2.0 * subject.start + 0.5 * subject.span:
            self._begin(loaded, subject)
            end = subject.start + subject.span
        return loaded.run_to(end)

    def whole(self, case: str, extent: Extent, end: float | None) -> Measurement:
        """A whole run of a paper test on one lattice, or its first `end` seconds."""
        scene = scene_with("calibrated", case, extent)
        if end is not None:
            scene = updated(scene, {"numerics": {"end": end}})
        loaded = self._loaded(1, scene)
        loaded.start([scene])
        loaded.run_steps(1)  # an extent that nothing else is timed for compiles here
        loaded.start([scene])
        total = Measurement(0.0, 0.0, 0.0, 0.0)
        while loaded.is_running:  # calls end with a full history
            total += loaded.run_to(1.0)
        return total

    def snapshot(self, subject: Subject) -> dict[str, float]:
        """What a snapshot of a subject's lattice takes [s], and what lies between two of them."""
        loaded = self._holding(subject)
        walls = []
        for _ in range(4):
            start = time.perf_counter()
            loaded.snapshot()
            walls.append(time.perf_counter() - start)
        interval = subject.scene().output.snapshot_interval
        return {
            "wall": float(np.median(walls[1:])),  # the first compiles
            "steps": interval / loaded.longest_step,
        }

    def traffic(self, subject: Subject) -> float:
        """Bytes per node and stage that the subject's lattice has to move."""
        return self._loaded(subject.batch, subject.scene()).bytes_per_node_stage()
