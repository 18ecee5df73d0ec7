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
