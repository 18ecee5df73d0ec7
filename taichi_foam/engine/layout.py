"""Layout: how the fields of a batch of lattices of the same size are laid out in memory."""

from dataclasses import dataclass
from typing import Any

from taichi_foam.backend import ti
from taichi_foam.engine import runtime
from taichi_foam.engine.lanes import CPU_LANES

# Room in the neighbour list per node of small and of big lattices: pairs, and candidates that have
# a pair. The paper's tests need up to 0.7 and 0.3; shattered foam needs more. Big blocks do not
# shatter as a whole: with 13,000 nodes the fastest cylinder and wedge need up to 0.32 and 0.20.
SMALL_BLOCK = 50_000
PAIRS = 2.0, 0.6
CANDIDATES = 1.0, 0.3

# Columns of forces that a sweep keeps: those left of, at and right of a node, the sweep's last
# column and the one beyond it, and a column of zeros for both sides of the lattice.
RING = 3
SWEEP_SLOTS = RING + 3

# Threads in a GPU block. More would leave each too few registers for 64-bit numbers.
THREADS = 256
# Up to this many nodes, one block steps a lattice alone. It handles THREADS nodes at a time, each
# time for some 50 us of a step on an NVIDIA H200. Launching the kernels of a step spread over
# blocks takes about 100 us, an estimate: this limit has not been tuned.
BLOCK_NODES = 4_096
# Most blocks that a bigger lattice is spread over: as many as a large GPU runs at a time.
MOST_BLOCKS = 512


# Room for lattices is one of ROOM_LATTICES; room for columns and for packs of rows is the number
# below or that number times a power of two.
ROOM_LATTICES = (1, 16, 64)
ROOM_COLUMNS = 24
ROOM_PACKS = 6
# Most nodes in the room for several lattices; beyond it, only the lattices needed get room.
ROOM_NODES = 400_000
SWEEPS = 8  # of a small lattice, which is seldom swept by more than one thread


@dataclass(frozen=True)
class Size:
    """Number of lattices in a batch, and the columns and rows of nodes in each."""

    batch: int
    columns: int
    rows: int

    @property
    def nodes(self) -> int:
        return self.columns * self.rows

    def room(self) -> "Size":
        """The size to allocate, rounded up so that lattices of other sizes fit the same fields.

        Kernels are compiled for the allocated size and read the number of nodes from the device.
        On a GPU, and for big lattices, exactly the required size is allocated.
        """
        if runtime.settings()["arch"] != "cpu" or self.nodes >= SMALL_BLOCK:
            return self
        columns = _doubled(ROOM_COLUMNS, self.columns)
        rows = _doubled(ROOM_PACKS * CPU_LANES, self.rows)
        most = ROOM_NODES // (columns * rows)
        found = [batch for batch in ROOM_LATTICES if self.batch <= batch <= most]
        return Size(found[0] if found else self.batch, columns, rows)


def _doubled(room: int, count: int) -> int:
    while room < count:
        room *= 2
    return room


def sweeps_of(columns: int, most: int) -> int:
    """Number of sweeps that the columns are divided into, each of at least five columns."""
    return max(1, min(columns // 5, most))


def _places(nodes: int, of_small: float, of_big: float) -> int:
    """Places in a list: no fewer in a bigger lattice."""
    return int(max(of_small * min(nodes, SMALL_BLOCK), of_big * nodes))


def bins_of(count: int) -> int:
    """Bins of the search grid along `count` columns or rows, with room for fragments flying off."""
    return count + count // 4 + 4


class Layout:
    """The room allocated, and the SNode trees that fields are placed in.

    batch, columns, rows, nodes   lattices in the batch; columns, rows and nodes of each
    lanes, packs      nodes in a pack, packs in a column
    strips            groups of nodes that one thread handles: columns on a CPU; on a GPU, THREADS
                      strips in each block
    sweeps            most sweeps that the columns of a lattice are divided into on a CPU
    slots             columns of forces that are kept at a time
    blocks            GPU blocks that one lattice is spread over
    most_pairs, most_candidates, bins_x, bins_y   room for self-contact

    Every field has a leading batch axis. Node fields are padded by one column and one pack on each
    side, so that a neighbour's index is always valid and a missing neighbour is merely an absent
    bond: their indices are (batch, -1..columns, -1..packs).

    Integers have a tree of their own: Taichi's Vulkan backend packs fields without padding, and a
    64-bit float whose address is not a multiple of eight is silently read from a wrong address.
    """

    TREES = 2

    def __init__(self, room: Size) -> None:
        settings = runtime.settings()
        self.on_gpu = settings["arch"] != "cpu"
        batch, columns, rows = room.batch, room.columns, room.rows
        self.batch, self.columns, self.rows, self.nodes = batch, columns, rows, room.nodes
        self.lanes = 1 if self.on_gpu else CPU_LANES
        self.packs = -(-rows // self.lanes)
        self.blocks = 1
        if self.on_gpu:
            spread = min(-(-self.nodes // THREADS), MOST_BLOCKS)
            self.blocks = 1 if self.nodes <= BLOCK_NODES else spread
            self.strips = self.blocks * THREADS  # each thread takes every `strips`-th node
            self.sweeps = 1
            self.slots = columns + 1  # all columns at once, and zeros left of the lattice
        else:
            self.strips = columns
            most = SWEEPS if self.nodes < SMALL_BLOCK else 4 * int(settings["threads"])
            self.sweeps = sweeps_of(columns, most)
            self.slots = SWEEP_SLOTS
        self.most_pairs = _places(self.nodes, *PAIRS)
        self.most_candidates = _places(self.nodes, *CANDIDATES)
        self.bins_x, self.bins_y = bins_of(columns), bins_of(rows)
        self.pack = ti.types.vector(self.lanes, ti.f64)
        self.small_pack = ti.types.vector(self.lanes, ti.f32)
        self.whole_pack = ti.types.vector(self.lanes, ti.i32)
        self._numbers, self._whole = ti.FieldsBuilder(), ti.FieldsBuilder()
        self._padded = (batch, columns + 2, self.packs + 2)

    def of_nodes(self, *fields: Any, whole: bool = False) -> None:
        """Node fields: (batch, -1..columns, -1..packs), the packs of each field contiguous."""
        for field in fields:
            tree = self._whole if whole else self._numbers
            tree.dense(ti.ijk, self._padded).place(field, offset=(0, -1, -1))

    def of_rows(self, *fields: Any) -> None:
        """Node fields that all columns share: (batch, 0, -1..packs)."""
        for field in fields:
            tree = self._numbers.dense(ti.ijk, (self.batch, 1, self.packs + 2))
            tree.place(field, offset=(0, 0, -1))

    def by_columns(self, *records: Any) -> None:
        """Node fields of several members: a column of the first, then of the second, and so on.

        The values of nodes above one another are then contiguous, and a pack shifted by one node is
        one load.
        """
        for record in records:
            column = self._numbers.dense(ti.ij, self._padded[:2])
            for name in record.keys:
                member = record.get_member_field(name)
                column.dense(ti.k, self._padded[2]).place(member, offset=(0, -1, -1))

    def of_sweeps(self, *records: Any) -> None:
        """Forces (sweeps of all lattices, slots, -1..packs-1) by columns, zeros below the first."""
        for record in records:
            column = self._numbers.dense(ti.ij, (self.batch * self.sweeps, self.slots))
            for name in record.keys:
                member = record.get_member_field(name)
                column.dense(ti.k, self.packs + 1).place(member, offset=(0, 0, -1))

    def listed_by_sweep(self, count: int, *records: Any) -> None:
        """(sweeps of all lattices, count) each."""
        for record in records:
            self._numbers.dense(ti.ij, (self.batch * self.sweeps, count)).place(record)

    def of_strips(self, *fields: Any) -> None:
        """(batch, strips + sweeps): columns at the seams of sweeps are visited by two sweeps."""
        for field in fields:
            self._numbers.dense(ti.ij, (self.batch, self.strips + self.sweeps)).place(field)

    def of_all(self, counts: Any) -> None:
        """Integers that all lattices share."""
        self._whole.place(counts)

    def of_lattices(self, *fields: Any) -> None:
        """(batch,), all fields of a lattice together: placed separately, lattices would share cache
        lines that one thread writes and another reads."""
        self._numbers.dense(ti.i, self.batch).place(*fields)

    def listed(self, count: int, *fields: Any, whole: bool = False) -> None:
        """(batch, count) each."""
        for field in fields:
            (self._whole if whole else self._numbers).dense(ti.ij, (self.batch, count)).place(field)

    def of_foams(self, foams: int, count: int, *fields: Any) -> None:
        """(batch * foams, count) each."""
        for field in fields:
            self._numbers.dense(ti.ij, (self.batch * foams, count)).place(field)

    def tabled(self, rows: int, columns: int, *fields: Any) -> None:
        """(batch, rows, columns) each."""
        for field in fields:
            self._numbers.dense(ti.ijk, (self.batch, rows, columns)).place(field)

    def finish(self) -> None:
        """Allocate everything; nothing can be placed afterwards."""
        self._numbers.finalize()
        self._whole.finalize()
