"""This engine as a subject, inside a worker process: its own calls, without `simulation`'s loop."""

from __future__ import annotations

import time
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Any

import numpy as np
import taichi as ti

from taichi_foam.engine import loading, stepper
from taichi_foam.engine.lattice import RUNNING, Lattice, borrowed
from taichi_foam.scene import Scene
from taichi_foam.shim2000.tests import paper_scene

from .subjects import Subject

SECONDS = 0.3  # a measurement of few steps takes about this
LEAST_STEPS = 3
BYTES = {"f32": 4, "f64": 8}
ALL = 1_000_000  # steps: as far as the lattice's pause


@dataclass
class Measurement:
    """What one measurement gave."""

    wall: float  # s
    cpu: float | None  # s, of all threads of the process
    node_stages: float
    simulated: float  # s, of one lattice; lattices of a batch add up


def better_steps(steps: int, took: float) -> int:
    """Steps of the next measurement, that it takes about SECONDS."""
    return max(LEAST_STEPS, round(steps * SECONDS / took))


class Loaded:
    """One lattice or batch on the device, and how far it has come."""

    def __init__(self, stack: ExitStack, batch: int, counts: tuple[int, int]) -> None:
        self.lattice: Lattice = stack.enter_context(borrowed(batch, *counts))
        self._advance = stepper.advance_of(self.lattice)
        self.standing: dict[str, np.ndarray] = {}
        self.holds = ""

    def start(self, scene: Scene, name: str) -> None:
        """Set all lattices to the start of the scene."""
        for b in range(self.lattice.batch):
            loading.load(self.lattice, b, scene)
            stepper.prepare(self.lattice, b)
        self.holds = name
        self.standing, _ = loading.harvest(self.lattice)

    def run_to(self, moment: float) -> Measurement:
        """Step all lattices to a simulated time."""
        loading.set_pause(self.lattice, np.full(self.lattice.batch, moment))
        return self._timed(ALL)

    def run_steps(self, steps: int) -> Measurement:
        """Step all lattices `steps` times."""
        loading.set_pause(self.lattice, np.full(self.lattice.batch, 1e30))
        return self._timed(steps)

    def _timed(self, steps: int) -> Measurement:
        before = self.standing
        ti.sync()
        cpu, wall = time.process_time(), time.perf_counter()
        self._advance(self.lattice, steps)
        ti.sync()
        wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
        self.standing, _ = loading.harvest(self.lattice)
        taken = (self.standing["steps"] - before["steps"]).sum()
        simulated = (self.standing["time"] - before["time"]).sum()
        return Measurement(wall, cpu, 4.0 * self.lattice.nodes * taken, simulated)


class Engine:
    """The lattices of one worker, each made when something first needs it."""

    def __init__(self) -> None:
        self._stack = ExitStack()
        self._lattices: dict[tuple, Loaded] = {}
        self._steps: dict[str, int] = {}

    def _loaded(self, batch: int, counts: tuple[int, int]) -> Loaded:
        key = (batch, counts)
        if key not in self._lattices:
            self._lattices[key] = Loaded(self._stack, batch, counts)
        return self._lattices[key]

    def prepare(self, subject: Subject) -> None:
        """Compile, and bring the subject where measurements begin."""
        loaded = self._loaded(subject.batch, subject.counts)
        self._begin(loaded, subject)
        if not subject.span:
            self._steps[subject.key] = better_steps(1, loaded.run_steps(1).wall)

    def _begin(self, loaded: Loaded, subject: Subject) -> None:
        loaded.start(subject.scene(), subject.key)
        if subject.span:
            loaded.run_to(subject.start)
        else:
            loaded.run_steps(2)  # the first writes a row and lists neighbours

    def measure(self, subject: Subject) -> Measurement:
        """One measurement, after going back to the start if need be."""
        loaded = self._loaded(subject.batch, subject.counts)
        if loaded.holds != subject.key:
            self._begin(loaded, subject)
        if not subject.span:
            steps = self._steps[subject.key]
            result = loaded.run_steps(steps)
            self._steps[subject.key] = better_steps(steps, result.wall)
            return result
        end = float(loaded.standing["time"].max()) + subject.span
        if end > subject.until + 0.5 * subject.span:
            self._begin(loaded, subject)
            end = subject.start + subject.span
        return loaded.run_to(end)

    def whole(self, case: str, contact: bool) -> Measurement:
        """A whole run of a paper test on one lattice."""
        scene = paper_scene(case)
        model = scene.model.model_copy(update={"self_contact": contact})
        loaded = self._loaded(1, (scene.block.columns, scene.block.rows))
        loaded.start(scene.model_copy(update={"model": model}), f"{case} {contact}")
        total = Measurement(0.0, 0.0, 0.0, 0.0)
        while loaded.standing["status"][0] == RUNNING:  # calls end with a full history
            call = loaded.run_to(1.0)
            total = Measurement(
                total.wall + call.wall, (total.cpu or 0.0) + (call.cpu or 0.0),
                total.node_stages + call.node_stages, total.simulated + call.simulated,
            )  # fmt: skip
        loaded.holds = ""
        return total

    def snapshot(self, subject: Subject) -> dict[str, float]:
        """What a snapshot of a subject's lattice takes [s], and what lies between two of them."""
        loaded = self._loaded(subject.batch, subject.counts)
        if loaded.holds != subject.key:
            self._begin(loaded, subject)
        walls = []
        for _ in range(4):
            start = time.perf_counter()
            loading.snapshot(loaded.lattice, 0)
            walls.append(time.perf_counter() - start)
        interval = subject.scene().output.snapshot_interval
        return {
            "wall": float(np.median(walls[1:])),  # the first compiles
            "steps": interval / float(loaded.standing["longest"][0]),
        }

    def traffic(self, subject: Subject) -> float:
        """Bytes per node and stage that a lattice beyond the caches has to move.

        Counted from the fields as they are: each stage reads the trial and the accepted state and
        the bonds, reads and writes the weighted sums, and writes the trial state; a step's
        first stage writes the bonds' history too, its last the accepted state.
        """
        lattice = self._loaded(subject.batch, subject.counts).lattice
        motion, rate = self._bytes(lattice.state), self._bytes(lattice.rate)
        bonds = sum(self._bytes(bond) for bond in lattice.bonds)
        return 3 * motion + bonds + 2 * rate + (bonds + motion) / 4

    @staticmethod
    def _bytes(record: Any) -> int:
        """Of one node in a record of packs: each member holds a number for every node."""
        return sum(BYTES[str(record.get_member_field(name).dtype)] for name in record.keys)


def resident() -> int:
    """Memory of this process that is in use [bytes]."""
    try:
        with open("/proc/self/statm", encoding="ascii") as file:
            return int(file.read().split()[1]) * 4096
    except OSError:  # no Linux: the most that ever was
        import resource

        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


def stepped(subject: Subject) -> int:
    """Memory in use [bytes] once a subject's lattice is loaded and has stepped."""
    with ExitStack() as stack:
        loaded = Loaded(stack, subject.batch, subject.counts)
        loaded.start(subject.scene(), subject.key)
        loaded.run_steps(LEAST_STEPS)
        return resident()
