"""The law and the shape of docs/extending.md, each in one file and registered by one line."""

from __future__ import annotations

import importlib.util
import re
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from bench import PLAIN, small_scene
from slipping_law import SlippingFoam

import taichi_foam as tf
from taichi_foam.laws.bond import FOAMS
from taichi_foam.laws.shape import SHAPES
from taichi_foam.picture import raster
from taichi_foam.scene import Base, Cylinder, FlatBlock, Model, Numerics, Output, Start
from taichi_foam.scene.files import scene_from_text, scene_to_toml

PAGE = Path(__file__).parents[2] / "docs" / "extending.md"
OUTPUT = Output(history_interval=1e-5, snapshot_interval=1e-3)


def module_of(part: str, folder: Path) -> ModuleType:
    """What the page shows between its marks, as a module from a file."""
    text = PAGE.read_text(encoding="utf-8")
    found = re.search(rf"<!-- {part}: begin -->\n```python\n(.*?)```\n<!-- {part}: end", text, re.S)
    file = folder / f"{part}_of_the_page.py"
    file.write_text(found.group(1), encoding="utf-8")
    spec = importlib.util.spec_from_file_location(file.stem, file)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def law(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ModuleType]:
    brittle = module_of("law", tmp_path_factory.mktemp("law"))
    FOAMS.register(brittle.BrittleFoam)
    yield brittle
    FOAMS.remove("brittle")


@pytest.fixture(scope="module")
def shape(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ModuleType]:
    capsule = module_of("shape", tmp_path_factory.mktemp("shape"))
    SHAPES.register(capsule.Capsule)
    yield capsule
    SHAPES.remove("capsule")


def test_a_block_of_the_new_law_swings_as_a_spring(law: ModuleType) -> None:
    """A gripped block, stretched upwards a little, in its lowest longitudinal mode or so.

    The strain energy at the start is E e^2 / 2 times the volume of its bonds, whose count is known;
    the ledger closes.
    """
    strain = 1e-3
    scene = small_scene(
        foam=law.BrittleFoam(youngs_modulus=2e6, shear_modulus=5e5),
        base=Base(kind="gripped"),
        model=Model(self_contact=False),
        start=Start(deformation_gradient=((1.0, 0.0), (0.0, 1.0 + strain))),
        numerics=Numerics(end=2e-3, damping_time=0.0, safety=0.1),  # an eighth: order 4
        output=OUTPUT,
    )
    block = scene.block
    result = tf.run(scene)
    upright = block.columns * (block.rows - 1)
    volume = block.dx * block.dy * block.depth
    energy = 0.5 * 2e6 * strain**2 * upright * volume
    assert result.history.strain_J[0] == pytest.approx(energy, rel=1e-9)
    assert result.history.foam_kinetic_J.max() > 0.5 * energy
    np.testing.assert_allclose(result.history.residual_J, 0.0, atol=1e-6 * energy)
    assert result.history.broken_bonds[-1] == 0


def test_it_breaks_where_it_says(law: ModuleType) -> None:
    for strain, broken in ((0.029, False), (0.031, True)):
        scene = small_scene(
            foam=law.BrittleFoam(fracture_strain=0.03),
            model=Model(self_contact=False),
            start=Start(deformation_gradient=((1.0, 0.0), (0.0, 1.0 - strain))),
            numerics=Numerics(end=1e-5, dt=1e-6),
            output=Output(history_interval=1e-6, snapshot_interval=1e-6),
        )
        first_steps = tf.run(scene).history.broken_bonds[:3]
        assert (first_steps.max() > 0) == broken


def test_a_law_with_two_values_of_its_own_meets_its_closed_form(tmp_path: Path) -> None:
    """A crosshead at the strain rate r: K min(r t, e_s) + K r T (1 - exp(-t / T)).

    At 0.2 m/s inertia, rho c v, is 2 % of that. The block that is left, and the next run on it,
    have the slip e_s less than the strain, and the creep r (t - T (1 - exp(-t / T))).
    """
    FOAMS.register(SlippingFoam)
    try:
        foam = SlippingFoam(youngs_modulus=2e6, slip_strain=0.01, relaxation_time=0.02)
        scene = small_scene(
            foam=foam,
            impactor=FlatBlock(
                width=0.08, velocity=0.2, motion="crosshead", travel=0.01, friction=0.0
            ),
            model=PLAIN,
            numerics=Numerics(damping_time=4e-6),
            output=Output(history_interval=2e-4, snapshot_interval=0.05, film=False),
        )
        block, rate = scene.block, 0.2 / (0.1 - 0.005)
        upright = block.columns * (block.rows - 1) * block.dx * block.dy * block.depth

        def creeping(time):
            return rate * 0.02 * (1.0 - np.exp(-time / 0.02))  # strain of Maxwell's spring

        def stored(time):
            return 0.5 * 2e6 * (0.01**2 + creeping(time) ** 2) * upright

        result = tf.run(scene)
        time = result.history.time_s
        force = 2e6 * (np.minimum(rate * time, 0.01) + creeping(time)) * block.width * block.depth
        late = time > 0.01
        np.testing.assert_allclose(result.history.contact_force_N[late], force[late], rtol=0.03)
        assert result.history.strain_J[-1] == pytest.approx(stored(time[-1]), rel=0.01)
        assert np.diff(result.history.crushing_J).min() > -1e-9 * stored(time[-1])
        loaded = tf.load(result.save(tmp_path / "run"))
        strain = rate * time[-1]
        own = {"slip_b": 0.01 - strain, "creep_b": creeping(time[-1]) - strain}
        for name, expected in own.items():
            np.testing.assert_allclose(loaded.cushion.own[name], expected, rtol=0.01)
            np.testing.assert_allclose(loaded.snapshots[-1].own[name], expected, rtol=0.01)
        again = tf.run(scene.with_values(numerics__end=2e-3, impactor__travel=None), after=loaded)
        energy = again.history.strain_J
        assert energy[0] == pytest.approx(result.history.strain_J[-1], rel=1e-9)
        assert energy[-1] == pytest.approx(stored(time[-1] + 2e-3), rel=0.01)
    finally:
        FOAMS.remove("slipping")


def test_scene_files_and_messages_know_the_law(law: ModuleType) -> None:
    scene = small_scene(foam=law.BrittleFoam(fracture_strain=0.02))
    assert scene_from_text(scene_to_toml(scene), "here") == scene
    with pytest.raises(tf.UserError, match=r"foam\.fracture_strain = 3: must be .*at most 0\.5"):
        scene.with_values(foam__fracture_strain=3)
    with pytest.raises(tf.UserError, match=r"must be one of crushable, .*, brittle"):
        scene.with_values(foam__law="britle")


def test_a_capsule_without_length_is_a_cylinder(shape: ModuleType) -> None:
    """The runs differ by rounding only."""
    common = {
        "numerics": Numerics(end=1.5e-3), "model": PLAIN, "output": OUTPUT,
    }  # fmt: skip
    of_both = [
        tf.run(small_scene(impactor=impactor, **common))
        for impactor in (
            shape.Capsule(half_length=0.0, radius=0.015, mass=0.1, velocity=5.0, guided=False),
            Cylinder(radius=0.015, mass=0.1, velocity=5.0, guided=False),
        )
    ]
    capsule, cylinder = (result.history for result in of_both)
    assert cylinder.contact_force_N.max() > 1.0
    np.testing.assert_allclose(capsule.velocity_m_s, cylinder.velocity_m_s, atol=1e-6)
    np.testing.assert_allclose(capsule.residual_J, 0.0, atol=1e-3)


def test_it_is_drawn_and_stored(shape: ModuleType, tmp_path: Path) -> None:
    scene = small_scene(
        impactor=shape.Capsule(mass=0.1, velocity=5.0, rotation_deg=20.0, guided=False),
        model=PLAIN,
        numerics=Numerics(end=2e-4),
        output=OUTPUT,
    )
    result = tf.run(scene)
    loaded = tf.load(result.save(tmp_path / "run"))
    assert loaded.scene == scene
    picture = raster.frame(loaded.snapshots[-1], scene, (256, 144))
    assert picture.std() > 10
