"""The time loop: Runge-Kutta stages, history, step size, and when to stop.

A stage is a *sweep* over columns: it computes the forces of one column's bonds, then moves the
nodes of the column before it, whose forces are then complete. So a stage reads and writes each node
once, and keeps the forces of only a few columns.

There are two ways to run the same functions, with bitwise identical results: `fused` keeps a whole
lattice on one thread for thousands of steps in one call (a call takes as long as a stage of a small
lattice), `staged` divides the columns of a big lattice among several sweeps.
"""

from taichi_foam.backend import ti
from taichi_foam.engine import bonds, cells, clock, contact, ledger, nodes
from taichi_foam.engine.lattice import LAST_STAGE, Lattice
from taichi_foam.engine.state import RUNNING

# Taichi gives each CPU thread at least this many iterations of a parallel loop, however long each
# takes. So a loop over few long iterations is stretched by this factor, and only every GRAIN-th
# iteration does work.
GRAIN = 512


@ti.func
def _write_row(lattice: ti.template(), b, p: ti.template()):
    energy, works = ledger.add_strips(lattice, b)
    clock.close_row(lattice, b, energy, works, p)


@ti.func
def _find_neighbours(lattice: ti.template(), b, p: ti.template()):
    """Find the nodes that may touch in the next step, and their radii."""
    if ti.static(lattice.features.self_contact):
        if lattice.state.clock[b].stale:
            contact.list_neighbours(lattice, b, p)
        elif lattice.state.clock[b].steps % clock.REFRESH == 0:
            contact.refresh_radii(lattice, b, p)


@ti.func
def _sweep(
    lattice: ti.template(), b, stage, sweep, start, end, known_before, known_from, p: ti.template()
):
    """A stage of the columns from `start` up to but excluding `end`.

    The forces of columns before `known_before` and from `known_from` on are already computed.
    """
    for i in range(start, end + 1):
        if known_before <= i and i < known_from:
            slot = bonds.slot_of(lattice, i, end - 1)
            bonds.bond_column(lattice, stage, b, i, i, sweep, slot, p)
        if i > start:
            slot = bonds.slot_of(lattice, i - 1, end - 1)
            left_slot = bonds.slot_of(lattice, i - 2, end - 1)
            nodes.node_column(lattice, b, i - 1, stage, sweep, slot, left_slot, p)


@ti.func
def _end_step(lattice: ti.template(), b, p: ti.template()):
    """Advance the clock, break failed bonds, and stop a lattice that has diverged."""
    moved = 0.0
    stiffest = 0.0
    crush = 0.0
    breaks = 0
    diverged = 0.0
    for strip in range(lattice.counts[None].strips):
        moved = ti.max(moved, lattice.scratch.tally[b, strip].moved.max())
        stiffest = ti.max(stiffest, lattice.scratch.stiffest[b, strip])
        crush = ti.max(crush, -lattice.scratch.tally[b, strip].least.min())
        diverged += lattice.scratch.tally[b, strip].diverged.sum()
    for i in range(lattice.counts[None].columns):
        breaks += lattice.scratch.column_breaks[b, i]
    bad_node = lattice.counts[None].nodes
    if diverged > 0.0:
        bad_node = nodes.first_diverged(lattice, b)
    clock.close_step(lattice, b, moved, stiffest, crush, breaks, bad_node, p)
    if ti.static(lattice.features.softens):
        for i in range(lattice.counts[None].columns):
            if lattice.scratch.column_softens[b, i] > 0:
                bonds.soften_bonds(lattice, b, i, p)
    if breaks > 0:
        for i in range(lattice.counts[None].columns):
            if lattice.scratch.column_breaks[b, i] > 0:
                bonds.break_bonds(lattice, b, i, p)


@ti.func
def _stage(lattice: ti.template(), b, stage, p: ti.template()):
    """One stage of a whole lattice on one thread."""
    if ti.static(lattice.features.self_contact):
        contact.push_pieces(lattice, b, stage, p)
    sweep = b * lattice.sweeps
    columns = lattice.counts[None].columns
    _sweep(lattice, b, stage, sweep, 0, columns, 0, columns, p)
    nodes.stage_of_strips(lattice, b, stage, p)


@ti.func
def _take_step(lattice: ti.template(), b, p: ti.template()):
    """One step of one lattice on one thread."""
    clock.take_stock(lattice, b, p)
    if clock.row_is_due(lattice, b):
        for i in range(lattice.counts[None].columns):
            ledger.energy_column(lattice, b, i, p)
        _write_row(lattice, b, p)
    _find_neighbours(lattice, b, p)
    if lattice.state.clock[b].status == RUNNING:
        if ti.static(lattice.features.flows):
            for i in range(lattice.counts[None].columns):
                bonds.flow_column(lattice, b, i, p)
        for stage in range(LAST_STAGE + 1):
            _stage(lattice, b, stage, p)
        _end_step(lattice, b, p)
        if ti.static(lattice.features.cells):
            for i in range(lattice.counts[None].columns):
                cells.look_column(lattice, b, i, True, p)


@ti.kernel
def look(lattice: ti.template(), b: ti.i32):
    """Update what the cells of a state just put carry."""
    for _ in range(1):
        p = lattice.model.parameters[b]
        for i in range(lattice.counts[None].columns):
            cells.look_column(lattice, b, i, False, p)


@ti.kernel
def find_stiffest(lattice: ti.template(), b: ti.i32):
    """Find the stiffest stiffened bond of a state just put."""
    for _ in range(1):
        p = lattice.model.parameters[b]
        stiffest = 0.0
        for i in range(lattice.counts[None].columns):
            bonds.bond_column(lattice, 0, b, i, i, b * lattice.sweeps, 0, p)
            stiffest = ti.max(stiffest, lattice.scratch.stiffest[b, i])
        lattice.state.clock[b].stiffest = stiffest


@ti.kernel
def advance_fused(lattice: ti.template(), most_steps: ti.i32):
    """Take up to `most_steps` steps of every running lattice, each on one thread."""
    for q in range(lattice.batch * GRAIN):
        if q % GRAIN == 0:
            b = q // GRAIN
            p = lattice.model.parameters[b]
            taken = 0
            while taken < most_steps and clock.goes_on(lattice, b):
                _take_step(lattice, b, p)
                taken += 1


@ti.func
def _is_swept(lattice: ti.template(), sweep) -> ti.i32:
    """Whether a sweep has columns and its lattice takes this step."""
    active = lattice.state.clock[sweep // lattice.sweeps].active
    return ti.i32(active and sweep % lattice.sweeps < lattice.counts[None].sweeps)


@ti.func
def _first_column(lattice: ti.template(), sweep) -> ti.i32:
    counts = lattice.counts[None]
    return sweep % lattice.sweeps * counts.columns // counts.sweeps


@ti.func
def _end_column(lattice: ti.template(), sweep) -> ti.i32:
    counts = lattice.counts[None]
    return (sweep % lattice.sweeps + 1) * counts.columns // counts.sweeps


@ti.kernel
def _begin_staged(lattice: ti.template()):
    """Begin a step: step size, history, neighbours, pushes and flow."""
    for b in range(lattice.batch):
        lattice.state.clock[b].active = clock.goes_on(lattice, b)
        if lattice.state.clock[b].active:
            p = lattice.model.parameters[b]
            clock.take_stock(lattice, b, p)
    for q in range(lattice.batch * lattice.sweeps * GRAIN):
        if q % GRAIN == 0:
            sweep = q // GRAIN
            b = sweep // lattice.sweeps
            if _is_swept(lattice, sweep) and clock.row_is_due(lattice, b):
                p = lattice.model.parameters[b]
                for i in range(_first_column(lattice, sweep), _end_column(lattice, sweep)):
                    ledger.energy_column(lattice, b, i, p)
    for b in range(lattice.batch):
        if lattice.state.clock[b].active:
            p = lattice.model.parameters[b]
            if clock.row_is_due(lattice, b):
                _write_row(lattice, b, p)
            _find_neighbours(lattice, b, p)
            lattice.state.clock[b].active = ti.i32(lattice.state.clock[b].status == RUNNING)
            if ti.static(lattice.features.self_contact):
                contact.push_pieces(lattice, b, 0, p)
    if ti.static(lattice.features.flows):
        for q in range(lattice.batch * lattice.sweeps * GRAIN):
            if q % GRAIN == 0:
                sweep = q // GRAIN
                b = sweep // lattice.sweeps
                if _is_swept(lattice, sweep):
                    p = lattice.model.parameters[b]
                    for i in range(_first_column(lattice, sweep), _end_column(lattice, sweep)):
                        bonds.flow_column(lattice, b, i, p)


@ti.kernel
def _stage_staged(lattice: ti.template(), stage: ti.i32):
    """One Runge-Kutta stage, its columns divided among sweeps.

    Sweeps move nodes as they proceed. So the forces at their seams, which depend on nodes on both
    sides, are computed before any sweep begins.
    """
    for q in range(lattice.batch * lattice.sweeps * GRAIN):
        if q % GRAIN == 0:
            sweep = q // GRAIN
            b = sweep // lattice.sweeps
            if _is_swept(lattice, sweep):
                p = lattice.model.parameters[b]
                start = _first_column(lattice, sweep)
                end = _end_column(lattice, sweep)
                for n in range(4):
                    i = ti.select(n < 2, start - 1 + n, end - 3 + n)
                    if i >= 0 and i < lattice.counts[None].columns:
                        slot = bonds.slot_of(lattice, i, end - 1)
                        own = start <= i and i < end
                        strip = ti.select(
                            own, i, lattice.counts[None].strips + sweep % lattice.sweeps
                        )
                        bonds.bond_column(lattice, stage, b, i, strip, sweep, slot, p)
    for q in range(lattice.batch * lattice.sweeps * GRAIN):
        if q % GRAIN == 0:
            sweep = q // GRAIN
            b = sweep // lattice.sweeps
            if _is_swept(lattice, sweep):
                p = lattice.model.parameters[b]
                start = _first_column(lattice, sweep)
                end = _end_column(lattice, sweep)
                _sweep(lattice, b, stage, sweep, start, end, start + 1, end - 1, p)
    for b in range(lattice.batch):
        if lattice.state.clock[b].active:
            p = lattice.model.parameters[b]
            nodes.stage_of_strips(lattice, b, stage, p)
            if stage == LAST_STAGE:
                _end_step(lattice, b, p)
            elif ti.static(lattice.features.self_contact):
                contact.push_pieces(lattice, b, stage + 1, p)


@ti.kernel
def _look_staged(lattice: ti.template()):
    """Update what cells hold at the end of a step."""
    for q in range(lattice.batch * lattice.sweeps * GRAIN):
        if q % GRAIN == 0:
            sweep = q // GRAIN
            b = sweep // lattice.sweeps
            if _is_swept(lattice, sweep):
                p = lattice.model.parameters[b]
                for i in range(_first_column(lattice, sweep), _end_column(lattice, sweep)):
                    cells.look_column(lattice, b, i, True, p)


def advance_staged(lattice: Lattice, most_steps: int) -> None:
    """Take up to `most_steps` steps of every running lattice, each spread over the threads."""
    for _ in range(most_steps):
        _begin_staged(lattice)
        for stage in range(LAST_STAGE + 1):
            _stage_staged(lattice, stage)
        if lattice.features.cells:
            _look_staged(lattice)
