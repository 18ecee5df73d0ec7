"""Fracture of a block: its pieces and its cracks.

Cracks are defined on the corners of the cells. Corner (p, q), p = 0..I, q = 0..J, lies in the
reference configuration at x = `Block.column_edges`[p], y = `Block.row_edges`[q]. A broken bond is
represented by the cell edge that it crosses:

    A(i,j), sideways    the vertical edge from corner (i+1, j) to corner (i+1, j+1)
    B(i,j), upwards     the horizontal edge from corner (i, j+1) to corner (i+1, j+1)
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from math import ceil

import numpy as np
from numpy.typing import NDArray

from taichi_foam.analysis.cell_state import apart, crushed_cells, there
from taichi_foam.analysis.impact import impactor_now
from taichi_foam.records.snapshot import Snapshot
from taichi_foam.scene import Block, Scene
from taichi_foam.scene.filling import connected

PIECE_FRACTION = 0.05
"""A connected part counts as a piece from this share of the mass points."""

CRACK_CELLS = 3
"""A crack below the impactor is at least this many cells long ..."""

CRACK_HEIGHT_FRACTION = 0.15
"""... and at least this share of the block's height (as much, on the paper's 20 cells)."""

CRACK_EDGES_PER_ROW = 2
"""A row of cells below the impactor with more broken edges in one line counts as shattered."""

_NEXT_ROW = [[1, 0, 1], [1, 1, 1], [1, 0, 1]]
"""Connectivity of vertical edges: in the next row, at most one column of edges away."""


@dataclass(frozen=True)
class Crack:
    """A crack that starts below the impactor (reference configuration).

    lowest_height  m, height of the lowest end of its vertical edges; 0 is the block's bottom. With
                   a gripped base the bottom row cannot open: a through crack ends above its cells.
    start_x        m, position of the bond that broke first
    start_height   m, height of that bond; for bonds of the top row, with mass points on the faces,
                   the block's height
    start_time     s, when it broke
    path           m, points (x, y) where its bonds cross its vertical edges, downwards from the
                   start: in each lower row the edge laterally nearest to the previous one
    """

    lowest_height: float
    start_x: float
    start_height: float
    start_time: float
    path: tuple[tuple[float, float], ...]

    @property
    def direction_deg(self) -> float:
        """Inclination of the straight line fitted to the path [deg].

        0 is vertical; positive if the crack runs to the right on its way down, negative to the
        left.
        """
        x, y = np.transpose(self.path)
        from_mean = y - y.mean()
        return float(np.degrees(np.arctan(-(from_mean @ x) / (from_mean @ from_mean))))


def parts(snapshot: Snapshot, block: Block, bottom_rows: int = 0) -> NDArray[np.int32]:
    """Number, from 0, of the part that each mass point belongs to: (columns, rows - bottom_rows).

    A part is connected by unbroken bonds; -1 where there is no mass point. The lowest `bottom_rows`
    rows and their bonds to the others are left out.
    """
    apart_a, apart_b = apart(snapshot, block)
    found = connected(~apart_a[:, bottom_rows:], ~apart_b[:, bottom_rows:])
    return np.where(there(block)[:, bottom_rows:], found, -1)


def sizes_of(labels: NDArray[np.int32]) -> NDArray[np.int64]:
    """Number of mass points in each part, by part number."""
    return np.bincount(labels[labels >= 0])


def piece_sizes(snapshot: Snapshot, block: Block) -> NDArray[np.float64]:
    """Share of the mass points in each part, including crumbs, the largest first."""
    sizes = sizes_of(parts(snapshot, block))
    return np.sort(sizes)[::-1] / sizes.sum()


def pieces(snapshot: Snapshot, block: Block) -> int:
    """Number of parts, connected by unbroken bonds, with at least PIECE_FRACTION of the nodes.

    Smaller parts are crumbs. It is 0 for a block that is all crumbs.
    """
    return int(np.count_nonzero(piece_sizes(snapshot, block) >= PIECE_FRACTION))


def cracks(snapshot: Snapshot, block: Block) -> list[NDArray[np.float64]]:
    """Broken bonds chained into polylines, the longest first.

    Returns arrays (n, 2) of corner positions x, y in metres, reference configuration. A polyline
    runs between corners where it ends or meets others; a closed loop repeats its first corner.
    Every broken bond belongs to exactly one polyline.
    """
    rows = snapshot.position.shape[1]
    first, second = _broken_edges(snapshot)
    at: dict[int, list[int]] = defaultdict(list)  # corner -> neighbours not yet visited
    for p, q in zip(first.tolist(), second.tolist(), strict=True):
        at[p].append(q)
        at[q].append(p)
    ends = [corner for corner, others in at.items() if len(others) != 2]
    is_end = set(ends)

    lines = []
    for corner in (*ends, *at):  # closed loops remain once all ends are done
        while at[corner]:
            line = [corner]
            while True:
                here = line[-1]
                step = at[here].pop()
                at[step].remove(here)
                line.append(step)
                if step in is_end or step == corner:
                    break
            lines.append(line)

    across, up = block.column_edges, block.row_edges
    corners = [np.divmod(line, rows + 1) for line in lines]
    points = [block.turned(np.stack([across[p], up[q]], axis=1)) for p, q in corners]
    return sorted(points, key=lambda xy: -np.abs(np.diff(xy, axis=0)).sum())


def crack_below_impactor(snapshot: Snapshot, scene: Scene) -> Crack | None:
    """The crack that runs down ahead of the impactor; None if there is none.

    Vertical edges in successive rows of cells, in the same column of edges or an adjacent one, form
    a line. "Below the impactor" means within the width of its outline, minus one cell on each side:
    a punch tears the foam along its flanks, which is not splitting (the axis and one cell beside it
    are always included). A line is such a crack if

    1. in L or more successive rows below the impactor's lowest point it has at least one and at
       most CRACK_EDGES_PER_ROW edges below the impactor (crushed foam that shatters has many, and
       flanks are torn beside a punch, hardly ahead of it);
    2. it runs down: there are L or more rows from that of its first broken edge below the impactor
       to its lowest edge (so cracks that rise from the base do not count).

    Edges between crushed cells do not count: broken crushed foam is powder, not a crack. L is
    CRACK_CELLS or CRACK_HEIGHT_FRACTION of the cells in the height, whichever is larger. Of several
    such lines, the deepest is taken, then the one that starts nearest to the axis. A crack starts
    at the edge of its path that broke first (the highest of several). None on a rotated lattice,
    where no line of edges is vertical.
    """
    from scipy import ndimage

    if scene.impactor is None or scene.block.lattice_angle_deg != 0:
        return None
    if not snapshot.broken_a.any():  # as in most drops on cushions
        return None
    columns, rows = snapshot.position.shape[:2]
    dx, dy, row_edges = scene.block.dx, scene.block.dy, scene.block.row_edges
    crushed = crushed_cells(snapshot, scene)
    lines = np.zeros((columns - 1, rows), dtype=np.int32)
    ndimage.label(snapshot.broken_a & ~(crushed[:-1] & crushed[1:]), _NEXT_ROW, output=lines)

    x = scene.block.column_edges[1:-1]
    now = impactor_now(snapshot, scene)
    assert now is not None  # there is an impactor
    axis = scene.impactor.x + snapshot.impactor_shift
    outline, level = now[:, 0] - axis, now[:, 1].min()
    from_axis = x - axis
    slack = 1e-6 * dx
    below = (from_axis > outline.min() + dx - slack) & (from_axis < outline.max() - dx + slack)
    below |= np.abs(from_axis) <= dx + slack
    ahead = row_edges[1:] <= level + dy + slack
    length = max(CRACK_CELLS, ceil(CRACK_HEIGHT_FRACTION * scene.block.height / dy - 1e-9))
    heights = scene.block.positions[0, :, 1]

    found = []
    for label in np.unique(lines[below][:, ahead]):
        mine = lines == label
        edges = np.count_nonzero(mine[below], axis=0)
        is_line = (edges >= 1) & (edges <= CRACK_EDGES_PER_ROW) & ahead
        if label == 0 or _longest_run(is_line) < length:
            continue
        path = _path(mine, snapshot.broken_a, below)
        times = [float(snapshot.break_time_a[edge]) for edge in path]
        path = path[times.index(min(times)) :]
        if path[0][1] - path[-1][1] + 1 < length:
            continue
        places = tuple((float(x[i]), float(heights[j])) for i, j in path)
        lowest = float(row_edges[path[-1][1]])
        found.append(Crack(lowest, *places[0], min(times), places))
    return min(found, key=lambda c: (c.lowest_height, abs(c.start_x - axis)), default=None)


def crack_over_time(snapshots: Sequence[Snapshot], scene: Scene) -> Crack | None:
    """The crack below the impactor at the time in a run when it is deepest; None if there is none.

    All snapshots are examined, since later crushing and shattering can hide a crack.
    """
    seen = [crack for crack in (crack_below_impactor(s, scene) for s in snapshots) if crack]
    return min(seen, key=lambda crack: crack.lowest_height, default=None)


def _path(
    line: NDArray[np.bool_], broken: NDArray[np.bool_], below: NDArray[np.bool_]
) -> list[tuple[int, int]]:
    """A line's edges (i, j) downwards, one in each row: the one laterally nearest to the previous.

    The path is extended above the line, where powder hides it: in each higher row by the nearest
    connected broken edge below the impactor.
    """
    rows = np.flatnonzero(line[below].any(axis=0))
    top = int(rows[-1])
    i = int(np.flatnonzero(line[:, top] & below)[0])
    above: list[tuple[int, int]] = []
    at = i
    for row in range(top + 1, line.shape[1]):
        follow = np.flatnonzero(broken[:, row] & below)
        follow = follow[np.abs(follow - at) <= 1]
        if not follow.size:
            break
        at = int(follow[np.argmin(np.abs(follow - at))])
        above.insert(0, (at, row))
    path = [*above, (i, top)]
    for row in range(top - 1, -1, -1):
        follow = np.flatnonzero(line[:, row])
        if follow.size:
            i = int(follow[np.argmin(np.abs(follow - i))])
            path.append((i, row))
    return path


def _broken_edges(snapshot: Snapshot) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """The two corners, numbered p (J+1) + q, of each broken bond: A first, then B."""
    columns, rows = snapshot.position.shape[:2]
    corner = np.arange((columns + 1) * (rows + 1)).reshape(columns + 1, rows + 1)
    a, b = snapshot.broken_a, snapshot.broken_b
    first = np.concatenate([corner[1:columns, :rows][a], corner[:columns, 1:rows][b]])
    second = np.concatenate([corner[1:columns, 1:][a], corner[1:, 1:rows][b]])
    return first, second


def _longest_run(flags: NDArray[np.bool_]) -> int:
    """Length of the longest run of consecutive true flags."""
    stops = np.flatnonzero(~np.concatenate([[False], flags, [False]]))
    return int(np.diff(stops).max()) - 1
