"""The state of a batch of lattices with the same counts, as Taichi fields.

Every field has a leading batch axis. Node fields are padded by one on each side, so that a
neighbour's index is always valid and a missing neighbour is only a connection that never was.
"""

import contextlib
from collections.abc import Iterator, Sequence

import numpy as np
import taichi as ti

from taichi_foam.engine import runtime
from taichi_foam.engine.parameters import MAX_EDGES, Parameters, impactor_edges, parameters_of
from taichi_foam.result import Snapshot
from taichi_foam.scene import Scene

# Members of a connection's four numbers.
AHEAD = 0  # factor of the half above (A) or right (B) in the mean of Eq. 13 [1/m]
BEHIND = 1  # factor of the half below (A) or left (B)
WORST = 2  # e_min
BREAK_TIME = 3  # time of breaking [s]; INTACT while whole, NEVER where no connection is

INTACT = -1.0
NEVER = 1e30

# Why a lattice no longer steps.
RUNNING = 0
AT_END_TIME = 1
AT_REBOUND = 2
NOT_FINITE = 3
CROWDED = 4

ROWS = 256  # of the history kept on the device between two calls
ROW_VALUES = 18  # in each, see ledger.ROW_COLUMNS
PAIRS_PER_NODE = 12  # room in the neighbour list; whole foam needs next to none


@ti.dataclass
class Body:
    """The impactor's vertical degree of freedom: y of its lowest point [m], upward velocity."""

    y: ti.f64
    v: ti.f64
    trial_y: ti.f64
    trial_v: ti.f64
    rate_y: ti.f64  # weighted sums of the RK4 stages
    rate_v: ti.f64
    force: ti.f64  # on the impactor at the current stage [N]
    support_work: ti.f64  # that the support has taken from it [J]


@ti.dataclass
class Clock:
    """Where one lattice stands in time."""

    time: ti.f64
    step: ti.f64
    shortest: ti.f64
    longest: ti.f64
    next_row: ti.f64
    last_contact: ti.f64
    reversal: ti.f64  # time of the impactor's zero velocity, NEVER before it
    steps: ti.i64
    status: ti.i32
    rows: ti.i32
    broken: ti.i32  # connections broken so far
    newly_broken: ti.i32  # by the last latch
    bad_node: ti.i32
    stale: ti.i32  # the neighbour list is to be built again
    active: ti.i32  # takes part in the current step (staged stepping)


@ti.data_oriented
class Lattice:
    """Fields for `batch` lattices of `columns` x `rows` nodes.

    Shapes: node fields (batch, -1..columns, -1..rows); connection A(i, j) and B(i, j) are stored
    at node (i, j).
    """

    def __init__(self, batch: int, columns: int, rows: int) -> None:
        runtime.start()
        self.batch, self.columns, self.rows = batch, columns, rows
        self.nodes = columns * rows
        self.bins_x, self.bins_y = columns + columns // 2 + 4, rows + rows // 2 + 4

        vec2 = ti.types.vector(2, ti.f64)
        vec3 = ti.types.vector(3, ti.f64)
        vec4 = ti.types.vector(4, ti.f64)
        vec8 = ti.types.vector(8, ti.f64)
        # grouped by four: a node's numbers share a cache line
        self.state = vec4.field()  # accepted (x, y, v_x, v_y)
        self.trial = vec4.field()  # at the current stage
        self.rate = vec4.field()  # weighted sum of the stages' time derivatives
        self.force = vec4.field()  # of the node's A and B faces (T_A, T_B) [N]
        self.link_a = vec4.field()  # AHEAD, BEHIND, WORST, BREAK_TIME
        self.link_b = vec4.field()
        self.links = (self.link_a, self.link_b)
        self.push = vec2.field()  # self-contact force [N]
        self.slip = vec2.field()  # stretch of the friction springs: impactor, floor [m]
        self.radius = ti.field(ti.f64)  # in self-contact [m]
        self.room = ti.field(ti.f64)  # that the radius had when the node could first touch [m]
        self.touching = ti.field(ti.i32)  # contact.INSIDE, AT_SURFACE or NEW
        self.anchor = vec2.field()  # where the node was when the neighbours were listed [m]

        # what a column of nodes adds up; a sum over columns has one order on any machine
        self.column_power = vec2.field()  # of shear and dashpots at the last latch [W]
        self.column_found = vec2.field()  # by the last latch: densified stiffness [N/m], breaks
        self.column_lift = ti.field(ti.f64)  # its force on the impactor now [N]
        self.column_overlap = ti.field(ti.f64)  # deepest so far in the impactor [m]
        self.column_bad = ti.field(ti.i32)  # first row that is not finite, or `rows`
        self.column_work = vec8.field()  # members in nodes.py [J]
        self.column_fracture = ti.field(ti.f64)  # stored energy lost by breaking [J]
        self.column_energy = vec3.field()  # kinetic, stored, potential [J]

        # the neighbour list: pairs[pair_start[n] : pair_start[n + 1]] are near node n
        self.pair_start = ti.field(ti.i32)
        self.pairs = ti.field(ti.i32)
        self.bin_head = ti.field(ti.i32)
        self.next_in_bin = ti.field(ti.i32)

        self.parameters = Parameters.field()
        self.edges = ti.types.vector(3, ti.f64).field()
        self.body = Body.field()
        self.clock = Clock.field()
        self.pause = ti.field(ti.f64)  # time at which a call hands a lattice back
        self.history = ti.field(ti.f64)

        builder = ti.FieldsBuilder()
        padded = (batch, columns + 2, rows + 2)
        offset = (0, -1, -1)
        for field in (
            self.state, self.trial, self.rate, self.force, self.link_a, self.link_b,
            self.push, self.slip, self.radius, self.room, self.touching, self.anchor,
        ):  # fmt: skip
            builder.dense(ti.ijk, padded).place(field, offset=offset)
        self.column_fields = (
            self.column_power, self.column_found, self.column_lift, self.column_overlap,
            self.column_bad, self.column_work, self.column_fracture, self.column_energy,
        )  # fmt: skip
        for field in self.column_fields:
            builder.dense(ti.ij, (batch, columns)).place(field)
        builder.dense(ti.ij, (batch, self.nodes)).place(self.next_in_bin)
        builder.dense(ti.ij, (batch, self.nodes + 1)).place(self.pair_start)
        builder.dense(ti.ij, (batch, self.bins_x * self.bins_y)).place(self.bin_head)
        builder.dense(ti.ij, (batch, PAIRS_PER_NODE * self.nodes)).place(self.pairs)
        for field in (self.parameters, self.body, self.clock, self.pause):
            builder.dense(ti.i, batch).place(field)
        builder.dense(ti.ij, (batch, MAX_EDGES)).place(self.edges)
        builder.dense(ti.ijk, (batch, ROWS, ROW_VALUES)).place(self.history)
        builder.finalize()

    def load(self, scenes: Sequence[Scene]) -> None:
        """Set every field to the start of `scenes`, one for each lattice of the batch."""
        if len(scenes) != self.batch:
            raise ValueError(f"{len(scenes)} scenes for a batch of {self.batch}")
        shape = (self.batch, self.columns + 2, self.rows + 2)
        state = np.zeros((*shape, 4))
        link_a = np.zeros((*shape, 4))
        link_a[..., BREAK_TIME] = NEVER
        link_b = link_a.copy()
        link_a[:, 1:-2, 1:-1, BREAK_TIME] = INTACT
        link_b[:, 1:-1, 1:-2, BREAK_TIME] = INTACT
        edges = np.stack([impactor_edges(scene) for scene in scenes])
        for b, scene in enumerate(scenes):
            state[b, 1:-1, 1:-1] = start_state(scene)
            self.parameters[b] = _record(Parameters, parameters_of(scene))
            self.body[b] = _record(Body, body_of(scene))
            self.clock[b] = Clock(reversal=NEVER, shortest=NEVER, bad_node=self.nodes, stale=1)
        self.state.from_numpy(state)
        self.trial.from_numpy(state)
        self.link_a.from_numpy(link_a)
        self.link_b.from_numpy(link_b)
        self.edges.from_numpy(edges)
        for field in (
            self.rate, self.force, self.push, self.slip, self.touching, *self.column_fields,
        ):  # fmt: skip
            field.fill(0)
        self.room.fill(NEVER)

    def snapshots(self) -> list[Snapshot]:
        """The accepted state of every lattice, copied."""
        inner = (slice(None), slice(1, -1), slice(1, -1))
        state = self.state.to_numpy()[inner]
        link_a = self.link_a.to_numpy()[inner][:, :-1]
        link_b = self.link_b.to_numpy()[inner][:, :, :-1]
        breaks = [np.where(link[..., BREAK_TIME] < 0, np.nan, link[..., BREAK_TIME])
                  for link in (link_a, link_b)]  # fmt: skip
        heights, times = self.body.y.to_numpy(), self.clock.time.to_numpy()
        kinds = self.parameters.impactor_kind.to_numpy()
        return [
            Snapshot(
                time=float(times[b]),
                impactor_y=float(heights[b]) if kinds[b] else float("nan"),
                position=state[b, ..., :2].copy(),
                velocity=state[b, ..., 2:].copy(),
                e_min_a=link_a[b, ..., WORST].copy(),
                e_min_b=link_b[b, ..., WORST].copy(),
                break_time_a=breaks[0][b],
                break_time_b=breaks[1][b],
            )
            for b in range(self.batch)
        ]


_idle: dict[tuple[int, int, int], list[Lattice]] = {}


@contextlib.contextmanager
def borrowed(batch: int, columns: int, rows: int) -> Iterator[Lattice]:
    """A lattice of these counts for the time of a run.

    Lattices are kept and lent again: Taichi compiles its kernels anew for every new set of
    fields, and a process can hold only so many of them.
    """
    kept = _idle.setdefault((batch, columns, rows), [])
    lattice = kept.pop() if kept else Lattice(batch, columns, rows)
    try:
        yield lattice
    finally:
        kept.append(lattice)


def reference_positions(columns: int, rows: int, dx: float, dy: float) -> np.ndarray:
    """Cell centres (columns, rows, 2) [m]; x is mirror-symmetric to the last bit."""
    x = (np.arange(columns) - 0.5 * (columns - 1)) * dx
    y = (np.arange(rows) + 0.5) * dy
    return np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1)


def start_state(scene: Scene) -> np.ndarray:
    """(x, y, v_x, v_y) of every node at the start, (columns, rows, 4) [m, m/s]."""
    block = scene.block
    reference = reference_positions(block.columns, block.rows, block.dx, block.dy)
    foot = np.array([0.0, 0.5 * block.dy])
    arm = reference - foot
    gradient = np.asarray(scene.start.deformation_gradient, float)
    spin = np.asarray(scene.start.velocity_gradient, float)
    # added to the reference, so that an undeformed block starts on it to the last bit
    position = reference + arm @ (gradient - np.eye(2)).T
    velocity = arm @ spin.T
    velocity[:, 0, 0] *= scene.base.kind != "gripped"
    velocity[:, 0, 1] *= scene.base.kind == "floor"
    return np.concatenate([position, velocity], axis=-1)


def body_of(scene: Scene) -> dict:
    """The impactor's record at the start: its lowest point meets the top row, or floats above."""
    if scene.impactor is None:
        return {}
    y = scene.block.height - 0.5 * scene.block.dy + scene.impactor.gap
    v = -scene.impactor.velocity
    return {"y": y, "v": v, "trial_y": y, "trial_v": v}


def _record(kind, values: dict):
    """Build a Taichi record from nested plain values."""
    return kind(**{
        key: _record(kind.members[key], value) if isinstance(value, dict) else value
        for key, value in values.items()
    })  # fmt: skip
