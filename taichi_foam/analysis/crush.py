"""Which cells of a block are crushed, each by its own foam."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from taichi_foam.laws.bond import BondFoam
from taichi_foam.records.snapshot import Snapshot
from taichi_foam.scene import Scene
from taichi_foam.scene.layers import foams_of_bonds

Array = NDArray[np.float64]

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


def by_foam(
    scene: Scene,
    what: Callable[..., Array],
    a: tuple[NDArray[Any], ...],
    b: tuple[NDArray[Any], ...],
) -> tuple[Array, Array]:
    """What a foam gives of figures of its bonds, for all bonds A and B, each by its own foam.

    Args:
        what: called with a foam and arrays of figures; gives an array of their shape.
        a, b: the figures of bonds A, (columns-1, rows) each, and of bonds B, (columns, rows-1).
    """
    foams, rows_a, rows_b = foams_of_bonds(scene)
    if len(foams) == 1:
        return what(foams[0], *a), what(foams[0], *b)
    found = np.zeros(a[0].shape), np.zeros(b[0].shape)
    for number, foam in enumerate(foams):
        for values, figures, rows in zip(found, (a, b), (rows_a, rows_b), strict=True):
            mine = rows == number
            values[:, mine] = what(foam, *(figure[:, mine] for figure in figures))
    return found


def crushed_parts(snapshot: Snapshot, scene: Scene) -> tuple[Array, Array]:
    """How far bonds A and B are through the crushing, each by its own foam: 0 to 1."""
    return by_foam(
        scene,
        lambda foam, worst: crushed_part(worst, foam),
        (snapshot.e_min_a,),
        (snapshot.e_min_b,),
    )


def crushed_cells(snapshot: Snapshot, scene: Scene) -> NDArray[np.bool_]:
    """Whether each cell is crushed, (columns, rows).

    It is when the worst compressive strain of one of its two to four bonds, so far, lies beyond
    CRUSHED_FRACTION of the way through the crushing.
    """
    return over_bonds(np.maximum, *crushed_parts(snapshot, scene)) > CRUSHED_FRACTION
