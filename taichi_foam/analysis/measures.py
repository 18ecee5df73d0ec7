"""The figures that sum up a run: the paper's (Tables 2-5, Eqs 4-7), and what designers ask first.

Every function takes a finished `Record` and gives None where its question has no answer: no
impactor, no contact, a run that ended before the impactor came to rest, or a driven test, which has
no impact. SI units throughout; displacements, velocities and decelerations are the impactor's,
positive downwards (a deceleration: upwards), and count from first contact.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from taichi_foam.analysis import balance
from taichi_foam.analysis.compression import largest_stress
from taichi_foam.analysis.fragments import crack_over_time, pieces
from taichi_foam.analysis.impact import (
    Contact,
    bottomed_out,
    first_contact,
    impact,
    is_flat,
    passed_through,
)
from taichi_foam.analysis.pattern import crushed_region
from taichi_foam.analysis.presence import hangs_on
from taichi_foam.analysis.resting import LIFTED, height_beneath
from taichi_foam.analysis.room import crushed_layer, without_room
from taichi_foam.analysis.shaking import shaking
from taichi_foam.analysis.soundness import energy_residual, warnings_of
from taichi_foam.analysis.statements import statement
from taichi_foam.records.ending import Ending
from taichi_foam.records.record import Record
from taichi_foam.scene import Scene
from taichi_foam.scene.keys import written
from taichi_foam.scene.paths import at
from taichi_foam.units import STANDARD_GRAVITY

FLAT_RISE_S = 3e-3
"""The initial rise of a flat face ends so long after contact ..."""

NOSE_RISE_LIMIT_M = 0.025
"""... and that of a nose when it is fully in, or this deep if it is longer (here: the paper's)."""

PLATEAU_END_FRACTION = 0.85
"""The plateau ends at this share of the impact duration, before the final decline."""

PLATEAU_SHARE = 0.5
"""Below this share of the mean deceleration over the whole impact there is no plateau (here: half;
in the paper's nine tests it is 1.0 to 1.2)."""

INITIAL_PEAK_WINDOW_S = 5e-3
"""A flat face's initial peak lies within this time of contact (measured: 1.8 to 2.9 ms)."""

RISES = 0.25
"""What a deceleration that only waves about a plateau may rise by after that, over its peak."""


def impact_duration(record: Record) -> float | None:
    """From first contact to zero impactor velocity (s)."""
    found = impact(record)
    return found.duration if found else None


def max_displacement(record: Record) -> float | None:
    """The largest displacement (m), a number for every impactor that has touched.

    That when the velocity reaches zero (exact for a constant deceleration); of one that has not
    come to rest, the largest until the run ended.
    """
    touch, found = first_contact(record), impact(record)
    if found is not None:
        return found.depth
    if touch is None:
        return None
    return float(np.nanmax(record.history["displacement_m"])) - touch.depth_0


def came_to_rest(record: Record) -> bool | None:
    """Whether the velocity reached zero after contact; None in a driven test, too."""
    if first_contact(record) is None or record.scene.is_driven:
        return None
    return impact(record) is not None


@dataclass(frozen=True)
class Peak:
    """The largest deceleration [m/s2], and when, after contact [s]."""

    deceleration: float
    time: float


def peak_deceleration(record: Record) -> Peak | None:
    """The largest raw deceleration since contact, in the middle of its row's interval.

    Raw is the mean over a row's interval, `output.history_interval`. None of a crosshead.
    """
    touch = _free_contact(record)
    if touch is None:
        return None
    time = record.history["time_s"]
    middle = time - 0.5 * np.diff(time, prepend=time[:1])
    return _peak(record.history["deceleration_m_s2"], middle, time, touch.time)


def filtered_peak_deceleration(record: Record) -> Peak | None:
    """The largest deceleration since contact, filtered after CFC 180 (SAE J211); as the raw one."""
    touch = _free_contact(record)
    if touch is None:
        return None
    time = record.history["time_s"]
    return _peak(record.history["deceleration_smoothed_m_s2"], time, time, touch.time)


def peak_resultant(record: Record) -> Peak | None:
    """The largest acceleration since contact of the centre of mass of an impactor that turns.

    The resultant of both directions, gravity left out; raw, as `peak_deceleration`. None on rails.
    """
    touch = first_contact(record)
    if touch is None or touch.impactor.guided:
        return None
    time, up = record.history["time_s"], record.history["deceleration_m_s2"]
    interval = np.diff(time, prepend=time[:1])
    change = np.diff(record.history["velocity_x_m_s"], prepend=0.0)
    sideways = np.divide(change, interval, out=np.zeros_like(time), where=interval > 0)
    return _peak(np.hypot(up, sideways), time - 0.5 * interval, time, touch.time)


def final_turn(record: Record) -> tuple[float, float, float] | None:
    """Angle (rad), spin (rad/s) and sideways velocity (m/s) at the end; None on rails."""
    names = ("angle_rad", "spin_rad_s", "velocity_x_m_s")
    if not record.scene.turns or not record.history["time_s"].size:
        return None
    angle, spin, velocity = (float(record.history[name][-1]) for name in names)
    return angle, spin, velocity


def _free_contact(record: Record) -> Contact | None:
    """First contact of an impactor that is free to be slowed down: no crosshead."""
    touch = first_contact(record)
    return touch if record.scene.is_slowed else None


def _peak(
    deceleration: NDArray[np.float64], at: NDArray[np.float64], end: NDArray[np.float64],
    contact: float,
) -> Peak | None:  # fmt: skip
    """The largest of rows that end after contact; what each is at stands in `at` [s]."""
    since = (end >= contact) & np.isfinite(deceleration)
    if not since.any():
        return None
    top = int(np.argmax(np.where(since, deceleration, -np.inf)))
    return Peak(float(deceleration[top]), max(float(at[top]) - contact, 0.0))


def plateau(record: Record) -> float | None:
    """Time mean of the raw deceleration over the plateau (m/s2).

    It runs from the end of the initial rise (FLAT_RISE_S after contact for a flat face, else when
    the nose is in: NOSE_RISE_LIMIT_M) to PLATEAU_END_FRACTION of the impact duration. None if the
    rise takes longer than that, and where this mean is less than PLATEAU_SHARE of that over the
    whole impact: most of the stopping then lies outside, as when foam bottoms out.
    """
    found = _plateau(record)
    return found if isinstance(found, float) else None


def why_no_plateau(record: Record) -> str | None:
    """Why an impactor that came to rest has no plateau, in words; None if it has one."""
    found = _plateau(record)
    return found if isinstance(found, str) else None


def _plateau(record: Record) -> float | str | None:
    """The plateau; why there is none; or None, if the impactor did not come to rest."""
    found = impact(record)
    if found is None:
        return None
    h = record.history
    t, d = h["time_s"], h["displacement_m"]
    end = found.contact + PLATEAU_END_FRACTION * found.duration
    if is_flat(found.impactor):
        start = found.contact + FLAT_RISE_S
    else:
        depth = found.depth_0 + min(found.impactor.nose_depth, NOSE_RISE_LIMIT_M)
        sinking = slice(0, found.row)  # up to the last row before the stop d only grows
        if d[sinking][-1] < depth:
            return "the nose did not sink in"
        start = float(np.interp(depth, d[sinking], t[sinking]))
    if start >= end:
        return "the impact was over before its initial rise"
    # Each row counts by the part of its interval that lies in the window.
    overlap = np.clip(np.minimum(t[1:], end) - np.maximum(t[:-1], start), 0, None)
    mean = float(overlap @ h["deceleration_m_s2"][1:] / overlap.sum())
    if mean < PLATEAU_SHARE * found.velocity_0 / found.duration:
        return "most of the stopping came in a peak, outside the time in which a plateau is sought"
    return mean


def initial_peak(record: Record) -> tuple[float, float] | None:
    """Initial peak of the smoothed deceleration and its time after contact (m/s2, s).

    The largest within INITIAL_PEAK_WINDOW_S of contact; flat faces only. None where the
    deceleration goes on rising, by more than RISES in as long again, or the whole impact is
    shorter: there is no other peak that this one would be the first of.
    """
    found = impact(record)
    if found is None or not is_flat(found.impactor) or found.duration <= INITIAL_PEAK_WINDOW_S:
        return None
    since = record.history["time_s"] - found.contact
    smooth = record.history["deceleration_smoothed_m_s2"]
    window = (since >= 0) & (since <= INITIAL_PEAK_WINDOW_S)
    after = (since > INITIAL_PEAK_WINDOW_S) & (since <= 2 * INITIAL_PEAK_WINDOW_S)
    if not window.any() or np.isnan(smooth[window]).any():
        return None
    top = int(np.argmax(smooth[window]))
    peak = float(smooth[window][top])
    if (smooth[after] > (1.0 + RISES) * peak).any():
        return None
    return peak, float(since[window][top])


def energy_absorbed(record: Record) -> float | None:
    """Loss of the impactor's kinetic energy from contact to stop (J), Eq. 7; gravity left out.

    Of an impactor that turns only a part: it goes on turning, and sideways.
    """
    found = impact(record)
    if found is None:
        return None
    if not found.impactor.guided:
        time, kinetic = record.history["time_s"], record.history["impactor_kinetic_J"]
        return float(np.interp(found.contact, time, kinetic) - np.interp(found.stop, time, kinetic))
    return 0.5 * found.impactor.mass * found.velocity_0**2


def crushed_volume(record: Record) -> float | None:
    """Volume crushed at the largest displacement (m3), Eqs 4-6; None of an impactor that turns."""
    found = impact(record)
    if found is None or not found.impactor.guided:
        return None
    return float(found.impactor.crushed_volume(found.depth, record.scene.block.depth))


def energy_per_volume(record: Record) -> float | None:
    """Energy absorbed over volume crushed (J/m3), both at the largest displacement.

    The paper's Table 5 gives slopes of Fig. 13, see `energy_volume_slope`.
    """
    energy, volume = energy_absorbed(record), crushed_volume(record)
    return energy / volume if energy is not None and volume else None


def absorption_curve(record: Record) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
    """Volume crushed (m3) and energy absorbed (J) from contact to stop, as in Fig. 13.

    None of an impactor that turns.
    """
    found = impact(record)
    if found is None or not found.impactor.guided:
        return None
    h, impactor = record.history, found.impactor
    during = (h["time_s"] > found.contact) & (h["time_s"] < found.stop)
    depth = np.concatenate([[0.0], h["displacement_m"][during] - found.depth_0, [found.depth]])
    velocity = np.concatenate([[found.velocity_0], h["velocity_m_s"][during], [0.0]])
    volume = impactor.crushed_volume(depth, record.scene.block.depth)
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


def velocity_change(record: Record) -> float | None:
    """What the impact changed of the impactor's velocity, from contact to its rebound (m/s).

    On a shaken base what the pulse changed of its absolute velocity, at most.
    """
    shaken = shaking(record)
    if shaken is not None:
        return None if first_contact(record) is None else shaken.change
    found, rebound = impact(record), rebound_velocity(record)
    return None if found is None or rebound is None else found.velocity_0 + rebound


def restitution(record: Record) -> float | None:
    """Coefficient of restitution: rebound velocity over that at contact."""
    found, rebound = impact(record), rebound_velocity(record)
    if found is None or rebound is None or found.velocity_0 <= 0:
        return None
    return rebound / found.velocity_0


def equivalent_drop_height(record: Record) -> float | None:
    """Height (m) of a free fall under standard gravity that gives the velocity at contact."""
    touch = None if record.scene.is_driven else first_contact(record)
    return touch and touch.velocity_0**2 / (2 * STANDARD_GRAVITY)


def rest_height(record: Record) -> float | None:
    """Height (m) at which the impactor's lowest point would touch the block as it is at the end.

    Crumbs, which hang on no whole bond, are left out. None without an impactor or a snapshot, and
    where nothing is beneath it.
    """
    impactor = record.scene.impactor
    if impactor is None or not record.snapshots:
        return None
    last, block = record.snapshots[-1], record.scene.block
    try:
        return height_beneath(last.position, impactor, hangs_on(last, block))
    except ValueError:
        return None


def max_strain(record: Record) -> float | None:
    """How far the fresh block was compressed at most under the impactor's lowest point, over its
    thickness from the first to the last row of mass points.

    None of a drop that began above the fresh block, over foam that was thrown up.
    """
    depth, scene = max_displacement(record), record.scene
    if depth is None:
        return None
    lost = scene.contact_height - record.contact_height
    if lost < -LIFTED * scene.block.dy:
        return None
    return (lost + depth) / (scene.contact_height - scene.block.foot)


def summary(record: Record) -> dict[str, Any]:
    """The content of summary.json: one entry per measure, units in the names, None for no answer.

    Pieces and the crushed region are those of the last snapshot. `statement` says in words how the
    impact ended, `warnings` what there is to say against the run's figures, `assumed` what of a
    foam of one's own nobody gave.
    """
    scene, run, found = record.scene, record.run, impact(record)
    raw, filtered = peak_deceleration(record), filtered_peak_deceleration(record)
    peak, resultant, turn = initial_peak(record), peak_resultant(record), final_turn(record)
    by_hand, pressed, shaken = balance.of_run(record), largest_stress(record), shaking(record)
    last = record.snapshots[-1] if record.snapshots else None
    region = crushed_region(last, scene) if last else None
    crack = crack_over_time(record.snapshots, scene)
    broken = record.history["broken_bonds"]
    overlap = run.get("max_overlap_m") if scene.impactor is not None else None
    figures = {
        "scene": scene.name,
        "peak_deceleration_cfc180_m_s2": filtered and filtered.deceleration,
        "peak_deceleration_cfc180_g": filtered and filtered.deceleration / STANDARD_GRAVITY,
        "peak_deceleration_cfc180_time_s": filtered and filtered.time,
        "peak_deceleration_m_s2": raw and raw.deceleration,
        "peak_deceleration_g": raw and raw.deceleration / STANDARD_GRAVITY,
        "peak_deceleration_time_s": raw and raw.time,
        "peak_resultant_m_s2": resultant and resultant.deceleration,
        "peak_resultant_g": resultant and resultant.deceleration / STANDARD_GRAVITY,
        "peak_resultant_time_s": resultant and resultant.time,
        "came_to_rest": came_to_rest(record),
        "bottomed_out": bottomed_out(record),
        "passed_through": passed_through(record),
        "impact_duration_s": found and found.duration,
        "max_displacement_m": max_displacement(record),
        "plateau_deceleration_m_s2": plateau(record),
        "initial_peak_m_s2": peak and peak[0],
        "initial_peak_time_s": peak and peak[1],
        "energy_absorbed_J": energy_absorbed(record),
        "crushed_volume_m3": crushed_volume(record),
        "energy_per_volume_J_m3": energy_per_volume(record),
        "energy_volume_slope_J_m3": energy_volume_slope(record),
        "rebound_velocity_m_s": rebound_velocity(record),
        "velocity_change_m_s": velocity_change(record),
        "restitution": restitution(record),
        "base_peak_m_s2": shaken and shaken.base_peak,
        "base_peak_g": shaken and shaken.base_peak / STANDARD_GRAVITY,
        "base_velocity_change_m_s": shaken and shaken.base_change,
        "peak_stress_Pa": pressed and pressed.stress,
        "peak_stress_force_N": pressed and pressed.force,
        "peak_stress_strain": pressed and pressed.strain,
        "equivalent_drop_height_m": equivalent_drop_height(record),
        "drop": record.drop if scene.impactor is not None else None,
        "contact_height_m": record.contact_height if scene.impactor is not None else None,
        "rest_height_m": rest_height(record),
        "max_strain": max_strain(record),
        "static_stress_Pa": by_hand and by_hand.static_stress,
        "balance_strain": by_hand and by_hand.strain,
        "balance_peak_m_s2": by_hand and by_hand.peak,
        "balance_peak_g": by_hand and by_hand.peak and by_hand.peak / STANDARD_GRAVITY,
        "final_angle_rad": turn and turn[0],
        "final_spin_rad_s": turn and turn[1],
        "final_velocity_x_m_s": turn and turn[2],
        "crushed_width_m": region and region.width,
        "crushed_height_m": region and region.height,
        "crushed_layer_m": crushed_layer(last, scene) if last else None,
        "crushed_without_room": without_room(last, scene) if last else None,
        "pieces": pieces(last, scene.block) if last else None,
        "crack_lowest_height_m": crack and crack.lowest_height,
        "crack_start_x_m": crack and crack.start_x,
        "crack_start_height_m": crack and crack.start_height,
        "crack_start_time_s": crack and crack.start_time,
        "broken_bonds": int(broken[-1]) if broken.size else None,
        "energy_residual": energy_residual(record),
        "steps": run.get("steps"),
        "dt_min_s": run.get("dt_min_s"),
        "dt_max_s": run.get("dt_max_s"),
        "dt_stable_min_s": run.get("dt_stable_min_s"),
        "wall_s": run.get("wall_s"),
        "node_stages_per_s": run.get("node_stages_per_s"),
        "max_overlap_cells": (
            None if overlap is None else overlap / min(scene.block.dx, scene.block.dy)
        ),
        "interrupted": record.ending is Ending.INTERRUPTED,
    }
    cushion = by_hand and balance.words(
        scene, by_hand, raw and raw.deceleration, figures["max_strain"]
    )
    words = statement(figures, why_no_plateau(record), cushion)
    return {
        **figures,
        "statement": words,
        "warnings": warnings_of(record),
        "assumed": assumed_of(scene),
    }


def assumed_of(scene: Scene) -> list[str]:
    """What a scene says of a foam of one's own that nobody gave: key, value, and its source."""
    return [
        f"{each.key} = {written(at(scene, each.key))}: {each.why}" for each in scene.assumed or ()
    ]
