"""The state of cells: where there is foam, which bonds are whole, and how far it is crushed.

In a snapshot of a block with an outline, all lattice sites have values, even those without a mass
point, and bonds that never existed do not count as broken.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from taichi_foam.laws.bond import BondFoam
from taichi_foam.records.snapshot import Snapshot
from taichi_foam.scene import Block, Scene
from taichi_foam.scene.filling import filling
from taichi_foam.scene.layers import foams_of_bonds

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

CRUSHED_FRACTION = 0.5
"""A cell counts as crushed from this share of the way from yield to densification (halfway)."""


def there(block: Block) -> Flags:
    """(columns, rows) whether there is a mass point."""
    return filling(block).there


def bonded(block: Block) -> tuple[Flags, Flags]:
    """Where there are bonds A and B, whole or broken: (columns-1, rows), (columns, rows-1)."""
    filled = filling(block)
    return filled.face_a > 0.0, filled.face_b > 0.0


def apart(snapshot: Snapshot, block: Block) -> tuple[Flags, Flags]:
    """Where bonds A and B do not join mass points: they are broken, or never existed."""
    a, b = bonded(block)
    return snapshot.broken_a | ~a, snapshot.broken_b | ~b


def hangs_on(snapshot: Snapshot, block: Block) -> Flags:
    """(columns, rows) whether a mass point has an unbroken bond."""
    apart_a, apart_b = apart(snapshot, block)
    return over_bonds(np.maximum, ~apart_a, ~apart_b) > 0.0


def over_bonds(join: np.ufunc, a: NDArray[Any], b: NDArray[Any]) -> Array:
    """`join` applied to zero and the values of each node's bonds A and B, (columns, rows)."""
    found = np.zeros((b.shape[0], a.shape[1]))
    for part, values in ((found[:-1], a), (found[1:], a), (found[:, :-1], b), (found[:, 1:], b)):
        join(part, values, out=part)
    return found


def worst_strain(e_min_a: Array, e_min_b: Array) -> Array:
    """Worst compressive strain (<= 0) over the bonds of each node, (columns, rows)."""
    return over_bonds(np.minimum, e_min_a, e_min_b)


def by_foam(
    snapshot: Snapshot, scene: Scene, what: Callable[[BondFoam, Array], NDArray[Any]]
) -> tuple[Array, Array]:
    """A function of the worst strain, evaluated for all bonds A and B with their own foams.

    `what` takes a foam and an array of strains, and returns an array of the same shape.
    """
    foams, rows_a, rows_b = foams_of_bonds(scene)
    a, b = snapshot.e_min_a, snapshot.e_min_b
    if len(foams) == 1:
        return what(foams[0], a), what(foams[0], b)
    found = np.zeros(a.shape), np.zeros(b.shape)
    for number, foam in enumerate(foams):
        for values, worst, rows in zip(found, (a, b), (rows_a, rows_b), strict=True):
            values[:, rows == number] = what(foam, worst[:, rows == number])
    return found


def crushed_parts(snapshot: Snapshot, scene: Scene) -> tuple[Array, Array]:
    """The crushed part of bonds A and B, each from its own foam: 0 to 1.

    On its plateau foam is a mixture: this part of it is crushed, the rest has only yielded.
    """

    def part(foam: BondFoam, worst: Array) -> Array:
        marks = foam.landmarks
        return np.clip(
            (marks.crush_start - worst) / (marks.crush_start - marks.crush_end), 0.0, 1.0
        )

    return by_foam(snapshot, scene, part)


def crushed_cells(snapshot: Snapshot, scene: Scene) -> Flags:
    """Whether each cell is crushed, (columns, rows).

    A cell is crushed if the crushed part of at least one of its two to four bonds, at the worst
    compressive strain so far, exceeds CRUSHED_FRACTION.
    """
    return over_bonds(np.maximum, *crushed_parts(snapshot, scene)) > CRUSHED_FRACTION
