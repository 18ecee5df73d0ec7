"""A peer as a subject, inside a worker process."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

from peers import PLASTIC, ROTATIONAL, Batch, Lammps, Numba, Plain, Skipped, State, Vectors
from peers.lammps_peer import TIME_STEP

from .subjects import Measurement, Subject, better_steps
from .workers import AbsentError

BLOCK = 25  # steps between two looks at the clock
# LAMMPS starts anew for every measurement, so that it gets as many steps whatever it takes: these
# for a measurement of one second
LAMMPS_NODE_STEPS = 5_000_000

LOADERS: dict[str, Callable[[], Any]] = {
    "Plain": Plain.load,
    "Vectors": Vectors.load,
    "Numba": Numba.load,
    "Batch 256": lambda: Batch.load(256),
    "Batch 512": lambda: Batch.load(512),
    "Rotational": lambda: Lammps.load(ROTATIONAL),
    "Plastic": lambda: Lammps.load(PLASTIC),
}


class Peers:
    """The peers of one worker; lattices of each size and number, shared by the thread counts."""

    def __init__(self) -> None:
        self._peers: dict[tuple, Any] = {}
        self._steps: dict[str, tuple[int, int]] = {}  # before a measurement, and in it

    def _peer(self, subject: Subject) -> Any:
        key = (subject.peer, subject.counts, subject.batch)
        if key not in self._peers:
            peer = LOADERS[subject.peer]()
            if isinstance(peer, Skipped):
                raise AbsentError(peer.reason)
            _begin(peer, subject)
            self._peers[key] = peer
        return self._peers[key]

    def prepare(self, subject: Subject) -> None:
        """Compile, and find how many steps lie before a measurement and in it."""
        peer = self._peer(subject)
        if isinstance(peer, Lammps):
            return
        peer.advance(1, subject.threads)
        if subject.span:
            self._steps[subject.key] = self._count(peer, subject)
        else:
            start = time.perf_counter()
            peer.advance(1, subject.threads)
            took = time.perf_counter() - start
            self._steps[subject.key] = (0, better_steps(1, took, subject.seconds))

    def _count(self, peer: Any, subject: Subject) -> tuple[int, int]:
        _begin(peer, subject)
        counts = []
        for moment in (subject.start, subject.start + subject.span):
            steps = 0
            while _states(peer)[0].time < moment:
                steps += peer.advance(BLOCK, subject.threads)
            counts.append(steps)
        return counts[0], counts[1]

    def measure(self, subject: Subject) -> Measurement:
        """One measurement, over the same span of the impact as the engine's."""
        peer = self._peer(subject)
        if isinstance(peer, Lammps):
            return _lammps(peer, subject)
        before, steps = self._steps[subject.key]
        if subject.span:
            _begin(peer, subject)
            peer.advance(before, subject.threads)
        since = sum(state.time for state in _states(peer))
        cpu, wall = time.process_time(), time.perf_counter()
        taken = peer.advance(steps, subject.threads)
        wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
        if not subject.span:
            self._steps[subject.key] = (0, better_steps(steps, wall, subject.seconds))
        simulated = sum(state.time for state in _states(peer)) - since
        return Measurement(wall, cpu, 4.0 * subject.nodes * taken * subject.batch, simulated)


def _begin(peer: Any, subject: Subject) -> None:
    peer.prepare(subject.scenes() if isinstance(peer, Batch) else subject.scene())


def _states(peer: Any) -> list[State]:
    return peer.states() if isinstance(peer, Batch) else [peer.state()]


def _lammps(peer: Lammps, subject: Subject) -> Measurement:
    """LAMMPS times its own loop, which evaluates forces once a step."""
    steps = max(10, round(LAMMPS_NODE_STEPS * subject.seconds / subject.nodes))
    taken = peer.advance(steps)
    evaluations = float(subject.nodes * taken)
    return Measurement(1e-9 * peer.nanoseconds * evaluations, None, evaluations, taken * TIME_STEP)
