"""Impactors without rails: free flight, plane impact, symmetry, energy, and a run that goes on."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from bench import PLAIN, bench, numerics, small_scene
from reference_lattice import reference_positions

from taichi_foam.analysis.impact import impactor_now, way_down
from taichi_foam.engine import transfer
from taichi_foam.engine.state import State
from taichi_foam.records.ending import Ending
from taichi_foam.records.record import Record
from taichi_foam.records.snapshot import Snapshot
from taichi_foam.results.result import Result
from taichi_foam.scene import (
    Block,
    Cylinder,
    Ellipse,
    FlatBlock,
    Impactor,
    IShape,
    Numerics,
    Outline,
    Output,
    Scene,
    Wedge,
)
from taichi_foam.simulation.simulate import run

OFTEN = Output(history_interval=1e-5, snapshot_interval=1e-3)


def dropped(impactor: Impactor, end: float = 5e-3, gravity: float = 0.0, **parts: object) -> Scene:
    given = {"numerics": Numerics(end=end, gravity=gravity), "output": OFTEN, "impactor": impactor}
    return small_scene(**{**given, **parts})


def product(**values: object) -> FlatBlock:
    """A block as impactor, too wide and light for its turn to matter little."""
    given = {"mass": 0.2, "velocity": 4.0, "width": 0.03, "height": 0.05, "guided": False}
    return FlatBlock(**{**given, **values})


@pytest.mark.parametrize("gravity", [0.0, 9.81])
def test_free_flight_is_exact(gravity: float) -> None:
    """A parabola and an even turn, which Runge-Kutta follows exactly: only rounding is left.

    Energy is kept, and so is the angular momentum about the centre of mass. Each step rounds it by
    half an ulp at most.
    """
    body = product(gap=0.02, velocity=0.5, velocity_x=0.3, spin=40.0, rotation_deg=20.0)
    result = run(dropped(body, 0.02, gravity))
    h, t = result.history, result.history.time_s
    assert result.run["steps"] > 400
    assert not h.contact_force_N.any()
    np.testing.assert_allclose(h.displacement_m, 0.5 * t + 0.5 * gravity * t**2, atol=1e-15)
    np.testing.assert_allclose(h.velocity_m_s, 0.5 + gravity * t, rtol=1e-12)
    np.testing.assert_allclose(h.displacement_x_m, 0.3 * t, rtol=1e-12)
    np.testing.assert_allclose(h.angle_rad, 40.0 * t, rtol=1e-12)
    assert np.ptp(h.spin_rad_s) == 0.0
    assert np.ptp(h.velocity_x_m_s) == 0.0
    energy = 0.5 * 0.2 * (0.5**2 + 0.3**2) + 0.5 * body.moment_of_inertia * 40.0**2
    assert h.impactor_kinetic_J[0] == pytest.approx(energy, rel=1e-14)
    rounding = 0.5 * np.finfo(float).eps * result.run["steps"]
    np.testing.assert_allclose(h.residual_J, 0.0, atol=rounding * energy)
    last = result.snapshots[-1]
    assert last.impactor_angle == pytest.approx(40.0 * last.time, rel=1e-12)
    assert last.impactor_shift == pytest.approx(0.3 * last.time, rel=1e-12)


@pytest.mark.parametrize(("friction", "order"), [(0.0, 4.0), (1.0, 3.0)])
def test_a_body_that_rocks_on_foam_is_followed_to_the_order_of_the_integrator(
    friction: float, order: float
) -> None:
    """Pressed into elastic foam that it does not leave, so that nothing but springs acts.

    Its edges lie between mass points, none of which comes onto their arcs. Friction springs, which
    stick here, stretch along the chord of each step: of order three.
    """
    time = 1e-3
    body = product(
        mass=2.0, inertia=1e-4, width=0.032, x=0.004, velocity=0.2, spin=2e-3, velocity_x=2e-3,
        friction=friction,
    )  # fmt: skip
    soft = numerics(damping_time=1e-6, contact_stiffness=0.5)
    scene = small_scene(numerics=soft, impactor=body)
    position = reference_positions(scene) + np.array([0.0, 5e-6])

    def state(steps: int) -> np.ndarray:
        given = scene.numerics.model_copy(update={"dt": time / steps})
        rare = Output(history_interval=time / 2, snapshot_interval=1.0)
        with bench(
            scene.model_copy(update={"numerics": given, "output": rare}), position=position
        ) as loaded:
            loaded.step(steps)
            found = transfer.take(loaded.lattice, 0)
            assert found.overlap.max() > 4e-6
            assert found.clock["broken"] == 0
            return np.array(
                [
                    *(found.body["y"], found.body["v"] * time),
                    *(found.turn["x"], found.turn["u"] * time),
                    *(found.turn["angle"] * 0.03, found.turn["spin"] * 0.03 * time),
                ]
            )

    counts = np.array([200, 283, 400, 566])
    exact = state(3200)
    errors = [np.abs(state(n) - exact).max() for n in counts]
    found = -np.polyfit(np.log(counts), np.log(errors), 1)[0]
    assert found == pytest.approx(order, abs=0.15)


def rod(lever: float, **values: object) -> Outline:
    """A rod of 200 mm with a nose, 4 mm wide and high, that meets one mass point."""
    left, right = lever - 0.002, lever + 0.002
    corners = (
        (-0.1, 0.004), (left, 0.004), (left, 0.0), (right, 0.0), (right, 0.004), (0.1, 0.004),
        (0.1, 0.014), (-0.1, 0.014),
    )  # fmt: skip
    given = {"mass": 0.2, "velocity": 0.02, "friction": 0.0, "guided": False}
    return Outline(vertices=corners, x=0.0025 - lever, **{**given, **values})


def plate(*rectangles: tuple[float, float, float, float]) -> tuple[np.ndarray, float]:
    """Centroid [m] and squared radius of gyration [m2] of rectangles (x, y, width, height)."""
    boxes = np.array(rectangles)
    area = boxes[:, 2] * boxes[:, 3]
    middle = boxes[:, :2] + boxes[:, 2:] / 2
    centre = area @ middle / area.sum()
    own = (boxes[:, 2:] ** 2).sum(axis=1) / 12
    apart = ((middle - centre) ** 2).sum(axis=1)
    return centre, float(area @ (own + apart) / area.sum())


@pytest.mark.parametrize("damping_time", [0.0, None], ids=["elastic", "damped"])
@pytest.mark.parametrize("lever", [0.05, -0.08])
def test_a_rod_that_strikes_off_centre_meets_the_closed_form(
    lever: float, damping_time: float | None
) -> None:
    """J = m v (1 + e) / (1 + m d^2 / I), delta v = J / m, delta spin = J d / I.

    By a spring without loss e is 1; foam of 7 g takes 1 % along as waves. The rod turns by 1e-3
    rad and moves by 0.1 mm while it touches: so much is left of the closed form's instant.
    """
    speed = 0.02
    given = {} if damping_time is None else {"damping_time": damping_time}
    body = rod(lever, velocity=speed)
    h = run(dropped(body, numerics=Numerics(end=12e-3, **given))).history
    centre, gyration = plate((-0.1, 0.004, 0.2, 0.01), (lever - 0.002, 0.0, 0.004, 0.004))
    d, m = lever - centre[0], 0.2
    inertia = m * gyration
    np.testing.assert_allclose(body.centre_of_mass, centre, rtol=1e-12)
    assert body.moment_of_inertia == pytest.approx(inertia, rel=1e-12)
    assert h.contact_force_N[-1] == 0.0
    assert h.broken_bonds[-1] == 0
    impulse = m * (h.velocity_m_s[0] - h.velocity_m_s[-1])
    assert h.spin_rad_s[-1] == pytest.approx(impulse * d / inertia, rel=2e-4)
    assert abs(h.velocity_x_m_s[-1]) < 1e-3 * speed
    struck = h.velocity_m_s - h.spin_rad_s * d  # the nose, downwards
    e = -struck[-1] / struck[0]
    assert impulse == pytest.approx(m * speed * (1 + e) / (1 + m * d**2 / inertia), rel=2e-4)
    if damping_time == 0.0:
        assert impulse == pytest.approx(2 * m * speed / (1 + m * d**2 / inertia), rel=0.01)
    else:
        assert 0.9 < e < 0.98


def test_a_body_that_falls_flat_and_centred_moves_as_one_on_rails() -> None:
    fixed = Numerics(end=4e-3, dt=1e-6)
    # a dashpot acts at once where bodies meet: they are to meet in the midst of a step
    free, guided = (
        run(dropped(product(velocity=2.0, gap=1.05e-5, guided=guided), numerics=fixed)).history
        for guided in (False, True)
    )
    assert guided.contact_force_N.max() > 50.0
    for name in ("displacement_m", "velocity_m_s", "contact_force_N", "foam_kinetic_J"):
        scale = np.abs(guided[name]).max()
        np.testing.assert_allclose(free[name], guided[name], rtol=0, atol=1e-11 * scale)
    assert "angle_rad" not in guided


def test_a_symmetric_drop_stays_symmetric_to_the_last_bit() -> None:
    """A wedge that breaks foam: it never turns nor moves sideways."""
    wedge = Wedge(mass=0.2, velocity=4.0, shank_width=0.03, height=0.05, guided=False)
    result = run(dropped(wedge, 6e-3))
    assert result.history.broken_bonds[-1] > 0
    for name in ("displacement_x_m", "velocity_x_m_s", "angle_rad", "spin_rad_s"):
        assert not result.history[name].any(), name
    position = result.snapshots[-1].position
    np.testing.assert_array_equal(position, position[::-1] * [-1.0, 1.0])


@pytest.fixture(scope="module")
def tilted() -> tuple[Result, Result]:
    """A tilted body that spins and slides and breaks foam, and its mirror image."""
    one, other = (
        run(
            dropped(
                product(
                    rotation_deg=side * 20, x=side * 0.004, spin=-side * 15, velocity_x=side * 0.5
                ),
                4.5e-3,
                gravity=9.81,
            )
        )
        for side in (1, -1)
    )
    return one, other


def test_the_ledger_closes_in_a_tilted_drop(tilted: tuple[Result, Result]) -> None:
    """To a thousandth of the impact energy, with rotation and sideways motion in it."""
    h = tilted[0].history
    assert h.broken_bonds[-1] > 0
    assert h.friction_J[-1] > 0.01 * h.impactor_kinetic_J[0]
    assert np.ptp(h.spin_rad_s) > 10.0
    np.testing.assert_allclose(h.residual_J, 0.0, atol=1e-3 * h.impactor_kinetic_J[0])


def test_a_mirrored_drop_gives_the_mirror_image(tilted: tuple[Result, Result]) -> None:
    """To rounding, which 4.5 ms of breaking foam enlarge."""
    one, other = tilted
    for name in ("displacement_x_m", "velocity_x_m_s", "angle_rad", "spin_rad_s"):
        scale = np.abs(one.history[name]).max()
        np.testing.assert_allclose(one.history[name], -other.history[name], atol=1e-9 * scale)
    np.testing.assert_allclose(one.history.velocity_m_s, other.history.velocity_m_s, atol=1e-9)
    position = other.snapshots[-1].position[::-1] * [-1.0, 1.0]
    np.testing.assert_allclose(one.snapshots[-1].position, position, rtol=0, atol=1e-12)


def test_a_turning_body_goes_on_from_its_state_to_the_last_bit(
    tilted: tuple[Result, Result],
) -> None:
    """Taken in the midst of contact, turned into arrays and back, put where another one was."""
    one, other = (result.scene for result in tilted)
    with bench(one) as loaded:
        loaded.step(400)
        kept = State.from_arrays(transfer.take(loaded.lattice, 0).to_arrays())
        loaded.step(400)
        whole = transfer.take(loaded.lattice, 0)
    assert kept.body["force"] != 0.0
    with bench(other) as loaded:
        loaded.step(100)
        transfer.load(loaded.lattice, 0, one, kept)
        transfer.set_pause(loaded.lattice, np.full(1, 1e30))
        loaded.step(400)
        continued = transfer.take(loaded.lattice, 0)
    assert (continued.turn, continued.body) == (whole.turn, whole.body)
    for name, values in whole.to_arrays().items():
        if not name.startswith("neighbours"):
            np.testing.assert_array_equal(values, continued.to_arrays()[name], err_msg=name)


def test_a_result_of_a_turning_body_is_stored_and_loaded(
    tilted: tuple[Result, Result], tmp_path: Path
) -> None:
    result = tilted[0]
    loaded = Result.load(result.save(tmp_path / "drop"))
    assert tuple(loaded.history) == tuple(result.history)
    for name, column in result.history.items():
        np.testing.assert_array_equal(column, loaded.history[name], err_msg=name)
    assert loaded.snapshots[-1].impactor_angle == result.snapshots[-1].impactor_angle
    assert loaded.summary["final_angle_rad"] == result.history.angle_rad[-1]
    assert loaded.summary["final_spin_rad_s"] == result.history.spin_rad_s[-1]
    resultant = loaded.summary["peak_resultant_m_s2"]
    assert resultant >= loaded.summary["peak_deceleration_m_s2"]


@pytest.mark.parametrize("tilt", [0.0, 15.0])
def test_the_support_throws_a_body_back(tilt: float) -> None:
    """With the block out of the way, from just above the bottom.

    Flat, it swings as on rails: v / w deep for half a swing. Tilted by t, it falls on a corner at
    a lever d and is thrown back as fast as it came: by J d / I, to the 3 % by which the lever
    changes while it turns by 4 degrees. What is exact is the energy.
    """
    speed, dt = 3.0, 2e-7
    stiff = numerics(contact_stiffness=40.0, dt=dt)
    body = product(velocity=speed, mass=6.0, rotation_deg=tilt)
    scene = small_scene(impactor=body, numerics=stiff)
    aside = reference_positions(scene) + np.array([1.0, 0.0])
    lever = body.outline()[np.argmin(body.outline()[:, 1]), 0] - body.centre_of_mass[0]
    with bench(scene, position=aside) as loaded:
        start = transfer.take(loaded.lattice, 0)
        transfer.load(loaded.lattice, 0, scene, replace(start, body={**start.body, "y": 1e-4}))
        transfer.set_pause(loaded.lattice, np.full(1, 1e30))
        deepest = 0.0
        for _ in range(240):
            loaded.step(10)
            now = transfer.take(loaded.lattice, 0)
            deepest = min(deepest, now.body["y"])
        u, v, spin = now.turn["u"], now.body["v"], now.turn["spin"]
        inertia = body.moment_of_inertia
        energy = 3.0 * (u**2 + v**2) + 0.5 * inertia * spin**2
        assert now.body["support_work"] == pytest.approx(3.0 * speed**2 - energy, abs=1e-4)
        assert u == 0.0
    if tilt == 0.0:
        w = math.sqrt(40 * 2.78e6 * 0.057 / scene.block.node_mass) / 20
        light = 1 + 6.0 * body.reach**2 / inertia  # the spring is softer by so much
        assert deepest == pytest.approx(-speed / w * math.sqrt(light), rel=1e-3)
        assert v == pytest.approx(speed, rel=1e-4)
        assert spin == 0.0
    else:
        impulse = 6.0 * (v + speed)
        assert spin == pytest.approx(impulse * lever / inertia, rel=0.05)
        assert v + spin * lever == pytest.approx(speed, rel=0.05)


def test_a_light_rod_that_swings_about_its_end_is_stable() -> None:
    """As light as a few mass points, it whirls away from where it hits: the automatic step follows.

    It answers with a quarter of its mass at its ends.
    """
    light = rod(0.09, mass=5e-4, velocity=3.0)
    scene = dropped(light, 3e-3, numerics=Numerics(end=3e-3, damping_time=0.0))
    result = run(scene)
    h = result.history
    assert h.spin_rad_s.max() > 10.0
    np.testing.assert_allclose(h.residual_J, 0.0, atol=1e-2 * h.impactor_kinetic_J[0])


@pytest.mark.parametrize(
    "body",
    [
        IShape(guided=False, rotation_deg=100.0, spin=7.0),
        Ellipse(guided=False, rotation_deg=-30.0, centre=(0.01, 0.02)),
        Cylinder(guided=False, rotation_deg=50.0, centre=(0.01, 0.02)),
        Wedge(guided=False, rotation_deg=170.0),
    ],
    ids=lambda body: body.shape,
)
def test_where_a_body_is_drawn_is_where_it_is(body: Impactor) -> None:
    """Its lowest level comes down with the history: the outline about the centre of mass, turned.

    Mid-width and lowest level of the start are where the scene says.
    """
    body = body.model_copy(update={"velocity": 1.0, "gap": 0.2, "spin": 300.0})
    scene = dropped(body, model=PLAIN)
    start = Snapshot(0.0, 0.3, *(np.zeros((2, 2)),) * 7)
    first = impactor_now(start, scene)
    assert first is not None
    size = np.ptp(body.outline(), axis=0).max()
    assert first[:, 1].min() == pytest.approx(0.3, abs=1e-3 * size)
    assert first[:, 0].min() + first[:, 0].max() == pytest.approx(2 * body.x, abs=1e-3 * size)
    result = run(scene)
    record = Record(result.scene, result.history, result.snapshots, {})
    for snapshot, row in ((result.snapshots[0], 0), (result.snapshots[-1], -1)):
        outline = impactor_now(snapshot, result.scene)
        assert outline is not None
        fallen = result.scene.contact_height + 0.2 - outline[:, 1].min()
        assert fallen == pytest.approx(way_down(record)[row], abs=1e-3 * size)


def test_a_rod_slaps_down_before_its_run_ends() -> None:
    """Tilted by 6 degrees: its low end strikes and rises, then the other one comes down.

    A run until the rebound is not over between the two.
    """
    low = product(width=0.18, height=0.02, rotation_deg=6.0, mass=0.5, velocity=1.0)
    until = Numerics(end="rebound", gravity=9.81)
    result = run(
        dropped(low, block=Block(mass_points="cells", columns=20, rows=10), numerics=until)
    )
    h, figures = result.history, result.summary
    pressed = np.flatnonzero(h.contact_force_N > 1.0)
    turned = np.diff(np.sign(h.spin_rad_s[pressed]))
    assert h.spin_rad_s.min() < -5.0
    assert h.spin_rad_s.max() > 5.0
    assert turned.any()
    assert np.diff(h.time_s[pressed]).max() > 3e-3
    assert figures["came_to_rest"]
    assert not figures["passed_through"]
    assert result.ending == Ending.REBOUND


def test_a_body_that_falls_past_the_block_says_so() -> None:
    """Sideways off the block before it has come down: the floor stops it, not the foam."""
    off = product(x=0.03, velocity=0.5, velocity_x=3.0, spin=-30.0)
    result = run(dropped(off, 0.15, gravity=9.81))
    assert result.history.contact_force_N.any()
    assert result.summary["passed_through"]
    assert not result.summary["bottomed_out"]
    assert any("fell past the block" in text for text in result.summary["warnings"])
