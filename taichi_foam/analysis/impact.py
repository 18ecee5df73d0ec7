"""Position and contact of the impactor: when it touched, stopped, bottomed out or passed through.

SI units; displacements and velocities are the impactor's, positive downwards.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from taichi_foam.analysis.cell_state import bonded
from taichi_foam.analysis.columns import intervals
from taichi_foam.laws.shape.outline import convex_hull, lower_chain
from taichi_foam.records.cushion import Cushion
from taichi_foam.records.record import Record
from taichi_foam.records.snapshot import Snapshot
from taichi_foam.scene import Block, Impactor, Scene
from taichi_foam.scene.filling import filling, reaches
from taichi_foam.scene.layers import foams_of_bonds
from taichi_foam.scene.motion import area_under

Array = NDArray[np.float64]

PLATEAUS = 2.0
"""Foam has bottomed out when it pressed on the impactor with this many times its plateau stress:
twice, since rate effects and friction raise an ongoing plateau by less."""

CLEAR_CELLS = 2.0
"""An impactor has left the foam when it has moved this many cells down without contact: between
contacts with mass points that bounce off it, it moves less."""

LIFTED = 1e-3
"""An impactor that starts more than this above a fresh block, in cells, is over thrown-up foam."""

# Velocity change of a free impactor from row to row that is rounding, not contact.
_TOUCH = 1e-9


def impactor_now(snapshot: Snapshot, scene: Scene) -> Array | None:
    """Vertices (n, 2) of the impactor's outline at an instant [m]; None without one."""
    if scene.impactor is None or np.isnan(snapshot.impactor_y):
        return None
    return scene.impactor.outline_at(
        snapshot.impactor_y, snapshot.impactor_shift, snapshot.impactor_angle
    )


def way_down(record: Record) -> Array:
    """How far the impactor's lowest point has come down since the start, at each row (n,) [m].

    The lowest point is a different one when the impactor has rotated.
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
    """Whether a rotating impactor came down beside the block, to the level of its bottom."""
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


def contact_height(block: Block, impactor: Impactor, cushion: Cushion) -> float:
    """Height [m] of the impactor's lowest point at first contact with a block that a run has left.

    Raises ValueError: there is no foam beneath it.
    """
    filled = filling(block)
    left = reaches(filled, cushion.worst_a, cushion.worst_b)
    return height_beneath(cushion.position, impactor, left, filled.there)


def height_beneath(
    position: Array, impactor: Impactor, reaches: Array, there: NDArray[np.bool_]
) -> float:
    """Height [m] of the impactor's lowest point when, moving down, it first touches the foam.

    Args:
        position: (I, J, 2) of the mass points [m].
        impactor: the impactor in its initial orientation; only its downward side counts.
        reaches: (I, J) how far foam reaches beyond them [m], see `filling.reaches`.
        there: (I, J) which mass points count.

    Raises ValueError: there is no foam beneath it.
    """
    chain = lower_chain(impactor.outline())
    x, y = position[there].T - [[impactor.x], [0.0]]
    reach = reaches[there]
    beneath = (chain[0, 0] - reach < x) & (x < chain[-1, 0] + reach)
    if not beneath.any():
        raise ValueError("no foam is beneath the impactor")
    x, y, reach = x[beneath], y[beneath], reach[beneath]
    # a disc that reaches less far than its point is touched a little later than this
    heights = [y - np.interp(x, chain[:, 0], chain[:, 1]) + np.minimum(reach, 0.0)]
    disc = np.flatnonzero(reach > 0.0)
    x, y, reach = x[disc], y[disc], reach[disc]
    for corner_x, corner_y in chain:
        over = reach**2 - (x - corner_x) ** 2
        heights.append((y + np.sqrt(np.maximum(over, 0.0)) - corner_y)[over > 0.0])
    for start, end in pairwise(chain):
        along, up = (end - start) / np.hypot(*(end - start))
        touched = x - up * reach  # where the disc touches the face
        under = (start[0] <= touched) & (touched <= end[0])
        if along > 0.0:
            heights.append(((y - start[1]) - (up * (x - start[0]) - reach) / along)[under])
    return float(max(each.max(initial=-np.inf) for each in heights))


@dataclass(frozen=True)
class Contact:
    """First contact of the impactor with the foam.

    impactor    the impactor
    row         first history row after contact
    contact     s, time of contact
    depth_0     m, value of the displacement column at contact (includes a gap, if any)
    way_0       m, how far its lowest point had then moved down: the same, unless it rotates
    velocity_0  m/s, velocity at contact
    """

    impactor: Impactor
    row: int
    contact: float
    depth_0: float
    way_0: float
    velocity_0: float


@dataclass(frozen=True)
class Impact(Contact):
    """First contact, and when the impactor came to rest.

    stop_row    first history row after the stop
    stop        s, first zero of the velocity
    depth       m, displacement from contact to stop
    """

    stop_row: int
    stop: float
    depth: float

    @property
    def duration(self) -> float:
        """Impact duration (s), from first contact to zero velocity (paper, section 3.1)."""
        return self.stop - self.contact


def first_contact(record: Record) -> Contact | None:
    """First contact: when the impactor's lowest point has closed its gap.

    A nose then touches the foam, though the lattice responds only once a mass point is under it.
    None without an impactor, and as long as nothing has pressed on it.
    """
    h, impactor = record.history, record.scene.impactor
    if impactor is None:
        return None
    t, d, v = h["time_s"], h["displacement_m"], h["velocity_m_s"]
    way = way_down(record)
    reached = np.flatnonzero(way >= impactor.gap)
    # a light impactor may have left again when the row is written: check its velocity, too
    lost = (h["deceleration_m_s2"] + record.scene.numerics.gravity) * intervals(t)
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
        contact=float(t[before]) + flight,
        depth_0=float(d[before] + v[before] * flight),
        way_0=float(way[before] + speed * flight),
        velocity_0=float(v[before]),
    )


def impact(record: Record) -> Impact | None:
    """First contact and stop; the velocity is taken as linear between rows.

    None in a driven test: a crosshead does not stop, and on a shaken base a zero velocity, which is
    relative to the base, is not the end of the impact.
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
        **vars(touch),
        stop_row=k,
        stop=float(t[k - 1] + last),
        depth=float(d[k - 1] + 0.5 * v[k - 1] * last) - touch.depth_0,
    )


def passed_through(record: Record) -> bool | None:
    """Whether the impactor left the foam moving down, through it or past it, and never stopped.

    It has if its lowest point is below the block without a support to stop it, if it came down to
    the support beside the block, or if it has moved down by CLEAR_CELLS cells without contact.
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

    Either the impactor has come down to the support; or a column of mass points under it was
    crushed, on average from top to base, to the strain at which the foam is used up, and the foam
    pressed on the impactor with more than PLATEAUS times the plateau stress over the impactor's
    width. None: it has not touched, or there is no snapshot.
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
    force = max(
        float(h["contact_force_N"].max()), impactor.mass * float(h["deceleration_m_s2"].max())
    )
    foams, _, rows = foams_of_bonds(scene)
    plateau = max(foams[n].landmarks.plateau_stress for n in np.unique(rows))
    if force < PLATEAUS * plateau * area_under(impactor, block):
        return False
    outline = impactor_now(record.snapshots[-1], scene)
    assert outline is not None  # there is an impactor: it has touched
    outline = outline[:, 0]
    held = bonded(block)[1]
    x = block.positions[:, :-1, 0]
    under = held & (outline.min() - block.dx < x) & (x < outline.max() + block.dx)
    ends = np.array([foam.used_up_strain for foam in foams])[rows]
    # compressive strain of the foam in a column, over the strain that uses it up
    crush = np.where(under, record.snapshots[-1].e_min_b / ends, 0.0).sum(axis=1)
    count = under.sum(axis=1)
    return bool((crush[count > 0] >= count[count > 0]).any())


def is_flat(impactor: Impactor) -> bool:
    """Whether the impactor meets the block with a level face."""
    return impactor.nose_depth <= 1e-6 * impactor.extent
