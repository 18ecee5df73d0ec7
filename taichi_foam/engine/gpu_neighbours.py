"""A GPU's neighbour lists: which nodes may touch, found by many threads at once.

The lists do not depend on the order in which threads run: each bin of the search grid is a list
sorted by node number, and each node adds the pushes of its partners in the order of the bins. Only
the place where a node's partners are stored depends on it; no result does.

Threads call each part for their strip; all must finish one part before any begins the next.
"""

from taichi_foam.backend import ti
from taichi_foam.engine import bonds, contact, lanes, makeup
from taichi_foam.engine.contact import INSIDE, NEW
from taichi_foam.engine.lattice import LAST_STAGE
from taichi_foam.engine.state import CROWDED, NEVER, WORK, book

vec2 = ti.types.vector(2, ti.f64)

NOBODY = -1  # ends the list of a bin


@ti.func
def _point(lattice: ti.template(), motion: ti.template(), b, n) -> vec2:
    i, j = lanes.column_and_row(lattice, n)
    return lanes.position(lattice, motion, b, i, j)


@ti.func
def begin_list(lattice: ti.template(), b, strip, width, p: ti.template()):
    """Part 1: empty the bins; find each node's bin, full radius and `surface`."""
    n = strip
    while n < lattice.counts[None].bins_x * lattice.counts[None].bins_y:
        lattice.scratch.bin_head[b, n] = NOBODY
        n += width
    n = strip
    while n < lattice.counts[None].nodes:
        i, j = lanes.column_and_row(lattice, n)
        lattice.state.radius[b, i, j][0] = contact.full_radius(lattice, b, i, j, p)
        lattice.state.surface[b, i, j][0] = contact.looked_at(
            lattice, b, i, j, lattice.state.surface[b, i, j][0]
        )
        cell = contact.bin_of(lattice, _point(lattice, lattice.state.motion, b, n), p)
        lattice.scratch.bin_of_node[b, n] = cell.x * lattice.counts[None].bins_y + cell.y
        lattice.scratch.next_in_bin[b, n] = NOBODY
        n += width
    if strip == 0:
        lattice.state.clock[b].pairs = 0


@ti.func
def fill_own_bins(lattice: ti.template(), b, strip, width):
    """Part 2: put nodes into a strip's bins, each a list with the highest number first.

    Each bin belongs to one strip, the one that emptied it. Every strip reads all nodes, which is
    efficient for few nodes only.
    """
    for n in range(lattice.counts[None].nodes):
        cell = lattice.scratch.bin_of_node[b, n]
        if ti.raw_mod(cell, width) == strip:
            lattice.scratch.next_in_bin[b, n] = lattice.scratch.bin_head[b, cell]
            lattice.scratch.bin_head[b, cell] = n


@ti.func
def fill_bins(lattice: ti.template(), b, strip, width):
    """Part 2 for many nodes, with the same result: put the nodes of a strip into their bins.

    A bin is a linked list from larger numbers to smaller ones. An atomic maximum puts a node's
    number into a link; the smaller of the two numbers moves on to the link of the larger one, until
    a link is free.
    """
    n = strip
    while n < lattice.counts[None].nodes:
        carried = n
        met = ti.atomic_max(lattice.scratch.bin_head[b, lattice.scratch.bin_of_node[b, n]], carried)
        while met != NOBODY:
            larger = ti.max(carried, met)
            carried = ti.min(carried, met)
            met = ti.atomic_max(lattice.scratch.next_in_bin[b, larger], carried)
        n += width


@ti.func
def count_partners(lattice: ti.template(), b, strip, width, p: ti.template()) -> ti.i32:
    """Part 3: count the partners of each node of a strip; returns their total."""
    total = 0
    n = strip
    while n < lattice.counts[None].nodes:
        count = _search(lattice, b, n, False, 0, p)
        lattice.state.partner_count[b, n] = count
        total += count
        n += width
    return total


@ti.func
def list_partners(lattice: ti.template(), b, strip, width, start, total, p: ti.template()):
    """Part 4: list the `total` partners of a strip's nodes from place `start` on."""
    at = start
    n = strip
    while n < lattice.counts[None].nodes:
        count = ti.select(
            start + total > 2 * lattice.most_pairs, 0, lattice.state.partner_count[b, n]
        )
        lattice.state.partner_start[b, n] = at
        lattice.state.partner_count[b, n] = count
        if count > 0:
            _search(lattice, b, n, True, at, p)
        else:
            i, j = lanes.column_and_row(lattice, n)
            lattice.scratch.push[b, i, j].x[0] = 0.0
            lattice.scratch.push[b, i, j].y[0] = 0.0
        at += count
        n += width


@ti.func
def _search(
    lattice: ti.template(), b, node, listing: ti.template(), start, p: ti.template()
) -> ti.i32:
    """Count a node's partners, and list them from `start` on if `listing`.

    A partner is near, is not a lattice neighbour, and at least one of the two is at a surface.
    """
    i, j = lanes.column_and_row(lattice, node)
    point = _point(lattice, lattice.state.motion, b, node)
    home = contact.bin_of(lattice, point, p)
    own = lattice.state.radius[b, i, j][0]
    inside = lattice.state.surface[b, i, j][0] == INSIDE
    there = makeup.is_there(lattice, b, i, j)
    count = 0
    for bx in range(ti.max(home.x - 1, 0), ti.min(home.x + 2, lattice.counts[None].bins_x)):
        for by in range(ti.max(home.y - 1, 0), ti.min(home.y + 2, lattice.counts[None].bins_y)):
            other = lattice.scratch.bin_head[b, bx * lattice.counts[None].bins_y + by]
            while other != NOBODY:
                oi, oj = lanes.column_and_row(lattice, other)
                both_inside = inside and lattice.state.surface[b, oi, oj][0] == INSIDE
                both_there = there and makeup.is_there(lattice, b, oi, oj)
                if both_there and not both_inside and ti.abs(oi - i) + ti.abs(oj - j) > 1:
                    limit = contact.touch_of(own, lattice.state.radius[b, oi, oj][0]) + p.skin
                    away = _point(lattice, lattice.state.motion, b, other) - point
                    if away.norm_sqr() < limit * limit:
                        if ti.static(listing):
                            lattice.state.partners[b, start + count] = other
                        count += 1
                other = lattice.scratch.next_in_bin[b, other]
    return count


@ti.func
def make_room(lattice: ti.template(), b, strip, width):
    """Part 5: compute the nodes' room, stored for now in place of their pushes; see `contact`."""
    n = strip
    while n < lattice.counts[None].nodes:
        i, j = lanes.column_and_row(lattice, n)
        radius = _listed_radius(lattice, b, i, j)
        is_new = lattice.state.surface[b, i, j][0] == NEW
        free, torn = NEVER, 1.0
        for m in range(lattice.state.partner_count[b, n]):
            other = lattice.state.partners[b, lattice.state.partner_start[b, n] + m]
            oi, oj = lanes.column_and_row(lattice, other)
            away = _point(lattice, lattice.state.motion, b, other)
            distance = (away - _point(lattice, lattice.state.motion, b, n)).norm()
            touch = contact.touch_of(radius, _listed_radius(lattice, b, oi, oj))
            free = ti.min(free, distance - touch)
            if is_new or lattice.state.surface[b, oi, oj][0] == NEW:
                torn = ti.min(torn, distance / touch)
        if lattice.state.partner_count[b, n] > 0:
            full = lattice.state.radius[b, i, j][0]
            lattice.scratch.push[b, i, j].x[0] = contact.room_of(radius, full, free, torn)
        n += width


@ti.func
def _listed_radius(lattice: ti.template(), b, i, j) -> ti.f64:
    """A node's radius [m] before the list is made; in parts 1 to 5 `radius` is the full radius."""
    return ti.min(lattice.state.radius[b, i, j][0], lattice.state.room[b, i, j][0])


@ti.func
def end_list(lattice: ti.template(), b, strip, width, p: ti.template()):
    """Part 6: new surface nodes become listed ones, and radii are limited to their room."""
    n = strip
    while n < lattice.counts[None].nodes:
        i, j = lanes.column_and_row(lattice, n)
        lattice.state.surface[b, i, j][0] = contact.listed(
            lattice, b, i, j, lattice.state.surface[b, i, j][0]
        )
        if lattice.state.partner_count[b, n] > 0:
            lattice.state.room[b, i, j][0] = lattice.scratch.push[b, i, j].x[0]
        n += width
    refresh_radii(lattice, b, strip, width, p)


@ti.func
def refresh_radii(lattice: ti.template(), b, strip, width, p: ti.template()):
    """Update the radii of the nodes that may touch to their present crush."""
    n = strip
    while n < lattice.counts[None].nodes:
        if lattice.state.partner_count[b, n] > 0:
            i, j = lanes.column_and_row(lattice, n)
            lattice.state.radius[b, i, j][0] = contact.piece_radius(lattice, b, i, j, p)
        n += width


@ti.func
def close_list(lattice: ti.template(), b):
    """Part 7, by one thread: mark the list as current; each of its pairs was counted twice."""
    lattice.state.clock[b].stale = 0
    lattice.state.clock[b].drift = 0.0
    if lattice.state.clock[b].pairs > 2 * lattice.most_pairs:
        lattice.state.clock[b].status = CROWDED
    lattice.state.clock[b].pairs = lattice.state.clock[b].pairs >> 1


@ti.func
def torn(lattice: ti.template(), b, n, p: ti.template()) -> ti.f64:
    """Broken faces of a listed node over the number of its partners; 0 if pieces do not rub."""
    found = 0.0
    if p.piece_friction > 0.0:
        i, j = lanes.column_and_row(lattice, n)
        found = bonds.broken_faces(lattice, b, i, j) / lattice.state.partner_count[b, n]
    return found


@ti.func
def push(lattice: ti.template(), b, n, stage, strip, p: ti.template()):
    """The pushes [N] of a node's partners on it; each pair is computed once for each node."""
    count = lattice.state.partner_count[b, n]
    if count > 0:
        i, j = lanes.column_and_row(lattice, n)
        point = _point(lattice, lattice.scratch.trial, b, n)
        speed = lanes.velocity(lattice, lattice.scratch.trial, b, i, j)
        own = torn(lattice, b, n, p)
        total = vec2(0.0)
        for m in range(count):
            other = lattice.state.partners[b, lattice.state.partner_start[b, n] + m]
            oi, oj = lanes.column_and_row(lattice, other)
            away = point - _point(lattice, lattice.scratch.trial, b, other)
            closing = speed - lanes.velocity(lattice, lattice.scratch.trial, b, oi, oj)
            touch = contact.touch_of(
                lattice.state.radius[b, i, j][0], lattice.state.radius[b, oi, oj][0]
            )
            less = ti.min(own, torn(lattice, b, other, p))
            total -= contact.piece_push(lattice, b, n, other, away, closing, touch, less, p)
            if stage == LAST_STAGE:
                held = contact.piece_energy(lattice, b, n, other, away.norm(), touch, p)
                book(lattice, b, strip, WORK.held_by_pieces, 0.5 * held)
        lattice.scratch.push[b, i, j].x[0] = total.x
        lattice.scratch.push[b, i, j].y[0] = total.y
