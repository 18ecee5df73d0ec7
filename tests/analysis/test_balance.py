"""The energy balance by hand against closed forms, and beside runs of the engine."""

from __future__ import annotations

import numpy as np
import pytest

import taichi_foam as tf
from taichi_foam.analysis.balance import balance, doubt
from taichi_foam.laws.bond import Curve
from taichi_foam.laws.bond.kinds.tabulated import TabulatedFoam
from taichi_foam.scene import Base, Block, Cylinder, FlatBlock, Foam, Output, Scene, Support
from taichi_foam.units import STANDARD_GRAVITY

WIDTH, HEIGHT, DEPTH = 0.15, 0.05, 0.1
AREA = WIDTH * DEPTH
FALL = 0.76
HARDENING = 4e5  # Pa


def curve(strain: list[float], stress: list[float]) -> TabulatedFoam:
    return TabulatedFoam(curve=Curve(strain=strain, stress=stress))


def hardens() -> TabulatedFoam:
    """Stress HARDENING times strain, to a strain of 0.9."""
    strain = np.linspace(0.0, 0.9, 91).tolist()
    return curve(strain, [HARDENING * each for each in strain])


def cushion(foam: object, mass: float, **impactor: object) -> Scene:
    return Scene(
        block=Block(width=WIDTH, height=HEIGHT, depth=DEPTH, cell=0.005),
        foam=foam,
        impactor=FlatBlock(**{"width": 0.2, "mass": mass, "drop_height": FALL} | impactor),
        base=Base(kind="gripped"),
        output=Output(film=False),
    )


def test_foam_that_hardens() -> None:
    """m g (h + T e) = A T H e^2 / 2, a quadratic for e; the peak is A H e / m - g."""
    mass = 6.0
    a, b, c = 0.5 * AREA * HEIGHT * HARDENING, -mass * 9.80665 * HEIGHT, -mass * 9.80665 * FALL
    strain = (-b + (b * b - 4 * a * c) ** 0.5) / (2 * a)
    found = balance(cushion(hardens(), mass))
    assert found.static_stress == pytest.approx(mass * 9.80665 / AREA)
    assert found.strain == pytest.approx(strain, rel=1e-9)
    peak = AREA * HARDENING * strain / mass - 9.80665
    assert found.peak == pytest.approx(peak, rel=1e-9)


def test_foam_with_a_plateau() -> None:
    """The paper's foam at a velocity without gravity: m v^2 / 2 = A T s (e - e_y / 2)."""
    foam, mass, velocity = Foam(), 8.0, 3.0
    stress = foam.plateau_stress
    scene = cushion(foam, mass, drop_height=None, velocity=velocity)
    strain = 0.5 * mass * velocity**2 / (AREA * HEIGHT * stress) - 0.5 * foam.yield_strain
    found = balance(scene)
    assert found.strain == pytest.approx(strain, rel=1e-9)
    assert found.peak == pytest.approx(AREA * stress / mass)


@pytest.mark.parametrize(
    ("foam", "mass", "impactor"),
    [(hardens(), 50.0, {}), (Foam(), 5000.0, {"drop_height": None, "velocity": 300.0})],
)
def test_foam_that_cannot_take_it_has_no_peak(foam: object, mass: float, impactor: dict) -> None:
    """The one takes 150 J until its test ends, and 390 J fall on it; the other locks at 95 %."""
    found = balance(cushion(foam, mass, **impactor))
    assert (found.strain, found.peak) == (None, None)


def test_a_drop_that_uses_up_the_foam_is_asked_about() -> None:
    """The velocity at which the foam's energy up to its densification is used up, and more."""
    foam, mass = Foam(), 5.0
    strain = np.linspace(0.0, -foam.used_up_strain, 10_001)
    taken = AREA * HEIGHT * float(np.trapezoid(foam.loading(strain), strain))
    limit = (2.0 * taken / mass) ** 0.5
    for share, asks in ((0.99, False), (1.01, True)):
        scene = cushion(foam, mass, drop_height=None, velocity=share * limit)
        assert (doubt(scene) is not None) == asks
    assert "masses are in kilograms" in str(doubt(scene))


@pytest.mark.parametrize(
    "scene",
    [
        cushion(Foam(), 6.0, width=0.1),
        cushion(Foam(), 6.0, guided=False),
        cushion(Foam(), 6.0).with_values(impactor=Cylinder(radius=0.2)),
        cushion(Foam(), 6.0).with_values(
            support=Support(kind="ribs", pitch=0.05, width=0.02, depth=0.02), base__kind="floor"
        ),
        cushion(Foam(), 6.0).with_values(
            block=Block(
                width=0.3,
                height=0.3,
                depth=DEPTH,
                lattice_angle_deg=10.0,
                outline=[(-0.075, 0.0), (0.075, 0.0), (0.075, 0.05), (-0.075, 0.05)],
            )
        ),
        cushion(Foam(), 6.0).with_values(
            block__outline=[(-0.075, 0.0), (0.075, 0.0), (0.05, 0.05), (-0.05, 0.05)]
        ),
    ],
    ids=["narrower", "turns", "cylinder", "ribs", "turned lattice", "outline"],
)
def test_where_there_is_none_by_hand(scene: Scene) -> None:
    assert balance(scene) is None


@pytest.fixture(scope="module")
def drops() -> list[tf.Result]:
    """Two, one after the other, on foam that hardens."""
    return tf.run_drops(cushion(hardens(), 6.0), 2)


def test_a_run_says_it_beside_its_own(drops: list[tf.Result]) -> None:
    """Within 1.5 % of each other: waves, the foam's mass and its dashpots are left out by hand."""
    figures = drops[0].summary
    assert figures["peak_deceleration_g"] == pytest.approx(figures["balance_peak_g"], rel=0.015)
    assert figures["max_strain"] == pytest.approx(figures["balance_strain"], rel=0.015)
    assert figures["balance_peak_m_s2"] == figures["balance_peak_g"] * STANDARD_GRAVITY
    said = figures["statement"]
    assert said.startswith(
        "cushion 50 x 150 x 100 mm (height, width, depth), static stress 3.92 kPa; by energy "
    )
    assert f"{figures['balance_peak_g']:.1f} g at" in said
    assert f"computed raw {figures['peak_deceleration_g']:.1f} g at" in said
    # by hand only of a fresh cushion
    assert drops[1].summary["balance_peak_g"] is None
    assert "cushion" not in drops[1].summary["statement"]


def test_foam_that_hardens_has_not_bottomed_out_in_the_middle_of_its_test(
    drops: list[tf.Result],
) -> None:
    """At 60 % strain it presses with far more than its plateau's stress, and hardens on."""
    figures = drops[0].summary
    assert 0.5 < figures["max_strain"] < 0.7
    assert figures["bottomed_out"] is False
    # The stress only rises: the first milliseconds have no peak of their own.
    assert figures["initial_peak_m_s2"] is None
    deep = tf.run(cushion(hardens(), 18.0)).summary
    assert deep["bottomed_out"] is True


def test_a_mass_that_is_put_down_at_rest_sinks_to_twice_its_static_strain() -> None:
    """A linear spring under a sudden load: twice the static way, and 1 g upwards there."""
    scene = cushion(hardens(), 6.0, drop_height=None, velocity=1.0)
    found = balance(scene.with_values(numerics__gravity=STANDARD_GRAVITY, impactor__velocity=0.0))
    static = 6.0 * STANDARD_GRAVITY / AREA / HARDENING
    assert found.strain == pytest.approx(2 * static, rel=1e-9)
    assert found.peak == pytest.approx(STANDARD_GRAVITY, rel=1e-9)


def test_the_thickness_is_that_between_the_rows() -> None:
    """Ten rows in cells of a tenth of the height: a cushion of nine tenths of it."""
    scene = cushion(Foam(), 8.0, drop_height=None, velocity=3.0)
    strains = []
    for points, rows in (("faces", 11), ("cells", 10)):
        found = balance(scene.with_values({"block.mass_points": points, "block.rows": rows}))
        strains.append(found.strain + 0.5 * Foam().yield_strain)
    assert strains[1] == pytest.approx(strains[0] / 0.9, rel=1e-9)
