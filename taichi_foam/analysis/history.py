"""The history of a run from the rows of the engine: signs and sums as people report them."""

from __future__ import annotations

from functools import reduce
from operator import add

import numpy as np
from numpy.typing import NDArray

from taichi_foam.analysis.smoothing import smooth_deceleration
from taichi_foam.records.history import COLUMNS, History, row_columns
from taichi_foam.scene import Scene

Array = NDArray[np.float64]


def history_of(scene: Scene, rows: NDArray[np.float64]) -> History:
    """The history of `scene` from rows (n, k) of the engine, see `row_columns`.

    They go from the first row of the run on; n may be 0.

    Works count from the first row. What a mechanism has lost is the work that it took, less what it
    stores more than at the first row, and less the stored energy that is booked as fracture. The
    residual is the energy that no column accounts for. What is not said here is the sum of its
    column's `source`.
    """
    of = dict(zip(row_columns(scene.turns), rows.T, strict=True))
    impactor = scene.impactor
    mass, gravity = (impactor.mass if impactor else 0.0), scene.numerics.gravity
    t, y, v = of["time"], of["y"], of["v"]
    interval = np.diff(t, prepend=t[:1])
    pulse = scene.base.shaking
    upwards = v if pulse is None else v + pulse.velocity(t)  # the engine's v is that on the base
    deceleration = np.divide(
        np.diff(upwards, prepend=upwards[:1]), interval, out=np.zeros_like(t), where=interval > 0
    )
    normal = of["bonds"] - of["shear"] - of["room"]
    if scene.model.damping != "absolute":
        normal = normal - of["dashpots"]  # which drag acts beside: it is on the mass points

    def lost(work: Array, *stored: str, fracture: str | None = None) -> Array:
        held = reduce(add, (of[member] for member in stored))
        return work - (held - held[:1]) - (0.0 if fracture is None else of[fracture])

    potential = of["potential"] + mass * gravity * y
    found = {
        "displacement_m": (y[:1] - y) if impactor else np.zeros_like(t),
        "velocity_m_s": -v,
        "deceleration_m_s2": deceleration,
        "deceleration_smoothed_m_s2": smooth_deceleration(t, deceleration),
        "impactor_kinetic_J": 0.5 * mass * v**2,
        "crushing_J": lost(normal, "in_bonds", fracture="lost_by_bonds"),
        "folding_J": lost(of["room"], "in_room", fracture="lost_by_room"),
        "shearing_J": lost(of["shear"], "in_shear", fracture="lost_by_shear"),
        "friction_J": lost(of["friction"], "held_by_friction", "held_by_base_friction"),
        "contact_loss_J": lost(of["contact"], "held_by_contact", "held_by_base"),
        "self_contact_J": lost(of["pieces"], "held_by_pieces"),
        "gravity_J": potential - potential[:1],
    }
    if impactor is not None and scene.turns:
        turning = 0.5 * impactor.moment_of_inertia * of["spin"] ** 2
        found["impactor_kinetic_J"] += 0.5 * mass * of["u"] ** 2 + turning
    for name, column in COLUMNS.items():
        if name not in found and column.source and (scene.turns or not column.turns):
            found[name] = reduce(add, (of[member] for member in column.source))
    total = np.sum([found[name] for name, column in COLUMNS.items() if column.in_ledger], axis=0)
    return History({**found, "residual_J": total[:1] - total})
