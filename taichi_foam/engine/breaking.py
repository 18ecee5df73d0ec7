"""What has become of the bonds: which are whole, which break or soften now, and what they lose."""

from taichi_foam.backend import ti
from taichi_foam.engine import lanes, makeup
from taichi_foam.engine.grading import A, B
from taichi_foam.engine.state import BREAKING, BROKEN, LOST_BY_BONDS, book
from taichi_foam.laws import kinematics


@ti.func
def look_at(lattice: ti.template(), axis, b, i, j, p: ti.template()):
    """Condition, worst and present strain of the accepted state's bond (i, j) along `axis`.

    The axis may be known at run time only.
    """
    k, lane = lanes.pack_of(lattice, j), lanes.lane_of(lattice, j)
    start = lanes.position(lattice, lattice.state.motion, b, i, j)
    condition = lattice.state.bond_a[b, i, k].condition[lane]
    worst = lattice.state.bond_a[b, i, k].worst[lane]
    length = p.cell.x
    end = lanes.position(lattice, lattice.state.motion, b, i + 1, j)
    if axis == B:
        condition = lattice.state.bond_b[b, i, k].condition[lane]
        worst = lattice.state.bond_b[b, i, k].worst[lane]
        length = p.cell.y
        end = lanes.position(lattice, lattice.state.motion, b, i, j + 1)
    strain = kinematics.engineering_strain((end - start).norm() / length)
    return condition, worst, strain


@ti.func
def intact_share(lattice: ti.template(), axis, b, i, j) -> ti.f64:
    """Share of a bond's face that carries tension and shear."""
    share = 1.0
    if ti.static(lattice.features.softens):
        k, lane = lanes.pack_of(lattice, j), lanes.lane_of(lattice, j)
        share = ti.cast(lattice.state.bond_a[b, i, k].intact[lane], ti.f64)
        if axis == B:
            share = ti.cast(lattice.state.bond_b[b, i, k].intact[lane], ti.f64)
    return share


@ti.func
def is_pulled(lattice: ti.template(), c: ti.template(), strain, worst) -> ti.i32:
    numerator, _ = lattice.law.stress_fraction(c, strain, worst, 0)
    return ti.i32(numerator > 0.0)


@ti.func
def soften_bonds(lattice: ti.template(), b, i, p: ti.template()):
    """At the end of a step: parts of the faces of column `i`'s bonds are lost from now on."""
    lost = 0.0
    for j in range(lattice.counts[None].rows):
        lost = soften_at(lattice, b, i, j, lost, p)
    book(lattice, b, i, LOST_BY_BONDS, lost)


@ti.func
def soften_at(lattice: ti.template(), b, i, j, lost: ti.f64, p: ti.template()) -> ti.f64:
    """Take from a node's bonds what they lose; the energy stored there is added to `lost` [J]."""
    k, lane = lanes.pack_of(lattice, j), lanes.lane_of(lattice, j)
    total = lost
    for axis in range(2):  # not unrolled: the law is long, and compiles once so
        left, worst, strain = look_at(lattice, axis, b, i, j, p)
        intact = intact_share(lattice, axis, b, i, j)
        if left > BROKEN and left < intact:
            c = makeup.constants_at(lattice, axis, b, j, p)
            if is_pulled(lattice, c, strain, worst):
                stored = lattice.law.stored_energy(c, strain, worst, 0)
                total += makeup.volume(lattice, axis, b, i, j, p) * (intact - left) * stored
            if axis == A:
                lattice.state.bond_a[b, i, k].intact[lane] = ti.cast(left, ti.f32)
            else:
                lattice.state.bond_b[b, i, k].intact[lane] = ti.cast(left, ti.f32)
    return total


@ti.func
def break_bonds(lattice: ti.template(), b, i, p: ti.template()):
    """At the end of a step: column `i`'s failed bonds are broken from now on.

    The stored energy that they lose is booked [J].
    """
    time = ti.cast(lattice.state.clock[b].time, ti.f32)
    lost = 0.0
    for j in range(lattice.counts[None].rows):
        lost = break_at(lattice, b, i, j, time, lost, p)
    book(lattice, b, i, LOST_BY_BONDS, lost)


@ti.func
def break_at(
    lattice: ti.template(), b, i, j, time: ti.f32, lost: ti.f64, p: ti.template()
) -> ti.f64:
    """Break a node's failed bonds; what they lose is added to `lost`, and comes back."""
    k, lane = lanes.pack_of(lattice, j), lanes.lane_of(lattice, j)
    total = lost
    for axis in range(2):
        condition, worst, strain = look_at(lattice, axis, b, i, j, p)
        if condition == BREAKING:
            c = makeup.constants_at(lattice, axis, b, j, p)
            energy = lattice.law.energy_lost_by_breaking(c, strain, worst)
            if ti.static(lattice.features.softens):  # noqa: SIM102 - the static test stands alone
                if is_pulled(lattice, c, strain, worst):
                    energy *= intact_share(lattice, axis, b, i, j)
            total += makeup.volume(lattice, axis, b, i, j, p) * energy
            if axis == A:
                lattice.state.bond_a[b, i, k].condition[lane] = BROKEN
                lattice.state.bond_a[b, i, k].break_time[lane] = time
            else:
                lattice.state.bond_b[b, i, k].condition[lane] = BROKEN
                lattice.state.bond_b[b, i, k].break_time[lane] = time
    return total


@ti.func
def is_whole(lattice: ti.template(), axis: ti.template(), b, i, j) -> ti.i32:
    bonds = ti.static(lattice.state.bonds[axis])
    return ti.i32(
        bonds[b, i, lanes.pack_of(lattice, j)].condition[lanes.lane_of(lattice, j)] > BROKEN
    )


@ti.func
def is_surface(lattice: ti.template(), b, i, j) -> ti.i32:
    """Whether any of the node's four bonds is broken or was never there."""
    return ti.i32(
        is_whole(lattice, A, b, i, j)
        + is_whole(lattice, A, b, i - 1, j)
        + is_whole(lattice, B, b, i, j)
        + is_whole(lattice, B, b, i, j - 1)
        < 4 * makeup.is_there(lattice, b, i, j)
    )


@ti.func
def is_torn(lattice: ti.template(), b, i, j) -> ti.i32:
    """Whether any of the node's bonds is broken."""
    return ti.i32(
        _is_broken(lattice, A, b, i, j)
        | _is_broken(lattice, A, b, i - 1, j)
        | _is_broken(lattice, B, b, i, j)
        | _is_broken(lattice, B, b, i, j - 1)
    )


@ti.func
def _is_broken(lattice: ti.template(), axis: ti.template(), b, i, j) -> ti.i32:
    bonds = ti.static(lattice.state.bonds[axis])
    return ti.i32(
        bonds[b, i, lanes.pack_of(lattice, j)].condition[lanes.lane_of(lattice, j)] == BROKEN
    )
