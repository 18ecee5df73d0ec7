"""What the page shows of one drop in numbers: at an instant, its measures so far, its curve."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any

import numpy as np

from taichi_foam.analysis.measures import shown_in
from taichi_foam.live.page.curve import Curve
from taichi_foam.live.page.figures import ENERGIES

if TYPE_CHECKING:
    from taichi_foam.live.messages import Frame
    from taichi_foam.results.result import Result

#: Between two looks at the measures, which take longer than the rest [s].
MEASURE_SECONDS = 1.0


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
        self._result: Result | None = None  # that `_told` is of
        self._measured: Result | None = None  # that `_figures` are of
        self._figures: dict[str, Any] = {}
        self._figures_time: float | None = None  # the instant that they are of [s]
        self._said: list[str] = []
        self._measure_at = 0.0
        self._told: dict[str, Any] = {}

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
        if not len(result.history["time_s"]):
            return
        if result is not self._result:
            self._result = result
            self._read(result)
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
        return {
            "drop": self.drop,
            **self._told,
            "figures": self._figures,
            "figures_time": self._figures_time,
            "said": self._said,
            **self._pace(),
        }

    def _read(self, result: Result) -> None:
        """Go through the history once more."""
        history = result.history
        self.curve = Curve(self.drop, history["time_s"], history["deceleration_smoothed_m_s2"])
        self._told = {"time": float(history["time_s"][-1])}

    def _measure(self, result: Result, is_over: bool) -> None:
        start = time.monotonic()
        measured = result.summary
        self._measured = result
        self._figures = {quantity.key: measured[quantity.key] for quantity in shown_in("page")}
        self._figures_time = float(result.history["time_s"][-1])
        # until it is over, a drop counts as interrupted, and there is nothing to say of its end
        words = measured["statement"] if is_over else None
        warned = [f"warning: {text}" for text in measured["warnings"]]
        self._said = [*([words] if words else []), *warned]
        took = time.monotonic() - start
        self._measure_at = start + max(MEASURE_SECONDS, 20.0 * took)

    def _pace(self) -> dict[str, Any]:
        """How fast it goes: over the last second, and the engine by itself."""
        frame = self._last
        if frame is None:
            return {"fraction": 0.0, "steps": 0, "pace": None, "steps_per_s": None}
        (then, time_0, steps_0, wall_0), (now, time_1, steps_1, wall_1) = (
            self._marks[0],
            self._marks[-1],
        )
        ran = wall_1 - wall_0
        return {
            "fraction": 1.0 if frame.ended else frame.fraction,
            "steps": frame.steps,
            "pace": (time_1 - time_0) / max(now - then, 1e-3),
            "steps_per_s": (steps_1 - steps_0) / ran if ran > 0 else None,
        }
