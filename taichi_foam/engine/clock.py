"""When a lattice steps, by how much, when a row of its history is due, and when it ends.

One thread does this for a lattice, whoever does the rest.
"""

import taichi as ti

from taichi_foam.engine import ledger
from taichi_foam.engine.lattice import (
    AT_END_TIME,
    AT_REBOUND,
    HISTORY_ROWS,
    NEVER,
    NOT_FINITE,
    RUNNING,
)
from taichi_foam.engine.parameters import NO_IMPACTOR, stable_step

# Steps after which the radii in contact are brought up to date with the nodes' crush.
REFRESH = 4

# After the impactor's reversal a run goes on until contact has been lost for QUIET, or for at most
# SETTLING: enough to measure the rebound velocity.
QUIET = 1e-3
SETTLING = 8e-3

vec3 = ti.types.vector(3, ti.f64)
vec8 = ti.types.vector(8, ti.f64)


@ti.func
def goes_on(lattice: ti.template(), b) -> ti.i32:
    """Whether a lattice takes another step in this call."""
    clock = lattice.clock[b]
    return ti.i32(
        clock.status == RUNNING and clock.time < clock.pause and clock.rows < HISTORY_ROWS
    )


@ti.func
def take_stock(lattice: ti.template(), b, densified, p: ti.template()):
    """Of an accepted state whose stiffest densified bond has `densified` [N/m]: step, end.

    The stiffness comes from the last stage's forces, which looked at the step's end.
    """
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
def row_is_due(lattice: ti.template(), b) -> ti.i32:
    """Whether the accepted state belongs into the history."""
    clock = lattice.clock[b]
    return ti.i32(clock.time >= clock.next_row or clock.status != RUNNING)


@ti.func
def close_row(
    lattice: ti.template(), b, energy: vec3, fracture: ti.f64, works: vec8, p: ti.template()
):
    """Write the row that is due, and say when the next one is."""
    ledger.write_row(lattice, b, energy, fracture, works)
    due = ti.floor(lattice.clock[b].time / p.row_interval + 1e-9) + 1.0
    lattice.clock[b].next_row = due * p.row_interval


@ti.func
def close_step(lattice: ti.template(), b, moved, breaks, bad_node, p: ti.template()):
    """Move the clock on, and stop a lattice that has gone astray.

    Of the step: the furthest motion squared [m2], bonds that break, and the first node that
    is astray (the count of nodes if none is).
    """
    clock = lattice.clock[b]
    lattice.clock[b].time = clock.time + clock.step
    lattice.clock[b].steps = clock.steps + 1
    lattice.clock[b].broken = clock.broken + breaks
    lattice.clock[b].drift = clock.drift + ti.sqrt(moved)
    if breaks > 0 or 2.0 * lattice.clock[b].drift > p.skin:
        lattice.clock[b].stale = 1
    if bad_node < lattice.nodes:
        lattice.clock[b].status = NOT_FINITE
        lattice.clock[b].bad_node = bad_node
