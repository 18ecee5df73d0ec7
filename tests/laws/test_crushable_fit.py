"""Eq. 26 fitted to curves: its own constants come back, and what a test does not say is said."""

from __future__ import annotations

import numpy as np
import pytest

from taichi_foam.engine.stresses import normal_stresses
from taichi_foam.laws.bond import Curve
from taichi_foam.laws.bond.fit import crushable_fit
from taichi_foam.laws.bond.kinds.crushable import Foam
from taichi_foam.scene import Scene
from taichi_foam.scene.options import Numerics

OTHER = Foam(
    youngs_modulus=6e6,
    yield_strain=-0.03,
    densification_strain=-0.65,
    locking_strain=-0.93,
    densification_a=0.8,
    densification_b=0.7,
)
CONSTANTS = (
    "youngs_modulus", "yield_strain", "densification_strain", "locking_strain",
    "densification_a", "densification_b",
)  # fmt: skip


def curve_of(foam: Foam, tested: float, points: int, noise: float = 0.0) -> Curve:
    strain = np.linspace(0.0, tested, points)
    factor = 1.0 + noise * np.random.default_rng(3).standard_normal(points)
    return Curve(strain=strain, stress=foam.loading(strain) * factor)


@pytest.mark.parametrize("foam", [Foam(), OTHER], ids=["paper", "other"])
def test_stresses_are_those_of_the_law(foam: Foam) -> None:
    strain = np.linspace(0.0, 0.98, 197)  # the guard of locking included
    scene = Scene(foam=foam, numerics=Numerics(end=1e-3))
    law = -normal_stresses(scene, -strain, -strain)
    np.testing.assert_allclose(foam.loading(strain), law, rtol=1e-9, atol=1e-6)


@pytest.mark.parametrize("foam", [Foam(), OTHER], ids=["paper", "other"])
@pytest.mark.parametrize("tested", [0.87, 0.92])
def test_a_curve_of_the_law_gives_its_constants_back(foam: Foam, tested: float) -> None:
    fit = crushable_fit(curve_of(foam, tested, 200))
    for key in CONSTANTS:
        assert getattr(fit.foam, key) == pytest.approx(getattr(foam, key), rel=0.01), key
    assert fit.densifies
    assert fit.error < 1e-3


def test_noise_moves_the_fit_little() -> None:
    fit = crushable_fit(curve_of(Foam(), 0.9, 300, noise=0.02))
    assert fit.foam.youngs_modulus == pytest.approx(Foam().youngs_modulus, rel=0.03)
    assert fit.foam.plateau_stress == pytest.approx(Foam().plateau_stress, rel=0.02)
    assert fit.foam.densification_strain == pytest.approx(-0.8, rel=0.03)
    assert fit.error < 0.02


def test_a_test_that_ends_on_the_plateau_says_nothing_of_densification() -> None:
    fit = crushable_fit(curve_of(OTHER, 0.5, 100))
    assert not fit.densifies
    assert fit.foam.youngs_modulus == pytest.approx(OTHER.youngs_modulus, rel=0.01)
    assert fit.foam.plateau_stress == pytest.approx(OTHER.plateau_stress, rel=0.01)
    for key in CONSTANTS[2:]:
        assert getattr(fit.foam, key) == pytest.approx(getattr(Foam(), key)), key
