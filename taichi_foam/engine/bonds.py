"""Bonds: their forces at a stage, and what a step does to their history.

Everything is done a pack of bonds at a time, without branches on values: see `packs`.
"""

import taichi as ti

from taichi_foam.engine import packs
from taichi_foam.engine.lattice import ABSENT, BREAKING, BROKEN, LAST_STAGE, RING, A, B
from taichi_foam.engine.packs import AHEAD_FAR, AHEAD_NEAR, BEHIND_FAR, BEHIND_NEAR
from taichi_foam.laws import elementary, kinematics
from taichi_foam.laws import foam as foam_law

vec4 = ti.types.vector(4, ti.f64)


@ti.func
def slot_of(lattice: ti.template(), i, last):
    """Where a sweep that ends with column `last` keeps the forces of column `i`.

    The last column and the one beyond it have places of their own: their forces may be there before
    the sweep begins. Left and right of the lattice there are none, for which a place of zeros is
    kept.
    """
    outside = i < 0 or i >= lattice.columns
    within = ti.select(i == last, RING, ti.raw_mod(i, RING))
    return ti.select(outside, RING + 1, ti.select(i > last, RING + 2, within))


@ti.func
def _bond_forces(
    lattice: ti.template(), axis: ti.template(), stage, b, i, k, strip,
    reach_x, reach_y, along_u, along_v, ahead: ti.template(), behind: ti.template(),
    p: ti.template(),
):  # fmt: skip
    """Force [N] of a pack of bonds on their first nodes, short of densification.

    The third number is what the shear stress comes to over the face [N].

    `reach` and `along` are the differences of position and velocity between the two nodes. `ahead`
    and `behind` are the differences of position (near x, far x, near y, far y) that cross it on its
    two sides, at its first node and at its second.

    The first stage, whose state is the accepted one, brings the worst strain up to date. The last
    one, which looks at the step's end, finds what breaks there. Both sample the powers of shear and
    of the dashpots.
    """
    bonds = ti.static(lattice.bonds[axis])
    tally = ti.static(lattice.tally)
    length = ti.sqrt(reach_x * reach_x + reach_y * reach_y)
    e = kinematics.engineering_strain(length * (1.0 / p.cell[axis]))
    condition = ti.cast(bonds[b, i, k].condition, ti.f64)
    there = condition > ABSENT
    whole = condition > BROKEN
    worst = bonds[b, i, k].worst
    if p.foam.rate == 0.0:
        # the plateau has no memory, so a worst strain met only now gives the same stress
        worst = elementary.smaller(e, worst)
    numerator, divisor = foam_law.yielding_fraction(p.foam, e, worst, condition <= BROKEN)
    normal = p.area[axis] * numerator / (divisor * length)
    # F's column across the bond, from the differences that its broken neighbours leave; on
    # each side they are added first, so that the mirror image gives the same sum
    per_spacing = 1.0 / p.cell[1 - axis]
    weights = bonds[b, i, k].weights
    ahead_near, ahead_far = packs.weight(weights, AHEAD_NEAR), packs.weight(weights, AHEAD_FAR)
    behind_near, behind_far = packs.weight(weights, BEHIND_NEAR), packs.weight(weights, BEHIND_FAR)
    across_x = ahead_near * ahead[0] + ahead_far * ahead[1]
    across_y = ahead_near * ahead[2] + ahead_far * ahead[3]
    across_x += behind_near * behind[0] + behind_far * behind[1]
    across_y += behind_near * behind[2] + behind_far * behind[3]
    across_x *= per_spacing
    across_y *= per_spacing
    gamma = kinematics.shear_strain(reach_x, reach_y, across_x, across_y) * (1.0 / p.cell[axis])
    tau = foam_law.shear_stress(p.foam, gamma)
    shear = p.area[axis] * tau
    dashpot = ti.select(whole, p.cross_dashpot[axis], 0.0)
    drag_x = dashpot * along_u
    drag_y = dashpot * along_v
    if p.excess_dashpot[axis] != 0.0:
        closing = (reach_x * along_u + reach_y * along_v) / (length * length)
        excess = ti.select(whole, p.excess_dashpot[axis], 0.0) * closing
        drag_x += reach_x * excess
        drag_y += reach_y * excess
    shear_x = across_x * shear
    shear_y = across_y * shear
    force_x = ti.select(there, reach_x * normal + (shear_x + drag_x), 0.0)
    force_y = ti.select(there, reach_y * normal + (shear_y + drag_y), 0.0)
    # what the strip has to know goes to memory: this loop has no registers to spare
    tally[b, strip].least = elementary.smaller(ti.select(there, e, 0.0), tally[b, strip].least)
    # columns at the seams of two sweeps are looked at by both: twice is the same as once
    if stage == 0:
        bonds[b, i, k].worst = ti.select(there, worst, 0.0)
    if stage == LAST_STAGE:
        # the shear strength grows with the stress up to the plateau
        size = (1.0 + e) * ti.sqrt(across_x * across_x + across_y * across_y)
        strength = ti.cast(bonds[b, i, k].strength, ti.f64)
        tensile = strength
        if p.foam.crushed_strength < 1.0:
            crossing = _crossing_crush(lattice, axis, b, i, k)
            tensile *= foam_law.tensile_strength_left(p.foam, crossing)
        fails = foam_law.fails(p.foam, e, numerator / divisor, tau, worst, size, tensile, strength)
        failed = ti.select(fails, ti.cast(BREAKING, ti.f64), condition)
        condition = ti.select(whole, failed, condition)
        bonds[b, i, k].condition = ti.cast(condition, ti.f32)
        breaks = ti.select(condition == BREAKING, 1.0, 0.0)
        tally[b, strip].breaks = tally[b, strip].breaks + breaks
    if stage == 0 or stage == LAST_STAGE:
        sheared = ti.select(whole, shear_x * along_u + shear_y * along_v, 0.0)
        damped = ti.select(whole, drag_x * along_u + drag_y * along_v, 0.0)
        tally[b, strip].sheared = tally[b, strip].sheared + sheared
        tally[b, strip].damped = tally[b, strip].damped + damped
    return force_x, force_y, shear


@ti.func
def _crossing_crush(lattice: ti.template(), axis: ti.template(), b, i, k):
    """The worst strain across a pack of bonds, of the end that is crushed less."""
    crossing = ti.static(lattice.bonds[1 - axis])
    near = crossing[b, i, k].worst
    far = near
    if ti.static(axis == A):
        last = ti.static(lattice.lanes - 1)
        far = crossing[b, i + 1, k].worst
        near_below = packs.from_below(near, crossing[b, i, k - 1].worst[last])
        far_below = packs.from_below(far, crossing[b, i + 1, k - 1].worst[last])
        near = elementary.smaller(near, near_below)
        far = elementary.smaller(far, far_below)
    else:
        near = elementary.smaller(near, crossing[b, i - 1, k].worst)
        above = elementary.smaller(crossing[b, i, k + 1].worst, crossing[b, i - 1, k + 1].worst)
        far = packs.from_above(near, above[0])
    return elementary.larger(near, far)


@ti.func
def face_pack(
    lattice: ti.template(), stage, b, i, k, strip, sweep, slot, below: ti.template(),
    p: ti.template(),
):  # fmt: skip
    """Forces of the bonds to the right of and above each node of a pack, kept in `slot`.

    `below` is what crosses the first lane's A below it (near x, far x, near y, far y). What crosses
    the last lane's A above it comes back for the next pack. The strip's tally gets the least
    strain, at the first and the last stage the powers of shear and of dashpots, and at the last how
    many bonds break.
    """
    motion = ti.static(lattice.trial)
    here = motion[b, i, k]
    right = motion[b, i + 1, k]
    left = motion[b, i - 1, k]
    up = motion[b, i, k + 1]
    up_x = packs.from_above(here.x, up.x[0])
    up_y = packs.from_above(here.y, up.y[0])
    right_up_x = packs.from_above(right.x, motion[b, i + 1, k + 1].x[0])
    right_up_y = packs.from_above(right.y, motion[b, i + 1, k + 1].y[0])
    left_up_x = packs.from_above(left.x, motion[b, i - 1, k + 1].x[0])
    left_up_y = packs.from_above(left.y, motion[b, i - 1, k + 1].y[0])
    reach_x, reach_y = right.x - here.x, right.y - here.y
    rise_x, rise_y = up_x - here.x, up_y - here.y
    right_rise_x, right_rise_y = right_up_x - right.x, right_up_y - right.y
    force_x, force_y, shear = _bond_forces(
        lattice, A, stage, b, i, k, strip,
        reach_x, reach_y, right.u - here.u, right.v - here.v,
        (rise_x, right_rise_x, rise_y, right_rise_y),
        (
            packs.from_below(rise_x, below[0]), packs.from_below(right_rise_x, below[1]),
            packs.from_below(rise_y, below[2]), packs.from_below(right_rise_y, below[3]),
        ),
        p,
    )  # fmt: skip
    lattice.force[sweep, slot, k].ax = force_x
    lattice.force[sweep, slot, k].ay = force_y
    if p.variational:
        crossing = shear * (1.0 / p.cell.y)
        lattice.crossing[sweep, slot, k].ax = crossing * reach_x
        lattice.crossing[sweep, slot, k].ay = crossing * reach_y
    up_u = packs.from_above(here.u, up.u[0])
    up_v = packs.from_above(here.v, up.v[0])
    force_x, force_y, shear = _bond_forces(
        lattice, B, stage, b, i, k, strip,
        rise_x, rise_y, up_u - here.u, up_v - here.v,
        (reach_x, right_up_x - up_x, reach_y, right_up_y - up_y),
        (here.x - left.x, up_x - left_up_x, here.y - left.y, up_y - left_up_y),
        p,
    )  # fmt: skip
    lattice.force[sweep, slot, k].bx = force_x
    lattice.force[sweep, slot, k].by = force_y
    if p.variational:
        crossing = shear * (1.0 / p.cell.x)
        lattice.crossing[sweep, slot, k].bx = crossing * rise_x
        lattice.crossing[sweep, slot, k].by = crossing * rise_y
    last = ti.static(lattice.lanes - 1)
    return vec4(rise_x[last], right_rise_x[last], rise_y[last], right_rise_y[last])


@ti.func
def densify_pack(lattice: ti.template(), b, i, k, sweep, slot, p: ti.template()):
    """Add densification to a pack's forces; its stiffest bond [N/m] comes back."""
    here = lattice.trial[b, i, k]
    up = lattice.trial[b, i, k + 1]
    fx, fy, stiffest = _densify(
        A, lattice.bond_a[b, i, k],
        lattice.trial[b, i + 1, k].x - here.x, lattice.trial[b, i + 1, k].y - here.y, p,
    )  # fmt: skip
    lattice.force[sweep, slot, k].ax = lattice.force[sweep, slot, k].ax + fx
    lattice.force[sweep, slot, k].ay = lattice.force[sweep, slot, k].ay + fy
    fx, fy, stiff = _densify(
        B, lattice.bond_b[b, i, k],
        packs.from_above(here.x, up.x[0]) - here.x, packs.from_above(here.y, up.y[0]) - here.y, p,
    )  # fmt: skip
    lattice.force[sweep, slot, k].bx = lattice.force[sweep, slot, k].bx + fx
    lattice.force[sweep, slot, k].by = lattice.force[sweep, slot, k].by + fy
    return ti.max(stiffest, stiff)


@ti.func
def _densify(axis: ti.template(), bond: ti.template(), reach_x, reach_y, p: ti.template()):
    length = ti.sqrt(reach_x * reach_x + reach_y * reach_y)
    e = kinematics.engineering_strain(length * (1.0 / p.cell[axis]))
    broken = bond.condition <= BROKEN
    stress, slope = foam_law.densification(p.foam, e, bond.worst, broken)
    there = bond.condition > ABSENT
    force = ti.select(there, p.area[axis] * stress / length, 0.0)
    stiffness = ti.select(there, slope * (p.area[axis] / p.cell[axis]), 0.0)
    return reach_x * force, reach_y * force, stiffness.max()


@ti.func
def face_column(lattice: ti.template(), stage, b, i, strip, sweep, slot, p: ti.template()):
    """Forces of column `i`'s bonds, kept in `slot`, and what a step has to know of them.

    What crosses an A above it crosses the next A below it, and is carried on. Densification has
    a loop of its own: few columns have any, and it would cost every other face its registers.
    """
    clear_faces(lattice, b, strip)
    below = vec4(0.0)
    for k in range(lattice.packs):
        below = face_pack(lattice, stage, b, i, k, strip, sweep, slot, below, p)
    stiffest = 0.0
    if lattice.tally[b, strip].least.min() < p.foam.densification_strain:
        for k in range(lattice.packs):
            stiff = densify_pack(lattice, b, i, k, sweep, slot, p)
            stiffest = ti.max(stiffest, stiff)
    lattice.strip_stiffest[b, strip] = stiffest
    if stage == LAST_STAGE:
        lattice.column_breaks[b, i] = ti.i32(lattice.tally[b, strip].breaks.sum())


@ti.func
def flow_pack(lattice: ti.template(), b, i, k, p: ti.template()):
    """Before a step, of rate-sensitive foam: let the worst strains of a pack flow.

    They are frozen during steps. What flows in the time of a step, at the strain now, takes them
    from the middle of the last step to the middle of the next: an error of second order.
    """
    motion = ti.static(lattice.state)
    here = motion[b, i, k]
    right = motion[b, i + 1, k]
    up = motion[b, i, k + 1]
    _flow(lattice, A, b, i, k, right.x - here.x, right.y - here.y, p)
    rise_x = packs.from_above(here.x, up.x[0]) - here.x
    rise_y = packs.from_above(here.y, up.y[0]) - here.y
    _flow(lattice, B, b, i, k, rise_x, rise_y, p)


@ti.func
def flow_column(lattice: ti.template(), b, i, p: ti.template()):
    for k in range(lattice.packs):
        flow_pack(lattice, b, i, k, p)


@ti.func
def _flow(lattice: ti.template(), axis: ti.template(), b, i, k, reach_x, reach_y, p: ti.template()):
    bonds = ti.static(lattice.bonds[axis])
    length = ti.sqrt(reach_x * reach_x + reach_y * reach_y)
    e = kinematics.engineering_strain(length * (1.0 / p.cell[axis]))
    worst = bonds[b, i, k].worst
    there = bonds[b, i, k].condition > ABSENT
    # powers are dear, and few bonds flow
    if packs.any_of(there & (e < worst)):
        flowed = foam_law.flowed_strain(p.foam, e, worst, lattice.clock[b].step)
        bonds[b, i, k].worst = ti.select(there, flowed, 0.0)


@ti.func
def clear_faces(lattice: ti.template(), b, strip):
    """Start the tally of a strip's faces."""
    lattice.tally[b, strip].least = packs.zeros(lattice)
    lattice.tally[b, strip].sheared = packs.zeros(lattice)
    lattice.tally[b, strip].damped = packs.zeros(lattice)
    lattice.tally[b, strip].breaks = packs.zeros(lattice)
