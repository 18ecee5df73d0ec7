"""What goes to the device and what comes back, a lattice of a batch at a time."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from taichi_foam.backend import ti
from taichi_foam.engine import breaking, driving, lanes, makeup, stepping, virial
from taichi_foam.engine.grading import B
from taichi_foam.engine.lattice import Lattice
from taichi_foam.engine.model import Model, model_of
from taichi_foam.engine.scratch import HISTORY_ROWS, OVERLAP, SUMS
from taichi_foam.engine.state import (
    ABSENT,
    BODY,
    BROKEN,
    CLOCK,
    EMPTY,
    NEVER,
    TURN,
    WORKS,
    State,
    initial_state,
)
from taichi_foam.laws import elementary
from taichi_foam.laws.bond.base import TABLE_COLUMNS, TABLE_ROWS
from taichi_foam.records.history import row_columns
from taichi_foam.records.snapshot import Snapshot
from taichi_foam.scene import Block, Scene

Numbers = ti.types.ndarray(dtype=ti.f64, ndim=1)
Table = ti.types.ndarray(dtype=ti.f64, ndim=2)
Stack = ti.types.ndarray(dtype=ti.f64, ndim=3)
WholeNumbers = ti.types.ndarray(dtype=ti.i32, ndim=1)

vec2 = ti.types.vector(2, ti.f64)
vec3 = ti.types.vector(3, ti.f64)

# Of every lattice after a call: the clock's members that a run records, and the deepest overlap.
REPORT = ("status", "time", "rows", "steps", "shortest", "longest", "stable", "bad_node", "overlap")

# Of a node, as `_take_nodes` gives them: position, velocity, increment, stretch of
# both springs, room, surface, hold; of its bonds A and B: worst strain, time of breaking, share
# intact.
NODE_NUMBERS, BOND_NUMBERS = 11, 6


def load(lattice: Lattice, b: int, scene: Scene, state: State | None = None) -> None:
    """Set lattice `b` of the batch to a state of `scene`, by default to its start.

    The others go on. The lattice must have the scene's counts and features.
    """
    put_model(lattice, b, model_of(scene))
    state = initial_state(scene) if state is None else state
    put(lattice, b, state)
    stepping.prepare(lattice, b, knows_stiffest=state.clock["stiffest"] >= 0.0)


def unload(lattice: Lattice, b: int) -> None:
    """Take lattice `b` away: calls no longer step it."""
    lattice.state.clock[b].status = EMPTY


def put_model(lattice: Lattice, b: int, model: Model) -> None:
    """Set the constants of lattice `b`."""
    _put_numbers(lattice, b, model.numbers, model.surface)
    if model.hull is not None:
        _put_hull(lattice, b, model.hull)
    if model.pulse is not None:
        _put_pulse(lattice, b, model.pulse)
    if model.support is not None:
        _put_support(lattice, b, model.support)
    if model.strengths is not None:
        _put_strengths(lattice, b, model.strengths)
    if model.filling is not None:
        _put_filling(lattice, b, model.filling)
    if model.reach is not None:
        _put_reach(lattice, b, model.reach)
    if model.tables is not None:
        for n, table in enumerate(model.tables):
            _put_table(lattice, b, n, table)
    if model.foams is not None:
        _put_foams(lattice, b, model.foams, model.places.ravel())


@ti.kernel
def _put_numbers(lattice: ti.template(), b: ti.i32, numbers: Numbers, surface: Table):
    """All parameters in one call: setting them one by one takes longer than a short run."""
    for _ in range(1):
        for n in ti.static(range(len(lattice.model.members))):
            member, component, kind = ti.static(lattice.model.members[n])
            if ti.static(kind == "vector"):
                member[b][component] = numbers[n]
            elif ti.static(kind == "integer"):
                member[b] = ti.i32(numbers[n])
            else:
                member[b] = numbers[n]
    for row in range(surface.shape[0]):
        for c in ti.static(range(3)):
            lattice.model.surface[b, row][c] = surface[row, c]
    if ti.static(not lattice.features.shaped):
        for k in range(lattice.counts[None].packs):
            p = lattice.model.parameters[b]
            for lane in range(lattice.lanes):
                j = k * lattice.lanes + lane
                free = 1.0 / p.node_mass
                moves_y = not (p.hold_y and j == 0)
                lattice.model.mobility[b, k].x[lane] = ti.select(p.hold_x and j == 0, 0.0, free)
                lattice.model.mobility[b, k].y[lane] = ti.select(moves_y, free, 0.0)
                if ti.static(lattice.features.shaken):  # noqa: SIM102 - the static test stands alone
                    if j >= lattice.counts[None].rows:
                        lattice.model.mobility[b, k].y[lane] = 0.0
                falls = moves_y and j < lattice.counts[None].rows
                lattice.model.mobility[b, k].gravity[lane] = ti.select(falls, p.gravity, 0.0)


@ti.kernel
def _put_filling(lattice: ti.template(), b: ti.i32, filling: Stack):
    """Masses, faces and mobilities; what pads the lattice, or holds no foam, cannot be moved.

    Of columns that are alike one is kept, see `makeup.column`: those beside the lattice need none.
    """
    start, end = -1, lattice.counts[None].columns + 1
    if ti.static(lattice.features.alike):
        start, end = 0, 1
    for i in range(start, end):
        p = lattice.model.parameters[b]
        for k in range(-1, lattice.counts[None].packs + 1):
            for lane in range(lattice.lanes):
                j = k * lattice.lanes + lane
                mass, face_a, face_b, share, cell = 0.0, 0.0, 0.0, 0.0, 0.0
                x, y, gravity = 0.0, 0.0, 0.0
                if (
                    i >= 0
                    and i < lattice.counts[None].columns
                    and j >= 0
                    and j < lattice.counts[None].rows
                ):
                    mass, share, cell = filling[i, j, 0], filling[i, j, 4], filling[i, j, 5]
                    face_a, face_b = filling[i, j, 1], filling[i, j, 2]
                    stands = filling[i, j, 3] > 0.0
                    if mass > 0.0:
                        x = ti.select(p.hold_x and stands, 0.0, 1.0 / mass)
                        y = ti.select(p.hold_y and stands, 0.0, 1.0 / mass)
                        gravity = ti.select(y > 0.0, p.gravity, 0.0)
                lattice.model.filling[b, i, k].mass[lane] = mass
                lattice.model.filling[b, i, k].face_a[lane] = face_a
                lattice.model.filling[b, i, k].face_b[lane] = face_b
                lattice.model.filling[b, i, k].share[lane] = share
                lattice.model.filling[b, i, k].cell[lane] = cell
                lattice.model.mobility[b, i, k].x[lane] = x
                lattice.model.mobility[b, i, k].y[lane] = y
                lattice.model.mobility[b, i, k].gravity[lane] = gravity


@ti.kernel
def _put_reach(lattice: ti.template(), b: ti.i32, reach: Table):
    for i in range(lattice.counts[None].columns):
        for j in range(lattice.counts[None].rows):
            k, lane = lanes.pack_of(lattice, j), lanes.lane_of(lattice, j)
            lattice.model.reach[b, i, k][lane] = reach[i, j]


@ti.kernel
def _put_foams(lattice: ti.template(), b: ti.i32, foams: Table, places: WholeNumbers):
    """The foams, and each bond's own by rows; a pack's spare lanes have those of the last row."""
    for foam in range(lattice.features.foams):
        for n in ti.static(range(len(lattice.model.foam_members))):
            lattice.model.foam_members[n][0][b, foam] = foams[foam, n]
        if ti.static(lattice.features.law.tabulated):
            lattice.model.foams[b, foam].bond.place = b * lattice.features.foams + foam
    for j in range(lattice.counts[None].rows):
        for axis in ti.static(range(2)):
            place = places[axis * lattice.counts[None].rows + j]
            lattice.model.foam_of_row[b, axis * lattice.most_rows + j] = place
    for k in range(lattice.counts[None].packs):
        for lane in range(lattice.lanes):
            j = ti.min(k * lattice.lanes + lane, lattice.counts[None].rows - 1)
            for axis in ti.static(range(2)):
                foam = places[axis * lattice.counts[None].rows + j]
                for pair in ti.static(lattice.model.graded_members[axis]):
                    pair[0][b, axis * lattice.most_packs + k][lane] = pair[1][b, foam]


@ti.kernel
def _put_hull(lattice: ti.template(), b: ti.i32, hull: Table):
    for n in range(hull.shape[0]):
        lattice.model.hull[b, n] = vec2(hull[n, 0], hull[n, 1])


@ti.kernel
def _put_pulse(lattice: ti.template(), b: ti.i32, pulse: Table):
    for n in range(pulse.shape[0]):
        lattice.model.pulse[b, n] = vec2(pulse[n, 0], pulse[n, 1])


@ti.kernel
def _put_support(lattice: ti.template(), b: ti.i32, support: Table):
    for row in range(support.shape[0]):
        lattice.model.support[b, row] = vec3(support[row, 0], support[row, 1], support[row, 2])


@ti.kernel
def _put_strengths(lattice: ti.template(), b: ti.i32, strengths: Stack):
    for i in range(lattice.counts[None].columns):
        for j in range(lattice.counts[None].rows):
            k, lane = lanes.pack_of(lattice, j), lanes.lane_of(lattice, j)
            for axis in ti.static(range(2)):
                strength = ti.cast(strengths[i, j, axis], ti.f32)
                lattice.model.strengths[axis][b, i, k][lane] = strength


@ti.kernel
def _put_table(lattice: ti.template(), b: ti.i32, foam: ti.i32, table: Table):
    """That of one of the block's foams; the first one is also what is asked without a place."""
    place = b * lattice.features.foams + foam
    if foam == 0:
        lattice.model.parameters[b].bond.place = place
    for row in range(TABLE_ROWS):
        for column in ti.static(range(TABLE_COLUMNS)):
            lattice.model.table[place, row][column] = table[row, column]


def put(lattice: Lattice, b: int, state: State) -> None:
    """Set the state of lattice `b`, whose model is there; `stepping.prepare` has to follow."""
    strips = np.zeros((lattice.filled_strips, WORKS + 1))
    given = len(state.work)
    strips[:given, :WORKS], strips[:given, WORKS] = state.work, state.overlap
    numbers = np.array([*_values(state.clock, CLOCK), *_values(state.body, BODY)])
    # each array as it is: copies of a big lattice would be as large as the lattice itself
    nodes = (state.position, state.velocity, state.increment, state.stretch)
    bonds = (state.worst_a, state.worst_b, state.break_time_a, state.break_time_b)
    arrays = (*nodes, state.room, state.surface, state.hold, *bonds, state.intact_a, state.intact_b)
    _put_nodes(lattice, b, *(np.ascontiguousarray(array, np.float64) for array in arrays))
    _put_rest(lattice, b, strips, numbers)
    if lattice.features.turns:
        _put_turn(lattice, b, np.array(_values(state.turn, TURN)))
    if lattice.features.self_contact:
        _put_neighbours(lattice, b, state.neighbours)


def _values(numbers: Mapping[str, float], names: tuple[str, ...]) -> list[float]:
    return [numbers[name] for name in names]


@ti.kernel
def _put_nodes(
    lattice: ti.template(), b: ti.i32, position: Stack, velocity: Stack, increments: Stack,
    stretch: Stack, rooms: Table, surfaces: Table, holds: Table, worst_a: Table, worst_b: Table,
    break_time_a: Table, break_time_b: Table, intact_a: Table, intact_b: Table,
):  # fmt: skip
    """Nodes and bonds; what pads them stands still on the reference lattice, and holds nothing."""
    for i in range(-1, lattice.counts[None].columns + 1):
        p = lattice.model.parameters[b]
        for k in range(-1, lattice.counts[None].packs + 1):
            for lane in range(lattice.lanes):
                j = k * lattice.lanes + lane
                x = vec2(
                    (i - 0.5 * (lattice.counts[None].columns - 1)) * p.cell.x, (j + 0.5) * p.cell.y
                )
                v, increment, slip = vec2(0.0), vec2(0.0), vec2(0.0)
                room, surface = NEVER, 0
                if (
                    i >= 0
                    and i < lattice.counts[None].columns
                    and j >= 0
                    and j < lattice.counts[None].rows
                ):
                    x = vec2(position[i, j, 0], position[i, j, 1])
                    v = vec2(velocity[i, j, 0], velocity[i, j, 1])
                    increment = vec2(increments[i, j, 0], increments[i, j, 1])
                    slip = vec2(stretch[i, j, 0], stretch[i, j, 1])
                    room, surface = rooms[i, j], ti.i32(surfaces[i, j])
                for motion in ti.static((lattice.state.motion, lattice.scratch.trial)):
                    motion[b, i, k].x[lane] = x.x
                    motion[b, i, k].y[lane] = x.y
                    motion[b, i, k].u[lane] = v.x
                    motion[b, i, k].v[lane] = v.y
                lattice.state.increment[b, i, k].x[lane] = increment.x
                lattice.state.increment[b, i, k].y[lane] = increment.y
                lattice.state.slip[b, i, k].impactor[lane] = slip.x
                lattice.state.slip[b, i, k].floor[lane] = slip.y
                if ti.static(lattice.features.self_contact):
                    lattice.state.room[b, i, k][lane] = room
                    lattice.state.surface[b, i, k][lane] = surface
                    lattice.scratch.push[b, i, k].x[lane] = 0.0
                    lattice.scratch.push[b, i, k].y[lane] = 0.0
                hold, grip = 0.0, 0.0
                if (
                    i >= 0
                    and i < lattice.counts[None].columns - 1
                    and j >= 0
                    and j < lattice.counts[None].rows - 1
                ):
                    hold, grip = holds[i, j], holds[i, j]
                    if ti.static(lattice.features.shaped):
                        grip *= lattice.model.filling[b, makeup.column(lattice, i), k].cell[lane]
                if ti.static(lattice.features.cells):
                    lattice.state.hold[b, i, k][lane] = hold
                    lattice.state.grip[b, i, k][lane] = grip
                if ti.static(lattice.features.crushed_room):
                    lattice.scratch.presses[b, i, k] = 0
                for axis in ti.static(range(2)):
                    bond = ti.static(lattice.state.bonds[axis])
                    worsts = ti.static((worst_a, worst_b)[axis])
                    break_times = ti.static((break_time_a, break_time_b)[axis])
                    condition = ti.cast(ABSENT, ti.f32)
                    worst, broken_at, intact = 0.0, 0.0, 1.0
                    columns = lattice.counts[None].columns - ti.static(1 - axis)
                    rows = lattice.counts[None].rows - ti.static(axis)
                    if i >= 0 and i < columns and j >= 0 and j < rows:
                        worst = worsts[i, j]
                        broken_at = break_times[i, j]
                        intact = ti.static((intact_a, intact_b)[axis])[i, j]
                        condition = ti.cast(intact, ti.f32)
                        if ti.static(lattice.features.shaped):
                            column = makeup.column(lattice, i)
                            face = lattice.model.filling[b, column, k].face_a[lane]
                            if ti.static(axis == B):
                                face = lattice.model.filling[b, column, k].face_b[lane]
                            if face == 0.0:
                                condition = ti.cast(ABSENT, ti.f32)
                        if condition > ABSENT and not ti.math.isnan(broken_at):
                            condition = BROKEN
                        else:
                            broken_at = 0.0
                    bond[b, i, k].worst[lane] = worst
                    bond[b, i, k].condition[lane] = condition
                    bond[b, i, k].break_time[lane] = ti.cast(broken_at, ti.f32)
                    if ti.static(lattice.features.softens):
                        bond[b, i, k].intact[lane] = ti.cast(intact, ti.f32)


@ti.kernel
def _put_rest(lattice: ti.template(), b: ti.i32, strips: Table, numbers: Numbers):
    for strip in range(lattice.counts[None].strips):
        for n in ti.static(range(WORKS)):
            lattice.state.work[b, strip][n] = strips[strip, n]
        lattice.state.overlap[b, strip] = strips[strip, WORKS]
    for i in range(lattice.counts[None].columns):
        lattice.scratch.column_breaks[b, i] = 0
    if ti.static(lattice.on_gpu):
        for n in range(SUMS):
            lattice.scratch.totals[b, 0, n] = 0.0
    for _ in range(1):
        for n in ti.static(range(len(CLOCK))):
            member = ti.static(lattice.state.clock.get_member_field(CLOCK[n]))
            member[b] = ti.cast(numbers[n], member.dtype)
        for n in ti.static(range(len(BODY))):
            member = ti.static(lattice.state.body.get_member_field(BODY[n]))
            member[b] = numbers[ti.static(len(CLOCK)) + n]
        lattice.state.body[b].trial_y = lattice.state.body[b].y
        lattice.state.body[b].trial_v = lattice.state.body[b].v
        lattice.state.clock[b].rows = 0
        lattice.state.clock[b].active = 0
        lattice.state.clock[b].pause = 0.0
        if ti.static(lattice.features.shaken):
            p = lattice.model.parameters[b]
            now = driving.pulse_at(lattice, b, lattice.state.clock[b].time, p)
            lattice.scratch.shake[b] = now


@ti.kernel
def _put_turn(lattice: ti.template(), b: ti.i32, numbers: Numbers):
    for _ in range(1):
        for n in ti.static(range(len(TURN))):
            member = ti.static(lattice.state.turn.get_member_field(TURN[n]))
            member[b] = numbers[n]
        turn = lattice.state.turn[b]
        turn.trial_x, turn.trial_angle, turn.trial_u, turn.trial_spin = (
            turn.x, turn.angle, turn.u, turn.spin,
        )  # fmt: skip
        turn.sine, turn.cosine = elementary.sine_cosine(turn.angle)
        lattice.state.turn[b] = turn


@ti.kernel
def _take_turn(lattice: ti.template(), b: ti.i32, numbers: Numbers):
    for _ in range(1):
        for n in ti.static(range(len(TURN))):
            numbers[n] = ti.static(lattice.state.turn.get_member_field(TURN[n]))[b]


def _turn(lattice: Lattice, b: int) -> dict[str, float]:
    """The members of a turn by name, none where impactors do not turn."""
    if not lattice.features.turns:
        return {}
    numbers = np.empty(len(TURN))
    _take_turn(lattice, b, numbers)
    return dict(zip(TURN, numbers.tolist(), strict=True))


def take(lattice: Lattice, b: int) -> State:
    """The state of lattice `b` between two steps."""
    nodes = np.empty((lattice.size.columns, lattice.size.rows, NODE_NUMBERS))
    bonds = np.empty((lattice.size.columns, lattice.size.rows, BOND_NUMBERS))
    strips = np.empty((lattice.filled_strips, WORKS + 1))
    numbers = np.empty(len(CLOCK) + len(BODY))
    _take_nodes(lattice, b, nodes, bonds)
    _take_rest(lattice, b, strips, numbers)
    return State(
        position=nodes[..., 0:2].copy(),
        velocity=nodes[..., 2:4].copy(),
        increment=nodes[..., 4:6].copy(),
        stretch=nodes[..., 6:8].copy(),
        room=nodes[..., 8].copy(),
        surface=nodes[..., 9].copy(),
        hold=nodes[:-1, :-1, 10].copy(),
        worst_a=bonds[:-1, :, 0].copy(),
        worst_b=bonds[:, :-1, 1].copy(),
        break_time_a=bonds[:-1, :, 2].copy(),
        break_time_b=bonds[:, :-1, 3].copy(),
        intact_a=bonds[:-1, :, 4].copy(),
        intact_b=bonds[:, :-1, 5].copy(),
        clock=dict(zip(CLOCK, numbers[: len(CLOCK)].tolist(), strict=True)),
        body=dict(zip(BODY, numbers[len(CLOCK) :].tolist(), strict=True)),
        turn=_turn(lattice, b),
        work=strips[:, :WORKS].copy(),
        overlap=strips[:, WORKS].copy(),
        neighbours=_take_neighbours(lattice, b) if lattice.features.self_contact else {},
    )


def snapshot(lattice: Lattice, b: int, stressed: Block | None = None) -> Snapshot:
    """What a viewer sees of lattice `b` between two steps; of a `stressed` block with stresses."""
    nodes = np.empty((lattice.size.columns, lattice.size.rows, 4))
    bonds = np.empty((lattice.size.columns, lattice.size.rows, 4))
    _take_nodes(lattice, b, nodes, bonds)
    height, turn = lattice.state.body[b].y, _turn(lattice, b)
    return Snapshot(
        time=lattice.state.clock[b].time,
        impactor_y=np.nan if height == NEVER else height,
        position=nodes[..., :2].copy(),
        velocity=nodes[..., 2:].copy(),
        e_min_a=bonds[:-1, :, 0].copy(),
        e_min_b=bonds[:, :-1, 1].copy(),
        break_time_a=bonds[:-1, :, 2].copy(),
        break_time_b=bonds[:, :-1, 3].copy(),
        impactor_shift=turn.get("x", 0.0),
        impactor_angle=turn.get("angle", 0.0),
        stress=None if stressed is None else virial.stresses(lattice, b, stressed),
    )


@ti.kernel
def _take_nodes(lattice: ti.template(), b: ti.i32, nodes: Stack, bonds: Stack):
    """Of each node and its bonds as many numbers as there is room for."""
    for i in range(lattice.counts[None].columns):
        for j in range(lattice.counts[None].rows):
            k, lane = lanes.pack_of(lattice, j), lanes.lane_of(lattice, j)
            x = lanes.position(lattice, lattice.state.motion, b, i, j)
            v = lanes.velocity(lattice, lattice.state.motion, b, i, j)
            for c in ti.static(range(2)):
                nodes[i, j, c] = x[c]
                nodes[i, j, 2 + c] = v[c]
                bond = ti.static(lattice.state.bonds[c])
                bonds[i, j, c] = bond[b, i, k].worst[lane]
                broken_at = ti.cast(bond[b, i, k].break_time[lane], ti.f64)
                if bond[b, i, k].condition[lane] != BROKEN:  # nor what never was
                    broken_at = ti.math.nan
                bonds[i, j, 2 + c] = broken_at
                if bonds.shape[2] > 4:
                    bonds[i, j, 4 + c] = breaking.intact_share(lattice, c, b, i, j)
            if nodes.shape[2] > 4:
                nodes[i, j, 4] = lattice.state.increment[b, i, k].x[lane]
                nodes[i, j, 5] = lattice.state.increment[b, i, k].y[lane]
                nodes[i, j, 6] = lattice.state.slip[b, i, k].impactor[lane]
                nodes[i, j, 7] = lattice.state.slip[b, i, k].floor[lane]
                nodes[i, j, 8] = NEVER
                nodes[i, j, 9] = 0.0
                if ti.static(lattice.features.self_contact):
                    nodes[i, j, 8] = lattice.state.room[b, i, k][lane]
                    nodes[i, j, 9] = lattice.state.surface[b, i, k][lane]
                nodes[i, j, 10] = 1.0
                if ti.static(lattice.features.cells):
                    nodes[i, j, 10] = lattice.state.hold[b, i, k][lane]


@ti.kernel
def _take_rest(lattice: ti.template(), b: ti.i32, strips: Table, numbers: Numbers):
    for strip in range(lattice.counts[None].strips):
        for n in ti.static(range(WORKS)):
            strips[strip, n] = lattice.state.work[b, strip][n]
        strips[strip, WORKS] = lattice.state.overlap[b, strip]
    for _ in range(1):
        for n in ti.static(range(len(CLOCK))):
            numbers[n] = ti.static(lattice.state.clock.get_member_field(CLOCK[n]))[b]
        for n in ti.static(range(len(BODY))):
            member = ti.static(lattice.state.body.get_member_field(BODY[n]))
            numbers[ti.static(len(CLOCK)) + n] = member[b]


# The neighbour list: kept as it is, since sums go in its order.


def _listed(lattice: Lattice) -> dict[str, Any]:
    """Whole-number fields of the neighbour list, by their names in a state."""
    state = lattice.state
    names = (
        ("partners", "partner_start", "partner_count") if lattice.on_gpu else ("candidate_node",)
    )
    return {name: getattr(state, name) for name in names}


def _put_neighbours(lattice: Lattice, b: int, kept: Mapping[str, NDArray[Any]]) -> None:
    if not kept:
        _forget_neighbours(lattice, b)
        return
    for name, field in _listed(lattice).items():
        values = np.ascontiguousarray(kept[name], dtype=np.int32)
        _put_whole(field, b, values, len(values))
    if lattice.on_gpu:
        _put_gpu_radii(lattice, b, np.ascontiguousarray(kept["radius"]))
    else:
        pairs = np.ascontiguousarray(kept["pairs"], dtype=np.int32).ravel()
        _put_pairs(lattice, b, pairs, np.ascontiguousarray(kept["radius"]))


def _take_neighbours(lattice: Lattice, b: int) -> dict[str, NDArray[Any]]:
    state, kept = lattice.state, {}
    counts = {"candidate_node": state.clock[b].candidates, "partners": 2 * lattice.most_pairs}
    for name, field in _listed(lattice).items():
        kept[name] = np.zeros(counts.get(name, lattice.size.nodes), dtype=np.int32)
        _take_whole(field, b, kept[name], len(kept[name]))
    if lattice.on_gpu:
        kept["radius"] = np.zeros(lattice.size.nodes)
        _take_gpu_radii(lattice, b, kept["radius"])
    else:
        pairs = np.zeros(2 * state.clock[b].pairs, dtype=np.int32)
        kept["radius"] = np.zeros(state.clock[b].candidates)
        _take_pairs(lattice, b, pairs, kept["radius"])
        kept["pairs"] = pairs.reshape(-1, 2)
    return kept


@ti.kernel
def _put_whole(field: ti.template(), b: ti.i32, values: WholeNumbers, count: ti.i32):
    for n in range(count):
        field[b, n] = values[n]


@ti.kernel
def _take_whole(field: ti.template(), b: ti.i32, values: WholeNumbers, count: ti.i32):
    for n in range(count):
        values[n] = field[b, n]


@ti.kernel
def _forget_neighbours(lattice: ti.template(), b: ti.i32):
    if ti.static(lattice.on_gpu):
        for node in range(lattice.counts[None].nodes):
            lattice.state.partner_count[b, node] = 0
    else:
        for i in range(lattice.counts[None].columns):
            lattice.state.column_candidates[b, i] = 0


@ti.kernel
def _put_pairs(lattice: ti.template(), b: ti.i32, pairs: WholeNumbers, radius: Numbers):
    for i in range(lattice.counts[None].columns):
        lattice.state.column_candidates[b, i] = 0
    for _ in range(1):
        for n in range(lattice.state.clock[b].candidates):
            lattice.state.candidate[b, n].radius = radius[n]
            i = ti.raw_div(lattice.state.candidate_node[b, n], lattice.counts[None].rows)
            count = lattice.state.column_candidates[b, i]
            lattice.state.column_candidates[b, i] = count + 1
        for n in range(lattice.state.clock[b].pairs):
            for side in ti.static(range(2)):
                lattice.state.pairs[b, n][side] = pairs[2 * n + side]


@ti.kernel
def _take_pairs(lattice: ti.template(), b: ti.i32, pairs: WholeNumbers, radius: Numbers):
    for _ in range(1):
        for n in range(lattice.state.clock[b].candidates):
            radius[n] = lattice.state.candidate[b, n].radius
        for n in range(lattice.state.clock[b].pairs):
            for side in ti.static(range(2)):
                pairs[2 * n + side] = lattice.state.pairs[b, n][side]


@ti.kernel
def _put_gpu_radii(lattice: ti.template(), b: ti.i32, radius: Numbers):
    for node in range(lattice.counts[None].nodes):
        i, j = (
            ti.raw_div(node, lattice.counts[None].rows),
            ti.raw_mod(node, lattice.counts[None].rows),
        )
        lattice.state.radius[b, i, j][0] = radius[node]


@ti.kernel
def _take_gpu_radii(lattice: ti.template(), b: ti.i32, radius: Numbers):
    for node in range(lattice.counts[None].nodes):
        i, j = (
            ti.raw_div(node, lattice.counts[None].rows),
            ti.raw_mod(node, lattice.counts[None].rows),
        )
        radius[node] = lattice.state.radius[b, i, j][0]


@ti.kernel
def set_pause(lattice: ti.template(), times: Numbers):
    """Set the times [s] at which a call hands each lattice back."""
    for b in range(times.shape[0]):
        lattice.state.clock[b].pause = times[b]


def harvest(lattice: Lattice) -> tuple[dict[str, np.ndarray], list[np.ndarray]]:
    """Where every lattice stands (REPORT), and its rows (n, k) since the last harvest."""
    report = np.empty((lattice.size.batch, len(REPORT)))
    rows = np.empty((lattice.size.batch, HISTORY_ROWS, len(row_columns(lattice.features.turns))))
    _harvest(lattice, report, rows)
    standing = dict(zip(REPORT, report.T, strict=True))
    return standing, [rows[b, : int(n)].copy() for b, n in enumerate(standing["rows"])]


@ti.kernel
def _harvest(lattice: ti.template(), report: Table, rows: Stack):
    for b in range(report.shape[0]):
        clock = lattice.state.clock[b]
        overlap = 0.0
        if ti.static(lattice.on_gpu):
            overlap = lattice.scratch.totals[b, 0, OVERLAP]
        else:
            for strip in range(lattice.counts[None].strips):
                overlap = ti.max(overlap, lattice.state.overlap[b, strip])
        report[b, 0] = clock.status
        report[b, 1] = clock.time
        report[b, 2] = clock.rows
        report[b, 3] = clock.steps
        report[b, 4] = clock.shortest
        report[b, 5] = clock.longest
        report[b, 6] = clock.stable
        report[b, 7] = clock.bad_node
        report[b, 8] = overlap
        for r in range(clock.rows):
            for n in ti.static(range(len(row_columns(lattice.features.turns)))):
                rows[b, r, n] = lattice.scratch.history[b, r, n]
        lattice.state.clock[b].rows = 0
