"""Which foam each row of a block's lattice is of, and where rows only lie on one another."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from taichi_foam.laws.bond import BondFoam
from taichi_foam.scene.block import Block, rows_of


def layer_of_rows(block: Block) -> NDArray[np.int64]:
    """Place in `block.layers` of the layer of each row (J,); -1: none."""
    found = np.full(block.rows, -1)
    for number, layer in enumerate(block.layers):
        found[rows_of(block, layer)] = number
    return found


def foams_of(scene: Any) -> tuple[tuple[BondFoam, ...], NDArray[np.int64]]:
    """The foams of a scene's block, `scene.foam` first and each once, and that of each row (J,)."""
    foams = [scene.foam]
    kinds = [0]  # of a row in no layer; then of each layer
    for layer in scene.block.layers:
        foam = layer.foam or scene.foam
        if foam not in foams:
            foams.append(foam)
        kinds.append(foams.index(foam))
    return tuple(foams), np.array(kinds)[layer_of_rows(scene.block) + 1]


def foams_of_bonds(
    scene: Any,
) -> tuple[tuple[BondFoam, ...], NDArray[np.int64], NDArray[np.int64]]:
    """The foams of a scene's block, that of bonds A of each row (J,), of bonds B above it (J-1,).

    A bond between two layers is of the one that crushes first: the other, half a cell of it, would
    hardly be strained. Bonds A of [foam] are of that of [across], if there is one; a plane has one
    shear modulus, that of [foam].
    """
    foams, rows = foams_of(scene)
    plateau = np.array([foam.landmarks.plateau_stress for foam in foams])
    between = np.where(plateau[rows[:-1]] <= plateau[rows[1:]], rows[:-1], rows[1:])
    if scene.across.foam is None:
        return foams, rows, between
    across = scene.across.foam.model_copy(update={"shear_modulus": scene.foam.shear_modulus})
    return (*foams, across), np.where(rows == 0, len(foams), rows), between


def loose_rows(block: Block) -> NDArray[np.int64]:
    """Rows j whose bonds B(i, j) to row j + 1 a loose interface cuts at the start."""
    layer = layer_of_rows(block)
    loose = np.array([False, *(each.interface == "loose" for each in block.layers)])[layer + 1]
    return np.flatnonzero((layer[:-1] != layer[1:]) & (loose[:-1] | loose[1:]))
