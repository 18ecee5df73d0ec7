"""A drop height in place of a velocity: what it sets, what takes it away, what contradicts it."""

from __future__ import annotations

import math

import pytest

from taichi_foam.catalogue import load_scene
from taichi_foam.errors import UserError
from taichi_foam.scene import Block, FlatBlock, Numerics, Scene
from taichi_foam.scene.files import scene_from_text, scene_to_toml
from taichi_foam.scene.paths import by_key
from taichi_foam.scene.toml import tomllib
from taichi_foam.units import STANDARD_GRAVITY

PAPER = "paper/rectangular-3.03"
PRESS = FlatBlock(motion="crosshead", velocity=0.5, travel=0.05)
FALL = math.sqrt(2 * STANDARD_GRAVITY * 0.5)


@pytest.fixture(scope="module")
def fallen() -> Scene:
    """An impactor that falls half a metre."""
    return load_scene(PAPER, overrides=["impactor.drop_height=0.5"])


def test_it_sets_velocity_and_gravity(fallen: Scene) -> None:
    assert fallen.impactor.velocity == pytest.approx(FALL, rel=1e-15)
    assert fallen.numerics.gravity == STANDARD_GRAVITY


def test_the_gap_is_the_last_part_of_the_fall(fallen: Scene) -> None:
    """Free fall: v^2 = v0^2 + 2 g gap at first contact, whatever the gap."""
    for gap in (0.0, 0.05, 0.1):
        scene = fallen.with_values(impactor__gap=gap)
        at_contact = math.sqrt(scene.impactor.velocity**2 + 2 * STANDARD_GRAVITY * gap)
        assert at_contact == pytest.approx(FALL, rel=1e-15)


def test_parts_built_in_python_say_the_same(fallen: Scene) -> None:
    shape = type(fallen.impactor)
    scene = Scene(impactor=shape(drop_height=0.5), numerics=Numerics(safety=0.5))
    assert scene.impactor.velocity == fallen.impactor.velocity
    assert scene.numerics == Numerics(safety=0.5, gravity=STANDARD_GRAVITY)


def test_a_velocity_takes_it_away_and_the_rest_gives_a_new_one(fallen: Scene) -> None:
    slow = fallen.with_values(impactor__velocity=2.0)
    assert (slow.impactor.drop_height, slow.impactor.velocity) == (None, 2.0)
    moon = fallen.with_values(numerics__gravity=1.62)
    assert moon.impactor.velocity == pytest.approx(math.sqrt(2 * 1.62 * 0.5), rel=1e-15)
    heavy = fallen.with_values(impactor__mass=1.0)
    assert heavy.impactor.velocity == pytest.approx(FALL, rel=1e-15)


def test_what_follows_is_not_given() -> None:
    """A scene says and writes what was given; one that a former version wrote holds both."""
    cases = [
        ({"impactor": FlatBlock(drop_height=0.5)}, ["impactor.velocity"]),
        ({"impactor": PRESS}, ["numerics.end"]),
        ({"impactor": FlatBlock(), "block": Block(cell=0.01)}, ["block.columns", "block.rows"]),
        ({"numerics": Numerics(end=0.01)}, []),
    ]
    for parts, following in cases:
        scene = Scene(**parts)
        text = scene_to_toml(scene)
        written, whole = by_key(tomllib.loads(text)), by_key(scene.model_dump(exclude_none=True))
        assert [key for key in whole if key not in written] == following
        again = scene_from_text(text, "again")
        assert again == Scene.checked(scene.model_dump(exclude_none=True), "whole") == scene
        assert eval(repr(scene)) == scene
        assert not [key for key in following if f"{key.partition('.')[2]}=" in repr(scene)]


def test_a_new_end_takes_a_travel_away() -> None:
    scene = Scene(impactor=PRESS).with_values(numerics__end=0.2)
    assert (scene.impactor.travel, scene.numerics.end) == (None, 0.2)


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ({"impactor.velocity": 2.0}, "gives 3.132 m/s; give one of the two"),
        ({"numerics.gravity": 0.0}, "nothing falls without gravity"),
        ({"impactor.gap": 0.6}, "must be at most impactor.drop_height = 0.5 m"),
    ],
)
def test_contradictions_are_refused(values: dict[str, float], said: str) -> None:
    with pytest.raises(UserError, match=said):
        load_scene(PAPER).with_values({"impactor.drop_height": 0.5, **values})


@pytest.mark.parametrize("height", [0.0, -1.0, "0.5 m", math.nan, True, 1e9])
def test_what_is_no_height_is_refused(height: object) -> None:
    with pytest.raises(UserError, match=r"impactor\.drop_height = .*must be"):
        load_scene(PAPER).with_values({"impactor.drop_height": height})


def test_millimetres_are_asked_about() -> None:
    with pytest.raises(UserError, match=r"760: must be .*at most 100 m; .*\(760 mm is 0\.76\)"):
        load_scene(PAPER).with_values({"impactor.drop_height": 760})


def test_grams_are_asked_about(fallen: Scene) -> None:
    """A product that crushes by its weight what it falls on; the most that foam carries is none."""
    block, foam, impactor = fallen.block, fallen.foam, fallen.impactor
    width = min(impactor.extent, block.width)
    most = foam.plateau_stress * width * block.depth / STANDARD_GRAVITY
    with pytest.raises(UserError, match=r"in kilograms \(5,000 g is 5\)"):
        fallen.with_values(impactor__mass=5000.0)
    with pytest.raises(UserError, match="its weight alone"):
        fallen.with_values(impactor__mass=1.001 * most)
    assert fallen.with_values(impactor__mass=0.999 * most).impactor.mass < most
    # an impact by a velocity, without gravity, is not a drop on a cushion
    heavy = fallen.with_values(impactor__mass=5000.0, impactor__velocity=3.0, numerics__gravity=0.0)
    assert heavy.impactor.drop_height is None
