"""The state of a batch of lattices with the same counts, as Taichi fields.

Every field has a leading batch axis. Node fields are padded by one column and one pack on each
side, so that a neighbour's index is always valid and a missing neighbour is only a bond that
never was.
"""

import contextlib
from collections.abc import Iterator

import taichi as ti

from taichi_foam.engine import runtime
from taichi_foam.engine.packs import CPU_LANES
from taichi_foam.engine.parameters import MAX_EDGES, Parameters

# What a bond is (`condition`).
ABSENT = -1
BROKEN = 0
WHOLE = 1
BREAKING = 2  # whole until the end of this step

# A bond runs along its own axis (A along x, B along y); the other axis lies across it.
A = 0
B = 1

NEVER = 1e30

# Why a lattice no longer steps.
RUNNING = 0
AT_END_TIME = 1
AT_REBOUND = 2
NOT_FINITE = 3
CROWDED = 4
EMPTY = 5  # nothing was loaded, or it has been taken away

HISTORY_ROWS = 256  # kept on the device between two calls
ROW_VALUES = 18  # in each, see ledger.ROW_COLUMNS

# Room in the neighbour list, for each node: pairs, and nodes that have one. The paper's tests need
# up to 0.7 and 0.3. Shattered foam needs more; but then it is no big block.
SMALL_BLOCK = 50_000
PAIRS = {"small": 2.0, "big": 1.0}
TOUCHERS = {"small": 1.0, "big": 0.5}

# Members of a column's work, all in J and positive where the nodes lose energy.
FACES = 0  # normal stress, shear and dashpots together
SHEAR = 1
DASHPOTS = 2
DRAG = 3
IMPACTOR = 4
FRICTION = 5
BASE = 6
SELF_CONTACT = 7

LAST_STAGE = 3  # of the classical Runge-Kutta method, counted from 0

# Columns of forces that a sweep keeps: those left of, at and right of a node, the last one of the
# sweep and the one beyond it, and zeros for what is left and right of the lattice.
RING = 3
SWEEP_SLOTS = RING + 3

# Threads of a GPU's block. More would leave each too few registers for 64-bit numbers.
THREADS = 256
# Up to so many nodes one block steps a lattice by itself. It takes them in turns of THREADS, some
# 10 us of a step each; the kernels of a step that is spread over blocks take 100 us to start.
# Estimates: benchmarks/gpu.py measures them.
BLOCK_NODES = 4_096
# Blocks that a bigger lattice is spread over at most: as many as a large GPU runs at a time.
MOST_BLOCKS = 512

# Members of a GPU's sums over a lattice.
LIFT = 0  # on the impactor [N]
MOVED = 1  # furthest squared in this step [m2]
STIFFEST = 2  # densified bond [N/m]
OVERLAP = 3  # deepest so far in the impactor [m]
ASTRAY = 4  # less the lowest number of a node that is not finite
BREAKS = 5  # bonds that break in this step
ENERGIES = 6  # kinetic, stored, potential [J]; lost by breaking; works
ENERGY_SUMS = 12
SUMS = ENERGIES + ENERGY_SUMS


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
class Toucher:
    """A node that may touch others: what its pairs read, gathered in one place."""

    x: ti.f64  # [m]
    y: ti.f64
    u: ti.f64  # [m/s]
    v: ti.f64
    radius: ti.f64  # [m]


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
    pause: ti.f64  # time at which a call hands the lattice back
    drift: ti.f64  # how far any node can have moved since the neighbours were listed [m]
    steps: ti.i32
    status: ti.i32
    rows: ti.i32
    broken: ti.i32  # bonds broken so far
    bad_node: ti.i32
    stale: ti.i32  # the neighbour list is to be built again
    touchers: ti.i32  # nodes that have a pair in the neighbour list
    pairs: ti.i32  # in the list; a GPU counts each from both sides
    active: ti.i32  # takes part in the current step (staged stepping)
    spare: ti.i32  # an even number of them keeps Vulkan's records aligned, see Lattice


@ti.data_oriented
class Lattice:
    """Fields for `batch` lattices of `columns` x `rows` nodes.

    Node fields have the shape (batch, -1..columns, -1..packs); each element holds a pack of
    `lanes` nodes. Bond A(i, j) and B(i, j) are stored at node (i, j).
    """

    def __init__(self, batch: int, columns: int, rows: int) -> None:
        runtime.start()
        self.on_gpu = runtime.settings()["arch"] != "cpu"
        self.batch, self.columns, self.rows = batch, columns, rows
        self.nodes = columns * rows
        self.lanes = 1 if self.on_gpu else CPU_LANES
        self.packs = -(-rows // self.lanes)
        # strips: groups of nodes that one thread takes at a time; on a CPU they are columns, and
        # sweeps are what the columns of one big lattice are dealt out in
        self.strips = columns
        self.sweeps = max(1, min(columns // 5, 4 * int(runtime.settings()["threads"])))
        self.slots = SWEEP_SLOTS
        if self.on_gpu:
            # blocks that one lattice is spread over; each thread takes every `strips`-th node
            spread = min(-(-self.nodes // THREADS), MOST_BLOCKS)
            self.blocks = 1 if self.nodes <= BLOCK_NODES else spread
            self.strips = self.blocks * THREADS
            self.sweeps = 1
            self.slots = columns + 1  # all columns at once, and zeros left of the lattice
        size = "small" if self.nodes < SMALL_BLOCK else "big"
        self.most_pairs = int(PAIRS[size] * self.nodes)
        self.most_touchers = int(TOUCHERS[size] * self.nodes)
        self.bins_x, self.bins_y = columns + columns // 4 + 4, rows + rows // 4 + 4

        vec2 = ti.types.vector(2, ti.f64)
        vec3 = ti.types.vector(3, ti.f64)
        vec8 = ti.types.vector(8, ti.f64)
        pack = ti.types.vector(self.lanes, ti.f64)
        small_pack = ti.types.vector(self.lanes, ti.f32)
        motion = ti.types.struct(x=pack, y=pack, u=pack, v=pack)
        # `weights` are those of the differences of Eq. 13 (above and below an A, right and left of
        # a B; at its first node and at its second), `strength` is a bond's own over the mean
        # of all. An even number of 32-bit members, see below.
        bond = ti.types.struct(
            worst=pack, weights=ti.types.vector(self.lanes, ti.i32), condition=small_pack,
            break_time=small_pack, strength=small_pack,
        )  # fmt: skip

        self.state = motion.field()  # accepted: position [m], velocity [m/s]
        self.trial = motion.field()  # at the current stage
        self.rate = motion.field()  # weighted sum of the stages' time derivatives
        self.bond_a = bond.field()
        self.bond_b = bond.field()
        self.bonds = (self.bond_a, self.bond_b)
        # stretch of the friction springs: impactor, floor [m]
        self.slip = ti.types.struct(impactor=pack, floor=pack).field()

        # self-contact
        self.push = ti.types.struct(x=pack, y=pack).field()  # force [N]
        self.radius = pack.field()  # [m]
        self.room = pack.field()  # that the radius had when the node could first touch [m]
        self.surface = ti.types.vector(self.lanes, ti.i32).field()  # contact.INSIDE and so on
        self.bin_head = ti.field(ti.i32)
        self.next_in_bin = ti.field(ti.i32)

        # forces of the bonds [N]; on a CPU of the few columns that a sweep needs at a time
        self.force = ti.types.struct(ax=pack, ay=pack, bx=pack, by=pack).field()
        # and of a variational shear on the differences that cross them, per unit of their weight
        self.crossing = ti.types.struct(ax=pack, ay=pack, bx=pack, by=pack).field()

        # what a strip of nodes adds up; a sum over strips has one order on any machine
        self.tally = ti.types.struct(
            least=pack,  # strain
            sheared=pack,  # power of shear [W]
            damped=pack,  # and of the dashpots
            breaks=pack,  # bonds that break in this step
            by_faces=pack,  # power of all bonds at the stage [W]
            moved=pack,  # squared motion in the step [m2]
            astray=pack,  # nodes that are not finite
            reaction_x=pack,  # of the bodies on the pack at hand [N]
            reaction_y=pack,
        ).field()
        self.strip_stiffest = ti.field(ti.f64)  # densified bond [N/m]
        self.strip_lift = ti.field(ti.f64)  # its force on the impactor now [N]
        self.strip_overlap = ti.field(ti.f64)  # deepest so far in the impactor [m]
        self.strip_work = vec8.field()  # members FACES to SELF_CONTACT [J]
        self.strip_fracture = ti.field(ti.f64)  # stored energy lost by breaking [J]
        self.strip_energy = vec3.field()  # kinetic, stored, potential [J]
        self.column_breaks = ti.field(ti.i32)  # bonds that break in this step
        self.column_touchers = ti.field(ti.i32)

        self.parameters = Parameters.field()
        self.edges = vec3.field()
        self.body = Body.field()
        self.clock = Clock.field()
        self.history = ti.field(ti.f64)

        builder = ti.FieldsBuilder()
        padded, offset = (batch, columns + 2, self.packs + 2), (0, -1, -1)
        for field in (
            self.state, self.trial, self.rate, self.bond_a, self.bond_b, self.slip,
            self.push, self.radius, self.room,
        ):  # fmt: skip
            builder.dense(ti.ijk, padded).place(field, offset=offset)
        sweeps = batch * self.sweeps
        builder.dense(ti.ijk, (sweeps, self.slots, self.packs)).place(self.force, self.crossing)
        for field in (
            self.tally, self.strip_stiffest, self.strip_lift, self.strip_overlap,
            self.strip_work, self.strip_fracture, self.strip_energy,
        ):  # fmt: skip
            # the columns at the seams of sweeps are looked at by two, but count once
            builder.dense(ti.ij, (batch, self.strips + self.sweeps)).place(field)
        if self.on_gpu:
            self.sums = ti.field(ti.f64)  # of each block's strips
            builder.dense(ti.ijk, (batch, self.blocks, SUMS)).place(self.sums)
            self.totals = ti.field(ti.f64)  # of the lattice
            builder.dense(ti.ijk, (batch, 1, SUMS)).place(self.totals)
        else:
            self.touchers = Toucher.field()
            builder.dense(ti.ij, (batch, self.most_touchers)).place(self.touchers)
            # apart from what is read: a wide load behind a narrow store would wait for it
            self.toucher_push = vec2.field()  # [N]
            builder.dense(ti.ij, (batch, self.most_touchers)).place(self.toucher_push)
        # side by side: lattices apart would share cache lines that one thread writes, another reads
        builder.dense(ti.i, batch).place(self.parameters, self.body, self.clock)
        builder.dense(ti.ij, (batch, MAX_EDGES)).place(self.edges)
        builder.dense(ti.ijk, (batch, HISTORY_ROWS, ROW_VALUES)).place(self.history)
        builder.finalize()
        # whole numbers in a tree of their own: Taichi's Vulkan backend packs fields without padding
        # and reads a float at an address that is no multiple of eight from another one, in silence
        builder = ti.FieldsBuilder()
        builder.dense(ti.ijk, padded).place(self.surface, offset=offset)
        for field in (self.column_breaks, self.column_touchers):
            builder.dense(ti.ij, (batch, columns)).place(field)
        builder.dense(ti.ij, (batch, self.nodes)).place(self.next_in_bin)
        builder.dense(ti.ij, (batch, self.bins_x * self.bins_y)).place(self.bin_head)
        if self.on_gpu:
            # of each node: its bin, where the partners are listed that it may touch, and how many
            self.bin_of_node = ti.field(ti.i32)
            self.partner_start, self.partner_count = ti.field(ti.i32), ti.field(ti.i32)
            for field in (self.bin_of_node, self.partner_start, self.partner_count):
                builder.dense(ti.ij, (batch, self.nodes)).place(field)
            self.partners = ti.field(ti.i32)
            builder.dense(ti.ij, (batch, 2 * self.most_pairs)).place(self.partners)
        else:
            self.toucher_node = ti.field(ti.i32)
            builder.dense(ti.ij, (batch, self.most_touchers)).place(self.toucher_node)
            # nodes, then touchers, that may touch
            self.pairs = ti.types.vector(2, ti.i32).field()
            builder.dense(ti.ij, (batch, self.most_pairs)).place(self.pairs)
        builder.finalize()
        self.clock.get_member_field("status").fill(EMPTY)
        self.members = list(_members(self.parameters))


def _members(record) -> Iterator[tuple]:
    """The number fields of a record field, nested ones too: field, component of a vector, kind."""
    for name in record.keys:
        member = record.get_member_field(name)
        if isinstance(member, ti.StructField):
            yield from _members(member)
        elif isinstance(member, ti.MatrixField):
            yield from ((member, component, "vector") for component in range(member.n))
        else:
            yield member, 0, "integer" if member.dtype == ti.i32 else "number"


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
