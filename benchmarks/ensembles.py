"""Runs of the nine tests with velocities a little off: how far a figure is chance.

Broken foam is chaotic. A figure of one run says little; a median over velocities that no
measurement could tell apart, and the range, say more.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from taichi_foam.measures import summary
from taichi_foam.paper import NAMES
from taichi_foam.scene import Scene
from taichi_foam.scene_io import load_scene
from taichi_foam.simulation import simulate_many
from taichi_foam.study.compare import DISPLACEMENT, DURATION, ENERGY, PLATEAU, relative_error

WITHIN = 0.005  # velocities differ by at most this part
ORDER = (DURATION, DISPLACEMENT, PLATEAU, ENERGY)

Figures = dict[str, Any]
"""The content of a run's summary.json, and `simulated_s`, how long the run was."""


def factors(count: int) -> list[float]:
    """Velocities of an ensemble over the test's own: evenly spread, from end to end."""
    return [float(f) for f in 1.0 + WITHIN * np.linspace(-1.0, 1.0, count)]


def scene_of(
    name: str, factor: float = 1.0, overrides: Sequence[str] = (), choices: str = "calibrated"
) -> Scene:
    """A paper test with another velocity."""
    scene = load_scene(name, choices, overrides)
    assert scene.impactor is not None
    velocity = factor * scene.impactor.velocity
    return load_scene(scene, overrides=[f"impactor.velocity={velocity!r}"])


def figures_of(
    scenes: Sequence[Scene], on_progress: Callable | None = None
) -> Iterator[tuple[int, Figures]]:
    """Run scenes side by side; place and figures of each as it ends."""
    for place, result in simulate_many(scenes, on_progress):
        ended = result.run["ended_by"]
        if ended not in ("rebound", "end time"):
            raise RuntimeError(f"{result.scene.name}: ended by {ended}")
        yield place, {**summary(result), "simulated_s": float(result.history["time_s"][-1])}


def median_and_range(values: Sequence[float | None]) -> tuple[float, float, float]:
    """Median, least and largest; a run without an answer (the impactor never stopped) counts inf.

    Of an even number the median is the mean of the two in the middle.
    """
    known = np.array([np.inf if value is None else value for value in values], dtype=float)
    return float(np.median(known)), float(known.min()), float(known.max())


def error_of(name: str, figures: Mapping[str, Any], key: str, measured: Mapping) -> float | None:
    """Relative error of one figure of one run."""
    return relative_error(figures[key], measured[name][key])


def table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A Markdown table."""
    lines = [header, ["---"] * len(header), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines) + "\n"


def short(name: str) -> str:
    """ "paper/rectangular-2.46" as the tables have it: flat 2.46."""
    shape, velocity = name.removeprefix("paper/").split("-")
    return f"{'flat' if shape == 'rectangular' else shape} {velocity}"


def full_names(cases: str | None) -> list[str]:
    """Tests given as "wedge-2.86,cylinder-3.32", or all nine."""
    wanted = [f"paper/{case.strip()}" for case in cases.split(",")] if cases else list(NAMES)
    unknown = [name for name in wanted if name not in NAMES]
    if unknown:
        raise SystemExit(f"no such test: {', '.join(unknown)}; choose from {', '.join(NAMES)}")
    return wanted
