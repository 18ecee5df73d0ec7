"""The pulse that shakes the base: acceleration over time, from lists, a CSV file or a shape."""

from __future__ import annotations

from itertools import pairwise
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from taichi_foam.parts import Part, quantity

MOST_POINTS = 2000

Shape = Literal["half-sine", "trapezoid", "sawtooth"]
"""The classical pulses of a shock machine (IEC 60068-2-27)."""

SINE_POINTS = 401
"""Points of a half-sine: between them it is straight, which changes its integral by 5e-6."""

RISE = 0.1
"""A trapezoid rises, and falls, within this share of its duration."""

DROP = 0.01
"""A terminal-peak sawtooth falls within this share of its duration: no acceleration jumps."""

_Time = Annotated[float, Field(ge=0, le=10)]
_Acceleration = Annotated[float, Field(ge=-1e6, le=1e6)]


class Pulse(Part):
    """Upward acceleration of the base over time, straight between its points and 0 beyond them."""

    time: Annotated[tuple[_Time, ...], Field(strict=False)] = quantity(
        ..., "s", "times of the points, rising", allowed="2 to 2,000 numbers from 0 to 10 s"
    )
    acceleration: Annotated[tuple[_Acceleration, ...], Field(strict=False)] = quantity(
        ...,
        "m/s2",
        "upward acceleration of the base at these times",
        allowed="as many numbers from -1e6 to 1e6 m/s2 as there are times",
    )

    @model_validator(mode="after")
    def _check_points(self) -> Pulse:
        times = self.time
        if len(times) != len(self.acceleration) or not 2 <= len(times) <= MOST_POINTS:
            raise ValueError(
                f"base.acceleration: {len(times)} times and {len(self.acceleration)} "
                f"accelerations; must be as many, from 2 to {MOST_POINTS:,}"
            )
        for n, (before, after) in enumerate(pairwise(times)):
            if after <= before:
                raise ValueError(
                    f"base.acceleration.time[{n + 1}] = {after:g}: must be above {before:g} s, the "
                    "time before it; sort the times, and give each once"
                )
        return self

    @classmethod
    def of_shape(cls, shape: Shape, peak: float, duration: float) -> Pulse:
        """A classical pulse that begins at time 0.

        Args:
            shape: its velocity change is 2/pi (half-sine), 0.9 (trapezoid) or 0.5 (sawtooth, its
                peak at its end) of peak times duration.
            peak: m/s2, upwards.
            duration: s, from zero to zero.
        """
        if shape == "half-sine":
            share = np.linspace(0.0, 1.0, SINE_POINTS)
            level = np.sin(np.pi * share)
            level[-1] = 0.0
        elif shape == "trapezoid":
            share, level = np.array([0.0, RISE, 1.0 - RISE, 1.0]), np.array([0.0, 1.0, 1.0, 0.0])
        else:
            share, level = np.array([0.0, 1.0 - DROP, 1.0]), np.array([0.0, 1.0, 0.0])
        time, acceleration = (duration * share).tolist(), (peak * level).tolist()
        return cls(time=time, acceleration=acceleration)

    @property
    def peak(self) -> float:
        """The largest acceleration, up or down, with its sign [m/s2]."""
        return max(self.acceleration, key=abs)

    def velocity(self, time: NDArray[np.float64]) -> NDArray[np.float64]:
        """Upward velocity [m/s] that the base has at times (n,) [s], exactly; 0 before the pulse.

        Of straight lines between points: their integral.
        """
        at, level = np.array(self.time), np.array(self.acceleration)
        now = np.clip(time, at[0], at[-1])
        speed = np.append(0.0, np.cumsum(0.5 * (level[1:] + level[:-1]) * np.diff(at)))
        before = np.clip(np.searchsorted(at, now, side="right") - 1, 0, len(at) - 2)
        mean = 0.5 * (level[before] + np.interp(now, at, level))
        return speed[before] + mean * (now - at[before])
