"""Cells: what four neighbouring nodes span, and the room in it that crushed foam keeps.

A bond's law knows its length only. Crushed bonds may fold, zigzag and turn inside out, and none of
them gets shorter by it: the foam between them would vanish. So a cell resists being smaller than
its bonds have left it, whether they are whole or broken; see docs/model.md.

Cell (i, j) is the one to the right of and above node (i, j).
"""

import taichi as ti

from taichi_foam.engine import lanes
from taichi_foam.engine.lattice import LAST_STAGE
from taichi_foam.engine.state import ABSENT, BROKEN
from taichi_foam.laws import elementary, kinematics

# A cell that cracks have pulled apart is none any more. It lets go by its longer diagonal, in
# cells (the root mean square of their two sides), and at once by its area, over that at rest.
HOLDS_TO = 1.6
FREE_FROM = 3.0
OPEN_AREA = 1.5


@ti.func
def _above(here: ti.template(), member: ti.template(), b, i, k):
    return lanes.from_above(here, member[b, i, k + 1][0])


@ti.func
def _diagonals(x, y, right_x, right_y, up_x, up_y, far_x, far_y):
    """From a pack's nodes to the far corners of their cells, and from the right to the upper."""
    return far_x - x, far_y - y, up_x - right_x, up_y - right_y


@ti.func
def _area(d1x, d1y, d2x, d2y, p: ti.template()):
    """Signed area between two diagonals over that at rest; below 0 inside out."""
    return (d1x * d2y - d1y * d2x) * (0.5 / (p.cell.x * p.cell.y))


@ti.func
def look_pack(lattice: ti.template(), b, i, k, p: ti.template()):
    """Before a step: let go of a pack's cells that are torn open, and see whether any may press.

    What a cell holds only falls. It is frozen in a step, whose stages see one potential.
    """
    bonds_a, bonds_b = ti.static(lattice.state.bond_a, lattice.state.bond_b)
    motion = ti.static(lattice.state.motion)
    a = bonds_a[b, i, k].condition
    left, right = bonds_b[b, i, k].condition, bonds_b[b, i + 1, k].condition
    above = lanes.from_above(a, bonds_a[b, i, k + 1].condition[0])
    there = (a > ABSENT) & (left > ABSENT)
    torn = there & ((a == BROKEN) | (above == BROKEN) | (left == BROKEN) | (right == BROKEN))
    if lanes.any_of(torn):
        x, y = motion[b, i, k].x, motion[b, i, k].y
        right_x, right_y = motion[b, i + 1, k].x, motion[b, i + 1, k].y
        d1x, d1y, d2x, d2y = _diagonals(
            x, y, right_x, right_y, _above(x, motion.x, b, i, k), _above(y, motion.y, b, i, k),
            _above(right_x, motion.x, b, i + 1, k), _above(right_y, motion.y, b, i + 1, k),
        )  # fmt: skip
        longer = elementary.larger(d1x * d1x + d1y * d1y, d2x * d2x + d2y * d2y)
        size = ti.sqrt(longer * (2.0 / (p.cell.x * p.cell.x + p.cell.y * p.cell.y)))
        left_over = (FREE_FROM - size) * (1.0 / (FREE_FROM - HOLDS_TO))
        left_over = ti.select(_area(d1x, d1y, d2x, d2y, p) > OPEN_AREA, 0.0, left_over)
        hold = elementary.smaller(elementary.larger(left_over, 0.0), lattice.state.hold[b, i, k])
        lattice.state.hold[b, i, k] = ti.select(torn, hold, lattice.state.hold[b, i, k])
    crushed = there & (_room_before(lattice, b, i, k) < lattice.law.keeps_room_below(p.bond))
    lattice.scratch.presses[b, i, k] = lanes.any_of(crushed)


@ti.func
def _room_before(lattice: ti.template(), b, i, k):
    """Room of a pack's cells by the strains that their bonds met before this step."""
    bonds_a, bonds_b = ti.static(lattice.state.bond_a, lattice.state.bond_b)
    along_x = bonds_a[b, i, k].worst
    along_x += lanes.from_above(along_x, bonds_a[b, i, k + 1].worst[0])
    along_y = bonds_b[b, i, k].worst + bonds_b[b, i + 1, k].worst
    return (1.0 + 0.5 * along_x) * (1.0 + 0.5 * along_y)


@ti.func
def look_column(lattice: ti.template(), b, i, p: ti.template()):
    for k in range(lattice.packs):
        look_pack(lattice, b, i, k, p)


@ti.func
def _most_crushed(worst, reach_x, reach_y, per_length):
    """The worst strain of a pack's bonds, now included."""
    length = ti.sqrt(reach_x * reach_x + reach_y * reach_y)
    return elementary.smaller(kinematics.engineering_strain(length * per_length), worst)


@ti.func
def _pressures(lattice: ti.template(), b, i, k, p: ti.template()):
    """Forces [N] by which a pack's cells push at the current stage.

    Thickness times pressure times the gradient of the area pushes the two ends of a diagonal apart,
    at right angles to the other one. Here it is put as pressure on faces: the force on the first
    node, less that on the second, of both bonds A, and of both bonds B.
    """
    trial = ti.static(lattice.scratch.trial)
    x, y = trial[b, i, k].x, trial[b, i, k].y
    right_x, right_y = trial[b, i + 1, k].x, trial[b, i + 1, k].y
    up_x, up_y = _above(x, trial.x, b, i, k), _above(y, trial.y, b, i, k)
    far_x = _above(right_x, trial.x, b, i + 1, k)
    far_y = _above(right_y, trial.y, b, i + 1, k)
    d1x, d1y, d2x, d2y = _diagonals(x, y, right_x, right_y, up_x, up_y, far_x, far_y)
    area = _area(d1x, d1y, d2x, d2y, p)
    zeros = lanes.zeros(lattice)
    ax, ay, bx, by = zeros, zeros, zeros, zeros
    # what bonds meet now only takes room: few packs need their lengths
    if lanes.any_of(area < _room_before(lattice, b, i, k)):
        bonds_a, bonds_b = ti.static(lattice.state.bond_a, lattice.state.bond_b)
        per_x, per_y = 1.0 / p.cell.x, 1.0 / p.cell.y
        worst_a, worst_b = bonds_a[b, i, k].worst, bonds_b[b, i, k].worst
        above = lanes.from_above(worst_a, bonds_a[b, i, k + 1].worst[0])
        right = bonds_b[b, i + 1, k].worst
        along_x = _most_crushed(worst_a, right_x - x, right_y - y, per_x)
        along_x += _most_crushed(above, far_x - up_x, far_y - up_y, per_x)
        along_y = _most_crushed(worst_b, up_x - x, up_y - y, per_y)
        along_y += _most_crushed(right, far_x - right_x, far_y - right_y, per_y)
        # a strain that is met now counts, as for the bonds themselves: straight cells, whatever
        # crushes them, have exactly the room that their bonds leave them
        room = (1.0 + 0.5 * along_x) * (1.0 + 0.5 * along_y)
        stress = lattice.state.hold[b, i, k] * lattice.law.room_stress(p.bond, area, room)
        there = (bonds_a[b, i, k].condition > ABSENT) & (bonds_b[b, i, k].condition > ABSENT)
        quarter = 0.25 * p.thickness * ti.select(there, stress, 0.0)
        ax, ay = -quarter * (d1y + d2y), quarter * (d1x + d2x)
        bx, by = quarter * (d1y - d2y), quarter * (d2x - d1x)
    return ax, ay, bx, by


@ti.func
def _power(lattice: ti.template(), b, i, k, ax, ay, bx, by):
    """Power [W] that a pack's cells take from their nodes, by the forces of `_pressures`."""
    trial = ti.static(lattice.scratch.trial)
    u, v = trial[b, i, k].u, trial[b, i, k].v
    right_u, right_v = trial[b, i + 1, k].u, trial[b, i + 1, k].v
    d1u, d1v, d2u, d2v = _diagonals(
        u, v, right_u, right_v, _above(u, trial.u, b, i, k), _above(v, trial.v, b, i, k),
        _above(right_u, trial.u, b, i + 1, k), _above(right_v, trial.v, b, i + 1, k),
    )  # fmt: skip
    return ((ax + bx) * d1u + (ay + by) * d1v) - ((ax - bx) * d2u + (ay - by) * d2v)


@ti.func
def press_pack(
    lattice: ti.template(), stage, b, i, k, strip, sweep, slot, left_slot, below_x, below_y,
    p: ti.template(),
):  # fmt: skip
    """Add the pressures of the cells on both sides of a pack's bonds to the bonds' forces.

    The cells on the left are in `left_slot`, or are worked out where it is below 0. `below` is the
    force of the cell below the first bond A on it [N]; that of the last cell on the bond A above it
    comes back. The first stage and the last one sample the power of the pack's own cells.
    """
    force = ti.static(lattice.scratch.force)
    tally, presses = ti.static(lattice.scratch.tally, lattice.scratch.presses)
    zeros = lanes.zeros(lattice)
    ax, ay, bx, by = zeros, zeros, zeros, zeros
    own, left = presses[b, i, k], presses[b, i - 1, k]
    if own:
        ax, ay, bx, by = _pressures(lattice, b, i, k, p)
        if ti.static(not lattice.on_gpu):
            lattice.scratch.beside[sweep, slot, k].x = bx
            lattice.scratch.beside[sweep, slot, k].y = by
        if stage == 0 or stage == LAST_STAGE:
            tally[b, strip].pressed += _power(lattice, b, i, k, ax, ay, bx, by)
    if own or left:
        if left:
            left_x, left_y = zeros, zeros
            if left_slot < 0:
                _, _, left_x, left_y = _pressures(lattice, b, i - 1, k, p)
            elif ti.static(not lattice.on_gpu):
                left_x = lattice.scratch.beside[sweep, left_slot, k].x
                left_y = lattice.scratch.beside[sweep, left_slot, k].y
            bx += left_x
            by += left_y
        force[sweep, slot, k].bx += bx
        force[sweep, slot, k].by += by
    if own or below_x != 0.0 or below_y != 0.0:
        force[sweep, slot, k].ax += ax + lanes.from_below(ax, below_x)
        force[sweep, slot, k].ay += ay + lanes.from_below(ay, below_y)
    last = ti.static(lattice.lanes - 1)
    return ax[last], ay[last]


@ti.func
def push_below(lattice: ti.template(), b, i, k, p: ti.template()):
    """What `press_pack` asks for, where no sweep has it from the pack below."""
    x, y = 0.0, 0.0
    if lattice.scratch.presses[b, i, k - 1]:
        ax, ay, _, _ = _pressures(lattice, b, i, k - 1, p)
        x, y = ax[ti.static(lattice.lanes - 1)], ay[ti.static(lattice.lanes - 1)]
    return x, y


@ti.func
def press_column(
    lattice: ti.template(), stage, b, i, strip, sweep, slot, left_slot, p: ti.template()
):  # fmt: skip
    """The pressures on the bonds of a column."""
    x, y = 0.0, 0.0
    for k in range(lattice.packs):
        x, y = press_pack(lattice, stage, b, i, k, strip, sweep, slot, left_slot, x, y, p)
