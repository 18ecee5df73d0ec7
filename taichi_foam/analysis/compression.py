"""The compression test that a crosshead makes: nominal stress over nominal strain."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from taichi_foam.records.record import Record
from taichi_foam.scene.motion import width_under

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Top:
    """The largest force [N] of a crosshead, its nominal stress [Pa], and the strain there."""

    force: float
    stress: float
    strain: float


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


def largest_stress(record: Record) -> Top | None:
    """Where a crosshead's stress is largest; None without one, or before it has touched."""
    curve, block = compression_curve(record), record.scene.block
    if curve is None or not curve[1].any():
        return None
    assert record.scene.impactor is not None
    strain, stress = curve
    top = int(np.argmax(stress))
    area = width_under(record.scene.impactor, block) * block.depth
    return Top(float(stress[top]) * area, float(stress[top]), float(strain[top]))
