"""The history of a run from the rows of the engine: signs and sums as people report them."""

from __future__ import annotations

from functools import reduce
from operator import add

import numpy as np
from numpy.typing import NDArray

from taichi_foam.records.history import COLUMNS, History, row_columns
from taichi_foam.scene import Scene


def history_of(scene: Scene, rows: NDArray[np.float64]) -> History:
    """The history of `scene` from rows (n, k) of the engine, see `row_columns`.

    They go from the first row of the run on; n may be 0.

    Work counts from the first row; crushing is what the normal stresses took up beyond what they
    still store or lost by breaking. The residual is the energy that no column accounts for. What
    is not said here is the sum of its column's `source`.
    """
    # filters take a second to load: after the run, not before it
    from taichi_foam.analysis.smoothing import smooth_deceleration

    of = dict(zip(row_columns(scene.turns), rows.T, strict=True))
    impactor = scene.impactor
    mass, gravity = (impactor.mass if impactor else 0.0), scene.numerics.gravity
    t, y, v, stored = of["time"], of["y"], of["v"], of["stored"]
    interval = np.diff(t, prepend=t[:1])
    deceleration = np.divide(
        np.diff(v, prepend=v[:1]), interval, out=np.zeros_like(t), where=interval > 0
    )
    normal = of["bonds"] - of["shear"] - of["dashpots"] - of["room"]
    potential = of["potential"] + mass * gravity * y
    found = {
        "displacement_m": (y[:1] - y) if impactor else np.zeros_like(t),
        "velocity_m_s": -v,
        "deceleration_m_s2": deceleration,
        "deceleration_smoothed_m_s2": smooth_deceleration(t, deceleration),
        "impactor_kinetic_J": 0.5 * mass * v**2,
        "crushing_J": normal - (stored - stored[:1]) - of["fracture"],
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
