"""The columns of a history, computed from the engine's rows: signs, sums, and a filter."""

from __future__ import annotations

from functools import reduce
from operator import add

import numpy as np
from numpy.typing import NDArray

from taichi_foam.formulas.traces import filtered
from taichi_foam.records.history import COLUMNS, History, row_columns
from taichi_foam.scene import Scene

Array = NDArray[np.float64]

CHANNEL_CLASS = 180
"""Channel frequency class [Hz] of the smoothed deceleration, see `formulas.traces`."""


def history_of(scene: Scene, rows: NDArray[np.float64]) -> History:
    """The history of `scene` from rows (n, k) of the engine, see `row_columns`.

    The rows start with the first row of the run; n may be 0.

    Work counts from the first row. The dissipation of a mechanism is the work done on it, minus the
    increase of its stored energy since the first row, and minus the stored energy that is counted
    as fracture energy. The residual is the energy that no column accounts for. Columns not computed
    here are the sums of their `source`.
    """
    of = dict(zip(row_columns(scene.turns), rows.T, strict=True))
    impactor = scene.impactor
    mass, gravity = (impactor.mass if impactor else 0.0), scene.numerics.gravity
    t, y, v = of["clock.time"], of["body.y"], of["body.v"]
    interval = np.diff(t, prepend=t[:1])
    pulse = scene.base.shaking
    upwards = v if pulse is None else v + pulse.velocity(t)  # the engine's v is relative
    deceleration = np.divide(
        np.diff(upwards, prepend=upwards[:1]), interval, out=np.zeros_like(t), where=interval > 0
    )
    normal = of["bonds"] - of["shear"] - of["room"]
    if scene.model.damping != "absolute":
        normal = normal - of["dashpots"]  # "absolute" dashpots act on mass points, not in bonds

    def lost(work: Array, *stored: str, fracture: str | None = None) -> Array:
        held = reduce(add, (of[member] for member in stored))
        return work - (held - held[:1]) - (0.0 if fracture is None else of[fracture])

    potential = of["potential"] + mass * gravity * y
    found = {
        "displacement_m": (y[:1] - y) if impactor else np.zeros_like(t),
        "velocity_m_s": -v,
        "deceleration_m_s2": deceleration,
        "deceleration_smoothed_m_s2": filtered(t, deceleration, CHANNEL_CLASS, means=True),
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
        turning = 0.5 * impactor.moment_of_inertia * of["turn.spin"] ** 2
        found["impactor_kinetic_J"] += 0.5 * mass * of["turn.u"] ** 2 + turning
    for name, column in COLUMNS.items():
        if name not in found and column.source and (scene.turns or not column.turns):
            found[name] = reduce(add, (of[member] for member in column.source))
    total = np.sum([found[name] for name, column in COLUMNS.items() if column.in_ledger], axis=0)
    return History({**found, "residual_J": total[:1] - total})
