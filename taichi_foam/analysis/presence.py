"""Where a block has foam: its mass points, and the bonds that join them.

In a snapshot of a block with an outline all places of the lattice have numbers, those without a
mass point too, and bonds that never were are not broken.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from taichi_foam.records.snapshot import Snapshot
from taichi_foam.scene import Block
from taichi_foam.scene.filling import filling

Flags = NDArray[np.bool_]


def there(block: Block) -> Flags:
    """(columns, rows) where there are mass points."""
    return filling(block).there


def bonded(block: Block) -> tuple[Flags, Flags]:
    """Where there are bonds A and B, whole or broken: (columns-1, rows), (columns, rows-1)."""
    filled = filling(block)
    return filled.face_a > 0.0, filled.face_b > 0.0


def hangs_on(snapshot: Snapshot, block: Block) -> Flags:
    """(columns, rows) which mass points hang on a whole bond."""
    apart_a, apart_b = apart(snapshot, block)
    found = np.zeros(snapshot.position.shape[:2], dtype=bool)
    found[:-1] |= ~apart_a
    found[1:] |= ~apart_a
    found[:, :-1] |= ~apart_b
    found[:, 1:] |= ~apart_b
    return found


def apart(snapshot: Snapshot, block: Block) -> tuple[Flags, Flags]:
    """Where no bonds A and B join mass points: they are broken, or never were."""
    a, b = bonded(block)
    return snapshot.broken_a | ~a, snapshot.broken_b | ~b
