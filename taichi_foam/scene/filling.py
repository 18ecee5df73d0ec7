"""What the foam of a block fills: mass of each mass point, share of each bond's face."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from taichi_foam.scene.block import Block

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Filling:
    """A block on its lattice of I x J cells, one mass point in each.

    mass    (I, J) of the mass points [kg]; 0: there is none
    face_a  (I-1, J) area of the face of bond A(i, j) over that of a whole one; 0: no bond
    face_b  (I, J-1) the same of B(i, j)
    reach   (I, J) from a mass point to the foam's nearest face [m], negative where it lies outside;
            inside the block half a cell
    """

    mass: Array
    face_a: Array
    face_b: Array
    reach: Array

    @property
    def there(self) -> NDArray[np.bool_]:
        """(I, J) where there are mass points."""
        return self.mass > 0.0


@lru_cache(maxsize=64)
def filling(block: Block) -> Filling:
    """What the foam of a block fills."""
    columns, rows = block.columns, block.rows
    return Filling(
        mass=np.full((columns, rows), block.node_mass),
        face_a=np.ones((columns - 1, rows)),
        face_b=np.ones((columns, rows - 1)),
        reach=np.full((columns, rows), 0.5 * min(block.dx, block.dy)),
    )
