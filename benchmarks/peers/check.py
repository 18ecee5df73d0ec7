"""Whether the peers compute the same thing as the engine, and as each other on two threads.

`python -m peers.check` in benchmarks/ prints a line for each comparison; `check()` returns them.
Nothing is compared beyond some milliseconds of impact: later the motion is chaotic, and grows the
last bit into another crack.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import dataclass
from typing import get_args

import numpy as np

from taichi_foam.scene import Foam, Scene
from taichi_foam.simulation.simulate import simulate

from .constants import Skipped, State
from .native import Batch, Plain, Vectors
from .numba_peer import Numba
from .scenes import Choices, Extent, batch_of, scene_with, updated

CASES = ("paper/rectangular-3.03", "paper/wedge-2.86")  # a flat face, and sloped ones
END = 8e-3  # s: by then some 30 bonds have broken
# Bonds that soften grow the last bit faster: under the wedge it is 1e-9 m after 7 ms, also between
# two runs of one peer whose velocities differ by 4e-16 of themselves.
END_SOFTENING = 6.4e-3
INTERVAL = 2e-4  # s between comparisons
TOLERANCE = 1e-9  # m: the same numbers but for the last bits, about 1e-16 m, which the motion grows
PEERS = (Plain, Vectors, Numba)
SOFTENING = (Vectors,)  # those of them that have room and softening
WIDTHS = (256, 512)  # bits of vectors with a lattice in each lane
BATCH_EXTENTS: tuple[Extent, ...] = ("peers", "room")
LATTICES = 5  # of a batch: two vectors of 256 bits, with spare lanes


@dataclass(frozen=True)
class Outcome:
    """One comparison over the whole time."""

    what: str
    distance: float  # the largest of any node's coordinate or the impactor's height [m]
    broken: int  # bonds at the end
    intact: int  # snapshots before the first bond broke
    lagging: float  # how far a bond's worst strain was behind its strain at most
    fault: str = ""

    @property
    def passed(self) -> bool:
        return not self.fault and self.distance <= TOLERANCE

    def __str__(self) -> str:
        return (
            f"{'same' if self.passed else 'DIFFERENT'}: {self.what}: {self.distance:.1e} m apart"
            f" ({self.broken} bonds broken, lag {self.lagging:.1e})"
            + (f": {self.fault}" if self.fault else "")
        )


def check() -> Iterator[Outcome | Skipped]:
    """Compare all peers that are there, with all sets of choices."""
    for kind in PEERS:
        peer = kind.load()
        if isinstance(peer, Skipped):
            yield peer
            continue
        for choices in get_args(Choices):
            for name in CASES:
                for threads in (1, 2):
                    yield compare(peer, name, choices, threads)
                    if kind in SOFTENING:
                        yield compare(peer, name, choices, threads, "room")
    for bits in WIDTHS:
        batch = Batch.load(bits)
        if isinstance(batch, Skipped):
            yield batch
            continue
        for extent in BATCH_EXTENTS:
            for name in CASES:
                yield from compare_batch(batch, name, extent, threads=2, count=LATTICES)


def compare(
    peer: Plain | Vectors | Numba, name: str, choices: Choices, threads: int,
    extent: Extent = "peers",
) -> Outcome:  # fmt: skip
    """Follow the engine to each of its snapshots, as many steps as lie before it."""
    scene = scene_with(choices, name, extent)
    pursuit = _Pursuit(scene, f"{_what(name, choices, extent, threads)} and {peer.name}")
    peer.prepare(scene)
    pursuit.look(peer.state())
    while not pursuit.is_over:
        peer.advance(1, threads)
        pursuit.look(peer.state())
    return pursuit.outcome()


def compare_batch(
    peer: Batch, name: str, extent: Extent, threads: int, count: int
) -> list[Outcome]:  # fmt: skip
    """Follow the engine's single runs with as many lattices that differ, side by side."""
    scenes = batch_of(scene_with("calibrated", name, extent), count)
    what = f"{_what(name, 'calibrated', extent, threads)} and {peer.name}"
    pursuits = [_Pursuit(scene, f"{what}, lattice {n}") for n, scene in enumerate(scenes)]
    peer.prepare(scenes)
    while True:
        for pursuit, state in zip(pursuits, peer.states(), strict=True):
            pursuit.look(state)
        if all(pursuit.is_over for pursuit in pursuits):
            return [pursuit.outcome() for pursuit in pursuits]
        peer.advance(1, threads)


def _what(name: str, choices: Choices, extent: Extent, threads: int) -> str:
    much = {
        "peers": "",
        "room": " with room and softening",
        "apart": " without contact of pieces",
        "whole": " whole",
    }[extent]
    return f"{name}, {choices}{much}, {threads} threads: engine"


class _Pursuit:
    """A peer's lattice that follows the engine from snapshot to snapshot."""

    def __init__(self, scene: Scene, what: str) -> None:
        self._scene, self._what = scene, what
        self._snapshots, self._next = _snapshots(scene), 0
        self._worst, self._intact, self._broken, self._lagging = 0.0, 0, 0, 0.0
        self._fault = ""

    @property
    def is_over(self) -> bool:
        return bool(self._fault) or self._next == len(self._snapshots)

    def look(self, state: State) -> None:
        """Compare, where the engine has a snapshot at the peer's time."""
        if self.is_over or state.time < self._snapshots[self._next].time - 0.5 * state.step:
            return
        snapshot = self._snapshots[self._next]
        self._next += 1
        apart = distance(state, snapshot.position, snapshot.impactor_y)
        self._worst = max(self._worst, apart)
        self._lagging = max(self._lagging, lag(self._scene, snapshot))
        self._broken = sum(
            int(np.isfinite(times).sum())
            for times in (snapshot.break_time_a, snapshot.break_time_b)
        )
        self._intact += self._broken == 0
        # the steps are chosen by both: after unequal steps there is nothing to compare
        late = abs(state.time - snapshot.time) > 1e-12
        if late or state.broken != self._broken or not self._worst < 1.0:
            self._fault = (
                f"at {1e3 * snapshot.time:.2f} ms the peer is at {1e3 * state.time:.2f} ms, with "
                f"{state.broken} bonds broken instead of {self._broken}"
            )

    def outcome(self) -> Outcome:
        """How it went."""
        return Outcome(
            self._what, self._worst, self._broken, self._intact, self._lagging, self._fault
        )


_kept: dict[tuple[str, str], list] = {}


def _snapshots(scene: Scene) -> list:
    """The engine's snapshots, run once for each scene."""
    key = (scene.name, scene.model_dump_json())
    if key not in _kept:
        assert isinstance(scene.foam, Foam)
        end = END_SOFTENING if scene.foam.softening else END
        short = {"numerics": {"end": end}, "output": {"snapshot_interval": INTERVAL}}
        _kept[key] = list(simulate(updated(scene, short)))
    return _kept[key]


def distance(state: State, position: np.ndarray, impactor_y: float) -> float:
    """How far apart [m] a peer and the engine are."""
    return max(float(np.abs(state.position - position).max()), abs(state.impactor_y - impactor_y))


def lag(scene: Scene, snapshot) -> float:
    """How far the worst strain of any bond is behind its strain; 0 of foam without a rate."""
    block, x = scene.block, snapshot.position
    strain_a = np.linalg.norm(np.diff(x, axis=0), axis=-1) / block.dx - 1.0
    strain_b = np.linalg.norm(np.diff(x, axis=1), axis=-1) / block.dy - 1.0
    yielding = scene.foam.landmarks.crush_start
    lags = [
        np.where(strain < yielding, worst - strain, 0.0).max()
        for strain, worst in ((strain_a, snapshot.e_min_a), (strain_b, snapshot.e_min_b))
    ]
    return max(0.0, float(max(lags)))


if __name__ == "__main__":
    passed = True
    for outcome in check():
        print(outcome if isinstance(outcome, Outcome) else f"skipped: {outcome.reason}", flush=True)
        passed = passed and (isinstance(outcome, Skipped) or outcome.passed)
    sys.exit(not passed)
