"""Motion: an impactor that falls, a crosshead at constant speed, a base that is shaken.

An impactor with a drop height h starts at its gap with the velocity that it has there, and gravity
acts on everything, so that it hits the foam at sqrt(2 g h). A crosshead's travel and speed give the
end of the run. Such values do not count as given (`Part.with_computed`).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from taichi_foam.laws.shape import Impactor
from taichi_foam.scene.block import Block
from taichi_foam.scene.options import LONGEST_RUN, Base, Numerics
from taichi_foam.units import STANDARD_GRAVITY, plain

Array = NDArray[np.float64]

_SAME = 1e-9
"""Values with a smaller relative difference are equal: a stored scene contains both, rounded."""


def start_velocity(drop_height: float, gap: float, gravity: float) -> float | None:
    """Velocity [m/s] at `gap` above the end of a fall of `drop_height` [m]; None: impossible."""
    if gravity <= 0.0 or gap > drop_height:
        return None
    return math.sqrt(2.0 * gravity * (drop_height - gap))


def followed(impactor: Impactor, numerics: Numerics) -> tuple[Impactor, Numerics]:
    """Both parts, with the velocity, gravity and end that follow from a drop height or a travel.

    Given values are kept, even if they contradict.
    """
    if impactor.drop_height is not None:
        if "gravity" not in numerics.model_fields_set:
            numerics = numerics.with_computed(gravity=STANDARD_GRAVITY)
        velocity = start_velocity(impactor.drop_height, impactor.gap, numerics.gravity)
        if velocity is not None and "velocity" not in impactor.model_fields_set:
            impactor = impactor.with_computed(velocity=velocity)
    ends = impactor.motion == "crosshead" and "end" not in numerics.model_fields_set
    if ends and impactor.travel is not None and impactor.velocity > 0.0:
        numerics = numerics.with_computed(end=impactor.travel / impactor.velocity)
    return impactor, numerics


def problems_of_driving(impactor: Impactor | None, base: Base, numerics: Numerics) -> list[str]:
    """Why a crosshead or a shaken base cannot be driven as the scene says."""
    shaken = base.shaking is not None
    found = []
    if shaken and numerics.end == "rebound":
        found.append(
            f"{_pulse(base)}: on a shaken base, things may rebound at any time; set numerics.end "
            "to a time in seconds, several times the length of the pulse"
        )
    if impactor is None:
        return found
    if impactor.motion != "crosshead":
        if impactor.travel is not None:
            found.append(
                f"impactor.travel = {impactor.travel:g}: is for a crosshead only; set "
                "impactor.motion = 'crosshead', or leave it out"
            )
        return found
    if not impactor.guided:
        found.append("impactor.guided = false: a crosshead moves straight down; leave it out")
    if impactor.drop_height is not None:
        found.append(
            f"impactor.drop_height = {impactor.drop_height:g}: a crosshead does not fall; give "
            "impactor.velocity"
        )
    if shaken:
        found.append(
            f"{_pulse(base)}: a crosshead and a shaken base cannot be combined; leave one of them "
            "out"
        )
    if impactor.velocity == 0:
        found.append("impactor.velocity = 0: must be above 0 m/s, because a crosshead moves")
    elif numerics.end == "rebound":
        found.append(
            "numerics.end = 'rebound': a crosshead does not rebound; give impactor.travel, the "
            "distance after which the run ends, or numerics.end in seconds"
        )
    elif impactor.travel is not None:
        expected = impactor.travel / impactor.velocity
        if expected > LONGEST_RUN:
            found.append(
                f"impactor.travel = {impactor.travel:g}: takes {expected:.4g} s at "
                f"{impactor.velocity:g} m/s; a run has at most {LONGEST_RUN:g} s; lengths are in "
                "metres; shorten the travel, or use a faster crosshead"
            )
        elif abs(float(numerics.end) - expected) > _SAME * expected:
            found.append(
                f"numerics.end = {numerics.end:g}: impactor.travel = {impactor.travel:g} m at "
                f"{impactor.velocity:g} m/s takes {expected:.4g} s; give one of the two"
            )
    return found


def _pulse(base: Base) -> str:
    """The key by which a base is shaken, as messages show it."""
    return "base.acceleration" if base.pulse is None else f"base.pulse = '{base.pulse}'"


def problems_of_fall(
    impactor: Impactor, block: Block, gravity: float, plateau_stress: float
) -> list[str]:
    """Why an impactor's drop height contradicts the rest of the scene.

    An impactor whose weight alone crushes the cushion is taken for a mistake.
    """
    height, velocity, gap = impactor.drop_height, impactor.velocity, impactor.gap
    if height is None:
        return []
    if gravity == 0.0:
        return [
            f"impactor.drop_height = {height:g}: nothing falls without gravity; numerics.gravity "
            f"must be above 0 m/s2; leave it out to use {STANDARD_GRAVITY:g} m/s2"
        ]
    expected = start_velocity(height, gap, gravity)
    if expected is None:
        return [
            f"impactor.gap = {gap:g}: must be at most impactor.drop_height = {height:g} m, of "
            "which it is the last part; lengths are in metres"
        ]
    if abs(velocity - expected) > _SAME * max(velocity, expected):
        return [
            f"impactor.velocity = {velocity:g}: impactor.drop_height = {height:g} m gives "
            f"{expected:.4g} m/s; give one of the two"
        ]
    area, weight = area_under(impactor, block), impactor.mass * gravity
    if weight <= plateau_stress * area or area == 0.0:
        return []
    return [
        f"impactor.mass = {impactor.mass:g}: its weight alone presses the foam under it with "
        f"{plain(1e-3 * weight / area)} kPa, but the plateau stress is "
        f"{plain(1e-3 * plateau_stress)} kPa: it crushes the cushion just by standing on it; "
        "masses are in kilograms (5,000 g is 5); use a lighter impactor or more foam, or give "
        "impactor.velocity instead of impactor.drop_height"
    ]


def area_under(impactor: Impactor, block: Block) -> float:
    """Area of the block under the impactor at the start, from end to end of its outline [m2]."""
    foam, (left, right) = np.array(block.corners)[:, 0], ends_of(impactor)
    width = float(max(min(foam.max(), right) - max(foam.min(), left), 0.0))
    return width * block.depth


def in_middle_half(impactor: Impactor, x: Array, slack: float = 0.0) -> NDArray[np.bool_]:
    """Whether places x [m] lie in the middle half of the impactor's width at the start."""
    left, right = ends_of(impactor)
    return np.abs(x - (left + right) / 2) <= (right - left) / 4 + slack


def ends_of(impactor: Impactor) -> tuple[float, float]:
    """The leftmost and rightmost x of an impactor at the start [m]."""
    x = impactor.x + impactor.outline()[:, 0]
    return float(x.min()), float(x.max())
