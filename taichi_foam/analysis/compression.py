"""The compression test that a crosshead makes: nominal stress over nominal strain."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from taichi_foam.analysis.impact import width_under
from taichi_foam.records.record import Record

Array = NDArray[np.float64]


def compression_curve(record: Record) -> tuple[Array, Array] | None:
    """Strain and stress [Pa] of a crosshead's test, compression positive, from first contact on.

    Nominal ones: the way of the face over the block's thickness between its first and last row of
    mass points, and its force over the area of the block under it. None without a crosshead.
    """
    scene, history = record.scene, record.history
    impactor, block = scene.impactor, scene.block
    if impactor is None or impactor.motion != "crosshead":
        return None
    way = history["displacement_m"] - impactor.gap
    strain = way / (record.contact_height - block.foot)
    width = width_under(impactor, block)
    stress = history["contact_force_N"] / (width * block.depth)
    touched = strain >= 0.0
    return strain[touched], stress[touched]
