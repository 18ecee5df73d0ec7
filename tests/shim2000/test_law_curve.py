"""Fig. 19's curves against Eq. 26 in closed form."""

from __future__ import annotations

import numpy as np
import pytest

from taichi_foam import paper_scene
from taichi_foam.shim2000.figures import branches

K = 2.78e6
YIELD = -0.0425  # of a plateau of 0.118 MPa
PLATEAU = -K * YIELD


def test_branches_follow_the_law() -> None:
    first, back, again = branches(paper_scene("paper/wedge-2.86")).values()
    strain, stress = first
    elastic, dense = strain > YIELD, strain < -0.8
    np.testing.assert_allclose(stress[elastic], K * strain[elastic], atol=1e-6)
    np.testing.assert_allclose(stress[~elastic & ~dense], -PLATEAU)
    e = strain[dense]
    np.testing.assert_allclose(stress[dense], -PLATEAU * np.exp(0.5 * (-0.8 - e) / (e + 0.95)))
    assert 3.5 * PLATEAU < -stress[-1] <= 4 * PLATEAU
    # Unloading from 40 % along the elastic slope; then to half the tensile strain, at K e_t / 2.
    np.testing.assert_allclose(back[1], K * (back[0] + 0.4 + YIELD), atol=1e-6)
    assert (again[0][0], again[1][0]) == pytest.approx((-0.4 - YIELD, 0.0))
    assert (again[0][-1], again[1][-1]) == pytest.approx((0.025, 0.0695e6))
