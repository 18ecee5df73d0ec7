"""What each part of a step costs, on one core: `python benchmarks/parts.py`.

The parts are timed one by one on the lattice of a paper case in full impact, then a whole run
without and with the contact of pieces. Processor time, the least of several repetitions, in ns per
node and Runge-Kutta stage (a part that is done once a step counts a quarter).
"""

import time
from collections.abc import Callable

import numpy as np
import taichi as ti

from taichi_foam.engine import contact, faces, ledger, nodes, runtime, stepper
from taichi_foam.engine.lattice import Lattice, borrowed
from taichi_foam.paper import paper_scene
from taichi_foam.simulation import run

CASE = "paper/rectangular-3.03"
IMPACT_TIME = 0.015  # s: the foam below the impactor is crushed
REPEATS = 200
ROUNDS = 9


def on_columns(part: Callable) -> Callable:
    """A kernel that does `part(lattice, b, i, p)` for all columns, many times on one thread."""

    @ti.kernel
    def repeat(lattice: ti.template(), times: ti.i32):
        for q in range(stepper.GRAIN):
            if q == 0:
                p = lattice.parameters[0]
                for _ in range(times):
                    for i in range(lattice.columns):
                        part(lattice, 0, i, p)

    return repeat


@ti.func
def latch(lattice: ti.template(), b, i, p: ti.template()):
    faces.face_column(lattice, True, b, i, p)


@ti.func
def face_stage(lattice: ti.template(), b, i, p: ti.template()):
    faces.face_column(lattice, False, b, i, p)


@ti.func
def node_stage(lattice: ti.template(), b, i, p: ti.template()):
    nodes.node_column(lattice, b, i, 1, p)


@ti.func
def row(lattice: ti.template(), b, i, p: ti.template()):
    ledger.energy_column(lattice, b, i, p)


@ti.func
def radii(lattice: ti.template(), b, i, p: ti.template()):
    stepper._refresh_column(lattice, b, i, p)


@ti.func
def push(lattice: ti.template(), b, i, p: ti.template()):
    for j in range(lattice.rows):
        contact.self_contact(lattice, b, i, j, p)


@ti.func
def neighbours(lattice: ti.template(), b, i, p: ti.template()):
    if i == 0:
        contact.list_neighbours(lattice, b, p)


PARTS = (
    ("latch: faces with history and failure, once a step", latch, 0.25),
    ("faces, three more times a step", face_stage, 0.75),
    ("nodes, impactor and floor, four times a step", node_stage, 1.0),
    ("pieces: radii and drift, once a step", radii, 0.25),
    ("pieces: push, four times a step", push, 1.0),
    ("pieces: one new neighbour list (not every step)", neighbours, 0.25),
    ("energies of one row (every 0.1 ms, some 30 steps)", row, 0.25),
)


def cost(kernel: Callable, lattice: Lattice) -> float:
    """Processor time of one pass over the lattice [ns per node]."""
    kernel(lattice, 1)
    times = []
    for _ in range(ROUNDS):
        start = time.process_time()
        kernel(lattice, REPEATS)
        times.append(time.process_time() - start)
    return 1e9 * min(times) / REPEATS / lattice.nodes


def main() -> None:
    """Print the table."""
    runtime.start(threads=1)
    scene = paper_scene(CASE)
    print(f"{CASE}, {scene.block.columns} x {scene.block.rows} nodes, one core\n")
    with borrowed(1, scene.block.columns, scene.block.rows) as lattice:
        lattice.load([scene])
        stepper.prepare(lattice)
        lattice.pause.fill(IMPACT_TIME)
        while lattice.clock.time.to_numpy()[0] < IMPACT_TIME:
            stepper.advance_fused(lattice, 1000)
            lattice.clock.get_member_field("rows").fill(0)
        for name, part, share in PARTS:
            print(f"{share * cost(on_columns(part), lattice):6.1f} ns  {name}")
    for self_contact in (False, True):
        model = scene.model.model_copy(update={"self_contact": self_contact})
        case = scene.model_copy(update={"model": model})
        rates = [run(case).run["node_stages_per_s"] for _ in range(3)]
        print(
            f"{1e9 / np.median(rates):6.1f} ns  a whole run, self_contact = {self_contact}: "
            f"{np.median(rates) / 1e6:.1f} (of three {min(rates) / 1e6:.1f} to "
            f"{max(rates) / 1e6:.1f}) million node-stages/s"
        )


if __name__ == "__main__":
    main()
