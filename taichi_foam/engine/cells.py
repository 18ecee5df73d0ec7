"""Cells, each spanned by four neighbouring nodes: the shear that their foam carries, and its room.

A cell's shear strain is the dot product of F's two columns in the cell, each a mean over opposite
sides. With the diagonals d1, from the first corner to the third, and d2, from the second to the
fourth, it is gamma = (d1^2 - d2^2) / (4 dX dY). The forces act along the diagonals, so they
conserve momentum and angular momentum, and they are the gradient of V G gamma^2 / 2.

A bond's law depends on its length only. Crushed bonds may fold, zigzag and turn inside out without
getting shorter: the foam between them would vanish. So a cell also resists having less area than
its bonds have left it (its room), whether they are whole or broken; see docs/model.md.

Cell (i, j) is the one to the right of and above node (i, j).
"""

from taichi_foam.backend import ti
from taichi_foam.engine import lanes, makeup
from taichi_foam.engine.grading import A, B
from taichi_foam.engine.state import ABSENT, BROKEN, WHOLE, WORK, book
from taichi_foam.laws import elementary, kinematics

# A cell that cracks have pulled apart carries nothing. Its hold falls from 1 to 0 as its longer
# diagonal grows from HOLDS_TO to FREE_FROM cells (the root mean square of a cell's two sides), and
# at once to 0 when its area exceeds OPEN_AREA times that at rest.
HOLDS_TO = 2.0
FREE_FROM = 4.0
OPEN_AREA = 1.5

# Fraction of a cell's area at rest. A cell that would not press with this much less area is left
# out of the next step: to lose as much in one step, its sides would have to close at a fifth of the
# speed of sound.
NEAR = 0.05

vec2 = ti.types.vector(2, ti.f64)
Losses = vec2  # of stored energies [J]: of shear, of room


@ti.func
def _diagonals_of(xs: ti.template(), ys: ti.template(), b, i, k):
    """Diagonals of a pack's cells: from node to far corner, and from right corner to upper corner.

    `xs` and `ys` are a motion's positions [m], or its velocities [m/s].
    """
    x, y, right_x, right_y = xs[b, i, k], ys[b, i, k], xs[b, i + 1, k], ys[b, i + 1, k]
    up_x, up_y = lanes.above(x, xs, b, i, k), lanes.above(y, ys, b, i, k)
    far_x, far_y = lanes.above(right_x, xs, b, i + 1, k), lanes.above(right_y, ys, b, i + 1, k)
    return far_x - x, far_y - y, up_x - right_x, up_y - right_y


@ti.func
def _area(d1x, d1y, d2x, d2y, p: ti.template()):
    """Signed area spanned by two diagonals over that at rest; below 0 if inside out."""
    return (d1x * d2y - d1y * d2x) * (0.5 / (p.cell.x * p.cell.y))


@ti.func
def _shear_strain(d1x, d1y, d2x, d2y, p: ti.template()):
    """gamma = 2 E_12 of the cell's two columns (Eqs 12, 23), from its diagonals."""
    squares = (d1x * d1x + d1y * d1y) - (d2x * d2x + d2y * d2y)
    return squares * (0.25 / (p.cell.x * p.cell.y))


@ti.func
def _elastic_shear(lattice: ti.template(), b, i, k, gamma):
    """The part of a pack's cells' shear strain that does not last."""
    elastic = gamma
    if ti.static(lattice.features.shear_yields):
        elastic -= lattice.state.shear_set[b, i, k]
    return elastic


@ti.func
def _squares_of_columns(d1x, d1y, d2x, d2y, p: ti.template()):
    """Squares of the lengths of F's two columns in a pack's cells, from their diagonals."""
    ax, ay, bx, by = d1x - d2x, d1y - d2y, d1x + d2x, d1y + d2y
    per_x, per_y = 0.25 / (p.cell.x * p.cell.x), 0.25 / (p.cell.y * p.cell.y)
    return (ax * ax + ay * ay) * per_x, (bx * bx + by * by) * per_y


@ti.func
def _rise(lattice: ti.template(), b, i, k, d1x, d1y, d2x, d2y, p: ti.template()):
    """Rise in the shear modulus of hardening foam [Pa] as each of F's two columns is shortened.

    For the first column, along x, and for the second: the rise, its slope over the column's length
    [Pa], and that length.
    """
    a2, b2 = _squares_of_columns(d1x, d1y, d2x, d2y, p)
    a, b_length = ti.sqrt(a2), ti.sqrt(b2)
    c = makeup.constants(lattice, B, b, k, p)
    rise_a, slope_a = lattice.law.shear_rise(c, a - 1.0)
    rise_b, slope_b = lattice.law.shear_rise(c, b_length - 1.0)
    return rise_a, slope_a, a, rise_b, slope_b, b_length


@ti.func
def _tilt(along: ti.template(), b, i, k):
    """Difference between the right and the left sides of a pack's cells, as vectors, along an axis.

    `along` is a motion's position [m] or velocity [m/s] along that axis.
    """
    here, right = along[b, i, k], along[b, i + 1, k]
    rise = lanes.above(here, along, b, i, k) - here
    return lanes.above(right, along, b, i + 1, k) - right - rise


@ti.func
def _shear_energy(lattice: ti.template(), b, i, k, d1x, d1y, d2x, d2y, p: ti.template()):
    """Shear energy [J/m3] stored in a pack's cells in the accepted state."""
    gamma = _elastic_shear(lattice, b, i, k, _shear_strain(d1x, d1y, d2x, d2y, p))
    modulus = lattice.law.shear_modulus(makeup.constants(lattice, B, b, k, p))
    energy = 0.5 * modulus * gamma * gamma
    if ti.static(lattice.law.shears_stiffer):
        rise_a, _, _, rise_b, _, _ = _rise(lattice, b, i, k, d1x, d1y, d2x, d2y, p)
        motion = ti.static(lattice.state.motion)
        tilt_x, tilt_y = _tilt(motion.x, b, i, k), _tilt(motion.y, b, i, k)
        tilt = 0.25 * (tilt_x * tilt_x + tilt_y * tilt_y)
        energy += 0.5 * rise_a * (gamma * gamma + tilt / (p.cell.x * p.cell.x))
        energy += 0.5 * rise_b * (gamma * gamma + tilt / (p.cell.y * p.cell.y))
    return energy


@ti.func
def look_pack(
    lattice: ti.template(), b, i, k, lost: Losses, booked: ti.template(), p: ti.template()
):  # fmt: skip
    """Update a pack's cells between two steps; `booked` as in `look_column`.

    Returns `lost` plus the stored energies lost, of shear and of room [J].
    """
    now_lost = lost
    if lanes.reaches_up(lattice, k):
        d1x, d1y, d2x, d2y = _diagonals_of(lattice.state.motion.x, lattice.state.motion.y, b, i, k)
        if ti.static(lattice.features.shear_yields):
            _yield_pack(lattice, b, i, k, d1x, d1y, d2x, d2y, booked, p)
        now_lost = _hold_pack(lattice, b, i, k, d1x, d1y, d2x, d2y, lost, p)
        if ti.static(lattice.features.shear_yields):
            _note_shear(lattice, b, i, k, d1x, d1y, d2x, d2y, p)
    else:
        # a higher lattice may have had cells here
        if ti.static(lattice.features.crushed_room):
            lattice.scratch.presses[b, i, k] = 0
        if ti.static(lattice.features.shear_yields):
            lattice.scratch.excess_shear[b, i, k] = ti.cast(lanes.zeros(lattice), ti.f32)
    if ti.static(lattice.law.looks_around):
        _look_around(lattice, b, i, k)
    return now_lost


@ti.func
def _hold_pack(
    lattice: ti.template(), b, i, k, d1x, d1y, d2x, d2y, lost: Losses, p: ti.template()
):  # fmt: skip
    """Update what a pack's cells hold, and find whether any may press.

    A cell's hold only falls, and is frozen during a step, so that all stages see one potential.
    Returns `lost` plus the stored energies lost, of shear and of room [J].
    """
    bonds_a, bonds_b = ti.static(lattice.state.bond_a, lattice.state.bond_b)
    a, left = bonds_a[b, i, k].condition, bonds_b[b, i, k].condition
    above, right = lanes.above(a, bonds_a.condition, b, i, k), bonds_b[b, i + 1, k].condition
    there = (a > ABSENT) & (left > ABSENT) & (above > ABSENT) & (right > ABSENT)
    worn = there & ((a < WHOLE) | (above < WHOLE) | (left < WHOLE) | (right < WHOLE))
    crushed = worn
    area = _area(d1x, d1y, d2x, d2y, p)
    if ti.static(lattice.features.crushed_room):
        limit = lattice.law.keeps_room_below(makeup.constants(lattice, B, b, k, p))
        crushed = there & (area - NEAR < limit)
    now_lost = lost
    near = 0
    if elementary.any_of(worn | crushed):
        if ti.static(lattice.features.crushed_room):
            c = makeup.constants(lattice, B, b, k, p)
            stress = lattice.law.room_stress(c, area - NEAR, _room_before(lattice, b, i, k))
            near = elementary.any_of(crushed & (stress > 0.0))
        if elementary.any_of(worn):
            longer = elementary.larger(d1x * d1x + d1y * d1y, d2x * d2x + d2y * d2y)
            size = ti.sqrt(longer * (2.0 / (p.cell.x * p.cell.x + p.cell.y * p.cell.y)))
            left_over = (FREE_FROM - size) * (1.0 / (FREE_FROM - HOLDS_TO))
            left_over = ti.select(area > OPEN_AREA, 0.0, left_over)
            torn = worn & ((a == BROKEN) | (above == BROKEN) | (left == BROKEN) | (right == BROKEN))
            before = lattice.state.hold[b, i, k]
            hold = elementary.smaller(elementary.larger(left_over, 0.0), before)
            hold = ti.cast(ti.select(torn, hold, before), ti.f32)
            lattice.state.hold[b, i, k] = hold
            # along each axis, the better of its two sides holds the cell together
            along_x = ti.cast(elementary.larger(a, above), ti.f64)
            along_y = ti.cast(elementary.larger(left, right), ti.f64)
            share = makeup.cell_share(lattice, b, i, k)
            held = lattice.state.grip[b, i, k]
            grip = ti.select(worn, share * hold * (along_x * along_y), held)
            volume = p.cell.x * p.cell.y * p.thickness
            if ti.static(not lattice.features.faces):
                stored = _shear_energy(lattice, b, i, k, d1x, d1y, d2x, d2y, p)
                now_lost[0] += volume * ((held - grip) * stored).sum()
            lattice.state.grip[b, i, k] = grip
            if ti.static(lattice.features.crushed_room):  # noqa: SIM102 - the static test stands alone
                if elementary.any_of(hold < before):
                    energy = _room_energy(lattice, b, i, k, d1x, d1y, d2x, d2y, p)
                    now_lost[1] += volume * (share * (before - hold) * energy).sum()
    if ti.static(lattice.features.crushed_room):
        lattice.scratch.presses[b, i, k] = near
    return now_lost


@ti.func
def _yield_pack(
    lattice: ti.template(), b, i, k, d1x, d1y, d2x, d2y, booked: ti.template(), p: ti.template()
):  # fmt: skip
    """Let a pack's cells yield in shear as their bonds were crushed in this step.

    docs/model.md, Yield in shear, has the flow rule. The crush along an axis is the mean of two
    sides. The implicit step takes between nothing and all of the elastic strain, so it only
    dissipates. A cell between two layers is of the lower one.
    """
    bonds_a, bonds_b = ti.static(lattice.state.bond_a, lattice.state.bond_b)
    c_a, c_b = makeup.constants(lattice, A, b, k, p), makeup.constants(lattice, B, b, k, p)
    worst_a, worst_b = bonds_a[b, i, k].worst, bonds_b[b, i, k].worst
    above, right = lanes.above(worst_a, bonds_a.worst, b, i, k), bonds_b[b, i + 1, k].worst
    crush_a = lattice.law.lasting_crush(c_a, worst_a) + lattice.law.lasting_crush(c_a, above)
    crush_b = lattice.law.lasting_crush(c_b, worst_b) + lattice.law.lasting_crush(c_b, right)
    now_a, now_b = ti.cast(0.5 * crush_a, ti.f32), ti.cast(0.5 * crush_b, ti.f32)
    if ti.static(booked):
        grown_a = ti.cast(now_a - lattice.scratch.crush[A][b, i, k], ti.f64)
        grown_b = ti.cast(now_b - lattice.scratch.crush[B][b, i, k], ti.f64)
        if elementary.any_of((grown_a > 0.0) | (grown_b > 0.0)):
            gamma = _shear_strain(d1x, d1y, d2x, d2y, p)
            a2, b2 = _squares_of_columns(d1x, d1y, d2x, d2y, p)
            modulus = lattice.law.shear_modulus(c_b)
            times = (2.0 * modulus) * (
                b2 * grown_a / lattice.law.plateau_stress(c_a)
                + a2 * grown_b / lattice.law.plateau_stress(c_b)
            )
            tilts = 2.0 * (grown_a / ti.sqrt(a2) + grown_b / ti.sqrt(b2))
            elastic = _elastic_shear(lattice, b, i, k, gamma)
            more = (times * elastic - tilts * gamma) / (1.0 + times)
            least, most = elementary.smaller(elastic, 0.0), elementary.larger(elastic, 0.0)
            more = elementary.smaller(elementary.larger(more, least), most)
            holds = lattice.state.grip[b, i, k] > 0.0
            lasts = lattice.state.shear_set[b, i, k] + ti.select(holds, more, 0.0)
            lattice.state.shear_set[b, i, k] = ti.cast(lasts, ti.f32)
    lattice.scratch.crush[A][b, i, k] = now_a
    lattice.scratch.crush[B][b, i, k] = now_b


@ti.func
def _note_shear(lattice: ti.template(), b, i, k, d1x, d1y, d2x, d2y, p: ti.template()):
    """Note the shear stress beyond balance, by which the bonds of a pack's cells yield sooner.

    Between none and that of its more crushed column in balance, a cell has none.
    """
    gamma = _shear_strain(d1x, d1y, d2x, d2y, p)
    a2, b2 = _squares_of_columns(d1x, d1y, d2x, d2y, p)
    c_a, c_b = makeup.constants(lattice, A, b, k, p), makeup.constants(lattice, B, b, k, p)
    stress_a, stress_b = lattice.law.plateau_stress(c_a), lattice.law.plateau_stress(c_b)
    along = ti.select(a2 < b2, stress_a, stress_b) * ti.abs(gamma)
    shorter, longer = elementary.smaller(a2, b2), elementary.larger(a2, b2)
    balance = along / (longer * ti.sqrt(shorter))
    tau = lattice.law.shear_modulus(c_b) * _elastic_shear(lattice, b, i, k, gamma)
    with_gamma = ti.select(gamma < 0.0, -tau, tau)
    beyond = elementary.larger(elementary.larger(with_gamma - balance, -with_gamma), 0.0)
    holds = lattice.state.grip[b, i, k] > 0.0
    lattice.scratch.excess_shear[b, i, k] = ti.cast(ti.select(holds, beyond, 0.0), ti.f32)


@ti.func
def _look_around(lattice: ti.template(), b, i, k):
    """Find for a pack of bonds the worst strain of the bonds around each, between two steps.

    It is kept for the flow before the next step, which changes worst strains in any order.
    """
    for axis in ti.static((A, B)):
        bonds = ti.static(lattice.state.bonds[axis])
        here = bonds[b, i, k].worst
        along = elementary.smaller(bonds[b, i - 1, k].worst, bonds[b, i + 1, k].worst)
        up = elementary.smaller(
            lanes.above(here, bonds.worst, b, i, k), lanes.below(here, bonds.worst, b, i, k)
        )
        found = elementary.smaller(along, up)
        lattice.scratch.around[axis][b, i, k] = ti.cast(found, ti.f32)


@ti.func
def _room_before(lattice: ti.template(), b, i, k):
    """Room of a pack's cells from the worst strains that their bonds reached before this step."""
    bonds_a, bonds_b = ti.static(lattice.state.bond_a, lattice.state.bond_b)
    along_x = bonds_a[b, i, k].worst
    along_x += lanes.above(along_x, bonds_a.worst, b, i, k)
    along_y = bonds_b[b, i, k].worst + bonds_b[b, i + 1, k].worst
    return (1.0 + 0.5 * along_x) * (1.0 + 0.5 * along_y)


@ti.func
def look_column(lattice: ti.template(), b, i, booked: ti.template(), p: ti.template()):
    """`look_pack` for a column; `booked`: at the end of a step, in which cells may also yield.

    A state that has just been put is only looked at: its cells have lost nothing since.
    """
    pressing, lost = 0, Losses(0.0)
    for k in range(lattice.counts[None].packs):
        lost = look_pack(lattice, b, i, k, lost, booked, p)
        if ti.static(lattice.features.crushed_room):
            pressing |= lattice.scratch.presses[b, i, k]
    if ti.static(lattice.features.crushed_room):
        lattice.scratch.column_presses[b, i] = pressing
    if ti.static(booked):
        book_lost(lattice, b, i, lost)


@ti.func
def book_lost(lattice: ti.template(), b, strip, lost: Losses):
    """Book the energies that a strip's cells have lost, see `look_pack`."""
    book(lattice, b, strip, WORK.lost_by_shear, lost[0])
    book(lattice, b, strip, WORK.lost_by_room, lost[1])


@ti.func
def _most_crushed(worst, reach_x, reach_y, per_length):
    """The worst strain of a pack's bonds, including the present one."""
    length = ti.sqrt(reach_x * reach_x + reach_y * reach_y)
    return elementary.smaller(kinematics.engineering_strain(length * per_length), worst)


@ti.func
def _room(lattice: ti.template(), motion: ti.template(), b, i, k, p: ti.template()):
    """Area that their bonds leave to a pack's cells, over that at rest.

    The present strain counts, as for the bonds themselves: rectangular cells, however crushed, have
    exactly the area that their bonds leave them.
    """
    bonds_a, bonds_b = ti.static(lattice.state.bond_a, lattice.state.bond_b)
    x, y = motion[b, i, k].x, motion[b, i, k].y
    right_x, right_y = motion[b, i + 1, k].x, motion[b, i + 1, k].y
    up_x, up_y = lanes.above(x, motion.x, b, i, k), lanes.above(y, motion.y, b, i, k)
    far_x = lanes.above(right_x, motion.x, b, i + 1, k)
    far_y = lanes.above(right_y, motion.y, b, i + 1, k)
    per_x, per_y = 1.0 / p.cell.x, 1.0 / p.cell.y
    worst_a, worst_b = bonds_a[b, i, k].worst, bonds_b[b, i, k].worst
    above = lanes.above(worst_a, bonds_a.worst, b, i, k)
    right = bonds_b[b, i + 1, k].worst
    along_x = _most_crushed(worst_a, right_x - x, right_y - y, per_x)
    along_x += _most_crushed(above, far_x - up_x, far_y - up_y, per_x)
    along_y = _most_crushed(worst_b, up_x - x, up_y - y, per_y)
    along_y += _most_crushed(right, far_x - right_x, far_y - right_y, per_y)
    return (1.0 + 0.5 * along_x) * (1.0 + 0.5 * along_y)


@ti.func
def _room_energy(lattice: ti.template(), b, i, k, d1x, d1y, d2x, d2y, p: ti.template()):
    """Energy [J/m3] that a pack's cells with less area than room store in the accepted state.

    It is that of a hold of 1.
    """
    room = _room(lattice, lattice.state.motion, b, i, k, p)
    c = makeup.constants(lattice, B, b, k, p)
    return lattice.law.room_energy(c, _area(d1x, d1y, d2x, d2y, p), room)


@ti.func
def stored_pack(lattice: ti.template(), b, i, k, p: ti.template()) -> vec2:
    """Energies [J] stored by a pack's cells in the accepted state: of shear, and of room."""
    d1x, d1y, d2x, d2y = _diagonals_of(lattice.state.motion.x, lattice.state.motion.y, b, i, k)
    volume = p.cell.x * p.cell.y * p.thickness
    found = vec2(0.0)
    if ti.static(not lattice.features.faces):
        stored = _shear_energy(lattice, b, i, k, d1x, d1y, d2x, d2y, p)
        found[0] = volume * (lattice.state.grip[b, i, k] * stored).sum()
    if ti.static(lattice.features.crushed_room):  # noqa: SIM102 - the static test stands alone
        if lattice.scratch.presses[b, i, k]:
            held = makeup.cell_share(lattice, b, i, k) * lattice.state.hold[b, i, k]
            energy = _room_energy(lattice, b, i, k, d1x, d1y, d2x, d2y, p)
            found[1] = volume * (held * energy).sum()
    return found


@ti.func
def shear_pack(lattice: ti.template(), b, i, k, strip, sweep, slot, p: ti.template()):
    """Shear forces [N] of a pack's cells at a stage, kept in `slot`; tallies the power of shear.

    The forces are those on the second ends of both diagonals; the opposite forces act on the first
    ends. All act along the diagonals. Returns the power of the cells' dashpots [W].
    """
    trial, tally = ti.static(lattice.scratch.trial, lattice.scratch.tally)
    d1x, d1y, d2x, d2y = _diagonals_of(trial.x, trial.y, b, i, k)
    d1u, d1v, d2u, d2v = _diagonals_of(trial.u, trial.v, b, i, k)
    # half of thickness times stress is force over diagonal length
    half = lattice.state.grip[b, i, k] * (0.5 * p.thickness)
    closing = (d1x * d1u + d1y * d1v) - (d2x * d2u + d2y * d2v)
    gamma = _elastic_shear(lattice, b, i, k, _shear_strain(d1x, d1y, d2x, d2y, p))
    elastic = half * lattice.law.shear_modulus(makeup.constants(lattice, B, b, k, p)) * gamma
    viscosity = makeup.shares(lattice, B, b, k, p).shear_viscosity
    viscous = half * closing * (viscosity * (0.5 / (p.cell.x * p.cell.y)))
    tally[b, strip].sheared = tally[b, strip].sheared + elastic * closing
    pull = elastic + viscous
    pushes = ti.static(lattice.scratch.cell_push)
    pushes[sweep, slot, k].x1 = -pull * d1x
    pushes[sweep, slot, k].y1 = -pull * d1y
    pushes[sweep, slot, k].x2 = pull * d2x
    pushes[sweep, slot, k].y2 = pull * d2y
    if ti.static(lattice.law.shears_stiffer):
        _harden_pack(
            lattice, b, i, k, strip, sweep, slot, half, d1x, d1y, d2x, d2y, d1u, d1v, d2u, d2v, p
        )
    return viscous * closing


@ti.func
def _harden_pack(
    lattice: ti.template(), b, i, k, strip, sweep, slot, half, d1x, d1y, d2x, d2y, d1u, d1v, d2u,
    d2v, p: ti.template(),
):  # fmt: skip
    """Add to `slot` the additional shear forces of hardening foam, and their power.

    A cell's columns are means over its sides. Rows of nodes that shift alternately left and right
    do not change them, and bonds in compression promote this mode; so the rise also resists the
    tilt of one side against the other. The rise depends on the present columns: rise and slope
    derive from one potential.
    """
    pushes, tally = ti.static(lattice.scratch.cell_push, lattice.scratch.tally)
    rise_a, slope_a, a, rise_b, slope_b, b_length = _rise(lattice, b, i, k, d1x, d1y, d2x, d2y, p)
    gamma = _elastic_shear(lattice, b, i, k, _shear_strain(d1x, d1y, d2x, d2y, p))
    trial = ti.static(lattice.scratch.trial)
    tilt_x, tilt_y = _tilt(trial.x, b, i, k), _tilt(trial.y, b, i, k)
    tilt_u, tilt_v = _tilt(trial.u, b, i, k), _tilt(trial.v, b, i, k)
    per_a, per_b = 1.0 / (p.cell.x * p.cell.x), 1.0 / (p.cell.y * p.cell.y)
    squared = 0.25 * (tilt_x * tilt_x + tilt_y * tilt_y)
    volume = half * (2.0 * p.cell.x * p.cell.y)
    # forces along the diagonals: from gamma, and from the columns' lengths
    pull = half * (rise_a + rise_b) * gamma
    along_a = volume * slope_a * (0.5 * (gamma * gamma + squared * per_a)) * (0.25 * per_a / a)
    along_b = (
        volume * slope_b * (0.5 * (gamma * gamma + squared * per_b)) * (0.25 * per_b / b_length)
    )
    less, more = along_b - along_a, along_b + along_a
    x1, y1 = -pull * d1x - (more * d1x + less * d2x), -pull * d1y - (more * d1y + less * d2y)
    x2, y2 = pull * d2x - (less * d1x + more * d2x), pull * d2y - (less * d1y + more * d2y)
    lean = -0.25 * volume * (rise_a * per_a + rise_b * per_b)
    given = (x1 * d1u + y1 * d1v) + (x2 * d2u + y2 * d2v)
    given += lean * (tilt_x * tilt_u + tilt_y * tilt_v)
    tally[b, strip].sheared = tally[b, strip].sheared - given
    pushes[sweep, slot, k].x1 = pushes[sweep, slot, k].x1 + x1
    pushes[sweep, slot, k].y1 = pushes[sweep, slot, k].y1 + y1
    pushes[sweep, slot, k].x2 = pushes[sweep, slot, k].x2 + x2
    pushes[sweep, slot, k].y2 = pushes[sweep, slot, k].y2 + y2
    pushes[sweep, slot, k].lean_x = lean * tilt_x
    pushes[sweep, slot, k].lean_y = lean * tilt_y


@ti.func
def clear_pack(lattice: ti.template(), sweep, slot, k):
    """Zero the forces of a pack whose cells carry no shear."""
    pushes = ti.static(lattice.scratch.cell_push)
    pushes[sweep, slot, k].x1 = lanes.zeros(lattice)
    pushes[sweep, slot, k].y1 = lanes.zeros(lattice)
    pushes[sweep, slot, k].x2 = lanes.zeros(lattice)
    pushes[sweep, slot, k].y2 = lanes.zeros(lattice)


@ti.func
def press_pack(lattice: ti.template(), b, i, k, strip, sweep, slot, p: ti.template()):
    """Add to `slot` the forces [N] by which a pack's cells keep their room, and their power.

    The forces are thickness times pressure times the gradient of the area: they push the ends of
    each diagonal apart, at right angles to the other diagonal.
    """
    trial, tally = ti.static(lattice.scratch.trial, lattice.scratch.tally)
    d1x, d1y, d2x, d2y = _diagonals_of(trial.x, trial.y, b, i, k)
    d1u, d1v, d2u, d2v = _diagonals_of(trial.u, trial.v, b, i, k)
    stress = lattice.law.room_stress(
        makeup.constants(lattice, B, b, k, p), _area(d1x, d1y, d2x, d2y, p),
        _room(lattice, trial, b, i, k, p),
    )  # fmt: skip
    held = makeup.cell_share(lattice, b, i, k) * lattice.state.hold[b, i, k]
    half = (0.5 * p.thickness) * held * stress
    given = half * ((d2y * d1u - d2x * d1v) + (d1x * d2v - d1y * d2u))
    tally[b, strip].pressed = tally[b, strip].pressed - given
    pushes = ti.static(lattice.scratch.cell_push)
    pushes[sweep, slot, k].x1 = pushes[sweep, slot, k].x1 + half * d2y
    pushes[sweep, slot, k].y1 = pushes[sweep, slot, k].y1 - half * d2x
    pushes[sweep, slot, k].x2 = pushes[sweep, slot, k].x2 - half * d1y
    pushes[sweep, slot, k].y2 = pushes[sweep, slot, k].y2 + half * d1x


@ti.func
def pushed_by(lattice: ti.template(), from_left: ti.template(), k, sweep, slot):
    """Force [N] on a pack of nodes from the cells in `slot`, to their right or to their left."""
    last = ti.static(lattice.lanes - 1)
    here, below = (
        lattice.scratch.cell_push[sweep, slot, k],
        lattice.scratch.cell_push[sweep, slot, k - 1],
    )
    x = lanes.from_below(here.x2, below.x2[last]) - here.x1
    y = lanes.from_below(here.y2, below.y2[last]) - here.y1
    if ti.static(from_left):
        x = lanes.from_below(here.x1, below.x1[last]) - here.x2
        y = lanes.from_below(here.y1, below.y1[last]) - here.y2
    if ti.static(lattice.law.shears_stiffer and not lattice.features.faces):
        lean_x = here.lean_x - lanes.from_below(here.lean_x, below.lean_x[last])
        lean_y = here.lean_y - lanes.from_below(here.lean_y, below.lean_y[last])
        if ti.static(from_left):
            x -= lean_x
            y -= lean_y
        else:
            x += lean_x
            y += lean_y
    return x, y
