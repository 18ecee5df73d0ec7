"""Where the impactor is: its outline at an instant, and how far its lowest point has come down."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from taichi_foam.laws.shape.outline import convex_hull
from taichi_foam.records.record import Record
from taichi_foam.records.snapshot import Snapshot
from taichi_foam.scene import Scene

Array = NDArray[np.float64]


def impactor_now(snapshot: Snapshot, scene: Scene) -> Array | None:
    """Vertices (n, 2) of the impactor's outline at an instant [m]; None without one."""
    if scene.impactor is None or np.isnan(snapshot.impactor_y):
        return None
    return scene.impactor.outline_at(
        snapshot.impactor_y, snapshot.impactor_shift, snapshot.impactor_angle
    )


def way_down(record: Record) -> Array:
    """How far the impactor's lowest point has come down since the start, at each row (n,) [m].

    It is another point whenever the impactor has turned.
    """
    history, impactor = record.history, record.scene.impactor
    way = history["displacement_m"]
    if impactor is None or impactor.guided:
        return way
    sine, cosine = np.sin(history["angle_rad"]), np.cos(history["angle_rad"])
    lowest = np.full_like(way, np.inf)
    for across, up in convex_hull(impactor.outline()) - impactor.centre_of_mass:
        lowest = np.minimum(lowest, sine * across + cosine * up)
    return way - (lowest + impactor.centre_of_mass[1])


def fell_beside(record: Record) -> bool:
    """Whether an impactor that turns came down to the block's bottom beside the block."""
    history, scene, impactor = record.history, record.scene, record.scene.impactor
    if impactor is None or impactor.guided:
        return False
    start = record.contact_height + impactor.gap
    down = np.flatnonzero(way_down(record) >= start)
    if down.size == 0:
        return False
    names = ("displacement_m", "displacement_x_m", "angle_rad")
    depth, shift, angle = (float(history[name][down[0]]) for name in names)
    outline = impactor.outline_at(start - depth, shift, angle)
    lowest, foam = outline[np.argmin(outline[:, 1]), 0], np.array(scene.block.corners)[:, 0]
    return bool(lowest < foam.min() or lowest > foam.max())
