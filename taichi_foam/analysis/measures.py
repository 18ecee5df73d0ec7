"""The figures that sum up a run, as the paper measures them (Tables 2-5, Eqs 4-7).

Every function takes a finished `Record` and gives None where its question has no answer: no
impactor, no contact, or a run that ended before the impactor came to rest. SI units throughout;
displacements, velocities and decelerations are the impactor's, positive downwards (a deceleration:
upwards), and count from first contact.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from taichi_foam.analysis.fragments import crack_over_time, pieces
from taichi_foam.analysis.pattern import crushed_region
from taichi_foam.records.ending import Ending
from taichi_foam.records.record import Record
from taichi_foam.scene import Impactor

FLAT_RISE_S = 3e-3
"""The initial rise of a flat face ends so long after contact ..."""

NOSE_RISE_LIMIT_M = 0.025
"""... and that of a nose when it is fully in, or this deep if it is longer (here: the paper's)."""

PLATEAU_END_FRACTION = 0.85
"""The plateau ends at this share of the impact duration, before the final decline."""

INITIAL_PEAK_WINDOW_S = 5e-3
"""A flat face's initial peak lies within this time of contact (measured: 1.8 to 2.9 ms)."""


@dataclass(frozen=True)
class Impact:
    """When the impactor touched and when it came to rest.

    impactor    the one that did
    row         first history row after the stop
    contact     s, first contact
    stop        s, first zero of the velocity
    depth_0     m, displacement column at contact (a gap, if any, lies before it)
    depth       m, displacement from contact to stop
    velocity_0  m/s at contact
    """

    impactor: Impactor
    row: int
    contact: float
    stop: float
    depth_0: float
    depth: float
    velocity_0: float

    @property
    def duration(self) -> float:
        """Impact duration (s), from first contact to zero velocity (paper, section 3.1)."""
        return self.stop - self.contact


def impact(record: Record) -> Impact | None:
    """First contact and stop; the velocity is taken as linear between rows.

    First contact is when the impactor's lowest level has used up its gap: a nose then touches the
    foam, though the lattice answers only when the first mass point is under it.
    """
    h, impactor = record.history, record.scene.impactor
    if impactor is None:
        return None
    t, d, v = h["time_s"], h["displacement_m"], h["velocity_m_s"]
    reached = np.flatnonzero(d >= impactor.gap)
    touching = np.flatnonzero(h["contact_force_N"] > 0)
    if reached.size == 0 or touching.size == 0:
        return None
    before = max(int(reached[0]) - 1, 0)
    flight = 0.0  # s, from row `before` to contact, at constant velocity
    if v[before] > 0:
        left = (impactor.gap - d[before]) / v[before]
        flight = float(np.clip(left, 0, t[reached[0]] - t[before]))
    stopped = np.flatnonzero((v[1:] <= 0) & (v[:-1] > 0)) + 1
    stopped = stopped[stopped >= touching[0]]
    if stopped.size == 0:
        return None
    k = int(stopped[0])
    last = (t[k] - t[k - 1]) * v[k - 1] / (v[k - 1] - v[k])  # s, from row k-1 to the stop
    depth_0 = float(d[before] + v[before] * flight)
    return Impact(
        impactor=impactor,
        row=k,
        contact=float(t[before]) + flight,
        stop=float(t[k - 1] + last),
        depth_0=depth_0,
        depth=float(d[k - 1] + 0.5 * v[k - 1] * last) - depth_0,
        velocity_0=float(v[before]),
    )


def impact_duration(record: Record) -> float | None:
    """From first contact to zero impactor velocity (s)."""
    found = impact(record)
    return found.duration if found else None


def max_displacement(record: Record) -> float | None:
    """Displacement when the velocity reaches zero (m): exact for a constant deceleration."""
    found = impact(record)
    return found.depth if found else None


def plateau(record: Record) -> float | None:
    """Time mean of the raw deceleration over the plateau (m/s2).

    It runs from the end of the initial rise (FLAT_RISE_S after contact for a flat face, else when
    the nose is in: NOSE_RISE_LIMIT_M) to PLATEAU_END_FRACTION of the impact duration. None if the
    rise takes longer than that.
    """
    found = impact(record)
    if found is None:
        return None
    h = record.history
    t, d = h["time_s"], h["displacement_m"]
    end = found.contact + PLATEAU_END_FRACTION * found.duration
    if _is_flat(found.impactor):
        start = found.contact + FLAT_RISE_S
    else:
        depth = found.depth_0 + min(found.impactor.nose_depth, NOSE_RISE_LIMIT_M)
        sinking = slice(0, found.row)  # up to the last row before the stop d only grows
        if d[sinking][-1] < depth:
            return None
        start = float(np.interp(depth, d[sinking], t[sinking]))
    if start >= end:
        return None
    # Each row counts by the part of its interval that lies in the window.
    overlap = np.clip(np.minimum(t[1:], end) - np.maximum(t[:-1], start), 0, None)
    return float(overlap @ h["deceleration_m_s2"][1:] / overlap.sum())


def initial_peak(record: Record) -> tuple[float, float] | None:
    """Initial peak of the smoothed deceleration and its time after contact (m/s2, s).

    The largest within INITIAL_PEAK_WINDOW_S of contact; flat faces only.
    """
    found = impact(record)
    if found is None or not _is_flat(found.impactor):
        return None
    since = record.history["time_s"] - found.contact
    window = (since >= 0) & (since <= min(INITIAL_PEAK_WINDOW_S, found.duration))
    smooth = record.history["deceleration_smoothed_m_s2"][window]
    if smooth.size == 0 or np.isnan(smooth).any():
        return None
    top = int(np.argmax(smooth))
    return float(smooth[top]), float(since[window][top])


def energy_absorbed(record: Record) -> float | None:
    """Loss of the impactor's kinetic energy from contact to stop (J), Eq. 7; gravity left out."""
    found = impact(record)
    return 0.5 * found.impactor.mass * found.velocity_0**2 if found else None


def crushed_volume(record: Record) -> float | None:
    """Volume crushed at the largest displacement (m3), Eqs 4-6."""
    found = impact(record)
    if found is None:
        return None
    return float(found.impactor.crushed_volume(found.depth, record.scene.block.thickness))


def energy_per_volume(record: Record) -> float | None:
    """Energy absorbed over volume crushed (J/m3), both at the largest displacement.

    The paper's Table 5 gives slopes of Fig. 13, see `energy_volume_slope`.
    """
    energy, volume = energy_absorbed(record), crushed_volume(record)
    return energy / volume if energy is not None and volume else None


def absorption_curve(record: Record) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
    """Volume crushed (m3) and energy absorbed (J) from contact to stop, as in Fig. 13."""
    found = impact(record)
    if found is None:
        return None
    h, impactor = record.history, found.impactor
    during = (h["time_s"] > found.contact) & (h["time_s"] < found.stop)
    depth = np.concatenate([[0.0], h["displacement_m"][during] - found.depth_0, [found.depth]])
    velocity = np.concatenate([[found.velocity_0], h["velocity_m_s"][during], [0.0]])
    volume = impactor.crushed_volume(depth, record.scene.block.thickness)
    return np.asarray(volume), 0.5 * impactor.mass * (found.velocity_0**2 - velocity**2)


def energy_volume_slope(record: Record) -> float | None:
    """Slope of the straight line that fits `absorption_curve` best (J/m3), as in Table 5."""
    curve = absorption_curve(record)
    if curve is None or np.ptp(curve[0]) == 0:
        return None
    volume, energy = (values - values.mean() for values in curve)
    return float(volume @ energy / (volume @ volume))


def rebound_velocity(record: Record) -> float | None:
    """Largest upward velocity after the stop (m/s, positive)."""
    found = impact(record)
    return float(-record.history["velocity_m_s"][found.row :].min()) if found else None


def energy_residual(record: Record) -> float | None:
    """Unaccounted energy at its worst row, with its sign, over the impact energy.

    The impact energy is the largest kinetic and strain energy that any row holds: that of the
    first row, or, when things fall, that at contact. None if it is zero.
    """
    h = record.history
    parts = ("impactor_kinetic_J", "foam_kinetic_J", "strain_J")
    impact_energy = np.sum([np.nan_to_num(h[name]) for name in parts], axis=0).max(initial=0.0)
    if impact_energy == 0:
        return None
    return float(h["residual_J"][np.argmax(np.abs(h["residual_J"]))] / impact_energy)


def summary(record: Record) -> dict[str, Any]:
    """The content of summary.json: one entry per measure, units in the names, None for no answer.

    Pieces and the crushed region are those of the last snapshot.
    """
    scene, run, found = record.scene, record.run, impact(record)
    peak = initial_peak(record)
    last = record.snapshots[-1] if record.snapshots else None
    region = crushed_region(last, scene) if last else None
    crack = crack_over_time(record.snapshots, scene)
    broken = record.history["broken_bonds"]
    overlap = run.get("max_overlap_m") if scene.impactor is not None else None
    return {
        "scene": scene.name,
        "impact_duration_s": found and found.duration,
        "max_displacement_m": found and found.depth,
        "plateau_deceleration_m_s2": plateau(record),
        "initial_peak_m_s2": peak and peak[0],
        "initial_peak_time_s": peak and peak[1],
        "energy_absorbed_J": energy_absorbed(record),
        "crushed_volume_m3": crushed_volume(record),
        "energy_per_volume_J_m3": energy_per_volume(record),
        "energy_volume_slope_J_m3": energy_volume_slope(record),
        "rebound_velocity_m_s": rebound_velocity(record),
        "crushed_width_m": region and region.width,
        "crushed_height_m": region and region.height,
        "crushed_height_left_m": region and region.height_left,
        "pieces": pieces(last) if last else None,
        "crack_lowest_height_m": crack and crack.lowest_height,
        "crack_start_x_m": crack and crack.start_x,
        "crack_start_height_m": crack and crack.start_height,
        "crack_start_time_s": crack and crack.start_time,
        "broken_bonds": int(broken[-1]) if broken.size else None,
        "energy_residual": energy_residual(record),
        "steps": run.get("steps"),
        "dt_min_s": run.get("dt_min_s"),
        "dt_max_s": run.get("dt_max_s"),
        "wall_s": run.get("wall_s"),
        "node_stages_per_s": run.get("node_stages_per_s"),
        "max_overlap_cells": (
            None if overlap is None else overlap / min(scene.block.dx, scene.block.dy)
        ),
        "interrupted": record.ending is Ending.INTERRUPTED,
    }


def _is_flat(impactor: Impactor) -> bool:
    """Whether the impactor meets the block with a level face."""
    return impactor.nose_depth <= 1e-6 * impactor.extent
