"""What moves by command: a crosshead, which makes a compression test, and a base that is shaken."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
import pytest
from bench import assert_same, interrupt_at, small_scene
from rich.console import Console
from scipy.signal import lsim, lti

import taichi_foam as tf
from taichi_foam.analysis.loads import compression_curve
from taichi_foam.catalogue import load_scene
from taichi_foam.cli.tables import key_figures
from taichi_foam.errors import UserError
from taichi_foam.laws.bond import Curve
from taichi_foam.results.result import Result
from taichi_foam.scene import Base, Block, FlatBlock, Foam, Numerics, Output, Scene, TabulatedFoam
from taichi_foam.scene.files import scene_to_toml
from taichi_foam.scene.measured import read_curve
from taichi_foam.scene.options import Pulse
from taichi_foam.simulation.simulate import run
from taichi_foam.units import STANDARD_GRAVITY

CURVE = ((0.0, 0.05, 0.3, 0.6, 0.8), (0.0, 0.1e6, 0.12e6, 0.18e6, 0.4e6))
GAUGE = 0.095  # m, from the first to the last row
OUTLINE = [(-0.0125, 0), (0.0125, 0), (0.0125, 0.1), (-0.0125, 0.1)]
CROSSHEAD = FlatBlock(width=0.08, velocity=0.5, motion="crosshead", travel=0.6 * GAUGE, friction=0)
FILES = Output(history_interval=2e-4, snapshot_interval=0.02, film=False)


@pytest.fixture(scope="module")
def pressed() -> Result:
    """Slowly: rho c v is 1 % of the plateau."""
    foam = TabulatedFoam(curve=Curve(strain=CURVE[0], stress=CURVE[1]))
    scene = Scene(
        block=Block(width=0.05, height=GAUGE),
        foam=foam,
        impactor=CROSSHEAD,
        numerics=Numerics(damping_time=4e-6),
        output=FILES,
    )
    return run(scene)


def test_a_crosshead_gives_the_foams_curve_back(pressed: Result, tmp_path: Path) -> None:
    found = compression_curve(pressed)
    assert found is not None
    strain, stress = found
    assert strain[-1] == pytest.approx(0.6, abs=1e-3)
    upper = strain > 0.08
    exact = np.interp(strain[upper], *CURVE)
    assert np.abs(stress[upper] / exact - 1).mean() < 0.01
    assert np.abs(stress[upper] / exact - 1).max() < 0.06  # it rings
    pressed.save(tmp_path / "test")
    again = read_curve(tmp_path / "test" / "compression.csv")
    assert again.plateau_stress == pytest.approx(pressed.scene.foam.curve.plateau_stress, rel=0.03)
    assert tf.load(tmp_path / "test").scene == pressed.scene


@pytest.mark.parametrize(
    ("block", "height", "area"),
    [
        ({"mass_points": "faces"}, 0.1, 0.05 * 0.057),
        ({"outline": OUTLINE}, 0.5 * (0.1 + GAUGE), 0.025 * 0.057),
        ({}, GAUGE, 0.05 * 0.057),
    ],
    ids=["faces", "outline", "cells"],
)
def test_the_curve_is_over_what_there_is(block: dict, height: float, area: float) -> None:
    """Height between the faces that are touched, area of the foam under the plate.

    The plate meets an outline itself, while the base holds the first row of mass points.

    The paper's foam has its plateau, with the dashpots that nobody gave.
    """
    plain = small_scene().block
    scene = Scene(
        block=plain.model_validate({**plain.model_dump(), **block}),
        foam=Foam(),
        impactor=CROSSHEAD,
        numerics=Numerics(),
        output=FILES,
    )
    found = run(scene)
    curve = compression_curve(found)
    assert curve is not None
    strain, stress = curve
    assert strain[-1] == pytest.approx(0.6 * GAUGE / height, abs=1e-3)
    late = strain > 0.2
    assert stress[late].mean() == pytest.approx(2.78e6 * 0.05, rel=0.02)
    force = found.history["contact_force_N"][-len(strain) :][late].mean()
    assert stress[late].mean() == pytest.approx(force / area, rel=0.01)


def test_a_shaken_block_alone_closes_its_ledger() -> None:
    """Nothing is booked for an impactor that is not there."""
    pulse = Pulse(time=(0.0, 1e-3, 2e-3), acceleration=(0.0, 300.0, 0.0))
    scene = small_scene(
        base=Base(kind="gripped", acceleration=pulse), numerics=Numerics(end=3e-3), output=FILES
    )
    history = run(scene).history
    assert np.abs(history["base_J"]).max() > 0.0
    assert np.abs(history["residual_J"]).max() < 1e-3 * np.abs(history["base_J"]).max()


def test_a_crosshead_keeps_its_speed_and_its_work_is_booked(pressed: Result) -> None:
    history = pressed.history
    assert (history["velocity_m_s"] == 0.5).all()
    assert history["time_s"][-1] == pytest.approx(0.6 * GAUGE / 0.5, rel=1e-3)
    force, way = history["contact_force_N"], history["displacement_m"]
    work = float((0.5 * (force[1:] + force[:-1])) @ np.diff(way))
    assert history["base_J"][-1] == pytest.approx(-work, rel=0.01)
    assert abs(pressed.summary["energy_residual"]) < 1e-4
    assert not pressed.warnings


def half_sine(peak: float, duration: float, points: int = 401) -> Pulse:
    time = np.linspace(0.0, duration, points)
    return Pulse(time=time.tolist(), acceleration=(peak * np.sin(np.pi * time / duration)).tolist())


def above_a_shaken_floor() -> Scene:
    """An impactor far above a block that a falling base leaves."""
    return small_scene(
        impactor=FlatBlock(width=0.08, mass=0.3, velocity=0.0, gap=1.0),
        base=Base(kind="floor", friction=0.0, acceleration=half_sine(-2000.0, 5e-3)),
        numerics=Numerics(end=6e-3, damping_time=0.0),
        output=FILES,
    )


def test_a_pulse_gives_all_that_is_free_its_integral() -> None:
    """In the frame of the base both impactor and block rise."""
    scene = above_a_shaken_floor()
    result, pulse = run(scene), scene.base.acceleration
    given = np.trapezoid(pulse.acceleration, pulse.time)
    assert result.history["velocity_m_s"][-1] == pytest.approx(given, rel=1e-6)
    last = result.snapshots[-1]
    np.testing.assert_allclose(last.velocity[..., 1], -given, rtol=1e-6)
    np.testing.assert_allclose(last.velocity[..., 0], 0.0, atol=1e-9)
    h = result.history
    gained = h["impactor_kinetic_J"] + h["foam_kinetic_J"]
    np.testing.assert_allclose(-h["base_J"], gained, atol=1e-6 * gained.max())


def test_a_mass_on_elastic_foam_answers_a_half_sine_as_one_degree_of_freedom() -> None:
    """x'' + w^2 x = -a: x = A / (w^2 - W^2) (sin W t - W / w sin w t), downwards.

    The mass is 300 times the block's. Springs in series: the block, and the contact's penalty.
    """
    peak, duration, mass = 400.0, 5e-3, 4.0
    scene = small_scene(
        impactor=FlatBlock(width=0.08, mass=mass, velocity=0.0, friction=0.0),
        base=Base(kind="held", acceleration=half_sine(peak, duration)),
        foam=Foam(),
        numerics=Numerics(end=duration, damping_time=0.0),
        output=FILES,
    )
    block, modulus = scene.block, scene.foam.youngs_modulus
    section = block.width * block.depth
    springs = [modulus * section / GAUGE, 40.0 * modulus * block.depth * block.columns]
    w = np.sqrt(1.0 / sum(1.0 / k for k in springs) / mass)
    W = np.pi / duration
    history = run(scene).history
    t = history["time_s"]
    exact = peak / (w**2 - W**2) * (np.sin(W * t) - W / w * np.sin(w * t))
    assert exact.max() < 0.045 * GAUGE
    np.testing.assert_allclose(history["displacement_m"], exact, atol=0.01 * exact.max())
    total = history["impactor_kinetic_J"].max()
    assert np.abs(history["residual_J"]).max() < 1e-4 * total


def on_a_table(pulse: str, peak_g: float, duration_ms: float, **numerics: float) -> Scene:
    """A product at rest on light, linear elastic foam, on a table that a pulse shakes."""
    plain = small_scene().block
    return Scene(
        block=plain.model_validate({**plain.model_dump(), "density": 5.0}),
        foam=Foam(youngs_modulus=2e6, yield_strain=-0.3),
        impactor=FlatBlock(width=0.08, mass=0.3, velocity=0.0, friction=0.0),
        base=Base(kind="held", pulse=pulse, pulse_peak_g=peak_g, pulse_duration_ms=duration_ms),
        numerics=Numerics(end=0.014, damping_time=0.0, **numerics),
        output=FILES.model_copy(update={"history_interval": 1e-4}),
    )


def exact_peak(scene: Scene) -> tuple[float, float]:
    """Largest acceleration [m/s2] and squeeze x [m] of x'' = a - w^2 x, the base's a, by scipy."""
    block, impactor, pulse = scene.block, scene.impactor, scene.base.shaking
    assert impactor is not None
    assert pulse is not None
    modulus, section = 2e6, block.width * block.depth
    springs = [modulus * section / GAUGE, 40.0 * modulus * block.depth * block.columns]
    square = 1.0 / sum(1.0 / k for k in springs) / impactor.mass
    time = np.linspace(0.0, scene.numerics.end, 20_001)
    shaken = np.interp(time, pulse.time, pulse.acceleration, left=0.0, right=0.0)
    system = lti([[0.0, 1.0], [-square, 0.0]], [[0.0], [1.0]], [[1.0, 0.0]], [[0.0]])
    _, x, _ = lsim(system, shaken, time)
    return square * float(np.max(x)), float(np.max(x))


@pytest.mark.parametrize(
    ("pulse", "share"), [("half-sine", 2.0 / np.pi), ("trapezoid", 0.9), ("sawtooth", 0.5)]
)
def test_a_product_on_a_shaken_base_has_its_own_g(pulse: str, share: float) -> None:
    """Its absolute acceleration is that of one degree of freedom, not that seen from the table."""
    scene = on_a_table(pulse, 20.0, 11.0)
    result = run(scene)
    found = result.summary
    peak, squeeze = exact_peak(scene)
    assert peak > 1.15 * 20.0 * STANDARD_GRAVITY  # it differs from the table's
    assert found["peak_deceleration_m_s2"] == pytest.approx(peak, rel=0.02)
    assert found["peak_deceleration_g"] == pytest.approx(peak / STANDARD_GRAVITY, rel=0.02)
    assert found["peak_deceleration_cfc180_m_s2"] == pytest.approx(peak, rel=0.02)
    assert found["max_strain"] == pytest.approx(squeeze / GAUGE, rel=0.02)
    history, mass = result.history, scene.impactor.mass
    force = history["contact_force_N"].max() / mass
    assert found["peak_deceleration_m_s2"] == pytest.approx(force, rel=0.02)
    assert found["base_peak_g"] == pytest.approx(20.0)
    change = share * 20.0 * STANDARD_GRAVITY * 11e-3
    assert found["base_velocity_change_m_s"] == pytest.approx(change, rel=1e-4)
    given = np.cumsum(history["contact_force_N"] * np.diff(history["time_s"], prepend=0.0)) / mass
    assert found["velocity_change_m_s"] == pytest.approx(given.max(), rel=0.02)


def test_a_shaken_base_has_no_impact() -> None:
    """What belongs to an impact has no answer, and the sentence and the table leave it out."""
    found = run(on_a_table("half-sine", 20.0, 11.0)).summary
    for key in (
        "came_to_rest", "impact_duration_s", "plateau_deceleration_m_s2", "initial_peak_m_s2",
        "energy_absorbed_J", "energy_per_volume_J_m3", "rebound_velocity_m_s", "restitution",
        "equivalent_drop_height_m",
    ):  # fmt: skip
        assert found[key] is None, key
    said = found["statement"]
    assert "base was shaken with a peak of 20.0 g and a velocity change of 1.37 m/s" in said
    assert "came to rest" not in said
    assert "plateau" not in said


def test_gravity_is_no_shock() -> None:
    """A product that gravity presses on its cushion has the g of the pulse, no more."""
    peak, _ = exact_peak(on_a_table("half-sine", 20.0, 11.0))
    scene = on_a_table("half-sine", 20.0, 11.0, gravity=STANDARD_GRAVITY)
    found = run(scene).summary
    # it falls into the cushion at the start: by up to 1 g of its own
    assert abs(found["peak_deceleration_m_s2"] - peak) < 1.2 * STANDARD_GRAVITY


@pytest.mark.parametrize(
    ("base", "words"),
    [
        ({"pulse": "half-sine", "pulse_peak_g": 50.0}, r"needs base\.pulse_duration_ms"),
        ({"pulse_peak_g": 50.0}, r"base\.pulse_peak_g: belongs to base\.pulse"),
        ({"pulse": "square", "pulse_peak_g": 50.0}, "half-sine, trapezoid, sawtooth"),
        (
            {"pulse": "sawtooth", "pulse_peak_g": -1.0, "pulse_duration_ms": 11.0},
            "this is in g of 9.80665",
        ),
        (
            {
                "pulse": "sawtooth", "pulse_peak_g": 1.0, "pulse_duration_ms": 11.0,
                "acceleration": {"time": [0.0, 1.0], "acceleration": [0.0, 1.0]},
            },
            "leave one of the two out",
        ),
        ({"pulse": "sawtooth", "pulse_peak_g": 1.0, "pulse_duration_ms": 1.0}, r"numerics\.end"),
    ],
)  # fmt: skip
def test_a_pulse_that_cannot_be_is_refused(base: dict, words: str) -> None:
    scene = Scene(impactor=FlatBlock())
    with pytest.raises(UserError, match=words):
        scene.with_values({f"base.{key}": value for key, value in base.items()})


def test_a_shaped_pulse_is_written_as_it_was_given(tmp_path: Path) -> None:
    scene = on_a_table("trapezoid", 40.0, 6.0)
    write_scene = tmp_path / "shaken.toml"
    write_scene.write_text(scene_to_toml(scene))
    again = load_scene(write_scene)
    assert again == scene
    assert 'pulse = "trapezoid"' in write_scene.read_text()
    harder = again.with_values({"base.pulse_peak_g": 80.0})
    assert harder.base.shaking.peak == pytest.approx(80.0 * STANDARD_GRAVITY)
    assert harder.base.shaking.time == pytest.approx((0.0, 0.6e-3, 5.4e-3, 6e-3))


def test_the_velocity_of_the_base_is_the_integral_of_its_pulse() -> None:
    """Between its points, at them, before and after, against a fine sum."""
    pulse = Pulse(time=(1e-3, 2e-3, 5e-3, 6e-3), acceleration=(10.0, 50.0, -20.0, 0.0))
    fine = np.linspace(0.0, 8e-3, 800_001)
    level = np.interp(fine, pulse.time, pulse.acceleration, left=0.0, right=0.0)
    summed = np.append(0.0, np.cumsum(0.5 * (level[1:] + level[:-1]) * np.diff(fine)))
    some = np.array([0.0, 0.5e-3, 1e-3, 1.7e-3, 2e-3, 4.4e-3, 6e-3, 8e-3])
    np.testing.assert_allclose(pulse.velocity(some), np.interp(some, fine, summed), atol=1e-6)


def test_a_crosshead_is_told_in_stress_and_strain(pressed: Result) -> None:
    """Nothing of g: it is not slowed down."""
    found = pressed.summary
    curve = compression_curve(pressed)
    assert curve is not None
    assert found["peak_stress_Pa"] == curve[1].max()
    assert found["peak_stress_strain"] == curve[0][np.argmax(curve[1])]
    force = pressed.history["contact_force_N"].max()
    assert found["peak_stress_force_N"] == pytest.approx(force, rel=1e-9)
    assert [key for key in found if key.endswith("_g") and found[key] is not None] == []
    assert "largest stress was" in found["statement"]
    assert " g " not in found["statement"]
    assert "moving" not in found["statement"]
    console = Console(width=100, file=io.StringIO())
    console.print(key_figures(pressed.scene, found))
    shown = console.file.getvalue()
    assert "largest stress" in shown
    assert "deceleration" not in shown
    assert " g\n" not in shown
    assert "drop height" not in shown


def test_an_interrupted_shaken_run_goes_on(tmp_path: Path) -> None:
    scene = above_a_shaken_floor()
    run(scene, interrupt_at(0.3), checkpoint=tmp_path)
    assert_same(tf.resume(tmp_path), run(scene))


def test_a_pulse_comes_from_a_file(tmp_path: Path) -> None:
    (tmp_path / "pulse.csv").write_text("time [ms],acceleration [g]\n0,0\n5,10\n10,0\n")
    (tmp_path / "shaken.toml").write_text(
        '[impactor]\nshape = "flat"\nvelocity = 0.0\n'
        '[base]\nacceleration = "pulse.csv"\n[numerics]\nend = 0.02\n'
    )
    scene = load_scene(tmp_path / "shaken.toml")
    assert scene.base.acceleration.time == pytest.approx((0.0, 5e-3, 0.01))
    assert scene.base.acceleration.acceleration == pytest.approx((0.0, 98.0665, 0.0))
    (tmp_path / "pulse.csv").write_text("time [ms],acceleration [g]\n0,0\n5,ten\n")
    with pytest.raises(UserError, match=r"line 3: 'ten' in column 2: must be a number"):
        load_scene(tmp_path / "shaken.toml")
    (tmp_path / "pulse.csv").write_text("0,0\n5,1\n5,2\n")
    with pytest.raises(UserError, match="must be above 5 s"):
        load_scene(tmp_path / "shaken.toml")
    (tmp_path / "pulse.csv").write_text("time [h],acceleration [g]\n0,0\n5,1\n")
    with pytest.raises(UserError, match="must be one of s, ms"):
        load_scene(tmp_path / "shaken.toml")


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"impactor.motion": "crosshead"}, "give impactor.travel"),
        ({"impactor.travel": 0.01}, "is for a crosshead only"),
        (
            {"impactor.motion": "crosshead", "impactor.travel": 0.01, "impactor.velocity": 0.0},
            "a crosshead moves",
        ),
        (
            {"impactor.motion": "crosshead", "impactor.travel": 0.01, "numerics.end": 1.0},
            "give one of the two",
        ),
        (
            {"impactor.motion": "crosshead", "impactor.travel": 0.1, "impactor.guided": False},
            "straight down",
        ),
        ({"base.acceleration": {"time": [0.0, 1.0], "acceleration": [0.0, 1.0]}}, "numerics.end"),
    ],
)
def test_what_cannot_be_driven_so_is_refused(values: dict, words: str) -> None:
    with pytest.raises(UserError, match=words):
        Scene(impactor=FlatBlock()).with_values(values)


def test_a_changed_speed_gives_a_new_end() -> None:
    scene = Scene(impactor=CROSSHEAD)
    assert scene.numerics.end == pytest.approx(0.6 * GAUGE / 0.5)
    faster = scene.with_values(impactor__velocity=1.0)
    assert faster.numerics.end == pytest.approx(0.6 * GAUGE)
