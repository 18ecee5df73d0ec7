"""The cushion chart: peak decelerations by the energy balance at once, and simulated one by one.

As a program, `python -m taichi_foam.live.page.cushion`, it simulates the drops of a chart.
"""

from __future__ import annotations

import json
import math
import os
import pickle
import queue
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field, replace
from typing import IO, TYPE_CHECKING, Any

import numpy as np

from taichi_foam.cushions import own_tests
from taichi_foam.cushions.own_tests import OwnTests
from taichi_foam.errors import UserError
from taichi_foam.formulas import energy
from taichi_foam.live.page.commands import Cushion
from taichi_foam.scene.families import FAMILIES
from taichi_foam.scene.library import foam_of, listed, names, packaged
from taichi_foam.scene.messages import shown

if TYPE_CHECKING:
    from taichi_foam.scene import Scene

#: How the foam of the served scene is called.
OWN = "of this scene"
#: Drops of a chart, and static stresses at which the formula is evaluated.
POINTS, FINE = 10, 200
#: How long a chart may compute [s]: the time of a drop grows with the stiffness of the foam.
MOST_SECONDS = 300.0
#: How little the process that computes gets of a busy machine.
NICE = 10


@dataclass(frozen=True)
class Input:
    """A number that a chart depends on.

    low, high  what it may be [unit]
    value      what stands there at first [unit]; None: nothing, and that is allowed
    """

    key: str
    label: str
    unit: str
    factor: float
    low: float
    high: float
    value: float | None
    about: str

    def told(self) -> dict[str, Any]:
        """The data from which the page builds the field; numbers in its unit."""
        return {
            **asdict(self),
            "min": self.low,
            "max": self.high,
            "open": [],
            "whole": False,
            "optional": self.value is None,
            "allowed": self.allowed,
        }

    @property
    def allowed(self) -> str:
        """The range in words."""
        words = f"{self.low:g} to {self.high:g} {self.unit}"
        return words if self.value is not None else f"nothing, or {words}"

    def check(self, value: float | None) -> None:
        """Raise UserError for a value [SI] out of range."""
        slack = 1e-9 * self.high
        if value is None:
            fits = self.value is None
        else:
            fits = self.low - slack <= value / self.factor <= self.high + slack
        if not fits:
            given = "nothing" if value is None else f"{value / self.factor:.12g} {self.unit}"
            raise UserError(f"{self.key} = {given}: must be {self.allowed}")


INPUTS = (
    Input("thickness", "thickness", "mm", 1e-3, 5, 300, 50, "of the foam under the product"),
    Input("drop_height", "drop height", "cm", 1e-2, 1, 500, 76, "of the fall until first contact"),
    Input(
        "least", "static stress from", "kPa", 1e3, 0.01, 1000, None,
        "weight over area; empty: chosen by the formula",
    ),
    Input("most", "static stress to", "kPa", 1e3, 0.01, 1000, None, "as above"),
)  # fmt: skip


@dataclass(frozen=True)
class Drops:
    """The drops of a chart; pickled, it is what its process is given. SI units.

    foam     as a scene takes it
    density  of the foam; None: as the foam says
    statics  static stresses, rising
    """

    called: str
    foam: Any
    density: float | None
    thickness: float
    drop_height: float
    statics: tuple[float, ...] = ()

    def scene(self, static: float) -> Scene:
        """The drop of a product of a static stress [Pa]. Raises UserError."""
        from taichi_foam.cushions.scenes import cushion_scene

        found = cushion_scene(
            self.foam, self.thickness, self.drop_height, static, density=self.density
        )
        # whoever watches it may want its film
        output = found.output.model_copy(update={"film": True, "snapshot_interval": 1e-3})
        name = f"{self.conditions}, static stress {1e-3 * static:.4g} kPa"
        return found.model_copy(update={"name": name[:100], "output": output})

    @property
    def conditions(self) -> str:
        """What all of them have in common, in words."""
        size = f"{1e3 * self.thickness:.4g} mm"
        return f"cushion, {self.called[:40]}, {size}, drop {1e2 * self.drop_height:.4g} cm"


@dataclass
class Chart:
    """A chart: its conditions, the formula's curve, and what has been simulated.

    number   grows with each chart
    about    what foam it is, in words
    fine     (n,) static stresses [Pa] of the formula's curve
    formula  (n,) its peaks [g], NaN where the foam is used up
    least    the optimum: static stress [Pa] and peak [g]
    by_hand  the formula's peak [g] of each drop, NaN where the foam is used up
    points   of each drop: what has come of it; None: not yet
    tests    own cushion tests, of any pads; None: none
    problem  why some will not come; empty if they will, or have
    """

    number: int
    drops: Drops
    about: str
    fine: np.ndarray
    formula: np.ndarray
    least: tuple[float, float]
    by_hand: np.ndarray
    points: list[dict[str, Any] | None]
    tests: OwnTests | None
    problem: str = ""
    _scenes: dict[int, Scene] = field(default_factory=dict)

    def scene(self, point: int) -> Scene:
        """The scene of a point, the same object each time. Raises UserError."""
        if not 0 <= point < len(self.points):
            raise UserError(f"point = {point}: must be 0 to {len(self.points) - 1}")
        if point not in self._scenes:
            self._scenes[point] = self.drops.scene(self.drops.statics[point])
        return self._scenes[point]

    def told(self, watched: Scene) -> dict[str, Any]:
        """What the page shows; SI units. `watched` is the scene that is dropped now."""
        drops, waits = self.drops, sum(point is None for point in self.points)
        at = [n for n, scene in self._scenes.items() if scene is watched]
        return {
            "number": self.number,
            "conditions": drops.conditions,
            "foam": drops.called,
            "about": self.about,
            "thickness": drops.thickness,
            "drop_height": drops.drop_height,
            "least": self.least,
            "formula": {"static": self.fine, "g": self.formula},
            "points": [
                {"static": static, "by_hand": g, **(point or {"state": "waiting"})}
                for static, g, point in zip(
                    drops.statics, self.by_hand.tolist(), self.points, strict=True
                )
            ],
            "tests": self._tests(),
            "waits": 0 if self.problem else waits,
            "problem": self.problem,
            "watched": at[0] if at else None,
        }

    def _tests(self) -> dict[str, Any] | None:
        """The own tests with the chart's height and thickness, and how many there are in all."""
        tests = self.tests
        if tests is None:
            return None
        which = tests.alike(self.drops.drop_height, self.drops.thickness)
        return {"static": tests.static[which], "g": tests.g[which], "all": len(tests.g)}


class Charts:
    """The chart that all viewers see, and the process that computes it. For one thread."""

    def __init__(self, given: Scene) -> None:
        self._given = given
        self._has_own = given.foam.loading(np.zeros(1)) is not None
        self.chart: Chart | None = None
        self._process: _Process | None = None

    def told(self) -> dict[str, Any]:
        """The data from which the page builds the fields."""
        foams = [*([OWN] if self._has_own else []), *listed()]
        return {
            "foams": foams,
            "foam": foams[0],
            "about": self._foams,
            "inputs": [each.told() for each in INPUTS],
        }

    def ask(self, asked: Cushion) -> None:
        """Show another chart, and compute it instead of the one before. Raises UserError."""
        for each in INPUTS:
            each.check(getattr(asked, each.key))
        number = self.chart.number if self.chart else 0
        chart = _chart(number + 1, asked, *self._drops(asked))
        self.close()
        self.chart = chart
        try:
            self._process = _Process(chart.drops)
        except OSError as error:
            chart.problem = f"the process that simulates cannot be started: {error}"

    def scene(self, number: int, point: int) -> Scene:
        """The scene of a point of the chart of a number. Raises UserError."""
        if self.chart is None or self.chart.number != number:
            raise UserError("the chart has been replaced meanwhile; choose a point of the new one")
        return self.chart.scene(point)

    def take(self) -> bool:
        """Take what has been simulated meanwhile; whether that changes the chart."""
        process, chart = self._process, self.chart
        if process is None or chart is None:
            return False
        changed = False
        for place, point in process.take():
            chart.points[place], changed = point, True
        if None not in chart.points:
            self._process = None  # left to itself: at its end it stores what it has compiled
        elif process.problem:
            chart.problem, changed = process.problem, True
            self.close()
        return changed

    def close(self) -> None:
        """Compute no more."""
        if self._process is not None:
            self._process.close()
        self._process = None

    @property
    def _foams(self) -> str:
        """What may be named, in words."""
        words = f"in the library: {', '.join(names())}"
        return f"{OWN}, or {words}" if self._has_own else words

    def _drops(self, asked: Cushion) -> tuple[Drops, str]:
        """The drops, with no static stresses yet, and what foam it is. Raises UserError."""
        foam, sizes = asked.foam, (asked.thickness, asked.drop_height)
        if foam == OWN and self._has_own:
            own, density = self._given.foam, self._given.block.density
            called = f"foam of {self._given.name}"
            return Drops(called, own, density, *sizes), f"{called}, {density:.4g} kg/m³"
        # a path would be read, too
        if foam not in packaged() and all(each.density(foam) is None for each in FAMILIES):
            raise UserError(f"foam = {shown(foam)}: must be {self._foams}")
        return Drops(foam, foam, None, *sizes), foam_of(foam).title


def _chart(number: int, asked: Cushion, drops: Drops, about: str) -> Chart:
    """A chart with nothing simulated yet. Raises UserError."""
    from taichi_foam.cushions.scenes import stress_curve

    tests = own_tests.pasted(asked.tests) if asked.tests.strip() else None
    thickness, height, least, most = asked.thickness, asked.drop_height, asked.least, asked.most
    scene = drops.scene(1e3)
    strain, stress = stress_curve(scene)
    plateau = scene.foam.landmarks.plateau_stress
    best, stop = energy.optimum(strain, stress, height, thickness)

    def peaks(statics: Any) -> np.ndarray:
        return energy.cushion_curve(strain, stress, height, thickness, statics)

    given = INPUTS[-1]
    low, high = energy.usual_range(strain, stress, height, thickness, plateau)
    if most is None:
        high = high if least is None else max(high, 2.0 * least)
        most = min(high, energy.STANDS * plateau, given.high * given.factor)
    if least is None:
        least = max(min(low, 0.5 * most), given.low * given.factor)
    if most >= plateau:
        raise UserError(
            f"most = {1e-3 * most:.6g} kPa: must be below the foam's plateau stress, "
            f"{1e-3 * plateau:.4g} kPa; under more it is crushed by the weight alone"
        )
    if not least < most:
        ends = f"{1e-3 * least:.6g} kPa"
        raise UserError(f"most = {1e-3 * most:.6g} kPa: must be above the least one, {ends}")
    statics = tuple(float(f"{each:.3g}") for each in np.geomspace(least, most, POINTS))
    if len(set(statics)) < POINTS:
        raise UserError(f"most = {1e-3 * most:.6g} kPa: must be at least 5 % above the least one")
    drops = replace(drops, statics=statics)
    for each in (statics[0], statics[-1]):
        drops.scene(each)  # what cannot be dropped is best told by its scene
    fine = np.union1d(np.geomspace(statics[0], statics[-1], FINE), [best])
    fine = fine[(fine >= statics[0]) & (fine <= statics[-1])]
    return Chart(
        number, drops, about, fine, peaks(fine), (best, stop.g), peaks(statics), [None] * POINTS,
        tests,
    )  # fmt: skip


class _Process:
    """The process that simulates drops, and a thread that reads what it says.

    problem  why it says no more, before its end; empty if there is none
    """

    def __init__(self, drops: Drops) -> None:
        self.problem = ""
        self._said: queue.SimpleQueue[tuple[int, dict[str, Any]] | None] = queue.SimpleQueue()
        self._until = time.monotonic() + MOST_SECONDS
        self._process = subprocess.Popen(
            [sys.executable, "-m", __name__],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            start_new_session=True,  # the server decides what Ctrl-C means
        )
        assert self._process.stdin is not None
        pickle.dump(drops, self._process.stdin)
        self._process.stdin.flush()
        threading.Thread(target=self._read, name="cushion", daemon=True).start()

    def take(self) -> Iterator[tuple[int, dict[str, Any]]]:
        """What has come meanwhile: the drop's place, and what became of it."""
        while not self._said.empty():
            said = self._said.get()
            if said is None:
                code = self._process.wait()
                self.problem = f"the process that simulates was ended with exit code {code}"
            else:
                yield said
        if time.monotonic() > self._until:
            self.problem = f"not simulated within {MOST_SECONDS:.0f} s"

    def close(self) -> None:
        """End it at once; while it simulates, it writes no file."""
        self._process.kill()

    def _read(self) -> None:
        with self._process as process:  # until it has ended
            assert process.stdout is not None
            for line in process.stdout:
                place, point = json.loads(line)
                self._said.put((place, point))
            self._said.put(None)


def main(asked: IO[bytes], said: IO[str]) -> None:
    """Simulate the drops of a pickled `Drops` one by one, and say what became of each."""
    from taichi_foam.simulation.simulate import simulate_many

    drops = pickle.load(asked)
    threading.Thread(target=_end_with, args=(asked,), daemon=True).start()
    for place, static in enumerate(drops.statics):
        try:
            # one at a time: on one thread they would else all end together
            for _, result in simulate_many([drops.scene(static)], arch="cpu", threads=1):
                point = _point(result.summary, result.run["ended_by"])
        except Exception as error:
            point = {"state": "failed", "why": f"{type(error).__name__}: {error}"}
        said.write(json.dumps([place, point]) + "\n")
        said.flush()


def _point(summary: dict[str, Any], ended_by: str) -> dict[str, Any]:
    """What the page is told of a drop that has been simulated."""
    raw = summary["peak_deceleration_g"]
    if raw is None or not math.isfinite(raw) or not summary["came_to_rest"]:
        return {"state": "failed", "why": f"no peak; ended by: {ended_by}"}
    return {
        "state": "simulated",
        "g": raw,
        "g_cfc180": summary["peak_deceleration_cfc180_g"],
        "strain": summary["max_strain"],
        "bottomed": bool(summary["bottomed_out"]),
    }


def _end_with(asked: IO[bytes]) -> None:
    """End this process when the one that has asked is gone."""
    os.read(asked.fileno(), 1)  # not through the file, whose lock Python wants at its own end
    os._exit(0)


if __name__ == "__main__":
    if hasattr(os, "nice"):
        os.nice(NICE)
    # what libraries print is no answer
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)
    main(sys.stdin.buffer, answers)
