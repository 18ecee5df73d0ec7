"""What each part of a step costs, on one core: `python benchmarks/parts.py`.

The parts are timed one by one on the lattice of a paper test in full impact, then whole runs
without and with contact of pieces, of which the parts should be the sum. Processor time, the least
of several repetitions, in ns per node and Runge-Kutta stage.
"""

import time
from collections.abc import Callable

import numpy as np
import taichi as ti
from rich.console import Console
from rich.table import Table

from taichi_foam.engine import bonds, clock, contact, ledger, loading, nodes, runtime, stepper
from taichi_foam.engine.lattice import LAST_STAGE, Lattice, borrowed
from taichi_foam.shim2000.tests import paper_scene
from taichi_foam.simulation.simulate import run

CASE = "paper/rectangular-3.03"
IMPACT_TIME = 0.015  # s: the foam below the impactor is crushed
REPEATS = 200
ROUNDS = 9
STEPS_PER_ROW = 30  # about, at the default interval
WATCHED = 500  # steps in which new neighbour lists are counted
WATCHED_TIME = 2e-3  # s, somewhat more than these take
NEIGHBOURS = "pieces: neighbour lists, as often as needed"


@ti.func
def first_faces(lattice: ti.template(), p: ti.template()):
    for i in range(lattice.columns):
        bonds.face_column(lattice, 0, 0, i, i, 0, i % 3, p)


@ti.func
def last_faces(lattice: ti.template(), p: ti.template()):
    for i in range(lattice.columns):
        bonds.face_column(lattice, LAST_STAGE, 0, i, i, 0, i % 3, p)


@ti.func
def middle_faces(lattice: ti.template(), p: ti.template()):
    for i in range(lattice.columns):
        bonds.face_column(lattice, 1, 0, i, i, 0, i % 3, p)


@ti.func
def densify(lattice: ti.template(), p: ti.template()):
    for i in range(lattice.columns):
        if lattice.tally[0, i].least.min() < p.foam.densification_strain:
            for k in range(lattice.packs):
                bonds.densify_pack(lattice, 0, i, k, 0, i % 3, p)


@ti.func
def node_stage(lattice: ti.template(), p: ti.template()):
    for i in range(lattice.columns):
        nodes.node_column(lattice, 0, i, 1, 0, i % 3, (i + 2) % 3, p)


@ti.func
def bodies(lattice: ti.template(), p: ti.template()):
    for i in range(lattice.columns):
        for k in range(lattice.packs):
            now = lattice.trial[0, i, k]
            if contact.may_touch_bodies(lattice, 0, now.x, now.y, p):
                for lane in range(lattice.lanes):
                    j = k * lattice.lanes + lane
                    contact.touch_bodies(lattice, 0, i, j, i, 1, 0.0, p)


@ti.func
def push(lattice: ti.template(), p: ti.template()):
    contact.push_pieces(lattice, 0, p)


@ti.func
def radii(lattice: ti.template(), p: ti.template()):
    contact.refresh_radii(lattice, 0, p)


@ti.func
def neighbours(lattice: ti.template(), p: ti.template()):
    contact.list_neighbours(lattice, 0, p)


@ti.func
def row(lattice: ti.template(), p: ti.template()):
    for i in range(lattice.columns):
        ledger.energy_column(lattice, 0, i, p)


# Name, part, how many times a stage, and whether it counts in the sum: not if it lies within
# another part.
PARTS = (
    ("faces with history, first stage", first_faces, 0.25, True),
    ("faces, two middle stages", middle_faces, 0.5, True),
    ("faces with failure, last stage", last_faces, 0.25, True),
    ("  of these: densification, four times a step", densify, 1.0, False),
    ("nodes, four times a step", node_stage, 1.0, True),
    ("  of these: contact with impactor and floor", bodies, 1.0, False),
    ("pieces: push, four times a step", push, 1.0, True),
    ("pieces: radii, every fourth step", radii, 0.25 / clock.REFRESH, True),
    (NEIGHBOURS, neighbours, 0.25, True),
    ("energies of a row, every thirtieth step", row, 0.25 / STEPS_PER_ROW, True),
)


def repeated(part: Callable) -> Callable:
    """A kernel that does a part many times, on one thread."""

    @ti.kernel
    def repeat(lattice: ti.template(), times: ti.i32):
        for _ in range(1):
            p = lattice.parameters[0]
            for _repeat in range(times):
                part(lattice, p)

    return repeat


def cost(kernel: Callable, lattice: Lattice) -> float:
    """Processor time of one pass over the lattice [ns per node]."""
    kernel(lattice, 1)
    times = []
    for _ in range(ROUNDS):
        start = time.process_time()
        kernel(lattice, REPEATS)
        times.append(time.process_time() - start)
    return 1e9 * min(times) / REPEATS / lattice.nodes


def part_costs() -> dict[str, float]:
    """ns per node-stage of each part."""
    scene = paper_scene(CASE)
    with borrowed(1, scene.block.columns, scene.block.rows) as lattice:
        loading.load(lattice, 0, scene)
        stepper.prepare(lattice, 0)
        run_to(lattice, IMPACT_TIME - WATCHED_TIME)
        builds = builds_per_step(lattice)
        run_to(lattice, IMPACT_TIME)
        costs = {name: often * cost(repeated(part), lattice) for name, part, often, _ in PARTS}
    costs[NEIGHBOURS] *= builds
    return costs


def run_to(lattice: Lattice, moment: float) -> None:
    """Step to a simulated time [s]."""
    loading.set_pause(lattice, np.array([moment]))
    stepper.advance_fused(lattice, 1_000_000)


def builds_per_step(lattice: Lattice) -> float:
    """How often neighbours are listed anew: what has drifted since then has become less."""
    loading.set_pause(lattice, np.array([1.0]))
    drifts = []
    for _ in range(WATCHED):
        stepper.advance_fused(lattice, 1)
        drifts.append(lattice.clock[0].drift)
    return float(np.mean(np.diff(drifts) < 0.0))


def main() -> None:
    """Print the table."""
    runtime.start(threads=1)
    console, scene = Console(highlight=False), paper_scene(CASE)
    costs = part_costs()
    counted = {name for name, _, _, counts in PARTS if counts}
    total = sum(costs[name] for name in counted)
    table = Table("part", "ns", "share", title=f"{CASE} at {1e3 * IMPACT_TIME:g} ms, one core")
    for name, ns in costs.items():
        table.add_row(name, f"{ns:.2f}", f"{100 * ns / total:.0f} %" if name in counted else "")
    table.add_row("sum", f"{total:.2f}", "100 %", end_section=True)
    for self_contact in (False, True):
        model = scene.model.model_copy(update={"self_contact": self_contact})
        case = scene.model_copy(update={"model": model})
        rates = [run(case).run["node_stages_per_s"] for _ in range(3)]
        name = f"a whole run {'with' if self_contact else 'without'} contact of pieces, wall time"
        table.add_row(name, f"{1e9 / max(rates):.2f}", "")
    console.print(table)


if __name__ == "__main__":
    main()
