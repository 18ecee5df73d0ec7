"""Cells: what four neighbouring nodes span; the shear that the foam in it carries, and its room.

A cell's shear strain is the product of F's two columns there, means over its opposite sides. With
the diagonals d1, from the first corner to the third, and d2, from the second to the fourth, that is
gamma = (d1^2 - d2^2) / (4 dX dY): a spring along each of them, so that forces keep momentum and
angular momentum, and are the gradient of V G gamma^2 / 2.

A bond's law knows its length only. Crushed bonds may fold, zigzag and turn inside out, and none of
them gets shorter by it: the foam between them would vanish. So a cell also resists being smaller
than its bonds have left it, whether they are whole or broken; see docs/model.md.

Cell (i, j) is the one to the right of and above node (i, j).
"""

from taichi_foam.backend import ti
from taichi_foam.engine import lanes, makeup
from taichi_foam.engine.grading import B
from taichi_foam.engine.state import ABSENT, BROKEN, LOST_BY_ROOM, LOST_BY_SHEAR, WHOLE, book
from taichi_foam.laws import elementary, kinematics

# A cell that cracks have pulled apart is none any more. It lets go by its longer diagonal, in
# cells (the root mean square of their two sides), and at once by its area, over that at rest.
HOLDS_TO = 2.0
FREE_FROM = 4.0
OPEN_AREA = 1.5

# Of its area at rest. A cell that would not press with so much less than it has is left out of the
# next step: to lose it in one, its sides would have to close at a fifth of the speed of sound.
NEAR = 0.05

vec2 = ti.types.vector(2, ti.f64)


@ti.func
def _diagonals_of(xs: ti.template(), ys: ti.template(), b, i, k):
    """From a pack's nodes to the far corners of their cells, and from the right to the upper.

    Of positions [m] or velocities [m/s]: the members of a motion along x and y.
    """
    x, y, right_x, right_y = xs[b, i, k], ys[b, i, k], xs[b, i + 1, k], ys[b, i + 1, k]
    up_x, up_y = lanes.above(x, xs, b, i, k), lanes.above(y, ys, b, i, k)
    far_x, far_y = lanes.above(right_x, xs, b, i + 1, k), lanes.above(right_y, ys, b, i + 1, k)
    return far_x - x, far_y - y, up_x - right_x, up_y - right_y


@ti.func
def _area(d1x, d1y, d2x, d2y, p: ti.template()):
    """Signed area between two diagonals over that at rest; below 0 inside out."""
    return (d1x * d2y - d1y * d2x) * (0.5 / (p.cell.x * p.cell.y))


@ti.func
def _shear_strain(d1x, d1y, d2x, d2y, p: ti.template()):
    """gamma = 2 E_12 of the cell's two columns (Eqs 12, 23), by its diagonals."""
    squares = (d1x * d1x + d1y * d1y) - (d2x * d2x + d2y * d2y)
    return squares * (0.25 / (p.cell.x * p.cell.y))


@ti.func
def _rise(lattice: ti.template(), b, i, k, d1x, d1y, d2x, d2y, p: ti.template()):
    """By what foam that hardens resists shear more, as its two columns are shortened [Pa].

    Of the first column, along x, and of the second; with each its slope over the column's length
    [Pa], and that length.
    """
    ax, ay = (d1x - d2x) * (0.5 / p.cell.x), (d1y - d2y) * (0.5 / p.cell.x)
    bx, by = (d1x + d2x) * (0.5 / p.cell.y), (d1y + d2y) * (0.5 / p.cell.y)
    a, b_length = ti.sqrt(ax * ax + ay * ay), ti.sqrt(bx * bx + by * by)
    c = makeup.constants(lattice, B, b, k, p)
    rise_a, slope_a = lattice.law.shear_rise(c, a - 1.0)
    rise_b, slope_b = lattice.law.shear_rise(c, b_length - 1.0)
    return rise_a, slope_a, a, rise_b, slope_b, b_length


@ti.func
def _tilt(along: ti.template(), b, i, k):
    """By what the right sides of a pack's cells lean off from the left ones, along an axis.

    Of positions [m] or velocities [m/s]: a member of a motion.
    """
    here, right = along[b, i, k], along[b, i + 1, k]
    rise = lanes.above(here, along, b, i, k) - here
    return lanes.above(right, along, b, i + 1, k) - right - rise


@ti.func
def _shear_energy(lattice: ti.template(), b, i, k, d1x, d1y, d2x, d2y, p: ti.template()):
    """Energy [J/m3] that the shear of a pack's cells of the accepted state stores."""
    gamma = _shear_strain(d1x, d1y, d2x, d2y, p)
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
def look_pack(lattice: ti.template(), b, i, k, lost: vec2, p: ti.template()):
    """Between two steps: let go of a pack's cells as they tear, and see whether any may press.

    What a cell holds only falls, and is frozen in a step, whose stages see one potential. The
    stored energies that it loses, of shear and of room [J], are added to `lost`, and come back.
    """
    bonds_a, bonds_b = ti.static(lattice.state.bond_a, lattice.state.bond_b)
    a, left = bonds_a[b, i, k].condition, bonds_b[b, i, k].condition
    above, right = lanes.above(a, bonds_a.condition, b, i, k), bonds_b[b, i + 1, k].condition
    there = (a > ABSENT) & (left > ABSENT) & (above > ABSENT) & (right > ABSENT)
    worn = there & ((a < WHOLE) | (above < WHOLE) | (left < WHOLE) | (right < WHOLE))
    crushed = worn
    if ti.static(lattice.features.crushed_room):
        room = _room_before(lattice, b, i, k)
        limit = lattice.law.keeps_room_below(makeup.constants(lattice, B, b, k, p))
        crushed = there & (room < limit)
    now_lost = lost
    near = 0
    if lanes.any_of(worn | crushed):
        d1x, d1y, d2x, d2y = _diagonals_of(lattice.state.motion.x, lattice.state.motion.y, b, i, k)
        area = _area(d1x, d1y, d2x, d2y, p)
        if ti.static(lattice.features.crushed_room):
            c = makeup.constants(lattice, B, b, k, p)
            stress = lattice.law.room_stress(c, area - NEAR, _room_before(lattice, b, i, k))
            near = lanes.any_of(crushed & (stress > 0.0))
        if lanes.any_of(worn):
            longer = elementary.larger(d1x * d1x + d1y * d1y, d2x * d2x + d2y * d2y)
            size = ti.sqrt(longer * (2.0 / (p.cell.x * p.cell.x + p.cell.y * p.cell.y)))
            left_over = (FREE_FROM - size) * (1.0 / (FREE_FROM - HOLDS_TO))
            left_over = ti.select(area > OPEN_AREA, 0.0, left_over)
            torn = worn & ((a == BROKEN) | (above == BROKEN) | (left == BROKEN) | (right == BROKEN))
            before = lattice.state.hold[b, i, k]
            hold = elementary.smaller(elementary.larger(left_over, 0.0), before)
            hold = ti.select(torn, hold, before)
            lattice.state.hold[b, i, k] = hold
            # it hangs together by one of its two sides along each axis
            along_x = ti.cast(elementary.larger(a, above), ti.f64)
            along_y = ti.cast(elementary.larger(left, right), ti.f64)
            share = makeup.cell_share(lattice, b, i, k)
            grip = ti.select(worn, share * hold * (along_x * along_y), lattice.state.grip[b, i, k])
            volume = p.cell.x * p.cell.y * p.thickness
            if ti.static(not lattice.features.faces):
                stored = _shear_energy(lattice, b, i, k, d1x, d1y, d2x, d2y, p)
                now_lost[0] += volume * ((lattice.state.grip[b, i, k] - grip) * stored).sum()
            lattice.state.grip[b, i, k] = grip
            if ti.static(lattice.features.crushed_room):  # noqa: SIM102 - the static test stands alone
                if lanes.any_of(hold < before):
                    energy = _room_energy(lattice, b, i, k, d1x, d1y, d2x, d2y, p)
                    now_lost[1] += volume * (share * (before - hold) * energy).sum()
    if ti.static(lattice.features.crushed_room):
        lattice.scratch.presses[b, i, k] = near
    return now_lost


@ti.func
def _room_before(lattice: ti.template(), b, i, k):
    """Room of a pack's cells by the strains that their bonds met before this step."""
    bonds_a, bonds_b = ti.static(lattice.state.bond_a, lattice.state.bond_b)
    along_x = bonds_a[b, i, k].worst
    along_x += lanes.above(along_x, bonds_a.worst, b, i, k)
    along_y = bonds_b[b, i, k].worst + bonds_b[b, i + 1, k].worst
    return (1.0 + 0.5 * along_x) * (1.0 + 0.5 * along_y)


@ti.func
def look_column(lattice: ti.template(), b, i, booked: ti.template(), p: ti.template()):
    """`look_pack` of a column; what its cells lose is `booked`.

    Of a state that has just been put it is not: what cells carry then follows from the state.
    """
    pressing, lost = 0, vec2(0.0)
    for k in range(lattice.counts[None].packs):
        lost = look_pack(lattice, b, i, k, lost, p)
        if ti.static(lattice.features.crushed_room):
            pressing |= lattice.scratch.presses[b, i, k]
    if ti.static(lattice.features.crushed_room):
        lattice.scratch.column_presses[b, i] = pressing
    if ti.static(booked):
        book_lost(lattice, b, i, lost)


@ti.func
def book_lost(lattice: ti.template(), b, strip, lost: vec2):
    """Add to a strip's books what its cells have lost, see `look_pack`."""
    book(lattice, b, strip, LOST_BY_SHEAR, lost[0])
    book(lattice, b, strip, LOST_BY_ROOM, lost[1])


@ti.func
def _most_crushed(worst, reach_x, reach_y, per_length):
    """The worst strain of a pack's bonds, now included."""
    length = ti.sqrt(reach_x * reach_x + reach_y * reach_y)
    return elementary.smaller(kinematics.engineering_strain(length * per_length), worst)


@ti.func
def _room(lattice: ti.template(), motion: ti.template(), b, i, k, p: ti.template()):
    """Area that the bonds of a pack's cells leave them, over that at rest.

    A strain that is met now counts, as for the bonds themselves: straight cells, whatever crushes
    them, have exactly the room that their bonds leave them.
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
    """Stored energy [J/m3] of a pack's cells of the accepted state that have less area than room.

    Of a hold of 1.
    """
    room = _room(lattice, lattice.state.motion, b, i, k, p)
    c = makeup.constants(lattice, B, b, k, p)
    return lattice.law.room_energy(c, _area(d1x, d1y, d2x, d2y, p), room)


@ti.func
def stored_pack(lattice: ti.template(), b, i, k, p: ti.template()) -> vec2:
    """Energies [J] that a pack's cells store in the accepted state: of shear, and of room."""
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
    """Forces [N] of a pack's cells by their shear at a stage, kept in `slot`, and their powers.

    On the second ends of the first and of the second diagonal; on the first ends act the opposite
    ones. All pull along the diagonals.
    """
    trial, tally = ti.static(lattice.scratch.trial, lattice.scratch.tally)
    d1x, d1y, d2x, d2y = _diagonals_of(trial.x, trial.y, b, i, k)
    d1u, d1v, d2u, d2v = _diagonals_of(trial.u, trial.v, b, i, k)
    # thickness times stress, halved, is a force over a diagonal's length
    half = lattice.state.grip[b, i, k] * (0.5 * p.thickness)
    closing = (d1x * d1u + d1y * d1v) - (d2x * d2u + d2y * d2v)
    gamma = _shear_strain(d1x, d1y, d2x, d2y, p)
    elastic = half * lattice.law.shear_modulus(makeup.constants(lattice, B, b, k, p)) * gamma
    viscosity = makeup.shares(lattice, B, b, k, p).shear_viscosity
    viscous = half * closing * (viscosity * (0.5 / (p.cell.x * p.cell.y)))
    tally[b, strip].sheared = tally[b, strip].sheared + elastic * closing
    tally[b, strip].damped = tally[b, strip].damped + viscous * closing
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


@ti.func
def _harden_pack(
    lattice: ti.template(), b, i, k, strip, sweep, slot, half, d1x, d1y, d2x, d2y, d1u, d1v, d2u,
    d2v, p: ti.template(),
):  # fmt: skip
    """Add to `slot` what foam that hardens does more against shear, and its power.

    A cell's columns are means over its sides. Rows of nodes that lean to and fro by turns leave
    them as they are, and bonds under pressure push that on; so the rise also resists the tilt of
    one side against the other. It is of the columns as they are: rise and slope are one potential.
    """
    pushes, tally = ti.static(lattice.scratch.cell_push, lattice.scratch.tally)
    rise_a, slope_a, a, rise_b, slope_b, b_length = _rise(lattice, b, i, k, d1x, d1y, d2x, d2y, p)
    gamma = _shear_strain(d1x, d1y, d2x, d2y, p)
    trial = ti.static(lattice.scratch.trial)
    tilt_x, tilt_y = _tilt(trial.x, b, i, k), _tilt(trial.y, b, i, k)
    tilt_u, tilt_v = _tilt(trial.u, b, i, k), _tilt(trial.v, b, i, k)
    per_a, per_b = 1.0 / (p.cell.x * p.cell.x), 1.0 / (p.cell.y * p.cell.y)
    squared = 0.25 * (tilt_x * tilt_x + tilt_y * tilt_y)
    volume = half * (2.0 * p.cell.x * p.cell.y)
    # along the diagonals: of gamma, and of the columns' lengths
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
    """A pack whose cells carry no shear."""
    pushes = ti.static(lattice.scratch.cell_push)
    pushes[sweep, slot, k].x1 = lanes.zeros(lattice)
    pushes[sweep, slot, k].y1 = lanes.zeros(lattice)
    pushes[sweep, slot, k].x2 = lanes.zeros(lattice)
    pushes[sweep, slot, k].y2 = lanes.zeros(lattice)


@ti.func
def press_pack(lattice: ti.template(), b, i, k, strip, sweep, slot, p: ti.template()):
    """Add to `slot` the forces [N] by which a pack's cells keep their room, and their power.

    Thickness times pressure times the gradient of the area pushes the ends of a diagonal apart, at
    right angles to the other one.
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
    """Force [N] on a pack of nodes of the cells in `slot`: of the column to the right, or left."""
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
