"""Connections: their forces at a stage, and their history once a step is accepted."""

import taichi as ti

from taichi_foam.engine.lattice import AHEAD, BEHIND, BREAK_TIME, INTACT, WORST
from taichi_foam.laws import foam as foam_law
from taichi_foam.laws import kinematics

vec2 = ti.types.vector(2, ti.f64)
vec3 = ti.types.vector(3, ti.f64)
vec4 = ti.types.vector(4, ti.f64)

# A connection runs along its own axis (A along x, B along y); the other axis lies across it.
A = 0
B = 1


@ti.func
def columns_of_f(lattice: ti.template(), axis: ti.template(), b, i, j, link: vec4, p: ti.template()):
    """The two columns of F at a connection, along it and across it, and its nodes' closing speed.

    `across` is the mean of the one-sided differences at the connection's two nodes, over the
    halves that its broken neighbours leave (Eqs 13 and 27). The two nodes' parts are added first:
    mirrored, the sum is then the same to the last bit.
    """
    ei, ej = ti.static((1, 0) if axis == A else (0, 1))  # to the connection's other node
    si, sj = ti.static((0, 1) if axis == A else (1, 0))  # to the neighbours beside it
    length = p.cell[axis]
    beside = p.cell[1 - axis]
    start = lattice.trial[b, i, j]
    end = lattice.trial[b, i + ei, j + ej]
    ahead = (lattice.trial[b, i + si, j + sj].xy - start.xy) + (
        lattice.trial[b, i + ei + si, j + ej + sj].xy - end.xy
    )
    behind = (start.xy - lattice.trial[b, i - si, j - sj].xy) + (
        end.xy - lattice.trial[b, i + ei - si, j + ej - sj].xy
    )
    along = (end.xy - start.xy) * (1.0 / length)
    across = (link[AHEAD] * ahead + link[BEHIND] * behind) * (0.5 / beside)
    return along, across, end.zw - start.zw


@ti.func
def face_force(
    lattice: ti.template(), axis: ti.template(), latching: ti.template(), b, i, j, p: ti.template()
):
    """Force [N] of connection (i, j) on its first node, its power [W], and what latching found.

    The power that the face takes up, T . (v_end - v_start), comes in all, in shear and in the
    dashpot: the ledger then closes to the integrator's order though the shear force is no gradient
    of an energy. With `latching`, the state is an accepted one, and the connection's history is
    brought up to date with it: the stiffness [N/m] comes back, and 1 if the connection breaks.
    """
    links = ti.static(lattice.links[axis])
    link = links[b, i, j]
    along, across, relative = columns_of_f(lattice, axis, b, i, j, link, p)
    stretch = along.norm()
    e = stretch - 1.0
    broken = ti.i32(link[BREAK_TIME] >= 0.0)
    stress = foam_law.normal_stress(p.foam, e, link[WORST], broken)
    force = along * (p.area[axis] * stress / stretch)
    shear_power = 0.0
    damping_power = 0.0
    found = vec2(0.0)
    if ti.static(latching):
        if e < link[WORST]:
            links[b, i, j][WORST] = e
        # a compressed connection is stiff, or rather unstable, across itself too
        modulus = ti.max(foam_law.tangent_modulus(p.foam, e), ti.abs(stress) / stretch)
        found[0] = modulus * p.area[axis] / p.cell[axis]
    if not broken:
        gamma = kinematics.shear_strain(along, across)
        tau = foam_law.shear_stress(p.foam, gamma)
        shear = kinematics.shear_traction(p.area[axis] * tau, across)
        dragging = p.dashpot[axis] * relative
        shear_power = shear.dot(relative)
        damping_power = dragging.dot(relative)
        force += shear + dragging
        if ti.static(latching):
            worst = ti.min(link[WORST], e)
            if foam_law.fails(p.foam, e, stress, gamma, worst):
                found[1] = 1.0
                links[b, i, j][BREAK_TIME] = lattice.clock[b].time
                if stress > 0.0 or p.foam.broken_contact == foam_law.JUMP:
                    lost = foam_law.stored_energy(p.foam, e, worst, 0)
                    lattice.column_fracture[b, i] += p.area[axis] * p.cell[axis] * lost
    return force, vec3(force.dot(relative), shear_power, damping_power), found


@ti.func
def face_column(lattice: ti.template(), latching: ti.template(), b, i, p: ti.template()):
    """Forces of the connections to the right of and above each node of column `i`."""
    power = vec3(0.0)
    stiffest = 0.0
    breaks = 0.0
    for j in range(lattice.rows):
        force_a = vec2(0.0)
        force_b = vec2(0.0)
        if i < lattice.columns - 1:
            force, taken, found = face_force(lattice, A, latching, b, i, j, p)
            force_a = force
            power += taken
            stiffest = ti.max(stiffest, found[0])
            breaks += found[1]
        if j < lattice.rows - 1:
            force, taken, found = face_force(lattice, B, latching, b, i, j, p)
            force_b = force
            power += taken
            stiffest = ti.max(stiffest, found[0])
            breaks += found[1]
        lattice.force[b, i, j] = vec4(force_a.x, force_a.y, force_b.x, force_b.y)
    lattice.column_power[b, i] = power
    if ti.static(latching):
        lattice.column_found[b, i] = vec2(stiffest, breaks)


@ti.func
def _whole(link: vec4) -> ti.i32:
    return ti.i32(link[BREAK_TIME] == INTACT)


@ti.func
def _weights(ahead: ti.i32, behind: ti.i32) -> vec2:
    """Shares of the two halves in the mean: equal, all to the one that is left, or none."""
    left = ti.max(ahead + behind, 1)
    return vec2(ahead / left, behind / left)


@ti.func
def update_halves(lattice: ti.template(), b, i, j):
    """Which halves of the node's two connections still count (Eq. 27, Fig. 20).

    A half counts while the crossing connections at both of the connection's nodes are whole. With
    none left the connection is a bare fibre: `across` vanishes, and the shear with it.
    """
    if i < lattice.columns - 1:
        above = _whole(lattice.link_b[b, i, j]) * _whole(lattice.link_b[b, i + 1, j])
        below = _whole(lattice.link_b[b, i, j - 1]) * _whole(lattice.link_b[b, i + 1, j - 1])
        halves = _weights(above, below)
        lattice.link_a[b, i, j][AHEAD] = halves[0]
        lattice.link_a[b, i, j][BEHIND] = halves[1]
    if j < lattice.rows - 1:
        right = _whole(lattice.link_a[b, i, j]) * _whole(lattice.link_a[b, i, j + 1])
        left = _whole(lattice.link_a[b, i - 1, j]) * _whole(lattice.link_a[b, i - 1, j + 1])
        halves = _weights(right, left)
        lattice.link_b[b, i, j][AHEAD] = halves[0]
        lattice.link_b[b, i, j][BEHIND] = halves[1]


@ti.func
def is_surface(lattice: ti.template(), b, i, j) -> ti.i32:
    """Whether any of the node's four connections is broken or was never there."""
    return ti.i32(
        _whole(lattice.link_a[b, i, j])
        + _whole(lattice.link_a[b, i - 1, j])
        + _whole(lattice.link_b[b, i, j])
        + _whole(lattice.link_b[b, i, j - 1])
        < 4
    )
