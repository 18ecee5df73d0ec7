"""Strain rates over a crush band (foam.crush_band): dashpots and rate, whatever the cell."""

import numpy as np
import pytest
from bench import COLUMNS, ROWS

from taichi_foam.scene import Base, Block, Foam, Model, Numerics, Output, Scene, Start
from taichi_foam.simulation.simulate import run

K, E_Y, Z = 2.78e6, -0.05, 0.057
D, TAU = 1e5, 5e-7
SPEED = 200.0  # m/s, of each column against the next


def plateau(cell: float, band: float | None, tau: float, rate: float | None) -> float:
    """Mean stress [Pa] of columns that close from -0.2 to -0.5 of strain at a steady speed.

    They are so heavy and fast that crushing takes a few thousandths of their speed.
    """
    scene = Scene(
        block=Block(
            mass_points="cells",
            width=COLUMNS * cell,
            height=ROWS * cell,
            columns=COLUMNS,
            rows=ROWS,
            depth=Z,
            density=5000.0,
        ),
        foam=Foam(rate=rate, crush_band=band),
        base=Base(kind="floor", friction=0.0),
        model=Model(self_contact=False),
        numerics=Numerics(end=0.55 * cell / SPEED, damping_time=tau, dt=1e-4 * cell / SPEED),
        start=Start(velocity_gradient=((-SPEED / cell, 0.0), (0.0, 0.0))),
        output=Output(history_interval=0.02 * cell / SPEED, snapshot_interval=1.0),
    )
    # energy that crushing takes, over the volume of the bonds between the columns
    history = run(scene).history
    strain = SPEED / cell * history["time_s"]
    taken = history["foam_kinetic_J"][0] - history["foam_kinetic_J"]
    taken_between = np.interp(0.5, strain, taken) - np.interp(0.2, strain, taken)
    return taken_between / 0.3 / ((COLUMNS - 1) * ROWS * cell**2 * Z)


@pytest.mark.parametrize("cell", [0.005, 0.002])
@pytest.mark.parametrize("band", [None, 0.005, 0.004])
def test_rates_count_over_the_band(cell: float, band: float | None) -> None:
    """K |e_y| (1 + r / D), and tau K r more by the dashpots, r being the speed over the band.

    At the mean the columns are slower by 0.2 %, and the strain that their first speed would give
    is too large by as much: 1 % leaves some room.
    """
    rate = SPEED / (cell if band is None else band)
    flowing = K * -E_Y * (1.0 + rate / D)
    assert plateau(cell, band, 0.0, D) == pytest.approx(flowing, rel=0.01)
    viscous = K * -E_Y + TAU * K * rate
    assert plateau(cell, band, TAU, None) == pytest.approx(viscous, rel=0.01)
