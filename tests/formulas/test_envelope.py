"""The shoulder envelope of foams whose stress at each energy is known."""

from __future__ import annotations

import numpy as np
import pytest

from taichi_foam.errors import UserError
from taichi_foam.formulas.envelope import shoulder_envelope


def test_foams_that_lock_take_turns() -> None:
    """Plateaus that rise with the density: each is best up to its s e_D, then the next one."""
    plateaus, lockings = np.array([1e5, 2e5, 4e5]), np.array([0.8, 0.7, 0.5])
    shoulders = plateaus * lockings  # 80, 140, 200 kJ/m3
    curves = [([0.0, 0.0, e], [0.0, s, s]) for s, e in zip(plateaus, lockings, strict=True)]
    energy = np.array([1.0, 0.99, 1.01, 1.74, 1.76, 2.49, 2.51]) * shoulders[0]
    found = shoulder_envelope(curves, energy)
    assert found.foam.tolist() == [0, 0, 1, 1, 2, 2, -1]
    assert found.stress[:-1] == pytest.approx(plateaus[found.foam[:-1]], rel=1e-12)
    assert np.isnan(found.stress[-1])


def test_linear_foams() -> None:
    """sigma = sqrt(2 E W): the softest that reaches the energy E e^2 / 2 is best."""
    moduli, energy = np.array([8e5, 1e5, 3e5]), np.geomspace(1e2, 2e5, 30)
    curves = [([0.0, 0.3, 0.7], [0.0, 0.3 * m, 0.7 * m]) for m in moduli]
    found = shoulder_envelope(curves, energy)
    stress = np.sqrt(2.0 * moduli[:, None] * energy)
    stress[stress > 0.7 * moduli[:, None]] = np.inf
    best = stress.min(axis=0)
    inside = np.isfinite(best)
    assert found.stress[inside] == pytest.approx(best[inside], rel=1e-9)
    assert (found.foam == np.where(inside, stress.argmin(axis=0), -1)).all()
    assert np.isnan(found.stress[~inside]).all()


def test_what_is_no_family() -> None:
    with pytest.raises(UserError, match="no curves"):
        shoulder_envelope([], [1.0])
    with pytest.raises(UserError, match="at least 0"):
        shoulder_envelope([([0.0, 0.5], [0.0, 1e5])], [-1.0])
