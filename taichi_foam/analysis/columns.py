"""The columns of a history, computed from the engine's rows: signs, sums, and a filter."""

from __future__ import annotations

from functools import reduce
from operator import add, sub

import numpy as np
from numpy.typing import NDArray

from taichi_foam.formulas.traces import filtered
from taichi_foam.records.history import CHANNEL_CLASS, COLUMNS, History, Loss, row_columns
from taichi_foam.scene import Scene

Array = NDArray[np.float64]


def intervals(time: Array) -> Array:
    """Length (n,) of each row's interval, from the row before [s]; 0 for the first row."""
    return np.diff(time, prepend=time[:1])


def mean_rates(time: Array, values: Array) -> Array:
    """Mean rate of change (n,) of values (n,) over each row's interval [1/s]; 0 for the first."""
    interval, change = intervals(time), np.diff(values, prepend=values[:1])
    return np.divide(change, interval, out=np.zeros_like(time), where=interval > 0)


def history_of(scene: Scene, rows: NDArray[np.float64]) -> History:
    """The history of `scene` from rows (n, k) of the engine, see `row_columns`.

    The rows start with the first row of the run; n may be 0.

    Work counts from the first row. The residual is the energy that no column accounts for. Columns
    not computed here are what their `source` says.
    """
    of = dict(zip(row_columns(scene.turns), rows.T, strict=True))
    impactor = scene.impactor
    mass, gravity = (impactor.mass if impactor else 0.0), scene.numerics.gravity
    t, y, v = of["clock.time"], of["body.y"], of["body.v"]
    pulse = scene.base.shaking
    upwards = v if pulse is None else v + pulse.velocity(t)  # the engine's v is relative
    deceleration = mean_rates(t, upwards)
    # "absolute" dashpots act on mass points: they are no part of another work
    apart = {"dashpots"} if scene.model.damping == "absolute" else set()

    def lost(loss: Loss) -> Array:
        work = reduce(
            sub, (of[member] for member in (loss.work, *loss.besides) if member not in apart)
        )
        held = reduce(add, (of[member] for member in loss.stored))
        return work - (held - held[:1]) - (of[loss.fracture] if loss.fracture else 0.0)

    potential = of["potential"] + mass * gravity * y
    found = {
        "displacement_m": (y[:1] - y) if impactor else np.zeros_like(t),
        "velocity_m_s": -v,
        "deceleration_m_s2": deceleration,
        "deceleration_smoothed_m_s2": filtered(t, deceleration, CHANNEL_CLASS, means=True),
        "impactor_kinetic_J": 0.5 * mass * v**2,
        "gravity_J": potential - potential[:1],
    }
    if impactor is not None and scene.turns:
        turning = 0.5 * impactor.moment_of_inertia * of["turn.spin"] ** 2
        found["impactor_kinetic_J"] += 0.5 * mass * of["turn.u"] ** 2 + turning
    for name, column in COLUMNS.items():
        if name in found or not column.members or (column.turns and not scene.turns):
            continue
        if isinstance(column.source, Loss):
            found[name] = lost(column.source)
        else:
            found[name] = reduce(add, (of[member] for member in column.source))
    total = np.sum([found[name] for name, column in COLUMNS.items() if column.in_ledger], axis=0)
    return History({**found, "residual_J": total[:1] - total})
