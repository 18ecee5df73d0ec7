"""A fall in place of a velocity: what `impactor.drop_height` says of the rest of a scene.

An impactor that falls so far starts at its gap with the velocity that it has there, and gravity
acts on everything, so that it meets the foam with sqrt(2 g h).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from taichi_foam.laws.shape import Impactor
from taichi_foam.parts import Part, is_number
from taichi_foam.scene.block import Block
from taichi_foam.units import STANDARD_GRAVITY, plain

_SAME = 1e-9
"""Velocities that differ by less, relative, are one: a scene that was written holds both."""


def start_velocity(drop_height: float, gap: float, gravity: float) -> float | None:
    """Velocity [m/s] that a fall of `drop_height` has `gap` before its end [m]; None: never."""
    if gravity <= 0.0 or gap > drop_height:
        return None
    return math.sqrt(2.0 * gravity * (drop_height - gap))


def completed(data: Any) -> Any:
    """Raw data of a scene with the velocity and the gravity that a drop height stands for.

    What is given stays, right or wrong; so does data that is no scene's.
    """
    if not isinstance(data, Mapping):
        return data
    impactor, numerics = data.get("impactor"), data.get("numerics")
    height = _given(impactor, "drop_height")
    gravity = _given(numerics, "gravity")
    gravity = STANDARD_GRAVITY if gravity is None else gravity
    gap = _given(impactor, "gap")
    gap = 0.0 if gap is None else gap
    if not all(is_number(value) for value in (height, gravity, gap)):
        return data
    found = {**data, "numerics": _with(numerics, "gravity", gravity)}
    velocity = start_velocity(height, gap, gravity)
    if velocity is not None and _given(impactor, "velocity") is None:
        found["impactor"] = _with(impactor, "velocity", velocity)
    return found


def settle(data: dict[str, Any], values: Mapping[str, Any]) -> None:
    """Nested data of a scene whose `values` have just been changed: what these take with them.

    A new velocity does away with a drop height, and all else about a fall gives a new velocity.
    """
    impactor, numerics = data.get("impactor"), data.get("numerics")
    if not isinstance(impactor, dict) or impactor.get("drop_height") is None:
        return
    if "impactor" in values:
        pass  # as it was given
    elif "impactor.velocity" not in values:
        impactor.pop("velocity", None)
    elif "impactor.drop_height" not in values:
        del impactor["drop_height"]
        return
    stays = {"numerics", "numerics.gravity"} & values.keys()
    if isinstance(numerics, dict) and numerics.get("gravity") == 0.0 and not stays:
        del numerics["gravity"]


def problems(drop_height: float, velocity: float, gap: float, gravity: float) -> list[str]:
    """Why an impactor cannot both fall so far and be what else the scene says."""
    if gravity == 0.0:
        return [
            f"impactor.drop_height = {drop_height:g}: nothing falls without gravity; "
            "numerics.gravity must be above 0 m/s2, or leave it out: then it is "
            f"{STANDARD_GRAVITY:g} m/s2"
        ]
    expected = start_velocity(drop_height, gap, gravity)
    if expected is None:
        return [
            f"impactor.gap = {gap:g}: must be at most impactor.drop_height = {drop_height:g} m, of "
            "which it is the last part; lengths are in metres"
        ]
    if abs(velocity - expected) > _SAME * max(velocity, expected):
        return [
            f"impactor.velocity = {velocity:g}: impactor.drop_height = {drop_height:g} m comes to "
            f"{expected:.4g} m/s; give one of the two"
        ]
    return []


def problems_of_weight(
    impactor: Impactor, block: Block, gravity: float, plateau_stress: float
) -> list[str]:
    """Why nobody can mean a mass that falls on a cushion: foam that it crushes as it stands."""
    area = width_under(impactor, block) * block.depth
    weight = impactor.mass * gravity
    if weight <= plateau_stress * area or area == 0.0:
        return []
    return [
        f"impactor.mass = {impactor.mass:g}: its weight alone presses the foam under it with "
        f"{plain(1e-3 * weight / area)} kPa, and the plateau is {plain(1e-3 * plateau_stress)} "
        "kPa: it crushes the cushion that it only stands on; masses are in kilograms (5,000 g is "
        "5); take a lighter impactor or more foam, or give impactor.velocity in place of "
        "impactor.drop_height"
    ]


def width_under(impactor: Impactor, block: Block) -> float:
    """Width of the block, as it is drawn, that lies under an impactor as it starts [m]."""
    foam = np.array(block.corners)[:, 0]
    ends = impactor.x + impactor.outline()[:, 0]
    return float(max(min(foam.max(), ends.max()) - max(foam.min(), ends.min()), 0.0))


def _given(part: Any, key: str) -> Any:
    """What a part, or its raw data, was given for a key; None if nothing."""
    if isinstance(part, Part):
        return getattr(part, key) if key in part.model_fields_set else None
    return part.get(key) if isinstance(part, Mapping) else None


def _with(part: Any, key: str, value: float) -> Any:
    if isinstance(part, Part):
        return part.model_copy(update={key: value})
    return {**(part or {}), key: value}
