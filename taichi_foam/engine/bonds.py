"""Bonds: their forces at a stage, and what a step does to their history.

Everything is done a pack of bonds at a time, without branches on values: see `lanes`. The normal
stress of a bond needs a root and a quotient; it is worked out apart from its shear stress.
"""

import taichi as ti

from taichi_foam.engine import cells, lanes, makeup
from taichi_foam.engine.grading import A, B
from taichi_foam.engine.lanes import AHEAD_FAR, AHEAD_NEAR, BEHIND_FAR, BEHIND_NEAR
from taichi_foam.engine.lattice import LAST_STAGE
from taichi_foam.engine.layout import RING
from taichi_foam.engine.state import ABSENT, BREAKING, BROKEN
from taichi_foam.laws import elementary, kinematics


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
def _normal_force(
    lattice: ti.template(), axis: ti.template(), stage, b, i, k, strip, reach_x, reach_y,
    p: ti.template(),
):  # fmt: skip
    """Length [m] and strain of a pack of bonds, and its normal force over its length [N/m].

    The force is without stiffening. `reach` is the difference of position between the bonds' nodes
    [m]. The first stage, whose state is the accepted one, brings the worst strain up to date.
    """
    bonds = ti.static(lattice.state.bonds[axis])
    tally = ti.static(lattice.scratch.tally)
    length = ti.sqrt(reach_x * reach_x + reach_y * reach_y)
    e = kinematics.engineering_strain(length * (1.0 / p.cell[axis]))
    condition = bonds[b, i, k].condition
    there = condition > ABSENT
    worst = bonds[b, i, k].worst
    if ti.static(not lattice.law.heeds_rate):
        # the plateau has no memory, so a worst strain met only now gives the same stress
        worst = elementary.smaller(e, worst)
    numerator, divisor = lattice.law.stress_fraction(
        makeup.constants(lattice, axis, b, k, p), e, worst, condition <= BROKEN
    )
    if ti.static(lattice.features.softens):
        intact = ti.cast(bonds[b, i, k].intact, ti.f64)
        # what pulls; as a choice of one of two products the compiler leaves it scalar
        pulls = elementary.larger(numerator, 0.0)
        numerator = intact * pulls + elementary.smaller(numerator, 0.0)
    # what the strip has to know goes to memory: these loops have no registers to spare. Columns at
    # the seams of two sweeps are looked at by both: twice is the same as once
    tally[b, strip].least = elementary.smaller(ti.select(there, e, 0.0), tally[b, strip].least)
    if stage == 0:
        bonds[b, i, k].worst = ti.select(there, worst, 0.0)
    return length, e, makeup.face(lattice, axis, b, i, k, p) * numerator / (divisor * length)


@ti.func
def normal_forces(lattice: ti.template(), stage, b, i, k, strip, p: ti.template()):
    """What `_normal_force` gives of a pack's bonds A, then B."""
    trial = ti.static(lattice.scratch.trial)
    x, y = trial[b, i, k].x, trial[b, i, k].y
    a_length, a_strain, a = _normal_force(
        lattice, A, stage, b, i, k, strip, trial[b, i + 1, k].x - x, trial[b, i + 1, k].y - y, p
    )
    b_length, b_strain, b_force = _normal_force(
        lattice, B, stage, b, i, k, strip,
        lanes.above(x, trial.x, b, i, k) - x, lanes.above(y, trial.y, b, i, k) - y, p,
    )  # fmt: skip
    return a_length, a_strain, a, b_length, b_strain, b_force


@ti.func
def _column_across(lattice: ti.template(), weights, ahead_near, ahead_far, behind_near, behind_far):
    """Mean of the differences across a pack of bonds that its broken neighbours leave (Eqs 13, 27).

    They cross it on its two sides, ahead and behind, at its first node (near) and its second (far).
    Those of a side are added first, so that the mirror image gives the same sum.
    """
    across = ahead_near
    if ti.static(lattice.features.four_weights):
        across = lanes.weight(weights, AHEAD_NEAR) * ahead_near
        across += lanes.weight(weights, AHEAD_FAR) * ahead_far
        across += (
            lanes.weight(weights, BEHIND_NEAR) * behind_near
            + lanes.weight(weights, BEHIND_FAR) * behind_far
        )
    else:
        across = lanes.weight(weights, AHEAD_NEAR) * (ahead_near + ahead_far)
        across += lanes.weight(weights, BEHIND_NEAR) * (behind_near + behind_far)
    return across


@ti.func
def _bond_forces(
    lattice: ti.template(), axis: ti.template(), stage, b, i, k, strip,
    length, e, normal, reach_x, reach_y, along_u, along_v, across_x, across_y, p: ti.template(),
):  # fmt: skip
    """Force [N] of a pack of bonds on their first nodes, without stiffening.

    The third number is what the shear stress comes to over the face [N].

    `length`, `e` and `normal` are what `_normal_force` gives, `reach` and `along` the differences
    of position and velocity between the two nodes, `across` that of `_column_across`. The last
    stage, which looks at the step's end, finds what breaks there. The first and the last one sample
    the powers of shear and of the dashpots.
    """
    bonds = ti.static(lattice.state.bonds[axis])
    tally = ti.static(lattice.scratch.tally)
    condition = ti.cast(bonds[b, i, k].condition, ti.f64)
    whole = condition > BROKEN
    per_spacing = 1.0 / p.cell[1 - axis]
    column_x, column_y = across_x * per_spacing, across_y * per_spacing
    gamma = kinematics.shear_strain(reach_x, reach_y, column_x, column_y) * (1.0 / p.cell[axis])
    tau = lattice.law.shear_stress(makeup.constants(lattice, axis, b, k, p), gamma)
    if ti.static(lattice.law.shears_stiffer):
        # as much on both sides of a cell's corner, or shear would turn it
        crushed = elementary.smaller(bonds[b, i, k].worst, _crush_across(lattice, axis, b, i, k))
        modulus = lattice.law.shear_modulus(makeup.constants(lattice, axis, b, k, p), crushed)
        tau = modulus * gamma
    shear = makeup.face(lattice, axis, b, i, k, p) * tau
    dashpot = ti.select(whole, makeup.shares(lattice, axis, b, k, p).cross_dashpot, 0.0)
    excess = dashpot
    if ti.static(lattice.features.excess_damping):
        excess = ti.select(whole, makeup.shares(lattice, axis, b, k, p).excess_dashpot, 0.0)
    if ti.static(lattice.features.softens):
        intact = ti.cast(bonds[b, i, k].intact, ti.f64)
        shear *= intact
        dashpot *= intact
        excess *= intact
    drag_x = dashpot * along_u
    drag_y = dashpot * along_v
    if ti.static(lattice.features.excess_damping):
        closing = (reach_x * along_u + reach_y * along_v) / (length * length)
        excess *= closing
        drag_x += reach_x * excess
        drag_y += reach_y * excess
    shear_x = column_x * shear
    shear_y = column_y * shear
    there = condition > ABSENT
    force_x = ti.select(there, reach_x * normal + (shear_x + drag_x), 0.0)
    force_y = ti.select(there, reach_y * normal + (shear_y + drag_y), 0.0)
    if stage == LAST_STAGE:
        worst = bonds[b, i, k].worst
        if ti.static(not lattice.law.heeds_rate):
            worst = elementary.smaller(e, worst)
        numerator, divisor = lattice.law.stress_fraction(
            makeup.constants(lattice, axis, b, k, p), e, worst, condition <= BROKEN
        )
        size = (1.0 + e) * ti.sqrt(column_x * column_x + column_y * column_y)
        strength = lanes.zeros(lattice) + 1.0
        if ti.static(lattice.features.scattered):
            strength = ti.cast(lattice.model.strengths[axis][b, i, k], ti.f64)
        tensile = strength * makeup.shares(lattice, axis, b, k, p).tensile_share
        strength *= makeup.shares(lattice, axis, b, k, p).shear_share
        if ti.static(lattice.law.weakens_across):
            tensile *= lattice.law.strength_left(
                makeup.constants(lattice, axis, b, k, p), _crush_across(lattice, axis, b, i, k)
            )
        sigma_e = numerator / divisor
        fails = whole & lattice.law.fails(
            makeup.constants(lattice, axis, b, k, p), e, sigma_e, tau, worst, size, tensile,
            strength,
        )  # fmt: skip
        if ti.static(lattice.features.softens):
            # divisions are dear, and few bonds are beyond their limits
            if lanes.any_of(fails):
                pulled, sheared = lattice.law.overload(
                    makeup.constants(lattice, axis, b, k, p), e, sigma_e, tau, worst, size,
                    tensile, strength,
                )  # fmt: skip
                left = elementary.smaller(
                    _left(pulled, makeup.shares(lattice, axis, b, k, p).tensile_tail),
                    _left(sheared, makeup.shares(lattice, axis, b, k, p).shear_tail),
                )
                left = elementary.smaller(left, condition)
                # over what is there now: a column at a seam of two sweeps is looked at by both
                intact = ti.cast(bonds[b, i, k].intact, ti.f64)
                softens = ti.select(whole & (left < intact) & (left > 0.0), 1.0, 0.0)
                tally[b, strip].softens = tally[b, strip].softens + softens
                failed = ti.select(left > 0.0, left, ti.cast(BREAKING, ti.f64))
                condition = ti.select(whole, failed, condition)
        else:
            condition = ti.select(fails, ti.cast(BREAKING, ti.f64), condition)
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
def _left(overload, tail):
    """What is left of a bond's face at so many times its limit: its stress falls in a line."""
    fallen = (tail - overload) / (overload * ti.max(tail - 1.0, 1e-9))
    return ti.select(overload > 1.0, elementary.larger(fallen, 0.0), 1.0)


@ti.func
def _crush_across(lattice: ti.template(), axis: ti.template(), b, i, k):
    """The worst strain across a pack of bonds, of the end that is crushed less."""
    crossing = ti.static(lattice.state.bonds[1 - axis])
    near = crossing[b, i, k].worst
    far = near
    if ti.static(axis == A):
        far = crossing[b, i + 1, k].worst
        near_below = lanes.below(near, crossing.worst, b, i, k)
        far_below = lanes.below(far, crossing.worst, b, i + 1, k)
        near = elementary.smaller(near, near_below)
        far = elementary.smaller(far, far_below)
    else:
        near = elementary.smaller(near, crossing[b, i - 1, k].worst)
        above = elementary.smaller(crossing[b, i, k + 1].worst, crossing[b, i - 1, k + 1].worst)
        far = lanes.from_above(near, above[0])
    return elementary.larger(near, far)


@ti.func
def bond_pack(
    lattice: ti.template(), stage, b, i, k, strip, sweep, slot, a_length, a_strain, a_normal,
    b_length, b_strain, b_normal, p: ti.template(),
):  # fmt: skip
    """Forces of the bonds to the right of and above each node of a pack, kept in `slot`.

    Lengths, strains and normal forces are those of `normal_forces`. The strip's tally gets, at the
    first and the last stage, the powers of shear and of dashpots, and at the last how many bonds
    break.
    """
    trial = ti.static(lattice.scratch.trial)
    force = ti.static(lattice.scratch.force)
    weights_a = lattice.state.bond_a[b, i, k].weights
    weights_b = lattice.state.bond_b[b, i, k].weights
    x, y = trial[b, i, k].x, trial[b, i, k].y
    right_x, right_y = trial[b, i + 1, k].x, trial[b, i + 1, k].y
    up_x, up_y = lanes.above(x, trial.x, b, i, k), lanes.above(y, trial.y, b, i, k)
    right_up_x = lanes.above(right_x, trial.x, b, i + 1, k)
    right_up_y = lanes.above(right_y, trial.y, b, i + 1, k)
    reach_x, reach_y = right_x - x, right_y - y
    rise_x, rise_y = up_x - x, up_y - y
    u, v = trial[b, i, k].u, trial[b, i, k].v
    across_x = _column_across(
        lattice, weights_a, rise_x, right_up_x - right_x,
        x - lanes.below(x, trial.x, b, i, k), right_x - lanes.below(right_x, trial.x, b, i + 1, k),
    )  # fmt: skip
    across_y = _column_across(
        lattice, weights_a, rise_y, right_up_y - right_y,
        y - lanes.below(y, trial.y, b, i, k), right_y - lanes.below(right_y, trial.y, b, i + 1, k),
    )  # fmt: skip
    force_x, force_y, shear = _bond_forces(
        lattice, A, stage, b, i, k, strip, a_length, a_strain, a_normal, reach_x, reach_y,
        trial[b, i + 1, k].u - u, trial[b, i + 1, k].v - v, across_x, across_y, p,
    )  # fmt: skip
    force[sweep, slot, k].ax = force_x
    force[sweep, slot, k].ay = force_y
    if ti.static(lattice.features.variational):
        crossing = shear * (1.0 / p.cell.y)
        lattice.scratch.crossing[sweep, slot, k].ax = crossing * reach_x
        lattice.scratch.crossing[sweep, slot, k].ay = crossing * reach_y
    left_x, left_y = trial[b, i - 1, k].x, trial[b, i - 1, k].y
    left_up_x = lanes.above(left_x, trial.x, b, i - 1, k)
    left_up_y = lanes.above(left_y, trial.y, b, i - 1, k)
    across_x = _column_across(
        lattice, weights_b, reach_x, right_up_x - up_x, x - left_x, up_x - left_up_x
    )
    across_y = _column_across(
        lattice, weights_b, reach_y, right_up_y - up_y, y - left_y, up_y - left_up_y
    )
    force_x, force_y, shear = _bond_forces(
        lattice, B, stage, b, i, k, strip, b_length, b_strain, b_normal, rise_x, rise_y,
        lanes.above(u, trial.u, b, i, k) - u, lanes.above(v, trial.v, b, i, k) - v,
        across_x, across_y, p,
    )  # fmt: skip
    force[sweep, slot, k].bx = force_x
    force[sweep, slot, k].by = force_y
    if ti.static(lattice.features.variational):
        crossing = shear * (1.0 / p.cell.x)
        lattice.scratch.crossing[sweep, slot, k].bx = crossing * rise_x
        lattice.scratch.crossing[sweep, slot, k].by = crossing * rise_y


@ti.func
def stiffen_pack(
    lattice: ti.template(), b, i, k, sweep, slot, a_strain, b_strain, p: ti.template()
):  # fmt: skip
    """Add stiffening to a pack's forces; its stiffest bond [N/m] comes back.

    Foam is seldom packed along both axes, and exponentials are dear.
    """
    trial = ti.static(lattice.scratch.trial)
    force = ti.static(lattice.scratch.force)
    stiffest = 0.0
    if _may_stiffen(lattice, A, b, k, a_strain, p):
        reach_x = trial[b, i + 1, k].x - trial[b, i, k].x
        reach_y = trial[b, i + 1, k].y - trial[b, i, k].y
        fx, fy, stiff = _stiffening(lattice, A, b, i, k, reach_x, reach_y, p)
        force[sweep, slot, k].ax = force[sweep, slot, k].ax + fx
        force[sweep, slot, k].ay = force[sweep, slot, k].ay + fy
        stiffest = ti.max(stiffest, stiff)
    if _may_stiffen(lattice, B, b, k, b_strain, p):
        x, y = trial[b, i, k].x, trial[b, i, k].y
        fx, fy, stiff = _stiffening(
            lattice, B, b, i, k,
            lanes.above(x, trial.x, b, i, k) - x, lanes.above(y, trial.y, b, i, k) - y, p,
        )  # fmt: skip
        force[sweep, slot, k].bx = force[sweep, slot, k].bx + fx
        force[sweep, slot, k].by = force[sweep, slot, k].by + fy
        stiffest = ti.max(stiffest, stiff)
    return stiffest


@ti.func
def _may_stiffen(lattice: ti.template(), axis: ti.template(), b, k, strain, p: ti.template()):
    """Whether any of a pack's bonds is packed."""
    limit = lattice.law.stiffens_below(makeup.constants(lattice, axis, b, k, p))
    if ti.static(lattice.features.foams > 1):
        return lanes.any_of(strain < limit)
    return strain.min() < limit


@ti.func
def _stiffening(
    lattice: ti.template(), axis: ti.template(), b, i, k, reach_x, reach_y, p: ti.template()
):
    bond = lattice.state.bonds[axis][b, i, k]
    length = ti.sqrt(reach_x * reach_x + reach_y * reach_y)
    e = kinematics.engineering_strain(length * (1.0 / p.cell[axis]))
    stress, slope = lattice.law.stiffening(
        makeup.constants(lattice, axis, b, k, p), e, bond.worst, bond.condition <= BROKEN
    )
    there = bond.condition > ABSENT
    face = makeup.face(lattice, axis, b, i, k, p)
    force = ti.select(there, face * stress / length, 0.0)
    stiffness = ti.select(there, slope * (face / p.cell[axis]), 0.0)
    return reach_x * force, reach_y * force, stiffness.max()


@ti.func
def bond_column(lattice: ti.template(), stage, b, i, strip, sweep, slot, p: ti.template()):
    """Forces of column `i`'s bonds, kept in `slot`, and what a step has to know of them.

    Stiffening has a loop of its own: few packs have any, and it would cost every other bond its
    registers.
    """
    strain = ti.static(lattice.scratch.strain)
    clear_bonds(lattice, b, strip)
    for k in range(lattice.packs):
        a_length, a_strain, a, b_length, b_strain, b_force = normal_forces(
            lattice, stage, b, i, k, strip, p
        )
        strain[sweep, k].a = a_strain
        strain[sweep, k].b = b_strain
        bond_pack(
            lattice, stage, b, i, k, strip, sweep, slot, a_length, a_strain, a, b_length,
            b_strain, b_force, p,
        )  # fmt: skip
    stiffest = 0.0
    if ti.static(lattice.law.stiffens):  # noqa: SIM102 - the static test must stand alone
        if _column_may_stiffen(lattice, b, strip, p):
            for k in range(lattice.packs):
                stiff = stiffen_pack(
                    lattice, b, i, k, sweep, slot, strain[sweep, k].a,
                    strain[sweep, k].b, p,
                )  # fmt: skip
                stiffest = ti.max(stiffest, stiff)
    lattice.scratch.stiffest[b, strip] = stiffest
    if ti.static(lattice.features.crushed_room):
        cells.press_column(lattice, stage, b, i, strip, sweep, slot, p)
    if stage == LAST_STAGE:
        lattice.scratch.column_breaks[b, i] = ti.i32(lattice.scratch.tally[b, strip].breaks.sum())
        if ti.static(lattice.features.softens):
            softens = lattice.scratch.tally[b, strip].softens.sum()
            lattice.scratch.column_softens[b, i] = ti.i32(softens)


@ti.func
def _column_may_stiffen(lattice: ti.template(), b, strip, p: ti.template()):
    """Whether any bond of a strip is packed; each pack knows of its own foams."""
    if ti.static(lattice.features.foams > 1):
        return 1
    return lattice.scratch.tally[b, strip].least.min() < lattice.law.stiffens_below(p.bond)


@ti.func
def flow_pack(lattice: ti.template(), b, i, k, p: ti.template()):
    """Before a step, of rate-sensitive foam: let the worst strains of a pack flow.

    They are frozen during steps. What flows in the time of a step, at the strain now, takes them
    from the middle of the last step to the middle of the next: an error of second order.
    """
    motion = ti.static(lattice.state.motion)
    x, y = motion[b, i, k].x, motion[b, i, k].y
    _flow(lattice, A, b, i, k, motion[b, i + 1, k].x - x, motion[b, i + 1, k].y - y, p)
    _flow(
        lattice, B, b, i, k,
        lanes.above(x, motion.x, b, i, k) - x, lanes.above(y, motion.y, b, i, k) - y, p,
    )  # fmt: skip


@ti.func
def flow_column(lattice: ti.template(), b, i, p: ti.template()):
    for k in range(lattice.packs):
        flow_pack(lattice, b, i, k, p)


@ti.func
def _flow(lattice: ti.template(), axis: ti.template(), b, i, k, reach_x, reach_y, p: ti.template()):
    bonds = ti.static(lattice.state.bonds[axis])
    length = ti.sqrt(reach_x * reach_x + reach_y * reach_y)
    e = kinematics.engineering_strain(length * (1.0 / p.cell[axis]))
    worst = bonds[b, i, k].worst
    there = bonds[b, i, k].condition > ABSENT
    # powers are dear, and few bonds flow
    if lanes.any_of(there & (e < worst)):
        # at a rate that counts half, foam flows as in twice the time
        time = lattice.state.clock[b].step * makeup.shares(lattice, axis, b, k, p).flow_share
        flowed = lattice.law.flowed(makeup.constants(lattice, axis, b, k, p), e, worst, time)
        bonds[b, i, k].worst = ti.select(there, flowed, 0.0)


@ti.func
def clear_bonds(lattice: ti.template(), b, strip):
    """Start the tally of a strip's bonds."""
    tally = ti.static(lattice.scratch.tally)
    tally[b, strip].least = lanes.zeros(lattice)
    tally[b, strip].sheared = lanes.zeros(lattice)
    tally[b, strip].damped = lanes.zeros(lattice)
    tally[b, strip].pressed = lanes.zeros(lattice)
    tally[b, strip].breaks = lanes.zeros(lattice)
    if ti.static(lattice.features.softens):
        tally[b, strip].softens = lanes.zeros(lattice)
