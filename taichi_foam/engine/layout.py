"""Layout: how the fields of a batch of lattices with the same counts lie in memory."""

from dataclasses import dataclass
from typing import Any

from taichi_foam.backend import ti
from taichi_foam.engine import runtime
from taichi_foam.engine.lanes import CPU_LANES

# Room in the neighbour list, for each node: pairs, and candidates that have one. The paper's tests
# need up to 0.7 and 0.3. Shattered foam needs more; but then it is no big block.
SMALL_BLOCK = 50_000
PAIRS = {"small": 2.0, "big": 1.0}
CANDIDATES = {"small": 1.0, "big": 0.5}

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


# Room is made for so many lattices, columns and packs of rows, or twice as many, four times, ...
ROOM_LATTICES = (1, 16, 64)
ROOM_COLUMNS = 24
ROOM_PACKS = 6
# as long as no more nodes than these have room: bigger lattices have as much as they need
ROOM_NODES = 400_000
SWEEPS = 8  # of a lattice that is seldom swept by more than one thread


@dataclass(frozen=True)
class Size:
    """How many lattices there are side by side, and how many nodes one has."""

    batch: int
    columns: int
    rows: int

    @property
    def nodes(self) -> int:
        return self.columns * self.rows

    def room(self) -> "Size":
        """What room is made for, so that lattices of other sizes find theirs in the same fields.

        Kernels are compiled for the room. How many nodes there are they read from the device. A GPU
        and big lattices have what they need and no more.
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
    """How many sweeps so many columns are dealt out in, each of five at least."""
    return max(1, min(columns // 5, most))


def bins_of(count: int) -> int:
    """Bins of the search grid along so many columns or rows: foam that flies off has room."""
    return count + count // 4 + 4


class Layout:
    """What there is room for, and the trees that fields are placed in.

    batch, columns, rows, nodes   lattices side by side; nodes of one
    lanes, packs      nodes in a pack, packs in a column
    strips            groups of nodes that one thread takes at a time: columns on a CPU, THREADS a
                      block on a GPU
    sweeps            what the columns of one big lattice are dealt out in on a CPU, at most
    slots             columns of forces that are kept at a time
    blocks            of a GPU that one lattice is spread over
    most_pairs, most_candidates, bins_x, bins_y   room for self-contact

    Every field has a leading batch axis. Node fields are padded by one column and one pack on each
    side, so that a neighbour's index is always valid and a missing neighbour is only a bond that
    never was: their indices are (batch, -1..columns, -1..packs).

    Whole numbers have a tree of their own: Taichi's Vulkan backend packs fields without padding and
    reads a float at an address that is no multiple of eight from another one, in silence.
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
        size = "small" if self.nodes < SMALL_BLOCK else "big"
        self.most_pairs = int(PAIRS[size] * self.nodes)
        self.most_candidates = int(CANDIDATES[size] * self.nodes)
        self.bins_x, self.bins_y = bins_of(columns), bins_of(rows)
        self.pack = ti.types.vector(self.lanes, ti.f64)
        self.small_pack = ti.types.vector(self.lanes, ti.f32)
        self.whole_pack = ti.types.vector(self.lanes, ti.i32)
        self._numbers, self._whole = ti.FieldsBuilder(), ti.FieldsBuilder()
        self._padded = (batch, columns + 2, self.packs + 2)

    def of_nodes(self, *fields: Any, whole: bool = False) -> None:
        """Node fields, the packs of each field one after the other."""
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

        Numbers of nodes above one another then lie side by side, and a pack that is shifted by a
        node is one load.
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
        """(batch, strips + sweeps): columns at the seams of sweeps are looked at by two."""
        for field in fields:
            self._numbers.dense(ti.ij, (self.batch, self.strips + self.sweeps)).place(field)

    def of_all(self, counts: Any) -> None:
        """Whole numbers that all lattices share."""
        self._whole.place(counts)

    def of_lattices(self, *fields: Any) -> None:
        """(batch,), side by side: apart, lattices would share cache lines that one thread writes
        and another reads."""
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
