"""An impactor without guide rails: the motion of its points, and its Runge-Kutta stage.

Its reference point, at mid-width and the lowest level of the outline at the start, moves with its
centre of mass: `Body` holds the height of that point, `Turn` its horizontal displacement and the
body's rotation about its centre of mass.
"""

from taichi_foam.backend import ti
from taichi_foam.engine import driving
from taichi_foam.engine.lattice import LAST_STAGE
from taichi_foam.laws import contact as contact_law
from taichi_foam.laws import elementary

vec2 = ti.types.vector(2, ti.f64)
vec3 = ti.types.vector(3, ti.f64)


@ti.func
def arm_to(lattice: ti.template(), b, x, y, p: ti.template()):
    """From the centre of mass to a point [m], or to a pack of them."""
    middle = p.impactor_x + p.impactor_centre.x + lattice.state.turn[b].trial_x
    return x - middle, y - (lattice.state.body[b].trial_y + p.impactor_centre.y)


@ti.func
def in_body(lattice: ti.template(), b, x, y, p: ti.template()):
    """A point, or a pack of them, in the unturned body's frame, about its reference point [m]."""
    arm_x, arm_y = arm_to(lattice, b, x, y, p)
    cosine, sine = lattice.state.turn[b].cosine, lattice.state.turn[b].sine
    across = (cosine * arm_x + sine * arm_y) + p.impactor_centre.x
    return across, (cosine * arm_y - sine * arm_x) + p.impactor_centre.y


@ti.func
def turned(lattice: ti.template(), b, along: vec2) -> vec2:
    """A direction of the unturned body, turned with the body."""
    cosine, sine = lattice.state.turn[b].cosine, lattice.state.turn[b].sine
    return vec2(cosine * along.x - sine * along.y, cosine * along.y + sine * along.x)


@ti.func
def is_near(lattice: ti.template(), b, x, y, margin, p: ti.template()):
    """Whether a pack's points lie in the box around the body, or that near to it."""
    across, up = in_body(lattice, b, x, y, p)
    beside = ti.abs(across) < p.impactor_half_width + margin
    return beside & (up > -margin) & (up < p.impactor_height + margin)


@ti.func
def velocity_of(lattice: ti.template(), b, arm: vec2) -> vec2:
    """Velocity [m/s] of the body's point at an arm [m] from its centre of mass."""
    turn = lattice.state.turn[b]
    return vec2(
        turn.trial_u - turn.trial_spin * arm.y,
        lattice.state.body[b].trial_v + turn.trial_spin * arm.x,
    )


@ti.func
def slid(lattice: ti.template(), b, arm: vec2, stage) -> vec2:
    """How far [m] the body's point at `arm` has moved since friction springs were latched.

    They are latched at a step's first stage, whose rates still hold the last step's motion.
    """
    body, turn = lattice.state.body[b], lattice.state.turn[b]
    way, by_turn = vec2(turn.rate_x, body.rate_y), turn.rate_angle
    if stage > 0:
        way = vec2(turn.trial_x - turn.x, body.trial_y - body.y)
        by_turn = turn.trial_angle - turn.angle
    # with the arm at half the turn, the path is the chord
    half_x, half_y = arm.x + 0.5 * by_turn * arm.y, arm.y - 0.5 * by_turn * arm.x
    return vec2(way.x - by_turn * half_y, way.y + by_turn * half_x)


@ti.func
def fastest(lattice: ti.template(), b, p: ti.template()) -> ti.f64:
    """Upper bound on the speed of the body's points [m/s]."""
    turn, v = lattice.state.turn[b], lattice.state.body[b].v
    return ti.sqrt(turn.u * turn.u + v * v) + ti.abs(turn.spin) * p.impactor_reach


@ti.func
def rises(lattice: ti.template(), b, p: ti.template()) -> ti.i32:
    """Whether no point of the body moves down, whatever its angle."""
    sinking = ti.abs(lattice.state.turn[b].spin) * p.impactor_reach
    return ti.i32(lattice.state.body[b].v >= sinking)


@ti.func
def add_reaction(lattice: ti.template(), b, strip, force: vec2, arm: vec2):
    """Add to a strip's sums the horizontal force and torque on the body of a node under `force`."""
    side, torque = ti.static(lattice.scratch.side_force, lattice.scratch.torque)
    side[b, strip] = side[b, strip] - force.x
    torque[b, strip] = torque[b, strip] - (arm.x * force.y - arm.y * force.x)


@ti.func
def load_of_strips(lattice: ti.template(), b) -> vec3:
    """The nodes' force on the body, up and to the right [N], and their torque [N m].

    Strips of mirrored columns are added in pairs, so that a symmetric impact does not turn the body
    and a mirrored impact gives the same numbers.
    """
    load = vec3(0.0)
    for strip in range((lattice.counts[None].strips + 1) // 2):
        mirrored = lattice.counts[None].strips - 1 - strip
        pair = _load(lattice, b, strip)
        if mirrored != strip:
            pair += _load(lattice, b, mirrored)
        load += pair
    return load


@ti.func
def _load(lattice: ti.template(), b, strip) -> vec3:
    side, torque = ti.static(lattice.scratch.side_force, lattice.scratch.torque)
    return vec3(lattice.scratch.contact_force[b, strip], side[b, strip], torque[b, strip])


@ti.func
def _support(lattice: ti.template(), b, weight, p: ti.template()) -> vec3:
    """Load of the support on a body that has gone right through the block; its work is booked.

    Each corner of the convex hull below y = 0 meets half the spring that stops a guided impactor: a
    level face, with two corners, meets the whole spring.
    """
    load = vec3(0.0)
    body = lattice.state.body[b]
    if p.support_stiffness > 0.0 and body.trial_y + p.impactor_centre.y < p.impactor_reach:
        for n in range(ti.cast(p.hull_corners, ti.i32)):
            arm = turned(lattice, b, lattice.model.hull[b, n] - p.impactor_centre)
            height = body.trial_y + p.impactor_centre.y + arm.y
            stop = contact_law.normal_force(0.5 * p.support_stiffness, height)
            load += vec3(stop, 0.0, arm.x * stop)
            lattice.state.body[b].support_work -= weight * stop * velocity_of(lattice, b, arm).y
    return load


@ti.func
def stage(lattice: ti.template(), b, stage, weight, ahead, by_nodes: vec3, p: ti.template()):
    """A Runge-Kutta stage for the body, once the load of all nodes on it is known."""
    load = by_nodes + _support(lattice, b, weight, p)
    body, turn = lattice.state.body[b], lattice.state.turn[b]
    pull = p.gravity
    if ti.static(lattice.features.shaken):
        shake = driving.shake(lattice, b)
        pull += shake
        body.support_work += weight * p.impactor_mass * shake * body.trial_v
    position = vec3(body.y, turn.x, turn.angle)
    velocity = vec3(body.v, turn.u, turn.spin)
    now = vec3(body.trial_v, turn.trial_u, turn.trial_spin)
    acceleration = vec3(
        load[0] / p.impactor_mass - pull,
        load[1] / p.impactor_mass,
        load[2] / p.impactor_inertia,
    )
    moved, changed = weight * now, weight * acceleration
    if stage > 0:
        moved += vec3(body.rate_y, turn.rate_x, turn.rate_angle)
        changed += vec3(body.rate_v, turn.rate_u, turn.rate_spin)
    next_position, next_velocity = position + ahead * now, velocity + ahead * acceleration
    if stage == LAST_STAGE:
        next_position, next_velocity = position + moved, velocity + changed
        body.y, turn.x, turn.angle = next_position[0], next_position[1], next_position[2]
        body.v, turn.u, turn.spin = next_velocity[0], next_velocity[1], next_velocity[2]
    body.trial_y, turn.trial_x, turn.trial_angle = (
        next_position[0], next_position[1], next_position[2],
    )  # fmt: skip
    body.trial_v, turn.trial_u, turn.trial_spin = (
        next_velocity[0], next_velocity[1], next_velocity[2],
    )  # fmt: skip
    body.rate_y, turn.rate_x, turn.rate_angle = moved[0], moved[1], moved[2]
    body.rate_v, turn.rate_u, turn.rate_spin = changed[0], changed[1], changed[2]
    body.force = load[0]
    turn.sine, turn.cosine = elementary.sine_cosine(turn.trial_angle)
    lattice.state.body[b] = body
    lattice.state.turn[b] = turn
