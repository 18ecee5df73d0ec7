"""Loads on the impactor, from the history of a run: decelerations, energies, stresses.

The figures of the paper (Tables 2-5, Eqs 4-7), and those of driven tests: with a crosshead, which
presses the foam, or with a pulse of the base, which shakes it.

Every function takes a finished `Record` and returns None if the figure is undefined: no impactor,
no contact, a run that ended before the impactor came to rest, or a driven test, which has no
impact. SI units throughout; displacements, velocities and decelerations are the impactor's,
positive downwards (decelerations: upwards), and count from first contact.
"""

from __future__ import annotations

from math import copysign
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from taichi_foam.analysis.cell_state import hangs_on
from taichi_foam.analysis.columns import intervals, mean_rates
from taichi_foam.analysis.impact import (
    LIFTED,
    first_contact,
    height_beneath,
    impact,
    is_flat,
)
from taichi_foam.records.record import Record
from taichi_foam.scene import Impactor
from taichi_foam.scene.filling import filling, reaches
from taichi_foam.scene.motion import area_under
from taichi_foam.units import STANDARD_GRAVITY

Array = NDArray[np.float64]

FLAT_RISE_S = 3e-3
"""The initial rise of a flat face ends this long after contact ..."""

NOSE_RISE_LIMIT_M = 0.025
"""... and that of a nose when it is fully immersed, or this deep if it is longer (paper value)."""

PLATEAU_END_FRACTION = 0.85
"""The plateau ends at this share of the impact duration, before the final decay."""

PLATEAU_SHARE = 0.5
"""There is no plateau if its mean is below this share of the mean deceleration over the whole
impact (here: half; in the paper's nine tests it is 1.0 to 1.2)."""

INITIAL_PEAK_WINDOW_S = 5e-3
"""A flat face's initial peak lies within this time of contact (measured: 1.8 to 2.9 ms)."""

RISES = 0.25
"""Largest relative rise above the initial peak if a deceleration oscillates about a plateau."""


def max_displacement(record: Record) -> float | None:
    """The largest displacement (m), defined for every impactor that has touched.

    It is the displacement at zero velocity (exact for a constant deceleration). If the impactor
    did not come to rest, it is the largest until the run ended.
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


class Peak(NamedTuple):
    """The largest deceleration [m/s2], and its time after contact [s]."""

    deceleration: float
    time: float


def peak_deceleration(record: Record) -> Peak | None:
    """The largest raw deceleration since contact, timed at the middle of its row's interval.

    Raw values are means over a row's interval, `output.history_interval`. None for a crosshead.
    """
    return _largest(record, record.history["deceleration_m_s2"], is_raw=True)


def filtered_peak_deceleration(record: Record) -> Peak | None:
    """The largest deceleration since contact, smoothed with `records.history.FILTER`."""
    return _largest(record, record.history["deceleration_smoothed_m_s2"], is_raw=False)


def peak_resultant(record: Record) -> Peak | None:
    """The largest acceleration since contact of the centre of mass of a rotating impactor.

    The resultant of both directions, without gravity; raw, as `peak_deceleration`. None on rails.
    """
    impactor, history = record.scene.impactor, record.history
    if impactor is None or impactor.guided:
        return None
    sideways = mean_rates(history["time_s"], history["velocity_x_m_s"])
    return _largest(record, np.hypot(history["deceleration_m_s2"], sideways), is_raw=True)


def _largest(record: Record, deceleration: Array, is_raw: bool) -> Peak | None:
    """The largest in rows that end after contact; None for a crosshead, which never slows down."""
    touch, end = first_contact(record), record.history["time_s"]
    if touch is None or not record.scene.is_slowed:
        return None
    since = (end >= touch.contact) & np.isfinite(deceleration)
    if not since.any():
        return None
    top = int(np.argmax(np.where(since, deceleration, -np.inf)))
    at = end - 0.5 * intervals(end) if is_raw else end
    return Peak(float(deceleration[top]), max(float(at[top]) - touch.contact, 0.0))


def rise_depth(impactor: Impactor) -> float:
    """Displacement from contact at which the initial rise is over [m]; 0 for a flat face."""
    return min(impactor.nose_depth, NOSE_RISE_LIMIT_M)


def plateau(record: Record) -> float | None:
    """Time average of the raw deceleration over the plateau (m/s2).

    The plateau lasts from the end of the initial rise (FLAT_RISE_S after contact for a flat face,
    else when the nose is immersed: NOSE_RISE_LIMIT_M) to PLATEAU_END_FRACTION of the impact
    duration. None if the rise takes longer than that, or if this average is less than
    PLATEAU_SHARE of that over the whole impact: most of the stopping then occurs outside the
    plateau, as when foam bottoms out.
    """
    found = _plateau(record)
    return found if isinstance(found, float) else None


def why_no_plateau(record: Record) -> str | None:
    """Why an impactor that came to rest has no plateau, in words; None if it has one."""
    found = _plateau(record)
    return found if isinstance(found, str) else None


def _plateau(record: Record) -> float | str | None:
    """The plateau; or the reason why there is none; or None if the impactor did not stop."""
    found = impact(record)
    if found is None:
        return None
    h = record.history
    t, d = h["time_s"], h["displacement_m"]
    end = found.contact + PLATEAU_END_FRACTION * found.duration
    if is_flat(found.impactor):
        start = found.contact + FLAT_RISE_S
    else:
        depth = found.depth_0 + rise_depth(found.impactor)
        sinking = slice(0, found.stop_row)  # d increases up to the last row before the stop
        if d[sinking][-1] < depth:
            return "the nose did not sink in deep enough"
        start = float(np.interp(depth, d[sinking], t[sinking]))
    if start >= end:
        return "the impact was over before its initial rise"
    # Each row is weighted by the part of its interval that lies in the window.
    overlap = np.clip(np.minimum(t[1:], end) - np.maximum(t[:-1], start), 0, None)
    mean = float(overlap @ h["deceleration_m_s2"][1:] / overlap.sum())
    if mean < PLATEAU_SHARE * found.velocity_0 / found.duration:
        return (
            "most of the velocity was lost in a peak outside the window in which a plateau is "
            "sought"
        )
    return mean


def initial_peak(record: Record) -> Peak | None:
    """Initial peak of the smoothed deceleration.

    The largest value within INITIAL_PEAK_WINDOW_S of contact; flat faces only. None if the
    deceleration keeps rising, by more than RISES in an equal time after that, or if the whole
    impact is shorter: the peak is then not an initial one.
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
    return Peak(peak, float(since[window][top]))


def energy_absorbed(record: Record) -> float | None:
    """Loss of the impactor's kinetic energy from contact to stop (J), Eq. 7, without gravity.

    A rotating impactor loses only part of it: it keeps rotating and moving sideways.
    """
    found = impact(record)
    if found is None:
        return None
    if not found.impactor.guided:
        time, kinetic = record.history["time_s"], record.history["impactor_kinetic_J"]
        return float(np.interp(found.contact, time, kinetic) - np.interp(found.stop, time, kinetic))
    return 0.5 * found.impactor.mass * found.velocity_0**2


def crushed_volume(record: Record) -> float | None:
    """Volume crushed at the largest displacement (m3), Eqs 4-6; None for a rotating impactor."""
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


def absorption_curve(record: Record) -> tuple[Array, Array] | None:
    """Volume crushed (m3) and energy absorbed (J) from contact to stop, as in Fig. 13.

    None for a rotating impactor.
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
    return float(-record.history["velocity_m_s"][found.stop_row :].min()) if found else None


def velocity_change(record: Record) -> float | None:
    """Velocity change of the impactor from contact to its rebound (m/s).

    On a shaken base, the largest change of its absolute velocity due to the pulse.
    """
    shaken = shaking(record)
    if shaken is not None:
        return None if first_contact(record) is None else shaken.change
    found, rebound = impact(record), rebound_velocity(record)
    return None if found is None or rebound is None else found.velocity_0 + rebound


def restitution(record: Record) -> float | None:
    """Coefficient of restitution: rebound velocity over velocity at contact."""
    found, rebound = impact(record), rebound_velocity(record)
    if found is None or rebound is None or found.velocity_0 <= 0:
        return None
    return rebound / found.velocity_0


def equivalent_drop_height(record: Record) -> float | None:
    """Height (m) of a free fall under standard gravity that gives the velocity at contact."""
    touch = None if record.scene.is_driven else first_contact(record)
    return touch and touch.velocity_0**2 / (2 * STANDARD_GRAVITY)


def rest_height(record: Record) -> float | None:
    """Height (m) at which the impactor's lowest point would touch the block in its final state.

    Mass points without an unbroken bond are left out. None without an impactor or a snapshot, or if
    nothing is beneath the impactor.
    """
    impactor = record.scene.impactor
    if impactor is None or not record.snapshots:
        return None
    last, block = record.snapshots[-1], record.scene.block
    try:
        left = reaches(filling(block), last.e_min_a, last.e_min_b)
        return height_beneath(last.position, impactor, left, hangs_on(last, block))
    except ValueError:
        return None


def max_strain(record: Record) -> float | None:
    """Largest compression of the fresh block under the impactor's lowest point, over its thickness.

    None for a drop that began above the fresh block, over thrown-up foam.
    """
    depth, scene = max_displacement(record), record.scene
    if depth is None:
        return None
    if record.lifted > LIFTED * scene.block.dy:
        return None
    return (depth - record.lifted) / scene.thickness


# --- driven tests -------------------------------------------------------------------------------


class Shaking(NamedTuple):
    """A pulse of the base, and its effect.

    base_peak     m/s2, the largest acceleration of the base, with its sign, upwards positive
    base_change   m/s, largest velocity change of the base, in the direction of that peak
    change        m/s, the same for the product; None without one
    """

    base_peak: float
    base_change: float
    change: float | None


def shaking(record: Record) -> Shaking | None:
    """The shaking in a run, until its end; None for a fixed base, and before the first row."""
    pulse, history = record.scene.base.shaking, record.history
    if pulse is None or not history["time_s"].size:
        return None
    base = pulse.velocity(history["time_s"])
    product = base - history["velocity_m_s"]
    sign = copysign(1.0, pulse.peak)
    change = None
    if record.scene.impactor is not None:
        change = float((sign * (product - product[0])).max())
    return Shaking(pulse.peak, float((sign * base).max()), change)


class Top(NamedTuple):
    """The largest force [N] of a crosshead, its nominal stress [Pa], and the strain there."""

    force: float
    stress: float
    strain: float


def compression_curve(record: Record) -> tuple[Array, Array] | None:
    """Strain and stress [Pa] of a crosshead test, compression positive, from first contact on.

    Nominal values: the face's displacement over the block's thickness, from its first row of mass
    points to the height of first contact, and its force over the area of the block under it. None
    without a crosshead.
    """
    scene, history = record.scene, record.history
    impactor, block = scene.impactor, scene.block
    if impactor is None or impactor.motion != "crosshead":
        return None
    way = history["displacement_m"] - impactor.gap
    strain = way / (record.contact_height - block.foot)
    stress = history["contact_force_N"] / area_under(impactor, block)
    touched = strain >= 0.0
    return strain[touched], stress[touched]


def largest_stress(record: Record) -> Top | None:
    """Where a crosshead's stress is largest; None without one, or before it has touched."""
    curve, scene = compression_curve(record), record.scene
    if curve is None or not curve[1].any():
        return None
    assert scene.impactor is not None
    strain, stress = curve
    top = int(np.argmax(stress))
    area = area_under(scene.impactor, scene.block)
    return Top(float(stress[top]) * area, float(stress[top]), float(strain[top]))
