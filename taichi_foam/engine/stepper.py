"""The time loop: Runge-Kutta stages, history, step size, and when to stop.

A stage is a *sweep* over columns: it works out the forces of one column's connections, then moves
the nodes of the column before it, whose forces are then complete. So a stage reads and writes each
node once, and keeps the forces of only a few columns.

Two ways to run the same functions, with the same numbers to the last bit: `fused` keeps a whole
lattice on one thread for thousands of steps in one call (a call costs as much as a stage of a small
lattice), `staged` deals the columns of a big lattice out to several sweeps.
"""

from collections.abc import Callable

import taichi as ti

from taichi_foam.engine import contact, faces, ledger, nodes
from taichi_foam.engine.lattice import (
    AT_END_TIME,
    AT_REBOUND,
    HISTORY_ROWS,
    LAST_STAGE,
    NEVER,
    NOT_FINITE,
    RUNNING,
    Lattice,
)
from taichi_foam.engine.parameters import NO_IMPACTOR, stable_step

# From this many nodes on, a stage is worth spreading over threads.
STAGED_NODES = 50_000

# Taichi gives each CPU thread at least this many iterations of a parallel loop, whatever its
# bodies cost. So a loop over few costly bodies is stretched by as much, and runs one in each.
GRAIN = 512

# Steps after which the radii in contact are brought up to date with the nodes' crush.
REFRESH = 4

# After the impactor's reversal a run goes on until contact has been lost for QUIET, or for at most
# SETTLING: enough to measure the rebound velocity.
QUIET = 1e-3
SETTLING = 8e-3


@ti.func
def _goes_on(lattice: ti.template(), b) -> ti.i32:
    clock = lattice.clock[b]
    return ti.i32(
        clock.status == RUNNING and clock.time < clock.pause and clock.rows < HISTORY_ROWS
    )


@ti.func
def _take_stock(lattice: ti.template(), b, p: ti.template()):
    """Of an accepted state: step size, an end.

    The stiffness comes from the last stage's forces, which looked at the step's end.
    """
    densified = 0.0
    for strip in range(lattice.strips):
        densified = ti.max(densified, lattice.strip_stiffest[b, strip])
    step = p.step
    if step == 0.0:
        step = stable_step(p, densified)
    lattice.clock[b].step = step
    lattice.clock[b].shortest = ti.min(lattice.clock[b].shortest, step)
    lattice.clock[b].longest = ti.max(lattice.clock[b].longest, step)
    _end_when_due(lattice, b, p)


@ti.func
def _end_when_due(lattice: ti.template(), b, p: ti.template()):
    """Set the status of a lattice that has come to its end time, or has rebounded."""
    time = lattice.clock[b].time
    if lattice.body[b].force != 0.0:
        lattice.clock[b].last_contact = time
    moves_up = p.impactor_kind != NO_IMPACTOR and lattice.body[b].v >= 0.0
    if lattice.clock[b].reversal == NEVER and moves_up:
        lattice.clock[b].reversal = time
    since = time - lattice.clock[b].reversal
    apart = time - lattice.clock[b].last_contact
    if p.end_at_rebound and ((since > QUIET and apart > QUIET) or since > SETTLING):
        lattice.clock[b].status = AT_REBOUND
    elif time >= p.end_time:
        lattice.clock[b].status = AT_END_TIME


@ti.func
def _row_is_due(lattice: ti.template(), b) -> ti.i32:
    clock = lattice.clock[b]
    return ti.i32(clock.time >= clock.next_row or clock.status != RUNNING)


@ti.func
def _close_row(lattice: ti.template(), b, p: ti.template()):
    ledger.write_row(lattice, b)
    due = ti.floor(lattice.clock[b].time / p.row_interval + 1e-9) + 1.0
    lattice.clock[b].next_row = due * p.row_interval


@ti.func
def _find_neighbours(lattice: ti.template(), b, p: ti.template()):
    """Before a step: which nodes may touch in it, and their radii."""
    if p.self_contact:
        if lattice.clock[b].stale:
            contact.list_neighbours(lattice, b, p)
        elif lattice.clock[b].steps % REFRESH == 0:
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
            slot = faces.slot_of(lattice, i, end - 1)
            faces.face_column(lattice, stage, b, i, i, sweep, slot, p)
        if i > start:
            slot = faces.slot_of(lattice, i - 1, end - 1)
            left_slot = faces.slot_of(lattice, i - 2, end - 1)
            nodes.node_column(lattice, b, i - 1, stage, sweep, slot, left_slot, p)


@ti.func
def _end_step(lattice: ti.template(), b, p: ti.template()):
    """Move the clock, break what has failed, and stop a lattice that has gone astray."""
    lattice.clock[b].time += lattice.clock[b].step
    lattice.clock[b].steps += 1
    moved = 0.0
    breaks = 0
    astray = 0.0
    for strip in range(lattice.strips):
        moved = ti.max(moved, lattice.tally[b, strip].moved.max())
        astray += lattice.tally[b, strip].astray.sum()
    for i in range(lattice.columns):
        breaks += lattice.column_breaks[b, i]
    if astray > 0.0:
        lattice.clock[b].status = NOT_FINITE
        lattice.clock[b].bad_node = nodes.first_astray(lattice, b)
    lattice.clock[b].drift += ti.sqrt(moved)
    if 2.0 * lattice.clock[b].drift > p.skin:
        lattice.clock[b].stale = 1
    if breaks > 0:
        lattice.clock[b].broken += breaks
        lattice.clock[b].stale = 1
        _break(lattice, b, p)


@ti.func
def _break(lattice: ti.template(), b, p: ti.template()):
    for i in range(lattice.columns):
        if lattice.column_breaks[b, i] > 0:
            faces.break_connections(lattice, b, i, p)
    for i in range(lattice.columns):
        near = lattice.column_breaks[b, i]
        near += lattice.column_breaks[b, ti.max(i - 1, 0)]
        near += lattice.column_breaks[b, ti.min(i + 1, lattice.columns - 1)]
        if near > 0:
            for j in range(lattice.rows):
                faces.update_halves(lattice, b, i, j)


@ti.func
def _stage(lattice: ti.template(), b, stage, p: ti.template()):
    """One stage of a whole lattice on one thread."""
    if p.self_contact:
        contact.push_pieces(lattice, b, p)
    sweep = b * lattice.sweeps
    columns = lattice.columns
    _sweep(lattice, b, stage, sweep, 0, columns, 0, columns, p)
    nodes.body_stage(lattice, b, stage, p)


@ti.func
def _take_step(lattice: ti.template(), b, p: ti.template()):
    """One step of one lattice on one thread."""
    _take_stock(lattice, b, p)
    if _row_is_due(lattice, b):
        for i in range(lattice.columns):
            ledger.energy_column(lattice, b, i, p)
        _close_row(lattice, b, p)
    _find_neighbours(lattice, b, p)
    if lattice.clock[b].status == RUNNING:
        for stage in range(LAST_STAGE + 1):
            _stage(lattice, b, stage, p)
        _end_step(lattice, b, p)


@ti.kernel
def prepare(lattice: ti.template(), b: ti.i32):
    """Before a lattice's first step: the halves of its gradients, its history, its stiffness."""
    for _ in range(1):
        p = lattice.parameters[b]
        for i in range(lattice.columns):
            for j in range(lattice.rows):
                faces.update_halves(lattice, b, i, j)
        for i in range(lattice.columns):
            sweep = b * lattice.sweeps
            faces.face_column(lattice, 0, b, i, i, sweep, 0, p)


@ti.kernel
def advance_fused(lattice: ti.template(), most_steps: ti.i32):
    """Up to `most_steps` steps of every lattice that goes on, each on one thread."""
    for q in range(lattice.batch * GRAIN):
        if q % GRAIN == 0:
            b = q // GRAIN
            p = lattice.parameters[b]
            taken = 0
            while taken < most_steps and _goes_on(lattice, b):
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
        lattice.clock[b].active = _goes_on(lattice, b)
        if lattice.clock[b].active:
            p = lattice.parameters[b]
            _take_stock(lattice, b, p)
    for q in range(lattice.batch * lattice.sweeps * GRAIN):
        if q % GRAIN == 0:
            sweep = q // GRAIN
            b = sweep // lattice.sweeps
            if lattice.clock[b].active and _row_is_due(lattice, b):
                p = lattice.parameters[b]
                for i in range(_first_column(lattice, sweep), _end_column(lattice, sweep)):
                    ledger.energy_column(lattice, b, i, p)
    for b in range(lattice.batch):
        if lattice.clock[b].active:
            p = lattice.parameters[b]
            if _row_is_due(lattice, b):
                _close_row(lattice, b, p)
            _find_neighbours(lattice, b, p)
            lattice.clock[b].active = ti.i32(lattice.clock[b].status == RUNNING)
            if p.self_contact:
                contact.push_pieces(lattice, b, p)


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
                for n in range(3):
                    i = ti.select(n == 2, end - 1, start - 1 + n)
                    if i >= 0:
                        slot = faces.slot_of(lattice, i, end - 1)
                        strip = ti.select(n == 0, lattice.strips + sweep % lattice.sweeps, i)
                        faces.face_column(lattice, stage, b, i, strip, sweep, slot, p)
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
            nodes.body_stage(lattice, b, stage, p)
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
    return advance_staged if lattice.nodes >= STAGED_NODES else advance_fused
