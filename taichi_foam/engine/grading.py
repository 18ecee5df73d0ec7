"""Which foam each bond is of: blocks of several foams, and foams that differ by direction."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from taichi_foam.laws.bond import BondFoam
from taichi_foam.scene import Scene
from taichi_foam.scene.layers import foams_of

# A bond runs along its own axis (A along x, B along y); the other axis lies across it.
A = 0
B = 1


@dataclass(frozen=True)
class Grading:
    """The foams of a block, and where they are.

    foams   each different one
    places  (2, J) index of that of bonds A of row j, and of bonds B from row j to row j + 1
    """

    foams: tuple[BondFoam, ...]
    places: NDArray[np.int32]


def grading(scene: Scene) -> Grading:
    """The foams of a scene's bonds.

    A bond between two layers is of the one that crushes first: the other, half a cell of it, would
    hardly be strained.
    """
    found: list[BondFoam] = []

    def place(foam: BondFoam) -> int:
        if foam not in found:
            found.append(foam)
        return found.index(foam)

    upright, rows = foams_of(scene)
    along = [upright[n] for n in rows]
    weaker = [
        min(upright[n], upright[m], key=lambda foam: foam.landmarks.plateau_stress)
        for n, m in zip(rows, [*rows[1:], rows[-1]], strict=True)
    ]
    places = [[place(foam) for foam in weaker], [place(foam) for foam in along]]
    return Grading(tuple(found), np.array(places[::-1], dtype=np.int32))
