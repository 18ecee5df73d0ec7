"""Which cells of a block are crushed."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from taichi_foam.laws.bond import BondFoam
from taichi_foam.records.snapshot import Snapshot

CRUSHED_FRACTION = 0.5
"""A cell counts as crushed this share of the way from yield to densification (here: halfway)."""


def over_bonds(join: np.ufunc, a: NDArray[Any], b: NDArray[Any]) -> NDArray[np.float64]:
    """What `join` makes of zero and the values of each node's bonds A and B, (columns, rows)."""
    found = np.zeros((b.shape[0], a.shape[1]))
    for part, values in ((found[:-1], a), (found[1:], a), (found[:, :-1], b), (found[:, 1:], b)):
        join(part, values, out=part)
    return found


def worst_strain(e_min_a: NDArray[np.float64], e_min_b: NDArray[np.float64]) -> NDArray[np.float64]:
    """Worst compressive strain (<= 0) over the bonds of each node, (columns, rows)."""
    return over_bonds(np.minimum, e_min_a, e_min_b)


def crushed_part(worst: NDArray[np.float64], foam: BondFoam) -> NDArray[np.float64]:
    """How far foam that has met the strain `worst` is through the crushing: 0 to 1.

    On its plateau foam is a mixture: this part of it is crushed, the rest has only yielded.
    """
    marks = foam.landmarks
    part = (marks.crush_start - worst) / (marks.crush_start - marks.crush_end)
    return np.clip(part, 0.0, 1.0)


def crushed_cells(snapshot: Snapshot, foam: BondFoam) -> NDArray[np.bool_]:
    """Whether each cell is crushed, (columns, rows).

    It is when the worst compressive strain of its two to four bonds, so far, lies beyond
    CRUSHED_FRACTION of the way through the crushing.
    """
    worst = worst_strain(snapshot.e_min_a, snapshot.e_min_b)
    return crushed_part(worst, foam) > CRUSHED_FRACTION
