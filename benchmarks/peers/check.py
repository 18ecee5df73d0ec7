"""Whether the peers compute the same thing as each other, and as the engine.

`python -m peers.check` in benchmarks/ prints a line for each comparison; `check()` returns them.
Nothing is compared beyond some milliseconds of impact: later the motion is chaotic, and grows the
last bit into another crack.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass

import numpy as np

from taichi_foam.scene import Scene
from taichi_foam.shim2000.tests import paper_scene
from taichi_foam.simulation.simulate import run

from .constants import Skipped, State
from .native import Plain, Vectors
from .numba_peer import Numba

CASES = ("paper/rectangular-3.03", "paper/wedge-2.86")  # a flat face, and sloped ones
STEPS = 2000
TOLERANCE = 1e-9  # m
SNAPSHOTS = 1e-3  # s between comparisons with the engine
PEERS = (Plain, Vectors, Numba)


@dataclass(frozen=True)
class Outcome:
    """One comparison."""

    what: str
    distance: float  # the largest of any node's coordinate or the impactor's height [m]
    passed: bool

    def __str__(self) -> str:
        return f"{'same' if self.passed else 'DIFFERENT'}: {self.what}: {self.distance:.1e} m apart"


def check() -> list[Outcome | Skipped]:
    """Compare all peers that are there."""
    outcomes: list[Outcome | Skipped] = []
    peers = []
    for kind in PEERS:
        peer = kind.load()
        if isinstance(peer, Skipped):
            outcomes.append(peer)
        else:
            peers.append(peer)
    for name in CASES:
        scene = bare(paper_scene(name))
        for peer in peers:
            outcomes.append(_with_engine(name, scene, peer))
        for threads in (1, 2):
            outcomes += _with_each_other(name, scene, peers, threads)
    return outcomes


def bare(scene: Scene) -> Scene:
    """The scene with the readings that the peers have, and without contact of pieces."""
    readings = {"self_contact": False, "damping": "bond", "broken_halves": "either"}
    plain = {"rate": None, "crushed_strength": 1.0}
    return scene.model_copy(
        update={
            "model": scene.model.model_copy(update=readings),
            "foam": scene.foam.model_copy(update=plain),
        }
    )


def _with_each_other(name: str, scene: Scene, peers: list, threads: int) -> list[Outcome]:
    states = []
    for peer in peers:
        peer.prepare(scene)
        peer.advance(STEPS, threads)
        states.append(peer.state())
    first = f"{name}, {STEPS} steps, {threads} threads: {peers[0].name if peers else ''}"
    return [
        _compare(f"{first} and {peer.name}", states[0], state.position, state.impactor_y)
        for peer, state in zip(peers[1:], states[1:], strict=True)
    ]


def _with_engine(name: str, scene: Scene, peer) -> Outcome:
    """Follow the engine to each of its snapshots, as many steps as lie before it."""
    step = 0.0
    worst = Outcome("", 0.0, True)
    peer.prepare(scene)
    for snapshot in _engine_snapshots(scene):
        while peer.state().time < snapshot.time - 0.5 * step:
            peer.advance(1)
            step = peer.state().step
        state = peer.state()
        what = f"{name}, to {snapshot.time * 1e3:.2f} ms: engine and {peer.name}"
        here = _compare(what, state, snapshot.position, snapshot.impactor_y)
        # the steps are chosen by both: after unequal steps there is nothing to compare
        same_time = abs(state.time - snapshot.time) < 1e-12
        here = Outcome(what, here.distance, here.passed and same_time)
        worst = here if not here.passed or here.distance >= worst.distance else worst
        if not worst.passed:
            break
    return worst


_snapshots: dict[str, list] = {}


def _engine_snapshots(scene: Scene) -> list:
    """The engine's snapshots over the time of STEPS steps, run once for each scene."""
    if scene.name not in _snapshots:
        end = 1e-3 * int(STEPS * 3.4e-6 / 1e-3)
        numerics = scene.numerics.model_copy(update={"end": end})
        output = scene.output.model_copy(update={"snapshot_interval": SNAPSHOTS})
        short = scene.model_copy(update={"numerics": numerics, "output": output})
        _snapshots[scene.name] = run(short).snapshots
    return _snapshots[scene.name]


def _compare(what: str, state: State, position: np.ndarray, impactor_y: float) -> Outcome:
    distance = max(
        float(np.abs(state.position - position).max()), abs(state.impactor_y - impactor_y)
    )
    return Outcome(what, distance, distance <= TOLERANCE)


if __name__ == "__main__":
    outcomes = check()
    for outcome in outcomes:
        print(outcome if isinstance(outcome, Outcome) else f"skipped: {outcome.reason}")
    sys.exit(any(isinstance(outcome, Outcome) and not outcome.passed for outcome in outcomes))
