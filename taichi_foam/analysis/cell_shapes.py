"""The shape of every node's cell, from the node positions and the state of the bonds.

Along the outline of a block, the corners of its cells are moved onto the outline.

Points are complex numbers here (x + iy): rotating a vector by a right angle is then a product
with i, and one array holds both coordinates.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from taichi_foam.analysis.cell_state import apart, bonded, over_bonds, worst_strain
from taichi_foam.records.snapshot import Snapshot
from taichi_foam.scene import Block
from taichi_foam.scene.filling import filling, in_cells
from taichi_foam.scene.layers import layer_of_rows
from taichi_foam.scene.outlines import is_mirrored

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Ints = NDArray[np.intp]
Points = NDArray[np.complex128]

#: Upper limit of half lengths, as a share of the cell: bonds break at 5 % tensile strain.
LONGEST_HALF = 0.53
#: A crushed face is never drawn thinner than this share of the cell.
THINNEST = 0.05

#: Only torn cells that were compressed further than this may have folded.
FOLDING_STRAIN = -0.3
#: A side longer than this share of the reference cell belongs to a cell torn out of shape.
LONGEST_SIDE = 1.2

AT_CORNER = 0.75
"""A corner of cells this near to a corner of the outline [cells] is moved to it, others to a side.

If an outline corner is the nearest outline point of some cell corners, only these are moved to it:
another one beside them would leave a cell without a side."""

FURTHEST = 1.0
"""Corners further from the outline than this [cells] stay: the foam there is too thin to show."""

#: Bits of `open_sides`.
LEFT, RIGHT, BOTTOM, TOP = 1, 2, 4, 8
ALL_SIDES = LEFT | RIGHT | BOTTOM | TOP


def shapes_of(snapshot: Snapshot, block: Block) -> tuple[Floats, NDArray[np.int32]]:
    """Corners (columns, rows, 4, 2) [m] of all deformed cells, and their `open_sides`.

    The corners run from the lower left one counter-clockwise. Around each lattice corner, cells
    connected by unbroken bonds share one point, the mean of their own estimates of the corner.
    Cells on the two sides of a crack have separate points, so the crack opens as a gap. A free edge
    is extended by half a cell, and cells along an outline end on it. Cells of tumbled rubble would
    be folded or stretched; each of these is drawn as a separate rectangle. Cells without a mass
    point represent no foam.
    """
    lattice = _Lattice(snapshot, block)
    z = lattice.z
    shared = np.zeros((block.columns + 1, block.rows + 1), dtype=np.complex128)
    # Between four connected cells the half vectors cancel: the corner is the mean of the nodes.
    shared[1:-1, 1:-1] = 0.25 * ((z[:-1, :-1] + z[1:, :-1]) + (z[:-1, 1:] + z[1:, 1:]))
    points = np.stack([shared[:-1, :-1], shared[1:, :-1], shared[1:, 1:], shared[:-1, 1:]], axis=-1)
    _mend(points, lattice)
    _unfold(points, lattice)
    quads = points.view(np.float64).reshape(*z.shape, 4, 2)
    return on_outline(quads, block), open_sides(*lattice.apart)


def layer_faces(snapshot: Snapshot, block: Block) -> NDArray[np.int32]:
    """Sides of cells at uncracked interfaces between layers, (columns, rows): TOP or 0."""
    layer, (_, apart_b) = layer_of_rows(block), apart(snapshot, block)
    faces = np.zeros((block.columns, block.rows), dtype=np.int32)
    faces[:, :-1][~apart_b & (layer[:-1] != layer[1:])] = TOP
    return faces


def open_sides(broken_a: Bools, broken_b: Bools) -> NDArray[np.int32]:
    """Which sides of each cell face a crack or the outside: LEFT | RIGHT | BOTTOM | TOP."""
    columns, rows = broken_b.shape[0], broken_a.shape[1]
    sides = np.zeros((columns, rows), dtype=np.int32)
    sides[0] |= LEFT
    sides[-1] |= RIGHT
    sides[:, 0] |= BOTTOM
    sides[:, -1] |= TOP
    sides[1:] |= broken_a * np.int32(LEFT)
    sides[:-1] |= broken_a * np.int32(RIGHT)
    sides[:, 1:] |= broken_b * np.int32(BOTTOM)
    sides[:, :-1] |= broken_b * np.int32(TOP)
    return sides


class _Lattice:
    """Nodes z (columns, rows) [m] and bonds, padded with absent bonds so that every cell has four.

    Bond A(i, j) is entry (i+1, j+1) and B(i, j) is entry (i+1, j+1) of the padded arrays.
    """

    def __init__(self, snapshot: Snapshot, block: Block) -> None:
        position = np.ascontiguousarray(snapshot.position, dtype=np.float64)
        self.z: Points = position.view(np.complex128)[..., 0]
        self.dx, self.dy = block.dx, block.dy
        self.apart = apart(snapshot, block)
        self.whole_a, self.whole_b = (np.pad(~each, 1) for each in self.apart)
        # NaN marks a side that never had a bond.
        self.strain_a, self.strain_b = (
            np.pad(np.where(there, e_min, np.nan), 1, constant_values=np.nan)
            for there, e_min in zip(
                bonded(block), (snapshot.e_min_a, snapshot.e_min_b), strict=True
            )
        )

    @property
    def torn_and_crushed(self) -> Bools:
        """(columns, rows) which cells have lost a bond and were compressed far: these may fold."""
        strains = (np.nan_to_num(each[1:-1, 1:-1]) for each in (self.strain_a, self.strain_b))
        return (over_bonds(np.add, *self.apart) > 0) & (worst_strain(*strains) < FOLDING_STRAIN)

    def frayed_corners(self) -> tuple[Ints, Ints]:
        """Lattice corners (p, q) with a broken or absent bond around them."""
        a, b = self.whole_a, self.whole_b
        whole = a[:, :-1] & a[:, 1:]
        whole &= b[:-1] & b[1:]
        p, q = np.nonzero(~whole)
        return p, q

    def half_vectors(self, i: Ints, j: Ints) -> tuple[Points, Points, Points, Points]:
        """Vectors from the nodes (i, j) to their left, right, lower and upper faces [m].

        For an unbroken bond it is half the bond. For a broken one it continues the direction of
        the opposite bond, with the length that remains after the bond's worst strain.
        """
        z, dx, dy = self.z, self.dx, self.dy
        columns, rows = z.shape
        here = z[i, j]
        whole_l, whole_r = self.whole_a[i, j + 1], self.whole_a[i + 1, j + 1]
        whole_d, whole_u = self.whole_b[i + 1, j], self.whole_b[i + 1, j + 1]
        left: Points = 0.5 * whole_l * (z[np.maximum(i - 1, 0), j] - here)
        right: Points = 0.5 * whole_r * (z[np.minimum(i + 1, columns - 1), j] - here)
        down: Points = 0.5 * whole_d * (z[i, np.maximum(j - 1, 0)] - here)
        up: Points = 0.5 * whole_u * (z[i, np.minimum(j + 1, rows - 1)] - here)

        along, upward = _unit(right - left), _unit(up - down)
        along = np.where(along == 0, -1j * upward, along)
        along = np.where(along == 0, 1, along)  # a loose node: its rotation is unknown
        upward = np.where(upward == 0, 1j * along, upward)

        strain_l, strain_r = self.strain_a[i, j + 1], self.strain_a[i + 1, j + 1]
        strain_d, strain_u = self.strain_b[i + 1, j], self.strain_b[i + 1, j + 1]
        return (
            _bounded(np.where(whole_l, left, -along * _reach(strain_l, right, strain_r, dx)), dx),
            _bounded(np.where(whole_r, right, along * _reach(strain_r, left, strain_l, dx)), dx),
            _bounded(np.where(whole_d, down, -upward * _reach(strain_d, up, strain_u, dy)), dy),
            _bounded(np.where(whole_u, up, upward * _reach(strain_u, down, strain_d, dy)), dy),
        )


def _mend(points: Points, lattice: _Lattice) -> None:
    """Replace the corners on cracks and on the block's edge, in place."""
    z = lattice.z
    columns, rows = z.shape
    p, q = lattice.frayed_corners()
    # Counter-clockwise around the corner, from its lower left: cell, and which of its corners.
    cells = ((p - 1, q - 1, 2), (p, q - 1, 3), (p, q, 0), (p - 1, q, 1))
    there = [(i >= 0) & (i < columns) & (j >= 0) & (j < rows) for i, j, _ in cells]
    near = np.zeros((columns, rows), dtype=bool)
    for (i, j, _), inside in zip(cells, there, strict=True):
        near[i[inside], j[inside]] = True
    ci, cj = np.nonzero(near)
    place = np.zeros((columns, rows), dtype=np.intp)
    place[ci, cj] = np.arange(len(ci))
    left, right, down, up = lattice.half_vectors(ci, cj)
    middle = z[ci, cj]
    guesses = (middle + (right + up), middle + (left + up),
               middle + (left + down), middle + (right + down))  # fmt: skip
    estimate = [
        np.where(inside, guess[place[i.clip(0, columns - 1), j.clip(0, rows - 1)]], 0)
        for guess, (i, j, _), inside in zip(guesses, cells, there, strict=True)
    ]
    a, b = lattice.whole_a, lattice.whole_b
    bond = (a[p, q], b[p + 1, q], a[p, q + 1], b[p, q])  # cell k to cell k+1
    for k, ((i, j, own), inside) in enumerate(zip(cells, there, strict=True)):
        ahead, back, ahead2, back2 = bond[k], bond[k - 1], bond[(k + 1) % 4], bond[k - 2]
        after = ahead | (back & back2 & ahead2)
        before = back | (ahead & ahead2 & back2)
        across = (ahead & ahead2) | (back & back2)
        total = (estimate[k] + across * estimate[k - 2]) + (
            after * estimate[(k + 1) % 4] + before * estimate[k - 1]
        )
        mean = total / (1 + across + (after.astype(np.intp) + before))
        points[i[inside], j[inside], own] = mean[inside]


def _unfold(points: Points, lattice: _Lattice) -> None:
    """Replace cells that are folded or torn out of shape by rectangles, in place."""
    i, j = np.nonzero(lattice.torn_and_crushed)
    quad = points[i, j]
    side = np.roll(quad, -1, axis=1) - quad
    turn = np.imag(np.conj(side) * np.roll(side, -1, axis=1))
    longest = LONGEST_SIDE * max(lattice.dx, lattice.dy)
    bad = np.any(turn < 0, axis=1) | np.any(np.abs(side) > longest, axis=1)
    i, j = i[bad], j[bad]
    left, right, down, up = lattice.half_vectors(i, j)
    wide, high = np.abs(left) + np.abs(right), np.abs(down) + np.abs(up)
    # The longer axis gives the direction; the shorter one may point anywhere.
    along = np.where(wide >= high, _unit(right - left), -1j * _unit(up - down))
    middle = lattice.z[i, j] + ((left + right) + (down + up)) / 2
    across, upward = along * wide / 2, 1j * along * high / 2
    points[i, j] = np.stack(
        [
            middle - across - upward,
            middle + across - upward,
            middle + across + upward,
            middle - across + upward,
        ],
        axis=1,
    )


def _reach(strain: Floats, opposite: Points, opposite_strain: Floats, size: float) -> Floats:
    """Half length of a side without a bond [m].

    From the bond's worst strain; equal to the opposite half if there never was a bond.
    """
    own = np.where(np.isnan(strain), opposite_strain, strain)
    length = 0.5 * size * np.clip(1 + np.nan_to_num(own), THINNEST, None)
    return np.where(np.isnan(strain) & (opposite != 0), np.abs(opposite), length)


def _unit(vector: Points) -> Points:
    """Direction of each vector; zero stays zero."""
    length = np.abs(vector)
    return vector / np.where(length > 0, length, 1)


def _bounded(vector: Points, size: float) -> Points:
    """The vectors, shortened to at most LONGEST_HALF of `size`."""
    length = np.abs(vector)
    return vector * np.minimum(1, LONGEST_HALF * size / np.where(length > 0, length, 1))


# --- along an outline ---------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Rim:
    """The cells along an outline.

    i, j   (n,) indices of the cells
    shift  (n, 4, 2) shifts of their corners, counter-clockwise from the lower left [cells]
    """

    i: Ints
    j: Ints
    shift: Floats


def on_outline(quads: Floats, block: Block) -> Floats:
    """Corners (columns, rows, 4, 2) of deformed cells, those along the outline moved onto it."""
    if block.is_rectangle:
        return quads
    rim = _rim(block)
    found = quads.copy()
    cells = quads[rim.i, rim.j]
    across = (cells[:, 1] - cells[:, 0] + cells[:, 2] - cells[:, 3]) / 2
    up = (cells[:, 3] - cells[:, 0] + cells[:, 2] - cells[:, 1]) / 2
    move = rim.shift[..., :1] * across[:, None] + rim.shift[..., 1:] * up[:, None]
    found[rim.i, rim.j] = cells + move
    return found


def along_outline(block: Block) -> Bools:
    """(columns, rows) which cells have corners that were moved onto the outline."""
    found = np.zeros((block.columns, block.rows), dtype=bool)
    if not block.is_rectangle:
        rim = _rim(block)
        found[rim.i, rim.j] = True
    return found


def _rim(block: Block) -> Rim:
    return _kept(block)  # type: ignore[arg-type]  # pydantic's frozen classes are hashable


@lru_cache(maxsize=16)
def _kept(block: Block) -> Rim:
    import shapely

    there = filling(block).there
    around = np.pad(there, 1).astype(int)
    count = around[:-1, :-1] + around[1:, :-1] + around[1:, 1:] + around[:-1, 1:]
    p, q = np.nonzero((count > 0) & (count < 4))
    corners = np.column_stack([p, q]).astype(float)
    foam = in_cells(block)
    edge = foam.boundary
    points = shapely.points(corners)
    nearest = shapely.get_coordinates(shapely.shortest_line(points, edge))[1::2]
    marks = shapely.get_coordinates(edge)
    away = np.abs(corners[:, None] - marks[None]).max(axis=2)
    best = away.argmin(axis=1)
    comes = np.abs(nearest - marks[best]).max(axis=1) < 1e-9
    at_corner = away[np.arange(len(best)), best] <= AT_CORNER
    at_corner &= comes | ~np.isin(best, best[comes])
    shift = np.where(at_corner[:, None], marks[best], nearest) - corners
    shift[np.abs(shift).max(axis=1) > FURTHEST] = 0.0
    shift[np.abs(shift) < 1e-9] = 0.0
    whole = np.zeros((*count.shape, 2))
    whole[p, q] = shift
    if block.lattice_angle_deg == 0 and is_mirrored(foam, block.columns):
        whole = 0.5 * (whole + whole[::-1] * [-1.0, 1.0])  # symmetric, even midway between sides
    of_cells = np.stack([whole[:-1, :-1], whole[1:, :-1], whole[1:, 1:], whole[:-1, 1:]], axis=2)
    i, j = np.nonzero(there & (of_cells != 0.0).any(axis=(2, 3)))
    return Rim(i, j, of_cells[i, j])
