"""Foam between a node and its support: elastic, plateau, and stiff once packed."""

import numpy as np
import pytest
from law_bench import constants, piece

from taichi_foam.scene import Foam

pytestmark = pytest.mark.usefixtures("taichi_runtime")

CELL = 0.005


@pytest.mark.parametrize(
    ("touch", "gap", "stress"),
    [
        # whole cells: strains 0, -0.02, -0.05, -0.5, -0.8; then 0.1 beyond, at 4 K
        (0.005, [5e-3, 4.9e-3, 4.75e-3, 2.5e-3, 1e-3, 0.5e-3], [0, -55.6, -139, -139, -139, -1251]),
        # crushed to 1 mm: packed at 0.2 mm, 0.02 of a cell before the centres meet
        (0.001, [1e-3, 0.9e-3, 0.75e-3, 0.2e-3, 0.1e-3], [0, -55.6, -139, -139, -361.4]),
        # powder of 0.2 mm: packed at 0.04 mm while still elastic, at 0.032; a plateau never comes
        (0.0002, [0.2e-3, 0.1e-3, 0.04e-3, 0.02e-3], [0, -55.6, -88.96, -144.56]),
    ],
)
def test_numbers_worked_out_by_hand(touch: float, gap: list, stress: list) -> None:
    """In kPa; strains count in cells, also in foam that crushing has made low."""
    found = piece(constants(), np.array(gap), touch, CELL)
    np.testing.assert_allclose(found, 1e3 * np.array(stress), rtol=1e-9, atol=1e-6)


@pytest.mark.parametrize("touch", [0.0002, 0.001, 0.004, 0.005])
@pytest.mark.parametrize("foam", [Foam(), Foam(youngs_modulus=7e6, densification_strain=-0.5)])
def test_the_push_grows_with_every_approach_and_never_by_a_jump(touch: float, foam: Foam) -> None:
    """From nothing at touch; no slope beyond 5 K a cell, as the step size counts on."""
    gap = np.linspace(touch, 0.0, 10_001)
    push = -piece(constants(foam), gap, touch, CELL)
    assert push[0] == 0.0
    assert np.all(push[1:] > 0.0)
    rise = np.diff(push)
    assert np.all(rise >= -1e-9 * push[1:])
    assert rise.max() <= 5.001 * foam.youngs_modulus * touch / 10_000 / CELL


def test_the_plateau_is_the_foams_own_until_it_packs() -> None:
    foam = Foam(youngs_modulus=4e6, yield_strain=-0.03, densification_strain=-0.6)
    gap = np.linspace(0.97 * CELL, 0.4 * CELL, 50)
    push = piece(constants(foam), gap, CELL, CELL)
    np.testing.assert_allclose(push, -0.12e6, rtol=1e-12)
    packed = piece(constants(foam), np.array([0.3 * CELL]), CELL, CELL)
    assert packed[0] == pytest.approx(-0.12e6 - 0.1 * 16e6)
