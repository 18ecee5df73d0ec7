"""The energies of a lattice, and the rows of its history."""

from types import SimpleNamespace
from typing import Any

from taichi_foam.backend import ti
from taichi_foam.engine import bonds, cells, lanes, makeup
from taichi_foam.engine.state import ABSENT, BROKEN, WORK, WORKS
from taichi_foam.records.history import BOOKED, ENERGIES_NOW, row_columns

vec_now = ti.types.vector(len(ENERGIES_NOW), ti.f64)
vec_works = ti.types.vector(WORKS, ti.f64)

ENERGY = SimpleNamespace(**{name: n for n, name in enumerate(ENERGIES_NOW)})
"""Index of each of ENERGIES_NOW."""

# What a row is made of.
MEMBER, NOW, DONE = range(3)


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
        energy[ENERGY.in_bonds] += _stored(lattice, axis, b, i, j, p)
    mass = makeup.mass(lattice, b, i, j, p)
    speed = lanes.velocity(lattice, lattice.state.motion, b, i, j)
    energy[ENERGY.kinetic] = 0.5 * mass * speed.norm_sqr()
    height = lanes.position(lattice, lattice.state.motion, b, i, j).y
    energy[ENERGY.potential] = mass * p.gravity * height
    return energy


@ti.func
def energy_of_cells(lattice: ti.template(), b, i, k, p: ti.template()) -> vec_now:
    """Energies [J] that a pack's cells store."""
    stored = cells.stored_pack(lattice, b, i, k, p)
    energy = vec_now(0.0)
    energy[ENERGY.in_shear], energy[ENERGY.in_room] = stored[0], stored[1]
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
    works = by_nodes
    works[WORK.base] += lattice.state.body[b].support_work
    row = lattice.state.clock[b].rows
    for n, kind, source in ti.static(_sources(lattice)):
        if ti.static(kind == NOW):
            lattice.scratch.history[b, row, n] = energy[source]
        elif ti.static(kind == DONE):
            lattice.scratch.history[b, row, n] = works[source]
        else:
            lattice.scratch.history[b, row, n] = source[b]
    lattice.state.clock[b].rows = row + 1


def _sources(lattice: Any) -> list[tuple[int, int, Any]]:
    """The entries of a row: number, kind, and the number of the energy or the member's field."""
    found: list[tuple[int, int, Any]] = []
    for n, name in enumerate(row_columns(lattice.features.turns)):
        if name in ENERGIES_NOW:
            found.append((n, NOW, ENERGIES_NOW.index(name)))
        elif name in BOOKED:
            found.append((n, DONE, BOOKED.index(name)))
        elif name in lattice.numbers:
            found.append((n, MEMBER, lattice.singles[lattice.numbers.index(name)]))
        else:
            raise ValueError(
                f"history: {name!r} is no member of clock, body or turn, and no energy"
            )
    return found
