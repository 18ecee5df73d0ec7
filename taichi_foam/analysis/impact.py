"""When the impactor touched, when it came to rest, and where else it went.

SI units; displacements and velocities are the impactor's, positive downwards.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from taichi_foam.analysis.body import fell_beside, impactor_now, way_down
from taichi_foam.analysis.presence import bonded
from taichi_foam.records.record import Record
from taichi_foam.scene import Impactor
from taichi_foam.scene.layers import foams_of_bonds
from taichi_foam.scene.motion import width_under

PLATEAUS = 2.0
"""Foam has bottomed out when it pressed on the impactor with so many times what its plateau holds:
twice, since rate and friction raise a plateau that goes on by less."""

CLEAR_CELLS = 2.0
"""An impactor has left the foam when it has gone so many cells down without a touch: in between
touches of mass points, which bounce off it, it goes less."""

# What a free impactor's velocity may change by from row to row without a touch: rounding.
_TOUCH = 1e-9


@dataclass(frozen=True)
class Contact:
    """First contact of the impactor with the foam.

    impactor    the one that touched
    row         first history row that knows of it
    time        s
    depth_0     m, displacement column at contact (a gap, if any, lies before it)
    way_0       m, how far its lowest point had then come down: the same, unless it turns
    velocity_0  m/s at contact
    """

    impactor: Impactor
    row: int
    time: float
    depth_0: float
    way_0: float
    velocity_0: float


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


def first_contact(record: Record) -> Contact | None:
    """First contact: when the impactor's lowest level has used up its gap.

    A nose then touches the foam, though the lattice answers only when the first mass point is under
    it. None without an impactor, and as long as nothing has pressed on it.
    """
    h, impactor = record.history, record.scene.impactor
    if impactor is None:
        return None
    t, d, v = h["time_s"], h["displacement_m"], h["velocity_m_s"]
    way = way_down(record)
    reached = np.flatnonzero(way >= impactor.gap)
    # a light impactor may be gone again when the row is written: its velocity tells
    lost = (h["deceleration_m_s2"] + record.scene.numerics.gravity) * np.diff(t, prepend=t[:1])
    touching = (h["contact_force_N"] != 0) | (lost > _TOUCH * np.abs(v).max(initial=0.0))
    if reached.size == 0 or not touching.any():
        return None
    before = max(int(reached[0]) - 1, 0)
    interval = t[reached[0]] - t[before]
    speed = v[before]
    if not impactor.guided and interval > 0:
        speed = (way[reached[0]] - way[before]) / interval  # of the lowest point
    flight = 0.0  # s, from row `before` to contact, at constant velocity
    if speed > 0:
        flight = float(np.clip((impactor.gap - way[before]) / speed, 0, interval))
    return Contact(
        impactor=impactor,
        row=int(np.argmax(touching)),
        time=float(t[before]) + flight,
        depth_0=float(d[before] + v[before] * flight),
        way_0=float(way[before] + speed * flight),
        velocity_0=float(v[before]),
    )


def impact(record: Record) -> Impact | None:
    """First contact and stop; the velocity is taken as linear between rows.

    None in a driven test: a crosshead does not stop, and on a shaken base a velocity of zero, which
    is relative to the base, ends nothing.
    """
    touch = first_contact(record)
    if touch is None or record.scene.is_driven:
        return None
    h = record.history
    t, d, v = h["time_s"], h["displacement_m"], h["velocity_m_s"]
    stopped = np.flatnonzero((v[1:] <= 0) & (v[:-1] > 0)) + 1
    stopped = stopped[stopped >= touch.row]
    if stopped.size == 0:
        return None
    k = int(stopped[0])
    last = (t[k] - t[k - 1]) * v[k - 1] / (v[k - 1] - v[k])  # s, from row k-1 to the stop
    return Impact(
        impactor=touch.impactor,
        row=k,
        contact=touch.time,
        stop=float(t[k - 1] + last),
        depth_0=touch.depth_0,
        depth=float(d[k - 1] + 0.5 * v[k - 1] * last) - touch.depth_0,
        velocity_0=touch.velocity_0,
    )


def passed_through(record: Record) -> bool | None:
    """Whether the impactor left the foam on its way down, through it or past it, and never stopped.

    It has when its lowest level is below the block, where no support stops it, when it came down
    to the support beside the block, or when it has gone down by CLEAR_CELLS cells without a touch.
    None: it has not touched.
    """
    touch = first_contact(record)
    if touch is None:
        return None
    h, scene = record.history, record.scene
    d, v = h["displacement_m"], h["velocity_m_s"]
    if fell_beside(record):
        return True
    if impact(record) is not None or not v[-1] > 0:
        return False
    way = way_down(record)[-1] - touch.way_0
    if way >= record.contact_height and not scene.base.stops_impactor:
        return True
    touching = np.flatnonzero(h["contact_force_N"] != 0)
    last = int(touching[-1]) if touching.size else touch.row
    return bool(d[-1] - d[last] >= CLEAR_CELLS * scene.block.dy)


def bottomed_out(record: Record) -> bool | None:
    """Whether the foam below the impactor was used up.

    Either the impactor has come down to the support; or the foam of a column of mass points under
    it was crushed, in the mean from top to base, to the strain at which it is used up, and
    has pressed on the impactor with more than PLATEAUS times the plateau's stress over the
    impactor's width. None: it has not touched, or there is no snapshot to tell.
    """
    touch = first_contact(record)
    if touch is None:
        return None
    h, scene = record.history, record.scene
    block, impactor = scene.block, touch.impactor
    way = np.nanmax(way_down(record)) - touch.way_0
    if fell_beside(record):
        return False
    if scene.base.stops_impactor and way >= record.contact_height:
        return True
    if not record.snapshots:
        return None
    width = width_under(impactor, block)
    force = max(
        float(h["contact_force_N"].max()), impactor.mass * float(h["deceleration_m_s2"].max())
    )
    foams, _, rows = foams_of_bonds(scene)
    plateau = max(foams[n].landmarks.plateau_stress for n in np.unique(rows))
    if force < PLATEAUS * plateau * width * block.depth:
        return False
    outline = impactor_now(record.snapshots[-1], scene)
    assert outline is not None  # one that has touched
    outline = outline[:, 0]
    held = bonded(block)[1]
    x = block.positions[:, :-1, 0]
    under = held & (outline.min() - block.dx < x) & (x < outline.max() + block.dx)
    ends = np.array([foam.used_up_strain for foam in foams])[rows]
    # what the foam of a column was crushed by, over what uses it up
    crush = np.where(under, record.snapshots[-1].e_min_b / ends, 0.0).sum(axis=1)
    count = under.sum(axis=1)
    return bool((crush[count > 0] >= count[count > 0]).any())


def is_flat(impactor: Impactor) -> bool:
    """Whether the impactor meets the block with a level face."""
    return impactor.nose_depth <= 1e-6 * impactor.extent
