"""The deceleration curve on its way to viewers: thinned, and only what they do not have yet."""

from __future__ import annotations

import json
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

#: A curve has at most so many points; a longer one is sent at every second row, and so on.
MOST_POINTS = 2000
#: The smoothing filter changes the newest part of a curve when rows follow: so much of it [s].
UNSETTLED = 0.006


@dataclass(frozen=True)
class Cursor:
    """Which part of a curve a viewer has for good."""

    drop: int = 0
    stride: int = 0
    points: int = 0


class Curve:
    """The smoothed deceleration of one drop, which grows."""

    def __init__(self, drop: int, time: Array, deceleration: Array) -> None:
        """time [s], deceleration [m/s2], both (n,)."""
        stride = 1
        while len(time) > stride * (MOST_POINTS - 1):
            stride *= 2
        kept = slice(None, None, stride)
        last = slice(-1, None) if len(time) and (len(time) - 1) % stride else slice(0, 0)
        self._time = np.concatenate([time[kept], time[last]])
        self._values = np.concatenate([deceleration[kept], deceleration[last]])
        settled = int(np.searchsorted(time[kept], time[-1] - UNSETTLED)) if len(time) else 0
        self._end = Cursor(drop, stride, settled)
        self._texts: dict[int, str] = {}  # of what is missing from a point on

    def since(self, cursor: Cursor) -> tuple[str, Cursor]:
        """The message with what is new to a viewer, and what the viewer has then."""
        same = (cursor.drop, cursor.stride) == (self._end.drop, self._end.stride)
        start = min(cursor.points, self._end.points) if same else 0
        if start not in self._texts:
            if len(self._texts) > 8:  # viewers of many speeds: each pays for its own
                self._texts.clear()
            self._texts[start] = self._text(start)
        return self._texts[start], self._end

    def _text(self, start: int) -> str:
        times, values = self._time[start:], self._values[start:]
        return json.dumps(
            {
                "kind": "curve",
                "drop": self._end.drop,
                "from": start,
                "t": np.round(1e3 * times, 4).tolist(),
                "a": [round(v, 3) if v == v else None for v in values.tolist()],
            },
            separators=(",", ":"),
        )


def thinned(time: Array, deceleration: Array, most: int = 400) -> dict[str, list[float]]:
    """At most so many points of a curve that is over: t [ms], a [m/s2]."""
    known = np.flatnonzero(np.isfinite(deceleration))
    kept = known[:: max(1, -(-len(known) // most))]
    return {
        "t": np.round(1e3 * time[kept], 4).tolist(),
        "a": np.round(deceleration[kept], 2).tolist(),
    }
