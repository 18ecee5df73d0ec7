"""A pad's verdict by runs: an ensemble of drops, of which every one must stay below the fragility.

Velocities are spread within 0.5 %, as in an ensemble of `reproduce`, since broken foam is chaotic
and no drop is exactly as high as the next; strengths have other seeds where a foam scatters them.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from taichi_foam.analysis.bands import Band, band
from taichi_foam.cushions.scenes import cushion_scene
from taichi_foam.cushions.sizing import Pad
from taichi_foam.results.files import drop_name
from taichi_foam.results.result import Result
from taichi_foam.scene import Scene
from taichi_foam.simulation.simulate import Progress, simulate_many
from taichi_foam.sweeps.sampling import factors, seed_of

WITHIN = 0.005
"""Largest relative difference of a run's velocity from that of the drop height."""


@dataclass(frozen=True)
class Runs:
    """The runs of a pad, one value for each (n,); the largest of all drops, if there are several.

    pad       what was dropped on
    velocity  at first contact of the first drop [m/s]
    g         largest deceleration, filtered with `records.history.FILTER` [g]
    raw       the same unfiltered [g]
    strain    largest strain of the pad
    change    velocity change [m/s]; inf if it did not come to rest
    warnings  what makes the runs doubtful, each once
    """

    pad: Pad
    velocity: list[float]
    g: list[float]
    raw: list[float]
    strain: list[float]
    change: list[float]
    warnings: list[str]

    @property
    def below(self) -> int:
        """Number of runs whose filtered peak is below the fragility."""
        return sum(each < self.pad.wish.fragility for each in self.g)

    @property
    def hold(self) -> bool:
        """Whether all are below it."""
        return self.below == len(self.g)

    @property
    def band(self) -> Band:
        """Median and 5-95 % band of the filtered peaks [g]."""
        return band(self.g)


def scenes(pad: Pad, shape: str, count: int) -> list[Scene]:
    """The scenes of an ensemble on a pad, in order of velocity."""
    found = []
    side, wish = math.sqrt(pad.area), pad.wish
    for place, factor in enumerate(factors(count, WITHIN)):
        scene = cushion_scene(
            pad.foam.name,
            pad.thickness,
            wish.drop * factor**2,
            pad.static_stress,
            shape=shape,
            width=side,
            depth=side,
            density=pad.foam.density,
        )
        if scene.foam.strength_scatter > 0.0:
            seed = seed_of(scene.foam.strength_seed, place)
            scene = scene.with_values(foam__strength_seed=seed)
        found.append(scene)
    return found


def runs(
    pad: Pad,
    shape: str,
    count: int,
    on_progress: Callable[[Progress], None] | None = None,
    *,
    checkpoint: Path | None = None,
    arch: str | None = None,
    threads: int | None = None,
) -> Runs:
    """The runs of an ensemble on a pad; with a folder, runs that have ended are not repeated.

    Raises UserError, RunError as `simulate_many`; KeyboardInterrupt on Ctrl-C.
    """
    asked = scenes(pad, shape, count)
    drops: list[list[Result]] = []
    for number in range(pad.wish.drops):
        folder = None if checkpoint is None else checkpoint / drop_name(number + 1)
        before = drops[-1] if drops else ()
        ended = dict(
            simulate_many(
                asked, on_progress, after=before, checkpoint=folder, arch=arch, threads=threads
            )
        )
        drops.append([ended[place] for place in sorted(ended)])
        if any(result.failure for result in drops[-1]):
            break
    of_run = list(zip(*drops, strict=True))

    def largest(key: str) -> list[float]:
        """A figure of all runs; one that has none, as of a failed run, counts as larger."""
        figures = [[result.summary[key] for result in results] for results in of_run]
        return [math.inf if None in each else float(max(each)) for each in figures]

    filtered = largest("peak_deceleration_cfc180_g")
    # a run that failed has a peak so far, but may have had a larger one
    failed = [any(result.failure for result in results) for results in of_run]
    return Runs(
        pad,
        [scene.impactor.velocity for scene in asked if scene.impactor is not None],
        [math.inf if fails else g for fails, g in zip(failed, filtered, strict=True)],
        largest("peak_deceleration_g"),
        largest("max_strain"),
        largest("velocity_change_m_s"),
        list(dict.fromkeys(text for each in drops for result in each for text in result.warnings)),
    )
