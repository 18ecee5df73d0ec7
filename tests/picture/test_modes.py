"""What the colours show, against states whose figures are known by hand."""

from __future__ import annotations

from typing import get_args

import numpy as np
import pytest
from picture_states import alone, dented, intact, reference, scene_of, shattered, snapshot_of, split

from taichi_foam.errors import UserError
from taichi_foam.picture import raster
from taichi_foam.picture.look import THEMES, Look
from taichi_foam.picture.modes import MODES
from taichi_foam.scene import Block, Foam, Output, Start

FOAM = Foam()


def shown(mode: str, snapshot, scene) -> np.ndarray:
    return MODES[mode].values(snapshot, scene)


def stretched(scene, x: float = 1.0, y: float = 1.0, shear: float = 0.0):
    """The whole block with the deformation gradient [[x, shear], [0, y]]."""
    X = reference(scene)
    return X @ np.array([[x, shear], [0.0, y]]).T


def test_a_scene_knows_the_same_modes_and_themes() -> None:
    fields = Output.model_fields
    assert get_args(fields["mode"].annotation) == tuple(MODES)
    assert get_args(fields["theme"].annotation) == tuple(THEMES)


@pytest.mark.parametrize(("name", "value"), [("mode", "colour"), ("theme", "grey")])
def test_an_unknown_name_is_refused_with_those_there_are(name: str, value: str) -> None:
    with pytest.raises(UserError, match=f"{name} = '{value}': must be one of .*(light|stress)"):
        Look(**{name: value})


def test_the_strain_now_is_that_of_the_lattice_and_of_unloaded_foam_where_it_is_broken() -> None:
    scene = scene_of(10, 5)
    e_min_b = np.full((10, 4), -0.5)
    broken_b = np.zeros((10, 4), dtype=bool)
    broken_b[0] = True
    snapshot = snapshot_of(scene, stretched(scene, y=0.8), e_min_b=e_min_b, broken_b=broken_b)
    strain = shown("strain", snapshot, scene)
    np.testing.assert_allclose(strain[1:], 0.2, atol=1e-12)
    # broken foam that was crushed to 50 % springs back by the yield strain
    np.testing.assert_allclose(strain[0], 0.45, atol=1e-12)
    np.testing.assert_allclose(shown("worst-strain", snapshot, scene), 0.5)


def test_the_stress_is_the_laws_on_the_elastic_line_the_plateau_and_in_tension() -> None:
    scene = scene_of(10, 5)
    modulus, plateau = FOAM.youngs_modulus, FOAM.plateau_stress
    for y, expected in ((0.98, -0.02 * modulus), (0.6, -plateau), (1.03, 0.03 * modulus)):
        snapshot = snapshot_of(scene, stretched(scene, y=y))
        shown_inside = shown("stress", snapshot, scene)[1:-1, 1:-1]
        np.testing.assert_allclose(shown_inside, expected, rtol=1e-5)


def test_unloaded_foam_and_foam_across_an_open_crack_carry_no_stress() -> None:
    scene = scene_of(10, 5)
    unloaded = 0.5 - FOAM.yield_strain  # of foam crushed to half its height
    e_min_b = np.full((10, 4), -0.5)
    snapshot = snapshot_of(scene, stretched(scene, y=unloaded), e_min_b=e_min_b)
    np.testing.assert_allclose(shown("stress", snapshot, scene), 0.0, atol=1e-6)
    opened = snapshot_of(
        scene,
        stretched(scene, y=0.9),
        e_min_b=e_min_b,
        broken_b=np.ones((10, 4), dtype=bool),
    )
    np.testing.assert_allclose(shown("stress", opened, scene), 0.0, atol=1e-6)


@pytest.mark.parametrize("gamma", [0.03, -0.03])
def test_the_shear_strain_is_that_of_simple_shear(gamma: float) -> None:
    scene = scene_of(10, 5)
    snapshot = snapshot_of(scene, stretched(scene, shear=gamma))
    np.testing.assert_allclose(shown("shear", snapshot, scene), 0.03, rtol=1e-9)


def test_a_rotation_is_no_shear_and_broken_bonds_have_no_say() -> None:
    scene = alone()
    assert shown("shear", split(scene, 0.2), scene).max() < 1e-12
    assert shown("shear", shattered(scene), scene).max() == 0


def test_the_speed_is_the_length_of_the_velocity() -> None:
    scene = scene_of(10, 5)
    snapshot = intact(scene)
    snapshot.velocity[..., :] = (3.0, -4.0)
    np.testing.assert_allclose(shown("speed", snapshot, scene), 5.0)
    assert MODES["speed"].key(scene).top == scene.impactor.velocity


def test_the_speed_of_a_block_without_an_impactor_has_a_scale_of_its_own() -> None:
    still = alone()
    pulled = still.model_copy(update={"start": Start(deformation_gradient=((1.01, 0), (0, 1)))})
    sound = np.sqrt(FOAM.youngs_modulus / still.block.density)
    assert MODES["speed"].key(still).top == 1.0
    assert MODES["speed"].key(pulled).top == pytest.approx(0.01 * sound)


def test_broken_bonds_are_counted_from_both_sides() -> None:
    scene = scene_of(6, 4)
    broken_a = np.zeros((5, 4), dtype=bool)
    broken_a[2, 1] = True
    count = shown("broken", snapshot_of(scene, reference(scene), broken_a=broken_a), scene)
    expected = np.zeros((6, 4))
    expected[2:4, 1] = 1
    np.testing.assert_array_equal(count, expected)
    inner = shown("broken", shattered(scene), scene)[1:-1, 1:-1]
    np.testing.assert_array_equal(inner, 4)


def test_the_crush_energy_adds_up_to_what_crushing_the_block_takes() -> None:
    """All of a tall column crushed to half: plateau stress times permanent strain times volume."""
    scene = scene_of(20, 40)
    e_min_b = np.full((20, 39), -0.5)
    snapshot = snapshot_of(scene, reference(scene), e_min_a=np.zeros((19, 40)), e_min_b=e_min_b)
    block = scene.block
    cell = block.dx * block.dy * block.depth
    total = shown("energy", snapshot, scene).sum() * cell
    volume = block.width * (block.height - block.dy) * block.depth  # between mass points
    assert total == pytest.approx(FOAM.plateau_stress * 0.45 * volume)


def test_the_crush_energy_of_rows_on_the_faces_is_that_of_the_others() -> None:
    """Half a cell has the half of one bond; all of the block's height has been crushed."""
    scene = scene_of().model_copy(update={"block": Block(width=0.1, height=0.1, cell=0.005)})
    e_min_b = np.full((20, 20), -0.5)
    snapshot = snapshot_of(scene, reference(scene), e_min_a=np.zeros((19, 21)), e_min_b=e_min_b)
    np.testing.assert_allclose(shown("energy", snapshot, scene), FOAM.plateau_stress * 0.45)


@pytest.mark.parametrize("mode", MODES)
def test_a_key_depends_on_the_scene_alone_and_its_ticks_lie_on_it(mode: str) -> None:
    scene = scene_of()
    key = MODES[mode].key(scene)
    values = [value for value, _ in key.ticks]
    assert values == sorted(values)
    assert values[0] == key.bottom
    assert 0.0 in values
    assert values[-1] == pytest.approx(key.top)
    assert len({text for _, text in key.ticks}) == len(key.ticks)
    apart = np.diff(values) / (key.top - key.bottom)
    assert apart.min() > 0.08  # ticks' texts do not run into one another


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("theme", THEMES)
def test_every_mode_draws_every_state(mode: str, theme: str) -> None:
    scene = scene_of(20, 10)
    look = Look(mode, theme)
    for state in (intact, dented, split, shattered):
        image = raster.frame(state(scene), scene, (512, 288), look=look)
        assert np.all(np.isin(image.reshape(-1, 3)[:1], THEMES[theme].page))
        assert len(np.unique(image.reshape(-1, 3), axis=0)) > 20


@pytest.mark.parametrize(
    ("plateau", "last", "unit"),
    [
        (200e3, "≥ 400", "(kPa)"),
        (499.9, "≥ 1", "(kPa)"),
        (499.9e3, "≥ 1", "(MPa)"),
        (499.0, "≥ 998", "(Pa)"),
        (2.5e9, "≥ 5", "(GPa)"),
        (5e12, "≥ 10000", "(GPa)"),
    ],
)
def test_a_key_has_the_prefix_of_its_last_figure(plateau: float, last: str, unit: str) -> None:
    foam = FOAM.model_copy(update={"youngs_modulus": -plateau / FOAM.yield_strain})
    scene = scene_of().model_copy(update={"foam": foam})
    assert foam.plateau_stress == pytest.approx(plateau)
    key = MODES["stress"].key(scene)
    assert key.ticks[-1][1] == last
    assert key.words[-1].endswith(unit)
    assert not any("e" in text for _, text in key.ticks)


@pytest.mark.parametrize(("locking", "last"), [(-0.95, "95 %"), (-0.85, "95 %"), (-0.98, "98 %")])
@pytest.mark.parametrize("mode", ["strain", "worst-strain"])
def test_a_strain_key_goes_to_where_foam_locks(mode: str, locking: float, last: str) -> None:
    foam = FOAM.model_copy(update={"locking_strain": locking})
    key = MODES[mode].key(scene_of().model_copy(update={"foam": foam}))
    assert key.ticks[-1] == (key.top, last)
    assert key.top == max(0.95, -locking)
