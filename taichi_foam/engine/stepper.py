"""The time loop: Runge-Kutta stages, history, step size, and when to stop.

A stage is a *sweep* over columns: it works out the forces of one column's bonds, then moves
the nodes of the column before it, whose forces are then complete. So a stage reads and writes each
node once, and keeps the forces of only a few columns.

Two ways to run the same functions, with the same numbers to the last bit: `fused` keeps a whole
lattice on one thread for thousands of steps in one call (a call costs as much as a stage of a small
lattice), `staged` deals the columns of a big lattice out to several sweeps.
"""

from collections.abc import Callable

import taichi as ti

from taichi_foam.engine import blocks, bonds, breaking, clock, contact, ledger, nodes
from taichi_foam.engine.lattice import BLOCK_NODES, LAST_STAGE, RUNNING, Lattice

# From this many nodes on, a stage is worth spreading over threads.
STAGED_NODES = 50_000

# Taichi gives each CPU thread at least this many iterations of a parallel loop, whatever its
# bodies cost. So a loop over few costly bodies is stretched by as much, and runs one in each.
GRAIN = 512


@ti.func
def _take_stock(lattice: ti.template(), b, p: ti.template()):
    densified = 0.0
    for strip in range(lattice.strips):
        densified = ti.max(densified, lattice.strip_stiffest[b, strip])
    clock.take_stock(lattice, b, densified, p)


@ti.func
def _write_row(lattice: ti.template(), b, p: ti.template()):
    energy, fracture, works = ledger.add_strips(lattice, b)
    clock.close_row(lattice, b, energy, fracture, works, p)


@ti.func
def _find_neighbours(lattice: ti.template(), b, p: ti.template()):
    """Before a step: which nodes may touch in it, and their radii."""
    if p.self_contact:
        if lattice.clock[b].stale:
            contact.list_neighbours(lattice, b, p)
        elif lattice.clock[b].steps % clock.REFRESH == 0:
            contact.refresh_radii(lattice, b, p)


@ti.func
def _sweep(
    lattice: ti.template(), b, stage, sweep, start, end, known_before, known_from, p: ti.template()
):
    """A stage of the columns `start` to `end`.

    The forces of columns before `known_before` and from `known_from` on are there already.
    """
    for i in range(start, end + 1):
        if known_before <= i and i < known_from:
            slot = bonds.slot_of(lattice, i, end - 1)
            bonds.face_column(lattice, stage, b, i, i, sweep, slot, p)
        if i > start:
            slot = bonds.slot_of(lattice, i - 1, end - 1)
            left_slot = bonds.slot_of(lattice, i - 2, end - 1)
            right_slot = bonds.slot_of(lattice, i, end - 1)
            nodes.node_column(lattice, b, i - 1, stage, sweep, slot, left_slot, right_slot, p)


@ti.func
def _end_step(lattice: ti.template(), b, p: ti.template()):
    """Move the clock, break what has failed, and stop a lattice that has gone astray."""
    moved = 0.0
    breaks = 0
    astray = 0.0
    for strip in range(lattice.strips):
        moved = ti.max(moved, lattice.tally[b, strip].moved.max())
        astray += lattice.tally[b, strip].astray.sum()
    for i in range(lattice.columns):
        breaks += lattice.column_breaks[b, i]
    bad_node = lattice.nodes
    if astray > 0.0:
        bad_node = nodes.first_astray(lattice, b)
    clock.close_step(lattice, b, moved, breaks, bad_node, p)
    if breaks > 0:
        _break(lattice, b, p)


@ti.func
def _break(lattice: ti.template(), b, p: ti.template()):
    for i in range(lattice.columns):
        if lattice.column_breaks[b, i] > 0:
            breaking.break_bonds(lattice, b, i, p)
    for i in range(lattice.columns):
        near = lattice.column_breaks[b, i]
        near += lattice.column_breaks[b, ti.max(i - 1, 0)]
        near += lattice.column_breaks[b, ti.min(i + 1, lattice.columns - 1)]
        if near > 0:
            for j in range(lattice.rows):
                breaking.update_halves(lattice, b, i, j)


@ti.func
def _stage(lattice: ti.template(), b, stage, p: ti.template()):
    """One stage of a whole lattice on one thread."""
    if p.self_contact:
        contact.push_pieces(lattice, b, p)
    sweep = b * lattice.sweeps
    columns = lattice.columns
    _sweep(lattice, b, stage, sweep, 0, columns, 0, columns, p)
    nodes.body_stage(lattice, b, stage, nodes.lift_of_strips(lattice, b), p)


@ti.func
def _take_step(lattice: ti.template(), b, p: ti.template()):
    """One step of one lattice on one thread."""
    _take_stock(lattice, b, p)
    if clock.row_is_due(lattice, b):
        for i in range(lattice.columns):
            ledger.energy_column(lattice, b, i, p)
        _write_row(lattice, b, p)
    _find_neighbours(lattice, b, p)
    if lattice.clock[b].status == RUNNING:
        if p.foam.rate > 0.0:
            for i in range(lattice.columns):
                bonds.flow_column(lattice, b, i, p)
        for stage in range(LAST_STAGE + 1):
            _stage(lattice, b, stage, p)
        _end_step(lattice, b, p)


def prepare(lattice: Lattice, b: int) -> None:
    """Before a lattice's first step: the halves of its gradients, its history, its stiffness."""
    if lattice.on_gpu:
        blocks.prepare(lattice, b)
    else:
        _prepare(lattice, b)


@ti.kernel
def _prepare(lattice: ti.template(), b: ti.i32):
    for _ in range(1):
        p = lattice.parameters[b]
        for i in range(lattice.columns):
            for j in range(lattice.rows):
                breaking.update_halves(lattice, b, i, j)
        for i in range(lattice.columns):
            sweep = b * lattice.sweeps
            bonds.face_column(lattice, 0, b, i, i, sweep, 0, p)


@ti.kernel
def advance_fused(lattice: ti.template(), most_steps: ti.i32):
    """Up to `most_steps` steps of every lattice that goes on, each on one thread."""
    for q in range(lattice.batch * GRAIN):
        if q % GRAIN == 0:
            b = q // GRAIN
            p = lattice.parameters[b]
            taken = 0
            while taken < most_steps and clock.goes_on(lattice, b):
                _take_step(lattice, b, p)
                taken += 1


@ti.func
def _first_column(lattice: ti.template(), sweep) -> ti.i32:
    return sweep % lattice.sweeps * lattice.columns // lattice.sweeps


@ti.func
def _end_column(lattice: ti.template(), sweep) -> ti.i32:
    return (sweep % lattice.sweeps + 1) * lattice.columns // lattice.sweeps


@ti.kernel
def _begin_staged(lattice: ti.template()):
    """What a step begins with."""
    for b in range(lattice.batch):
        lattice.clock[b].active = clock.goes_on(lattice, b)
        if lattice.clock[b].active:
            p = lattice.parameters[b]
            _take_stock(lattice, b, p)
    for q in range(lattice.batch * lattice.sweeps * GRAIN):
        if q % GRAIN == 0:
            sweep = q // GRAIN
            b = sweep // lattice.sweeps
            if lattice.clock[b].active and clock.row_is_due(lattice, b):
                p = lattice.parameters[b]
                for i in range(_first_column(lattice, sweep), _end_column(lattice, sweep)):
                    ledger.energy_column(lattice, b, i, p)
    for b in range(lattice.batch):
        if lattice.clock[b].active:
            p = lattice.parameters[b]
            if clock.row_is_due(lattice, b):
                _write_row(lattice, b, p)
            _find_neighbours(lattice, b, p)
            lattice.clock[b].active = ti.i32(lattice.clock[b].status == RUNNING)
            if p.self_contact:
                contact.push_pieces(lattice, b, p)
    for q in range(lattice.batch * lattice.sweeps * GRAIN):
        if q % GRAIN == 0:
            sweep = q // GRAIN
            b = sweep // lattice.sweeps
            if lattice.clock[b].active and lattice.parameters[b].foam.rate > 0.0:
                p = lattice.parameters[b]
                for i in range(_first_column(lattice, sweep), _end_column(lattice, sweep)):
                    bonds.flow_column(lattice, b, i, p)


@ti.kernel
def _stage_staged(lattice: ti.template(), stage: ti.i32):
    """One Runge-Kutta stage, its columns dealt out to sweeps.

    Sweeps move nodes as they go. So the forces at their seams, which depend on nodes of both
    sides, are worked out before any sweep begins.
    """
    for q in range(lattice.batch * lattice.sweeps * GRAIN):
        if q % GRAIN == 0:
            sweep = q // GRAIN
            b = sweep // lattice.sweeps
            if lattice.clock[b].active:
                p = lattice.parameters[b]
                start = _first_column(lattice, sweep)
                end = _end_column(lattice, sweep)
                for n in range(4):
                    i = ti.select(n < 2, start - 1 + n, end - 3 + n)
                    if i >= 0 and i < lattice.columns:
                        slot = bonds.slot_of(lattice, i, end - 1)
                        own = start <= i and i < end
                        strip = ti.select(own, i, lattice.strips + sweep % lattice.sweeps)
                        bonds.face_column(lattice, stage, b, i, strip, sweep, slot, p)
    for q in range(lattice.batch * lattice.sweeps * GRAIN):
        if q % GRAIN == 0:
            sweep = q // GRAIN
            b = sweep // lattice.sweeps
            if lattice.clock[b].active:
                p = lattice.parameters[b]
                start = _first_column(lattice, sweep)
                end = _end_column(lattice, sweep)
                _sweep(lattice, b, stage, sweep, start, end, start + 1, end - 1, p)
    for b in range(lattice.batch):
        if lattice.clock[b].active:
            p = lattice.parameters[b]
            nodes.body_stage(lattice, b, stage, nodes.lift_of_strips(lattice, b), p)
            if stage == LAST_STAGE:
                _end_step(lattice, b, p)
            elif p.self_contact:
                contact.push_pieces(lattice, b, p)


def advance_staged(lattice: Lattice, most_steps: int) -> None:
    """Up to `most_steps` steps of every lattice that goes on, each spread over the threads."""
    for _ in range(most_steps):
        _begin_staged(lattice)
        for stage in range(LAST_STAGE + 1):
            _stage_staged(lattice, stage)


def advance_of(lattice: Lattice) -> Callable[[Lattice, int], None]:
    """The faster way to step `lattice`."""
    if lattice.on_gpu:
        return blocks.advance_blocks if lattice.nodes <= BLOCK_NODES else blocks.advance_wide
    return advance_staged if lattice.nodes >= STAGED_NODES else advance_fused
