"""Stress about each mass point: the virial of all forces on it (Love; Irving & Kirkwood).

    stress = 1/V sum of arm (x) force

over the mass point's present volume V; tension positive. The sum takes half of each of its bonds, a
quarter of each of its cells, and the forces of contact with the impactor, the floor and other
pieces and of the base that holds it, each with the arm from the mass point to its cell's side. The
forces are computed by the engine's own functions at a middle stage, which change no state.

The kernels take some seconds to compile: runs keep stresses only on request
(`Output.keeps_stress`).
"""

import numpy as np
from numpy.typing import NDArray

from taichi_foam.backend import ti
from taichi_foam.engine import bonds, cells, contact, gpu_neighbours, lanes, makeup
from taichi_foam.engine.grading import A, B
from taichi_foam.engine.lattice import Lattice
from taichi_foam.engine.state import ABSENT
from taichi_foam.scene.block import Block
from taichi_foam.scene.filling import filling

Stack = ti.types.ndarray(dtype=ti.f64, ndim=3)

# Arguments with which forces are computed: a stage that updates no history, and zero weight for
# works.
MIDDLE, NOTHING = 1, 0.0

# Smallest volume, over that which the worst strains leave: lattices fold.
LEAST_ROOM = 0.5

vec2 = ti.types.vector(2, ti.f64)
vec3 = ti.types.vector(3, ti.f64)


def stresses(lattice: Lattice, b: int, block: Block) -> NDArray[np.float32]:
    """Stress xx, yy and xy [Pa] at each node of lattice `b` between two steps, (I, J, 3).

    It is 0 where the `block` has no foam.
    """
    found = np.zeros((lattice.size.columns, lattice.size.rows, 3))
    if lattice.on_gpu:
        _gpu_forces(lattice, b, MIDDLE)
        _gpu_sums(lattice, b, MIDDLE, NOTHING, found)
    else:
        _cpu_sums(lattice, b, MIDDLE, NOTHING, found)
    if not block.is_rectangle:
        found /= _shares(block)[..., None]
    return found.astype(np.float32)


def _shares(block: Block) -> NDArray[np.float64]:
    """Foam of each mass point over that of a whole cell, (I, J); infinite where there is none."""
    filled = filling(block)
    return np.where(filled.there, filled.area, np.inf)


@ti.func
def _forces(lattice: ti.template(), stage, b, i, k, strip, sweep, slot, p: ti.template()):
    """The forces of a pack's bonds and cells, kept in `slot`."""
    a_strain, b_strain = bonds.bond_pack(lattice, stage, b, i, k, strip, sweep, slot, p)
    if ti.static(lattice.law.stiffens):
        bonds.stiffen_pack(lattice, b, i, k, sweep, slot, a_strain, b_strain, p)
    if ti.static(lattice.features.crushed_room):
        cells.press_pack(lattice, b, i, k, strip, sweep, slot, p)


@ti.kernel
def _cpu_sums(lattice: ti.template(), b: ti.i32, stage: ti.i32, weight: ti.f64, found: Stack):
    for _ in range(1):
        p = lattice.model.parameters[b]
        sweep, last = b * lattice.sweeps, lattice.counts[None].columns - 1
        for i in range(lattice.counts[None].columns):
            slot, left = bonds.slot_of(lattice, i, last), bonds.slot_of(lattice, i - 1, last)
            for k in range(lattice.counts[None].packs):
                _forces(lattice, stage, b, i, k, i, sweep, slot, p)
            for j in range(lattice.counts[None].rows):
                _add_node(lattice, stage, weight, b, i, j, i, sweep, slot, left, found, p)
        if ti.static(lattice.features.self_contact):
            for n in range(lattice.state.clock[b].pairs):
                pair = lattice.state.pairs[b, n]
                one = lattice.state.candidate_node[b, pair[0]]
                two = lattice.state.candidate_node[b, pair[1]]
                touch = contact.touch_of(
                    lattice.state.candidate[b, pair[0]].radius,
                    lattice.state.candidate[b, pair[1]].radius,
                )
                torn = ti.min(
                    lattice.state.candidate[b, pair[0]].torn,
                    lattice.state.candidate[b, pair[1]].torn,
                )
                sums = _of_pair(lattice, b, one, two, touch, torn, p)
                for c in ti.static(range(3)):
                    for node in ti.static((one, two)):
                        i, j = lanes.column_and_row(lattice, node)
                        found[i, j, c] = found[i, j, c] + sums[c]
        for i in range(lattice.counts[None].columns):
            for j in range(lattice.counts[None].rows):
                _divide(lattice, b, i, j, found, p)


@ti.kernel
def _gpu_forces(lattice: ti.template(), b: ti.i32, stage: ti.i32):
    for strip in range(lattice.counts[None].strips):
        p = lattice.model.parameters[b]
        n = strip
        while n < lattice.counts[None].nodes:
            i, k = lanes.column_and_row(lattice, n)
            _forces(lattice, stage, b, i, k, strip, b, i, p)
            n += lattice.counts[None].strips


@ti.kernel
def _gpu_sums(lattice: ti.template(), b: ti.i32, stage: ti.i32, weight: ti.f64, found: Stack):
    for strip in range(lattice.counts[None].strips):
        p = lattice.model.parameters[b]
        n = strip
        while n < lattice.counts[None].nodes:
            i, j = lanes.column_and_row(lattice, n)
            left = ti.select(i > 0, i - 1, lattice.counts[None].columns)
            _add_node(lattice, stage, weight, b, i, j, strip, b, i, left, found, p)
            if ti.static(lattice.features.self_contact):
                for m in range(lattice.state.partner_count[b, n]):
                    other = lattice.state.partners[b, lattice.state.partner_start[b, n] + m]
                    oi, oj = lanes.column_and_row(lattice, other)
                    touch = contact.touch_of(
                        lattice.state.radius[b, i, j][0], lattice.state.radius[b, oi, oj][0]
                    )
                    torn = ti.min(
                        gpu_neighbours.torn(lattice, b, n, p),
                        gpu_neighbours.torn(lattice, b, other, p),
                    )
                    sums = _of_pair(lattice, b, n, other, touch, torn, p)
                    for c in ti.static(range(3)):
                        found[i, j, c] = found[i, j, c] + sums[c]
            _divide(lattice, b, i, j, found, p)
            n += lattice.counts[None].strips


@ti.func
def _half(arm: vec2, force: vec2) -> vec3:
    """Symmetric part of half of arm (x) force, as xx, yy, xy [J]."""
    return 0.5 * vec3(arm.x * force.x, arm.y * force.y, 0.5 * (arm.x * force.y + arm.y * force.x))


@ti.func
def _add_node(
    lattice: ti.template(), stage, weight, b, i, j, strip, sweep, slot, left, found: ti.template(),
    p: ti.template(),
):  # fmt: skip
    """Contribution of bonds, cells and bodies to a node's virial [J].

    `left` is the slot of the column to the left.
    """
    force, motion = ti.static(lattice.scratch.force, lattice.scratch.trial)
    k, lane = lanes.pack_of(lattice, j), lanes.lane_of(lattice, j)
    low_k, low_lane = lanes.pack_of(lattice, j - 1), lanes.lane_of(lattice, j - 1)
    x = lanes.position(lattice, motion, b, i, j)
    to_right = lanes.position(lattice, motion, b, i + 1, j) - x
    to_left = lanes.position(lattice, motion, b, i - 1, j) - x
    up = lanes.position(lattice, motion, b, i, j + 1) - x
    down = lanes.position(lattice, motion, b, i, j - 1) - x
    by_right = vec2(force[sweep, slot, k].ax[lane], force[sweep, slot, k].ay[lane])
    by_left = -vec2(force[sweep, left, k].ax[lane], force[sweep, left, k].ay[lane])
    by_up = vec2(force[sweep, slot, k].bx[lane], force[sweep, slot, k].by[lane])
    by_down = -vec2(force[sweep, slot, low_k].bx[low_lane], force[sweep, slot, low_k].by[low_lane])
    sums = _half(to_right, by_right) + _half(to_left, by_left)
    sums += _half(up, by_up) + _half(down, by_down)
    reaction = -(by_right + by_left + by_up + by_down)
    if ti.static(lattice.features.cells):
        for side in ti.static(range(2)):
            place = slot
            if ti.static(side == 1):
                place = left
            # the cell above on this side, and the one below
            first, second = _pushes(lattice, sweep, place, k, lane)
            sums += _of_cell(lattice, motion, b, i - side, j, first, second)
            low_first, low_second = _pushes(lattice, sweep, place, low_k, low_lane)
            sums += _of_cell(lattice, motion, b, i - side, j - 1, low_first, low_second)
            if ti.static(side == 0):
                reaction += first - low_second
            else:
                reaction += second - low_first
    across, upright, _ = _cell(lattice, b, i, j, p)
    if makeup.is_held(lattice, b, i, j, p):
        if not p.hold_x:
            reaction.x = 0.0
        sums -= _half(upright, reaction)
    else:
        deepest = lattice.state.overlap[b, strip]
        by_bodies = contact.touch_bodies(lattice, b, i, j, strip, stage, weight, p)
        lattice.state.overlap[b, strip] = deepest
        # the force acts on the side of the cell that it presses
        arm = across
        if ti.abs(by_bodies.dot(upright)) * across.norm() > (
            ti.abs(by_bodies.dot(across)) * upright.norm()
        ):
            arm = upright
        if by_bodies.dot(arm) > 0.0:
            arm = -arm
        sums += _half(arm, by_bodies)
    for c in ti.static(range(3)):
        found[i, j, c] = sums[c]


@ti.func
def _pushes(lattice: ti.template(), sweep, slot, k, lane):
    """Forces [N] of one cell on the second ends of its two diagonals."""
    push = ti.static(lattice.scratch.cell_push)
    first = vec2(push[sweep, slot, k].x1[lane], push[sweep, slot, k].y1[lane])
    second = vec2(push[sweep, slot, k].x2[lane], push[sweep, slot, k].y2[lane])
    return first, second


@ti.func
def _of_cell(
    lattice: ti.template(), motion: ti.template(), b, i, j, first: vec2, second: vec2
) -> vec3:
    """A quarter of the virial of the forces of cell (i, j) on its diagonals' ends [J]."""
    start = lanes.position(lattice, motion, b, i, j)
    right = lanes.position(lattice, motion, b, i + 1, j)
    up = lanes.position(lattice, motion, b, i, j + 1)
    far = lanes.position(lattice, motion, b, i + 1, j + 1)
    return -0.5 * (_half(far - start, first) + _half(up - right, second))


@ti.func
def _of_pair(lattice: ti.template(), b, one, two, touch, torn, p: ti.template()) -> vec3:
    """Contribution of the contact of two pieces to the virial of each [J]."""
    i, j = lanes.column_and_row(lattice, one)
    oi, oj = lanes.column_and_row(lattice, two)
    motion = ti.static(lattice.scratch.trial)
    away = lanes.position(lattice, motion, b, i, j) - lanes.position(lattice, motion, b, oi, oj)
    closing = lanes.velocity(lattice, motion, b, i, j) - lanes.velocity(lattice, motion, b, oi, oj)
    push = contact.piece_push(lattice, b, one, two, away, closing, touch, torn, p)
    return _half(away, push)


@ti.func
def _divide(lattice: ti.template(), b, i, j, found: ti.template(), p: ti.template()):
    """Divide a node's virial by its volume."""
    _, _, area = _cell(lattice, b, i, j, p)
    for c in ti.static(range(3)):
        found[i, j, c] = found[i, j, c] / (area * p.thickness)


@ti.func
def _cell(lattice: ti.template(), b, i, j, p: ti.template()):
    """The two sides of a node's cell from its whole bonds at present [m], and its area [m2]."""
    across, width = _side(lattice, A, b, i, j, p)
    upright, height = _side(lattice, B, b, i, j, p)
    area = across.x * upright.y - across.y * upright.x
    return across, upright, ti.max(area, LEAST_ROOM * width * height)


@ti.func
def _side(lattice: ti.template(), axis: ti.template(), b, i, j, p: ti.template()):
    """Mean of a node's whole bonds along `axis`, and the length left by crushing [m]."""
    motion, state = ti.static(lattice.scratch.trial, lattice.state.bonds[axis])
    step = ti.static((1, 0) if axis == A else (0, 1))
    total, worst, count, there = vec2(0.0), 0.0, 0, 0
    for side in ti.static(range(2)):
        m, n = i - side * step[0], j - side * step[1]
        if lanes.value(lattice, state.condition, b, m, n) > ABSENT:
            worst += lanes.value(lattice, state.worst, b, m, n)
            there += 1
        if bonds.is_whole(lattice, axis, b, m, n):
            total += lanes.position(lattice, motion, b, m + step[0], n + step[1])
            total -= lanes.position(lattice, motion, b, m, n)
            count += 1
    left = p.cell[axis] * (1.0 + worst / ti.max(there, 1))
    mean = vec2(left * step[0], left * step[1])
    if count > 0:
        mean = total / count
    return mean, left
