"""plain.cpp translated to Numba: same arrays of structs, same passes, same order of sums.

A node's numbers lie together: nodes (n, 4) x, y, v_x, v_y; bonds (n, 4) ahead, behind, worst, break
time; faces (n, 4) force of A, force of B; slips (n, 2) impactor, floor. Columns are SUMS wide.
"""

import functools
import math

import numba
import numpy as np

from .constants import WORKS, Features

A, B = 0, 1
LAST_STAGE = 3
INTACT, BREAKING, NEVER = -1.0, -2.0, 1e30
GUARD, PACKED, RK4_RADIUS, ASTRAY = 0.05, 4.0, 2.61, 1e5

# What a column adds up.
DENSIFIED, LIFT, SHEAR_POWER, DASHPOT_POWER, BREAKS, STRANGE, WORK = range(7)
SUMS = WORK + len(WORKS)
FACES, SHEAR, DASHPOTS, IMPACTOR, FRICTION, BASE = range(WORK, SUMS)

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


def tension_function(weakened: bool):
    """A function for whether an intact bond breaks in tension."""

    @inlined
    def fails_in_tension(c, e, worst, crossing, k, along, side):
        limit = c.crushed_strain if worst < c.yield_strain else c.tensile_strain
        if weakened and e > 0.0:
            # crush across is that of the end which is crushed less
            near = min(crossing[k, 2], crossing[k - side, 2])
            far = min(crossing[k + along, 2], crossing[k + along - side, 2])
            crush = max(near, far) - c.yield_strain
            crush /= c.densification_strain - c.yield_strain
            limit *= 1.0 - (1.0 - c.crushed_strength) * min(max(crush, 0.0), 1.0)
        return e > limit

    return fails_in_tension


def face_function(axis: int, stage: int, features: Features):
    """A function for the force of one bond, for its axis and its stage."""
    has_excess, has_rate, weakened = features
    yielding_stress = stress_function(has_rate)
    fails_in_tension = tension_function(weakened)

    @inlined
    def face_force(c, trial, bonds, crossing, faces, column, kept, k, along, side):
        if axis == A:
            per_length, area = c.per_length_a, c.area_a
            dashpot, excess = c.dashpot_a, c.excess_a
        else:
            per_length, area = c.per_length_b, c.area_b
            dashpot, excess = c.dashpot_b, c.excess_b
        end = k + along
        intact = bonds[k, 3] < 0.0
        x, y, x_end, y_end = trial[k, 0], trial[k, 1], trial[end, 0], trial[end, 1]
        reach_x, reach_y = x_end - x, y_end - y
        square = reach_x * reach_x + reach_y * reach_y
        length = math.sqrt(square)
        e = length * per_length - 1.0
        worst = bonds[k, 2]
        if stage == 0 and e < worst:
            worst = flowed_strain(c, e, worst, kept) if has_rate else e
            bonds[k, 2] = worst
        yielding = yielding_stress(c, e, worst, not intact)
        stress = yielding
        if e < c.densification_strain:
            dense, slope = densification(c, e)
            stress += dense
            column[DENSIFIED] = max(column[DENSIFIED], slope * area * per_length)
        pull = area * stress / length
        force_x, force_y = pull * reach_x, pull * reach_y
        if intact:
            ahead, behind = bonds[k, 0], bonds[k, 1]
            ahead_x = trial[k + side, 0] - x + (trial[end + side, 0] - x_end)
            ahead_y = trial[k + side, 1] - y + (trial[end + side, 1] - y_end)
            behind_x = x - trial[k - side, 0] + (x_end - trial[end - side, 0])
            behind_y = y - trial[k - side, 1] + (y_end - trial[end - side, 1])
            across_x = ahead * ahead_x + behind * behind_x
            across_y = ahead * ahead_y + behind * behind_y
            tau = c.shear_modulus * (reach_x * across_x + reach_y * across_y) * per_length
            shear_x, shear_y = area * tau * across_x, area * tau * across_y
            relative_x, relative_y = trial[end, 2] - trial[k, 2], trial[end, 3] - trial[k, 3]
            drag_x, drag_y = dashpot * relative_x, dashpot * relative_y
            if has_excess:
                closing = excess * (reach_x * relative_x + reach_y * relative_y) / square
                drag_x += closing * reach_x
                drag_y += closing * reach_y
            force_x += shear_x + drag_x
            force_y += shear_y + drag_y
            if stage == 0 or stage == LAST_STAGE:
                column[SHEAR_POWER] += shear_x * relative_x + shear_y * relative_y
                column[DASHPOT_POWER] += drag_x * relative_x + drag_y * relative_y
            if stage == LAST_STAGE:
                met = worst if has_rate else min(worst, e)
                if fails_in_tension(c, e, met, crossing, k, along, side) or fails_in_shear(
                    c, e, yielding, tau
                ):
                    bonds[k, 3] = BREAKING
                    column[BREAKS] += 1.0
        faces[k, 2 * axis] = force_x
        faces[k, 2 * axis + 1] = force_y

    return face_force


def column_function(stage: int, features: Features):
    """A function for the forces of one column's bonds."""
    force_a, force_b = (face_function(axis, stage, features) for axis in (A, B))

    @compiled
    def face_column(c, columns, rows, trial, bond_a, bond_b, faces, column, kept, i):
        stride = rows + 2
        column[DENSIFIED] = 0.0
        column[BREAKS] = 0.0
        column[SHEAR_POWER] = 0.0
        column[DASHPOT_POWER] = 0.0
        for j in range(rows):
            k = (i + 1) * stride + j + 1
            if i < columns - 1:
                force_a(c, trial, bond_a, bond_b, faces, column, kept, k, stride, 1)
            if j < rows - 1:
                force_b(c, trial, bond_b, bond_a, faces, column, kept, k, 1, stride)

    return face_column


@inlined
def half_counts(c, crossing, near, far):
    """Whether a half counts, by which of its two bonds are whole."""
    if c.half_needs_both != 0.0:
        return crossing[near, 3] == INTACT and crossing[far, 3] == INTACT
    return crossing[near, 3] == INTACT or crossing[far, 3] == INTACT


@compiled
def update_halves(c, rows, bond_a, bond_b, i):
    """Which halves of a column's gradients still count."""
    stride = rows + 2
    for j in range(rows):
        k = (i + 1) * stride + j + 1
        for axis in range(2):
            bond, crossing = (bond_a, bond_b) if axis == A else (bond_b, bond_a)
            along, side = (stride, 1) if axis == A else (1, stride)
            per_length = c.per_length_b if axis == A else c.per_length_a
            ahead = half_counts(c, crossing, k, k + along)
            behind = half_counts(c, crossing, k - side, k + along - side)
            each = 0.5 * per_length / (2.0 if ahead and behind else 1.0)
            bond[k, 0] = each if ahead else 0.0
            bond[k, 1] = each if behind else 0.0


@inlined
def spring(stiffness, stretch, limit):
    """A friction spring's force [N], up to its limit."""
    return -min(max(stiffness * stretch, -limit), limit)


@compiled
def impactor_contact(c, edges, x, y, path_x, path_y, stretch):
    """The impactor's normal and tangential force on a node, and the spring's new stretch."""
    distance, normal_x, normal_y = -NEVER, 0.0, -1.0
    for k in range(len(edges)):
        to_edge = edges[k, 0] * x + edges[k, 1] * y - edges[k, 2]
        if to_edge > distance:
            distance, normal_x, normal_y = to_edge, edges[k, 0], edges[k, 1]
    if distance >= 0.0 or len(edges) == 0:
        return 0.0, 0.0, 0.0, 0.0, 0.0
    force = -c.contact_stiffness * distance
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
    c, rows, state, trial, rate, faces, bond_a, bond_b, slips, edges, body, column, i, stage, step
):
    """Gather the forces on a column's nodes, and take the stage."""
    stride = rows + 2
    weight = step / (6.0 if stage == 0 or stage == LAST_STAGE else 3.0)
    ahead = 0.5 * step if stage < 2 else step
    per_mass = 1.0 / c.node_mass
    half = 0.5 * c.cell_b
    body_path = body[TRIAL_Y] - body[Y] if stage > 0 else body[RATE_Y]
    lift = taken = pressing = rubbing = base = 0.0
    column[STRANGE] = 0.0
    for j in range(rows):
        k = (i + 1) * stride + j + 1
        x, y, vx, vy = trial[k, 0], trial[k, 1], trial[k, 2], trial[k, 3]
        fx = faces[k, 0] - faces[k - stride, 0] + (faces[k, 2] - faces[k - 1, 2])
        fy = faces[k, 1] - faces[k - stride, 1] + (faces[k, 3] - faces[k - 1, 3])
        taken -= fx * vx + fy * vy
        held = j == 0 and c.hold_y != 0.0
        if not held:
            path_x, path_y = rate[k, 0], rate[k, 1]
            if stage > 0:
                path_x, path_y = x - state[k, 0], y - state[k, 1]
            point_x, point_y = x - c.impactor_x, y - body[TRIAL_Y]
            stretch = floor_stretch = 0.0
            if point_y > 0.0 and abs(point_x) < c.impactor_half_width:
                press_x, press_y, rub_x, rub_y, stretch = impactor_contact(
                    c, edges, point_x, point_y, path_x, path_y - body_path, slips[k, 0]
                )
                relative = vy - body[TRIAL_V]
                pressing -= press_x * vx + press_y * relative
                rubbing -= rub_x * vx + rub_y * relative
                lift -= press_y + rub_y
                fx += press_x + rub_x
                fy += press_y + rub_y
            if y < half:
                worst_a = min(bond_a[k, 2], bond_a[k - stride, 2])
                worst_b = min(bond_b[k, 2], bond_b[k - 1, 2])
                floor_x, floor_y, floor_stretch = floor_contact(
                    c, y, worst_a, worst_b, path_x, slips[k, 1]
                )
                base -= floor_x * vx + floor_y * vy
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
    column[FACES] += weight * taken
    # sampled at both ends of the step: the trapezium rule
    column[SHEAR] += 3.0 * weight * column[SHEAR_POWER]
    column[DASHPOTS] += 3.0 * weight * column[DASHPOT_POWER]
    column[IMPACTOR] += weight * pressing
    column[FRICTION] += weight * rubbing
    column[BASE] += weight * base


@compiled
def stable_step(c, densified):
    """The largest stable step while the stiffest densified bond has `densified` [N/m]."""
    aspect = max(c.area_a * c.per_length_a, c.area_b * c.per_length_b)
    modulus = max(c.youngs_modulus, c.crushed_stress / c.crushed_strain)
    elastic = modulus * aspect
    # with a rate, the overstress comes on top
    stiffest = elastic + densified if c.rate > 0.0 else max(elastic, densified)
    stiffness = 4.0 * stiffest + 8.0 * c.shear_modulus * aspect + c.contact_stiffness
    dashpots = c.dashpot_a + max(c.excess_a, 0.0) + c.dashpot_b + max(c.excess_b, 0.0)
    decay = 4.0 * dashpots
    rate = max(math.sqrt(stiffness / c.node_mass), decay / c.node_mass)
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
def break_bonds(c, columns, rows, bond_a, bond_b, column, clock):
    """What has failed in a step is broken from its end on."""
    breaks = 0.0
    for i in range(columns):
        breaks += column[i, BREAKS]
    if breaks == 0.0:
        return
    clock[BROKEN] += breaks
    for k in range(len(bond_a)):
        if bond_a[k, 3] == BREAKING:
            bond_a[k, 3] = clock[TIME]
        if bond_b[k, 3] == BREAKING:
            bond_b[k, 3] = clock[TIME]
    for i in range(columns):
        update_halves(c, rows, bond_a, bond_b, i)


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
        c, columns, rows, state, trial, rate, faces, bond_a, bond_b, slips, edges, body, column,
        clock, steps,
    ):  # fmt: skip
        for taken in range(steps):
            take_stock(c, column, clock)
            step, kept = clock[STEP], clock[KEPT]
            for stage in range(LAST_STAGE + 1):
                for i in columns_of(columns):
                    sums = column[i]
                    if stage == 0:
                        first_column(c, columns, rows, trial, bond_a, bond_b, faces, sums, kept, i)
                    elif stage == LAST_STAGE:
                        last_column(c, columns, rows, trial, bond_a, bond_b, faces, sums, kept, i)
                    else:
                        middle_column(c, columns, rows, trial, bond_a, bond_b, faces, sums, kept, i)
                for i in columns_of(columns):
                    node_column(
                        c, rows, state, trial, rate, faces, bond_a, bond_b, slips, edges, body,
                        column[i], i, stage, step,
                    )  # fmt: skip
                body_stage(c, column, body, stage, step)
            clock[TIME] += step
            break_bonds(c, columns, rows, bond_a, bond_b, column, clock)
            if np.any(column[:, STRANGE] > 0.0):
                return taken
        return steps

    return advance
