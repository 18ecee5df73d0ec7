"""The foam at a place in the block: its constants, and the share of cells and faces that it fills.

In a plain block of one foam these are the same everywhere, and kernels read them from the block's
constants. Otherwise the shares differ between mass points (`Features.shaped`), and the constants
between rows and between axes (`Features.foams`).
"""

from taichi_foam.backend import ti
from taichi_foam.engine import lanes
from taichi_foam.engine.grading import A


@ti.func
def column(lattice: ti.template(), i):
    """Column of the fields in which a shaped block keeps the values of column `i`."""
    if ti.static(lattice.features.alike):
        return 0
    return i


@ti.func
def constants(lattice: ti.template(), axis: ti.template(), b, k, p: ti.template()):
    """The law's constants for a pack of bonds along `axis`: scalars, or packs."""
    if ti.static(lattice.features.foams > 1):
        return lattice.model.graded[b, ti.static(axis) * ti.static(lattice.most_packs) + k].bond
    return p.bond


@ti.func
def shares(lattice: ti.template(), axis: ti.template(), b, k, p: ti.template()):
    """`model.SHARES` of a pack's bonds along `axis`: limits and dashpots by bond length."""
    if ti.static(lattice.features.foams > 1):
        return lattice.model.graded[b, ti.static(axis) * ti.static(lattice.most_packs) + k].shares
    if ti.static(axis == A):
        return p.a
    return p.b


@ti.func
def constants_at(lattice: ti.template(), axis, b, j, p: ti.template()):
    """The law's constants for a bond of row `j`; `axis` may be known only at run time."""
    if ti.static(lattice.features.foams > 1):
        foam = lattice.model.foam_of_row[b, axis * lattice.most_rows + j]
        return lattice.model.foams[b, foam].bond
    return p.bond


@ti.func
def face(lattice: ti.template(), axis: ti.template(), b, i, k, p: ti.template()):
    """Area of the faces of a pack of bonds along `axis` [m2]: a scalar, or a pack."""
    area = p.area[axis]
    if ti.static(not lattice.features.shaped):
        return area
    if ti.static(axis == A):
        return area * lattice.model.filling[b, column(lattice, i), k].face_a
    return area * lattice.model.filling[b, column(lattice, i), k].face_b


@ti.func
def wider_face(lattice: ti.template(), axis: ti.template(), b, i, j) -> ti.f64:
    """Share of the wider face of a mass point's two bonds along `axis`, in a shaped block."""
    k, lane = lanes.pack_of(lattice, j), lanes.lane_of(lattice, j)
    found = 0.0
    if ti.static(axis == A):
        filling = ti.static(lattice.model.filling.face_a)
        found = ti.max(
            filling[b, column(lattice, i), k][lane], filling[b, column(lattice, i - 1), k][lane]
        )
    else:
        filling = ti.static(lattice.model.filling.face_b)
        under, under_lane = lanes.pack_of(lattice, j - 1), lanes.lane_of(lattice, j - 1)
        found = ti.max(
            filling[b, column(lattice, i), k][lane],
            filling[b, column(lattice, i), under][under_lane],
        )
    return found


@ti.func
def volume(lattice: ti.template(), axis, b, i, j, p: ti.template()) -> ti.f64:
    """Reference volume [m3] that a bond represents."""
    found = ti.select(axis == A, p.area.x * p.cell.x, p.area.y * p.cell.y)
    if ti.static(lattice.features.shaped):
        k, lane = lanes.pack_of(lattice, j), lanes.lane_of(lattice, j)
        filling = lattice.model.filling[b, column(lattice, i), k]
        found *= ti.select(axis == A, filling.face_a[lane], filling.face_b[lane])
    return found


@ti.func
def mass(lattice: ti.template(), b, i, j, p: ti.template()) -> ti.f64:
    """Mass of a mass point [kg]; 0 where there is none."""
    found = p.node_mass
    if ti.static(lattice.features.shaped):
        k, lane = lanes.pack_of(lattice, j), lanes.lane_of(lattice, j)
        found = lattice.model.filling[b, column(lattice, i), k].mass[lane]
    return found


@ti.func
def share(lattice: ti.template(), b, i, j) -> ti.f64:
    """Share of a mass point's cell that is foam."""
    found = 1.0
    if ti.static(lattice.features.shaped):
        k, lane = lanes.pack_of(lattice, j), lanes.lane_of(lattice, j)
        found = lattice.model.filling[b, column(lattice, i), k].share[lane]
    return found


@ti.func
def reach(lattice: ti.template(), b, i, j) -> ti.f64:
    """Distance of a mass point from the foam's nearest face [m], in a shaped block."""
    k, lane = lanes.pack_of(lattice, j), lanes.lane_of(lattice, j)
    return lattice.model.filling[b, column(lattice, i), k].reach[lane]


@ti.func
def shares_of_points(lattice: ti.template(), b, i, k):
    """`share` of a pack's mass points."""
    found = lanes.zeros(lattice) + 1.0
    if ti.static(lattice.features.shaped):
        found = lattice.model.filling[b, column(lattice, i), k].share
    return found


@ti.func
def cell_share(lattice: ti.template(), b, i, k):
    """Share of a pack's lattice cells, each between four mass points, that is foam."""
    found = lanes.zeros(lattice) + 1.0
    if ti.static(lattice.features.shaped):
        found = lattice.model.filling[b, column(lattice, i), k].cell
    return found


@ti.func
def contact_stiffness(lattice: ti.template(), b, i, j, p: ti.template()) -> ti.f64:
    """Stiffness of a mass point's contact with a body [N/m], lower for a lighter mass point."""
    found = p.contact_stiffness
    if ti.static(lattice.features.shaped):
        found *= ti.min(mass(lattice, b, i, j, p) / p.node_mass, 1.0)
    return found


@ti.func
def mobility(lattice: ti.template(), b, i, k):
    """Inverse masses of a pack of mass points, and gravity; see `ModelFields`."""
    if ti.static(lattice.features.shaped):
        return lattice.model.mobility[b, column(lattice, i), k]
    return lattice.model.mobility[b, k]


@ti.func
def is_there(lattice: ti.template(), b, i, j) -> ti.i32:
    """Whether there is a mass point, that is, any foam."""
    found = 1
    if ti.static(lattice.features.shaped):
        k, lane = lanes.pack_of(lattice, j), lanes.lane_of(lattice, j)
        found = ti.i32(lattice.model.filling[b, column(lattice, i), k].mass[lane] > 0.0)
    return found


@ti.func
def is_held(lattice: ti.template(), b, i, j, p: ti.template()) -> ti.i32:
    """Whether the base holds a mass point, or there is none: bodies then do not touch it."""
    found = ti.i32(p.hold_y and j == 0)
    if ti.static(lattice.features.shaped):
        k, lane = lanes.pack_of(lattice, j), lanes.lane_of(lattice, j)
        found = ti.i32(lattice.model.mobility[b, column(lattice, i), k].y[lane] == 0.0)
    return found
