"""The pulse that shakes the base: acceleration over time, from lists or a CSV file."""

from __future__ import annotations

from itertools import pairwise
from typing import Annotated

from pydantic import Field, model_validator

from taichi_foam.parts import Part, quantity

MOST_POINTS = 2000

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
