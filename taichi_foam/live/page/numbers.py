"""What the page shows of one drop in numbers: at an instant, its measures so far, its curve."""

from __future__ import annotations

import json
import time
from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from taichi_foam.analysis.measures import Quantity, shown_in
from taichi_foam.records.history import COLUMNS, LEDGER

if TYPE_CHECKING:
    from taichi_foam.live.messages import Frame
    from taichi_foam.results.result import Result

Array = NDArray[np.float64]


def shown(quantities: Iterable[Quantity]) -> tuple[tuple[str, str, str, float, int], ...]:
    """Figures as the page shows them in a table: key, name, unit, factor to it, and digits."""
    return tuple((one.key, one.name, one.unit, one.factor, one.digits) for one in quantities)


FIGURES = shown(shown_in("page"))
"""The figures of the page's table, in its order."""

ENERGIES = (
    *((layer.label, layer.columns) for layer in LEDGER),
    *((COLUMNS[name].label, (name,)) for name in ("gravity_J", "residual_J")),
)
"""The ledger as the page shows it: words, and the columns of the history that add up to them."""

#: Between two looks at the measures, which take longer than the rest [s].
MEASURE_SECONDS = 1.0
#: A curve has at most so many points; a longer one is sent at every second row, and so on.
MOST_POINTS = 2000
#: One of a former drop, which is a thin line, has at most so many.
MOST_FORMER = 400
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


def thinned(time: Array, deceleration: Array) -> dict[str, list[float]]:
    """At most `MOST_FORMER` points of a curve that is over: t [ms], a [m/s2]."""
    known = np.flatnonzero(np.isfinite(deceleration))
    kept = known[:: max(1, -(-len(known) // MOST_FORMER))]
    return {
        "t": np.round(1e3 * time[kept], 4).tolist(),
        "a": np.round(deceleration[kept], 2).tolist(),
    }


class Numbers:
    """The numbers of one drop.

    drop   its number
    curve  its deceleration until now
    """

    def __init__(self, drop: int) -> None:
        self.drop = drop
        self.curve = Curve(drop, np.empty(0), np.empty(0))
        self._last: Frame | None = None
        # of the last second: wall time [s], simulated time [s], steps, the engine's time [s]
        self._marks: list[tuple[float, float, int, float]] = []
        self._result: Result | None = None  # that `curve` is of
        self._measured: Result | None = None  # that `_measures` are of
        self._measures: dict[str, Any] = {"figures": {}, "figures_time": None, "said": []}
        self._measure_at = 0.0

    def take(self, frame: Frame) -> None:
        """A frame has come."""
        self._last = frame
        now = time.monotonic()
        self._marks.append((now, frame.snapshot.time, frame.steps, frame.wall))
        while len(self._marks) > 2 and self._marks[1][0] < now - 1.0:
            self._marks.pop(0)

    def read(self, result: Result, is_over: bool, at_rest: bool) -> None:
        """Take the numbers of what the drop has given until now.

        Measures are taken now and then while it moves, and at once when it is over or `at_rest`:
        people then read the figures beside the picture.
        """
        history = result.history
        if not len(history["time_s"]):
            return
        if result is not self._result:
            self._result = result
            self.curve = Curve(self.drop, history["time_s"], history["deceleration_smoothed_m_s2"])
        is_due = is_over or at_rest or time.monotonic() >= self._measure_at
        if is_due and result is not self._measured:
            self._measure(result, is_over)

    def at(self, time: float, result: Result) -> dict[str, Any]:
        """What is read out beside the picture of an instant [s]; SI units.

        The worker shows instants that the history holds. Before its first row there is the time
        alone.
        """
        history = result.history
        row = int(np.searchsorted(history["time_s"], time, side="right")) - 1
        if row < 0:
            return {"drop": self.drop, "time": time}
        return {
            "drop": self.drop,
            "time": float(history["time_s"][row]),
            "displacement": float(history["displacement_m"][row]),
            "velocity": float(history["velocity_m_s"][row]),
            "deceleration": float(history["deceleration_smoothed_m_s2"][row]),
            "energies": {
                words: sum(float(history[name][row]) for name in names if name in history)
                for words, names in ENERGIES
            },
        }

    def told(self) -> dict[str, Any]:
        """What the page shows beside the picture; SI units."""
        reached = {} if self._result is None else {"time": _end(self._result)}
        return {"drop": self.drop, **reached, **self._measures, **self._pace()}

    def _measure(self, result: Result, is_over: bool) -> None:
        start = time.monotonic()
        measured = result.summary
        self._measured = result
        # until it is over, a drop counts as interrupted, and there is nothing to say of its end
        words = [measured["statement"]] if is_over and measured["statement"] else []
        self._measures = {
            "figures": {key: measured[key] for key, *_ in FIGURES},
            "figures_time": _end(result),
            "said": [*words, *(f"warning: {text}" for text in measured["warnings"])],
        }
        took = time.monotonic() - start
        self._measure_at = start + max(MEASURE_SECONDS, 20.0 * took)

    def _pace(self) -> dict[str, Any]:
        """How fast it goes: over the last second, and the engine by itself."""
        frame = self._last
        if frame is None:
            return {"fraction": 0.0, "steps": 0, "pace": None, "steps_per_s": None}
        then, time_0, steps_0, wall_0 = self._marks[0]
        now, time_1, steps_1, wall_1 = self._marks[-1]
        ran = wall_1 - wall_0
        return {
            "fraction": 1.0 if frame.ended else frame.fraction,
            "steps": frame.steps,
            "pace": (time_1 - time_0) / max(now - then, 1e-3),
            "steps_per_s": (steps_1 - steps_0) / ran if ran > 0 else None,
        }


def _end(result: Result) -> float:
    """Time of the last row [s]."""
    return float(result.history["time_s"][-1])
