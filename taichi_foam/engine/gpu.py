"""Stepping on a GPU, in two ways that run the same functions of strips.

`advance_blocks` gives each lattice one block, whose threads synchronise at barriers, for many steps
in one call: a call takes as long as several steps of a small lattice. `advance_wide` spreads each
lattice over blocks, and launches kernels for each part of a step.
"""

from taichi_foam.backend import ti
from taichi_foam.engine import clock, gpu_neighbours, gpu_strips, runtime
from taichi_foam.engine.lattice import LAST_STAGE, Lattice
from taichi_foam.engine.layout import THREADS
from taichi_foam.engine.scratch import (
    BREAKS,
    CONTACT_FORCE,
    ENERGIES,
    ENERGY_SUMS,
    MOVED,
    STIFFEST,
)
from taichi_foam.engine.state import RUNNING

# Mesa's software Vulkan silently ends all loops of a thread after MOST_ITERATIONS iterations in one
# call. A step takes at most PER_TURN iterations each time the threads pass over the nodes (mostly
# the search for partners in nine bins, twice, with up to a dozen nodes each), PER_STEP in the trees
# of its reductions, plus one for each node and each thread where it fills the bins and counts
# neighbours.
MOST_ITERATIONS = 65_535
PER_TURN, PER_STEP = 400, 80


# One block per lattice.


@ti.func
def _find_neighbours(lattice: ti.template(), shared: ti.template(), b, t, p: ti.template()):
    """Find the nodes that may touch in the next step, and their radii."""
    if lattice.state.clock[b].stale:
        gpu_neighbours.begin_list(lattice, b, t, THREADS, p)
        ti.simt.block.sync()
        gpu_neighbours.fill_own_bins(lattice, b, t, THREADS)
        ti.simt.block.sync()
        total = gpu_neighbours.count_partners(lattice, b, t, THREADS, p)
        shared[t] = total
        ti.simt.block.sync()
        start = 0
        for before in range(t):
            start += ti.i32(shared[before])
        if t == THREADS - 1:
            lattice.state.clock[b].pairs = start + total
        gpu_neighbours.list_partners(lattice, b, t, THREADS, start, total, p)
        ti.simt.block.sync()
        gpu_neighbours.make_room(lattice, b, t, THREADS)
        ti.simt.block.sync()
        gpu_neighbours.end_list(lattice, b, t, THREADS, p)
        if t == 0:
            gpu_neighbours.close_list(lattice, b)
    elif lattice.state.clock[b].steps % clock.REFRESH == 0:
        gpu_neighbours.refresh_radii(lattice, b, t, THREADS, p)
    ti.simt.block.sync()


@ti.func
def _stage(lattice: ti.template(), shared: ti.template(), b, t, stage, p: ti.template()):
    gpu_strips.bond_strip(lattice, stage, b, t, THREADS, p)
    ti.simt.block.sync()
    diverged = gpu_strips.node_strip(lattice, b, t, THREADS, stage, p)
    gpu_strips.reduce_stage(lattice, shared, lattice.scratch.totals, t, b, 0, t, stage, diverged)
    if t == 0:
        gpu_strips.body_stage(lattice, b, stage, p)
        if stage == LAST_STAGE:
            gpu_strips.close_step(lattice, b, p)
    ti.simt.block.sync()


@ti.func
def _take_step(lattice: ti.template(), shared: ti.template(), b, t, p: ti.template()):
    if t == 0:
        clock.take_stock(lattice, b, p)
    ti.simt.block.sync()
    if clock.row_is_due(lattice, b):
        gpu_strips.reduce_energies(lattice, shared, lattice.scratch.totals, t, b, 0, t, THREADS, p)
        if t == 0:
            gpu_strips.write_row(lattice, b, p)
    if ti.static(lattice.features.self_contact):
        _find_neighbours(lattice, shared, b, t, p)
    if lattice.state.clock[b].status == RUNNING:
        if ti.static(lattice.features.flows):
            gpu_strips.flow_strip(lattice, b, t, THREADS, p)
            ti.simt.block.sync()
        for stage in range(LAST_STAGE + 1):
            _stage(lattice, shared, b, t, stage, p)
        if ti.static(lattice.features.softens):
            gpu_strips.soften_strip(lattice, b, t, THREADS, p)
        if lattice.scratch.totals[b, 0, BREAKS] > 0.0:
            gpu_strips.break_strip(lattice, b, t, THREADS, p)
        if ti.static(lattice.features.cells):
            ti.simt.block.sync()
            gpu_strips.look_strip(lattice, b, t, THREADS, True, p)
    ti.simt.block.sync()


@ti.kernel
def _advance_blocks(lattice: ti.template(), most_steps: ti.i32):
    ti.loop_config(block_dim=THREADS)
    for q in range(lattice.batch * THREADS):
        shared = ti.simt.block.SharedArray((ENERGY_SUMS * THREADS,), ti.f64)
        b = q // THREADS
        t = q % THREADS
        p = lattice.model.parameters[b]
        taken = 0
        while taken < most_steps and clock.goes_on(lattice, b):
            ti.simt.block.sync()  # all threads have read the clock before it changes
            _take_step(lattice, shared, b, t, p)
            taken += 1


def advance_blocks(lattice: Lattice, most_steps: int) -> None:
    """Take up to `most_steps` steps of every running lattice, each in one block of threads."""
    most = max(most_steps, 1)
    if runtime.settings()["arch"] == "vulkan":
        turns = -(-lattice.size.nodes // THREADS)
        each = PER_TURN * turns + PER_STEP + lattice.size.nodes + THREADS
        most = max(1, MOST_ITERATIONS // each)
    for taken in range(0, max(most_steps, 1), most):
        _advance_blocks(lattice, min(most, most_steps - taken))


# Kernels for each part of a step, spread over blocks.


@ti.kernel
def _begin_wide(lattice: ti.template()):
    """Begin a step: step size and history."""
    for b in range(lattice.batch):
        lattice.state.clock[b].active = clock.goes_on(lattice, b)
        if lattice.state.clock[b].active:
            p = lattice.model.parameters[b]
            clock.take_stock(lattice, b, p)
    ti.loop_config(block_dim=THREADS)
    for q in range(lattice.batch * lattice.strips):
        shared = ti.simt.block.SharedArray((ENERGY_SUMS * THREADS,), ti.f64)
        b = q // lattice.strips
        strip = q % lattice.strips
        if lattice.state.clock[b].active and clock.row_is_due(lattice, b):
            p = lattice.model.parameters[b]
            gpu_strips.reduce_energies(
                lattice, shared, lattice.scratch.sums, q % THREADS, b, strip // THREADS, strip,
                lattice.strips, p,
            )  # fmt: skip
    ti.loop_config(block_dim=THREADS)
    for q in range(lattice.batch * THREADS):
        shared = ti.simt.block.SharedArray((ENERGY_SUMS * THREADS,), ti.f64)
        b = q // THREADS
        t = q % THREADS
        if lattice.state.clock[b].active and clock.row_is_due(lattice, b):
            p = lattice.model.parameters[b]
            _add_blocks(lattice, shared, t, b, ENERGIES, ENERGY_SUMS, True)
            if t == 0:
                gpu_strips.write_row(lattice, b, p)
    for b in range(lattice.batch):
        if lattice.state.clock[b].status != RUNNING:
            lattice.state.clock[b].active = 0


@ti.func
def _add_blocks(
    lattice: ti.template(), shared: ti.template(), t, b, first: ti.template(),
    count: ti.template(), adding: ti.template(),
):  # fmt: skip
    """Reduce the sums of a lattice's blocks to its totals, in one block."""
    for c in range(count):
        value = lattice.scratch.sums[b, ti.min(t, lattice.blocks - 1), first + c]
        if ti.static(adding):
            value = ti.select(t < lattice.blocks, value, 0.0)
        block = t + THREADS
        while block < lattice.blocks:
            more = lattice.scratch.sums[b, block, first + c]
            if ti.static(adding):
                value += more
            else:
                value = ti.max(value, more)
            block += THREADS
        shared[c * THREADS + t] = value
    gpu_strips.reduce(shared, lattice.scratch.totals, t, b, 0, first, count, adding)


@ti.func
def _lists(lattice: ti.template(), b) -> ti.i32:
    """Whether a lattice needs new lists of partners for this step."""
    return ti.i32(lattice.state.clock[b].active and lattice.state.clock[b].stale)


@ti.kernel
def _find_neighbours_wide(lattice: ti.template()):
    width = lattice.strips
    for q in range(lattice.batch * lattice.strips):
        if _lists(lattice, q // width):
            b = q // width
            p = lattice.model.parameters[b]
            gpu_neighbours.begin_list(lattice, b, q % width, width, p)
    ti.loop_config(block_dim=THREADS)
    for q in range(lattice.batch * lattice.strips):
        if _lists(lattice, q // width):
            b = q // width
            p = lattice.model.parameters[b]
            gpu_neighbours.fill_bins(lattice, b, q % width, width)
        ti.simt.block.sync()  # without a barrier in the kernel, Mesa ends a loop with atomics early
    ti.loop_config(block_dim=THREADS)
    for q in range(lattice.batch * lattice.strips):
        if _lists(lattice, q // width):
            b = q // width
            p = lattice.model.parameters[b]
            total = gpu_neighbours.count_partners(lattice, b, q % width, width, p)
            start = ti.atomic_add(lattice.state.clock[b].pairs, total)
            gpu_neighbours.list_partners(lattice, b, q % width, width, start, total, p)
    for q in range(lattice.batch * lattice.strips):
        if _lists(lattice, q // width):
            gpu_neighbours.make_room(lattice, q // width, q % width, width)
    for q in range(lattice.batch * lattice.strips):
        b = q // width
        if lattice.state.clock[b].active:
            p = lattice.model.parameters[b]
            if lattice.state.clock[b].stale:
                gpu_neighbours.end_list(lattice, b, q % width, width, p)
            elif lattice.state.clock[b].steps % clock.REFRESH == 0:
                gpu_neighbours.refresh_radii(lattice, b, q % width, width, p)
    for b in range(lattice.batch):
        if _lists(lattice, b):
            gpu_neighbours.close_list(lattice, b)
        if lattice.state.clock[b].status != RUNNING:
            lattice.state.clock[b].active = 0


@ti.kernel
def _flow_wide(lattice: ti.template()):
    for q in range(lattice.batch * lattice.strips):
        b = q // lattice.strips
        if lattice.state.clock[b].active:
            p = lattice.model.parameters[b]
            gpu_strips.flow_strip(lattice, b, q % lattice.strips, lattice.strips, p)


@ti.kernel
def _stage_wide(lattice: ti.template(), stage: ti.i32):
    for q in range(lattice.batch * lattice.strips):
        b = q // lattice.strips
        if lattice.state.clock[b].active:
            p = lattice.model.parameters[b]
            gpu_strips.bond_strip(lattice, stage, b, q % lattice.strips, lattice.strips, p)
    ti.loop_config(block_dim=THREADS)
    for q in range(lattice.batch * lattice.strips):
        shared = ti.simt.block.SharedArray((5 * THREADS,), ti.f64)
        b = q // lattice.strips
        strip = q % lattice.strips
        if lattice.state.clock[b].active:
            p = lattice.model.parameters[b]
            diverged = gpu_strips.node_strip(lattice, b, strip, lattice.strips, stage, p)
            gpu_strips.reduce_stage(
                lattice, shared, lattice.scratch.sums, q % THREADS, b, strip // THREADS, strip,
                stage, diverged,
            )  # fmt: skip
    ti.loop_config(block_dim=THREADS)
    for q in range(lattice.batch * THREADS):
        shared = ti.simt.block.SharedArray((5 * THREADS,), ti.f64)
        b = q // THREADS
        t = q % THREADS
        if lattice.state.clock[b].active:
            p = lattice.model.parameters[b]
            _add_blocks(
                lattice, shared, t, b, CONTACT_FORCE, ti.static(gpu_strips.loads(lattice)), True
            )
            if stage == LAST_STAGE:
                _add_blocks(lattice, shared, t, b, MOVED, 5, False)
                _add_blocks(lattice, shared, t, b, BREAKS, 1, True)
            if t == 0:
                gpu_strips.body_stage(lattice, b, stage, p)
                if stage == LAST_STAGE:
                    gpu_strips.close_step(lattice, b, p)


@ti.kernel
def _break_wide(lattice: ti.template()):
    if ti.static(lattice.features.softens):
        for q in range(lattice.batch * lattice.strips):
            b = q // lattice.strips
            if lattice.state.clock[b].active:
                p = lattice.model.parameters[b]
                gpu_strips.soften_strip(lattice, b, q % lattice.strips, lattice.strips, p)
    for q in range(lattice.batch * lattice.strips):
        b = q // lattice.strips
        if lattice.state.clock[b].active and lattice.scratch.totals[b, 0, BREAKS] > 0.0:
            p = lattice.model.parameters[b]
            gpu_strips.break_strip(lattice, b, q % lattice.strips, lattice.strips, p)
    if ti.static(lattice.features.cells):
        for q in range(lattice.batch * lattice.strips):
            b = q // lattice.strips
            if lattice.state.clock[b].active:
                p = lattice.model.parameters[b]
                gpu_strips.look_strip(lattice, b, q % lattice.strips, lattice.strips, True, p)


def advance_wide(lattice: Lattice, most_steps: int) -> None:
    """Take up to `most_steps` steps of every running lattice, each spread over blocks."""
    for _ in range(most_steps):
        _begin_wide(lattice)
        if lattice.features.self_contact:
            _find_neighbours_wide(lattice)
        if lattice.features.flows:
            _flow_wide(lattice)
        for stage in range(LAST_STAGE + 1):
            _stage_wide(lattice, stage)
        _break_wide(lattice)


@ti.kernel
def look(lattice: ti.template(), b: ti.i32):
    """Update what the cells of a state just put carry."""
    for strip in range(lattice.strips):
        p = lattice.model.parameters[b]
        gpu_strips.look_strip(lattice, b, strip, lattice.strips, False, p)


@ti.kernel
def find_stiffest(lattice: ti.template(), b: ti.i32):
    """Find the stiffest stiffened bond of a state just put."""
    ti.loop_config(block_dim=THREADS)
    for strip in range(lattice.strips):
        shared = ti.simt.block.SharedArray((THREADS,), ti.f64)
        p = lattice.model.parameters[b]
        t = strip % THREADS
        gpu_strips.bond_strip(lattice, 0, b, strip, lattice.strips, p)
        shared[t] = lattice.scratch.stiffest[b, strip]
        gpu_strips.reduce(shared, lattice.scratch.sums, t, b, strip // THREADS, STIFFEST, 1, False)
    ti.loop_config(block_dim=THREADS)
    for t in range(THREADS):
        shared = ti.simt.block.SharedArray((THREADS,), ti.f64)
        _add_blocks(lattice, shared, t, b, STIFFEST, 1, False)
        if t == 0:
            lattice.state.clock[b].stiffest = lattice.scratch.totals[b, 0, STIFFEST]
