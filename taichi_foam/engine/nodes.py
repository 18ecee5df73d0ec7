"""Nodes and impactor: gather the forces of a stage, and add the stage to the Runge-Kutta sum.

Sums are kept per strip of nodes: their order is then the same whichever threads run the strips. On
a CPU a strip is a column.
"""

from taichi_foam.backend import ti
from taichi_foam.engine import cells, contact, driving, lanes, makeup, turning
from taichi_foam.engine.lattice import LAST_STAGE
from taichi_foam.engine.state import WORK, book
from taichi_foam.laws import contact as contact_law
from taichi_foam.laws import elementary

HELD_BY_BODIES = (
    WORK.held_by_contact, WORK.held_by_friction, WORK.held_by_base, WORK.held_by_base_friction,
)  # fmt: skip

# A node this far away [m] or this fast [m/s] belongs to a run that has diverged: waves in the foam
# travel at hundreds of metres per second. Breaking bonds may keep such a run finite.
DIVERGED_SIZE = 1e5


@ti.func
def node_pack(
    lattice: ti.template(), b, i, k, strip, stage, sweep, slot, left_slot,
    p: ti.template(),
):  # fmt: skip
    """Take stage `stage` (0-3) of the classical Runge-Kutta method for one pack of nodes.

    `slot` and `left_slot` hold the forces of the bonds and cells of this column and of the one to
    its left. After the last stage the step is accepted.

    Forces are added in a mirror-neutral order: bonds to the right and left, then those above and
    below, then the sum of the cells in the right and the left column. The power [W] that the nodes
    give to bonds and cells is added to the strip's tally, the work that they do on anything else to
    the strip's work.
    """
    step = lattice.state.clock[b].step
    weight = stage_weight(stage, step)
    now = lattice.scratch.trial[b, i, k]
    force, tally = ti.static(lattice.scratch.force, lattice.scratch.tally)
    last = ti.static(lattice.lanes - 1)
    own, below = force[sweep, slot, k], force[sweep, slot, k - 1]
    left = force[sweep, left_slot, k]
    force_x = (own.ax - left.ax) + (own.bx - lanes.from_below(own.bx, below.bx[last]))
    force_y = (own.ay - left.ay) + (own.by - lanes.from_below(own.by, below.by[last]))
    if ti.static(lattice.features.cells):
        right_x, right_y = cells.pushed_by(lattice, False, k, sweep, slot)
        left_x, left_y = cells.pushed_by(lattice, True, k, sweep, left_slot)
        force_x += right_x + left_x
        force_y += right_y + left_y
    by_bonds = force_x * now.u + force_y * now.v
    tally[b, strip].by_bonds = tally[b, strip].by_bonds - by_bonds
    if contact.may_touch_bodies(lattice, b, i, k, now.x, now.y, p):
        for lane in range(lattice.lanes):
            j = k * lattice.lanes + lane
            if j < lattice.counts[None].rows:
                reaction = contact.touch_bodies(lattice, b, i, j, strip, stage, weight, p)
                # not through memory: a wide load after a narrow store would stall
                force_x += lanes.only(lattice, lane, reaction.x)
                force_y += lanes.only(lattice, lane, reaction.y)
    if ti.static(lattice.features.self_contact):  # noqa: SIM102 - the static test must stand alone
        if contact.is_pushed(lattice, b, i, k):
            push_x, push_y = contact.pushes_on(lattice, b, i, k)
            by_pieces = -(push_x * now.u + push_y * now.v).sum()
            book(lattice, b, strip, WORK.pieces, weight * by_pieces)
            force_x += push_x
            force_y += push_y
    if ti.static(lattice.features.drag):
        drag = p.drag * makeup.shares_of_points(lattice, b, i, k)
        by_drag = (drag * (now.u * now.u + now.v * now.v)).sum()
        book(lattice, b, strip, WORK.dashpots, weight * by_drag)
        force_x -= drag * now.u
        force_y -= drag * now.v
    # held nodes have zero mobility: a branch for them would prevent vectorisation
    mobility = makeup.mobility(lattice, b, i, k)
    a_x = force_x * mobility.x
    a_y = force_y * mobility.y - mobility.gravity
    if ti.static(lattice.features.shaken):
        shake, moves = driving.shake(lattice, b), mobility.y > 0.0
        a_y -= ti.select(moves, shake, 0.0)
        momentum = ti.select(moves, now.v / mobility.y, 0.0).sum()
        book(lattice, b, strip, WORK.base, weight * shake * momentum)
    rate_x, rate_y, rate_u, rate_v = weight * now.u, weight * now.v, weight * a_x, weight * a_y
    if stage > 0:
        before = lattice.state.increment[b, i, k]
        rate_x, rate_y = before.x + rate_x, before.y + rate_y
        rate_u, rate_v = before.u + rate_u, before.v + rate_v
    lattice.state.increment[b, i, k].x = rate_x
    lattice.state.increment[b, i, k].y = rate_y
    lattice.state.increment[b, i, k].u = rate_u
    lattice.state.increment[b, i, k].v = rate_v
    start = lattice.state.motion[b, i, k]
    next_x, next_y = start.x + rate_x, start.y + rate_y
    next_u, next_v = start.u + rate_u, start.v + rate_v
    if stage < LAST_STAGE:
        ahead = stage_ahead(stage, step)
        next_x, next_y = start.x + ahead * now.u, start.y + ahead * now.v
        next_u, next_v = start.u + ahead * a_x, start.v + ahead * a_y
    else:
        lattice.state.motion[b, i, k].x = next_x
        lattice.state.motion[b, i, k].y = next_y
        lattice.state.motion[b, i, k].u = next_u
        lattice.state.motion[b, i, k].v = next_v
    lattice.scratch.trial[b, i, k].x = next_x
    lattice.scratch.trial[b, i, k].y = next_y
    lattice.scratch.trial[b, i, k].u = next_u
    lattice.scratch.trial[b, i, k].v = next_v


@ti.func
def inspect_pack(lattice: ti.template(), b, i, k, strip):
    """Tally after the last stage how far nodes moved in the step, and how many diverged."""
    now = lattice.state.motion[b, i, k]
    path = lattice.state.increment[b, i, k]
    moved = path.x * path.x + path.y * path.y
    lattice.scratch.tally[b, strip].moved = elementary.larger(
        moved, lattice.scratch.tally[b, strip].moved
    )
    size = ti.abs(now.x) + ti.abs(now.y) + ti.abs(now.u) + ti.abs(now.v)
    tally = ti.static(lattice.scratch.tally)
    diverged = ti.select(size <= DIVERGED_SIZE, 0.0, 1.0)  # 1 for NaN too
    tally[b, strip].diverged = tally[b, strip].diverged + diverged


@ti.func
def node_column(lattice: ti.template(), b, i, stage, sweep, slot, left_slot, p: ti.template()):
    """A stage for one column of nodes."""
    clear_nodes(lattice, b, i, stage)
    for k in range(lattice.counts[None].packs):
        node_pack(lattice, b, i, k, i, stage, sweep, slot, left_slot, p)
    if stage == LAST_STAGE:
        for k in range(lattice.counts[None].packs):
            inspect_pack(lattice, b, i, k, i)
    close_nodes(lattice, b, i, stage)


@ti.func
def clear_nodes(lattice: ti.template(), b, strip, stage):
    """Reset the tally of a strip's nodes."""
    lattice.scratch.contact_force[b, strip] = 0.0
    if ti.static(lattice.features.turns):
        lattice.scratch.side_force[b, strip] = 0.0
        lattice.scratch.torque[b, strip] = 0.0
    lattice.scratch.tally[b, strip].by_bonds = lanes.zeros(lattice)
    if stage == LAST_STAGE:
        for held in ti.static(HELD_BY_BODIES):
            lattice.state.work[b, strip][held] = 0.0
        lattice.scratch.tally[b, strip].moved = lanes.zeros(lattice)
        lattice.scratch.tally[b, strip].diverged = lanes.zeros(lattice)


@ti.func
def close_nodes(lattice: ti.template(), b, strip, stage):
    """Add a stage's tally to the strip's work.

    The energy ledger integrates the power of bonds and cells on the nodes, and its parts due to the
    cells' shear and room and to the dashpots, by the same Runge-Kutta sum as the motion. So it
    closes to the integrator's order, for each mechanism separately.
    """
    weight = stage_weight(stage, lattice.state.clock[b].step)
    tally = ti.static(lattice.scratch.tally)
    book(lattice, b, strip, WORK.bonds, weight * tally[b, strip].by_bonds.sum())
    book(lattice, b, strip, WORK.shear, weight * tally[b, strip].sheared.sum())
    book(lattice, b, strip, WORK.dashpots, weight * tally[b, strip].damped.sum())
    if ti.static(lattice.features.crushed_room):
        book(lattice, b, strip, WORK.room, weight * tally[b, strip].pressed.sum())


@ti.func
def first_diverged(lattice: ti.template(), b) -> ti.i32:
    """The smallest number of a diverged node; the number of nodes if none has diverged."""
    found = lattice.counts[None].nodes
    for i in range(lattice.counts[None].columns):
        for j in range(lattice.counts[None].rows):
            x = lanes.position(lattice, lattice.state.motion, b, i, j)
            v = lanes.velocity(lattice, lattice.state.motion, b, i, j)
            if (
                found == lattice.counts[None].nodes
                and not ti.abs(x).sum() + ti.abs(v).sum() <= DIVERGED_SIZE
            ):
                found = i * lattice.counts[None].rows + j
    return found


@ti.func
def contact_force_of_strips(lattice: ti.template(), b) -> ti.f64:
    """The nodes' force on the impactor [N]."""
    force = 0.0
    for strip in range(lattice.counts[None].strips):
        force += lattice.scratch.contact_force[b, strip]
    return force


@ti.func
def stage_of_strips(lattice: ti.template(), b, stage, p: ti.template()):
    """The same stage for the impactor, once the loads of all strips on it are known."""
    if ti.static(lattice.features.turns):
        free_stage(lattice, b, stage, turning.load_of_strips(lattice, b), p)
    else:
        body_stage(lattice, b, stage, contact_force_of_strips(lattice, b), p)


@ti.func
def free_stage(lattice: ti.template(), b, stage, by_nodes, p: ti.template()):
    """A stage for an impactor that turns, once the load of all nodes on it is known."""
    step = lattice.state.clock[b].step
    weight, ahead = stage_weight(stage, step), stage_ahead(stage, step)
    turning.stage(lattice, b, stage, weight, ahead, by_nodes, p)
    driving.look_ahead(lattice, b, stage, step, p)


@ti.func
def body_stage(lattice: ti.template(), b, stage, by_nodes, p: ti.template()):
    """A stage for a guided impactor, once the force of all nodes on it [N] is known."""
    step = lattice.state.clock[b].step
    weight = stage_weight(stage, step)
    force = by_nodes
    body = lattice.state.body[b]
    if p.impactor:
        # the support also stops the impactor, if it goes right through the block
        stop = contact_law.normal_force(p.support_stiffness, body.trial_y)
        body.support_work -= weight * stop * body.trial_v
        force += stop
    acceleration = force / p.impactor_mass - p.gravity
    if p.crosshead > 0.0:
        # the drive balances all other forces, and does their work
        body.support_work += weight * p.impactor_mass * acceleration * body.trial_v
        acceleration = 0.0
    if ti.static(lattice.features.shaken):
        shake = driving.shake(lattice, b)
        if p.impactor:
            body.support_work += weight * p.impactor_mass * shake * body.trial_v
        acceleration -= shake
    rate_y = weight * body.trial_v
    rate_v = weight * acceleration
    if stage > 0:
        rate_y += body.rate_y
        rate_v += body.rate_v
    y = body.y + stage_ahead(stage, step) * body.trial_v
    v = body.v + stage_ahead(stage, step) * acceleration
    if stage == LAST_STAGE:
        y = body.y + rate_y
        v = body.v + rate_v
        body.y = y
        body.v = v
    body.trial_y = y
    body.trial_v = v
    body.rate_y = rate_y
    body.rate_v = rate_v
    body.force = force
    lattice.state.body[b] = body
    driving.look_ahead(lattice, b, stage, step, p)


@ti.func
def stage_weight(stage, step) -> ti.f64:
    """The stage's share of the step in the weighted sum: 1/6, 1/3, 1/3, 1/6."""
    return ti.select(stage == 0 or stage == LAST_STAGE, step / 6.0, step / 3.0)


@ti.func
def stage_ahead(stage, step) -> ti.f64:
    """Time of the next stage after the step's start: half a step twice, then a whole step."""
    return ti.select(stage < 2, 0.5 * step, step)
