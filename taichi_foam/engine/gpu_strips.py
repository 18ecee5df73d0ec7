"""The work of a GPU's threads on their nodes, and the reduction of their sums.

A thread handles a *strip*: every `width`-th node, from node `strip` on. It calls the same functions
as the CPU, node by node. All forces of a stage are computed before any node moves. The sums of
strips are reduced by a tree within each block of threads, always in the same order: a run gives
bitwise identical results however the device schedules it, alone or in a batch. They differ from the
CPU's by rounding.

Barriers must also order accesses to fields. On CUDA they do. Vulkan guarantees it for shared memory
only; drivers order a work group's accesses nevertheless, and the tests would fail otherwise.
"""

from taichi_foam.backend import ti
from taichi_foam.engine import bonds, cells, clock, gpu_neighbours, lanes, ledger, nodes
from taichi_foam.engine.lattice import LAST_STAGE, Lattice
from taichi_foam.engine.layout import THREADS
from taichi_foam.engine.scratch import (
    BREAKS,
    CONTACT_FORCE,
    CRUSH,
    DIVERGING,
    ENERGIES,
    ENERGY_SUMS,
    MOVED,
    SIDE_FORCE,
    STIFFEST,
    TORQUE,
)
from taichi_foam.engine.state import WORK, WORKS, book
from taichi_foam.records.history import ENERGIES_NOW

vec3 = ti.types.vector(3, ti.f64)


@ti.func
def reduce(
    shared: ti.template(), values: ti.template(), t, b, block, first: ti.template(),
    count: ti.template(), adding: ti.template(),
):  # fmt: skip
    """Reduce `count` numbers per thread of a block to `values`, from member `first` on.

    Number `c` of thread `t` is in `shared[c * THREADS + t]`. The result is the sum, or the maximum.
    The tree is a loop, as Mesa takes long to compile many barriers.
    """
    half = THREADS // 2
    while half > 0:
        ti.simt.block.sync()
        if t < half:
            for c in range(count):
                here = c * THREADS + t
                if ti.static(adding):
                    shared[here] = shared[here] + shared[here + half]
                else:
                    shared[here] = ti.max(shared[here], shared[here + half])
        half //= 2
    ti.simt.block.sync()
    if t < count:
        values[b, block, first + t] = shared[t * THREADS]
    ti.simt.block.sync()


@ti.func
def bond_strip(lattice: ti.template(), stage, b, strip, width, p: ti.template()):
    """Forces of a strip's bonds and cells, and the pushes on its pieces."""
    bonds.clear_bonds(lattice, b, strip)
    if stage == LAST_STAGE:
        lattice.state.work[b, strip][WORK.held_by_pieces] = 0.0
    stiffest = 0.0
    n = strip
    while n < lattice.counts[None].nodes:
        i, k = lanes.column_and_row(lattice, n)
        a_strain, b_strain = bonds.bond_pack(lattice, stage, b, i, k, strip, b, i, p)
        if ti.static(lattice.law.stiffens):
            stiff = bonds.stiffen_pack(lattice, b, i, k, b, i, a_strain, b_strain, p)
            stiffest = ti.max(stiffest, stiff)
        if ti.static(lattice.features.crushed_room):  # noqa: SIM102 - the static test stands alone
            if lattice.scratch.presses[b, i, k]:
                cells.press_pack(lattice, b, i, k, strip, b, i, p)
        if ti.static(lattice.features.self_contact):
            gpu_neighbours.push(lattice, b, n, stage, strip, p)
        n += width
    lattice.scratch.stiffest[b, strip] = stiffest


@ti.func
def look_strip(lattice: ti.template(), b, strip, width, booked: ti.template(), p: ti.template()):
    """`cells.look_column` for a strip's cells."""
    lost = cells.Losses(0.0)
    n = strip
    while n < lattice.counts[None].nodes:
        i, k = lanes.column_and_row(lattice, n)
        lost = cells.look_pack(lattice, b, i, k, lost, booked, p)
        n += width
    if ti.static(booked):
        cells.book_lost(lattice, b, strip, lost)


@ti.func
def flow_strip(lattice: ti.template(), b, strip, width, p: ti.template()):
    n = strip
    while n < lattice.counts[None].nodes:
        i, k = lanes.column_and_row(lattice, n)
        bonds.flow_pack(lattice, b, i, k, p)
        n += width


@ti.func
def node_strip(lattice: ti.template(), b, strip, width, stage, p: ti.template()) -> ti.i32:
    """A stage of a strip's nodes; returns the first diverged node, or the number of nodes."""
    nodes.clear_nodes(lattice, b, strip, stage)
    diverged = lattice.counts[None].nodes
    n = strip
    while n < lattice.counts[None].nodes:
        i, k = lanes.column_and_row(lattice, n)
        left_slot = ti.select(i > 0, i - 1, lattice.counts[None].columns)  # a slot of zeros
        nodes.node_pack(lattice, b, i, k, strip, stage, b, i, left_slot, p)
        if stage == LAST_STAGE:
            nodes.inspect_pack(lattice, b, i, k, strip)
            if lattice.scratch.tally[b, strip].diverged[0] > 0.0:
                diverged = ti.min(diverged, n)
        n += width
    nodes.close_nodes(lattice, b, strip, stage)
    return diverged


@ti.func
def reduce_stage(
    lattice: ti.template(), shared: ti.template(), values: ti.template(), t, b, block, strip,
    stage, diverged,
):  # fmt: skip
    """Reduce the strips' values that a stage needs, and after the last stage those of the step."""
    shared[t] = lattice.scratch.contact_force[b, strip]
    if ti.static(lattice.features.turns):
        shared[THREADS + t] = lattice.scratch.side_force[b, strip]
        shared[2 * THREADS + t] = lattice.scratch.torque[b, strip]
    reduce(shared, values, t, b, block, CONTACT_FORCE, ti.static(loads(lattice)), True)
    if stage == LAST_STAGE:
        shared[t] = lattice.scratch.tally[b, strip].moved[0]
        shared[THREADS + t] = lattice.scratch.stiffest[b, strip]
        shared[2 * THREADS + t] = lattice.state.overlap[b, strip]
        shared[3 * THREADS + t] = -diverged
        shared[4 * THREADS + t] = -lattice.scratch.tally[b, strip].least[0]
        reduce(shared, values, t, b, block, MOVED, 5, False)
        shared[t] = lattice.scratch.tally[b, strip].breaks[0]
        reduce(shared, values, t, b, block, BREAKS, 1, True)


def loads(lattice: Lattice) -> int:
    """Number of components of the nodes' load on the impactor: 1 (vertical force) or all 3."""
    return 3 if lattice.features.turns else 1


@ti.func
def body_stage(lattice: ti.template(), b, stage, p: ti.template()):
    """The stage for the impactor, from the lattice's totals."""
    totals = ti.static(lattice.scratch.totals)
    if ti.static(lattice.features.turns):
        load = vec3(totals[b, 0, CONTACT_FORCE], totals[b, 0, SIDE_FORCE], totals[b, 0, TORQUE])
        nodes.free_stage(lattice, b, stage, load, p)
    else:
        nodes.body_stage(lattice, b, stage, totals[b, 0, CONTACT_FORCE], p)


@ti.func
def reduce_energies(
    lattice: ti.template(), shared: ti.template(), values: ti.template(), t, b, block, strip, width,
    p: ti.template(),
):  # fmt: skip
    """Reduce the strips' energies and works for a row of the history."""
    energy = ledger.vec_now(0.0)
    n = strip
    while n < lattice.counts[None].nodes:
        i, k = lanes.column_and_row(lattice, n)
        energy += ledger.energy_at(lattice, b, i, k, p)
        if ti.static(lattice.features.cells):
            energy += ledger.energy_of_cells(lattice, b, i, k, p)
        n += width
    works = lattice.state.work[b, strip]
    for c in ti.static(range(len(ENERGIES_NOW))):
        shared[c * THREADS + t] = energy[c]
    for c in ti.static(range(WORKS)):
        shared[ti.static(len(ENERGIES_NOW) + c) * THREADS + t] = works[c]
    reduce(shared, values, t, b, block, ENERGIES, ENERGY_SUMS, True)


@ti.func
def write_row(lattice: ti.template(), b, p: ti.template()):
    energy, works = ledger.vec_now(0.0), ledger.vec_works(0.0)
    for c in ti.static(range(len(ENERGIES_NOW))):
        energy[c] = lattice.scratch.totals[b, 0, ENERGIES + c]
    for c in ti.static(range(WORKS)):
        works[c] = lattice.scratch.totals[b, 0, ti.static(ENERGIES + len(ENERGIES_NOW) + c)]
    clock.close_row(lattice, b, energy, works, p)


@ti.func
def close_step(lattice: ti.template(), b, p: ti.template()):
    breaks = ti.i32(lattice.scratch.totals[b, 0, BREAKS])
    diverged = ti.i32(-lattice.scratch.totals[b, 0, DIVERGING])
    moved, stiffest = lattice.scratch.totals[b, 0, MOVED], lattice.scratch.totals[b, 0, STIFFEST]
    crush = lattice.scratch.totals[b, 0, CRUSH]
    clock.close_step(lattice, b, moved, stiffest, crush, breaks, diverged, p)


@ti.func
def soften_strip(lattice: ti.template(), b, strip, width, p: ti.template()):
    """Reduce the intact shares of a strip's bonds."""
    lost = 0.0
    n = strip
    while n < lattice.counts[None].nodes:
        i, k = lanes.column_and_row(lattice, n)
        lost = bonds.soften_at(lattice, b, i, k, lost, p)
        n += width
    book(lattice, b, strip, WORK.lost_by_bonds, lost)


@ti.func
def break_strip(lattice: ti.template(), b, strip, width, p: ti.template()):
    """Break a strip's failed bonds. All strips must finish this before `look_strip`."""
    time = ti.cast(lattice.state.clock[b].time, ti.f32)
    lost = 0.0
    n = strip
    while n < lattice.counts[None].nodes:
        i, k = lanes.column_and_row(lattice, n)
        lost = bonds.break_at(lattice, b, i, k, time, lost, p)
        n += width
    book(lattice, b, strip, WORK.lost_by_bonds, lost)
