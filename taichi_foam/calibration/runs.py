"""The runs of a calibration: waves of them as sweeps, and what is read from each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from taichi_foam.calibration.reading import Reader
from taichi_foam.calibration.space import Space
from taichi_foam.scene import Scene
from taichi_foam.sweeps import table
from taichi_foam.sweeps.plan import Plan
from taichi_foam.sweeps.run import sweep
from taichi_foam.sweeps.store import MARK, Sweep

Array = NDArray[np.float64]

SEED, SCATTER = "foam.strength_seed", "foam.strength_scatter"
_SEEDS = 2**32 - 1


@dataclass(frozen=True)
class Runs:
    """Runs of a scene with different values of the parameters.

    values    (n, d)
    series    (n, m) filtered deceleration at `Reader.time` [m/s2], nan where a run has failed;
              m is 0 without a trace
    measures  (n, j) the key figures that were asked for, nan where a run does not have one
    failures  (n,) why a run has none of these, in words; None: it has
    """

    values: Array
    series: Array
    measures: Array
    failures: NDArray[np.object_]

    def __len__(self) -> int:
        return len(self.values)

    @property
    def failed(self) -> NDArray[np.bool_]:
        """(n,) which runs have failed."""
        return np.array([reason is not None for reason in self.failures], bool)

    @property
    def traces(self) -> Array:
        """The series of the runs that have one."""
        return self.series[np.isfinite(self.series).all(axis=1)]

    def figures(self, reader: Reader | None) -> Array:
        """The figures (n, k) of all runs: those of the trace, then the key figures."""
        if reader is None:
            return self.measures
        return np.concatenate([reader.figures(self.series), self.measures], axis=1)


def joined(parts: Sequence[Runs]) -> Runs:
    """The runs of several waves."""
    columns = ([getattr(part, each.name) for part in parts] for each in fields(Runs))
    return Runs(*map(np.concatenate, columns))


def first_plan(
    scene: Scene, space: Space, count: int, seed: int, measures: Sequence[str] = ()
) -> dict[str, Any]:
    """The plan of a wave over the whole ranges, with key figures of each run: a Sobol sequence.

    If the foam's strength scatters, each run draws other strengths: the measured foam did, too.
    """
    axes = [one.axis for one in space.ranges]
    if _scatters(scene, space):
        axes.append({"key": SEED, "from": 0, "to": _SEEDS})
    sample = {"method": "sobol", "count": count, "seed": seed}
    return {**_common(scene, measures), "axes": axes, "sample": sample}


def plan_at(
    scene: Scene, space: Space, values: Array, seed: int, measures: Sequence[str] = ()
) -> dict[str, Any]:
    """The plan of runs at values (n, d) of the parameters, with key figures of each run."""
    axes = [
        {"key": key, "values": each.tolist()}
        for key, each in zip(space.keys, values.T, strict=True)
    ]
    if _scatters(scene, space):
        seeds = np.random.default_rng(seed).choice(_SEEDS, len(values), replace=False)
        axes.append({"key": SEED, "values": seeds.tolist()})
    return {**_common(scene, measures), "axes": axes, "paired": True}


def _scatters(scene: Scene, space: Space) -> bool:
    return scene.foam.strength_scatter > 0 or SCATTER in space.keys


def _common(scene: Scene, measures: Sequence[str]) -> dict[str, Any]:
    data = scene.model_dump(mode="json", exclude_none=True)
    return {"scene": data, "keep": {"histories": "float32", "measures": [*measures]}}


def computed(plan: dict[str, Any], folder: Path, **how: Any) -> Sweep:
    """The sweep of a plan in a folder; one that was begun there goes on with its own plan.

    Raises as `sweep`, to which `how` is passed on.
    """
    begun = Sweep.open(folder).plan if (folder / MARK).is_file() else None
    return sweep(begun or Plan.load(plan), folder, **how)


def runs_of(found: Sweep, space: Space, reader: Reader | None, measures: Sequence[str]) -> Runs:
    """What is read from the drops of a complete sweep.

    A drop that diverged, whose values make an invalid scene, whose trace has no peak, or that lacks
    a key figure has failed.
    """
    names = (table.MEMBER, "failure", *space.keys, *measures)
    rows = table.read(found.shards(), names).to_pylist()
    values = np.array([[row[key] for key in space.keys] for row in rows], dtype=float)
    figures = np.array(
        [[np.nan if row.get(name) is None else row[name] for name in measures] for row in rows],
        dtype=float,
    ).reshape(len(rows), len(measures))
    failures = [row["failure"] for row in rows]
    series = np.empty((len(rows), 0))
    if reader is not None:
        series = np.full((len(rows), len(reader.time)), np.nan)
        gravity = found.plan.base.numerics.gravity
        traces = traces_of(found)
        for place, row in enumerate(rows):
            if failures[place] is None:
                time, deceleration = traces[row[table.MEMBER]]
                if len(time) > 2:  # rows are means over the intervals that end there
                    series[place] = reader.series(time, deceleration + gravity, means=True)
                if np.isnan(series[place]).any():
                    failures[place] = "its trace has no peak"
    for place, (row, reason) in enumerate(zip(rows, failures, strict=True)):
        lacking = [name for name in measures if row.get(name) is None]
        if reason is None and lacking:
            failures[place] = f"it has no {lacking[0]}"
        if failures[place] is not None:
            figures[place] = series[place] = np.nan
    return Runs(values, series, figures, np.array(failures, dtype=object))


def traces_of(found: Sweep) -> dict[int, tuple[Array, Array]]:
    """Time [s] and raw deceleration [m/s2] of each drop, from the histories of a sweep."""
    found_traces = found.traces(["time_s", "deceleration_m_s2"])
    return {member: (time, deceleration) for member, _, (time, deceleration) in found_traces}
