"""Nodes and impactor: gather the forces of a stage, and take it in the Runge-Kutta sum.

Everything is done a column of nodes at a time, and what a column adds up is kept per column: the
sums then have one order, whoever runs the columns.
"""

import taichi as ti

from taichi_foam.engine import contact
from taichi_foam.engine.parameters import NO_IMPACTOR
from taichi_foam.laws import contact as contact_law

vec2 = ti.types.vector(2, ti.f64)
vec4 = ti.types.vector(4, ti.f64)
vec8 = ti.types.vector(8, ti.f64)

LAST_STAGE = 3

# A node this far away [m] or this fast [m/s] belongs to a run that has blown up: the foam's waves
# travel at hundreds of metres a second. Breaking may keep such a run finite for ever.
ASTRAY = 1e5

# Members of a column's work, all in J and positive where the nodes lose energy.
FACES = 0  # normal stress, shear and dashpots together
SHEAR = 1
DASHPOTS = 2
DRAG = 3
IMPACTOR = 4
FRICTION = 5
BASE = 6
SELF_CONTACT = 7


@ti.func
def node_column(lattice: ti.template(), b, i, stage, p: ti.template()):
    """Take stage `stage` (0-3) of the classical Runge-Kutta method for one column of nodes.

    Left and right faces are added first, then below and above: the mirror image adds the same
    numbers. After the last stage the step is accepted.

    The ledger: what the faces take up is the power of their forces on the nodes, in the same
    Runge-Kutta sum (the shear force is no gradient of an energy). It therefore closes to the
    integrator's order. How it splits into normal stress, shear and dashpots is sampled once a
    step, with the latch: that moves work between columns, never out of the sum.
    """
    step = lattice.clock[b].step
    weight = stage_weight(stage, step)
    ahead = stage_ahead(stage, step)
    lift = 0.0
    overlap = 0.0
    bad = lattice.rows
    power = vec8(0.0)
    for j in range(lattice.rows):
        own = lattice.force[b, i, j]
        left = lattice.force[b, i - 1, j].xy
        below = lattice.force[b, i, j - 1].zw
        force = (own.xy - left) + (own.zw - below)
        v = lattice.trial[b, i, j].zw
        power[FACES] -= force.dot(v)
        held = p.hold_y and j == 0  # part of the support, which lets the impactor pass
        if p.impactor_kind != NO_IMPACTOR and not held:
            pressing, rubbing, distance = contact.impactor_contact(lattice, b, i, j, stage, p)
            if distance < 0.0:
                relative = vec2(v.x, v.y - lattice.body[b].trial_v)
                power[IMPACTOR] -= pressing.dot(relative)
                power[FRICTION] -= rubbing.dot(relative)
                lift -= pressing.y + rubbing.y
                force += pressing + rubbing
                overlap = ti.max(overlap, -distance)
        if not held:
            floor = contact.floor_contact(lattice, b, i, j, stage, p)
            power[BASE] -= floor.dot(v)
            force += floor
        if p.self_contact:
            push = lattice.push[b, i, j]
            power[SELF_CONTACT] -= push.dot(v)
            force += push
        if p.drag > 0.0:
            power[DRAG] += p.drag * v.norm_sqr()
            force -= p.drag * v
        acceleration = force * (1.0 / p.node_mass)
        acceleration.y -= p.gravity
        if j == 0:
            if p.hold_x:
                acceleration.x = 0.0
            if p.hold_y:
                acceleration.y = 0.0
        slope = vec4(v.x, v.y, acceleration.x, acceleration.y)
        rate = weight * slope
        if stage > 0:
            rate += lattice.rate[b, i, j]
        lattice.rate[b, i, j] = rate
        if stage < LAST_STAGE:
            lattice.trial[b, i, j] = lattice.state[b, i, j] + ahead * slope
        else:
            accepted = lattice.state[b, i, j] + rate
            lattice.state[b, i, j] = accepted
            lattice.trial[b, i, j] = accepted
            total = ti.abs(accepted).sum()
            if bad == lattice.rows and (ti.math.isnan(total) or total > ASTRAY):
                bad = j
    face_power = lattice.column_power[b, i]
    power[SHEAR] = face_power[0]
    power[DASHPOTS] = face_power[1]
    lattice.column_work[b, i] += weight * power
    lattice.column_lift[b, i] = lift
    lattice.column_overlap[b, i] = ti.max(lattice.column_overlap[b, i], overlap)
    lattice.column_bad[b, i] = bad


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
        lattice.body[b].support_work -= weight * stop * body.trial_v
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
        lattice.body[b].y = y
        lattice.body[b].v = v
    lattice.body[b].trial_y = y
    lattice.body[b].trial_v = v
    lattice.body[b].rate_y = rate_y
    lattice.body[b].rate_v = rate_v
    lattice.body[b].force = force


@ti.func
def stage_weight(stage, step) -> ti.f64:
    """The stage's share of the step in the weighted sum: 1/6, 1/3, 1/3, 1/6."""
    return ti.select(stage == 0 or stage == LAST_STAGE, step / 6.0, step / 3.0)


@ti.func
def stage_ahead(stage, step) -> ti.f64:
    """How far ahead of the step's start the next stage looks: half a step twice, then a whole."""
    return ti.select(stage < 2, 0.5 * step, step)
