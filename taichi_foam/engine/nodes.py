"""Nodes and impactor: gather the forces of a stage, and take it in the Runge-Kutta sum.

What a column adds up is kept per column: the sums then have one order, whoever runs the columns.
"""

import taichi as ti

from taichi_foam.engine import contact, packs
from taichi_foam.engine.lattice import DASHPOTS, DRAG, FACES, SELF_CONTACT, SHEAR
from taichi_foam.engine.parameters import NO_IMPACTOR
from taichi_foam.laws import contact as contact_law

LAST_STAGE = 3

# A node this far away [m] or this fast [m/s] belongs to a run that has blown up: the foam's waves
# travel at hundreds of metres a second. Breaking may keep such a run finite for ever.
ASTRAY = 1e5


@ti.func
def node_pack(
    lattice: ti.template(), motion: ti.template(), first: ti.template(),
    b, i, k, stage, sweep, slot, left_slot, below_x, below_y, touched, p: ti.template(),
):  # fmt: skip
    """Take stage `stage` (0-3) of the classical Runge-Kutta method for one pack of nodes.

    `slot` and `left_slot` hold the forces of this column's connections and of those to its left;
    `below` is the force of the connection below the first lane. `motion` is the stage's: accepted
    for the first, whose code is its own, else trial. After the last stage the step is accepted.

    Left and right faces are added first, then below and above: the mirror image adds the same
    numbers. Powers taken from the nodes by faces, self-contact and drag [W] come back, the
    largest squared motion in the step [m2], and how many nodes are astray.
    """
    step = lattice.clock[b].step
    weight = stage_weight(stage, step)
    now = motion[b, i, k]
    own = lattice.force[sweep, slot, k]
    left = lattice.force[sweep, left_slot, k]
    force_x = (own.ax - left.ax) + (own.bx - packs.from_below(own.bx, below_x))
    force_y = (own.ay - left.ay) + (own.by - packs.from_below(own.by, below_y))
    by_faces = -(force_x * now.u + force_y * now.v)
    by_pieces = 0.0 * now.u
    by_drag = 0.0 * now.u
    if contact.may_touch_bodies(lattice, b, now.x, now.y, p):
        for lane in range(lattice.lanes):
            j = k * lattice.lanes + lane
            if j < lattice.rows:
                contact.touch_bodies(lattice, motion, b, i, j, sweep, stage, weight, p)
            else:
                lattice.reaction[sweep].x[lane] = 0.0
                lattice.reaction[sweep].y[lane] = 0.0
        force_x += lattice.reaction[sweep].x
        force_y += lattice.reaction[sweep].y
    if touched:
        push = lattice.push[b, i, k]
        by_pieces = -(push.x * now.u + push.y * now.v)
        force_x += push.x
        force_y += push.y
    if p.drag > 0.0:
        by_drag = p.drag * (now.u * now.u + now.v * now.v)
        force_x -= p.drag * now.u
        force_y -= p.drag * now.v
    a_x = force_x * (1.0 / p.node_mass)
    a_y = force_y * (1.0 / p.node_mass) - p.gravity
    if k == 0:
        a_x[0] = ti.select(p.hold_x, 0.0, a_x[0])
        a_y[0] = ti.select(p.hold_y, 0.0, a_y[0])
    spare = ti.static(lattice.rows - (lattice.packs - 1) * lattice.lanes)
    if ti.static(spare < lattice.lanes):  # noqa: SIM102 - the static test must stand alone
        if k == lattice.packs - 1:
            for lane in ti.static(range(spare, lattice.lanes)):
                a_y[lane] = 0.0
    rate_x, rate_y, rate_u, rate_v = weight * now.u, weight * now.v, weight * a_x, weight * a_y
    if ti.static(not first):
        before = lattice.rate[b, i, k]
        rate_x, rate_y = before.x + rate_x, before.y + rate_y
        rate_u, rate_v = before.u + rate_u, before.v + rate_v
    lattice.rate[b, i, k].x = rate_x
    lattice.rate[b, i, k].y = rate_y
    lattice.rate[b, i, k].u = rate_u
    lattice.rate[b, i, k].v = rate_v
    start = lattice.state[b, i, k]
    moved = 0.0
    astray = 0
    if stage < LAST_STAGE:
        ahead = stage_ahead(stage, step)
        lattice.trial[b, i, k].x = start.x + ahead * now.u
        lattice.trial[b, i, k].y = start.y + ahead * now.v
        lattice.trial[b, i, k].u = start.u + ahead * a_x
        lattice.trial[b, i, k].v = start.v + ahead * a_y
    else:
        x, y, u, v = start.x + rate_x, start.y + rate_y, start.u + rate_u, start.v + rate_v
        lattice.state[b, i, k].x = x
        lattice.state[b, i, k].y = y
        lattice.state[b, i, k].u = u
        lattice.state[b, i, k].v = v
        moved = (rate_x * rate_x + rate_y * rate_y).max()
        sound = ti.abs(x) + ti.abs(y) + ti.abs(u) + ti.abs(v) <= ASTRAY  # false for NaN
        astray = lattice.lanes - ti.select(sound, 1, 0).sum()
    return by_faces.sum(), by_pieces.sum(), by_drag.sum(), moved, astray


@ti.func
def node_column(
    lattice: ti.template(), motion: ti.template(), first: ti.template(),
    b, i, stage, sweep, slot, left_slot, p: ti.template(),
):  # fmt: skip
    """A stage for one column of nodes.

    The ledger: what the faces take up is the power of their forces on the nodes, in the same
    Runge-Kutta sum (the shear force is no gradient of an energy). It therefore closes to the
    integrator's order. How it splits into normal stress, shear and dashpots is sampled once a
    step, with the latch: that moves work between columns, never out of the sum.
    """
    touched = p.self_contact and lattice.column_touchers[b, i] > 0
    lattice.column_lift[b, i] = 0.0
    by_faces, by_pieces, by_drag = 0.0, 0.0, 0.0
    moved = 0.0
    astray = 0
    below_x, below_y = 0.0, 0.0
    last = ti.static(lattice.lanes - 1)
    for k in range(lattice.packs):
        faces, pieces, drag, reach, lost = node_pack(
            lattice, motion, first, b, i, k, stage, sweep, slot, left_slot, below_x, below_y,
            touched, p,
        )  # fmt: skip
        below_x = lattice.force[sweep, slot, k].bx[last]
        below_y = lattice.force[sweep, slot, k].by[last]
        by_faces += faces
        by_pieces += pieces
        by_drag += drag
        moved = ti.max(moved, reach)
        astray += lost
    weight = stage_weight(stage, lattice.clock[b].step)
    _add_work(lattice, b, i, FACES, weight * by_faces)
    if touched:
        _add_work(lattice, b, i, SELF_CONTACT, weight * by_pieces)
    if p.drag > 0.0:
        _add_work(lattice, b, i, DRAG, weight * by_drag)
    if ti.static(first):
        power = lattice.column_power[b, i]
        _add_work(lattice, b, i, SHEAR, lattice.clock[b].step * power[0])
        _add_work(lattice, b, i, DASHPOTS, lattice.clock[b].step * power[1])
    if stage == LAST_STAGE:
        lattice.column_moved[b, i] = moved
        lattice.column_astray[b, i] = astray


@ti.func
def first_astray(lattice: ti.template(), b, i) -> ti.i32:
    """The lowest row of a column whose node is astray."""
    found = lattice.rows
    for n in range(lattice.rows):
        j = lattice.rows - 1 - n
        x = packs.position(lattice, lattice.state, b, i, j)
        v = packs.velocity(lattice, lattice.state, b, i, j)
        if not ti.abs(x).sum() + ti.abs(v).sum() <= ASTRAY:
            found = j
    return found


@ti.func
def _add_work(lattice: ti.template(), b, i, member: ti.template(), work):
    """A column has one thread: no atomics."""
    lattice.column_work[b, i][member] = lattice.column_work[b, i][member] + work


@ti.func
def body_stage(lattice: ti.template(), b, stage, p: ti.template()):
    """The same stage for the impactor, once all columns have given their lift."""
    step = lattice.clock[b].step
    weight = stage_weight(stage, step)
    force = 0.0
    for i in range(lattice.columns):
        force += lattice.column_lift[b, i]
    body = lattice.body[b]
    if p.impactor_kind != NO_IMPACTOR:
        # the support stops the impactor too, once it has gone right through the block
        stop = contact_law.normal_force(p.support_stiffness, body.trial_y)
        body.support_work -= weight * stop * body.trial_v
        force += stop
    acceleration = force / p.impactor_mass - p.gravity
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
    lattice.body[b] = body


@ti.func
def stage_weight(stage, step) -> ti.f64:
    """The stage's share of the step in the weighted sum: 1/6, 1/3, 1/3, 1/6."""
    return ti.select(stage == 0 or stage == LAST_STAGE, step / 6.0, step / 3.0)


@ti.func
def stage_ahead(stage, step) -> ti.f64:
    """How far ahead of the step's start the next stage looks: half a step twice, then a whole."""
    return ti.select(stage < 2, 0.5 * step, step)
