"""What studies of many runs of the nine tests share: the tests, their figures, tables."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

from taichi_foam.analysis.bands import Band, band
from taichi_foam.analysis.measures import (
    DISPLACEMENT,
    DURATION,
    ENERGY_PER_VOLUME,
    PLATEAU,
    summary,
)
from taichi_foam.catalogue import load_scene
from taichi_foam.errors import UserError
from taichi_foam.scene import Scene
from taichi_foam.shim2000.compare import at_rest
from taichi_foam.shim2000.impacts import case_names
from taichi_foam.shim2000.study import faster
from taichi_foam.simulation.simulate import ProgressCallback, simulate_many

ORDER = (DURATION, DISPLACEMENT, PLATEAU, ENERGY_PER_VOLUME)

Figures = dict[str, Any]
"""The content of a run's summary.json, and `simulated_s`, how long the run was."""


def scene_of(
    name: str, factor: float = 1.0, overrides: Sequence[str] = (), choices: str = "calibrated"
) -> Scene:
    """A paper test with another velocity."""
    return faster(load_scene(name, choices, overrides), factor)


def figures_of(
    scenes: Sequence[Scene], on_progress: ProgressCallback | None = None
) -> Iterator[tuple[int, Figures]]:
    """Run scenes side by side; place and figures of each as it ends."""
    for place, result in simulate_many(scenes, on_progress):
        if result.failure:
            raise RuntimeError(f"{result.scene.name}: ended by {result.run['ended_by']}")
        yield (
            place,
            {**at_rest(summary(result)), "simulated_s": float(result.history["time_s"][-1])},
        )


def median_and_range(values: Sequence[float | None]) -> Band:
    """Least, median and largest; a run that has no answer counts as inf."""
    return band(values, ends=(0.0, 1.0))


def percent(error: float | None) -> str:
    """A relative error, in per cent; a dash for no answer."""
    return "–" if error is None or error == float("inf") else f"{100 * error:+.0f}"


def short(name: str) -> str:
    """ "paper/rectangular-2.46" as the tables have it: flat 2.46."""
    shape, velocity = name.removeprefix("paper/").split("-")
    return f"{'flat' if shape == 'rectangular' else shape} {velocity}"


COARSE = ("block.columns=20", "block.rows=10")
"""Settings with which an impact takes a second: for `--smoke`, whose figures nobody reads."""


def full_names(cases: str | None) -> list[str]:
    """Tests given as "wedge-2.86,cylinder-3.32", or all nine."""
    try:
        return case_names(cases.split(",") if cases else None)
    except UserError as error:
        raise SystemExit(str(error)) from None
