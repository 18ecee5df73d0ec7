"""What each part of a step costs, on one core: `python benchmarks/parts.py [--smoke]`.

The parts are timed one by one on the lattice of a paper test in full impact, then whole runs
with ever more of the model, of which the parts should be the sum. Processor time, the least
of several repetitions, in ns per node and Runge-Kutta stage. `--smoke` does a few steps of each:
whether they run, not how fast.
"""

import argparse
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import taichi as ti
from peers import CASE, Extent, scene_with, updated
from rich.console import Console
from timing.table import Table
from timing.workers import compile_thoroughly

from taichi_foam.engine import bonds, cells, clock, contact, cpu, ledger, nodes, runtime, transfer
from taichi_foam.engine.features import features_of
from taichi_foam.engine.lattice import LAST_STAGE, Lattice, borrowed
from taichi_foam.simulation.simulate import run

WHOLE_RUNS: dict[Extent, str] = {
    "peers": "of what the peers have",
    "room": "with room and softening",
    "apart": "of the model without contact of pieces",
    "whole": "of the whole model",
}
STEPS_PER_ROW = 30  # about, at the default interval
NEIGHBOURS = "pieces: neighbour lists, as often as needed"


@dataclass(frozen=True)
class Mode:
    """How much is measured."""

    impact_time: float = 0.015  # s: the foam below the impactor is crushed
    repeats: int = 200
    rounds: int = 9
    runs: int = 3
    run_end: float | str = "rebound"
    watched: int = 500  # steps in which new neighbour lists are counted
    watched_time: float = 2e-3  # s, somewhat more than these take
    extents: tuple[Extent, ...] = tuple(WHOLE_RUNS)


# one extent: compare.py runs the others
SMOKE = Mode(
    2e-4, repeats=1, rounds=1, runs=1, run_end=2e-4, watched=3, watched_time=1e-4,
    extents=("whole",),
)  # fmt: skip


@ti.func
def first_bonds(lattice: ti.template(), p: ti.template()):
    for i in range(lattice.counts[None].columns):
        bonds.bond_column(lattice, 0, 0, i, i, 0, i % 3, p)


@ti.func
def last_bonds(lattice: ti.template(), p: ti.template()):
    for i in range(lattice.counts[None].columns):
        bonds.bond_column(lattice, LAST_STAGE, 0, i, i, 0, i % 3, p)


@ti.func
def middle_bonds(lattice: ti.template(), p: ti.template()):
    for i in range(lattice.counts[None].columns):
        bonds.bond_column(lattice, 1, 0, i, i, 0, i % 3, p)


@ti.func
def flow(lattice: ti.template(), p: ti.template()):
    """For no time: else foam would have stopped to flow after the first passes."""
    step = lattice.state.clock[0].step
    lattice.state.clock[0].step = 0.0
    for i in range(lattice.counts[None].columns):
        bonds.flow_column(lattice, 0, i, p)
    lattice.state.clock[0].step = step


@ti.func
def stiffen(lattice: ti.template(), p: ti.template()):
    """Of the bonds that have ever been packed: nearly all of them still are."""
    for i in range(lattice.counts[None].columns):
        if lattice.scratch.tally[0, i].least.min() < lattice.law.stiffens_below(p.bond):
            for k in range(lattice.counts[None].packs):
                bonds.stiffen_pack(
                    lattice, 0, i, k, 0, i % 3, lattice.state.bond_a[0, i, k].worst,
                    lattice.state.bond_b[0, i, k].worst, p,
                )  # fmt: skip


@ti.func
def shear(lattice: ti.template(), p: ti.template()):
    for i in range(lattice.counts[None].columns):
        for k in range(lattice.counts[None].packs):
            cells.shear_pack(lattice, 0, i, k, i, 0, i % 3, p)


@ti.func
def look(lattice: ti.template(), p: ti.template()):
    for i in range(lattice.counts[None].columns):
        cells.look_column(lattice, 0, i, 1, p)


@ti.func
def press(lattice: ti.template(), p: ti.template()):
    for i in range(lattice.counts[None].columns):
        for k in range(lattice.counts[None].packs):
            if lattice.scratch.presses[0, i, k]:
                cells.press_pack(lattice, 0, i, k, i, 0, i % 3, p)


@ti.func
def node_stage(lattice: ti.template(), p: ti.template()):
    for i in range(lattice.counts[None].columns):
        nodes.node_column(lattice, 0, i, 1, 0, i % 3, (i + 2) % 3, p)


@ti.func
def bodies(lattice: ti.template(), p: ti.template()):
    for i in range(lattice.counts[None].columns):
        for k in range(lattice.counts[None].packs):
            now = lattice.scratch.trial[0, i, k]
            if contact.may_touch_bodies(lattice, 0, i, k, now.x, now.y, p):
                for lane in range(lattice.lanes):
                    j = k * lattice.lanes + lane
                    if j < lattice.counts[None].rows:
                        contact.touch_bodies(lattice, 0, i, j, i, 1, 0.0, p)


@ti.func
def push(lattice: ti.template(), p: ti.template()):
    contact.push_pieces(lattice, 0, 1, p)


@ti.func
def radii(lattice: ti.template(), p: ti.template()):
    contact.refresh_radii(lattice, 0, p)


@ti.func
def neighbours(lattice: ti.template(), p: ti.template()):
    contact.list_neighbours(lattice, 0, p)


@ti.func
def row(lattice: ti.template(), p: ti.template()):
    for i in range(lattice.counts[None].columns):
        ledger.energy_column(lattice, 0, i, p)


# Name, part, how many times a stage, and whether it counts in the sum: not if it lies within
# another part.
PARTS = (
    ("flow of the worst strain, once a step", flow, 0.25, True),
    ("cells: which let go, which may press, once a step", look, 0.25, True),
    ("bonds with history and cells, first stage", first_bonds, 0.25, True),
    ("bonds and cells, two middle stages", middle_bonds, 0.5, True),
    ("bonds with failure and cells, last stage", last_bonds, 0.25, True),
    ("  of these: shear of cells, four times a step", shear, 1.0, False),
    ("  of these: stiffening, four times a step", stiffen, 1.0, False),
    ("  of these: room of crushed cells", press, 1.0, False),
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
            p = lattice.model.parameters[0]
            for _repeat in range(times):
                part(lattice, p)

    return repeat


def cost(kernel: Callable, lattice: Lattice, mode: Mode) -> float:
    """Processor time of one pass over the lattice [ns per node]."""
    kernel(lattice, 1)
    times = []
    for _ in range(mode.rounds):
        start = time.process_time()
        kernel(lattice, mode.repeats)
        times.append(time.process_time() - start)
    return 1e9 * min(times) / mode.repeats / lattice.size.nodes


def part_costs(mode: Mode) -> dict[str, float]:
    """ns per node-stage of each part."""
    scene = scene_with("calibrated", extent="whole")
    with borrowed(1, scene.block.columns, scene.block.rows, features_of(scene)) as lattice:
        transfer.load(lattice, 0, scene)
        run_to(lattice, mode.impact_time - mode.watched_time)
        builds = builds_per_step(lattice, mode.watched)
        run_to(lattice, mode.impact_time)
        costs = {
            name: often * cost(repeated(part), lattice, mode) for name, part, often, _ in PARTS
        }
    costs[NEIGHBOURS] *= builds
    return costs


def run_to(lattice: Lattice, moment: float) -> None:
    """Step to a simulated time [s]."""
    transfer.set_pause(lattice, np.array([moment]))
    cpu.advance_fused(lattice, 1_000_000)


def builds_per_step(lattice: Lattice, watched: int) -> float:
    """How often neighbours are listed anew: what has drifted since then has become less."""
    transfer.set_pause(lattice, np.array([1.0]))
    drifts = []
    for _ in range(watched):
        cpu.advance_fused(lattice, 1)
        drifts.append(lattice.state.clock[0].drift)
    return float(np.mean(np.diff(drifts) < 0.0))


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--smoke", action="store_true")
    mode = SMOKE if parser.parse_args().smoke else Mode()
    if mode is not SMOKE:
        compile_thoroughly()
    runtime.start(threads=1)
    costs = part_costs(mode)
    counted = {name for name, _, _, counts in PARTS if counts}
    total = sum(costs[name] for name in counted)
    table = Table(("part", "ns", "share"))
    for name, ns in costs.items():
        share = f"{100 * ns / total:.0f} %" if name in counted else ""
        table.rows.append((name, f"{ns:.2f}", share))
    table.rows.append(("sum", f"{total:.2f}", "100 %"))
    for extent in mode.extents:
        case = scene_with("calibrated", extent=extent)
        case = updated(case, {"numerics": {"end": mode.run_end}})
        rates = [run(case).run["node_stages_per_s"] for _ in range(mode.runs)]
        name = f"a whole run {WHOLE_RUNS[extent]}, wall time"
        table.rows.append((name, f"{1e9 / max(rates):.2f}", ""))
    console = Console(highlight=False)
    console.print(f"{CASE} at {1e3 * mode.impact_time:g} ms, one core")
    console.print(table)


if __name__ == "__main__":
    main()
