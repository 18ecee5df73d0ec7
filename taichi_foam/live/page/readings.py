"""What the instruments of one drop show: the numbers of now, and the curve until now."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any

import numpy as np

from taichi_foam.analysis.history import history_of
from taichi_foam.live.page.curve import Curve
from taichi_foam.live.page.figures import ENERGIES, QUANTITIES
from taichi_foam.results.result import Result

if TYPE_CHECKING:
    from taichi_foam.live.messages import Frame
    from taichi_foam.scene import Scene

#: Between two looks at the measures, which take longer than the rest [s].
MEASURE_SECONDS = 1.0


class Readings:
    """Collects the frames of one drop.

    curve  its deceleration until now
    """

    def __init__(self, drop: int, scene: Scene) -> None:
        self._drop, self._scene = drop, scene
        self._rows: list[np.ndarray] = []
        self._last: Frame | None = None
        # of the last second: wall time [s], simulated time [s], steps, the engine's time [s]
        self._marks: list[tuple[float, float, int, float]] = []
        self._is_over = False
        self._figures: dict[str, Any] = {}
        self._measure_at = 0.0
        self._told: dict[str, Any] = {}
        self._is_new = False
        self.curve = Curve(drop, np.empty(0), np.empty(0))

    def take(self, frame: Frame) -> None:
        """A frame has come."""
        self._last = frame
        if len(frame.rows) and not self._is_over:
            self._rows.append(frame.rows)
            self._is_new = True
        now = time.monotonic()
        self._marks.append((now, frame.snapshot.time, frame.steps, frame.wall))
        while len(self._marks) > 2 and self._marks[1][0] < now - 1.0:
            self._marks.pop(0)

    def finish(self, result: Result) -> None:
        """The drop is over: this is all that it gave."""
        self._is_over, self._is_new = True, False
        self._rows = []
        self._read(result)
        self._measure(result)

    def told(self) -> dict[str, Any]:
        """What the page shows now; SI units."""
        if self._is_new:
            self._is_new = False
            self._rows = [np.concatenate(self._rows)]
            last = [self._last.snapshot] if self._last else []
            result = Result(self._scene, history_of(self._scene, self._rows[0]), last, {})
            self._read(result)
            if time.monotonic() >= self._measure_at:
                self._measure(result)
        return {"drop": self._drop, **self._told, "figures": self._figures, **self._pace()}

    def _read(self, result: Result) -> None:
        """Go through the history once more."""
        history = result.history
        if not len(history["time_s"]):
            return
        self.curve = Curve(self._drop, history["time_s"], history["deceleration_smoothed_m_s2"])
        now = {name: float(column[-1]) for name, column in history.items()}
        self._told = {
            "time": now["time_s"],
            "displacement": now["displacement_m"],
            "velocity": now["velocity_m_s"],
            "deceleration": now["deceleration_smoothed_m_s2"],
            "force": now["contact_force_N"],
            "broken": int(now["broken_bonds"]),
            "energies": {name: now[name] for name, _ in ENERGIES},
        }

    def _measure(self, result: Result) -> None:
        start = time.monotonic()
        measured = result.summary
        self._figures = {quantity.key: measured[quantity.key] for quantity in QUANTITIES}
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
