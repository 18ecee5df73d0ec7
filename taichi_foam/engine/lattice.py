"""A batch of lattices of the same size and features: model, state and scratch on the device."""

import contextlib
from collections.abc import Iterator, Mapping
from typing import Any

from taichi_foam.backend import ti
from taichi_foam.engine import effort, runtime
from taichi_foam.engine.features import Features
from taichi_foam.engine.layout import Layout, Size, bins_of, sweeps_of
from taichi_foam.engine.model import ModelFields
from taichi_foam.engine.scratch import ScratchFields
from taichi_foam.engine.state import ARRAYS, EMPTY, StateFields, own_arrays

LAST_STAGE = 3  # of the classical Runge-Kutta method, counted from 0


@ti.dataclass
class Counts:
    """A lattice's size, as kernels read it."""

    columns: ti.i32
    rows: ti.i32
    nodes: ti.i32
    packs: ti.i32  # in a column
    strips: ti.i32  # strips that have nodes
    sweeps: ti.i32  # sweeps that have columns
    bins_x: ti.i32  # of the search grid
    bins_y: ti.i32


@ti.data_oriented
class Packs:
    """Node fields that are put or taken together: those of `names` that exist."""

    def __init__(self, fields: Mapping[str, Any], *names: str) -> None:
        self.names = [name for name in names if name in fields]
        self.fields = [fields[name] for name in self.names]


def _fields_of(part: Any) -> dict[str, Any]:
    """The fields of model, state or scratch by name; for records, the fields of their members."""
    found: dict[str, Any] = {}
    for name, field in vars(part).items():
        if isinstance(field, ti.StructField):
            found |= {f"{name}.{key}": field.get_member_field(key) for key in field.keys}
        elif isinstance(field, ti.Field):
            found[name] = field
    return found


@ti.data_oriented
class Lattice:
    """Fields for a batch of lattices of the same size; for the room allocated, see `Layout`.

    size      number of lattices, and their columns and rows: at most what there is room for
    counts    the same for kernels, with what follows from it
    model     constants of the lattices' scenes
    state     values that steps change
    scratch   working memory of the steps
    seen, kept    node fields that snapshots contain, and the others that states contain
    put           all node fields that putting a state sets
    made, apart   constants of nodes: those that identical columns share, and the others
    arrays        the declaration of each array that states contain
    own           of these, of what bonds remember besides their worst strain
    numbers, singles    names of the members of clock, body and turn, and their fields
    place     the SNode tree and number of its fields, which compiled kernels contain
    """

    def __init__(self, room: Size, features: Features) -> None:
        layout = Layout(room)
        self.features = features
        self.on_gpu, self.blocks = layout.on_gpu, layout.blocks
        self.batch, self.most_rows, self.most_packs = layout.batch, layout.rows, layout.packs
        self.lanes, self.slots = layout.lanes, layout.slots
        self.strips, self.sweeps = layout.strips, layout.sweeps
        self.most_pairs, self.most_candidates = layout.most_pairs, layout.most_candidates
        self.counts = Counts.field()
        layout.of_all(self.counts)
        self.model = ModelFields(layout, features)
        self.law = self.model.law
        self.state = StateFields(layout, features)
        self.scratch = ScratchFields(layout, features)
        layout.finish()
        self._sort()
        self.size = room
        whole = self.counts.snode.ptr
        self.place = whole.get_snode_tree_id(), whole.id

    def _sort(self) -> None:
        """Sort the fields by how they are transferred to the device and back."""
        fields = _fields_of(self.scratch) | _fields_of(self.state)
        self.own = own_arrays(self.features.law)
        self.arrays = ARRAYS | self.own
        kept = [name for told in self.arrays.values() for name in told.device if not told.seen]
        seen = [name for told in self.arrays.values() for name in told.device if told.seen]
        seen += ["bond_a.condition", "bond_b.condition"]
        if self.on_gpu:
            kept += ["radius"]  # of the neighbour list
        follow = [f"trial.{name}" for name in "xyuv"]
        self.seen, self.kept = Packs(fields, *seen), Packs(fields, *kept)
        self.put = Packs(fields, *seen, *kept, *follow, "grip", "place_in_list")
        fixed = _fields_of(self.model)
        made = [name for name in fixed if name.split(".")[0] in ("filling", "mobility")]
        self.made = Packs(fixed if self.features.shaped else {}, *made)
        self.apart = Packs(fixed, "strength_a", "strength_b")
        parts = ("clock", "body", "turn")
        self.numbers = [name for name in fields if name.split(".")[0] in parts]
        self.singles = [fields[name] for name in self.numbers]

    @property
    def filled_strips(self) -> int:
        """Number of strips that have nodes: on a CPU, the number of columns."""
        return self.strips if self.on_gpu else self.size.columns

    def resize(self, size: Size) -> None:
        """Make this a batch of `size`, with nothing loaded."""
        self.size = size
        sweeps = sweeps_of(size.columns, self.sweeps)
        bins = bins_of(size.columns), bins_of(size.rows)
        _put_counts(self, size.columns, size.rows, self.filled_strips, sweeps, *bins)


@ti.kernel
def _put_counts(
    lattice: ti.template(), columns: ti.i32, rows: ti.i32, strips: ti.i32, sweeps: ti.i32,
    bins_x: ti.i32, bins_y: ti.i32,
):  # fmt: skip
    for b in range(lattice.batch):
        lattice.state.clock[b].status = EMPTY
    for _ in range(1):
        lattice.counts[None].columns = columns
        lattice.counts[None].rows = rows
        lattice.counts[None].nodes = columns * rows
        lattice.counts[None].packs = (rows + lattice.lanes - 1) // lattice.lanes
        lattice.counts[None].strips = strips
        lattice.counts[None].sweeps = sweeps
        lattice.counts[None].bins_x = bins_x
        lattice.counts[None].bins_y = bins_y


MOST_IDLE = 12
"""From this many lattices on, idle ones are given up. Each takes some 40 MB with its kernels."""

_idle: dict[tuple[Size, Features, bool], list[Lattice]] = {}
_lent = 0


@contextlib.contextmanager
def borrowed(batch: int, columns: int, rows: int, features: Features) -> Iterator[Lattice]:
    """A lattice of this size and with these features for the duration of a run.

    Lattices are kept and lent again, also for other sizes, because Taichi compiles its kernels
    anew for every new set of fields. When many are idle, all are given up at once: Taichi frees the
    memory of kernels in no other way. For the compiler's optimisation level see `engine.effort`.
    """
    global _lent
    runtime.start()
    size = Size(batch, columns, rows)
    room = size.room()
    key = room, features, effort.pays(room, features)
    if not _idle.get(key):
        _give_up_idle()
    kept = _idle.setdefault(key, [])
    lattice = kept.pop() if kept else Lattice(room, features)
    with effort.spent(room, features, lattice.place):
        lattice.resize(size)
        _lent += 1
        try:
            yield lattice
        finally:
            _lent -= 1
            kept.append(lattice)


def _give_up_idle() -> None:
    """Forget all lattices, if there are many and none is lent.

    Does nothing if the program has Taichi fields of its own, which would be lost too.
    """
    made = sum(map(len, _idle.values()))
    if _lent == 0 and made >= MOST_IDLE and runtime.has_only(trees=made * Layout.TREES):
        _idle.clear()
        runtime.begin_anew()
