"""Blocks whose masses, faces and foams differ from place to place, in the engine."""

import math

import numpy as np
import pytest
from bench import COLUMNS, FREE, LIFT, PLAIN, ROWS, UNBREAKABLE, numerics, run_to

import taichi_foam as tf
from taichi_foam.engine import features
from taichi_foam.laws.bond import BondFoam, Curve
from taichi_foam.scene import (
    Base,
    Block,
    FlatBlock,
    Foam,
    Model,
    Numerics,
    Output,
    Scene,
    TabulatedFoam,
    Wedge,
)
from taichi_foam.scene.filling import filling

RECTANGLE = ((-0.025, 0.0), (0.025, 0.0), (0.025, 0.1), (-0.025, 0.1))


def wedge_drop(foam: BondFoam | None = None, **block: object) -> Scene:
    """A wedge that splits a small block, with everything on."""
    size = {"width": 0.05, "height": 0.1, "columns": COLUMNS, "rows": ROWS}
    return Scene(
        block=Block(mass_points="cells", **size, **block),
        foam=foam or Foam(),
        impactor=Wedge(mass=1.0, velocity=8.0, shank_width=0.03),
        numerics=Numerics(end=3e-3),
        output=Output(film=False),
    )


def assert_same(one: tf.Result, other: tf.Result) -> None:
    for name, column in one.history.items():
        np.testing.assert_array_equal(other.history[name], column, err_msg=name)
    for ours, theirs in zip(one.snapshots, other.snapshots, strict=True):
        np.testing.assert_array_equal(theirs.position, ours.position)


def assert_close(one: tf.Result, other: tf.Result) -> None:
    """Other kernels with the same numbers: a compiler may round a product and a sum at once."""
    for name, column in one.history.items():
        scale = max(np.abs(column).max(), 1e-9)
        np.testing.assert_allclose(
            other.history[name], column, rtol=0, atol=1e-9 * scale, err_msg=name
        )


def test_a_block_drawn_as_a_polygon_is_the_plain_block(monkeypatch: pytest.MonkeyPatch) -> None:
    """To the last bit; the kernels of shaped blocks, where all shares are 1, agree to rounding."""
    plain = tf.run(wedge_drop())
    assert plain.history["broken_bonds"][-1] > 10
    assert_same(plain, tf.run(wedge_drop(outline=RECTANGLE)))
    monkeypatch.setattr(features, "_is_plain", lambda *_: False)
    assert_close(plain, tf.run(wedge_drop(outline=RECTANGLE)))


def test_layers_of_equal_foams_are_one_foam() -> None:
    """They differ in where they are from, and so are told apart."""
    layers = [
        {"bottom": 0.0, "top": 0.03, "foam": Foam(source="a")},
        {"bottom": 0.065, "top": 0.1, "foam": Foam(source="b")},
    ]
    layered = wedge_drop(layers=layers)
    assert features.features_of(layered).foams == 3
    assert_close(tf.run(wedge_drop()), tf.run(layered))


def test_layers_of_equal_curves_are_one_curve() -> None:
    """The same for foams that look things up."""
    curve = Curve(strain=(0, 0.05, 0.6, 0.8, 0.9), stress=(0, 120e3, 150e3, 400e3, 2e6))
    foam = TabulatedFoam(curve=curve)
    layers = [{"bottom": 0.035, "top": 0.1, "foam": TabulatedFoam(curve=curve, source="b")}]
    assert_close(tf.run(wedge_drop(foam)), tf.run(wedge_drop(foam, layers=layers)))


@pytest.mark.parametrize(("young", "density"), [(8e6, 60.0), (1e6, 20.0)])
def test_a_layered_bar_reflects_by_its_impedances(young: float, density: float) -> None:
    """R = (Z_1 - Z_2) / (Z_1 + Z_2) of a displacement pulse, T = 1 + R, with Z = sqrt(K rho).

    The pulse, Gaussian with a deviation of s = 8 cells, is longer than any cell: the lattice's
    dispersion delays it by (k dy)^2 / 24, at most 1 % of what is in it at k = 4 / s. Its peak falls
    by less than that.
    """
    dy, rows = 0.005, 400
    foam = Foam(youngs_modulus=young, crush_band=None)
    top = 0.5 * rows * dy
    block = Block(
        mass_points="cells",
        width=4 * dy,
        height=rows * dy,
        columns=4,
        rows=rows,
        layers=[{"bottom": 0.0, "top": top, "foam": foam, "density": density}],
    )
    scene = Scene(
        block=block,
        foam=Foam(crush_band=None),
        base=Base(kind="held"),
        model=Model(self_contact=False, crushed_room=False),
        numerics=numerics(damping_time=0.0),
    )
    speed, size, height = math.sqrt(2.78e6 / 25.6), 8 * dy, 1e-6
    X = block.positions
    away = X[..., 1] - (top + 5 * size)
    pulse = height * np.exp(-0.5 * (away / size) ** 2)
    position, velocity = X.copy(), np.zeros_like(X)
    position[..., 1] += pulse
    velocity[..., 1] = -speed * away / size**2 * pulse  # it goes down
    fastest = max(speed, math.sqrt(young / density))
    time = 10 * size / speed
    steps = math.ceil(time / (0.2 * dy / fastest))
    after = run_to(scene, time, steps, position=position, velocity=velocity)
    moved = (after.position - X)[0, :, 1] / height
    above = X[0, :, 1] > top
    one, two = math.sqrt(2.78e6 * 25.6), math.sqrt(young * density)
    reflected = (one - two) / (one + two)
    found = moved[above][np.argmax(np.abs(moved[above]))]
    assert found == pytest.approx(reflected, rel=0.01)
    assert np.abs(moved[~above]).max() == pytest.approx(1 + reflected, rel=0.01)


LOW = ((-0.025, 0.0), (0.025, 0.0), (0.025, 0.0982), (-0.025, 0.0982))
NARROW = ((-0.025, 0.0), (0.0232, 0.0), (0.0232, 0.1), (-0.025, 0.1))


@pytest.mark.parametrize(
    ("outline", "mass_points", "axis"), [((), "faces", 0), (LOW, "cells", 0), (NARROW, "cells", 1)]
)
def test_a_block_that_rings_stays_plane(outline: tuple, mass_points: str, axis: int) -> None:
    """Its outermost rows are only partly foam: of mass, stiffness and dashpots they have that part.

    Half a wave over n mass points is a mode of each row along the axis, w = 2 c / L sin(pi / 2n),
    and follows x'' + tau w^2 x' + w^2 x = 0.
    """
    size = {"width": 0.05, "height": 0.1, "columns": COLUMNS, "rows": ROWS}
    block = Block(outline=outline, mass_points=mass_points, **size)
    scene = Scene(
        block=block,
        base=FREE,
        foam=UNBREAKABLE,
        model=PLAIN,
        numerics=numerics(contact_stiffness=1e-4, damping_time=2e-5),
    )
    there = filling(block).there
    X = block.positions
    number, way = ((COLUMNS, 0.05), (ROWS, 0.1))[axis]
    mode = np.cos(np.pi * (np.indices(X.shape[:2])[axis] + 0.5) / number)
    velocity = np.zeros_like(X)
    velocity[..., axis] = 0.1 * mode
    time, steps = 4e-4, 800
    after = run_to(scene, time, steps, position=X + LIFT, velocity=velocity)
    moved = (after.position - X - LIFT)[..., axis]
    w = 2.0 * math.sqrt(2.78e6 / 25.6) / (way / number) * math.sin(math.pi / (2 * number))
    decay = 0.5 * scene.numerics.damping_time * w * w
    swings = math.sqrt(w * w - decay * decay)
    expected = 0.1 * mode * math.exp(-decay * time) * math.sin(swings * time) / swings
    assert 0.2 < decay * time < 5.0
    largest = np.abs(expected).max()
    np.testing.assert_allclose(moved[there], expected[there], rtol=0, atol=1e-6 * largest)


def test_the_weaker_layer_crushes_first() -> None:
    """Two layers in series: the plate feels the weaker plateau until that layer is crushed.

    Its contact force over the area, at half of that layer's crush, is the plateau of Eq. 26; the
    other layer's strain is then that stress over its modulus.
    """
    strong = Foam(yield_strain=-0.15)
    layers = [{"bottom": 0.05, "top": 0.1, "foam": strong}]
    size = {"width": 0.05, "height": 0.1, "columns": COLUMNS, "rows": ROWS}
    scene = Scene(
        block=Block(mass_points="cells", **size, layers=layers),
        impactor=FlatBlock(width=0.1, mass=2e3, velocity=0.5, friction=0.0),
        base=Base(kind="held"),
        numerics=Numerics(end=0.04, damping_time=1e-6),
        output=Output(film=False, snapshot_interval=0.04),
    )
    run = tf.run(scene)
    half = run.history["time_s"] > 0.02
    stress = run.history["contact_force_N"][half].mean() / (0.05 * 0.057)
    assert stress == pytest.approx(2.78e6 * 0.05, rel=0.01)
    crush = run.snapshots[-1].e_min_b.mean(axis=0)
    assert crush[:9].mean() < -0.3
    assert crush[10:].min() > -0.06  # 0.05 and what waves add
    assert np.abs(run.history["residual_J"]).max() < 1e-3 * run.history["impactor_kinetic_J"][0]


def hole_stress(cells: int) -> tuple[np.ndarray, np.ndarray]:
    """Of a hole of so many cells' radius in a square twelve times as wide, pressed upright.

    Distance over radius of the bonds beside it on its level, and their stress over the mean of the
    whole level's section. With G = K / 2 the lattice is isotropic,
    without Poisson's effect, which plane stress around a hole does not know of.
    """
    count = 12 * cells
    size = 0.16
    cell = size / count
    radius = cells * cell
    angle = np.arange(200) * (2 * math.pi / 200)
    corner = radius * math.sqrt(math.pi / 100 / math.sin(math.pi / 100))  # of the circle's area
    hole = [(corner * math.cos(a), 0.5 * size + corner * math.sin(a)) for a in angle]
    block = Block(
        mass_points="cells", width=size, height=size, columns=count, rows=count, holes=[hole]
    )
    drag = 3e3 * block.node_mass / (2.78e6 * 0.057)
    run = tf.run(
        Scene(
            block=block,
            foam=Foam(shear_modulus=1.39e6, crush_band=None),
            base=Base(kind="held"),
            impactor=FlatBlock(width=0.2, mass=1e5, velocity=0.01, friction=0.0),
            model=Model(self_contact=False, crushed_room=False, damping="absolute"),
            numerics=Numerics(end=0.012, damping_time=drag),
            output=Output(history_interval=1e-3, snapshot_interval=0.012, film=False),
        )
    )
    strain = np.diff(run.snapshots[-1].position[..., 1], axis=1) / block.dy - 1
    face = filling(block).face_b[:, count // 2 - 1]
    level = strain[:, count // 2 - 1]
    mean = (face * level).sum() / count
    x = np.abs(block.positions[:, 0, 0]) / radius
    beside = (face > 0) & (x > 1) & (x < 2)
    return x[beside], level[beside] / mean


def kirsch(x: np.ndarray) -> np.ndarray:
    """Stress over the mean one, at a distance over the hole's radius from its middle (1898)."""
    return 0.5 * (2 + x**-2.0 + 3 * x**-4.0)


def test_a_hole_concentrates_stress_as_kirsch_says() -> None:
    """Everywhere the stress is that of a place within a cell.

    The outline is met to within a part of a cell, and cells that it cuts carry no shear; so the
    stress is right to first order.
    """
    errors = []
    for cells in (5, 8):  # blocks that have the same room
        x, found = hole_stress(cells)
        errors.append(float(np.sqrt(np.mean((found / kirsch(x) - 1) ** 2))))
        assert np.all(found > kirsch(x + 1 / cells))
        assert np.all(found < kirsch(x - 1 / cells))
        np.testing.assert_allclose(found, found[::-1], rtol=1e-9)  # the hole is symmetric
    assert errors[1] < 0.8 * errors[0]
