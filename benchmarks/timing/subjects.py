"""What is timed: this engine in its ways of stepping, and the peers; how much of everything.

And what a single measurement gives.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from peers import CASE, Extent, batch_of, lattice_of, scene_with, updated

from taichi_foam.scene import Scene
from taichi_foam.shim2000.impacts import NAMES

SMALL = (40, 20)
LEAST_STEPS = 3  # of a measurement
ROOM = "room and softening"
NO_LEDGER = "no-ledger"  # how the worker is called whose engine keeps none
LAMMPS = {"lammps": "Rotational", "lammps plastic": "Plastic"}
PEERS = {"Plain": "C++, plain", "Vectors": "C++, vectors by hand", "Numba": "Numba"}


@dataclass(frozen=True)
class Mode:
    """How much a run measures: all of it, less, or a few steps of everything."""

    rounds: int
    tests: tuple[str, ...]  # of the paper, as whole runs
    test_rounds: int
    warm_starts: int
    middle: tuple[int, int] = (400, 200)
    large: tuple[int, int] = (2000, 1000)
    batches: tuple[tuple[int, float], ...] = ((8, 2e-3), (64, 3e-4))  # lattices, simulated time [s]
    all_sizes: bool = True  # the large lattice on one thread too, peers of the middle one, starts
    start: float = 8e-3  # s: where small lattices are timed
    span: float = 8e-3
    seconds: float = 0.3  # about, of a measurement that is not given a simulated time
    test_end: float | None = None  # s
    counted_steps: tuple[int, int] = (1000, 200)  # whose operations are counted, after how many


MODES = {
    "full": Mode(rounds=9, tests=NAMES, test_rounds=3, warm_starts=3),
    "quick": Mode(
        rounds=3,
        tests=("paper/rectangular-3.03", "paper/wedge-2.86"),
        test_rounds=1,
        warm_starts=1,
        batches=((8, 2e-3),),
        all_sizes=False,
    ),
    # one size, so that Taichi compiles once
    "smoke": Mode(
        rounds=1, tests=(CASE,), test_rounds=1, warm_starts=0, middle=SMALL, large=SMALL,
        batches=((1, 1e-4),), start=1e-4, span=1e-4, seconds=0.01, test_end=2e-4,
        counted_steps=(1, 1),
    ),
}  # fmt: skip


@dataclass(frozen=True)
class Subject:
    """One thing that is timed again and again.

    A small lattice runs to `start`, where the impact is in full swing; a measurement is the next
    `span` of simulated time, and at twice the start the lattice goes back to it. With `span` 0 a
    measurement is a few steps, the first of a lattice too large to wait for more.
    """

    key: str
    name: str
    worker: str
    counts: tuple[int, int] = SMALL
    batch: int = 1
    threads: int = 1
    case: str = CASE
    extent: Extent = "peers"
    peer: str = ""
    start: float = 0.0  # s
    span: float = 0.0
    seconds: float = 0.3

    @property
    def nodes(self) -> int:
        """Of one lattice."""
        return self.counts[0] * self.counts[1]

    def scene(self) -> Scene:
        """The case with this subject's cells, and no end in sight."""
        scene = scene_with("calibrated", self.case, self.extent)
        scene = updated(scene, {"numerics": {"end": 1.0}})
        if self.worker.endswith(NO_LEDGER):
            rare = {"history_interval": 0.01, "snapshot_interval": 0.01}
            scene = updated(scene, {"output": rare})
        return lattice_of(scene, *self.counts)

    def scenes(self) -> list[Scene]:
        """Of each lattice: those of a batch differ, as drops do."""
        return batch_of(self.scene(), self.batch)


def subjects(mode: Mode, threads: int) -> list[Subject]:
    """All subjects of a run, in the order of the table; `threads`: what many-threaded ones use."""
    found = [*_small(mode), *_batches(mode, threads)]
    for key, counts in (("middle", mode.middle), ("large", mode.large)):
        found += _big(mode, key, counts, threads)
    return list({subject.key: subject for subject in found}.values())  # threads may be 1


def _small(mode: Mode) -> list[Subject]:
    """The paper's lattice on one thread."""
    fused = Subject("fused", "this engine, fused", "engine-1", start=mode.start, span=mode.span)
    whole = f"{fused.name}, whole model"
    worker, name = f"engine-1-{NO_LEDGER}", f"{fused.name}, no ledger"
    return [
        fused,
        replace(fused, key="fused room", name=f"{fused.name}, {ROOM}", extent="room"),
        replace(fused, key="fused whole", name=whole, extent="whole"),
        replace(fused, key="fused no ledger", name=name, worker=worker),
        *(
            replace(fused, key=peer.lower(), name=name, worker="peers", peer=peer)
            for peer, name in PEERS.items()
        ),
        replace(
            fused,
            key="vectors room",
            name=f"{PEERS['Vectors']}, {ROOM}",
            worker="peers",
            peer="Vectors",
            extent="room",
        ),
        *(_lammps(key, peer, mode) for key, peer in LAMMPS.items()),
    ]


def _lammps(key: str, peer: str, mode: Mode) -> Subject:
    name = f"LAMMPS bpm/{'rotational' if peer == 'Rotational' else 'spring/plastic'}"
    return Subject(key, name, "peers", peer=peer, seconds=mode.seconds)


def _batches(mode: Mode, threads: int) -> list[Subject]:
    return [
        Subject(
            f"batch {batch} on {count}", f"this engine, batch of {batch}", f"engine-{count}",
            batch=batch, threads=count, start=mode.start, span=span,
        )
        for batch, span in mode.batches
        for count in (1, threads)
    ]  # fmt: skip


def _big(mode: Mode, key: str, counts: tuple[int, int], threads: int) -> list[Subject]:
    """A lattice that does not fit the caches: engine and peers on one thread and on many."""
    engine = Subject("", "this engine, staged", "", counts, seconds=mode.seconds)
    alone = mode.all_sizes or key == "middle"
    found = [
        replace(engine, key=f"{key} on {count}", worker=f"engine-{count}", threads=count)
        for count in ((1, threads) if alone else (threads,))
    ]
    whole = f"{engine.name}, whole model"
    found.append(replace(found[-1], key=f"{key} whole on {threads}", name=whole, extent="whole"))
    for peer in ("Plain", "Vectors"):
        found += [
            replace(
                engine, key=f"{key} {peer.lower()} on {count}", name=PEERS[peer], worker="peers",
                peer=peer, threads=count,
            )
            for count in ((1, threads) if alone else (threads,))
        ]  # fmt: skip
    if mode.all_sizes and key == "middle":
        numba = replace(engine, key="middle numba", name="Numba", worker="peers", peer="Numba")
        found += [numba, replace(_lammps("middle lammps", "Rotational", mode), counts=counts)]
    return found


@dataclass
class Measurement:
    """What one measurement gave; two add up."""

    wall: float  # s
    cpu: float | None  # s, of all threads of the process
    node_stages: float
    simulated: float  # s, of one lattice; lattices of a batch add up

    def __add__(self, other: Measurement) -> Measurement:
        cpu = None if self.cpu is None or other.cpu is None else self.cpu + other.cpu
        return Measurement(
            self.wall + other.wall, cpu, self.node_stages + other.node_stages,
            self.simulated + other.simulated,
        )  # fmt: skip


def better_steps(steps: int, took: float, seconds: float) -> int:
    """Steps of the next measurement, that it takes about `seconds`."""
    return max(LEAST_STEPS, round(steps * seconds / took))
