"""The energy balance of a drop on a level cushion: a hand calculation to compare with a run.

A mass m that hits the cushion at the velocity v and crushes its thickness T to the strain e loses
the energy m v^2 / 2 + m g T e. The foam under the area A absorbs A T times the area under its
stress-strain curve up to e. At the stop the two are equal; the deceleration follows from the stress
there and the mass. Waves, the foam's own mass and its dashpots are neglected.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from taichi_foam.analysis.impact import is_flat
from taichi_foam.formulas.energy import largest_until, stopping_strain
from taichi_foam.records.record import Record
from taichi_foam.scene import Scene
from taichi_foam.scene.motion import ends_of
from taichi_foam.units import STANDARD_GRAVITY

POINTS = 20_001
"""Number of strains, from 0 to 1, between which the curve of a foam is taken as linear."""


@dataclass(frozen=True)
class Balance:
    """The energy balance of a drop on a cushion.

    static_stress  Pa, weight over area
    strain         strain at the stop; None: the foam cannot absorb the energy
    peak           m/s2, the largest deceleration until then; None likewise
    """

    static_stress: float
    strain: float | None
    peak: float | None


def of_run(record: Record) -> Balance | None:
    """The balance of a drop on a fresh cushion; None after other drops, or if `balance` is None."""
    is_fresh = abs(record.lifted) <= 1e-9 * record.scene.block.height
    return balance(record.scene) if is_fresh else None


def balance(scene: Scene) -> Balance | None:
    """The energy balance of a scene; None if the scene is not suitable.

    It requires a level face on rails over the whole width of a rectangle of one foam on a level
    floor, and a foam law that gives its stress.
    """
    impactor, block = scene.impactor, scene.block
    if impactor is None or scene.is_driven or not impactor.guided or not is_flat(impactor):
        return None
    if block.outline or block.holes or block.layers or block.lattice_angle_deg != 0:
        return None
    if scene.support.kind != "floor" or not scene.start.is_at_rest:
        return None
    left, right = ends_of(impactor)
    half = 0.5 * block.width * (1.0 - 1e-9)
    if left > -half or right < half:
        return None
    strain = np.linspace(0.0, 1.0, POINTS)
    stress = scene.foam.loading(strain)
    if stress is None:
        return None
    area, gravity = block.width * block.depth, scene.numerics.gravity
    load = impactor.mass * gravity / area
    energy = 0.5 * impactor.mass * impactor.velocity**2 / area + load * impactor.gap
    stop = stopping_strain(strain, stress, energy / scene.thickness, load)
    static = impactor.mass * STANDARD_GRAVITY / area
    if stop is None or -stop <= scene.foam.landmarks.limit:
        return Balance(static, None, None)
    peak = area * largest_until(strain, stress, stop) / impactor.mass - gravity
    return Balance(static, stop, peak)


def doubt(scene: Scene) -> str | None:
    """A question to ask before computing a drop that uses up the cushion; None otherwise."""
    found, impactor = balance(scene), scene.impactor
    if found is None or impactor is None:
        return None
    if found.strain is not None and found.strain <= -scene.foam.used_up_strain:
        return None
    return (
        f"by energy balance, {impactor.mass:g} kg at {impactor.velocity:.3g} m/s is more than this "
        "foam can absorb: it will bottom out; check the units: masses are in kilograms (5,000 g "
        "is 5), lengths in metres (76 cm is 0.76), velocities in m/s"
    )
