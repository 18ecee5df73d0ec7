"""How foam fills a block's lattice: mass of each mass point, share of each bond's face.

Cells are cut by the outline. A cell that is less than a quarter full has no mass point: its foam is
assigned to a neighbour.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from taichi_foam.scene import outlines
from taichi_foam.scene.block import Block, rows_of

if TYPE_CHECKING:
    from shapely import Polygon

Array = NDArray[np.float64]

LEAST = 0.25
"""Smallest share of foam with which a cell has a mass point."""

LONGEST_TIP = 3
"""Longest row of cells in a tip with no mass point of their own or beside them."""

NO_FACE = 1e-6
"""Share of a face below which there is no bond."""


@dataclass(frozen=True, eq=False)
class Filling:
    """A block on its lattice of I x J cells; each that is at least a quarter full has a mass point.

    mass    (I, J) mass of the mass points [kg]; 0: there is none
    face_a  (I-1, J) area of the face of bond A(i, j) over that of a whole one; 0: no bond
    face_b  (I, J-1) the same for B(i, j)
    reach   (I, J) distance from a mass point to the foam's nearest face [m], negative if the point
            is outside the foam; inside the block, and at the sides of a rectangle, half a cell,
            sqrt(dX dY) / 2
    edge    (I, J) how far foam reaches beyond a mass point to a body that touches it [m]: the same
            distance beside the outline, 0 elsewhere and in a rectangle
    share   (I, J) share of each cell's area that is foam
    cell    (I-1, J-1) foam of the lattice cell between four mass points over a whole cell's,
            including foam beside it that no other cell carries; 0: a side has no bond
    on_base (I, J) whether the foam of a mass point lies on the base
    owner   (I, J, 2) cell of the mass point to which a cell's foam belongs; (-1, -1): no foam.
            None: each cell's foam belongs to its own mass point
    """

    mass: Array
    face_a: Array
    face_b: Array
    reach: Array
    edge: Array
    share: Array
    cell: Array
    on_base: NDArray[np.bool_]
    owner: NDArray[np.int32] | None

    @property
    def there(self) -> NDArray[np.bool_]:
        """(I, J) whether there is a mass point."""
        return self.mass > 0.0

    @property
    def area(self) -> Array:
        """(I, J) area of each mass point's foam over that of a whole cell."""
        if self.owner is None:
            return self.share
        found = np.zeros(self.share.shape)
        held = self.owner[..., 0] >= 0
        np.add.at(found, tuple(self.owner[held].T), self.share[held])
        return found

    @cached_property
    def is_alike(self) -> bool:
        """Whether all columns of mass points are identical."""
        arrays = (self.mass, self.share, self.reach, self.edge, self.on_base)
        arrays += (self.face_a, self.face_b, self.cell)
        return all(bool(np.all(array == array[:1])) for array in arrays)

    @property
    def has_edges(self) -> bool:
        """Whether bodies touch foam at its edge, beyond or behind mass points."""
        return bool(self.edge.any())

    @property
    def is_full(self) -> bool:
        """Whether foam fills every cell and just the bottom row is on the base."""
        level = self.on_base[:, 0].all() and not self.on_base[:, 1:].any()
        return bool(level and np.all(self.share == 1.0))


def filling(block: Block) -> Filling:
    """The filling of a block's lattice."""
    return _kept(block)  # type: ignore[arg-type]  # pydantic's frozen classes do have a hash


@lru_cache(maxsize=64)
def _kept(block: Block) -> Filling:
    if {*block.corners} == {*block.frame} and not block.holes and block.lattice_angle_deg == 0:
        return _rectangle(block)
    return _cut(block, in_cells(block))


def reaches(filled: Filling, worst_a: Array, worst_b: Array) -> Array:
    """How far [m] foam still reaches beyond its mass points (I, J).

    It is `Filling.edge`, shortened by the worst strain of the node's bonds (`worst_a` (I-1, J),
    `worst_b` (I, J-1)), unless the point is in front of the foam.
    """
    worst = np.zeros(filled.edge.shape)
    for ends, strain in (
        ((np.s_[:-1], np.s_[1:]), worst_a),
        ((np.s_[:, :-1], np.s_[:, 1:]), worst_b),
    ):
        for end in ends:
            worst[end] = np.minimum(worst[end], strain)
    return filled.edge + np.maximum(filled.edge, 0.0) * worst


def in_cells(block: Block) -> Polygon:
    """The foam's polygon in units of cells: cell (i, j) is the square (i, i+1) x (j, j+1)."""

    def placed(corners: outlines.Corners) -> Array:
        corner = np.array([-0.5 * block.columns * block.dx, block.foot - 0.5 * block.dy])
        cells = (block.on_lattice(np.array(corners)) - corner) / [block.dx, block.dy]
        near = np.round(cells)
        return np.where(np.abs(cells - near) < outlines.TOLERANCE * block.columns, near, cells)

    return outlines.polygon(placed(block.corners), map(placed, block.holes))


def _rectangle(block: Block) -> Filling:
    """The filling of a rectangle: cells are full, or half full where mass points lie on its faces.

    Every array is the same in all columns, which share its memory.
    """
    columns, rows = block.columns, block.rows
    outside = 0.5 if block.mass_points == "faces" else 0.0  # of the first and the last row
    heights = np.ones(rows)
    heights[[0, -1]] -= outside
    share = np.broadcast_to(heights, (columns, rows))
    area = np.diff(np.clip(_levels(block), outside, rows - outside))
    reach = np.full(rows, 0.5 * np.sqrt(block.dx * block.dy))
    reach[[0, -1]] = (0.5 - outside) * block.dy
    return Filling(
        mass=np.broadcast_to(_mass(block, area[None]), (columns, rows)),
        face_a=share[1:],
        face_b=np.broadcast_to(1.0, (columns, rows - 1)),
        reach=np.broadcast_to(reach, (columns, rows)),
        edge=np.broadcast_to(0.0, (columns, rows)),
        share=share,
        cell=np.broadcast_to(1.0, (columns - 1, rows - 1)),
        on_base=np.broadcast_to(np.arange(rows) == 0, (columns, rows)),
        owner=None,
    )


def _cut(block: Block, shape: Polygon) -> Filling:
    """The filling of an outline."""
    columns, rows = block.columns, block.rows
    across, levels = np.arange(columns + 1.0), _levels(block)
    up = np.arange(rows + 1.0)
    area = outlines.shares(shape, across, levels)
    inner_a = outlines.lengths(shape, across[1:-1], up, upright=True)
    inner_b = outlines.lengths(shape, up[1:-1], across, upright=False).T
    edge = _signed_distance(block)
    mirrored = block.lattice_angle_deg == 0 and outlines.is_mirrored(shape, columns)
    if mirrored:  # except for rounding; made exact here
        area, inner_a, inner_b, edge = map(_mirrored, (area, inner_a, inner_b, edge))
    share = np.add.reduceat(area, np.searchsorted(levels, up[:-1]), axis=1)
    there = share >= LEAST - outlines.TOLERANCE
    owner = _owners(share, there, inner_a, inner_b)
    mass = np.zeros((columns, rows))
    held = share > 0
    np.add.at(mass, tuple(owner[held].T), _mass(block, area)[held])
    face_a, face_b = _faces(owner, inner_a, 0), _faces(owner, inner_b, 1)
    between = outlines.shares(shape, across[:-1] + 0.5, up[:-1] + 0.5)
    sides = (face_a[:, :-1], face_a[:, 1:], face_b[:-1], face_b[1:])
    cell = _carried(between, np.min(sides, axis=0) > 0.0)
    if mirrored:  # sums depend on their order
        mass, face_a, face_b, cell = map(_mirrored, (mass, face_a, face_b, cell))
    on_base = np.zeros((columns, rows), dtype=bool)
    on_base[tuple(owner[_on_base(block, shape, share)].T)] = True
    return Filling(
        mass=mass,
        face_a=face_a,
        face_b=face_b,
        **_distances(block, edge, there, share >= 1.0 - outlines.TOLERANCE),
        share=share,
        cell=cell,
        on_base=on_base,
        owner=owner,
    )


def _carried(between: Array, spanned: NDArray[np.bool_]) -> Array:
    """Foam of each cell between mass points: its own, and its share of foam beside it.

    A cell with a missing side is not spanned; its foam is divided among its neighbours.
    """
    carried = np.where(spanned, between, 0.0)
    beside = [(step, *_pair(step)) for step in ((0, -1), (0, 1), (-1, 0), (1, 0))]
    neighbours = np.zeros_like(carried)
    for _, here, other in beside:
        neighbours[here] += spanned[other]
    part = np.where(spanned | (neighbours == 0), 0.0, between / np.maximum(neighbours, 1.0))
    for _, here, other in beside:
        carried[other] += np.where(spanned[other], part[here], 0.0)
    return carried


def _mirrored(figures: Array) -> Array:
    """Values (I, ...) made symmetric under mirroring of the columns."""
    return 0.5 * (figures + figures[::-1])


def _levels(block: Block) -> Array:
    """Heights [cells] at which rows of cells and layers begin and end, in rising order."""
    rows = np.arange(block.rows + 1.0)
    heights = (each for layer in block.layers for each in (layer.bottom, layer.top))
    faces = [(each - block.foot) / block.dy + 0.5 for each in heights]
    between = [
        face
        for face in sorted(set(faces))
        if np.abs(rows - face).min() > outlines.TOLERANCE * block.rows
    ]
    return np.sort(np.concatenate([rows, between]))


def _mass(block: Block, area: Array) -> Array:
    """Mass (I, J) [kg] of the foam in each cell, from its areas between `_levels`."""
    levels = _levels(block)
    middle = ((levels[:-1] + levels[1:]) / 2 - 0.5) * block.dy + block.foot
    density = np.full(len(middle), block.density)
    for layer in block.layers:
        if layer.density is not None:
            density[(middle >= layer.bottom) & (middle < layer.top)] = layer.density
    mass = (density * block.dx * block.dy * block.depth) * area
    return np.add.reduceat(mass, np.searchsorted(levels, np.arange(block.rows)), axis=1)


def _owners(share: Array, there: NDArray[np.bool_], a: Array, b: Array) -> NDArray[np.int32]:
    """Cell (I, J, 2) of the mass point to which each cell's foam belongs; (-1, -1) if it is empty.

    That is the cell itself; or the neighbour with which it shares the longest face; or the nearest.
    """
    own = _own(share.shape)
    longest = np.full(share.shape, NO_FACE)
    owner = np.where(there[..., None], own, -1)
    lost = (share > 0) & ~there
    for step, faces in (((0, -1), b), ((0, 1), b), ((-1, 0), a), ((1, 0), a)):
        here, other = _pair(step)
        better = np.zeros_like(lost)
        better[here] = lost[here] & there[other] & (faces > longest[here])
        whole = np.zeros_like(longest)
        whole[here] = faces
        longest = np.where(better, whole, longest)
        owner[better] = own[better] + step
    far = lost & (owner[..., 0] < 0)
    if far.any() and there.any():
        from scipy.spatial import KDTree

        owner[far] = own[there][KDTree(own[there]).query(own[far])[1]]
    return owner


def _own(shape: tuple[int, ...]) -> NDArray[np.int32]:
    """The indices of each cell, (I, J, 2)."""
    return np.moveaxis(np.indices(shape, dtype=np.int32), 0, -1)


def _pair(step: tuple[int, int]) -> tuple[tuple[slice, slice], tuple[slice, slice]]:
    """Slices of the cells that have a neighbour in a direction, and of these neighbours."""
    here = tuple(slice(max(0, -each), -each if each > 0 else None) for each in step)
    other = tuple(slice(max(0, each), each if each < 0 else None) for each in step)
    return here, other  # type: ignore[return-value]


def _faces(owner: NDArray[np.int32], inner: Array, axis: int) -> Array:
    """Faces of the bonds along an axis, summed over the cells of their two mass points."""
    step = np.array([axis == 0, axis == 1], dtype=np.int64)
    count = np.array(owner.shape[:2])
    found = np.zeros(tuple(count - step))
    first = owner[:-1] if axis == 0 else owner[:, :-1]
    second = owner[1:] if axis == 0 else owner[:, 1:]
    joined = (first[..., 0] >= 0) & ((second - first) == step).all(axis=-1)
    np.add.at(found, tuple(first[joined].T), inner[joined])
    return np.where(found > NO_FACE, found, 0.0)


def _on_base(block: Block, shape: Polygon, share: Array) -> NDArray[np.bool_]:
    """Cells (I, J) with foam that lies on the base: on edges of the outline at y = 0."""
    import shapely

    found = np.zeros(share.shape, dtype=bool)
    level = np.array(block.corners)[:, 1] <= outlines.TOLERANCE * block.height
    corners = np.array(shape.exterior.coords)[:-1]
    ground = shapely.MultiLineString(
        [corners[[k, (k + 1) % len(corners)]] for k in np.flatnonzero(level & np.roll(level, -1))]
    )
    if ground.is_empty:
        return found
    low, high = np.array(ground.bounds).reshape(2, 2)
    low = np.maximum(np.floor(low).astype(int) - 1, 0)
    high = np.minimum(np.ceil(high).astype(int) + 1, share.shape)
    i, j = (each.ravel() for each in np.mgrid[low[0] : high[0], low[1] : high[1]])
    held = share[i, j] > 0
    i, j = i[held], j[held]
    lying = shapely.length(shapely.intersection(ground, shapely.box(i, j, i + 1, j + 1)))
    found[i, j] = lying > NO_FACE
    return found


def _signed_distance(block: Block) -> Array:
    """Distance (I, J) of mass points from the outline [m], negative outside it."""
    import shapely

    whole = outlines.polygon(block.corners, block.holes)
    points = shapely.points(block.positions)
    shapely.prepare(whole)
    away = shapely.distance(points, whole.boundary)
    return np.where(shapely.covers(whole, points), away, -away)


def _distances(
    block: Block, edge: Array, there: NDArray[np.bool_], full: NDArray[np.bool_]
) -> dict[str, Array]:
    """`reach` and `edge` of a `Filling`, from the distance `edge` from the outline [m]."""
    for half in (0.5 * block.dx, 0.5 * block.dy):
        whole = np.round(edge / half) * half
        edge = np.where(np.abs(edge - whole) < outlines.TOLERANCE * half, whole, edge)
    around = np.pad(there, 1)
    inside = full & np.logical_and.reduce(
        [around[2:, 1:-1], around[:-2, 1:-1], around[1:-1, 2:], around[1:-1, :-2]]
    )
    at_edge = there & ~inside & ~full.all()  # if foam fills all cells, it is a rectangle
    return {
        "reach": np.where(inside, 0.5 * np.sqrt(block.dx * block.dy), edge),
        "edge": np.where(at_edge, edge, 0.0),
    }


def problems(block: Block) -> list[str]:
    """Why the lattice cannot represent the block's outline and layers, in whole sentences."""
    if block.is_rectangle:
        return []
    filled = filling(block)
    empty = [
        f"block.layers[{number}]: {layer.bottom:g} to {layer.top:g} m contains no foam: the "
        "outline ends below it, or a hole takes all of it; move the layer, or leave it out"
        for number, layer in enumerate(block.layers)
        if not filled.there[:, rows_of(block, layer)].any()
    ]
    if empty:
        return empty
    more = "use more block.columns and block.rows, or make it wider"
    if not filled.there.any():
        return [f"block.outline: does not fill a quarter of any cell of the lattice; {more}"]
    cell = f"a cell of {block.dx:.3g} x {block.dy:.3g} m"
    where = _without_mass_point(filled)
    if where is not None:
        x, y = block.positions[where]
        return [
            f"block.outline: near x = {x:.4g} m, y = {y:.4g} m the foam is thinner than a quarter "
            f"of {cell}, and would be left out; {more}"
        ]
    part = connected(filled.face_a > 0, filled.face_b > 0)[filled.there]
    numbers, sizes = np.unique(part, return_counts=True)
    if len(sizes) > 1:
        x, y = block.positions[filled.there][part == numbers[sizes.argmin()]].mean(axis=0)
        return [
            f"block.outline: the lattice falls into {len(sizes)} parts, one of them around x = "
            f"{x:.4g} m, y = {y:.4g} m: the foam that joins it to the others is thinner than "
            f"{cell}; {more}"
        ]
    return []


def _without_mass_point(filled: Filling) -> tuple[int, int] | None:
    """A cell with foam but no mass point beside it, one of more than LONGEST_TIP in a row."""
    if filled.owner is None:
        return None
    away = np.abs(filled.owner - _own(filled.share.shape)).sum(axis=-1)
    far = (filled.share > 0) & (away > 1)
    if not far.any():
        return None
    from scipy import ndimage  # slow to import, and seldom needed

    label = np.zeros(far.shape, dtype=np.int64)
    ndimage.label(far, np.ones((3, 3)), output=label)
    for place in ndimage.find_objects(label):
        if max(along.stop - along.start for along in place) > LONGEST_TIP:
            i, j = np.argwhere(far[place])[0] + [along.start for along in place]
            return int(i), int(j)
    return None


def connected(a: NDArray[np.bool_], b: NDArray[np.bool_]) -> NDArray[np.int32]:
    """Number (I, J), from 0, of the part, connected by bonds, to which each lattice site belongs.

    Bonds are where `a` (I-1, J) and `b` (I, J-1) are true. A site without a bond is a part.
    """
    sites = np.arange(a.shape[1] * b.shape[0]).reshape(b.shape[0], a.shape[1])
    if a.all() and b.all():
        return np.zeros_like(sites, dtype=np.int32)
    from scipy.sparse import coo_array  # slow to import
    from scipy.sparse.csgraph import connected_components

    first = np.concatenate([sites[:-1][a], sites[:, :-1][b]])
    second = np.concatenate([sites[1:][a], sites[:, 1:][b]])
    shape = (sites.size, sites.size)
    graph = coo_array((np.ones(first.size, dtype=bool), (first, second)), shape=shape)
    return connected_components(graph, directed=False)[1].reshape(sites.shape)


def thin_parts(block: Block) -> tuple[float, float] | None:
    """A place [m] where foam is thinner than two cells; None if there is none.

    Thin foam is what disappears when the outline is shrunk by a cell's larger side and then grown
    by as much. Less than a cell's area of it, as at a tip, does not count.
    """
    if block.is_rectangle:
        return None
    import shapely

    foam = outlines.polygon(block.corners, block.holes)
    side = max(block.dx, block.dy) * (1.0 - outlines.TOLERANCE)
    with_corners = {"join_style": "mitre", "mitre_limit": 5.0}
    core = foam.buffer(-side, **with_corners).buffer(side * (1.0 + 1e-6), **with_corners)
    thin = shapely.get_parts(foam.difference(core))
    areas = shapely.area(thin)
    if not len(thin) or areas.max() <= block.dx * block.dy:
        return None
    middle = thin[areas.argmax()].representative_point()
    return middle.x, middle.y
