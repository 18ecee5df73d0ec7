"""Lanes: consecutive nodes of a column that the processor computes side by side, as a pack.

On a CPU a pack is four nodes, and every variable of the hot loops is a vector of four, from which
the compiler makes vector instructions; it would not vectorise scalar loops. On a GPU, whose threads
already are such lanes, a pack is one node. Row `j` of a column is lane `j % lanes` of pack
`j // lanes`; the last pack's spare lanes hold nodes without bonds.
"""

from taichi_foam.backend import ti

CPU_LANES = 4  # a power of two

vec2 = ti.types.vector(2, ti.f64)


@ti.func
def pack_of(lattice: ti.template(), j) -> ti.i32:
    """The pack of row `j`; a shift also rounds negative numbers down."""
    return j >> ti.static(lattice.lanes.bit_length() - 1)


@ti.func
def lane_of(lattice: ti.template(), j) -> ti.i32:
    """The lane of row `j` in its pack."""
    return j & ti.static(lattice.lanes - 1)


@ti.func
def column_and_row(lattice: ti.template(), node):
    """Column and row of a node from its number; nodes are numbered upwards, column by column."""
    rows = lattice.counts[None].rows
    return ti.raw_div(node, rows), ti.raw_mod(node, rows)


@ti.func
def reaches_up(lattice: ti.template(), k) -> ti.i32:
    """Whether any node of a pack has one above it; the top row may be alone in the last pack.

    Bonds B and cells of a pack without are not computed: what others read of them must be 0.
    """
    return ti.i32(k * lattice.lanes < lattice.counts[None].rows - 1)


@ti.func
def zeros(lattice: ti.template()):
    """A pack of zeros."""
    return ti.Vector.zero(ti.f64, ti.static(lattice.lanes))


@ti.func
def only(lattice: ti.template(), lane, value):
    """A pack with `value` in one lane and zeros elsewhere."""
    places = ti.Vector([ti.static(n) for n in ti.static(range(lattice.lanes))])
    return ti.select(places == lane, value, zeros(lattice))


@ti.func
def from_above(values: ti.template(), following):
    """For each lane the value of the node above it; `following` is the next pack's first value.

    If both come from a field with contiguous packs (`Layout.by_columns`), this compiles to one
    load.
    """
    lanes = ti.static(values.n)
    above = values
    for lane in ti.static(range(lanes - 1)):
        above[lane] = values[lane + 1]
    above[lanes - 1] = following
    return above


@ti.func
def from_below(values: ti.template(), preceding):
    """For each lane the value of the node below it; `preceding` is the pack below's last value."""
    below = values
    for lane in ti.static(range(1, values.n)):
        below[lane] = values[lane - 1]
    below[0] = preceding
    return below


@ti.func
def above(here: ti.template(), member: ti.template(), b, i, k):
    """For each lane of a node field's pack `here` the value of the node above it."""
    return from_above(here, member[b, i, k + 1][0])


@ti.func
def below(here: ti.template(), member: ti.template(), b, i, k):
    """For each lane of a node field's pack `here` the value of the node below it."""
    return from_below(here, member[b, i, k - 1][ti.static(here.n - 1)])


@ti.func
def value(lattice: ti.template(), values: ti.template(), b, i, j):
    """The value of node (i, j) in a node field, or of the bond or the cell that begins there."""
    return values[b, i, pack_of(lattice, j)][lane_of(lattice, j)]


@ti.func
def position(lattice: ti.template(), motion: ti.template(), b, i, j) -> vec2:
    """Position of node (i, j) [m] in `motion`, the lattice's accepted or trial motion."""
    return vec2(value(lattice, motion.x, b, i, j), value(lattice, motion.y, b, i, j))


@ti.func
def velocity(lattice: ti.template(), motion: ti.template(), b, i, j) -> vec2:
    """Velocity of node (i, j) [m/s] in `motion`."""
    return vec2(value(lattice, motion.u, b, i, j), value(lattice, motion.v, b, i, j))
