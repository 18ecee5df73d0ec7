"""Contact of mass points with the impactor and the floor or support, and between pieces.

At the edges of a block that its lattice does not follow, foam reaches beyond its mass points.
"""

from taichi_foam.backend import ti
from taichi_foam.engine import bonds, lanes, makeup, turning
from taichi_foam.engine.grading import A, B
from taichi_foam.engine.lattice import LAST_STAGE
from taichi_foam.engine.state import CROWDED, NEVER, UNLISTED, WORK
from taichi_foam.laws import contact as contact_law
from taichi_foam.laws import elementary
from taichi_foam.laws.shape.edges import Edged

# Whether a node can touch others: not while whole foam surrounds it.
INSIDE = 0
OUTER = 1  # at the block's surface, with whole bonds
TORN = 2  # at a crack
NEW = 3  # at the surface, or torn, since the last listing

# Foam between a mass point and its face that is thinner than this, in cells, is a penalty spring.
THIN = 0.25

# The distance at which points of unequal size touch grows by this fraction of the difference of
# their radii. A row of large points represents foam with a straight face, but has dents: a point of
# zero size in a dent then lies on that face, not behind it.
LEVEL = 2.0**0.5 - 1.0

vec2 = ti.types.vector(2, ti.f64)
vec4 = ti.types.vector(4, ti.f64)


@ti.func
def may_touch_bodies(lattice: ti.template(), b, i, k, x, y, p: ti.template()) -> ti.i32:
    """Whether any of a pack's nodes may touch the impactor or the support, or just did.

    Because of the margin, a node that has just left them is visited once more, so that its friction
    springs go slack.
    """
    to_impactor, to_base = _margins(lattice, b, i, k, p)
    above = y > lattice.state.body[b].trial_y - to_impactor
    beside = ti.abs(x - p.impactor_x) < p.impactor_half_width + to_impactor
    near = above & beside
    if ti.static(lattice.features.turns):
        near = turning.is_near(lattice, b, x, y, to_impactor, p)
    may = near | (y < to_base)
    if ti.static(lattice.features.supported):
        may = near | _is_near_support(x, y, to_base, p)
    if ti.static(lattice.features.shaped):  # any mass point may be held
        may &= makeup.mobility(lattice, b, i, k).y > 0.0
    elif ti.static(not lattice.features.supported):  # noqa: SIM102 - the static test stands alone
        if p.hold_y and k == 0:
            # the held row is part of the support and does not touch the impactor
            may[0] = 0
    return elementary.any_of(may)


@ti.func
def _margins(lattice: ti.template(), b, i, k, p: ti.template()):
    """Distances [m] within which a pack's nodes may touch the impactor, and the floor or support.

    They are what `touch_bodies` and `_stand` allow, and the skin.
    """
    to_impactor, to_base = lanes.zeros(lattice) + p.skin, lanes.zeros(lattice) + p.skin
    if ti.static(lattice.features.shaped):
        filled = lattice.model.filling[b, makeup.column(lattice, i), k]
        to_base += filled.reach
        if ti.static(lattice.features.edged):
            to_impactor += filled.edge
    else:
        to_base += 0.5 * (p.cell.max() if ti.static(lattice.features.supported) else p.cell.y)
    return to_impactor, to_base


@ti.func
def _is_near_support(x, y, margin, p: ti.template()):
    """Whether a pack's points lie in the box around the support's outline, or that near to it."""
    beside = (x > p.support_low.x - margin) & (x < p.support_high.x + margin)
    return beside & (y > p.support_low.y - margin) & (y < p.support_high.y + margin)


@ti.func
def _slid(lattice: ti.template(), b, i, j, stage) -> vec2:
    """How far [m] a node has moved since its friction springs were latched.

    They are latched at a step's first stage, when `increment` still holds the last step's motion.
    """
    path = lanes.position(lattice, lattice.state.increment, b, i, j)
    if stage > 0:
        now = lanes.position(lattice, lattice.scratch.trial, b, i, j)
        path = now - lanes.position(lattice, lattice.state.motion, b, i, j)
    return path


@ti.func
def _impactor_slid(lattice: ti.template(), b, arm: vec2, stage) -> vec2:
    """How far [m] the impactor's point at `arm` from its centre of mass has moved since then."""
    path = lattice.state.body[b].rate_y
    if stage > 0:
        path = lattice.state.body[b].trial_y - lattice.state.body[b].y
    moved = vec2(0.0, path)
    if ti.static(lattice.features.turns):
        moved = turning.slid(lattice, b, arm, stage)
    return moved


@ti.func
def touch_bodies(lattice: ti.template(), b, i, j, strip, stage, weight, p: ti.template()) -> vec2:
    """Force [N] of the impactor, and of the floor or the support, on a node.

    The work and the force on the impactor are added to the strip's, as is at the last stage the
    energy stored in the springs. The first stage of a step also latches the friction springs: their
    force is limited to mu N, and they are slack where there is no contact.
    """
    now = lanes.position(lattice, lattice.scratch.trial, b, i, j)
    speed = lanes.velocity(lattice, lattice.scratch.trial, b, i, j)
    k = lanes.pack_of(lattice, j)
    lane = lanes.lane_of(lattice, j)
    force = vec2(0.0)
    on_impactor = 0.0
    on_floor = 0.0
    if not makeup.is_held(lattice, b, i, j, p):
        work = lattice.state.work[b, strip]
        body = lattice.state.body[b]
        stiffness = makeup.contact_stiffness(lattice, b, i, j, p)
        point, arm = vec2(now.x - p.impactor_x, now.y - body.trial_y), vec2(0.0)
        if ti.static(lattice.features.turns):
            point = vec2(turning.in_body(lattice, b, now.x, now.y, p))
            arm = vec2(turning.arm_to(lattice, b, now.x, now.y, p))
        edge = makeup.edge(lattice, b, i, j)
        if point.y > -edge and ti.abs(point.x) < p.impactor_half_width + edge:
            found = lattice.features.distance(
                lattice.model.surface, b, ti.cast(p.surface_rows, ti.i32), point
            )
            gap, normal = found[0], found.yz
            if ti.static(lattice.features.turns):
                normal = turning.turned(lattice, b, normal)
            if ti.static(lattice.features.edged):
                gap -= _reach(lattice, b, i, j, edge)
            if gap < 0.0:
                tangent = vec2(-normal.y, normal.x)
                relative = vec2(speed.x, speed.y - body.trial_v)
                if ti.static(lattice.features.turns):
                    relative = speed - turning.velocity_of(lattice, b, arm)
                spring = contact_law.normal_force(stiffness, gap)
                press = contact_law.damped_force(
                    spring, p.contact_dashpot * stiffness, relative.dot(normal)
                )
                path = _slid(lattice, b, i, j, stage) - _impactor_slid(lattice, b, arm, stage)
                along = contact_law.tangential_force(
                    stiffness,
                    lattice.state.slip[b, i, k].impactor[lane] + path.dot(tangent),
                    p.impactor_friction,
                    press,
                )
                pressing = press * normal
                rubbing = along * tangent
                on_impactor = -along / stiffness
                if ti.static(lattice.features.turns):
                    turning.add_reaction(lattice, b, strip, pressing + rubbing, arm)
                work[WORK.contact] -= weight * pressing.dot(relative)
                work[WORK.friction] -= weight * rubbing.dot(relative)
                if stage == LAST_STAGE:
                    work[WORK.held_by_contact] += 0.5 * spring * spring / stiffness
                    work[WORK.held_by_friction] += 0.5 * along * along / stiffness
                lattice.scratch.contact_force[b, strip] = lattice.scratch.contact_force[
                    b, strip
                ] - (pressing.y + rubbing.y)
                lattice.state.overlap[b, strip] = ti.max(lattice.state.overlap[b, strip], -gap)
                force += pressing + rubbing
        standing, stretch, stored = _stand(lattice, b, i, j, stage, now, stiffness, p)
        on_floor = stretch
        pressed, rubbed = standing.xy, standing.zw
        work[WORK.contact] -= weight * pressed.dot(speed)
        work[WORK.friction] -= weight * rubbed.dot(speed)
        if stage == LAST_STAGE:
            work[WORK.held_by_base] += stored
            work[WORK.held_by_base_friction] += 0.5 * stiffness * stretch * stretch
        force += pressed + rubbed
        lattice.state.work[b, strip] = work
    if stage == 0:
        lattice.state.slip[b, i, k].impactor[lane] = on_impactor
        lattice.state.slip[b, i, k].floor[lane] = on_floor
    return force


@ti.func
def _stand(lattice: ti.template(), b, i, j, stage, now: vec2, stiffness: ti.f64, p: ti.template()):
    """Forces [N] of the floor or the support on a node: normal force (x, y) and friction (z, w).

    Also returns the stretch of the friction spring [m] and the energy stored by the normal force
    [J].

    Between the node and the body lies half a cell of foam, or what crushing has left of it, along
    the outline's normal. Where the normal is horizontal, the foam lies beside the node: it is half
    a cell wide, with the crush and the faces of the node's bonds A.
    """
    distance, normal = now.y, vec2(0.0, 1.0)
    if ti.static(lattice.features.supported):
        rows = ti.cast(p.support_rows, ti.i32)
        found = Edged.distance(lattice.model.support, b, rows, now)
        distance, normal = found[0], found.yz
    flank = normal.x * normal.x  # weight of the horizontal direction; 1 - flank is the vertical's
    half = 0.5 * (p.cell.y + flank * (p.cell.x - p.cell.y))
    upright, sideways = p.area.y, p.area.x
    if ti.static(lattice.features.shaped):
        half = makeup.reach(lattice, b, i, j)
        upright *= makeup.wider_face(lattice, B, b, i, j)
        sideways *= makeup.wider_face(lattice, A, b, i, j)
    stand, stretch, stored = vec4(0.0), 0.0, 0.0
    if distance < half:
        height = _least_height(lattice, b, i, j)
        strain = height + flank * (_least_width(lattice, b, i, j) - height)
        radius = half * (1.0 + strain)
        press = 0.0
        if ti.static(lattice.features.shaped) and half < THIN * p.cell.y:
            press = contact_law.normal_force(stiffness, distance - half)
            stored = 0.5 * press * press / stiffness
        elif distance < radius:
            c = makeup.constants_at(lattice, B, b, j, p)
            face = upright + flank * (sideways - upright)
            press = -face * lattice.law.contact_stress(c, distance, radius, half)
            stored = face * half * lattice.law.contact_energy(c, distance, radius, half)
        tangent = vec2(normal.y, -normal.x)
        along = contact_law.tangential_force(
            stiffness,
            lanes.value(lattice, lattice.state.slip.floor, b, i, j)
            + _slid(lattice, b, i, j, stage).dot(tangent),
            p.floor_friction,
            press,
        )
        stand.xy, stand.zw = press * normal, along * tangent
        stretch = -along / stiffness
    return stand, stretch, stored


@ti.func
def _worst(bonds: ti.template(), lattice: ti.template(), b, i, j) -> ti.f64:
    return lanes.value(lattice, bonds.worst, b, i, j)


@ti.func
def _least_height(lattice: ti.template(), b, i, j) -> ti.f64:
    """The worst strain of a node's bonds B."""
    bond_b = ti.static(lattice.state.bond_b)
    return ti.min(_worst(bond_b, lattice, b, i, j), _worst(bond_b, lattice, b, i, j - 1))


@ti.func
def _least_width(lattice: ti.template(), b, i, j) -> ti.f64:
    """The worst strain of a node's bonds A."""
    bond_a = ti.static(lattice.state.bond_a)
    return ti.min(_worst(bond_a, lattice, b, i, j), _worst(bond_a, lattice, b, i - 1, j))


@ti.func
def _reach(lattice: ti.template(), b, i, j, edge) -> ti.f64:
    """How far [m] the foam of a mass point reaches beyond it to a body; `edge` before any crush.

    It is the same in all directions, so that contact has a potential, and only ever falls: what
    grew without motion would make energy. So a point in front of the foam stays there.
    """
    worst = ti.min(_least_height(lattice, b, i, j), _least_width(lattice, b, i, j))
    return edge + ti.max(edge, 0.0) * worst


@ti.func
def full_radius(lattice: ti.template(), b, i, j, p: ti.template()) -> ti.f64:
    """Radius [m] of a node's disc, whose area shrinks as the node's bonds are crushed.

    In whole foam only the bonds are stressed: two nodes with a third between them do not touch,
    however flat all three are crushed.
    """
    width = p.cell.x * (1.0 + _least_width(lattice, b, i, j))
    height = p.cell.y * (1.0 + _least_height(lattice, b, i, j))
    radius = 0.5 * p.piece_size * ti.sqrt(width * height)
    if ti.static(lattice.features.shaped):
        radius *= ti.sqrt(makeup.share(lattice, b, i, j))
    flat = ti.min(width, height)
    if flat < radius and not bonds.is_torn(lattice, b, i, j):
        radius = flat
    return radius


@ti.func
def looked_at(lattice: ti.template(), b, i, j, surface) -> ti.i32:
    """A node's `surface` as a list is made: NEW if it has become a surface or torn since the last.

    `surface` is its value so far.
    """
    found = surface
    if surface == INSIDE:
        found = ti.select(bonds.is_surface(lattice, b, i, j) != 0, NEW, INSIDE)
    elif surface == OUTER:
        found = ti.select(bonds.is_torn(lattice, b, i, j) != 0, NEW, OUTER)
    return found


@ti.func
def listed(lattice: ti.template(), b, i, j, surface) -> ti.i32:
    """A node's `surface` once the list is made."""
    found = surface
    if surface == NEW:
        found = ti.select(bonds.is_torn(lattice, b, i, j) != 0, TORN, OUTER)
    return found


@ti.func
def piece_radius(lattice: ti.template(), b, i, j, p: ti.template()) -> ti.f64:
    """`full_radius`, but at most the node's room, see `room_of`."""
    radius = full_radius(lattice, b, i, j, p)
    if ti.static(lattice.features.self_contact):
        radius = ti.min(radius, lanes.value(lattice, lattice.state.room, b, i, j))
    return radius


@ti.func
def touch_of(one: ti.f64, two: ti.f64) -> ti.f64:
    """Distance [m] at which mass points of these two radii [m] begin to touch."""
    return one + two + LEVEL * ti.abs(one - two)


@ti.func
def is_pushed(lattice: ti.template(), b, i, k) -> ti.i32:
    """Whether the pushes on a pack may be non-zero."""
    may_be = 0
    if ti.static(lattice.on_gpu):
        may_be = ti.i32(lattice.state.partner_count[b, i * lattice.counts[None].rows + k] > 0)
    else:
        may_be = elementary.any_of(lattice.state.place_in_list[b, i, k] > UNLISTED)
    return may_be


@ti.func
def pushes_on(lattice: ti.template(), b, i, k):
    """Forces [N] of other pieces on a pack of nodes, along x and y."""
    x, y = lanes.zeros(lattice), lanes.zeros(lattice)
    if ti.static(lattice.on_gpu):
        x, y = lattice.scratch.push[b, i, k].x, lattice.scratch.push[b, i, k].y
    else:
        for lane in range(lattice.lanes):
            n = lattice.state.place_in_list[b, i, k][lane]
            if n > UNLISTED:
                push = lattice.scratch.candidate_push[b, n]
                x += lanes.only(lattice, lane, push[0])
                y += lanes.only(lattice, lane, push[1])
    return x, y


@ti.func
def piece_push(
    lattice: ti.template(), b, one, two, away: vec2, closing: vec2, touch: ti.f64, torn: ti.f64,
    p: ti.template(),
) -> vec2:  # fmt: skip
    """Force [N] on node `one` from node `two`, both given by their numbers.

    `away` is the vector from `one` to `two` [m], `closing` the velocity of `two` relative to `one`
    [m/s] and `touch` the distance at which they touch [m]; if both vectors are reversed, so is the
    force. `torn` is a node's broken faces over the number of its partners, the smaller of the two
    nodes' values. The normal force is elastic, by the softer foam; friction adds to it. There are
    no branches: a processor could not predict which candidates touch.

    The dashpots by which a node rubs are in place of those of its broken bonds: they shorten no
    step unless those are weaker (`model._fastest_rate`). Foam without cracks does not rub.
    """
    gap, share = away.norm(), _share_of_pair(lattice, b, one, two)
    stress = _stiffness_of_pair(lattice, b, one, two, p) * (gap - touch) / p.piece_length
    acts = gap < touch and gap > 0.0
    normal = away * ti.select(acts, 1.0 / gap, 0.0)
    tangent = vec2(-normal.y, normal.x)
    area = p.piece_area * share
    rubbing = contact_law.rubbing_force(
        p.piece_dashpot * ti.min(torn, 1.0),
        -closing.dot(tangent),
        p.piece_friction,
        -area * stress,
    )
    return normal * (area * stress) + tangent * rubbing


@ti.func
def _stiffness_of_pair(lattice: ti.template(), b, one, two, p: ti.template()) -> ti.f64:
    """Stress [Pa] between two pieces over their overlap in cells."""
    _, j = lanes.column_and_row(lattice, one)
    found = lattice.law.piece_stiffness(makeup.constants_at(lattice, B, b, j, p))
    if ti.static(lattice.features.foams > 1):
        _, other = lanes.column_and_row(lattice, two)
        c = makeup.constants_at(lattice, B, b, other, p)
        found = ti.min(found, lattice.law.piece_stiffness(c))
    return found


@ti.func
def _share_of_pair(lattice: ti.template(), b, one, two) -> ti.f64:
    """Share of a whole cell's face on which two nodes touch: that of the node with less foam."""
    i, j = lanes.column_and_row(lattice, one)
    oi, oj = lanes.column_and_row(lattice, two)
    return ti.min(makeup.share(lattice, b, i, j), makeup.share(lattice, b, oi, oj))


@ti.func
def piece_energy(lattice: ti.template(), b, one, two, gap, touch: ti.f64, p: ti.template()):
    """Energy [J] that the contact of two nodes stores, see `piece_push`."""
    overlap = ti.min(gap - touch, 0.0) / p.piece_length
    energy = 0.5 * _stiffness_of_pair(lattice, b, one, two, p) * overlap * overlap
    return p.piece_area * p.piece_length * _share_of_pair(lattice, b, one, two) * energy


@ti.func
def push_pieces(lattice: ti.template(), b, stage, p: ti.template()):
    """The pushes [N] on all nodes that touch others.

    A node at a surface of the block or of a crack may touch any node but its neighbours in the
    lattice: for these, the bond's own law covers compression, broken or not. Only one thread adds
    to a lattice's pushes, so there are no atomics.
    """
    pushes = ti.static(lattice.scratch.candidate_push)
    for n in range(lattice.state.clock[b].candidates):
        i, j = lanes.column_and_row(lattice, lattice.state.candidate_node[b, n])
        now = lanes.position(lattice, lattice.scratch.trial, b, i, j)
        speed = lanes.velocity(lattice, lattice.scratch.trial, b, i, j)
        lattice.state.candidate[b, n].x = now.x
        lattice.state.candidate[b, n].y = now.y
        lattice.state.candidate[b, n].u = speed.x
        lattice.state.candidate[b, n].v = speed.y
        pushes[b, n] = vec2(0.0)
    held = 0.0
    for n in range(lattice.state.clock[b].pairs):
        pair = lattice.state.pairs[b, n]
        one = lattice.state.candidate[b, pair[0]]
        two = lattice.state.candidate[b, pair[1]]
        away = vec2(one.x - two.x, one.y - two.y)
        closing = vec2(one.u - two.u, one.v - two.v)
        one_node = lattice.state.candidate_node[b, pair[0]]
        other_node = lattice.state.candidate_node[b, pair[1]]
        touch = touch_of(one.radius, two.radius)
        torn = ti.min(one.torn, two.torn)
        push = piece_push(lattice, b, one_node, other_node, away, closing, touch, torn, p)
        lattice.scratch.candidate_push[b, pair[0]] = (
            lattice.scratch.candidate_push[b, pair[0]] - push
        )
        lattice.scratch.candidate_push[b, pair[1]] = (
            lattice.scratch.candidate_push[b, pair[1]] + push
        )
        if stage == LAST_STAGE:
            held += piece_energy(lattice, b, one_node, other_node, away.norm(), touch, p)
    if stage == LAST_STAGE:
        lattice.state.work[b, 0][WORK.held_by_pieces] = held


@ti.func
def refresh_radii(lattice: ti.template(), b, p: ti.template()):
    """Update the radii of the nodes that may touch to their present crush."""
    for n in range(lattice.state.clock[b].candidates):
        i, j = lanes.column_and_row(lattice, lattice.state.candidate_node[b, n])
        lattice.state.candidate[b, n].radius = piece_radius(lattice, b, i, j, p)


@ti.func
def bin_of(lattice: ti.template(), point: vec2, p: ti.template()) -> ti.types.vector(2, ti.i32):
    """Bin of a point in the search grid; points outside the grid belong to its outermost bins.

    A bin is as wide as the list reaches from the largest node: a node's neighbours are in its own
    bin or in one beside it. Clamping moves no two points further apart, so none is missed.
    """
    size = ti.max(p.cell.max(), p.piece_size * p.piece_length) + p.skin
    half = 0.5 * size * lattice.counts[None].bins_x
    x = ti.math.clamp((point.x + half) / size, 0.0, lattice.counts[None].bins_x - 1.0)
    y = ti.math.clamp(point.y / size + 2.0, 0.0, lattice.counts[None].bins_y - 1.0)
    return ti.Vector([ti.i32(x), ti.i32(y)])


@ti.func
def list_neighbours(lattice: ti.template(), b, p: ti.template()):
    """Build the search grid and the neighbour list of one lattice, serially.

    Being serial, the order of the list, and so every sum, is the same for any number of threads.
    It is seldom needed: when a node has moved by half the skin, or a bond has broken. Until it is
    made, the nodes' full radii [m] are in place of their trial positions along x, which between two
    steps are those of the accepted state.
    """
    for n in range(lattice.state.clock[b].candidates):
        i, j = lanes.column_and_row(lattice, lattice.state.candidate_node[b, n])
        k, lane = lanes.pack_of(lattice, j), lanes.lane_of(lattice, j)
        lattice.state.place_in_list[b, i, k][lane] = UNLISTED
    for n in range(lattice.counts[None].bins_x * lattice.counts[None].bins_y):
        lattice.scratch.bin_head[b, n] = -1
    for i in range(lattice.counts[None].columns):
        for j in range(lattice.counts[None].rows):
            k, lane = lanes.pack_of(lattice, j), lanes.lane_of(lattice, j)
            lattice.scratch.trial[b, i, k].x[lane] = full_radius(lattice, b, i, j, p)
            lattice.state.surface[b, i, k][lane] = looked_at(
                lattice, b, i, j, lattice.state.surface[b, i, k][lane]
            )
            node = i * lattice.counts[None].rows + j
            cell = bin_of(lattice, lanes.position(lattice, lattice.state.motion, b, i, j), p)
            head = cell.x * lattice.counts[None].bins_y + cell.y
            lattice.scratch.next_in_bin[b, node] = lattice.scratch.bin_head[b, head]
            if makeup.is_there(lattice, b, i, j):
                lattice.scratch.bin_head[b, head] = node
    found = 0
    for i in range(lattice.counts[None].columns):
        for j in range(lattice.counts[None].rows):
            if lanes.value(lattice, lattice.state.surface, b, i, j) != INSIDE:
                found = _list_around(lattice, b, i, j, found, p)
    lattice.state.clock[b].stale = 0
    lattice.state.clock[b].drift = 0.0
    lattice.state.clock[b].pairs = ti.min(found, lattice.most_pairs)
    if found > lattice.most_pairs:
        lattice.state.clock[b].status = CROWDED
    _list_candidates(lattice, b)
    _make_room(lattice, b)
    for i in range(lattice.counts[None].columns):
        for k in range(lattice.counts[None].packs):
            lattice.scratch.trial[b, i, k].x = lattice.state.motion[b, i, k].x
        for j in range(lattice.counts[None].rows):
            k, lane = lanes.pack_of(lattice, j), lanes.lane_of(lattice, j)
            lattice.state.surface[b, i, k][lane] = listed(
                lattice, b, i, j, lattice.state.surface[b, i, k][lane]
            )
    refresh_radii(lattice, b, p)


@ti.func
def _list_around(lattice: ti.template(), b, i, j, found, p: ti.template()) -> ti.i32:
    """Append the pairs of a surface node with nodes near it, except its lattice neighbours.

    Of two surface nodes, the one with the lower number lists the pair.
    """
    node = i * lattice.counts[None].rows + j
    point = lanes.position(lattice, lattice.state.motion, b, i, j)
    home = bin_of(lattice, point, p)
    own = lanes.value(lattice, lattice.scratch.trial.x, b, i, j)
    count = found
    for bx in range(ti.max(home.x - 1, 0), ti.min(home.x + 2, lattice.counts[None].bins_x)):
        for by in range(ti.max(home.y - 1, 0), ti.min(home.y + 2, lattice.counts[None].bins_y)):
            other = lattice.scratch.bin_head[b, bx * lattice.counts[None].bins_y + by]
            while other >= 0:
                oi, oj = lanes.column_and_row(lattice, other)
                listed = (
                    lanes.value(lattice, lattice.state.surface, b, oi, oj) != INSIDE
                    and other < node
                )
                if not listed and ti.abs(oi - i) + ti.abs(oj - j) > 1:
                    radius = lanes.value(lattice, lattice.scratch.trial.x, b, oi, oj)
                    limit = touch_of(own, radius) + p.skin
                    away = lanes.position(lattice, lattice.state.motion, b, oi, oj) - point
                    if away.norm_sqr() < limit * limit:
                        if count < lattice.most_pairs:
                            lattice.state.pairs[b, count] = ti.Vector([node, other])
                        count += 1
                other = lattice.scratch.next_in_bin[b, other]
    return count


@ti.func
def _make_room(lattice: ti.template(), b):
    """Limit radii so that new contacts begin without overlap; let them recover if there is room."""
    gaps = ti.static(lattice.scratch.candidate_push)  # unused as yet: free, torn; see `room_of`
    for n in range(lattice.state.clock[b].candidates):
        gaps[b, n] = vec2(NEVER, 1.0)
    for n in range(lattice.state.clock[b].pairs):
        pair = lattice.state.pairs[b, n]
        i, j = lanes.column_and_row(lattice, lattice.state.candidate_node[b, pair[0]])
        oi, oj = lanes.column_and_row(lattice, lattice.state.candidate_node[b, pair[1]])
        away = lanes.position(lattice, lattice.state.motion, b, oi, oj)
        distance = (away - lanes.position(lattice, lattice.state.motion, b, i, j)).norm()
        touch = touch_of(_listed_radius(lattice, b, i, j), _listed_radius(lattice, b, oi, oj))
        is_new = (
            lanes.value(lattice, lattice.state.surface, b, i, j) == NEW
            or lanes.value(lattice, lattice.state.surface, b, oi, oj) == NEW
        )
        found = vec2(distance - touch, ti.select(is_new, distance / touch, 1.0))
        for side in ti.static(range(2)):
            gaps[b, pair[side]] = ti.min(gaps[b, pair[side]], found)
    for n in range(lattice.state.clock[b].candidates):
        i, j = lanes.column_and_row(lattice, lattice.state.candidate_node[b, n])
        k, lane = lanes.pack_of(lattice, j), lanes.lane_of(lattice, j)
        full = lattice.scratch.trial[b, i, k].x[lane]
        radius = _listed_radius(lattice, b, i, j)
        lattice.state.room[b, i, k][lane] = room_of(radius, full, gaps[b, n][0], gaps[b, n][1])


@ti.func
def _listed_radius(lattice: ti.template(), b, i, j) -> ti.f64:
    """A node's radius [m] before the list is made, see `list_neighbours`."""
    full = lanes.value(lattice, lattice.scratch.trial.x, b, i, j)
    return ti.min(full, lanes.value(lattice, lattice.state.room, b, i, j))


@ti.func
def room_of(radius: ti.f64, full: ti.f64, free: ti.f64, torn: ti.f64) -> ti.f64:
    """Upper limit of a node's radius [m] from now on.

    `free` is the smallest gap to a listed node [m], negative where they overlap. `torn` is the
    smallest distance to a node with which contact has just become possible, over the distance at
    which the two touch, or 1. Nodes of foam that has sheared in compression may be closer than
    their radii when it tears. Sudden contact there would create energy, so both radii are reduced.
    Later each grows by half the gap, so that two that both grow then just touch.
    """
    room = ti.select(torn < 1.0, torn * radius, radius + 0.5 * ti.max(free, 0.0))
    return ti.select(room < full, room, NEVER)


@ti.func
def _list_candidates(lattice: ti.template(), b):
    """List the nodes that have a pair, in place of whose numbers pairs get their places in it."""
    found = 0
    for n in range(lattice.state.clock[b].pairs):
        for side in ti.static(range(2)):
            node = lattice.state.pairs[b, n][side]
            i, j = lanes.column_and_row(lattice, node)
            k, lane = lanes.pack_of(lattice, j), lanes.lane_of(lattice, j)
            if lattice.state.place_in_list[b, i, k][lane] == UNLISTED:
                lattice.state.place_in_list[b, i, k][lane] = found
                if found < lattice.most_candidates:
                    lattice.state.candidate_node[b, found] = node
                found += 1
            lattice.state.pairs[b, n][side] = lattice.state.place_in_list[b, i, k][lane]
    lattice.state.clock[b].candidates = ti.min(found, lattice.most_candidates)
    if found > lattice.most_candidates:
        lattice.state.clock[b].status = CROWDED
        lattice.state.clock[b].pairs = 0
    _share_broken_faces(lattice, b)


@ti.func
def _share_broken_faces(lattice: ti.template(), b):
    """Find the broken faces of each candidate over the number of its partners."""
    for n in range(lattice.state.clock[b].candidates):
        lattice.state.candidate[b, n].torn = 0.0
    for n in range(lattice.state.clock[b].pairs):  # counts the partners first
        for side in ti.static(range(2)):
            m = lattice.state.pairs[b, n][side]
            lattice.state.candidate[b, m].torn = lattice.state.candidate[b, m].torn + 1.0
    for n in range(lattice.state.clock[b].candidates):
        i, j = lanes.column_and_row(lattice, lattice.state.candidate_node[b, n])
        partners = ti.max(lattice.state.candidate[b, n].torn, 1.0)
        lattice.state.candidate[b, n].torn = bonds.broken_faces(lattice, b, i, j) / partners
