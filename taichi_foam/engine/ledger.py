"""The energies of a lattice, and the rows of its history."""

import taichi as ti

from taichi_foam.engine import breaking, lanes, makeup
from taichi_foam.engine.state import ABSENT, BASE, BROKEN, WORKS
from taichi_foam.records.history import ROW_COLUMNS, TURN_COLUMNS

vec3 = ti.types.vector(3, ti.f64)
vec4 = ti.types.vector(4, ti.f64)
vec_works = ti.types.vector(WORKS, ti.f64)

FIRST_WORK = ROW_COLUMNS.index("bonds")
FIRST_OF_TURN = len(ROW_COLUMNS)


@ti.func
def _stored(lattice: ti.template(), axis, b, i, j, p: ti.template()) -> ti.f64:
    """Stored energy [J] of the bond from (i, j) along `axis`, 0 where there is none."""
    condition, worst, strain = breaking.look_at(lattice, axis, b, i, j, p)
    energy = 0.0
    if condition > ABSENT:
        broken = ti.i32(condition == BROKEN)
        c = makeup.constants_at(lattice, axis, b, j, p)
        stored = lattice.law.stored_energy(c, strain, worst, broken)
        if ti.static(lattice.features.softens):  # noqa: SIM102 - the static test stands alone
            if not broken and breaking.is_pulled(lattice, c, strain, worst):
                stored *= breaking.intact_share(lattice, axis, b, i, j)
        energy = makeup.volume(lattice, axis, b, i, j, p) * stored
    return energy


@ti.func
def energy_column(lattice: ti.template(), b, i, p: ti.template()):
    """Add up the energies of one column of nodes and its bonds."""
    energy = vec3(0.0)
    for j in range(lattice.rows):
        energy += energy_at(lattice, b, i, j, p)
    lattice.scratch.energy[b, i] = energy


@ti.func
def energy_at(lattice: ti.template(), b, i, j, p: ti.template()) -> vec3:
    """Kinetic, stored and potential energy [J] of a node and its two bonds."""
    stored = 0.0
    for axis in range(2):  # not unrolled: the law is long, and compiles once so
        stored += _stored(lattice, axis, b, i, j, p)
    mass = makeup.mass(lattice, b, i, j, p)
    return vec3(
        0.5 * mass * lanes.velocity(lattice, lattice.state.motion, b, i, j).norm_sqr(),
        stored,
        mass * p.gravity * lanes.position(lattice, lattice.state.motion, b, i, j).y,
    )


@ti.func
def add_strips(lattice: ti.template(), b):
    """Energies, what breaking lost, and works of a lattice [J], from its strips."""
    energy = vec3(0.0)
    fracture = 0.0
    works = vec_works(0.0)
    for strip in range(lattice.strips):
        energy += lattice.scratch.energy[b, strip]
        fracture += lattice.state.fracture[b, strip]
        works += lattice.state.work[b, strip]
    return energy, fracture, works


@ti.func
def write_row(lattice: ti.template(), b, energy: vec3, fracture: ti.f64, by_nodes: vec_works):
    """Append a row to the lattice's history; `by_nodes` are the works that its nodes did."""
    clock = lattice.state.clock[b]
    row = clock.rows
    works = by_nodes
    works[BASE] += lattice.state.body[b].support_work
    lattice.scratch.history[b, row, 0] = clock.time
    lattice.scratch.history[b, row, 1] = clock.step
    lattice.scratch.history[b, row, 2] = lattice.state.body[b].y
    lattice.scratch.history[b, row, 3] = lattice.state.body[b].v
    lattice.scratch.history[b, row, 4] = lattice.state.body[b].force
    lattice.scratch.history[b, row, 5] = clock.broken
    for k in ti.static(range(3)):
        lattice.scratch.history[b, row, 6 + k] = energy[k]
    lattice.scratch.history[b, row, 9] = fracture
    for k in ti.static(range(WORKS)):
        lattice.scratch.history[b, row, FIRST_WORK + k] = works[k]
    if ti.static(lattice.features.turns):
        turn = lattice.state.turn[b]
        of_body = vec4(turn.x, turn.u, turn.angle, turn.spin)
        for k in ti.static(range(len(TURN_COLUMNS))):
            lattice.scratch.history[b, row, FIRST_OF_TURN + k] = of_body[k]
    lattice.state.clock[b].rows = row + 1
