"""Which foam each bond is of: blocks of several foams, and foams that differ by direction."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from taichi_foam.laws.bond import BondFoam
from taichi_foam.scene import Scene
from taichi_foam.scene.layers import foams_of, foams_of_bonds

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
    """The foams of a scene's bonds; a row's last bonds B, which are none, are of its own foam."""
    foams, along, upright = foams_of_bonds(scene)
    places = np.array([along, [*upright, foams_of(scene)[1][-1]]])
    used = np.unique(places)
    return Grading(tuple(foams[n] for n in used), np.searchsorted(used, places).astype(np.int32))
