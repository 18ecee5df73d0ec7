"""What moves by command: a crosshead at constant speed, a base that is shaken."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from taichi_foam.laws.shape import Impactor
from taichi_foam.parts import Part
from taichi_foam.scene.options import Base, Numerics

_SAME = 1e-9
"""Times that differ by less, relative, are one: a scene that was written holds both."""


def completed(data: Any) -> Any:
    """Raw data of a scene with the end that a crosshead's travel stands for, if none is given."""
    if not isinstance(data, Mapping):
        return data
    impactor, numerics = data.get("impactor"), data.get("numerics")
    travel, speed = _given(impactor, "travel"), _given(impactor, "velocity")
    if _given(impactor, "motion") != "crosshead":
        return data  # what is wrong with it is said where it is checked
    if not (_is_positive(travel) and _is_positive(speed)) or _given(numerics, "end") is not None:
        return data
    if isinstance(numerics, Part):
        return {**data, "numerics": numerics.model_copy(update={"end": travel / speed})}
    if numerics is None or isinstance(numerics, Mapping):
        return {**data, "numerics": {**(numerics or {}), "end": travel / speed}}
    return data


def settle(data: dict[str, Any], values: Mapping[str, Any]) -> None:
    """A changed speed or travel of a crosshead gives a new end, unless that is given too."""
    impactor, numerics = data.get("impactor"), data.get("numerics")
    if not isinstance(impactor, dict) or impactor.get("travel") is None:
        return
    if {"numerics", "numerics.end"} & values.keys() or not isinstance(numerics, dict):
        return
    if {"impactor", "impactor.velocity", "impactor.travel"} & values.keys():
        numerics.pop("end", None)


def problems(impactor: Impactor | None, base: Base, numerics: Numerics) -> list[str]:
    """Why something cannot be driven so."""
    shaken = base.shaking is not None
    found = []
    if shaken and numerics.end == "rebound":
        found.append(
            f"{_pulse(base)}: a base that is shaken makes things rebound at any time; give "
            "numerics.end a time in seconds, some times as long as the pulse"
        )
    if impactor is None:
        return found
    if impactor.motion != "crosshead":
        if impactor.travel is not None:
            found.append(
                f"impactor.travel = {impactor.travel:g}: is a crosshead's; set impactor.motion = "
                "'crosshead', or leave it out"
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
            f"{_pulse(base)}: a crosshead and a shaken base are two tests; leave one of them out"
        )
    if impactor.velocity == 0:
        found.append("impactor.velocity = 0: a crosshead moves; must be above 0 m/s")
    elif numerics.end == "rebound":
        found.append(
            "numerics.end = 'rebound': a crosshead does not rebound; give impactor.travel, the way "
            "after which the run ends, or numerics.end in seconds"
        )
    elif impactor.travel is not None:
        expected = impactor.travel / impactor.velocity
        if abs(float(numerics.end) - expected) > _SAME * expected:
            found.append(
                f"numerics.end = {numerics.end:g}: impactor.travel = {impactor.travel:g} m at "
                f"{impactor.velocity:g} m/s takes {expected:.4g} s; give one of the two"
            )
    return found


def _pulse(base: Base) -> str:
    """The key that shakes a base."""
    return "base.acceleration" if base.pulse is None else f"base.pulse = '{base.pulse}'"


def _given(part: Any, key: str) -> Any:
    """What a part, or its raw data, was given for a key; None if nothing."""
    if isinstance(part, Part):
        return getattr(part, key) if key in part.model_fields_set else None
    return part.get(key) if isinstance(part, Mapping) else None


def _is_positive(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and value > 0
