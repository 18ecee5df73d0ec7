"""Which cells of a block are crushed."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from taichi_foam.laws.bond import BondFoam
from taichi_foam.records.snapshot import Snapshot

CRUSHED_FRACTION = 0.5
"""A cell counts as crushed this share of the way from yield to densification (here: halfway)."""


def worst_strain(e_min_a: NDArray[np.float64], e_min_b: NDArray[np.float64]) -> NDArray[np.float64]:
    """Worst compressive strain (<= 0) over the bonds of each node, (columns, rows)."""
    columns, rows = e_min_b.shape[0], e_min_a.shape[1]
    worst = np.zeros((columns, rows))
    for part, strain in (
        (worst[:-1], e_min_a),
        (worst[1:], e_min_a),
        (worst[:, :-1], e_min_b),
        (worst[:, 1:], e_min_b),
    ):
        np.minimum(part, strain, out=part)
    return worst


def crushed_cells(snapshot: Snapshot, foam: BondFoam) -> NDArray[np.bool_]:
    """Whether each cell is crushed, (columns, rows).

    It is when the worst compressive strain of its two to four bonds, so far, lies beyond
    CRUSHED_FRACTION of the way through the crushing.
    """
    marks = foam.landmarks
    limit = marks.crush_start + CRUSHED_FRACTION * (marks.crush_end - marks.crush_start)
    return worst_strain(snapshot.e_min_a, snapshot.e_min_b) < limit
