"""Compaction fronts against the jump conditions (Rankine and Hugoniot; Reid and Peng 1997)."""

import pytest
from verification.jump import front
from verification.shock import DENSITY, LOCKING, PAPER, Shock, measure, scene

from taichi_foam.simulation.simulate import run


@pytest.mark.parametrize("velocity", [100.0, 150.0])
def test_stress_behind_a_front_is_that_of_rigid_locking_foam(velocity: float) -> None:
    """sigma_p + rho v^2 / e_d, within 5 %, of foam that is nearly rigid and nearly locks at 0.80.

    The elastic precursor brings foam to 2.3 m/s, which takes 2 * 2.3 / v = 4.7 % off rho v^2 at
    100 m/s, and the foam locks anywhere within 0.01 of 0.80, 1.3 % of it: together 4 % of the
    stress, of which the plateau is a third; less at 150 m/s. The jump conditions for the law itself
    know of both. They hold within 0.5 %: a thick front takes long to become quite steady.
    """
    bar = Shock(LOCKING, velocity, length=0.75)
    found = measure(bar, run(scene(bar)))
    assert found.stress == pytest.approx(bar.locking_stress, rel=0.05)
    assert found.stress == pytest.approx(bar.front.stress, rel=0.005)
    assert found.strain == pytest.approx(bar.front.strain, rel=0.005)
    assert found.dissipated == pytest.approx(1.0, abs=0.01)


@pytest.mark.parametrize(("cell", "length"), [(0.010, 1.0), (0.005, 0.75)])
def test_a_front_does_not_depend_on_the_cells(cell: float, length: float) -> None:
    """Stress and strain are the jump's. The width is the dashpots', its two ends to half a cell."""
    bar = Shock(PAPER, 100.0, cell, length=length)
    found = measure(bar, run(scene(bar)))
    assert found.stress == pytest.approx(bar.front.stress, rel=0.005)
    assert found.strain == pytest.approx(bar.front.strain, rel=0.005)
    assert found.speed == pytest.approx(bar.front.speed, rel=0.01)
    assert found.thickness == pytest.approx(bar.thickness, abs=cell)


def test_the_jump_conditions_tend_to_rigid_locking() -> None:
    """Ever stiffer foam that locks ever more sharply; it dissipates sigma_p e_d + rho v^2 / 2."""
    foam = LOCKING.model_copy(
        update={
            "youngs_modulus": 139e9,
            "yield_strain": -1e-6,
            "densification_strain": -0.79999,
            "locking_strain": -0.80001,
        }
    )
    found = front(foam, DENSITY, 100.0)
    assert found.stress == pytest.approx(139e3 + DENSITY * 100.0**2 / 0.8, rel=1e-4)
    assert found.dissipated == pytest.approx(139e3 * 0.8 + 0.5 * DENSITY * 100.0**2, rel=1e-4)
