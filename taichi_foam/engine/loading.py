"""What goes into a lattice of a batch and what comes out, a lattice at a time."""

from collections.abc import Iterator
from typing import Any

import numpy as np
import taichi as ti

from taichi_foam.engine import breaking, packs
from taichi_foam.engine.lattice import (
    ABSENT,
    BROKEN,
    EMPTY,
    HISTORY_ROWS,
    NEVER,
    OVERLAP,
    ROW_VALUES,
    RUNNING,
    SUMS,
    WHOLE,
    Body,
    Lattice,
)
from taichi_foam.engine.parameters import (
    MAX_EDGES,
    Parameters,
    impactor_edges,
    parameters_of,
)
from taichi_foam.engine.strengths import strengths
from taichi_foam.records.snapshot import Snapshot
from taichi_foam.scene import Scene

vec2 = ti.types.vector(2, ti.f64)
vec4 = ti.types.vector(4, ti.f64)
vec8 = ti.types.vector(8, ti.f64)
Numbers = ti.types.ndarray(dtype=ti.f64, ndim=1)
Table = ti.types.ndarray(dtype=ti.f64, ndim=2)
Stack = ti.types.ndarray(dtype=ti.f64, ndim=3)

# Of every lattice after a call: the clock's members that a run records, and the deepest overlap.
REPORT = ("status", "time", "rows", "steps", "shortest", "longest", "bad_node", "overlap")


def load(lattice: Lattice, b: int, scene: Scene) -> None:
    """Set lattice `b` of the batch to the start of `scene`; the others go on."""
    _set_members(lattice, b, np.array([*_numbers(Parameters, parameters_of(scene))]))
    _set_body(lattice, b, *_start_of_impactor(scene))
    _set_edges(lattice, b, impactor_edges(scene))
    gradient = np.asarray(scene.start.deformation_gradient, float) - np.eye(2)
    spin = np.asarray(scene.start.velocity_gradient, float)
    _set_start(lattice, b, vec4(*gradient.ravel()), vec4(*spin.ravel()))
    _set_strengths(lattice, b, strengths(scene))


def unload(lattice: Lattice, b: int) -> None:
    """Take lattice `b` away: calls no longer step it."""
    lattice.clock[b].status = EMPTY


def _numbers(record: Any, values: dict) -> Iterator[float]:
    """The numbers of a record, nested ones and vectors too, in the record's order."""
    for name, kind in record.members.items():
        value = values[name]
        if isinstance(value, dict):
            yield from _numbers(kind, value)
        elif isinstance(value, list):
            yield from value
        else:
            yield value


def _start_of_impactor(scene: Scene) -> tuple[float, float]:
    """Height [m] and velocity [m/s]: its lowest point meets the top row, or floats above."""
    if scene.impactor is None:
        return NEVER, 0.0
    y = scene.block.height - 0.5 * scene.block.dy + scene.impactor.gap
    return y, -scene.impactor.velocity


@ti.kernel
def _set_members(lattice: ti.template(), b: ti.i32, values: Numbers):
    """All parameters in one call: setting them one by one takes longer than a short run."""
    for _ in range(1):
        for n in ti.static(range(len(lattice.members))):
            member, component, kind = ti.static(lattice.members[n])
            if ti.static(kind == "vector"):
                member[b][component] = values[n]
            elif ti.static(kind == "integer"):
                member[b] = ti.i32(values[n])
            else:
                member[b] = values[n]


@ti.kernel
def _set_body(lattice: ti.template(), b: ti.i32, y: ti.f64, v: ti.f64):
    lattice.body[b] = Body(y=y, v=v, trial_y=y, trial_v=v)


@ti.kernel
def _set_edges(lattice: ti.template(), b: ti.i32, edges: Table):
    for n in range(MAX_EDGES):
        for c in ti.static(range(3)):
            lattice.edges[b, n][c] = edges[n, c]


@ti.kernel
def _set_start(lattice: ti.template(), b: ti.i32, gradient: vec4, spin: vec4):
    """Position, velocity, history and sums at the start.

    `gradient` is the deformation gradient without the unit matrix, so that an undeformed block
    starts on its reference to the last bit.
    """
    for i in range(-1, lattice.columns + 1):
        p = lattice.parameters[b]
        for k in range(-1, lattice.packs + 1):
            for lane in range(lattice.lanes):
                j = k * lattice.lanes + lane
                x = (i - 0.5 * (lattice.columns - 1)) * p.cell.x
                y = (j + 0.5) * p.cell.y
                arm = vec2(x, y - 0.5 * p.cell.y)
                x += arm.x * gradient[0] + arm.y * gradient[1]
                y += arm.x * gradient[2] + arm.y * gradient[3]
                u = arm.x * spin[0] + arm.y * spin[1]
                v = arm.x * spin[2] + arm.y * spin[3]
                inside = i >= 0 and i < lattice.columns and j >= 0 and j < lattice.rows
                if not inside or (j == 0 and p.hold_x):
                    u = 0.0
                if not inside or (j == 0 and p.hold_y):
                    v = 0.0
                for motion in ti.static((lattice.state, lattice.trial)):
                    motion[b, i, k].x[lane] = x
                    motion[b, i, k].y[lane] = y
                    motion[b, i, k].u[lane] = u
                    motion[b, i, k].v[lane] = v
                to_right = inside and i < lattice.columns - 1
                to_top = inside and j < lattice.rows - 1
                lattice.bond_a[b, i, k].condition[lane] = ti.select(to_right, WHOLE, ABSENT)
                lattice.bond_b[b, i, k].condition[lane] = ti.select(to_top, WHOLE, ABSENT)
            zeros = packs.zeros(lattice)
            no_weight = ti.cast(zeros, ti.f32)
            for bonds in ti.static(lattice.bonds):
                bonds[b, i, k].worst = zeros
                bonds[b, i, k].weights = ti.cast(zeros, ti.i32)
                bonds[b, i, k].break_time = no_weight
                bonds[b, i, k].strength = no_weight
            lattice.rate[b, i, k].x = zeros
            lattice.rate[b, i, k].y = zeros
            lattice.slip[b, i, k].impactor = zeros
            lattice.slip[b, i, k].floor = zeros
            lattice.push[b, i, k].x = zeros
            lattice.push[b, i, k].y = zeros
            lattice.surface[b, i, k] = ti.cast(zeros, ti.i32)
            lattice.room[b, i, k] = zeros + NEVER
    for i in range(lattice.columns):
        lattice.column_breaks[b, i] = 0
        lattice.column_touchers[b, i] = 0
    if ti.static(lattice.on_gpu):
        for n in range(SUMS):
            lattice.totals[b, 0, n] = 0.0
        for node in range(lattice.nodes):
            lattice.partner_count[b, node] = 0
    for strip in range(lattice.strips):
        lattice.strip_stiffest[b, strip] = 0.0
        lattice.strip_overlap[b, strip] = 0.0
        lattice.strip_fracture[b, strip] = 0.0
        lattice.strip_work[b, strip] = vec8(0.0)
    for _ in range(1):
        clock = lattice.clock[b]
        clock.time = 0.0
        clock.step = 0.0
        clock.shortest = NEVER
        clock.longest = 0.0
        clock.next_row = 0.0
        clock.last_contact = 0.0
        clock.reversal = NEVER
        clock.pause = 0.0
        clock.drift = 0.0
        clock.steps = 0
        clock.status = RUNNING
        clock.rows = 0
        clock.broken = 0
        clock.bad_node = lattice.nodes
        clock.stale = 1
        clock.touchers = 0
        clock.pairs = 0
        clock.active = 0
        lattice.clock[b] = clock


@ti.kernel
def _set_strengths(lattice: ti.template(), b: ti.i32, values: Stack):
    """How strong bonds are; without any strength they are broken from the start."""
    for i in range(lattice.columns):
        for j in range(lattice.rows):
            k = packs.pack_of(lattice, j)
            lane = packs.lane_of(lattice, j)
            for axis in ti.static(range(2)):
                bond = ti.static(lattice.bonds[axis])
                strength = values[i, j, axis]
                bond[b, i, k].strength[lane] = ti.cast(strength, ti.f32)
                if strength == 0.0 and bond[b, i, k].condition[lane] == WHOLE:
                    bond[b, i, k].condition[lane] = BROKEN


@ti.kernel
def set_pause(lattice: ti.template(), times: Numbers):
    """Set the times [s] at which a call hands each lattice back."""
    for b in range(lattice.batch):
        lattice.clock[b].pause = times[b]


def harvest(lattice: Lattice) -> tuple[dict[str, np.ndarray], list[np.ndarray]]:
    """Where every lattice stands (REPORT), and the rows (n, ROW_VALUES) since the last harvest."""
    report = np.empty((lattice.batch, len(REPORT)))
    rows = np.empty((lattice.batch, HISTORY_ROWS, ROW_VALUES))
    _harvest(lattice, report, rows)
    standing = dict(zip(REPORT, report.T, strict=True))
    return standing, [rows[b, : int(n)].copy() for b, n in enumerate(standing["rows"])]


@ti.kernel
def _harvest(lattice: ti.template(), report: Table, rows: Stack):
    for b in range(lattice.batch):
        clock = lattice.clock[b]
        overlap = 0.0
        if ti.static(lattice.on_gpu):
            overlap = lattice.totals[b, 0, OVERLAP]
        else:
            for strip in range(lattice.strips):
                overlap = ti.max(overlap, lattice.strip_overlap[b, strip])
        report[b, 0] = clock.status
        report[b, 1] = clock.time
        report[b, 2] = clock.rows
        report[b, 3] = clock.steps
        report[b, 4] = clock.shortest
        report[b, 5] = clock.longest
        report[b, 6] = clock.bad_node
        report[b, 7] = overlap
        for r in range(clock.rows):
            for n in ti.static(range(ROW_VALUES)):
                rows[b, r, n] = lattice.history[b, r, n]
        lattice.clock[b].rows = 0


def snapshot(lattice: Lattice, b: int) -> Snapshot:
    """The accepted state of lattice `b`."""
    motion = np.empty((lattice.columns, lattice.rows, 4))
    bonds = np.empty((lattice.columns, lattice.rows, 4))
    instant = np.empty(2)
    _copy_state(lattice, b, motion, bonds, instant)
    return Snapshot(
        time=float(instant[0]),
        impactor_y=float(instant[1]),
        position=motion[..., :2].copy(),
        velocity=motion[..., 2:].copy(),
        e_min_a=bonds[:-1, :, 0].copy(),
        e_min_b=bonds[:, :-1, 1].copy(),
        break_time_a=bonds[:-1, :, 2].copy(),
        break_time_b=bonds[:, :-1, 3].copy(),
    )


@ti.kernel
def _copy_state(lattice: ti.template(), b: ti.i32, motion: Stack, bonds: Stack, instant: Numbers):
    for i in range(lattice.columns):
        for j in range(lattice.rows):
            k = packs.pack_of(lattice, j)
            lane = packs.lane_of(lattice, j)
            x = packs.position(lattice, lattice.state, b, i, j)
            v = packs.velocity(lattice, lattice.state, b, i, j)
            for c in ti.static(range(2)):
                motion[i, j, c] = x[c]
                motion[i, j, 2 + c] = v[c]
                bond = ti.static(lattice.bonds[c])
                bonds[i, j, c] = bond[b, i, k].worst[lane]
                broken_at = ti.cast(bond[b, i, k].break_time[lane], ti.f64)
                if breaking.is_whole(lattice, c, b, i, j):
                    broken_at = ti.math.nan
                bonds[i, j, 2 + c] = broken_at
    for _ in range(1):
        instant[0] = lattice.clock[b].time
        instant[1] = lattice.body[b].y
        if lattice.parameters[b].impactor_kind == 0:
            instant[1] = ti.math.nan
