"""Connections: their forces at a stage, and their history once a step is accepted."""

import taichi as ti

from taichi_foam.engine.lattice import AHEAD, BEHIND, BREAK_TIME, INTACT, NEVER, WORST
from taichi_foam.laws import foam as foam_law
from taichi_foam.laws import kinematics

vec2 = ti.types.vector(2, ti.f64)
vec4 = ti.types.vector(4, ti.f64)

# A connection runs along its own axis (A along x, B along y); the other axis lies across it.
A = 0
B = 1


@ti.func
def crossing(lattice: ti.template(), axis: ti.template(), side: ti.template(), b, i, j) -> vec2:
    """Sum of the differences that cross a connection at its two nodes, on one side of it [m].

    `side` 0 is above an A and right of a B, -1 below and left. The two nodes' parts are added
    first: mirrored, the sum is then the same to the last bit.
    """
    ei, ej = ti.static((1, 0) if axis == A else (0, 1))  # to the connection's other node
    si, sj = ti.static((0, 1) if axis == A else (1, 0))  # to the neighbours beside it
    fi, fj = ti.static((side * si, side * sj))
    x = ti.static(lattice.trial)
    at_start = x[b, i + fi + si, j + fj + sj].xy - x[b, i + fi, j + fj].xy
    at_end = x[b, i + ei + fi + si, j + ej + fj + sj].xy - x[b, i + ei + fi, j + ej + fj].xy
    return at_start + at_end


@ti.func
def face_force(
    lattice: ti.template(), axis: ti.template(), latching: ti.template(),
    b, i, j, ahead: vec2, behind: vec2, p: ti.template(),
):  # fmt: skip
    """Force [N] of connection (i, j) on its first node, short of densification.

    `ahead` and `behind` are the crossing differences on its two sides. Besides, its strain; and
    with `latching`, when the state is an accepted one and the connection's history is brought up
    to date with it: the powers [W] that its shear and its dashpot take up, T . (v_end - v_start),
    and 1 if it breaks.
    """
    links = ti.static(lattice.links[axis])
    ei, ej = ti.static((1, 0) if axis == A else (0, 1))
    link = links[b, i, j]
    start = lattice.trial[b, i, j]
    end = lattice.trial[b, i + ei, j + ej]
    reach = end.xy - start.xy
    relative = end.zw - start.zw
    per_length = 1.0 / p.cell[axis]
    length = reach.norm()
    e = kinematics.engineering_strain(length * per_length)
    broken = ti.i32(link[BREAK_TIME] >= 0.0)
    stress = foam_law.yielding_stress(p.foam, e, link[WORST], broken)
    per_reach = 1.0 / length
    force = reach * (p.area[axis] * stress * per_reach)
    power = vec2(0.0)
    breaks = 0.0
    if ti.static(latching):  # noqa: SIM102 - the static test must stand alone
        if e < link[WORST]:
            links[b, i, j][WORST] = e
    if not broken:
        # F's column across the connection, from the halves that its broken neighbours leave
        across = link[AHEAD] * ahead + link[BEHIND] * behind
        gamma = kinematics.shear_strain(reach, across) * per_length
        tau = foam_law.shear_stress(p.foam, gamma)
        shear = across * (p.area[axis] * tau)
        dragging = p.cross_dashpot[axis] * relative
        if p.excess_dashpot[axis] != 0.0:
            closing = reach.dot(relative) * per_reach
            dragging += reach * (p.excess_dashpot[axis] * closing * per_reach)
        force += shear + dragging
        if ti.static(latching):
            power = vec2(shear.dot(relative), dragging.dot(relative))
            # the shear strength grows with the stress up to the plateau
            if foam_law.fails(p.foam, e, stress, tau, ti.min(link[WORST], e)):
                breaks = 1.0
                links[b, i, j][BREAK_TIME] = lattice.clock[b].time
    return force, e, power, breaks


@ti.func
def face_column(lattice: ti.template(), latching: ti.template(), b, i, p: ti.template()):
    """Forces of the connections to the right of and above each node of column `i`.

    What crosses an A above it crosses the next A below it, and is carried on.
    """
    power = vec2(0.0)
    deepest = 0.0
    breaks = 0.0
    below = crossing(lattice, A, -1, b, i, 0)
    for j in range(lattice.rows):
        force_a = vec2(0.0)
        force_b = vec2(0.0)
        if i < lattice.columns - 1:
            above = crossing(lattice, A, 0, b, i, j)
            force, e, taken, broke = face_force(lattice, A, latching, b, i, j, above, below, p)
            below = above
            force_a = force
            deepest = ti.min(deepest, e)
            power += taken
            breaks += broke
        if j < lattice.rows - 1:
            right = crossing(lattice, B, 0, b, i, j)
            left = crossing(lattice, B, -1, b, i, j)
            force, e, taken, broke = face_force(lattice, B, latching, b, i, j, right, left, p)
            force_b = force
            deepest = ti.min(deepest, e)
            power += taken
            breaks += broke
        lattice.force[b, i, j] = vec4(force_a.x, force_a.y, force_b.x, force_b.y)
    stiffest = 0.0
    if deepest < p.foam.densification_strain:
        stiffest = _densify_column(lattice, b, i, p)
    if ti.static(latching):
        lattice.column_power[b, i] = power
        lattice.column_found[b, i] = vec2(stiffest, breaks)


@ti.func
def _densify_column(lattice: ti.template(), b, i, p: ti.template()) -> ti.f64:
    """Add densification to the column's forces; its stiffest connection [N/m] comes back.

    Few columns have any, and the exponential's call would cost every face the processor's
    registers: so it has a loop of its own.
    """
    stiffest = 0.0
    for j in range(lattice.rows):
        extra = vec4(0.0)
        for axis in ti.static(range(2)):
            ei, ej = ti.static((1, 0) if axis == A else (0, 1))
            link = ti.static(lattice.links[axis])[b, i, j]
            if link[BREAK_TIME] < NEVER:
                reach = lattice.trial[b, i + ei, j + ej].xy - lattice.trial[b, i, j].xy
                square = reach.norm_sqr()
                dense_length = p.cell[axis] * (1.0 + p.foam.densification_strain)
                if square < dense_length * dense_length:
                    length = ti.sqrt(square)
                    e = kinematics.engineering_strain(length / p.cell[axis])
                    broken = ti.i32(link[BREAK_TIME] >= 0.0)
                    dense = foam_law.densification(p.foam, e, link[WORST], broken)
                    force = reach * (p.area[axis] * dense[0] / length)
                    extra[2 * axis] = force.x
                    extra[2 * axis + 1] = force.y
                    stiffest = ti.max(stiffest, dense[1] * p.area[axis] / p.cell[axis])
        lattice.force[b, i, j] += extra
    return stiffest


@ti.func
def book_fracture(lattice: ti.template(), b, i, j, p: ti.template()):
    """Book the stored energy that the node's connections have lost by breaking just now [J]."""
    for axis in ti.static(range(2)):
        ei, ej = ti.static((1, 0) if axis == A else (0, 1))
        link = ti.static(lattice.links[axis])[b, i, j]
        if link[BREAK_TIME] == lattice.clock[b].time:
            reach = lattice.trial[b, i + ei, j + ej].xy - lattice.trial[b, i, j].xy
            e = kinematics.engineering_strain(reach.norm() / p.cell[axis])
            lost = foam_law.energy_lost_by_breaking(p.foam, e, link[WORST])
            lattice.column_fracture[b, i] += p.area[axis] * p.cell[axis] * lost


@ti.func
def _whole(link: vec4) -> ti.i32:
    return ti.i32(link[BREAK_TIME] == INTACT)


@ti.func
def _weights(ahead: ti.i32, behind: ti.i32, spacing: ti.f64) -> vec2:
    """Factors of the two halves in the mean gradient [1/m], none of a half that does not count.

    Each half is the sum of two differences over `spacing`.
    """
    halves = ti.max(ahead + behind, 1)
    return vec2(ahead, behind) / (2.0 * halves * spacing)


@ti.func
def update_halves(lattice: ti.template(), b, i, j, p: ti.template()):
    """Which halves of the node's two connections still count (Eqs 13, 27, Fig. 20).

    A half counts while the crossing connections at both of the connection's nodes are whole. With
    none left the connection is a bare fibre: `across` vanishes, and the shear with it.
    """
    if i < lattice.columns - 1:
        above = _whole(lattice.link_b[b, i, j]) * _whole(lattice.link_b[b, i + 1, j])
        below = _whole(lattice.link_b[b, i, j - 1]) * _whole(lattice.link_b[b, i + 1, j - 1])
        factors = _weights(above, below, p.cell.y)
        lattice.link_a[b, i, j][AHEAD] = factors[0]
        lattice.link_a[b, i, j][BEHIND] = factors[1]
    if j < lattice.rows - 1:
        right = _whole(lattice.link_a[b, i, j]) * _whole(lattice.link_a[b, i, j + 1])
        left = _whole(lattice.link_a[b, i - 1, j]) * _whole(lattice.link_a[b, i - 1, j + 1])
        factors = _weights(right, left, p.cell.x)
        lattice.link_b[b, i, j][AHEAD] = factors[0]
        lattice.link_b[b, i, j][BEHIND] = factors[1]


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
