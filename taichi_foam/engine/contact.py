"""Contact of mass points: with the impactor, with the floor, and of pieces with each other."""

import taichi as ti

from taichi_foam.engine import faces
from taichi_foam.engine.lattice import CROWDED, PAIRS_PER_NODE, WORST
from taichi_foam.engine.parameters import CIRCLE, POLYGON
from taichi_foam.laws import contact as contact_law
from taichi_foam.laws import foam as foam_law

# Whether a node can touch others: not while whole foam surrounds it.
INSIDE = 0
AT_SURFACE = 1
NEW = 2  # at the surface since this listing

vec2 = ti.types.vector(2, ti.f64)
vec3 = ti.types.vector(3, ti.f64)
vec4 = ti.types.vector(4, ti.f64)


@ti.func
def impactor_distance(lattice: ti.template(), b, point: vec2, p: ti.template()) -> vec3:
    """Signed distance [m] of a point relative to the impactor's lowest point, and the normal."""
    found = vec3(1.0, 0.0, -1.0)
    if p.impactor_kind == CIRCLE:
        found = contact_law.circle_distance(point, p.impactor_radius)
    elif p.impactor_kind == POLYGON:
        found[0] = -ti.math.inf
        for k in range(p.impactor_edges):
            edge = lattice.edges[b, k]
            distance = edge.xy.dot(point) - edge.z
            if distance > found[0]:
                found = vec3(distance, edge.x, edge.y)
    return found


@ti.func
def slid(lattice: ti.template(), b, i, j, stage) -> vec2:
    """How far [m] a node has moved since its friction springs were latched.

    They are latched at a step's first stage, whose `rate` still holds the last step's motion.
    """
    path = lattice.rate[b, i, j].xy
    if stage > 0:
        path = lattice.trial[b, i, j].xy - lattice.state[b, i, j].xy
    return path


@ti.func
def impactor_slid(lattice: ti.template(), b, stage) -> ti.f64:
    """How far [m] the impactor has moved since then."""
    path = lattice.body[b].rate_y
    if stage > 0:
        path = lattice.body[b].trial_y - lattice.body[b].y
    return path


@ti.func
def impactor_contact(lattice: ti.template(), b, i, j, stage, p: ti.template()):
    """The impactor's normal and tangential force [N] on a node, and the signed distance [m].

    The first stage of a step also latches the friction spring: slid off beyond mu N, and slack
    where there is no touch.
    """
    now = lattice.trial[b, i, j].xy
    point = vec2(now.x - p.impactor_x, now.y - lattice.body[b].trial_y)
    pressing = vec2(0.0)
    rubbing = vec2(0.0)
    distance = ti.math.inf
    stretch = 0.0
    if point.y > 0.0 and ti.abs(point.x) < p.impactor_half_width:
        found = impactor_distance(lattice, b, point, p)
        distance = found[0]
        if distance < 0.0:
            normal = found.yz
            tangent = vec2(-normal.y, normal.x)
            force = contact_law.normal_force(p.contact_stiffness, distance)
            path = slid(lattice, b, i, j, stage) - vec2(0.0, impactor_slid(lattice, b, stage))
            along = contact_law.tangential_force(
                p.contact_stiffness,
                lattice.slip[b, i, j][0] + path.dot(tangent),
                p.impactor_friction,
                force,
            )
            pressing = force * normal
            rubbing = along * tangent
            stretch = -along / p.contact_stiffness
    if stage == 0:
        lattice.slip[b, i, j][0] = stretch
    return pressing, rubbing, distance


@ti.func
def floor_contact(lattice: ti.template(), b, i, j, stage, p: ti.template()) -> vec2:
    """Force [N] of the floor on a node; its friction spring is latched likewise.

    Between the node and the floor lies half a cell of foam, or what crushing has left of it.
    """
    now = lattice.trial[b, i, j].xy
    force = vec2(0.0)
    stretch = 0.0
    half = 0.5 * p.cell.y
    if now.y < half:
        radius = piece_radius(lattice, b, i, j, p)
        if now.y < radius:
            force.y = -p.area.y * foam_law.piece_stress(p.foam, now.y, radius, half)
        force.x = contact_law.tangential_force(
            p.contact_stiffness,
            lattice.slip[b, i, j][1] + slid(lattice, b, i, j, stage).x,
            p.floor_friction,
            force.y,
        )
        stretch = -force.x / p.contact_stiffness
    if stage == 0:
        lattice.slip[b, i, j][1] = stretch
    return force


@ti.func
def piece_radius(lattice: ti.template(), b, i, j, p: ti.template()) -> ti.f64:
    """Half the cell, shrunk by the worst crush of the node's connections on its thinner axis.

    Never more than the room that there was when the node could first touch.
    """
    worst_a = ti.min(lattice.link_a[b, i, j][WORST], lattice.link_a[b, i - 1, j][WORST])
    worst_b = ti.min(lattice.link_b[b, i, j][WORST], lattice.link_b[b, i, j - 1][WORST])
    thinner = ti.min(p.cell.x * (1.0 + worst_a), p.cell.y * (1.0 + worst_b))
    return ti.min(0.5 * thinner, lattice.room[b, i, j])


@ti.func
def self_contact(lattice: ti.template(), b, i, j, p: ti.template()):
    """Find the push [N] on a node from the nodes that it touches.

    A node at a surface, the block's or a crack's, touches any but its neighbours in the lattice:
    those have their connection's own law for compression, broken or not.
    """
    node = i * lattice.rows + j
    here = lattice.trial[b, i, j].xy
    radius = lattice.radius[b, i, j]
    push = vec2(0.0)
    for k in range(lattice.pair_start[b, node], lattice.pair_start[b, node + 1]):
        other = lattice.pairs[b, k]
        oi = other // lattice.rows
        oj = other % lattice.rows
        away = here - lattice.trial[b, oi, oj].xy
        touch = radius + lattice.radius[b, oi, oj]
        gap_sqr = away.norm_sqr()
        if gap_sqr < touch * touch and gap_sqr > 0.0:
            gap = ti.sqrt(gap_sqr)
            stress = foam_law.piece_stress(p.foam, gap, touch, p.piece_length)
            push -= away * (p.piece_area * stress / gap)
    lattice.push[b, i, j] = push


@ti.func
def drifted(lattice: ti.template(), b, i, j, p: ti.template()) -> ti.i32:
    """Whether a node has moved so far that the neighbour list may miss a touch."""
    moved = lattice.trial[b, i, j].xy - lattice.anchor[b, i, j]
    return ti.i32(4.0 * moved.norm_sqr() > p.skin * p.skin)


@ti.func
def _bin(lattice: ti.template(), point: vec2, p: ti.template()) -> ti.types.vector(2, ti.i32):
    """Cell of the search grid; what has flown off the grid counts to its rim.

    Clamping brings no two points further apart, so no neighbour is missed.
    """
    size = p.cell.max() + p.skin
    half = 0.5 * size * lattice.bins_x
    x = ti.math.clamp((point.x + half) / size, 0.0, lattice.bins_x - 1.0)
    y = ti.math.clamp(point.y / size + 2.0, 0.0, lattice.bins_y - 1.0)
    return ti.Vector([ti.i32(x), ti.i32(y)])


@ti.func
def list_neighbours(lattice: ti.template(), b, p: ti.template()):
    """Build the search grid and the neighbour list of one lattice, serially.

    Serial, so that the order of every list, and with it every sum, is the same for any number of
    threads. It is rare: a node has moved by half the skin, or a connection has broken.
    """
    for k in range(lattice.bins_x * lattice.bins_y):
        lattice.bin_head[b, k] = -1
    for i in range(lattice.columns):
        for j in range(lattice.rows):
            point = lattice.trial[b, i, j].xy
            lattice.anchor[b, i, j] = point
            lattice.radius[b, i, j] = piece_radius(lattice, b, i, j, p)
            if lattice.touching[b, i, j] == INSIDE and faces.is_surface(lattice, b, i, j):
                lattice.touching[b, i, j] = NEW
            node = i * lattice.rows + j
            cell = _bin(lattice, point, p)
            head = cell.x * lattice.bins_y + cell.y
            lattice.next_in_bin[b, node] = lattice.bin_head[b, head]
            lattice.bin_head[b, head] = node
    found = 0
    for i in range(lattice.columns):
        for j in range(lattice.rows):
            lattice.pair_start[b, i * lattice.rows + j] = found
            found = _list_around(lattice, b, i, j, found, p)
    lattice.pair_start[b, lattice.nodes] = found
    lattice.clock[b].stale = 0
    if found > PAIRS_PER_NODE * lattice.nodes:
        lattice.clock[b].status = CROWDED
    else:
        for i in range(lattice.columns):
            for j in range(lattice.rows):
                _make_room(lattice, b, i, j)
        for i in range(lattice.columns):
            for j in range(lattice.rows):
                lattice.touching[b, i, j] = ti.min(lattice.touching[b, i, j], AT_SURFACE)
                lattice.radius[b, i, j] = piece_radius(lattice, b, i, j, p)


@ti.func
def _make_room(lattice: ti.template(), b, i, j):
    """Let a node start to touch its neighbours without overlap.

    Foam that has sheared under compression may be closer than its radii when it tears. Contact
    that sprang up there at once would push with energy from nothing.
    """
    node = i * lattice.rows + j
    radius = lattice.radius[b, i, j]
    for k in range(lattice.pair_start[b, node], lattice.pair_start[b, node + 1]):
        other = lattice.pairs[b, k]
        oi = other // lattice.rows
        oj = other % lattice.rows
        if ti.max(lattice.touching[b, i, j], lattice.touching[b, oi, oj]) == NEW:
            distance = (lattice.trial[b, oi, oj].xy - lattice.trial[b, i, j].xy).norm()
            share = distance / (radius + lattice.radius[b, oi, oj])
            lattice.room[b, i, j] = ti.min(lattice.room[b, i, j], share * radius)


@ti.func
def _list_around(lattice: ti.template(), b, i, j, found, p: ti.template()) -> ti.i32:
    """Append the nodes near node (i, j), but not those that it is or was connected to."""
    point = lattice.anchor[b, i, j]
    home = _bin(lattice, point, p)
    count = found
    for bx in range(ti.max(home.x - 1, 0), ti.min(home.x + 2, lattice.bins_x)):
        for by in range(ti.max(home.y - 1, 0), ti.min(home.y + 2, lattice.bins_y)):
            other = lattice.bin_head[b, bx * lattice.bins_y + by]
            while other >= 0:
                oi = other // lattice.rows
                oj = other % lattice.rows
                can_touch = lattice.touching[b, i, j] + lattice.touching[b, oi, oj] > INSIDE
                if can_touch and ti.abs(oi - i) + ti.abs(oj - j) > 1:
                    reach = lattice.radius[b, i, j] + lattice.radius[b, oi, oj] + p.skin
                    if (lattice.anchor[b, oi, oj] - point).norm_sqr() < reach * reach:
                        if count < PAIRS_PER_NODE * lattice.nodes:
                            lattice.pairs[b, count] = other
                        count += 1
                other = lattice.next_in_bin[b, other]
    return count
