"""A curve that ends in a jump goes on with finite stresses."""

from __future__ import annotations

import numpy as np

from taichi_foam.laws.bond import Curve
from taichi_foam.laws.bond.tabulated import TabulatedFoam


def test_a_jump_at_the_end_stays_finite() -> None:
    curve = Curve(strain=(0.0, 0.05, 0.5, 0.50001), stress=(0.0, 1e5, 1.1e5, 1e7))
    table = TabulatedFoam(curve=curve).table
    assert np.isfinite(table).all()
    assert (np.diff(table[:, 0]) > 0.0).all()


def test_a_curve_that_ends_level_locks_all_the_same() -> None:
    """The last stress fell, and was raised to the one before: a slope of its own would be none."""
    curve = Curve(strain=[0, 0.05, 0.5, 0.7, 0.71], stress=[0, 1e5, 1.2e5, 6e5, 5.9e5])
    stress = curve.table(0.93, 1e6, 1e9, 1e6)[:, 0]
    assert stress[900] > 1.5 * curve.stress[-1]
    level = Curve(strain=[0, 0.05, 0.6], stress=[0, 1e5, 1e5]).table(0.9, 1e6, 1e9, 1e6)[:, 0]
    assert level[890] > 2 * level[600]
