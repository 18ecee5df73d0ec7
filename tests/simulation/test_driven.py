"""What moves by command: a crosshead, which makes a compression test, and a base that is shaken."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from bench import small_scene

import taichi_foam as tf
from taichi_foam.analysis.compression import compression_curve
from taichi_foam.catalogue import load_scene
from taichi_foam.errors import UserError
from taichi_foam.laws.bond import Curve
from taichi_foam.results.result import Result
from taichi_foam.scene import Base, FlatBlock, Foam, Model, Numerics, Output, Scene, TabulatedFoam
from taichi_foam.scene.measured import read_curve
from taichi_foam.scene.pulse import Pulse
from taichi_foam.simulation.simulate import Progress, run

CURVE = ((0.0, 0.05, 0.3, 0.6, 0.8), (0.0, 0.1e6, 0.12e6, 0.18e6, 0.4e6))
GAUGE = 0.095  # m, from the first to the last row
CROSSHEAD = FlatBlock(width=0.08, velocity=0.5, motion="crosshead", travel=0.6 * GAUGE, friction=0)
FILES = Output(history_interval=2e-4, snapshot_interval=0.02, film=False)


@pytest.fixture(scope="module")
def pressed() -> Result:
    """Slowly: rho c v is 1 % of the plateau."""
    foam = TabulatedFoam(curve=Curve(strain=CURVE[0], stress=CURVE[1]))
    scene = Scene(
        block=small_scene().block,
        foam=foam,
        impactor=CROSSHEAD,
        model=Model(crushed_room=False),
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
    ("block", "area"),
    [
        ({"mass_points": "faces"}, 0.05 * 0.057),
        ({"outline": [(-0.0125, 0), (0.0125, 0), (0.0125, 0.1), (-0.0125, 0.1)]}, 0.025 * 0.057),
    ],
    ids=["faces", "outline"],
)
def test_the_curve_is_over_what_there_is(block: dict, area: float) -> None:
    """Height between the faces that are touched, area of the foam under the plate."""
    plain = small_scene().block
    scene = Scene(
        block=plain.model_validate({**plain.model_dump(), **block}),
        foam=Foam(),
        impactor=CROSSHEAD,
        model=Model(crushed_room=False),
        numerics=Numerics(damping_time=4e-6),
        output=FILES,
    )
    found = run(scene)
    curve = compression_curve(found)
    assert curve is not None
    strain, stress = curve
    height = 0.1 if block.get("mass_points") else GAUGE
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


def test_the_papers_foam_has_its_plateau_under_a_crosshead() -> None:
    scene = small_scene(impactor=CROSSHEAD, output=FILES, numerics=Numerics())
    found = compression_curve(run(scene))
    assert found is not None
    strain, stress = found
    plateau = stress[(strain > 0.2) & (strain < 0.55)]
    assert plateau.mean() == pytest.approx(Foam().plateau_stress, rel=0.02)


def half_sine(peak: float, duration: float, points: int = 401) -> Pulse:
    time = np.linspace(0.0, duration, points)
    return Pulse(time=time.tolist(), acceleration=(peak * np.sin(np.pi * time / duration)).tolist())


SHAKEN = Numerics(end=6e-3, damping_time=0.0)


def test_a_pulse_gives_all_that_is_free_its_integral() -> None:
    """An impactor far above, and a block that a falling base leaves: in its frame both rise."""
    pulse = half_sine(-2000.0, 5e-3)
    scene = small_scene(
        impactor=FlatBlock(width=0.08, mass=0.3, velocity=0.0, gap=1.0),
        base=Base(kind="floor", friction=0.0, acceleration=pulse),
        numerics=SHAKEN,
        output=FILES,
    )
    result = run(scene)
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


def test_an_interrupted_shaken_run_goes_on(tmp_path: Path) -> None:
    scene = small_scene(
        impactor=FlatBlock(width=0.08, mass=0.3, velocity=0.0, gap=1.0),
        base=Base(kind="floor", friction=0.0, acceleration=half_sine(-2000.0, 5e-3)),
        numerics=SHAKEN,
        output=FILES,
    )

    def press(progress: Progress) -> None:
        if progress.fraction > 0.3:
            raise KeyboardInterrupt

    run(scene, press, checkpoint=tmp_path)
    continued, whole = tf.resume(tmp_path), run(scene)
    for name, column in whole.history.items():
        np.testing.assert_array_equal(column, continued.history[name], err_msg=name)


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
        ({"impactor.travel": 0.01}, "is a crosshead's"),
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
