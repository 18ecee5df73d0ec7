"""Which way a crack goes on from a cut, where a plate is pulled: theory against the lattice.

The first part of its way is to follow the largest hoop stress about the tip (Erdogan & Sih 1963,
J. Basic Engng 85:519). Foam with G = K / 2 is isotropic, without Poisson's effect.
"""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.optimize import brentq

import taichi_foam as tf
from taichi_foam.scene import Base, Block, Foam, Model, Numerics, Output, Scene, Start

SIZE, HALF = 0.2, 0.03  # of the plate, and of the cut [m]
RATE = 80.0  # 1/s; in the 0.5 ms until cracks run, waves cross the cut several times
BONDS = 6  # from the tip on: what theory speaks of


def kink(slant: float) -> float:
    """Angle [degrees] to the level at which a cut that rises by `slant` goes on.

    The load is upright: K_I and K_II go by the cosine and the sine of the slant.
    """
    modes = math.tan(math.radians(slant))
    turn = brentq(lambda angle: math.sin(angle) + modes * (3 * math.cos(angle) - 1), -1.3, 1e-9)
    return slant + math.degrees(turn)


def growth(slant: float) -> np.ndarray:
    """Middles (n, 2) of the bonds that broke at the right tip, from there, as they broke [m]."""
    tip = HALF * np.array([math.cos(math.radians(slant)), math.sin(math.radians(slant))])
    middle = np.array([0.0, 0.5 * SIZE])
    scene = Scene(
        block=Block(mass_points="cells", width=SIZE, height=SIZE, columns=100, rows=100),
        foam=Foam(
            shear_modulus=1.39e6,
            tensile_strain=0.03,
            shear_strain=2.0,
            crush_band=None,
            softening=False,
        ),
        base=Base(kind="held"),
        model=Model(self_contact=False, crushed_room=False),
        start=Start(
            velocity_gradient=((0.0, 0.0), (0.0, RATE)), cuts=((*(middle - tip), *(middle + tip)),)
        ),
        numerics=Numerics(end=6e-4),
        output=Output(snapshot_interval=6e-4, film=False),
    )
    last, X = tf.run(scene).snapshots[-1], scene.block.positions
    places = [0.5 * (X[1:] + X[:-1]), 0.5 * (X[:, 1:] + X[:, :-1])]
    times = [last.break_time_a, last.break_time_b]
    place = np.concatenate([found.reshape(-1, 2) for found in places]) - middle - tip
    time = np.concatenate([found.ravel() for found in times])
    grown = np.isfinite(time) & (time > 0.0) & (place[:, 0] > -0.2 * HALF)
    return place[grown][np.argsort(time[grown], kind="stable")]


@pytest.mark.parametrize(("slant", "within"), [(0.0, 1.0), (30.0, 6.0)])
def test_a_crack_starts_along_the_largest_hoop_stress(slant: float, within: float) -> None:
    """Level from a level cut; from a slanted one to the accuracy of steps from row to row."""
    first = growth(slant)[:BONDS]
    assert len(first) == BONDS
    angle = math.degrees(math.atan2(*first.sum(axis=0)[::-1]))
    assert angle == pytest.approx(kink(slant), abs=within)
