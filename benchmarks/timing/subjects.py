"""What is timed: this engine in its ways of stepping, and the peers."""

from __future__ import annotations

from dataclasses import dataclass, replace

from peers import lattice_of

from taichi_foam.scene import Scene
from taichi_foam.shim2000.tests import paper_scene

CASE = "paper/rectangular-3.03"
SMALL = (40, 20)
MIDDLE = (400, 200)
LARGE = (2000, 1000)
NO_LEDGER = "no-ledger"  # how the worker is called whose engine keeps none


@dataclass(frozen=True)
class Subject:
    """One thing that is timed again and again.

    A small lattice runs to `start`, where the impact is in full swing; a measurement is the next
    `span` of simulated time, and at `until` the lattice goes back to the start. With `span` 0 a
    measurement is a few steps, the first of a lattice too large to wait for more.
    """

    key: str
    name: str
    worker: str
    counts: tuple[int, int] = SMALL
    batch: int = 1
    threads: int = 1
    contact: bool = False
    peer: str = ""
    start: float = 8e-3  # s
    span: float = 8e-3
    until: float = 16e-3

    @property
    def nodes(self) -> int:
        """Of one lattice."""
        return self.counts[0] * self.counts[1]

    def scene(self) -> Scene:
        """The case with this subject's cells, and no end in sight."""
        scene = paper_scene(CASE)
        model = scene.model.model_copy(update={"self_contact": self.contact})
        numerics = scene.numerics.model_copy(update={"end": 1.0})
        update: dict[str, object] = {"model": model, "numerics": numerics}
        if self.worker.endswith(NO_LEDGER):
            rare = {"history_interval": 0.01, "snapshot_interval": 0.01}
            update["output"] = scene.output.model_copy(update=rare)
        return lattice_of(scene.model_copy(update=update), *self.counts)


def subjects(quick: bool, threads: int) -> list[Subject]:
    """All subjects of a run, in the order of the table; `threads` is what many-threaded ones use.

    `quick` leaves out what takes long to prepare.
    """
    many = f"engine-{threads}"
    found = [
        Subject("fused", "this engine, fused", "engine-1"),
        Subject("fused contact", "this engine, fused, contact of pieces", "engine-1", contact=True),
        Subject("fused no ledger", "this engine, fused, no ledger", f"engine-1-{NO_LEDGER}"),
        Subject("plain", "C++, plain", "peers", peer="Plain"),
        Subject("vectors", "C++, vectors by hand", "peers", peer="Vectors"),
        Subject("numba", "Numba", "peers", peer="Numba"),
        Subject("lammps", "LAMMPS bpm/rotational", "peers", peer="Rotational"),
        Subject("lammps plastic", "LAMMPS bpm/spring/plastic", "peers", peer="Plastic"),
    ]
    for batch, span in ((8, 2e-3),) if quick else ((8, 2e-3), (64, 3e-4)):
        for worker, count in (("engine-1", 1), (many, threads)):
            found.append(
                Subject(
                    f"batch {batch} on {count}", f"this engine, batch of {batch}", worker,
                    batch=batch, threads=count, span=span,
                )
            )  # fmt: skip
    middle = _big("middle", MIDDLE, many, threads, singles=True)
    large = _big("large", LARGE, many, threads, singles=not quick)
    if not quick:
        lammps = Subject(
            "middle lammps", "LAMMPS bpm/rotational", "peers", MIDDLE, peer="Rotational"
        )
        numba = Subject("middle numba", "Numba", "peers", MIDDLE, peer="Numba", start=0, span=0)
        middle += [numba, lammps]
    return found + middle + large


def _big(
    key: str, counts: tuple[int, int], many: str, threads: int, singles: bool
) -> list[Subject]:
    """A lattice that does not fit the caches: engine and C++ on one thread and on many."""
    engine = Subject("", "this engine, staged", "", counts, start=0.0, span=0.0)
    found = []
    if singles:
        found.append(replace(engine, key=f"{key} on 1", worker="engine-1"))
    found.append(replace(engine, key=f"{key} on {threads}", worker=many, threads=threads))
    found.append(
        replace(
            found[-1], key=f"{key} contact on {threads}", contact=True,
            name="this engine, staged, contact of pieces",
        )
    )  # fmt: skip
    for peer, name in (("Plain", "C++, plain"), ("Vectors", "C++, vectors by hand")):
        for count in (1, threads) if singles else (threads,):
            found.append(
                replace(
                    engine, key=f"{key} {peer.lower()} on {count}", name=name, worker="peers",
                    peer=peer, threads=count,
                )
            )  # fmt: skip
    return found
