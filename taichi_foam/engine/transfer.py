"""Transfer to and from the device, one lattice of a batch at a time, and the choice of stepping."""

from collections.abc import Callable, Iterator, Mapping
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from taichi_foam.backend import ti
from taichi_foam.engine import cpu, driving, gpu, lanes, virial
from taichi_foam.engine.lattice import Lattice, Packs
from taichi_foam.engine.layout import BLOCK_NODES
from taichi_foam.engine.model import Model, model_of
from taichi_foam.engine.scratch import HISTORY_ROWS, OVERLAP, SUMS
from taichi_foam.engine.state import (
    ABSENT,
    BODY,
    BROKEN,
    CLOCK,
    EMPTY,
    TURN,
    UNLISTED,
    WORKS,
    State,
    initial_state,
    snapshot_of,
)
from taichi_foam.laws import elementary
from taichi_foam.laws.bond.base import TABLE_ROWS
from taichi_foam.records.history import row_columns
from taichi_foam.records.snapshot import Snapshot
from taichi_foam.scene import Block, Scene

Array = NDArray[np.float64]
Numbers = ti.types.ndarray(dtype=ti.f64, ndim=1)
Table = ti.types.ndarray(dtype=ti.f64, ndim=2)
Stack = ti.types.ndarray(dtype=ti.f64, ndim=3)
WholeNumbers = ti.types.ndarray(dtype=ti.i32, ndim=1)
AnyNumbers = ti.types.ndarray(ndim=1)

CLOCK_REPORT = ("status", "time", "rows", "steps", "shortest", "longest", "stable", "bad_node")
REPORT = (*CLOCK_REPORT, "overlap")
"""Reported for each lattice after a call: clock members that a run records, the largest overlap."""

# From this many nodes on, spreading a stage over a CPU's threads pays off.
STAGED_NODES = 50_000

AT_A_TIME = 500_000
"""Values copied at a time: a copy of a whole big lattice would need as much memory again."""


def load(lattice: Lattice, b: int, scene: Scene, state: State | None = None) -> None:
    """Set lattice `b` of the batch to a state of `scene`, by default to its start.

    The other lattices of the batch are unaffected. The lattice must have the scene's counts and
    features.
    """
    model = model_of(scene)
    _put_model(lattice, b, model)
    state = initial_state(scene) if state is None else state
    _put_nodes(lattice, lattice.put, b, _of_nodes(lattice, scene.block, state, model))
    _put_numbers(lattice, b, *_of_lattice(lattice, state))
    if lattice.features.self_contact:
        _put_neighbours(lattice, b, state.neighbours)
    _prepare(lattice, b, knows_stiffest=state.clock["stiffest"] >= 0.0)


def unload(lattice: Lattice, b: int) -> None:
    """Unload lattice `b`: calls no longer step it."""
    lattice.state.clock[b].status = EMPTY


def _prepare(lattice: Lattice, b: int, knows_stiffest: bool) -> None:
    """Derive from a state just put what its cells carry, and its stiffest bond if unknown.

    The stiffest bond has a kernel of its own: it compiles the whole bond law, and few states need
    it.
    """
    kernels = gpu if lattice.on_gpu else cpu
    if lattice.features.cells:
        kernels.look(lattice, b)
    if not knows_stiffest:
        kernels.find_stiffest(lattice, b)


# Constants.


def _put_model(lattice: Lattice, b: int, model: Model) -> None:
    """Set the constants of lattice `b`."""
    lists = [model.lists[name].ravel() for name, _ in lattice.model.lists]
    for n, (_, field) in enumerate(lattice.model.lists):
        lists[n] = np.pad(lists[n], (0, -len(lists[n]) % field.n))
    ends = np.cumsum([0, *map(len, lists)], dtype=np.int32)
    _put_constants(lattice, b, model.numbers, ends, np.concatenate(lists))
    for n, table in enumerate(model.tables):
        _put_table(lattice, b, n, table)
    if model.foams is not None:
        _put_foams(lattice, b, model.foams, model.places.ravel())
    parts = {name: (values.__getitem__, 0.0) for name, values in model.of_nodes.items()}
    _put_nodes(lattice, lattice.made, b, parts, (0, 1) if lattice.features.alike else None)
    _put_nodes(lattice, lattice.apart, b, parts)


@ti.kernel
def _put_constants(
    lattice: ti.template(), b: ti.i32, numbers: Numbers, ends: WholeNumbers, lists: Numbers
):
    """Set all constants in one call: one by one takes longer than a short run."""
    for _ in range(1):
        for n in ti.static(range(len(lattice.model.members))):
            member, component, kind = ti.static(lattice.model.members[n])
            if ti.static(kind == "vector"):
                member[b][component] = numbers[n]
            elif ti.static(kind == "integer"):
                member[b] = ti.i32(numbers[n])
            else:
                member[b] = numbers[n]
        for n in ti.static(range(len(lattice.model.lists))):
            field = ti.static(lattice.model.lists[n][1])
            for row in range(ti.raw_div(ends[n + 1] - ends[n], field.n)):
                for c in ti.static(range(field.n)):
                    field[b, row][c] = lists[ends[n] + row * field.n + c]


@ti.kernel
def _put_foams(lattice: ti.template(), b: ti.i32, foams: Table, places: WholeNumbers):
    """Set the foams and each row's foam; a pack's spare lanes get the last row's foam."""
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
def _put_table(lattice: ti.template(), b: ti.i32, foam: ti.i32, table: Table):
    """Set the table of one foam; the first foam's is also the lattice's default."""
    place = b * lattice.features.foams + foam
    if foam == 0:
        lattice.model.parameters[b].bond.place = place
    for row in range(TABLE_ROWS):
        for column in ti.static(range(lattice.law.table_columns)):
            lattice.model.table[place, row][column] = table[row, column]


# Values of nodes, bonds and cells.

Parts = Mapping[str, tuple[Callable[[slice], Array], Any]]
"""Fields by name: values by column and row, given some columns, and the values outside the block.

What follows from other arrays is computed as it is copied: whole, it would double a state's memory.
"""


def _of_nodes(lattice: Lattice, block: Block, state: State, model: Model) -> Parts:
    """A state's node fields on the device; padding nodes are at rest on the reference lattice."""
    parts: dict[str, tuple[Callable[[slice], Array], Any]] = {}
    arrays: dict[str, Array] = {}
    for name, told in lattice.arrays.items():
        values = state.own[name] if name in lattice.own else getattr(state, name)
        for n, device in enumerate(told.device):
            arrays[device] = values[..., n] if told.numbers else values
            parts[device] = arrays[device].__getitem__, told.beyond
    across = (np.arange(-1, block.columns + 1)[:, None] - 0.5 * (block.columns - 1)) * block.dx
    up = (np.arange(_height(lattice)) - lattice.lanes + 0.5) * block.dy
    parts["motion.x"] = parts["motion.x"][0], across
    parts["motion.y"] = parts["motion.y"][0], up

    def there(name: str, like: Array, columns: slice) -> Array | float:
        """A constant of the block's cells or faces; in a plain block they are all there."""
        if not lattice.features.shaped:
            return 1.0
        made = model.of_nodes[name]
        here = made if len(made) == 1 else made[columns]
        return here[: len(like), : like.shape[1]]

    def is_broken(bond: str, columns: slice) -> NDArray[np.bool_]:
        time = arrays[f"{bond}.break_time"][columns]
        return ~np.isnan(time) & (there(f"filling.face_{bond[-1]}", time, columns) != 0.0)

    def condition(bond: str, columns: slice) -> Array:
        intact = arrays[f"{bond}.intact"][columns]
        found = np.where(is_broken(bond, columns), BROKEN, intact)
        return np.where(there(f"filling.face_{bond[-1]}", intact, columns) == 0.0, ABSENT, found)

    def break_time(bond: str, columns: slice) -> Array:
        return np.where(is_broken(bond, columns), arrays[f"{bond}.break_time"][columns], 0.0)

    def grip(columns: slice) -> Array:
        return state.hold[columns] * there("filling.cell", state.hold[columns], columns)

    for bond in ("bond_a", "bond_b"):
        parts[f"{bond}.condition"] = partial(condition, bond), ABSENT
        parts[f"{bond}.break_time"] = partial(break_time, bond), 0.0
    parts["grip"] = grip, 0.0
    for member in "xyuv":
        parts[f"trial.{member}"] = parts[f"motion.{member}"]
    if lattice.on_gpu:
        radius = state.neighbours.get("radius", np.zeros(lattice.size.nodes))
        parts["radius"] = radius.reshape(block.columns, block.rows).__getitem__, 0.0
    else:
        candidates = state.neighbours.get("candidate_node", np.zeros(0, dtype=np.int32))
        places = np.full(lattice.size.nodes, UNLISTED, dtype=np.int32)
        places[candidates] = np.arange(len(candidates))
        places = places.reshape(block.columns, block.rows)
        parts["place_in_list"] = places.__getitem__, UNLISTED
    return parts


def _height(lattice: Lattice) -> int:
    """Rows of a column of packs, padding included."""
    return (-(-lattice.size.rows // lattice.lanes) + 2) * lattice.lanes


def _put_nodes(
    lattice: Lattice, packs: Packs, b: int, parts: Parts, columns: tuple[int, int] | None = None
) -> None:
    """Set fields of lattice `b` in a range of columns; by default in all, padding included."""
    if not packs.fields:
        return
    lanes_, height = lattice.lanes, _height(lattice)
    start, end = columns or (-1, lattice.size.columns + 1)
    count = max(1, AT_A_TIME // (len(packs.names) * height))
    for first in range(start, end, count):
        last = min(first + count, end)
        copied = np.empty((len(packs.names), last - first, height))
        for copy, name in zip(copied, packs.names, strict=True):
            values, beyond = parts[name]
            if np.ndim(beyond) == 2:
                beyond = beyond[first + 1 : last + 1]
            beyond = np.broadcast_to(beyond, copy.shape)
            here = values(slice(max(first, 0), last))
            low, high = max(-first, 0), max(-first, 0) + len(here)
            bottom, top = lanes_, lanes_ + here.shape[1]
            copy[low:high, bottom:top] = here
            for around in (np.s_[:low], np.s_[high:], np.s_[:, :bottom], np.s_[:, top:]):
                copy[around] = beyond[around]
        _put_packs(lattice, packs, b, first, copied)


@ti.kernel
def _put_packs(
    lattice: ti.template(), packs: ti.template(), b: ti.i32, first: ti.i32, values: Stack
):
    """Set columns from `first` on; the rows begin with the padding pack below the block."""
    for i in range(values.shape[1]):
        for n in ti.static(range(len(packs.fields))):
            field = ti.static(packs.fields[n])
            for row in range(values.shape[2]):
                k, lane = lanes.pack_of(lattice, row) - 1, lanes.lane_of(lattice, row)
                field[b, first + i, k][lane] = ti.cast(values[n, i, row], field.dtype)


def _take_nodes(lattice: Lattice, packs: Packs, b: int) -> Iterator[tuple[slice, dict[str, Array]]]:
    """Fields of lattice `b` by name, some columns at a time. The caller may change the arrays."""
    columns, rows = lattice.size.columns, lattice.size.rows
    count = max(1, AT_A_TIME // (len(packs.names) * rows))
    for first in range(0, columns, count):
        copied = np.empty((len(packs.names), min(count, columns - first), rows))
        _take_packs(lattice, packs, b, first, copied)
        yield slice(first, first + count), dict(zip(packs.names, copied, strict=True))


@ti.kernel
def _take_packs(
    lattice: ti.template(), packs: ti.template(), b: ti.i32, first: ti.i32, values: Stack
):
    for i in range(values.shape[1]):
        for j in range(values.shape[2]):
            k, lane = lanes.pack_of(lattice, j), lanes.lane_of(lattice, j)
            for n in ti.static(range(len(packs.fields))):
                values[n, i, j] = ti.cast(packs.fields[n][b, first + i, k][lane], ti.f64)


def _arrays(lattice: Lattice, b: int, packs: Packs, seen: bool) -> dict[str, Array]:
    """The arrays of a state that are `seen`, or those that are not."""
    size = lattice.size.columns, lattice.size.rows
    told = {name: each for name, each in lattice.arrays.items() if each.seen == seen}
    found = {name: np.empty(each.shape(*size)) for name, each in told.items()}
    for name, each in told.items():
        if each.device[0] not in packs.names:
            found[name][...] = each.start
    for columns, taken in _take_nodes(lattice, packs, b):
        if seen:
            for bond in ("bond_a", "bond_b"):  # whole and absent bonds have no time of breaking
                taken[f"{bond}.break_time"][taken[f"{bond}.condition"] != BROKEN] = np.nan
        for name, each in told.items():
            for n, device in enumerate(each.device):
                if device in taken:
                    into = found[name][..., n] if each.numbers else found[name]
                    part = into[columns]
                    part[...] = taken[device][: len(part), : part.shape[1]]
        if "radius" in taken:
            radius = found.setdefault("radius", np.empty(size))
            radius[columns] = taken["radius"]
    return found


# Values of a lattice and of its strips.


def _of_lattice(lattice: Lattice, state: State) -> tuple[Array, Array]:
    """A state's values that are not per node: those of each strip, and those of the lattice."""
    strips = np.zeros((lattice.filled_strips, WORKS + 1))
    given = len(state.work)
    strips[:given, :WORKS], strips[:given, WORKS] = state.work, state.overlap
    parts = {"clock": state.clock, "body": state.body, "turn": state.turn}
    told = {f"{part}.{name}": value for part, held in parts.items() for name, value in held.items()}
    for part, names in (("body", ("y", "v")), ("turn", ("x", "angle", "u", "spin"))):
        for name in names:
            told[f"{part}.trial_{name}"] = parts[part].get(name, 0.0)
    return strips, np.array([told.get(name, 0.0) for name in lattice.numbers])


@ti.kernel
def _put_numbers(lattice: ti.template(), b: ti.i32, strips: Table, numbers: Numbers):
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
        for n in ti.static(range(len(lattice.singles))):
            member = ti.static(lattice.singles[n])
            member[b] = ti.cast(numbers[n], member.dtype)
        if ti.static(lattice.features.turns):
            sine, cosine = elementary.sine_cosine(lattice.state.turn[b].angle)
            lattice.state.turn[b].sine = sine
            lattice.state.turn[b].cosine = cosine
        if ti.static(lattice.features.shaken):
            p = lattice.model.parameters[b]
            now = driving.pulse_at(lattice, b, lattice.state.clock[b].time, p)
            lattice.scratch.shake[b] = now


@ti.kernel
def _take_numbers(lattice: ti.template(), b: ti.i32, strips: Table, numbers: Numbers):
    for strip in range(lattice.counts[None].strips):
        for n in ti.static(range(WORKS)):
            strips[strip, n] = lattice.state.work[b, strip][n]
        strips[strip, WORKS] = lattice.state.overlap[b, strip]
    for _ in range(1):
        for n in ti.static(range(len(lattice.singles))):
            numbers[n] = ti.static(lattice.singles[n])[b]


def _numbers(lattice: Lattice, b: int) -> tuple[Array, dict[str, dict[str, float]]]:
    """Each strip's works and overlap; the members of clock, body and turn by name."""
    strips = np.empty((lattice.filled_strips, WORKS + 1))
    numbers = np.empty(len(lattice.numbers))
    _take_numbers(lattice, b, strips, numbers)
    told = dict(zip(lattice.numbers, numbers.tolist(), strict=True))
    kinds = {"clock": CLOCK, "body": BODY, "turn": TURN if lattice.features.turns else ()}
    held = {part: {name: told[f"{part}.{name}"] for name in names} for part, names in kinds.items()}
    return strips, held


def take(lattice: Lattice, b: int) -> State:
    """The state of lattice `b` between two steps."""
    strips, numbers = _numbers(lattice, b)
    arrays = {
        **_arrays(lattice, b, lattice.seen, True),
        **_arrays(lattice, b, lattice.kept, False),
    }
    radius = arrays.pop("radius", None)
    own = {name: arrays.pop(name) for name in lattice.own}
    clock, neighbours = numbers["clock"], {}
    if lattice.features.self_contact:
        neighbours = _take_neighbours(lattice, b, clock)
        if radius is not None:
            neighbours["radius"] = radius.ravel()
    return State(
        **arrays,
        clock=clock,
        body=numbers["body"],
        turn=numbers["turn"],
        work=strips[:, :WORKS].copy(),
        overlap=strips[:, WORKS].copy(),
        neighbours=neighbours,
        own=own,
    )


def snapshot(lattice: Lattice, b: int, stressed: Block | None = None) -> Snapshot:
    """A snapshot of lattice `b` between two steps; with stresses if `stressed` is its block."""
    stress = None if stressed is None else virial.stresses(lattice, b, stressed)
    arrays = _arrays(lattice, b, lattice.seen, True)
    own = {name: arrays.pop(name) for name in lattice.own}
    return snapshot_of(arrays, own, **_numbers(lattice, b)[1], stress=stress)


# The neighbour list. It is kept as it is, since its order is the order of sums.


def _put_neighbours(lattice: Lattice, b: int, kept: Mapping[str, NDArray[Any]]) -> None:
    if lattice.on_gpu:
        lists = dict(kept) or {"partner_count": np.zeros(lattice.size.nodes, dtype=np.int32)}
    else:
        lists = {name: values for name, values in kept.items() if name != "pairs"}
        if kept:
            lists["first"], lists["second"] = kept["pairs"].T
    for name, field in lattice.state.lists.items():
        if name in lists:
            _put_list(field, b, np.ascontiguousarray(lists[name], dtype=_kind(name)))


def _kind(name: str) -> type:
    """Type of the numbers of a neighbour list's field."""
    return np.float64 if name in ("radius", "torn") else np.int32


def _take_neighbours(
    lattice: Lattice, b: int, clock: Mapping[str, float]
) -> dict[str, NDArray[Any]]:
    nodes, pairs, candidates = lattice.size.nodes, int(clock["pairs"]), int(clock["candidates"])
    if lattice.on_gpu:
        counts = {
            "partners": 2 * lattice.most_pairs,
            "partner_start": nodes,
            "partner_count": nodes,
        }
    else:
        counts = {
            "candidate_node": candidates,
            "radius": candidates,
            "torn": candidates,
            "first": pairs,
            "second": pairs,
        }
    kept = {}
    for name, count in counts.items():
        kept[name] = np.zeros(count, dtype=_kind(name))
        _take_list(lattice.state.lists[name], b, kept[name])
    if not lattice.on_gpu:
        kept["pairs"] = np.stack([kept.pop("first"), kept.pop("second")], axis=1)
    return kept


@ti.kernel
def _put_list(field: ti.template(), b: ti.i32, values: AnyNumbers):
    for n in range(values.shape[0]):
        field[b, n] = values[n]


@ti.kernel
def _take_list(field: ti.template(), b: ti.i32, values: AnyNumbers):
    for n in range(values.shape[0]):
        values[n] = field[b, n]


# Calls.


def advance_of(lattice: Lattice) -> Callable[[Lattice, int], None]:
    """The faster function to step the lattices of a batch; its second argument limits the steps."""
    if lattice.on_gpu:
        return gpu.advance_blocks if lattice.size.nodes <= BLOCK_NODES else gpu.advance_wide
    return cpu.advance_staged if lattice.size.nodes >= STAGED_NODES else cpu.advance_fused


@ti.kernel
def set_pause(lattice: ti.template(), times: Numbers):
    """Set the time [s] at which a call stops stepping each lattice."""
    for b in range(times.shape[0]):
        lattice.state.clock[b].pause = times[b]


def harvest(lattice: Lattice) -> tuple[dict[str, np.ndarray], list[np.ndarray]]:
    """Each lattice's REPORT, and its history rows (n, k) since the last harvest."""
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
        for n in ti.static(range(len(CLOCK_REPORT))):
            member = ti.static(lattice.state.clock.get_member_field(CLOCK_REPORT[n]))
            report[b, n] = member[b]
        report[b, ti.static(len(CLOCK_REPORT))] = overlap
        for r in range(clock.rows):
            for n in ti.static(range(len(row_columns(lattice.features.turns)))):
                rows[b, r, n] = lattice.scratch.history[b, r, n]
        lattice.state.clock[b].rows = 0
