"""When a lattice steps, by how much, when a row of its history is due, and when it ends.

One thread does this for a lattice, however many do the rest.
"""

from taichi_foam.backend import ti
from taichi_foam.engine import ledger, turning
from taichi_foam.engine.model import RK4_RADIUS, automatic_step, fastest_rate
from taichi_foam.engine.scratch import HISTORY_ROWS
from taichi_foam.engine.state import AT_END_TIME, AT_REBOUND, DIVERGED, NEVER, RUNNING

# Steps between updates of contact radii to the nodes' crush.
REFRESH = 4

# After the impactor's reversal a run continues until contact has been lost for QUIET, or at most
# for SETTLING [s]. The foam under a flat impactor of the tests springs back for that long: then it
# is as found after a test, and the rebound velocity is known.
QUIET = 1e-3
SETTLING = 20e-3


@ti.func
def goes_on(lattice: ti.template(), b) -> ti.i32:
    """Whether a lattice takes another step in this call."""
    clock = lattice.state.clock[b]
    return ti.i32(
        clock.status == RUNNING and clock.time < clock.pause and clock.rows < HISTORY_ROWS
    )


@ti.func
def take_stock(lattice: ti.template(), b, p: ti.template()):
    """Set the size of the next step from an accepted state, and the status if the run ends."""
    clock = lattice.state.clock[b]
    rate = fastest_rate(lattice, b, clock.stiffest, clock.crush, p)
    step = p.step
    if step == 0.0:
        speed = clock.speed
        if p.impactor:
            speed = ti.max(speed, ti.abs(lattice.state.body[b].v))
        if ti.static(lattice.features.turns):
            speed = ti.max(speed, turning.fastest(lattice, b, p))
        step = automatic_step(lattice, b, rate, speed, clock.crush, p)
    lattice.state.clock[b].step = step
    lattice.state.clock[b].stable = ti.min(clock.stable, RK4_RADIUS / rate)
    lattice.state.clock[b].shortest = ti.min(lattice.state.clock[b].shortest, step)
    lattice.state.clock[b].longest = ti.max(lattice.state.clock[b].longest, step)
    _end_when_due(lattice, b, p)


@ti.func
def _end_when_due(lattice: ti.template(), b, p: ti.template()):
    """Set the status of a lattice that has reached its end time, or has rebounded."""
    time = lattice.state.clock[b].time
    if lattice.state.body[b].force != 0.0:
        lattice.state.clock[b].last_contact = time
    moves_up = p.impactor and lattice.state.body[b].v >= 0.0
    if lattice.state.clock[b].reversal == NEVER and moves_up:
        lattice.state.clock[b].reversal = time
    since = time - lattice.state.clock[b].reversal
    apart = time - lattice.state.clock[b].last_contact
    gone = since > QUIET and apart > QUIET
    if ti.static(lattice.features.turns):
        gone = gone and turning.rises(lattice, b, p)
    if p.end_at_rebound and (gone or since > SETTLING):
        lattice.state.clock[b].status = AT_REBOUND
    elif time >= p.end_time:
        lattice.state.clock[b].status = AT_END_TIME


@ti.func
def row_is_due(lattice: ti.template(), b) -> ti.i32:
    """Whether a history row of the accepted state is due."""
    clock = lattice.state.clock[b]
    return ti.i32(clock.time >= clock.next_row or clock.status != RUNNING)


@ti.func
def close_row(
    lattice: ti.template(), b, energy: ledger.vec_now, works: ledger.vec_works, p: ti.template()
):
    """Write the row that is due, and set the time of the next one."""
    ledger.write_row(lattice, b, energy, works)
    due = ti.floor(lattice.state.clock[b].time / p.row_interval + 1e-9) + 1.0
    lattice.state.clock[b].next_row = due * p.row_interval


@ti.func
def close_step(
    lattice: ti.template(), b, moved, stiffest, crush, breaks, bad_node, p: ti.template()
):
    """Advance the clock, and stop a lattice that has diverged.

    `moved` is the largest squared displacement of a node in the step [m2]; `stiffest` and `crush`
    are the stiffest stiffened bond [N/m] and the largest crush at its end, from the forces of the
    last stage; `breaks` is the number of bonds that break; `bad_node` is the first diverged node
    (the number of nodes if there is none).
    """
    clock = lattice.state.clock[b]
    lattice.state.clock[b].time = clock.time + clock.step
    lattice.state.clock[b].steps = clock.steps + 1
    lattice.state.clock[b].broken = clock.broken + breaks
    lattice.state.clock[b].drift = clock.drift + ti.sqrt(moved)
    lattice.state.clock[b].stiffest = stiffest
    if ti.static(lattice.law.shears_stiffer):
        lattice.state.clock[b].crush = ti.max(crush, clock.crush)  # the largest so far
    else:
        lattice.state.clock[b].crush = crush
    lattice.state.clock[b].speed = ti.sqrt(moved) / clock.step
    if breaks > 0 or 2.0 * lattice.state.clock[b].drift > p.skin:
        lattice.state.clock[b].stale = 1
    if bad_node < lattice.counts[None].nodes:
        lattice.state.clock[b].status = DIVERGED
        lattice.state.clock[b].bad_node = bad_node
