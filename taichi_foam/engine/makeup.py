"""The foam at a place in the block: its constants, and the share of cells and faces that it fills.

In a plain block of one foam these are the same everywhere, and kernels read them from the block's
constants. Otherwise the shares differ between mass points (`Features.shaped`), and the constants
between rows and between axes (`Features.foams`).
"""

from taichi_foam.backend import ti
from taichi_foam.engine import lanes
from taichi_foam.engine.grading import A, B


@ti.func
def column(lattice: ti.template(), i):
    """Column of the fields in which a shaped block keeps the values of column `i`."""
    if ti.static(lattice.features.alike):
        return 0
    return i


@ti.func
def _value(lattice: ti.template(), values: ti.template(), b, i, j):
    """A shaped block's value of mass point (i, j)."""
    return lanes.value(lattice, values, b, column(lattice, i), j)


@ti.func
def constants(lattice: ti.template(), axis: ti.template(), b, k, p: ti.template()):
    """The law's constants for a pack of bonds along `axis`: scalars, or packs."""
    if ti.static(lattice.features.foams > 1):
        return lattice.model.graded[b, ti.static(axis) * ti.static(lattice.most_packs) + k].bond
    return p.bond


@ti.func
def shares(lattice: ti.template(), axis: ti.template(), b, k, p: ti.template()):
    """`model.SHARES` of a pack's bonds along `axis`, as if their faces were whole."""
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
    return p.area[axis] * face_share(lattice, axis, b, i, k)


@ti.func
def face_share(lattice: ti.template(), axis: ti.template(), b, i, k):
    """Share of a whole cell's face that a pack of bonds along `axis` has: 1.0, or a pack."""
    if ti.static(not lattice.features.shaped):
        return 1.0
    if ti.static(axis == A):
        return lattice.model.filling[b, column(lattice, i), k].face_a
    return lattice.model.filling[b, column(lattice, i), k].face_b


@ti.func
def face_share_at(lattice: ti.template(), axis: ti.template(), b, i, j) -> ti.f64:
    """The same of the bond of mass point (i, j) along `axis`."""
    found = 1.0
    if ti.static(lattice.features.shaped):
        if ti.static(axis == A):
            found = _value(lattice, lattice.model.filling.face_a, b, i, j)
        else:
            found = _value(lattice, lattice.model.filling.face_b, b, i, j)
    return found


@ti.func
def wider_face(lattice: ti.template(), axis: ti.template(), b, i, j) -> ti.f64:
    """Share of the wider face of a mass point's two bonds along `axis`, in a shaped block."""
    before = face_share_at(lattice, axis, b, i - ti.static(1 - axis), j - ti.static(axis))
    return ti.max(face_share_at(lattice, axis, b, i, j), before)


@ti.func
def volume(lattice: ti.template(), axis, b, i, j, p: ti.template()) -> ti.f64:
    """Reference volume [m3] that a bond represents."""
    found = ti.select(axis == A, p.area.x * p.cell.x, p.area.y * p.cell.y)
    if ti.static(lattice.features.shaped):
        face_a = face_share_at(lattice, A, b, i, j)
        found *= ti.select(axis == A, face_a, face_share_at(lattice, B, b, i, j))
    return found


@ti.func
def mass(lattice: ti.template(), b, i, j, p: ti.template()) -> ti.f64:
    """Mass of a mass point [kg]; 0 where there is none."""
    found = p.node_mass
    if ti.static(lattice.features.shaped):
        found = _value(lattice, lattice.model.filling.mass, b, i, j)
    return found


@ti.func
def share(lattice: ti.template(), b, i, j) -> ti.f64:
    """Share of a mass point's cell that is foam."""
    found = 1.0
    if ti.static(lattice.features.shaped):
        found = _value(lattice, lattice.model.filling.share, b, i, j)
    return found


@ti.func
def reach(lattice: ti.template(), b, i, j) -> ti.f64:
    """Distance of a mass point from the foam's nearest face [m], in a shaped block."""
    return _value(lattice, lattice.model.filling.reach, b, i, j)


@ti.func
def edge(lattice: ti.template(), b, i, j) -> ti.f64:
    """How far foam reaches beyond a mass point to a body that touches it [m], uncrushed."""
    found = 0.0
    if ti.static(lattice.features.edged):
        found = _value(lattice, lattice.model.filling.edge, b, i, j)
    return found


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
        found = ti.i32(_value(lattice, lattice.model.filling.mass, b, i, j) > 0.0)
    return found


@ti.func
def is_held(lattice: ti.template(), b, i, j, p: ti.template()) -> ti.i32:
    """Whether the base holds a mass point, or there is none: bodies then do not touch it."""
    found = ti.i32(p.hold_y and j == 0)
    if ti.static(lattice.features.shaped):
        found = ti.i32(_value(lattice, lattice.model.mobility.y, b, i, j) == 0.0)
    return found
