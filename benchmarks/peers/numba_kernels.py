"""plain.cpp translated to Numba: same arrays of structs, same passes, same order of sums.

A node's numbers lie together: nodes (n, 4) x, y, v_x, v_y; bonds (n, 2) worst, break time; cells
(n, 2) hold, grip; forces (n, 8) of bond A, of bond B, of the cell on the second ends of its two
diagonals; slips (n, 2) impactor, floor. Columns are SUMS wide.
"""

import functools
import math

import numba
import numpy as np

from .constants import WORKS, Features

A, B = 0, 1
LAST_STAGE = 3
INTACT, BREAKING, NEVER = -1.0, -2.0, 1e30
GUARD, PACKED, RK4_RADIUS, RK4_DECAY, ASTRAY = 0.05, 4.0, 2.61, 2.785, 1e5
HOLDS_TO, FREE_FROM, OPEN_AREA = 2.0, 4.0, 1.5

# What a column adds up.
DENSIFIED, LIFT, SHEAR_POWER, DASHPOT_POWER, BREAKS, STRANGE, WORK = range(7)
SUMS = WORK + len(WORKS)
BONDS, SHEAR, DASHPOTS, CONTACT, FRICTION, PRESSING = range(WORK, SUMS)  # the last stays 0

# The impactor's record.
Y, V, TRIAL_Y, TRIAL_V, RATE_Y, RATE_V = range(6)

# The clock's record. KEPT is the part of a bond's lag that is left after the step.
TIME, STEP, KEPT, BROKEN = range(4)

# A zero divisor gives infinity, as in C. Nothing here allocates: counting references around every
# call would double the time.
compiled = numba.njit(error_model="numpy", _nrt=False)
inlined = numba.njit(error_model="numpy", _nrt=False, inline="always")


def stress_function(has_rate: bool):
    """A function for a bond's stress [Pa] short of densification."""

    @inlined
    def yielding_stress(c, e, worst, broken):
        turn = min(max(worst, c.densification_strain), c.yield_strain)
        permanent = turn - c.yield_strain
        elastic = max(e - permanent, c.yield_strain)
        if has_rate:
            elastic += min(e - min(worst, c.yield_strain), 0.0)
        stress = c.youngs_modulus * elastic
        if stress > 0.0:
            if broken:
                stress = 0.0
            elif worst < c.yield_strain:
                stress = c.crushed_stress / (c.crushed_strain - permanent) * (e - permanent)
        return stress

    return yielding_stress


@inlined
def flowed_strain(c, e, worst, kept):
    """The worst strain that lags behind the strain, after a step's flow."""
    start = min(max(e, c.yield_strain), worst)
    lag = max(start - e, 0.0)
    return start - (lag - lag * kept)


@compiled
def densification(c, e):
    """What densification adds to the plateau, and the slope [Pa]."""
    guard = c.locking_strain + GUARD * (c.densification_strain - c.locking_strain)
    inside = max(e, guard)
    room = inside - c.locking_strain
    power = room if c.densification_b == 1.0 else room**c.densification_b
    steepness = c.densification_a / power
    exponent = steepness * (c.densification_strain - inside)
    plateau = c.youngs_modulus * c.yield_strain
    stress = plateau * math.exp(exponent)
    slope = -stress * (steepness + c.densification_b * exponent / room)
    return stress + slope * (e - inside) - plateau, slope


@inlined
def fails_in_shear(c, e, stress, tau):
    """Whether an intact bond breaks in shear."""
    strength = c.shear_strength
    if e < 0.0:
        strength += c.pressure_coefficient * abs(stress)
    return abs(tau) > strength


@inlined
def shear_across(c, trial, cells, k, along, side, reach_x, reach_y):
    """Shear stress [Pa] at a bond: that of the cells on both its sides, of those that carry any."""
    across_x = across_y = 0.0
    differences = 0
    for near in (k, k - side):  # the nodes between which a side lies
        if cells[near, 1] > 0.0:
            far = near + along
            across_x += trial[near + side, 0] - trial[near, 0]
            across_x += trial[far + side, 0] - trial[far, 0]
            across_y += trial[near + side, 1] - trial[near, 1]
            across_y += trial[far + side, 1] - trial[far, 1]
            differences += 2
    gamma = reach_x * across_x + reach_y * across_y
    return c.shear_modulus * gamma * c.per_length_a * c.per_length_b / max(differences, 1)


def bond_function(axis: int, stage: int, features: Features):
    """A function for the force of one bond, for its axis and its stage."""
    has_rate = features.rate
    yielding_stress = stress_function(has_rate)

    @inlined
    def bond_force(c, trial, bonds, cells, forces, column, kept, k, along, side):
        if axis == A:
            per_length, area, dashpot = c.per_length_a, c.area_a, c.dashpot_a
        else:
            per_length, area, dashpot = c.per_length_b, c.area_b, c.dashpot_b
        end = k + along
        intact = bonds[k, 1] < 0.0
        reach_x, reach_y = trial[end, 0] - trial[k, 0], trial[end, 1] - trial[k, 1]
        square = reach_x * reach_x + reach_y * reach_y
        length = math.sqrt(square)
        e = length * per_length - 1.0
        worst = bonds[k, 0]
        if stage == 0 and e < worst:
            worst = flowed_strain(c, e, worst, kept) if has_rate else e
            bonds[k, 0] = worst
        yielding = yielding_stress(c, e, worst, not intact)
        stress = yielding
        if e < c.densification_strain:
            dense, slope = densification(c, e)
            stress += dense
            column[DENSIFIED] = max(column[DENSIFIED], slope * area * per_length)
        pull = area * stress / length
        if intact:
            relative_x, relative_y = trial[end, 2] - trial[k, 2], trial[end, 3] - trial[k, 3]
            closing = reach_x * relative_x + reach_y * relative_y
            drag = dashpot * closing / square
            pull += drag
            column[DASHPOT_POWER] += drag * closing
            if stage == LAST_STAGE:
                met = worst if has_rate else min(worst, e)
                limit = c.crushed_strain if met < c.yield_strain else c.tensile_strain
                tau = shear_across(c, trial, cells, k, along, side, reach_x, reach_y)
                if e > limit or fails_in_shear(c, e, yielding, tau):
                    bonds[k, 1] = BREAKING
                    column[BREAKS] += 1.0
        forces[k, 2 * axis] = pull * reach_x
        forces[k, 2 * axis + 1] = pull * reach_y

    return bond_force


@inlined
def cell_forces(c, trial, cells, forces, column, k, stride):
    """Forces of a cell along its two diagonals, on their second ends: elastic and viscous."""
    right, up, far = k + stride, k + 1, k + stride + 1
    d1_x, d1_y = trial[far, 0] - trial[k, 0], trial[far, 1] - trial[k, 1]
    d2_x, d2_y = trial[up, 0] - trial[right, 0], trial[up, 1] - trial[right, 1]
    d1_u, d1_v = trial[far, 2] - trial[k, 2], trial[far, 3] - trial[k, 3]
    d2_u, d2_v = trial[up, 2] - trial[right, 2], trial[up, 3] - trial[right, 3]
    per_area = c.per_length_a * c.per_length_b
    # thickness times stress, halved, is a force over a diagonal's length
    half = 0.5 * c.thickness * cells[k, 1]
    squares = (d1_x * d1_x + d1_y * d1_y) - (d2_x * d2_x + d2_y * d2_y)
    closing = (d1_x * d1_u + d1_y * d1_v) - (d2_x * d2_u + d2_y * d2_v)
    elastic = half * c.shear_modulus * (0.25 * per_area) * squares
    viscous = half * c.shear_viscosity * (0.5 * per_area) * closing
    pull = elastic + viscous
    forces[k, 4], forces[k, 5] = -pull * d1_x, -pull * d1_y
    forces[k, 6], forces[k, 7] = pull * d2_x, pull * d2_y
    column[SHEAR_POWER] += elastic * closing
    column[DASHPOT_POWER] += viscous * closing


def column_function(stage: int, features: Features):
    """A function for the forces of one column's bonds and cells."""
    force_a, force_b = (bond_function(axis, stage, features) for axis in (A, B))

    @compiled
    def force_column(c, columns, rows, trial, bond_a, bond_b, cells, forces, column, kept, i):
        stride = rows + 2
        column[DENSIFIED] = 0.0
        column[BREAKS] = 0.0
        column[SHEAR_POWER] = 0.0
        column[DASHPOT_POWER] = 0.0
        for j in range(rows):
            k = (i + 1) * stride + j + 1
            if i < columns - 1:
                force_a(c, trial, bond_a, cells, forces, column, kept, k, stride, 1)
            if j < rows - 1:
                force_b(c, trial, bond_b, cells, forces, column, kept, k, 1, stride)
            if i < columns - 1 and j < rows - 1:
                cell_forces(c, trial, cells, forces, column, k, stride)

    return force_column


@compiled
def look_column(c, columns, rows, trial, bond_a, bond_b, cells, i):
    """Between two steps: cells let go as cracks pull them apart. What they hold only falls."""
    if i == columns - 1:
        return
    stride = rows + 2
    across = c.cell_a * c.cell_a + c.cell_b * c.cell_b
    for j in range(rows - 1):
        k = (i + 1) * stride + j + 1
        right, up, far = k + stride, k + 1, k + stride + 1
        below, above = bond_a[k, 1] == INTACT, bond_a[up, 1] == INTACT
        before, after = bond_b[k, 1] == INTACT, bond_b[right, 1] == INTACT
        if below and above and before and after:
            continue
        d1_x, d1_y = trial[far, 0] - trial[k, 0], trial[far, 1] - trial[k, 1]
        d2_x, d2_y = trial[up, 0] - trial[right, 0], trial[up, 1] - trial[right, 1]
        longer = max(d1_x * d1_x + d1_y * d1_y, d2_x * d2_x + d2_y * d2_y)
        left = (FREE_FROM - math.sqrt(2.0 * longer / across)) / (FREE_FROM - HOLDS_TO)
        if d1_x * d2_y - d1_y * d2_x > 2.0 * OPEN_AREA * c.cell_a * c.cell_b:
            left = 0.0
        cells[k, 0] = min(max(left, 0.0), cells[k, 0])
        # it hangs together by one of its two sides along each axis
        carries = (below or above) and (before or after)
        cells[k, 1] = cells[k, 0] if carries else 0.0


@inlined
def spring(stiffness, stretch, limit):
    """A friction spring's force [N], up to its limit."""
    return -min(max(stiffness * stretch, -limit), limit)


@compiled
def impactor_contact(c, edges, x, y, relative_x, relative_y, path_x, path_y, stretch):
    """The impactor's normal and tangential force on a node, and the spring's new stretch."""
    distance, normal_x, normal_y = -NEVER, 0.0, -1.0
    for k in range(len(edges)):
        to_edge = edges[k, 0] * x + edges[k, 1] * y - edges[k, 2]
        if to_edge > distance:
            distance, normal_x, normal_y = to_edge, edges[k, 0], edges[k, 1]
    if distance >= 0.0 or len(edges) == 0:
        return 0.0, 0.0, 0.0, 0.0, 0.0
    parting = relative_x * normal_x + relative_y * normal_y
    force = max(-c.contact_stiffness * distance - c.contact_dashpot * parting, 0.0)
    moved = -path_x * normal_y + path_y * normal_x
    along = spring(c.contact_stiffness, stretch + moved, c.impactor_friction * force)
    return (
        force * normal_x,
        force * normal_y,
        -along * normal_y,
        along * normal_x,
        -along / c.contact_stiffness,
    )


@compiled
def floor_contact(c, y, worst_a, worst_b, path, stretch):
    """The floor's force on a node, and its friction spring's new stretch."""
    half = 0.5 * c.cell_b
    radius = 0.5 * min(c.cell_a * (1.0 + worst_a), c.cell_b * (1.0 + worst_b))
    lift = 0.0
    if y < radius:
        packed = min(y - (1.0 + c.densification_strain) * radius, 0.0) / half
        strain = max((y - radius) / half, c.yield_strain)
        lift = -c.area_b * c.youngs_modulus * (strain + PACKED * packed)
    along = spring(c.contact_stiffness, stretch + path, c.floor_friction * lift)
    return along, lift, -along / c.contact_stiffness


@compiled
def node_column(
    c, rows, state, trial, rate, forces, bond_a, bond_b, slips, edges, body, column, i, stage, step
):
    """Gather the forces on a column's nodes, and take the stage."""
    stride = rows + 2
    weight = step / (6.0 if stage == 0 or stage == LAST_STAGE else 3.0)
    ahead = 0.5 * step if stage < 2 else step
    per_mass = 1.0 / c.node_mass
    half = 0.5 * c.cell_b
    body_path = body[TRIAL_Y] - body[Y] if stage > 0 else body[RATE_Y]
    lift = taken = pressing = rubbing = 0.0
    column[STRANGE] = 0.0
    for j in range(rows):
        k = (i + 1) * stride + j + 1
        x, y, vx, vy = trial[k, 0], trial[k, 1], trial[k, 2], trial[k, 3]
        fx = forces[k, 0] - forces[k - stride, 0] + (forces[k, 2] - forces[k - 1, 2])
        fy = forces[k, 1] - forces[k - stride, 1] + (forces[k, 3] - forces[k - 1, 3])
        # each of four cells has the node at another corner: its upper, first, far, right one
        fx += forces[k - 1, 6] - forces[k, 4] + (forces[k - stride - 1, 4] - forces[k - stride, 6])
        fy += forces[k - 1, 7] - forces[k, 5] + (forces[k - stride - 1, 5] - forces[k - stride, 7])
        taken -= fx * vx + fy * vy
        held = j == 0 and c.hold_y != 0.0
        if not held:
            path_x, path_y = rate[k, 0], rate[k, 1]
            if stage > 0:
                path_x, path_y = x - state[k, 0], y - state[k, 1]
            point_x, point_y = x - c.impactor_x, y - body[TRIAL_Y]
            stretch = floor_stretch = 0.0
            if point_y > 0.0 and abs(point_x) < c.impactor_half_width:
                relative = vy - body[TRIAL_V]
                press_x, press_y, rub_x, rub_y, stretch = impactor_contact(
                    c, edges, point_x, point_y, vx, relative, path_x, path_y - body_path,
                    slips[k, 0],
                )  # fmt: skip
                pressing -= press_x * vx + press_y * relative
                rubbing -= rub_x * vx + rub_y * relative
                lift -= press_y + rub_y
                fx += press_x + rub_x
                fy += press_y + rub_y
            if y < half:
                worst_a = min(bond_a[k, 0], bond_a[k - stride, 0])
                worst_b = min(bond_b[k, 0], bond_b[k - 1, 0])
                floor_x, floor_y, floor_stretch = floor_contact(
                    c, y, worst_a, worst_b, path_x, slips[k, 1]
                )
                pressing -= floor_y * vy
                rubbing -= floor_x * vx
                fx += floor_x
                fy += floor_y
            if stage == 0:
                slips[k, 0] = stretch
                slips[k, 1] = floor_stretch
        ax, ay = fx * per_mass, fy * per_mass - c.gravity
        if j == 0 and c.hold_x != 0.0:
            ax = 0.0
        if held:
            ay = 0.0
        sum_x, sum_y, sum_vx, sum_vy = weight * vx, weight * vy, weight * ax, weight * ay
        if stage > 0:
            sum_x += rate[k, 0]
            sum_y += rate[k, 1]
            sum_vx += rate[k, 2]
            sum_vy += rate[k, 3]
        rate[k, 0], rate[k, 1], rate[k, 2], rate[k, 3] = sum_x, sum_y, sum_vx, sum_vy
        if stage < LAST_STAGE:
            trial[k, 0] = state[k, 0] + ahead * vx
            trial[k, 1] = state[k, 1] + ahead * vy
            trial[k, 2] = state[k, 2] + ahead * ax
            trial[k, 3] = state[k, 3] + ahead * ay
        else:
            x, y = state[k, 0] + sum_x, state[k, 1] + sum_y
            vx, vy = state[k, 2] + sum_vx, state[k, 3] + sum_vy
            state[k, 0], state[k, 1], state[k, 2], state[k, 3] = x, y, vx, vy
            trial[k, 0], trial[k, 1], trial[k, 2], trial[k, 3] = x, y, vx, vy
            if not abs(x) + abs(y) + abs(vx) + abs(vy) < ASTRAY:
                column[STRANGE] = 1.0
    column[LIFT] = lift
    column[BONDS] += weight * taken
    column[SHEAR] += weight * column[SHEAR_POWER]
    column[DASHPOTS] += weight * column[DASHPOT_POWER]
    column[CONTACT] += weight * pressing
    column[FRICTION] += weight * rubbing


@compiled
def stable_step(c, densified):
    """The largest stable step while the stiffest densified bond has `densified` [N/m]."""
    aspect = max(c.area_a * c.per_length_a, c.area_b * c.per_length_b)
    modulus = max(c.youngs_modulus, c.crushed_stress / c.crushed_strain)
    elastic = modulus * aspect
    # with a rate, the overstress comes on top
    stiffest = elastic + densified if c.rate > 0.0 else max(elastic, densified)
    stiffness = 4.0 * stiffest + 4.0 * c.shear_modulus * aspect + c.contact_stiffness
    decay = 4.0 * (c.dashpot_a + c.dashpot_b + c.shear_viscosity * aspect)
    rate = max(math.sqrt(stiffness / c.node_mass), decay / c.node_mass * (RK4_RADIUS / RK4_DECAY))
    return min(c.safety * RK4_RADIUS / rate, c.largest_step)


@compiled
def take_stock(c, column, clock):
    """Choose the step by the last stage's forces, which looked at the last step's end."""
    densified = 0.0
    for i in range(len(column)):
        densified = max(densified, column[i, DENSIFIED])
    clock[STEP] = c.step if c.step > 0.0 else stable_step(c, densified)
    clock[KEPT] = math.exp(c.rate * clock[STEP] / c.yield_strain)


@compiled
def break_bonds(columns, bond_a, bond_b, column, clock):
    """What has failed in a step is broken from its end on."""
    breaks = 0.0
    for i in range(columns):
        breaks += column[i, BREAKS]
    if breaks == 0.0:
        return
    clock[BROKEN] += breaks
    for k in range(len(bond_a)):
        if bond_a[k, 1] == BREAKING:
            bond_a[k, 1] = clock[TIME]
        if bond_b[k, 1] == BREAKING:
            bond_b[k, 1] = clock[TIME]


@compiled
def body_stage(c, column, body, stage, step):
    """The impactor's stage."""
    weight = step / (6.0 if stage == 0 or stage == LAST_STAGE else 3.0)
    ahead = 0.5 * step if stage < 2 else step
    force = c.support_stiffness * max(-body[TRIAL_Y], 0.0)
    for i in range(len(column)):
        force += column[i, LIFT]
    acceleration = force / c.impactor_mass - c.gravity
    speed = body[TRIAL_V]
    before = 1.0 if stage > 0 else 0.0
    body[RATE_Y] = weight * speed + before * body[RATE_Y]
    body[RATE_V] = weight * acceleration + before * body[RATE_V]
    if stage < LAST_STAGE:
        body[TRIAL_Y] = body[Y] + ahead * speed
        body[TRIAL_V] = body[V] + ahead * acceleration
    else:
        body[Y] += body[RATE_Y]
        body[V] += body[RATE_V]
        body[TRIAL_Y], body[TRIAL_V] = body[Y], body[V]


@functools.cache
def advance_function(features: Features, parallel: bool):
    """A function that takes steps, with the columns of each pass spread over threads or not."""
    columns_of = numba.prange if parallel else range
    first_column, middle_column, last_column = (
        column_function(stage, features) for stage in (0, 1, LAST_STAGE)
    )

    @numba.njit(error_model="numpy", parallel=parallel)
    def advance(
        c, columns, rows, state, trial, rate, forces, bond_a, bond_b, cells, slips, edges, body,
        column, clock, steps,
    ):  # fmt: skip
        for taken in range(steps):
            take_stock(c, column, clock)
            step, kept = clock[STEP], clock[KEPT]
            for stage in range(LAST_STAGE + 1):
                for i in columns_of(columns):
                    if stage == 0:
                        first_column(
                            c, columns, rows, trial, bond_a, bond_b, cells, forces, column[i],
                            kept, i,
                        )  # fmt: skip
                    elif stage == LAST_STAGE:
                        last_column(
                            c, columns, rows, trial, bond_a, bond_b, cells, forces, column[i],
                            kept, i,
                        )  # fmt: skip
                    else:
                        middle_column(
                            c, columns, rows, trial, bond_a, bond_b, cells, forces, column[i],
                            kept, i,
                        )  # fmt: skip
                for i in columns_of(columns):
                    node_column(
                        c, rows, state, trial, rate, forces, bond_a, bond_b, slips, edges, body,
                        column[i], i, stage, step,
                    )  # fmt: skip
                body_stage(c, column, body, stage, step)
            clock[TIME] += step
            break_bonds(columns, bond_a, bond_b, column, clock)
            for i in columns_of(columns):
                look_column(c, columns, rows, trial, bond_a, bond_b, cells, i)
            if np.any(column[:, STRANGE] > 0.0):
                return taken
        return steps

    return advance
