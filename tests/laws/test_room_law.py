"""The room that a cell keeps: its pressure, and the energy that it stores."""

import numpy as np
import pytest
from law_bench import constants, kept, pressed
from scipy.integrate import quad

from taichi_foam.laws.bond import BondFoam, Curve
from taichi_foam.scene import Foam, RecoveringFoam, TabulatedFoam

pytestmark = pytest.mark.usefixtures("taichi_runtime")

CURVE = Curve(strain=(0.0, 0.05, 0.5, 0.7, 0.9), stress=(0.0, 1e5, 1.5e5, 3e5, 2e6))
FOAMS = (Foam(), TabulatedFoam(curve=CURVE), RecoveringFoam(curve=CURVE, hysteresis_factor=0.2))

AREAS = np.linspace(-0.5, 1.0, 61)
ROOMS = np.concatenate([np.linspace(1.0, 0.8, 41), np.linspace(0.79, 0.1, 70)])


@pytest.mark.parametrize("foam", FOAMS, ids=lambda foam: foam.law)
def test_crushing_the_bonds_of_a_folded_cell_gives_it_no_energy(foam: BondFoam) -> None:
    """Its room falls at the same area, which takes no work."""
    bound = constants(foam)
    energies = np.array([kept(bound, AREAS, room) for room in ROOMS])
    assert energies[0].max() > 1e4  # whole foam that is folded, too
    # tables of the energy interpolate between the strains of a curve
    assert np.diff(energies, axis=0).max() <= 1e-6 * energies.max()


@pytest.mark.parametrize("room", [1.0, 0.9, 0.3])
@pytest.mark.parametrize("foam", FOAMS, ids=lambda foam: foam.law)
def test_the_energy_is_the_work_of_the_pressure(foam: BondFoam, room: float) -> None:
    bound = constants(foam)
    for area in (0.75, 0.5, 0.2, 0.05):
        work, _ = quad(
            lambda at: pressed(bound, np.array([at]), room)[0], area, room,
            points=[1.0 - strain for strain in CURVE.strain[1:] if area < 1.0 - strain < room],
            limit=200,
        )  # fmt: skip
        assert kept(bound, np.array([area]), room)[0] == pytest.approx(work, rel=1e-3, abs=1.0)
