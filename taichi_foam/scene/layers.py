"""The foam of each row of a block's lattice, and the loose interfaces between rows."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from taichi_foam.laws.bond import BondFoam
from taichi_foam.scene.block import Block, rows_of


def layer_of_rows(block: Block) -> NDArray[np.int64]:
    """Index in `block.layers` of the layer of each row (J,); -1: none."""
    found = np.full(block.rows, -1)
    for number, layer in enumerate(block.layers):
        found[rows_of(block, layer)] = number
    return found


def foams_of(scene: Any) -> tuple[tuple[BondFoam, ...], NDArray[np.int64]]:
    """The distinct foams of a scene's block, `scene.foam` first, and each row's index (J,)."""
    foams = [scene.foam]
    kinds = [0]  # index for rows in no layer, then for each layer
    for layer in scene.block.layers:
        foam = layer.foam or scene.foam
        if foam not in foams:
            foams.append(foam)
        kinds.append(foams.index(foam))
    return tuple(foams), np.array(kinds)[layer_of_rows(scene.block) + 1]


def foams_of_bonds(
    scene: Any,
) -> tuple[tuple[BondFoam, ...], NDArray[np.int64], NDArray[np.int64]]:
    """The foams of a block's bonds, and the index for bonds A of each row (J,), B above it (J-1,).

    A bond between two layers is of the foam that crushes first: the other foam's half cell would
    hardly be strained. In rows of [foam], bonds A are of the foam of [across], if there is one. A
    plane has one shear modulus, that of [foam].
    """
    foams, rows = foams_of(scene)
    plateau = np.array([foam.landmarks.plateau_stress for foam in foams])
    between = np.where(plateau[rows[:-1]] <= plateau[rows[1:]], rows[:-1], rows[1:])
    if scene.across.foam is None:
        return foams, rows, between
    across = scene.across.foam.model_copy(update={"shear_modulus": scene.foam.shear_modulus})
    return (*foams, across), np.where(rows == 0, len(foams), rows), between


def loose_rows(block: Block) -> NDArray[np.int64]:
    """Rows j whose bonds B(i, j) to row j + 1 are cut at the start by a loose interface."""
    layer = layer_of_rows(block)
    loose = np.array([False, *(each.interface == "loose" for each in block.layers)])[layer + 1]
    return np.flatnonzero((layer[:-1] != layer[1:]) & (loose[:-1] | loose[1:]))
