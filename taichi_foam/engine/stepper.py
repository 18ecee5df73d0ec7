"""The time loop: Runge-Kutta stages, history, step size, and when to stop.

Two ways to run the same functions in the same order, with the same numbers to the last bit:
`fused` keeps a whole lattice on one thread for thousands of steps in one call (a call costs as
much as a stage of a small lattice), `staged` spreads the columns of a big lattice over the threads.
"""

from collections.abc import Callable

import taichi as ti

from taichi_foam.engine import contact, faces, ledger, nodes, runtime
from taichi_foam.engine.lattice import (
    AT_END_TIME,
    AT_REBOUND,
    NEVER,
    NOT_FINITE,
    ROWS,
    RUNNING,
    Lattice,
)
from taichi_foam.engine.parameters import NO_IMPACTOR, stable_step

# From this many nodes on, a stage is worth spreading over threads.
STAGED_NODES = 50_000

# Taichi gives each CPU thread at least this many iterations of a parallel loop, whatever its
# bodies cost. So a loop over few costly bodies is stretched by as much, and runs one in each.
GRAIN = 512

# Tasks that the columns of a big lattice are dealt out in.
TASKS = 32

# After the impactor's reversal a run goes on until contact has been lost for QUIET, or for at most
# SETTLING: enough to measure the rebound velocity.
QUIET = 1e-3
SETTLING = 8e-3


@ti.func
def _goes_on(lattice: ti.template(), b) -> ti.i32:
    clock = lattice.clock[b]
    return ti.i32(clock.status == RUNNING and clock.time < lattice.pause[b] and clock.rows < ROWS)


@ti.func
def _take_stock(lattice: ti.template(), b, p: ti.template()):
    """Of an accepted state whose columns have been latched: breaks, step size, an end."""
    densified = 0.0
    breaks = 0.0
    for i in range(lattice.columns):
        found = lattice.column_found[b, i]
        densified = ti.max(densified, found[0])
        breaks += found[1]
    lattice.clock[b].newly_broken = ti.i32(breaks)
    lattice.clock[b].stale |= ti.i32(breaks > 0.0)
    lattice.clock[b].broken += ti.i32(breaks)
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
def _refresh_column(lattice: ti.template(), b, i, p: ti.template()):
    """Keep the touching radii up to date, and see whether the neighbour list may miss a touch."""
    for j in range(lattice.rows):
        lattice.radius[b, i, j] = contact.piece_radius(lattice, b, i, j, p)
        if contact.drifted(lattice, b, i, j, p):
            lattice.clock[b].stale = 1


@ti.func
def _push_column(lattice: ti.template(), b, i, p: ti.template()):
    for j in range(lattice.rows):
        contact.self_contact(lattice, b, i, j, p)


@ti.func
def _end_step(lattice: ti.template(), b):
    """Move the clock, and stop a lattice that has gone astray."""
    lattice.clock[b].time += lattice.clock[b].step
    lattice.clock[b].steps += 1
    for i in range(lattice.columns):
        if lattice.column_bad[b, i] < lattice.rows and lattice.clock[b].status == RUNNING:
            lattice.clock[b].status = NOT_FINITE
            lattice.clock[b].bad_node = i * lattice.rows + lattice.column_bad[b, i]


@ti.func
def _take_step(lattice: ti.template(), b, p: ti.template()):
    """One step of one lattice on one thread: latch the accepted state, then four stages.

    The first stage's forces come with the latch. If connections broke, they are worked out again.
    """
    for i in range(lattice.columns):
        faces.face_column(lattice, True, b, i, p)
    _take_stock(lattice, b, p)
    if _row_is_due(lattice, b):
        for i in range(lattice.columns):
            ledger.energy_column(lattice, b, i, p)
        _close_row(lattice, b, p)
    broke = lattice.clock[b].newly_broken
    if broke:
        for i in range(lattice.columns):
            for j in range(lattice.rows):
                faces.book_fracture(lattice, b, i, j, p)
                faces.update_halves(lattice, b, i, j, p)
    if p.self_contact:
        for i in range(lattice.columns):
            _refresh_column(lattice, b, i, p)
        if lattice.clock[b].stale:
            contact.list_neighbours(lattice, b, p)
    if lattice.clock[b].status == RUNNING:
        for stage in range(4):
            if stage > 0 or broke:
                for i in range(lattice.columns):
                    faces.face_column(lattice, False, b, i, p)
            if p.self_contact:
                for i in range(lattice.columns):
                    _push_column(lattice, b, i, p)
            for i in range(lattice.columns):
                nodes.node_column(lattice, b, i, stage, p)
            nodes.body_stage(lattice, b, stage, p)
        _end_step(lattice, b)


@ti.kernel
def prepare(lattice: ti.template()):
    """Before the first step: say which halves every connection's gradient has."""
    for b, i, j in ti.ndrange(lattice.batch, lattice.columns, lattice.rows):
        p = lattice.parameters[b]
        faces.update_halves(lattice, b, i, j, p)


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
def _first_column(lattice: ti.template(), task) -> ti.i32:
    return task * lattice.batch * lattice.columns // TASKS


@ti.kernel
def _staged_latch(lattice: ti.template()):
    """What a step begins with, columns spread over the threads."""
    for b in range(lattice.batch):
        lattice.clock[b].active = _goes_on(lattice, b)
    for q in range(TASKS * GRAIN):
        if q % GRAIN == 0:
            task = q // GRAIN
            for column in range(_first_column(lattice, task), _first_column(lattice, task + 1)):
                b = column // lattice.columns
                if lattice.clock[b].active:
                    p = lattice.parameters[b]
                    faces.face_column(lattice, True, b, column % lattice.columns, p)
    for b in range(lattice.batch):
        if lattice.clock[b].active:
            p = lattice.parameters[b]
            _take_stock(lattice, b, p)
    for q in range(TASKS * GRAIN):
        if q % GRAIN == 0:
            task = q // GRAIN
            for column in range(_first_column(lattice, task), _first_column(lattice, task + 1)):
                b = column // lattice.columns
                i = column % lattice.columns
                if lattice.clock[b].active:
                    p = lattice.parameters[b]
                    if _row_is_due(lattice, b):
                        ledger.energy_column(lattice, b, i, p)
                    if lattice.clock[b].newly_broken:
                        for j in range(lattice.rows):
                            faces.book_fracture(lattice, b, i, j, p)
                            faces.update_halves(lattice, b, i, j, p)
                    if p.self_contact:
                        _refresh_column(lattice, b, i, p)
    for b in range(lattice.batch):
        if lattice.clock[b].active:
            p = lattice.parameters[b]
            if _row_is_due(lattice, b):
                _close_row(lattice, b, p)
            if p.self_contact and lattice.clock[b].stale:
                contact.list_neighbours(lattice, b, p)
            lattice.clock[b].active = ti.i32(lattice.clock[b].status == RUNNING)


@ti.kernel
def _staged_stage(lattice: ti.template(), stage: ti.i32):
    """One Runge-Kutta stage, columns spread over the threads."""
    for q in range(TASKS * GRAIN):
        if q % GRAIN == 0:
            task = q // GRAIN
            for column in range(_first_column(lattice, task), _first_column(lattice, task + 1)):
                b = column // lattice.columns
                if lattice.clock[b].active:
                    p = lattice.parameters[b]
                    if stage > 0 or lattice.clock[b].newly_broken:
                        faces.face_column(lattice, False, b, column % lattice.columns, p)
                    if p.self_contact:
                        _push_column(lattice, b, column % lattice.columns, p)
    for q in range(TASKS * GRAIN):
        if q % GRAIN == 0:
            task = q // GRAIN
            for column in range(_first_column(lattice, task), _first_column(lattice, task + 1)):
                b = column // lattice.columns
                if lattice.clock[b].active:
                    p = lattice.parameters[b]
                    nodes.node_column(lattice, b, column % lattice.columns, stage, p)
    for b in range(lattice.batch):
        if lattice.clock[b].active:
            p = lattice.parameters[b]
            nodes.body_stage(lattice, b, stage, p)
            if stage == nodes.LAST_STAGE:
                _end_step(lattice, b)


def advance_staged(lattice: Lattice, most_steps: int) -> None:
    """Up to `most_steps` steps of every lattice that goes on, each spread over the threads."""
    for _ in range(most_steps):
        _staged_latch(lattice)
        for stage in range(4):
            _staged_stage(lattice, stage)


def advance_of(lattice: Lattice) -> Callable[[Lattice, int], None]:
    """The faster way to step `lattice`: a GPU's threads are too slow for a whole lattice each."""
    if lattice.nodes >= STAGED_NODES or runtime.settings()["arch"] != "cpu":
        return advance_staged
    return advance_fused
