"""The parameters of a calibration: keys of the scene, each with a range."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from taichi_foam.errors import UserError
from taichi_foam.scene import Scene
from taichi_foam.scene.paths import by_key
from taichi_foam.sweeps.sampling import between

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Range:
    """A key of the scene and its range, in which the prior is uniform; `log`: in the logarithm."""

    key: str
    low: float
    high: float
    log: bool = False

    def value(self, unit: Array) -> Array:
        """Values at coordinates from 0 to 1."""
        return between(self.low, self.high, self.log, unit)

    def unit(self, value: Array) -> Array:
        """Coordinates of values."""
        if self.log:
            return np.log(value / self.low) / np.log(self.high / self.low)
        return (value - self.low) / (self.high - self.low)

    @property
    def axis(self) -> dict[str, Any]:
        """The range as an axis of a sweep's plan."""
        spacing = "log" if self.log else "linear"
        return {"key": self.key, "from": self.low, "to": self.high, "spacing": spacing}


@dataclass(frozen=True)
class Space:
    """The ranges of d parameters; a point in it has a coordinate from 0 to 1 for each."""

    ranges: tuple[Range, ...]

    @property
    def keys(self) -> list[str]:
        return [one.key for one in self.ranges]

    def __len__(self) -> int:
        return len(self.ranges)

    def values(self, unit: Array) -> Array:
        """Values (n, d) of points (n, d) given by coordinates from 0 to 1."""
        columns = [one.value(u) for one, u in zip(self.ranges, unit.T, strict=True)]
        return np.stack(columns, axis=1)

    def unit(self, values: Array) -> Array:
        """Coordinates (n, d) of values (n, d)."""
        columns = [one.unit(v) for one, v in zip(self.ranges, values.T, strict=True)]
        return np.stack(columns, axis=1)


def space_of(scene: Scene, fit: Mapping[str, Sequence[Any]] | Sequence[str]) -> Space:
    """The checked ranges of a calibration.

    Args:
        scene: the scene that has the keys.
        fit: for each key (low, high), or (low, high, "log") for a prior that is uniform in the
            logarithm; or texts "KEY=LOW..HIGH" and "KEY=LOW..HIGH:log".

    Raises:
        UserError: no range, one that reads otherwise, LOW not below HIGH, a key that the scene does
            not have or that takes no real number, or an end that the scene refuses.
    """
    if not isinstance(fit, Mapping):
        pairs = [_read(text) for text in fit]
        if twice := [key for n, (key, _) in enumerate(pairs) if key in dict(pairs[:n])]:
            raise UserError(f"fit {twice[0]}: given twice; a parameter has one range")
        fit = dict(pairs)
    if not fit:
        raise UserError(
            "fit: no parameter given. Fix: name what the trace shall determine, e.g. "
            "foam.yield_strain=-0.06..-0.03"
        )
    return Space(tuple(_range(scene, key, ends) for key, ends in fit.items()))


def _read(text: str) -> tuple[str, tuple[Any, ...]]:
    """The key and the ends of a range in text. Raises UserError."""
    key, equals, words = (part.strip() for part in text.partition("="))
    words, _, spacing = words.partition(":")
    ends = words.split("..")
    try:
        if not (key and equals) or len(ends) != 2 or spacing not in ("", "log", "linear"):
            raise ValueError
        return key, (float(ends[0]), float(ends[1]), spacing or "linear")
    except ValueError:
        raise UserError(
            f"fit {text!r}: must read KEY=LOW..HIGH or KEY=LOW..HIGH:log, e.g. "
            "foam.yield_strain=-0.06..-0.03"
        ) from None


def _range(scene: Scene, key: str, ends: Sequence[Any]) -> Range:
    """A checked range. Raises UserError."""
    numbers = all(isinstance(end, int | float) and math.isfinite(end) for end in ends[:2])
    if len(ends) not in (2, 3) or not numbers:
        raise UserError(f"fit {key}: {ends!r}: must be two finite numbers, low and high")
    low, high, spacing = float(ends[0]), float(ends[1]), ends[2] if len(ends) == 3 else "linear"
    if spacing not in ("linear", "log"):
        raise UserError(f"fit {key}: spacing = {spacing!r}: must be 'linear' or 'log'")
    if low >= high:
        raise UserError(f"fit {key}: LOW = {low:g} is not below HIGH = {high:g}; exchange them")
    if spacing == "log" and low <= 0:
        raise UserError(
            f"fit {key}: LOW = {low:g}: a logarithmic range must be above 0; leave :log out, or "
            "take a larger LOW"
        )
    usual = by_key(scene.model_dump()).get(key)
    if isinstance(usual, bool | int | str):
        raise UserError(
            f"fit {key}: the scene has {usual!r}; only a key that takes any number in its range "
            "can be determined"
        )
    for end in (low, high):
        scene.with_values({key: end})  # its message names the key, the value and what is allowed
    return Range(key, low, high, spacing == "log")
