"""Foam that springs back, dropped on five times: a level cushion against its energy balance.

In drop k a mass m falls by h on to a cushion that has come back to the set S e_(k-1), and crushes
it to e_k. It loses m g (h + T (e_k - S e_(k-1))). The foam takes the area W under its curve up to
e_k, less what it has lost before: of W(e_(k-1)) the part (1 - S) (1 + SHAPE HU) / (1 + SHAPE) has
been given back and is taken again. Where that is more than the fall brings, the mass stops on the
way back, short of e_(k-1).

What the balance leaves out: waves, and dashpots of half a per cent of the plateau or less.
"""

import numpy as np
import pytest

import taichi_foam as tf
from taichi_foam.laws.bond import Curve
from taichi_foam.laws.bond.recovering import RecoveringFoam
from taichi_foam.records.history import DISSIPATIONS
from taichi_foam.results.result import Result
from taichi_foam.scene import Block, FlatBlock, Model, Output, Scene, Start
from taichi_foam.units import STANDARD_GRAVITY

STRAIN = np.array([0.0, 0.05, 0.2, 0.4, 0.6, 0.7, 0.8, 0.9])
STRESS = np.array([0.0, 60e3, 80e3, 120e3, 220e3, 360e3, 800e3, 3e6])
FACTOR, SHAPE, SET = 0.25, 2.0, 0.1
THICK, WIDE, DEEP, STATIC, HEIGHT = 0.05, 0.025, 0.05, 4e3, 0.5
FINE = np.linspace(0.0, 0.9, 90_001)
CURVE = np.interp(FINE, STRAIN, STRESS)


def areas(stress: np.ndarray) -> np.ndarray:
    return np.append(0.0, np.cumsum(0.5 * (stress[1:] + stress[:-1]) * np.diff(FINE)))


TAKEN = areas(CURVE)


def scene_of(wait: float = 0.0, **foam: float) -> Scene:
    return Scene(
        name="recovering",
        block=Block(width=WIDE, height=THICK, depth=DEEP, density=25.0),
        foam=RecoveringFoam(
            curve=Curve(strain=STRAIN, stress=STRESS),
            hysteresis_factor=FACTOR, hysteresis_shape=SHAPE, permanent_set=SET,
            tensile_strain=0.5, shear_strain=2.0, **foam,
        ),
        impactor=FlatBlock(
            width=2 * WIDE, mass=STATIC * WIDE * DEEP / STANDARD_GRAVITY, drop_height=HEIGHT,
            friction=0.0,
        ),
        model=Model(self_contact=False),
        start=Start(wait=wait),
        output=Output(film=False),
    )  # fmt: skip


def balance(before: float) -> tuple[float, float]:
    """Strain and peak deceleration [g] of a drop after one that has left the strain `before`."""
    start = SET * before
    lost = STATIC * (HEIGHT / THICK + FINE - start)
    if before == 0.0:
        stress = CURVE
        taken = TAKEN
    else:
        x = np.clip((FINE - start) / (1.0 - SET), 0.0, before)
        share = np.interp(x, FINE, TAKEN) / np.interp(before, FINE, TAKEN)
        back = np.interp(x, FINE, CURVE) * (FACTOR + (1.0 - FACTOR) * share**SHAPE)
        stress = np.where(start > FINE, 0.0, np.where(before > FINE, back, CURVE))
        taken = areas(stress)
    stop = int(np.argmax((taken >= lost) & (start < FINE)))
    return float(FINE[stop]), float(stress[stop]) / STATIC - 1.0


def check_ledger(result: Result) -> None:
    """It closes to 5e-4 of the impact's energy, and nothing lost comes back."""
    impactor, history = result.scene.impactor, result.history
    energy = 0.5 * impactor.mass * impactor.velocity**2
    assert np.abs(history.residual_J).max() < 5e-4 * energy
    for column in DISSIPATIONS:
        lost = history[column.name]
        assert (np.maximum.accumulate(lost) - lost).max() < 1e-6 * energy, column.name


@pytest.fixture(scope="module")
def drops() -> list[Result]:
    return tf.run_drops(scene_of(), 5)


def test_five_drops_meet_the_energy_balance(drops: list[Result]) -> None:
    """Strain and peak within 3 %; each drop reaches a little further, from where the set is."""
    before = 0.0
    for number, drop in enumerate(drops):
        strain, g = balance(before)
        height = drop.run["after"]["contact_height_m"] if number else THICK
        assert height == pytest.approx(THICK * (1.0 - SET * before), abs=2e-3 * THICK)
        reached = 1.0 - (height - drop.summary["max_displacement_m"]) / THICK
        assert reached == pytest.approx(strain, rel=0.03)
        assert drop.summary["peak_deceleration_g"] == pytest.approx(g, rel=0.03)
        assert drop.summary["broken_bonds"] == 0
        before = max(before, reached)


def test_the_ledger_closes_and_nothing_lost_comes_back(drops: list[Result]) -> None:
    for drop in drops:
        check_ledger(drop)
