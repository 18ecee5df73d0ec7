"""What a crack costs: limits of bonds by their length, and bonds that hold beyond their limits."""

import math

import numpy as np
import pytest
from bench import Bench, bench, numerics

from taichi_foam.engine import transfer
from taichi_foam.engine.grading import limits
from taichi_foam.laws.bond import Limit
from taichi_foam.scene import Base, Block, Foam, Numerics, Output, Scene, Start
from taichi_foam.simulation.simulate import run

K, E_T = 2.78e6, 0.05  # Table 1
TOUGHNESS = 2 * K * E_T**2 * 0.005  # J/m2: what bonds of 5 mm hold, four times
Z = 0.057
ROWS = 3


def two_columns(dx: float, dy: float, foam: Foam, times: float = 1e-4) -> Scene:
    """Two columns of mass points that fly apart, with ten times what 100 J/m2 between them take.

    Nothing else takes energy: no dashpots, no impactor, no strain within a column. A step moves
    them by the part `times` of a cell.
    """
    mass = Block(mass_points="cells").density * dx * dy * Z
    speed = math.sqrt(10 * 100.0 * dy * Z / mass)  # m v^2 a row
    return Scene(
        block=Block(mass_points="cells", width=2 * dx, height=ROWS * dy, columns=2, rows=ROWS),
        foam=foam,
        base=Base(kind="floor", friction=0.0),
        numerics=Numerics(end=dx / speed, damping_time=0.0, dt=times * dx / speed),
        start=Start(velocity_gradient=((2 * speed / dx, 0.0), (0.0, 0.0))),
        output=Output(history_interval=max(1e-7, 0.05 * dx / speed), snapshot_interval=1.0),
    )


@pytest.mark.parametrize(
    ("dx", "dy", "given"),
    [
        (0.0025, 0.0025, None),
        (0.00125, 0.00125, None),
        (0.002, 0.005, None),
        (0.005, 0.005, None),
        (0.010, 0.005, None),
        (0.005, 0.005, 90.0),
        (0.001, 0.003, 20.0),
    ],
)
def test_opening_a_crack_costs_the_fracture_energy(dx: float, dy: float, given: float) -> None:
    """The area under the stress, whatever the cell; a bond's length is what counts.

    In a step of 1e-4 of a cell a bond strains by 1e-4 of its length twice over: its share of the
    face is late by one step, 2e-4 / (e_f - e_t) of the area or 0.2 % and less; 1 % allows for the
    corners too. All of it is in the ledger's fracture.
    """
    history = run(two_columns(dx, dy, Foam(fracture_energy=given))).history
    face = ROWS * dy * Z
    taken = history["foam_kinetic_J"][0] - history["foam_kinetic_J"][-1]
    assert history["broken_bonds"][-1] == ROWS
    assert taken / face == pytest.approx(given or TOUGHNESS, rel=0.01)
    assert history["fracture_J"][-1] / face == pytest.approx(given or TOUGHNESS, rel=0.01)
    assert np.abs(history["residual_J"]).max() < 1e-3 * taken


@pytest.mark.parametrize(
    ("dx", "share"), [(0.00125, 4.0), (0.005, 1.0), (0.010, 0.5), (0.020, 0.25)]
)
def test_brittle_bonds_of_any_length_hold_the_same_over_their_face(dx: float, share: float) -> None:
    """K e^2 dx / 2 at break is that of 5 mm: what they take when they break, a fourth of the cost.

    They break within a step of 2e-5 of a cell, 4e-5 of strain or 0.16 % of the energy at 0.05.
    """
    scene = two_columns(dx, 0.005, Foam(softening=False), times=2e-5)
    history = run(scene).history
    assert history["broken_bonds"][-1] == ROWS
    taken = history["foam_kinetic_J"][0] - history["foam_kinetic_J"][-1]
    assert taken / (ROWS * 0.005 * Z) == pytest.approx(0.25 * TOUGHNESS, rel=0.01)
    for a, b in limits(scene.foam, scene.block):
        assert a == Limit(pytest.approx(math.sqrt(share), rel=1e-12), 1.0)
        assert b == Limit()


def test_limits_go_by_the_length_of_the_bond_along_each_axis() -> None:
    """(K e_t^2 / 2) L in tension and (G gamma_t^2 / 2) L in shear, over the energies.

    Bonds that soften hold at least 4 and 2 times that, long ones at limits that are lower.
    """
    foam = Foam(fracture_energy=130.0, shear_fracture_energy=42.0)
    scene = two_columns(0.002, 0.008, foam)
    tension, shear = limits(scene.foam, scene.block)
    held = 0.5 * K * E_T**2 * np.array([0.002, 0.008])
    for limit, energy in zip(tension, held, strict=True):
        assert limit == Limit(1.0, pytest.approx(130.0 / energy))
    held = 0.5 * 0.84e6 * 0.1**2 * np.array([0.002, 0.008])
    assert shear[0] == Limit(1.0, pytest.approx(42.0 / held[0]))
    assert shear[1] == Limit(pytest.approx(math.sqrt(42.0 / held[1] / 2.0)), 2.0)


@pytest.mark.parametrize("softening", [True, False])
def test_cells_of_the_paper_have_the_limits_of_table_1(softening: bool) -> None:
    """Exactly: a factor of 1 changes no bit."""
    scene = Scene(foam=Foam(softening=softening), numerics=Numerics(end=1e-3))
    tension, shear = limits(scene.foam, scene.block)
    assert tension == (Limit(1.0, 4.0 if softening else 1.0),) * 2
    assert shear == (Limit(1.0, 2.0 if softening else 1.0),) * 2


def test_unloading_goes_to_the_origin_and_compression_is_whole() -> None:
    """Foam that has lost a part of its face in tension: a line to zero, and K below it.

    At 0.1 in cells of 2.5 mm the stress has come down from K e_t at 0.05 on its way to nothing at
    0.4: 6 / 7 of K e_t.
    """
    scene = two_columns(0.0025, 0.0025, Foam()).model_copy(
        update={"numerics": numerics(dt=1e-12, damping_time=0.0)}
    )

    def force(strain: float, loaded: Bench) -> float:
        """Of a bond at this strain [N], by what a step of 1e-12 s does to its node."""
        state = transfer.take(loaded.lattice, 0)
        position = scene.block.positions.copy()
        position[..., 0] *= 1 + strain
        values = {**vars(state), "position": position, "velocity": np.zeros_like(position)}
        transfer.load(loaded.lattice, 0, scene, type(state)(**values))
        transfer.set_pause(loaded.lattice, np.array([1.0]))
        speed = loaded.step(1).velocity[0, 1, 0]
        return speed * scene.block.node_mass / 1e-12

    with bench(scene) as loaded:
        area = 0.0025 * Z
        force(0.1, loaded)  # what is lost counts from the next step on
        assert force(0.1, loaded) == pytest.approx(area * K * E_T * 6 / 7, rel=1e-6)
        assert force(0.05, loaded) == pytest.approx(area * K * E_T * 3 / 7, rel=1e-6)
        assert force(-0.02, loaded) == pytest.approx(-area * K * 0.02, rel=1e-6)
        kept = transfer.take(loaded.lattice, 0).intact_a[0, 1]
        assert kept == pytest.approx(3 / 7, rel=1e-6)  # 32 bits
