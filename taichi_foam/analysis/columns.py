"""The columns of a history, computed from the engine's rows: signs, sums, and SAE J211 filter."""

from __future__ import annotations

import math
from functools import reduce
from operator import add

import numpy as np
from numpy.typing import ArrayLike, NDArray

from taichi_foam.records.history import COLUMNS, History, row_columns
from taichi_foam.scene import Scene

Array = NDArray[np.float64]

CHANNEL_CLASS = 180
"""Channel frequency class (Hz): the signal passes unchanged, within 0.5 dB, up to here."""

PASS_CUTOFF_HZ = 2.0775 * CHANNEL_CLASS
"""Cut-off frequency of each pass (Hz). Two passes together are 3 dB down at 300 Hz = CFC / 0.6."""

_SAMPLE_INTERVAL = 1e-4  # s; J211 requires at least 10 CFC = 1800 samples/s
_PAD = 0.02  # s before and after; the response of a pass has decayed to 1e-14 by then


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
    t, y, v = of["time"], of["y"], of["v"]
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


def smooth_deceleration(time: ArrayLike, deceleration: ArrayLike) -> NDArray[np.float64]:
    """Four-pole zero-phase Butterworth filter, CFC 180 (SAE J211): two poles forward, two backward.

    time          (n,) s, increasing, not necessarily evenly spaced
    deceleration  (n,) m/s2; row k is the mean over time[k-1] .. time[k]. Row 0 has no interval and
                  is not used: before time[0] there is no contact and no deceleration. (Otherwise
                  the filter would reflect the sudden start of a flat impactor at the edge.)
    Returns (n,) m/s2, the smoothed deceleration at the instants `time`; after the last row the
    raw series is assumed to keep its last value. Raises ValueError for invalid shapes or times. A
    series with a non-finite value gives all NaN.
    """
    t = np.asarray(time, dtype=np.float64)
    raw = np.asarray(deceleration, dtype=np.float64)
    if t.ndim != 1 or t.shape != raw.shape:
        raise ValueError(f"time {t.shape} and deceleration {raw.shape} must be equal in length")
    if not np.isfinite(raw[1:]).all():
        return np.full_like(raw, np.nan)
    if t.size < 2:
        return np.zeros_like(raw)
    widths = np.diff(t)
    if not (widths > 0).all():
        raise ValueError("time must increase from row to row")
    # Even resampling that preserves the integral (the velocity change) of every row.
    step = min(float(np.median(widths)), _SAMPLE_INTERVAL)
    pad = int(np.ceil(_PAD / step))
    count = int(np.ceil((t[-1] - t[0]) / step))
    edges = t[0] + step * np.arange(-pad, count + pad + 1)
    speed = np.concatenate([[0.0], np.cumsum(raw[1:] * widths)])
    beyond = np.maximum(edges - t[-1], 0.0) * raw[-1]
    samples = np.diff(np.interp(edges, t, speed) + beyond) / step

    forth = _low_pass(samples, PASS_CUTOFF_HZ * step)
    smooth = _low_pass(forth[::-1], PASS_CUTOFF_HZ * step)[::-1]
    return np.interp(t, 0.5 * (edges[1:] + edges[:-1]), smooth)


def _low_pass(samples: NDArray[np.float64], cutoff: float) -> NDArray[np.float64]:
    """One pass of a two-pole Butterworth low-pass (SAE J211-1, appendix C).

    `cutoff` is in cycles per sample; the signal before the first sample is assumed constant. SciPy
    also uses a loop for this, and takes half a second to load: a fifth of a short run.
    """
    w = math.tan(math.pi * cutoff)
    whole = 1.0 + math.sqrt(2.0) * w + w * w
    b = w * w / whole
    a1, a2 = 2.0 * (w * w - 1.0) / whole, (1.0 - math.sqrt(2.0) * w + w * w) / whole
    first = float(samples[0])
    passed, one, two = np.empty_like(samples), 0.0, 0.0  # filter state from the last two samples
    for k, sample in enumerate((samples - first).tolist()):
        now = b * sample + one
        one = 2.0 * b * sample - a1 * now + two
        two = b * sample - a2 * now
        passed[k] = now
    return passed + first
