"""The energies of a lattice, and the rows of its history."""

from taichi_foam.backend import ti
from taichi_foam.engine import bonds, cells, lanes, makeup
from taichi_foam.engine.state import ABSENT, BASE, BROKEN, WORKS
from taichi_foam.records.history import BOOKED, ENERGIES_NOW, TURN_COLUMNS, row_columns

vec4 = ti.types.vector(4, ti.f64)
vec_now = ti.types.vector(len(ENERGIES_NOW), ti.f64)
vec_works = ti.types.vector(WORKS, ti.f64)

KINETIC, POTENTIAL, IN_BONDS, IN_SHEAR, IN_ROOM = range(len(ENERGIES_NOW))
COLUMN = {name: n for n, name in enumerate(row_columns(turns=True))}
FIRST_NOW, FIRST_BOOKED = COLUMN[ENERGIES_NOW[0]], COLUMN[BOOKED[0]]
FIRST_OF_TURN = COLUMN[TURN_COLUMNS[0]]


@ti.func
def _stored(lattice: ti.template(), axis, b, i, j, p: ti.template()) -> ti.f64:
    """Stored energy [J] of the bond from (i, j) along `axis`, 0 if it is absent."""
    condition, history, strain = bonds.look_at(lattice, axis, b, i, j, p)
    energy = 0.0
    if condition > ABSENT:
        broken = ti.i32(condition == BROKEN)
        c = makeup.constants_at(lattice, axis, b, j, p)
        stored = lattice.law.stored_energy(c, strain, history, broken)
        if ti.static(lattice.features.softens):  # noqa: SIM102 - the static test stands alone
            if not broken and bonds.is_pulled(lattice, c, strain, history):
                stored *= bonds.intact_share(lattice, axis, b, i, j)
        energy = makeup.volume(lattice, axis, b, i, j, p) * stored
    return energy


@ti.func
def energy_column(lattice: ti.template(), b, i, p: ti.template()):
    """Add up the energies of one column of nodes, its bonds and its cells."""
    energy = vec_now(0.0)
    for j in range(lattice.counts[None].rows):
        energy += energy_at(lattice, b, i, j, p)
    if ti.static(lattice.features.cells):
        for k in range(lattice.counts[None].packs):
            energy += energy_of_cells(lattice, b, i, k, p)
    lattice.scratch.energy[b, i] = energy


@ti.func
def energy_at(lattice: ti.template(), b, i, j, p: ti.template()) -> vec_now:
    """Energies [J] of a node and its two bonds."""
    energy = vec_now(0.0)
    for axis in range(2):  # not unrolled, so that the long law compiles once
        energy[IN_BONDS] += _stored(lattice, axis, b, i, j, p)
    mass = makeup.mass(lattice, b, i, j, p)
    speed = lanes.velocity(lattice, lattice.state.motion, b, i, j)
    energy[KINETIC] = 0.5 * mass * speed.norm_sqr()
    height = lanes.position(lattice, lattice.state.motion, b, i, j).y
    energy[POTENTIAL] = mass * p.gravity * height
    return energy


@ti.func
def energy_of_cells(lattice: ti.template(), b, i, k, p: ti.template()) -> vec_now:
    """Energies [J] that a pack's cells store."""
    stored = cells.stored_pack(lattice, b, i, k, p)
    energy = vec_now(0.0)
    energy[IN_SHEAR], energy[IN_ROOM] = stored[0], stored[1]
    return energy


@ti.func
def add_strips(lattice: ti.template(), b):
    """Energies and booked works of a lattice [J], summed over its strips."""
    energy, works = vec_now(0.0), vec_works(0.0)
    for strip in range(lattice.counts[None].strips):
        energy += lattice.scratch.energy[b, strip]
        works += lattice.state.work[b, strip]
    return energy, works


@ti.func
def write_row(lattice: ti.template(), b, energy: vec_now, by_nodes: vec_works):
    """Append a row to the lattice's history; `by_nodes` are the works booked by its nodes."""
    clock = lattice.state.clock[b]
    row = clock.rows
    works = by_nodes
    works[BASE] += lattice.state.body[b].support_work
    history = ti.static(lattice.scratch.history)
    history[b, row, ti.static(COLUMN["time"])] = clock.time
    history[b, row, ti.static(COLUMN["step"])] = clock.step
    history[b, row, ti.static(COLUMN["y"])] = lattice.state.body[b].y
    history[b, row, ti.static(COLUMN["v"])] = lattice.state.body[b].v
    history[b, row, ti.static(COLUMN["force"])] = lattice.state.body[b].force
    history[b, row, ti.static(COLUMN["broken"])] = clock.broken
    for k in ti.static(range(len(ENERGIES_NOW))):
        history[b, row, FIRST_NOW + k] = energy[k]
    for k in ti.static(range(WORKS)):
        history[b, row, FIRST_BOOKED + k] = works[k]
    if ti.static(lattice.features.turns):
        turn = lattice.state.turn[b]
        of_body = vec4(turn.x, turn.u, turn.angle, turn.spin)
        for k in ti.static(range(len(TURN_COLUMNS))):
            history[b, row, FIRST_OF_TURN + k] = of_body[k]
    lattice.state.clock[b].rows = row + 1
