"""Cells: what four neighbouring nodes span, and the room in it that crushed foam keeps.

A bond's law knows its length only. Crushed bonds may fold, zigzag and turn inside out, and none of
them gets shorter by it: the foam between them would vanish. So a cell resists being smaller than
its bonds have left it, whether they are whole or broken; see docs/model.md.

Cell (i, j) is the one to the right of and above node (i, j).
"""

import taichi as ti

from taichi_foam.engine import lanes, makeup
from taichi_foam.engine.grading import B
from taichi_foam.engine.lattice import LAST_STAGE
from taichi_foam.engine.state import ABSENT, BROKEN
from taichi_foam.laws import elementary, kinematics

# A cell that cracks have pulled apart is none any more. It lets go by its longer diagonal, in
# cells (the root mean square of their two sides), and at once by its area, over that at rest.
HOLDS_TO = 2.0
FREE_FROM = 4.0
OPEN_AREA = 1.5

# It no longer tells the strain of the bonds beside it, once so much of its hold is left.
COUNTS_ABOVE = 0.5

# Of its area at rest. A cell that would not press with so much less than it has is left out of the
# next step: to lose it in one, its sides would have to close at a fifth of the speed of sound.
NEAR = 0.05


@ti.func
def _diagonals(x, y, right_x, right_y, up_x, up_y, far_x, far_y):
    """From a pack's nodes to the far corners of their cells, and from the right to the upper."""
    return far_x - x, far_y - y, up_x - right_x, up_y - right_y


@ti.func
def _area(d1x, d1y, d2x, d2y, p: ti.template()):
    """Signed area between two diagonals over that at rest; below 0 inside out."""
    return (d1x * d2y - d1y * d2x) * (0.5 / (p.cell.x * p.cell.y))


@ti.func
def has_corners(lattice: ti.template(), b, i, j) -> ti.i32:
    """Whether there are bonds on all four sides of a cell."""
    bonds_a, bonds_b = ti.static(lattice.state.bond_a, lattice.state.bond_b)
    k, lane = lanes.pack_of(lattice, j), lanes.lane_of(lattice, j)
    upper, upper_lane = lanes.pack_of(lattice, j + 1), lanes.lane_of(lattice, j + 1)
    return ti.i32(
        bonds_a[b, i, k].condition[lane] > ABSENT
        and bonds_a[b, i, upper].condition[upper_lane] > ABSENT
        and bonds_b[b, i, k].condition[lane] > ABSENT
        and bonds_b[b, i + 1, k].condition[lane] > ABSENT
    )


@ti.func
def look_pack(lattice: ti.template(), b, i, k, p: ti.template()):
    """Before a step: let go of a pack's cells that are torn open, and see whether any may press.

    What a cell holds only falls. It is frozen in a step, whose stages see one potential.
    """
    bonds_a, bonds_b = ti.static(lattice.state.bond_a, lattice.state.bond_b)
    motion = ti.static(lattice.state.motion)
    a = bonds_a[b, i, k].condition
    left, right = bonds_b[b, i, k].condition, bonds_b[b, i + 1, k].condition
    above = lanes.above(a, bonds_a.condition, b, i, k)
    there = (a > ABSENT) & (left > ABSENT)
    torn = there & ((a == BROKEN) | (above == BROKEN) | (left == BROKEN) | (right == BROKEN))
    room = _room_before(lattice, b, i, k)
    # a cell between two layers is of the foam that the bonds across it have
    limit = lattice.law.keeps_room_below(makeup.constants(lattice, B, b, k, p))
    crushed = there & (room < limit)
    near = 0
    if lanes.any_of(torn | crushed):
        x, y = motion[b, i, k].x, motion[b, i, k].y
        right_x, right_y = motion[b, i + 1, k].x, motion[b, i + 1, k].y
        d1x, d1y, d2x, d2y = _diagonals(
            x, y, right_x, right_y,
            lanes.above(x, motion.x, b, i, k), lanes.above(y, motion.y, b, i, k),
            lanes.above(right_x, motion.x, b, i + 1, k),
            lanes.above(right_y, motion.y, b, i + 1, k),
        )  # fmt: skip
        area = _area(d1x, d1y, d2x, d2y, p)
        stress = lattice.law.room_stress(makeup.constants(lattice, B, b, k, p), area - NEAR, room)
        near = lanes.any_of(crushed & (stress > 0.0))
        longer = elementary.larger(d1x * d1x + d1y * d1y, d2x * d2x + d2y * d2y)
        size = ti.sqrt(longer * (2.0 / (p.cell.x * p.cell.x + p.cell.y * p.cell.y)))
        left_over = (FREE_FROM - size) * (1.0 / (FREE_FROM - HOLDS_TO))
        left_over = ti.select(area > OPEN_AREA, 0.0, left_over)
        hold = elementary.smaller(elementary.larger(left_over, 0.0), lattice.state.hold[b, i, k])
        hold = ti.select(torn, hold, lattice.state.hold[b, i, k])
        frees = (hold <= COUNTS_ABOVE) & (lattice.state.hold[b, i, k] > COUNTS_ABOVE)
        if lanes.any_of(frees):
            lattice.state.clock[b].freed = 1
        lattice.state.hold[b, i, k] = hold
    lattice.scratch.presses[b, i, k] = near


@ti.func
def _room_before(lattice: ti.template(), b, i, k):
    """Room of a pack's cells by the strains that their bonds met before this step."""
    bonds_a, bonds_b = ti.static(lattice.state.bond_a, lattice.state.bond_b)
    along_x = bonds_a[b, i, k].worst
    along_x += lanes.above(along_x, bonds_a.worst, b, i, k)
    along_y = bonds_b[b, i, k].worst + bonds_b[b, i + 1, k].worst
    return (1.0 + 0.5 * along_x) * (1.0 + 0.5 * along_y)


@ti.func
def look_column(lattice: ti.template(), b, i, p: ti.template()):
    pressing = 0
    for k in range(lattice.packs):
        look_pack(lattice, b, i, k, p)
        pressing |= lattice.scratch.presses[b, i, k]
    lattice.scratch.column_presses[b, i] = pressing


@ti.func
def _most_crushed(worst, reach_x, reach_y, per_length):
    """The worst strain of a pack's bonds, now included."""
    length = ti.sqrt(reach_x * reach_x + reach_y * reach_y)
    return elementary.smaller(kinematics.engineering_strain(length * per_length), worst)


@ti.func
def press_pack(lattice: ti.template(), stage, b, i, k, strip, sweep, slot, p: ti.template()):
    """Forces [N] by which a pack's cells push at a stage, kept in `slot`.

    Thickness times pressure times the gradient of the area pushes the two ends of a diagonal apart,
    at right angles to the other one: here along the first diagonal's ends and along the second's.
    The first stage and the last one sample their power.
    """
    trial = ti.static(lattice.scratch.trial)
    bonds_a, bonds_b = ti.static(lattice.state.bond_a, lattice.state.bond_b)
    x, y = trial[b, i, k].x, trial[b, i, k].y
    right_x, right_y = trial[b, i + 1, k].x, trial[b, i + 1, k].y
    up_x, up_y = lanes.above(x, trial.x, b, i, k), lanes.above(y, trial.y, b, i, k)
    far_x = lanes.above(right_x, trial.x, b, i + 1, k)
    far_y = lanes.above(right_y, trial.y, b, i + 1, k)
    d1x, d1y, d2x, d2y = _diagonals(x, y, right_x, right_y, up_x, up_y, far_x, far_y)
    per_x, per_y = 1.0 / p.cell.x, 1.0 / p.cell.y
    # a strain that is met now counts, as for the bonds themselves: straight cells, whatever crushes
    # them, have exactly the room that their bonds leave them
    worst_a, worst_b = bonds_a[b, i, k].worst, bonds_b[b, i, k].worst
    above = lanes.above(worst_a, bonds_a.worst, b, i, k)
    right = bonds_b[b, i + 1, k].worst
    along_x = _most_crushed(worst_a, right_x - x, right_y - y, per_x)
    along_x += _most_crushed(above, far_x - up_x, far_y - up_y, per_x)
    along_y = _most_crushed(worst_b, up_x - x, up_y - y, per_y)
    along_y += _most_crushed(right, far_x - right_x, far_y - right_y, per_y)
    room = (1.0 + 0.5 * along_x) * (1.0 + 0.5 * along_y)
    stress = lattice.law.room_stress(
        makeup.constants(lattice, B, b, k, p), _area(d1x, d1y, d2x, d2y, p), room
    )
    there = (bonds_a[b, i, k].condition > ABSENT) & (bonds_b[b, i, k].condition > ABSENT)
    half = 0.5 * p.thickness * ti.select(there, lattice.state.hold[b, i, k] * stress, 0.0)
    x1, y1, x2, y2 = half * d2y, -half * d2x, -half * d1y, half * d1x
    pushes = ti.static(lattice.scratch.cell_push)
    pushes[sweep, slot, k].x1 = x1
    pushes[sweep, slot, k].y1 = y1
    pushes[sweep, slot, k].x2 = x2
    pushes[sweep, slot, k].y2 = y2
    if stage == 0 or stage == LAST_STAGE:
        u, v = trial[b, i, k].u, trial[b, i, k].v
        right_u, right_v = trial[b, i + 1, k].u, trial[b, i + 1, k].v
        d1u, d1v, d2u, d2v = _diagonals(
            u, v, right_u, right_v,
            lanes.above(u, trial.u, b, i, k), lanes.above(v, trial.v, b, i, k),
            lanes.above(right_u, trial.u, b, i + 1, k),
            lanes.above(right_v, trial.v, b, i + 1, k),
        )  # fmt: skip
        given = (x1 * d1u + y1 * d1v) + (x2 * d2u + y2 * d2v)
        tally = ti.static(lattice.scratch.tally)
        tally[b, strip].pressed = tally[b, strip].pressed - given


@ti.func
def clear_pack(lattice: ti.template(), sweep, slot, k):
    """A pack whose cells do not push."""
    pushes = ti.static(lattice.scratch.cell_push)
    pushes[sweep, slot, k].x1 = lanes.zeros(lattice)
    pushes[sweep, slot, k].y1 = lanes.zeros(lattice)
    pushes[sweep, slot, k].x2 = lanes.zeros(lattice)
    pushes[sweep, slot, k].y2 = lanes.zeros(lattice)


@ti.func
def press_column(lattice: ti.template(), stage, b, i, strip, sweep, slot, p: ti.template()):
    """The pushes of a column's cells, if any of them may push."""
    if lattice.scratch.column_presses[b, i]:
        for k in range(lattice.packs):
            if lattice.scratch.presses[b, i, k]:
                press_pack(lattice, stage, b, i, k, strip, sweep, slot, p)
            else:
                clear_pack(lattice, sweep, slot, k)


@ti.func
def presses(lattice: ti.template(), b, i) -> ti.i32:
    """Whether the pushes of a column's cells are kept, and may be other than zero."""
    may_be = 1
    if ti.static(not lattice.on_gpu):
        may_be = lattice.scratch.column_presses[b, i]
    return may_be


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
    return x, y
