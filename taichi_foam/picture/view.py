"""Coordinates of a picture: the part of the world that is shown, and its scale."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from taichi_foam.analysis.impact import impactor_now

if TYPE_CHECKING:
    from taichi_foam.laws.shape import Impactor
    from taichi_foam.records.snapshot import Snapshot
    from taichi_foam.scene import Scene

_AROUND = 1.05
"""Size of the region shown around a body that is shown whole, relative to the body's size."""

_FURTHEST = 2.0
"""A body that flies off is followed up to this many times its size away from the block."""


@dataclass(frozen=True)
class Window:
    """The part of the world that a picture shows [m]."""

    x_min: float
    x_max: float
    y_min: float
    y_max: float


@dataclass(frozen=True)
class Box:
    """A rectangle of pixels: columns left <= c < right, rows top <= r < bottom."""

    left: int
    top: int
    right: int
    bottom: int

    @property
    def width(self) -> int:
        return self.right - self.left

    @property
    def height(self) -> int:
        return self.bottom - self.top


@dataclass(frozen=True)
class View:
    """World to pixels: column = x_zero + scale x, row = y_zero - scale y, drawn within `box`."""

    box: Box
    scale: float
    x_zero: float
    y_zero: float


def window(
    scene: Scene, snapshots: Sequence[Snapshot] = (), *, side: float = 0.125, above: float = 0.6
) -> Window:
    """The window of a run, the same for all of its frames.

    Contains the block in its initial state, a margin of `side` times its width on each side, a
    strip of floor (or the part of a support with an outline down to half the block's height), and
    `above` times its height for the impactor (a seventh of that without an impactor). A tilted or
    rotating impactor is contained whole, at its start and in each of `snapshots`.
    """
    block, impactor = scene.block, scene.impactor
    base = np.array([0.0, block.foot])
    (left, low), (right, high) = np.min(block.corners, axis=0), np.max(block.corners, axis=0)
    reference = np.array([[left, low], [right, low], [right, high], [left, high]])
    start = base + (reference - base) @ np.array(scene.start.deformation_gradient).T
    (x_min, y_min), (x_max, y_max) = start.min(axis=0), start.max(axis=0)
    margin = side * (x_max - x_min)
    if impactor is not None:
        # A platen is shown up to its ends; a much wider one is cut.
        ends = impactor.x + _AROUND * impactor.outline()[:, 0]
        span = x_max - x_min
        x_min, x_max = (
            min(x_min, max(ends.min() + margin, x_min - span / 2)),
            max(x_max, min(ends.max() - margin, x_max + span / 2)),
        )
    tall = y_max - y_min
    support = scene.support.outline_under(block)
    if support is not None:
        y_min = max(min(y_min, support[:, 1].min()), y_min - tall / 2)
    top = above if impactor is not None else above / 7
    shown = Window(
        float(x_min - margin),
        float(x_max + margin),
        float(min(y_min, 0.0) - max(0.07 * tall, 0.03 * (x_max - x_min))),
        float(y_max + top * tall),
    )
    if impactor is not None and scene.is_tilted:
        return _with_whole(shown, impactor, scene, snapshots)
    return shown


def _with_whole(
    shown: Window, impactor: Impactor, scene: Scene, snapshots: Sequence[Snapshot]
) -> Window:
    """A window that also contains a body, at its start and at all instants.

    A rotating body is contained at any angle. Gaps and flights are limited by the body's size.
    """
    size = 2 * impactor.reach
    start = impactor.outline_at(scene.contact_height + min(impactor.gap, size))
    points = [start]
    if not impactor.guided:
        centre = impactor.centre_of_mass + start[0] - impactor.outline()[0]
        points.append(centre + impactor.reach * np.array([[-1.0, -1.0], [1.0, 1.0]]))
    points += [body for each in snapshots if (body := impactor_now(each, scene)) is not None]
    left, low = np.concatenate(points).min(axis=0)
    right, high = np.concatenate(points).max(axis=0)
    room, most = (_AROUND - 1) * size, _FURTHEST * size
    if not snapshots:  # it is unknown how far down it will turn
        low = shown.y_min + room
    return Window(
        float(max(min(shown.x_min, left - room), shown.x_min - most)),
        float(min(max(shown.x_max, right + room), shown.x_max + most)),
        float(max(min(shown.y_min, low - room), shown.y_min - most)),
        float(min(max(shown.y_max, high + room), shown.y_max + most)),
    )


def fit(world: Window, box: Box) -> View:
    """Show all of `world` in `box`, as large as possible, centred, at the bottom of the box."""
    scale = min(box.width / (world.x_max - world.x_min), box.height / (world.y_max - world.y_min))
    x_middle = (world.x_min + world.x_max) / 2
    return View(
        box,
        scale,
        (box.left + box.right) / 2 - scale * x_middle,
        box.bottom + scale * world.y_min,
    )
