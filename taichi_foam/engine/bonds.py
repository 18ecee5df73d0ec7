"""Bonds: their forces at a stage, how a step updates their history, and which break or soften.

Forces are computed for a pack of bonds at a time, without branches on values: see `lanes`. A bond's
force acts along it. Cells carry the shear; only with Model.shear = "face" do bonds carry it too.
"""

from taichi_foam.backend import ti
from taichi_foam.engine import cells, lanes, makeup
from taichi_foam.engine.grading import A, B
from taichi_foam.engine.lattice import LAST_STAGE
from taichi_foam.engine.layout import RING
from taichi_foam.engine.state import ABSENT, BREAKING, BROKEN, WORK, book
from taichi_foam.laws import elementary, kinematics


@ti.func
def slot_of(lattice: ti.template(), i, last):
    """Slot in which a sweep that ends with column `last` keeps the forces of column `i`.

    The last column and the one beyond it have slots of their own: their forces may be computed
    before the sweep begins. Columns outside the lattice share a slot of zeros.
    """
    outside = i < 0 or i >= lattice.counts[None].columns
    within = ti.select(i == last, RING, ti.raw_mod(i, RING))
    return ti.select(outside, RING + 1, ti.select(i > last, RING + 2, within))


@ti.func
def _remembered(lattice: ti.template(), axis: ti.template(), b, i, k):
    """What a pack of bonds remembers: the law's `History`, in packs."""
    return lattice.state.History(
        *[member[b, i, k] for member in ti.static(lattice.state.remembered[axis])]
    )


@ti.func
def _remember(
    lattice: ti.template(), axis: ti.template(), b, i, k, there, history: ti.template()
):  # fmt: skip
    """Store what a pack of bonds remembers, of those that are `there`."""
    for member, value in ti.static(
        zip(lattice.state.remembered[axis], history.entries.values(), strict=True)
    ):
        member[b, i, k] = ti.select(there, value, 0.0)


@ti.func
def _bond(
    lattice: ti.template(), axis: ti.template(), stage, b, i, k, strip, reach_x, reach_y, squared,
    length, along_u, along_v, p: ti.template(),
):  # fmt: skip
    """Strain of a pack of bonds, and their forces [N] on their first nodes, without stiffening.

    `reach` and `along` are the differences of position [m] and velocity [m/s] between the bonds'
    nodes, `length` and `squared` the size of `reach` [m] and its square. The first stage, whose
    state is the accepted one, updates what they remember; the last stage, whose state is that at
    the step's end, finds the bonds that fail.
    """
    bonds, tally = ti.static(lattice.state.bonds[axis], lattice.scratch.tally)
    e = kinematics.engineering_strain(length * (1.0 / p.cell[axis]))
    condition = bonds[b, i, k].condition
    there, whole = condition > ABSENT, condition > BROKEN
    history = lattice.law.met(
        makeup.constants(lattice, axis, b, k, p), e, _remembered(lattice, axis, b, i, k)
    )
    numerator, divisor = lattice.law.stress_fraction(
        makeup.constants(lattice, axis, b, k, p), e, history, condition <= BROKEN
    )
    if ti.static(lattice.features.softens):
        # the tensile part; written as a choice of two products, it would not be vectorised
        pulls = elementary.larger(numerator, 0.0)
        numerator = ti.cast(bonds[b, i, k].intact, ti.f64) * pulls + elementary.smaller(
            numerator, 0.0
        )
    # the strip's tally is kept in memory: these loops have no registers to spare. Columns at the
    # seam of two sweeps are visited by both: doing this twice gives the same result
    packed = lattice.law.stiffens_at(e, history)
    tally[b, strip].least = elementary.smaller(ti.select(there, packed, 0.0), tally[b, strip].least)
    if ti.static(not lattice.law.only_flows):  # noqa: SIM102 - the static test must stand alone
        if stage == 0:
            _remember(lattice, axis, b, i, k, there, history)
    drag = lanes.zeros(lattice)
    if elementary.any_of(whole):
        closing = reach_x * along_u + reach_y * along_v
        dashpot = makeup.shares(lattice, axis, b, k, p).dashpot / squared
        dashpot *= makeup.face_share(lattice, axis, b, i, k)
        if ti.static(lattice.features.softens):
            dashpot *= ti.cast(bonds[b, i, k].intact, ti.f64)
        drag = ti.select(whole, dashpot * closing, 0.0)
        tally[b, strip].damped = tally[b, strip].damped + drag * closing
    # this branch and the one above keep the compiler from merging all parts into one sum, lane by
    # lane
    if stage == LAST_STAGE:
        _look_for_failure(lattice, axis, b, i, k, strip, reach_x, reach_y, e, history, p)
    normal = makeup.face(lattice, axis, b, i, k, p) * numerator / (divisor * length)
    normal = ti.select(there, normal, 0.0) + drag
    force_x, force_y = reach_x * normal, reach_y * normal
    if ti.static(lattice.features.faces):
        tau, across_x, across_y = _shear(lattice, axis, b, i, k, reach_x, reach_y, p)
        if ti.static(lattice.features.softens):
            tau *= ti.cast(bonds[b, i, k].intact, ti.f64)
        shear = ti.select(whole, makeup.face(lattice, axis, b, i, k, p) * tau, 0.0)
        force_x += across_x * shear
        force_y += across_y * shear
        sheared = (across_x * along_u + across_y * along_v) * shear
        tally[b, strip].sheared = tally[b, strip].sheared + sheared
    return packed, force_x, force_y


@ti.func
def _yields_as_at(lattice: ti.template(), axis: ti.template(), b, i, k, e, p: ti.template()):
    """The strain at which a pack's bonds would yield as they do at `e` if their foam had no shear.

    A bond is between two cells, whose shear stresses beyond balance, tau, count alike: of the
    plateau's stress Y they leave it sqrt(1 - 2 tau^2 / Y^2) (docs/model.md, Yield in shear). A side
    without a cell that holds has no shear, and broken bonds feel none.
    """
    sheared = ti.static(lattice.scratch.excess_shear)
    here = sheared[b, i, k]
    beside = lanes.below(here, sheared, b, i, k)
    if ti.static(axis == B):
        beside = sheared[b, i - 1, k]
    c = makeup.constants(lattice, axis, b, k, p)
    stress = lattice.law.plateau_stress(c)
    squares = ti.cast(here * here + beside * beside, ti.f64)
    left = elementary.larger(1.0 - squares * (1.0 / (stress * stress)), 0.0)
    whole = lattice.state.bonds[axis][b, i, k].condition > BROKEN
    yields = e
    # a root is at least its share: if no bond yields with `left`, no root is needed
    if elementary.any_of(whole & (lattice.law.yields_as_at(c, e, left) < e)):
        yields = ti.select(whole, lattice.law.yields_as_at(c, e, ti.sqrt(left)), e)
    return yields


@ti.func
def _look_for_failure(
    lattice: ti.template(), axis: ti.template(), b, i, k, strip, reach_x, reach_y, e,
    history: ti.template(), p: ti.template(),
):  # fmt: skip
    """Find which of a pack's bonds break at the end of this step, and the intact shares of others.

    Both are stored as the bonds' `condition`.
    """
    bonds, tally = ti.static(lattice.state.bonds[axis], lattice.scratch.tally)
    condition = ti.cast(bonds[b, i, k].condition, ti.f64)
    whole = condition > BROKEN
    tau, across_x, across_y = _shear(lattice, axis, b, i, k, reach_x, reach_y, p)
    numerator, divisor = lattice.law.stress_fraction(
        makeup.constants(lattice, axis, b, k, p), e, history, bonds[b, i, k].condition <= BROKEN
    )
    sigma_e = numerator / divisor
    size = (1.0 + e) * ti.sqrt(across_x * across_x + across_y * across_y)
    strength = lanes.zeros(lattice) + 1.0
    if ti.static(lattice.features.scattered):
        strength = ti.cast(lattice.model.strengths[axis][b, i, k], ti.f64)
    tensile = strength * makeup.shares(lattice, axis, b, k, p).tensile_share
    strength *= makeup.shares(lattice, axis, b, k, p).shear_share
    fails = whole & lattice.law.fails(
        makeup.constants(lattice, axis, b, k, p), e, sigma_e, tau, history, size, tensile, strength
    )
    if ti.static(lattice.features.softens):
        # divisions are expensive, and few bonds are beyond their limits
        if elementary.any_of(fails):
            pulled, sheared = lattice.law.overload(
                makeup.constants(lattice, axis, b, k, p), e, sigma_e, tau, history, size, tensile,
                strength,
            )  # fmt: skip
            left = elementary.smaller(
                _left(pulled, makeup.shares(lattice, axis, b, k, p).tensile_tail),
                _left(sheared, makeup.shares(lattice, axis, b, k, p).shear_tail),
            )
            left = elementary.smaller(left, condition)
            # compared with the present share, since a column at a seam is visited by two sweeps
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


@ti.func
def _left(overload, tail):
    """Intact share of a bond's face at `overload` times its limit: its stress falls linearly."""
    fallen = (tail - overload) / (overload * ti.max(tail - 1.0, 1e-9))
    return ti.select(overload > 1.0, elementary.larger(fallen, 0.0), 1.0)


@ti.func
def _shear(
    lattice: ti.template(), axis: ti.template(), b, i, k, reach_x, reach_y, p: ti.template()
):
    """Shear stress [Pa] at a pack of bonds, and F's column across them (Eqs 13, 23, 25).

    That column is the mean over the two sides, ahead and behind, that count. A side's value is the
    mean of the differences at the bond's two nodes. With Model.shear = "face" a side counts while
    both bonds that cross there are whole (Eq. 27); otherwise while its cell carries shear.
    """
    crossing, trial = ti.static(lattice.state.bonds[1 - axis], lattice.scratch.trial)
    x, y = trial[b, i, k].x, trial[b, i, k].y
    ahead_x, ahead_y, behind_x, behind_y = x, y, x, y
    ahead, behind = lanes.zeros(lattice), lanes.zeros(lattice)
    if ti.static(axis == A):
        right_x, right_y = trial[b, i + 1, k].x, trial[b, i + 1, k].y
        ahead_x = lanes.above(x, trial.x, b, i, k) - x
        ahead_x += lanes.above(right_x, trial.x, b, i + 1, k) - right_x
        ahead_y = lanes.above(y, trial.y, b, i, k) - y
        ahead_y += lanes.above(right_y, trial.y, b, i + 1, k) - right_y
        behind_x = x - lanes.below(x, trial.x, b, i, k)
        behind_x += right_x - lanes.below(right_x, trial.x, b, i + 1, k)
        behind_y = y - lanes.below(y, trial.y, b, i, k)
        behind_y += right_y - lanes.below(right_y, trial.y, b, i + 1, k)
        if ti.static(lattice.features.faces):
            near, far = crossing[b, i, k].condition, crossing[b, i + 1, k].condition
            both = (near > BROKEN) & (far > BROKEN)
            below = lanes.below(near, crossing.condition, b, i, k) > BROKEN
            below &= lanes.below(far, crossing.condition, b, i + 1, k) > BROKEN
            ahead, behind = ti.select(both, 1.0, 0.0), ti.select(below, 1.0, 0.0)
        else:
            grip = lattice.state.grip[b, i, k]
            ahead = ti.select(grip > 0.0, 1.0, 0.0)
            behind = ti.select(lanes.below(grip, lattice.state.grip, b, i, k) > 0.0, 1.0, 0.0)
    else:
        left_x, left_y = trial[b, i - 1, k].x, trial[b, i - 1, k].y
        right_x, right_y = trial[b, i + 1, k].x, trial[b, i + 1, k].y
        up_x, up_y = lanes.above(x, trial.x, b, i, k), lanes.above(y, trial.y, b, i, k)
        ahead_x = right_x - x + (lanes.above(right_x, trial.x, b, i + 1, k) - up_x)
        ahead_y = right_y - y + (lanes.above(right_y, trial.y, b, i + 1, k) - up_y)
        behind_x = x - left_x + (up_x - lanes.above(left_x, trial.x, b, i - 1, k))
        behind_y = y - left_y + (up_y - lanes.above(left_y, trial.y, b, i - 1, k))
        if ti.static(lattice.features.faces):
            near, near_left = crossing[b, i, k].condition, crossing[b, i - 1, k].condition
            both = near > BROKEN
            both &= lanes.above(near, crossing.condition, b, i, k) > BROKEN
            left = near_left > BROKEN
            left &= lanes.above(near_left, crossing.condition, b, i - 1, k) > BROKEN
            ahead, behind = ti.select(both, 1.0, 0.0), ti.select(left, 1.0, 0.0)
        else:
            ahead = ti.select(lattice.state.grip[b, i, k] > 0.0, 1.0, 0.0)
            behind = ti.select(lattice.state.grip[b, i - 1, k] > 0.0, 1.0, 0.0)
    # each side has two differences; a bond with none is a bare fibre (Fig. 20)
    weight = (0.5 / p.cell[1 - axis]) / elementary.larger(ahead + behind, 1.0)
    across_x = (ahead * ahead_x + behind * behind_x) * weight
    across_y = (ahead * ahead_y + behind * behind_y) * weight
    gamma = kinematics.shear_strain(reach_x, reach_y, across_x, across_y) * (1.0 / p.cell[axis])
    if ti.static(lattice.features.shear_yields):
        shear_set = ti.static(lattice.state.shear_set)
        lasts = shear_set[b, i, k]
        lasts_behind = lanes.below(lasts, shear_set, b, i, k)
        if ti.static(axis == B):
            lasts_behind = shear_set[b, i - 1, k]
        gamma -= (ahead * lasts + behind * lasts_behind) / elementary.larger(ahead + behind, 1.0)
    c = makeup.constants(lattice, axis, b, k, p)
    tau = lattice.law.shear_modulus(c) * gamma
    if ti.static(lattice.law.shears_stiffer):
        stretch = ti.sqrt(reach_x * reach_x + reach_y * reach_y) * (1.0 / p.cell[axis])
        rise, _ = lattice.law.shear_rise(c, kinematics.engineering_strain(stretch))
        tau += rise * gamma
    return tau, across_x, across_y


@ti.func
def bond_pack(lattice: ti.template(), stage, b, i, k, strip, sweep, slot, p: ti.template()):
    """Forces of a pack's bonds to the right and above, and of the cells between, kept in `slot`.

    Returns the strains of the bonds. Adds to the strip's tally the powers of shear and of the
    dashpots, and at the last stage the number of bonds that break.
    """
    trial, force = ti.static(lattice.scratch.trial, lattice.scratch.force)
    tally = ti.static(lattice.scratch.tally)
    x, y = trial[b, i, k].x, trial[b, i, k].y
    u, v = trial[b, i, k].u, trial[b, i, k].v
    right_x, right_y = trial[b, i + 1, k].x - x, trial[b, i + 1, k].y - y
    up_x, up_y = lanes.above(x, trial.x, b, i, k) - x, lanes.above(y, trial.y, b, i, k) - y
    right_squared, up_squared = right_x * right_x + right_y * right_y, up_x * up_x + up_y * up_y
    # roots take long, and all of a bond waits for its length: meanwhile the cells are computed
    right_length, up_length = ti.sqrt(right_squared), ti.sqrt(up_squared)
    damped = lanes.zeros(lattice)
    if ti.static(not lattice.features.faces):
        damped = cells.shear_pack(lattice, b, i, k, strip, sweep, slot, p)
    elif ti.static(lattice.features.cells):
        cells.clear_pack(lattice, sweep, slot, k)
    a_strain, force_x, force_y = _bond(
        lattice, A, stage, b, i, k, strip, right_x, right_y, right_squared, right_length,
        trial[b, i + 1, k].u - u, trial[b, i + 1, k].v - v, p,
    )  # fmt: skip
    force[sweep, slot, k].ax = force_x
    force[sweep, slot, k].ay = force_y
    b_strain, force_x, force_y = lanes.zeros(lattice), lanes.zeros(lattice), lanes.zeros(lattice)
    if lanes.reaches_up(lattice, k):
        b_strain, force_x, force_y = _bond(
            lattice, B, stage, b, i, k, strip, up_x, up_y, up_squared, up_length,
            lanes.above(u, trial.u, b, i, k) - u, lanes.above(v, trial.v, b, i, k) - v, p,
        )  # fmt: skip
        # after those of the bonds, which keeps the order of this sum
        if ti.static(not lattice.features.faces):
            tally[b, strip].damped = tally[b, strip].damped + damped
    force[sweep, slot, k].bx = force_x
    force[sweep, slot, k].by = force_y
    return a_strain, b_strain


@ti.func
def stiffen_pack(
    lattice: ti.template(), b, i, k, sweep, slot, a_strain, b_strain, p: ti.template()
):  # fmt: skip
    """Add stiffening to a pack's forces; returns the stiffness of its stiffest bond [N/m].

    Each axis is tested separately: foam is seldom packed along both, and exponentials are
    expensive.
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
    """Whether any of a pack's bonds may stiffen."""
    limit = lattice.law.stiffens_below(makeup.constants(lattice, axis, b, k, p))
    if ti.static(lattice.features.foams > 1):
        return elementary.any_of(strain < limit)
    return strain.min() < limit


@ti.func
def _stiffening(
    lattice: ti.template(), axis: ti.template(), b, i, k, reach_x, reach_y, p: ti.template()
):
    bond = lattice.state.bonds[axis][b, i, k]
    length = ti.sqrt(reach_x * reach_x + reach_y * reach_y)
    e = kinematics.engineering_strain(length * (1.0 / p.cell[axis]))
    stress, slope = lattice.law.stiffening(
        makeup.constants(lattice, axis, b, k, p), e, _remembered(lattice, axis, b, i, k),
        bond.condition <= BROKEN,
    )  # fmt: skip
    there = bond.condition > ABSENT
    face = makeup.face(lattice, axis, b, i, k, p)
    force = ti.select(there, face * stress / length, 0.0)
    stiffness = ti.select(there, slope * (face / p.cell[axis]), 0.0)
    return reach_x * force, reach_y * force, stiffness.max()


@ti.func
def bond_column(lattice: ti.template(), stage, b, i, strip, sweep, slot, p: ti.template()):
    """Forces of column `i`'s bonds and cells, kept in `slot`, and the sums that a step needs.

    Stiffening has a loop of its own: few packs need it, and in the main loop it would take
    registers from all other bonds.
    """
    strain = ti.static(lattice.scratch.strain)
    clear_bonds(lattice, b, strip)
    for k in range(lattice.counts[None].packs):
        a_strain, b_strain = bond_pack(lattice, stage, b, i, k, strip, sweep, slot, p)
        strain[sweep, k].a = a_strain
        strain[sweep, k].b = b_strain
    stiffest = 0.0
    if ti.static(lattice.law.stiffens):  # noqa: SIM102 - the static test must stand alone
        if _column_may_stiffen(lattice, b, strip, p):
            for k in range(lattice.counts[None].packs):
                stiff = stiffen_pack(
                    lattice, b, i, k, sweep, slot, strain[sweep, k].a,
                    strain[sweep, k].b, p,
                )  # fmt: skip
                stiffest = ti.max(stiffest, stiff)
    lattice.scratch.stiffest[b, strip] = stiffest
    if ti.static(lattice.features.crushed_room):  # noqa: SIM102 - the static test must stand alone
        if lattice.scratch.column_presses[b, i]:
            for k in range(lattice.counts[None].packs):
                if lattice.scratch.presses[b, i, k]:
                    cells.press_pack(lattice, b, i, k, strip, sweep, slot, p)
    if stage == LAST_STAGE:
        lattice.scratch.column_breaks[b, i] = ti.i32(lattice.scratch.tally[b, strip].breaks.sum())
        if ti.static(lattice.features.softens):
            softens = lattice.scratch.tally[b, strip].softens.sum()
            lattice.scratch.column_softens[b, i] = ti.i32(softens)


@ti.func
def _column_may_stiffen(lattice: ti.template(), b, strip, p: ti.template()):
    """Whether any bond of a strip may stiffen; with several foams, each pack decides for itself."""
    if ti.static(lattice.features.foams > 1):
        return 1
    return lattice.scratch.tally[b, strip].least.min() < lattice.law.stiffens_below(p.bond)


@ti.func
def flow_pack(lattice: ti.template(), b, i, k, p: ti.template()):
    """Let what a pack of bonds remembers change in time, or by their shear; called before a step.

    Within a step it does not: all stages see the shear at its start. A change for the duration of a
    step at the present strain takes it from the middle of the last step to the middle of the next:
    the error is of second order.
    """
    motion = ti.static(lattice.state.motion)
    x, y = motion[b, i, k].x, motion[b, i, k].y
    _flow(lattice, A, b, i, k, motion[b, i + 1, k].x - x, motion[b, i + 1, k].y - y, p)
    if lanes.reaches_up(lattice, k):
        _flow(
            lattice, B, b, i, k,
            lanes.above(x, motion.x, b, i, k) - x, lanes.above(y, motion.y, b, i, k) - y, p,
        )  # fmt: skip


@ti.func
def flow_column(lattice: ti.template(), b, i, p: ti.template()):
    for k in range(lattice.counts[None].packs):
        flow_pack(lattice, b, i, k, p)


@ti.func
def _flow(lattice: ti.template(), axis: ti.template(), b, i, k, reach_x, reach_y, p: ti.template()):
    bonds = ti.static(lattice.state.bonds[axis])
    length = ti.sqrt(reach_x * reach_x + reach_y * reach_y)
    e = kinematics.engineering_strain(length * (1.0 / p.cell[axis]))
    history = _remembered(lattice, axis, b, i, k)
    there = bonds[b, i, k].condition > ABSENT
    c = makeup.constants(lattice, axis, b, k, p)
    if ti.static(lattice.features.shear_yields):
        e = _yields_as_at(lattice, axis, b, i, k, e, p)
    if ti.static(lattice.law.heeds_rate):
        # powers are expensive, and few bonds flow
        if elementary.any_of(there & lattice.law.flows(c, e, history)):
            # if only half the strain rate counts, foam flows as in twice the time
            slowed = makeup.shares(lattice, axis, b, k, p).flow_share
            around = lanes.zeros(lattice)
            if ti.static(lattice.law.looks_around):
                around = ti.cast(lattice.scratch.around[axis][b, i, k], ti.f64)
            step = lattice.state.clock[b].step
            flowed = lattice.law.flowed(c, e, history, step, slowed, around)
            _remember(lattice, axis, b, i, k, there, flowed)
    else:
        _remember(lattice, axis, b, i, k, there, lattice.law.met(c, e, history))


@ti.func
def clear_bonds(lattice: ti.template(), b, strip):
    """Reset the tally of a strip's bonds."""
    tally = ti.static(lattice.scratch.tally)
    tally[b, strip].least = lanes.zeros(lattice)
    tally[b, strip].sheared = lanes.zeros(lattice)
    tally[b, strip].damped = lanes.zeros(lattice)
    tally[b, strip].pressed = lanes.zeros(lattice)
    tally[b, strip].breaks = lanes.zeros(lattice)
    if ti.static(lattice.features.softens):
        tally[b, strip].softens = lanes.zeros(lattice)


# The bonds of the accepted state: their condition, and the energy that they lose.


@ti.func
def _history(lattice: ti.template(), axis: ti.template(), b, i, j):
    """What bond (i, j) along `axis` remembers."""
    return lattice.law.History(
        *[
            lanes.value(lattice, member, b, i, j)
            for member in ti.static(lattice.state.remembered[axis])
        ]
    )


@ti.func
def look_at(lattice: ti.template(), axis, b, i, j, p: ti.template()):
    """Condition, history and present strain of the accepted state's bond (i, j) along `axis`.

    The axis need not be known at compile time.
    """
    bonds_a, bonds_b = ti.static(lattice.state.bonds)
    start = lanes.position(lattice, lattice.state.motion, b, i, j)
    condition = lanes.value(lattice, bonds_a.condition, b, i, j)
    history = _history(lattice, A, b, i, j)
    length = p.cell.x
    end = lanes.position(lattice, lattice.state.motion, b, i + 1, j)
    if axis == B:
        condition = lanes.value(lattice, bonds_b.condition, b, i, j)
        history = _history(lattice, B, b, i, j)
        length = p.cell.y
        end = lanes.position(lattice, lattice.state.motion, b, i, j + 1)
    strain = kinematics.engineering_strain((end - start).norm() / length)
    return condition, history, strain


@ti.func
def intact_share(lattice: ti.template(), axis, b, i, j) -> ti.f64:
    """Share of a bond's face that carries tension and shear."""
    share = 1.0
    if ti.static(lattice.features.softens):
        bonds_a, bonds_b = ti.static(lattice.state.bonds)
        share = ti.cast(lanes.value(lattice, bonds_a.intact, b, i, j), ti.f64)
        if axis == B:
            share = ti.cast(lanes.value(lattice, bonds_b.intact, b, i, j), ti.f64)
    return share


@ti.func
def is_pulled(lattice: ti.template(), c: ti.template(), strain, history: ti.template()) -> ti.i32:
    numerator, _ = lattice.law.stress_fraction(c, strain, history, 0)
    return ti.i32(numerator > 0.0)


@ti.func
def soften_bonds(lattice: ti.template(), b, i, p: ti.template()):
    """Reduce the intact shares of column `i`'s bonds at the end of a step, and book the energy."""
    lost = 0.0
    for j in range(lattice.counts[None].rows):
        lost = soften_at(lattice, b, i, j, lost, p)
    book(lattice, b, i, WORK.lost_by_bonds, lost)


@ti.func
def soften_at(lattice: ti.template(), b, i, j, lost: ti.f64, p: ti.template()) -> ti.f64:
    """Reduce the intact shares of a node's bonds; returns `lost` plus the energy lost [J]."""
    k, lane = lanes.pack_of(lattice, j), lanes.lane_of(lattice, j)
    total = lost
    for axis in range(2):  # not unrolled, so that the long law compiles once
        left, history, strain = look_at(lattice, axis, b, i, j, p)
        intact = intact_share(lattice, axis, b, i, j)
        if left > BROKEN and left < intact:
            c = makeup.constants_at(lattice, axis, b, j, p)
            if is_pulled(lattice, c, strain, history):
                stored = lattice.law.stored_energy(c, strain, history, 0)
                total += makeup.volume(lattice, axis, b, i, j, p) * (intact - left) * stored
            if axis == A:
                lattice.state.bond_a[b, i, k].intact[lane] = ti.cast(left, ti.f32)
            else:
                lattice.state.bond_b[b, i, k].intact[lane] = ti.cast(left, ti.f32)
    return total


@ti.func
def break_bonds(lattice: ti.template(), b, i, p: ti.template()):
    """Break column `i`'s failed bonds at the end of a step, and book the stored energy lost [J]."""
    time = ti.cast(lattice.state.clock[b].time, ti.f32)
    lost = 0.0
    for j in range(lattice.counts[None].rows):
        lost = break_at(lattice, b, i, j, time, lost, p)
    book(lattice, b, i, WORK.lost_by_bonds, lost)


@ti.func
def break_at(
    lattice: ti.template(), b, i, j, time: ti.f32, lost: ti.f64, p: ti.template()
) -> ti.f64:
    """Break a node's failed bonds; returns `lost` plus the energy lost [J]."""
    k, lane = lanes.pack_of(lattice, j), lanes.lane_of(lattice, j)
    total = lost
    for axis in range(2):
        condition, history, strain = look_at(lattice, axis, b, i, j, p)
        if condition == BREAKING:
            c = makeup.constants_at(lattice, axis, b, j, p)
            energy = lattice.law.energy_lost_by_breaking(c, strain, history)
            if ti.static(lattice.features.softens):  # noqa: SIM102 - the static test stands alone
                if is_pulled(lattice, c, strain, history):
                    energy *= intact_share(lattice, axis, b, i, j)
            total += makeup.volume(lattice, axis, b, i, j, p) * energy
            if axis == A:
                lattice.state.bond_a[b, i, k].condition[lane] = BROKEN
                lattice.state.bond_a[b, i, k].break_time[lane] = time
            else:
                lattice.state.bond_b[b, i, k].condition[lane] = BROKEN
                lattice.state.bond_b[b, i, k].break_time[lane] = time
    return total


@ti.func
def is_whole(lattice: ti.template(), axis: ti.template(), b, i, j) -> ti.i32:
    bonds = ti.static(lattice.state.bonds[axis])
    return ti.i32(lanes.value(lattice, bonds.condition, b, i, j) > BROKEN)


@ti.func
def is_surface(lattice: ti.template(), b, i, j) -> ti.i32:
    """Whether any of the node's four bonds is broken or absent."""
    return ti.i32(
        is_whole(lattice, A, b, i, j)
        + is_whole(lattice, A, b, i - 1, j)
        + is_whole(lattice, B, b, i, j)
        + is_whole(lattice, B, b, i, j - 1)
        < 4 * makeup.is_there(lattice, b, i, j)
    )


@ti.func
def is_torn(lattice: ti.template(), b, i, j) -> ti.i32:
    """Whether any of the node's bonds is broken."""
    return ti.i32(broken_faces(lattice, b, i, j) > 0.0)


@ti.func
def broken_faces(lattice: ti.template(), b, i, j) -> ti.f64:
    """Area of the faces of the node's broken bonds, over that of a whole face."""
    return (
        _broken_face(lattice, A, b, i, j)
        + _broken_face(lattice, A, b, i - 1, j)
        + _broken_face(lattice, B, b, i, j)
        + _broken_face(lattice, B, b, i, j - 1)
    )


@ti.func
def _broken_face(lattice: ti.template(), axis: ti.template(), b, i, j) -> ti.f64:
    is_broken = lanes.value(lattice, lattice.state.bonds[axis].condition, b, i, j) == BROKEN
    return ti.select(is_broken, makeup.face_share_at(lattice, axis, b, i, j), 0.0)
