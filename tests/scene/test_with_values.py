"""Scenes with other values: by dotted key or keyword, checked anew, the old one kept."""

from __future__ import annotations

from typing import get_args

import numpy as np
import pytest
from pydantic import ValidationError

from taichi_foam import scene
from taichi_foam.catalogue import load_scene
from taichi_foam.errors import UserError
from taichi_foam.laws.shape import SHAPES
from taichi_foam.parts import described, unit_of
from taichi_foam.scene import Curve, Cylinder, FlatBlock, Foam, Scene, TabulatedFoam, Wedge
from taichi_foam.scene.messages import explain
from taichi_foam.scene.values import settings

SCENE = Scene(name="mine", impactor=Wedge(velocity=2.86))


def test_by_key_and_by_keyword() -> None:
    changed = SCENE.with_values({"impactor.velocity": 3.0, "name": "other"}, block__rows=40)
    assert changed.impactor == Wedge(velocity=3.0)
    assert (changed.name, changed.block.rows) == ("other", 40)
    assert SCENE.impactor == Wedge(velocity=2.86)
    assert SCENE.with_values() is SCENE
    assert SCENE.with_values({}) == SCENE
    assert SCENE.with_values({"block.rows": 10}, block__rows=12).block.rows == 12


def test_a_whole_part_and_values_in_it_in_any_order() -> None:
    values = {"impactor.mass": 3.0, "impactor": Cylinder(radius=0.02), "foam": {"rate": 100.0}}
    changed = SCENE.with_values(values)
    assert changed.impactor == Cylinder(radius=0.02, mass=3.0)
    assert changed.foam == Foam(rate=100.0)


def test_a_new_shape_drops_what_it_lacks_and_keeps_the_rest() -> None:
    slow = SCENE.with_values(impactor__velocity=1.0, impactor__angle_deg=60.0)
    changed = slow.with_values({"impactor.radius": 0.03, "impactor.shape": "cylinder"})
    assert changed.impactor == Cylinder(radius=0.03, velocity=1.0)
    with pytest.raises(UserError, match=r"impactor\.angle_deg: unknown key"):
        slow.with_values({"impactor.angle_deg": 70.0, "impactor.shape": "cylinder"})


def test_none_empties_and_what_was_empty_is_filled() -> None:
    empty = SCENE.with_values({"impactor": None, "numerics.end": 1e-3, "foam.rate": None})
    assert empty.impactor is None
    assert empty.foam.rate is None
    assert empty.with_values({"impactor.shape": "flat"}).impactor == FlatBlock()


def test_numbers_of_numpy_are_numbers() -> None:
    for velocity in np.linspace(2.0, 3.0, 3):
        changed = SCENE.with_values(impactor__velocity=velocity, block__rows=np.int64(12))
        assert type(changed.impactor.velocity) is float
        assert changed.block.rows == 12


@pytest.mark.parametrize(
    ("values", "says"),
    [
        ({"impactor.speed": 1.0}, r"impactor\.speed: unknown key"),
        ({"foam.youngs_module": 1e6}, r"did you mean foam\.youngs_modulus\?"),
        ({"block.rows": 0}, r"block\.rows = 0: must be at least"),
        ({"block.rows": "40"}, r"block\.rows = '40': must be a whole number"),
        ({"impactor.shape": "cone"}, r"impactor\.shape = 'cone': must be one of flat"),
        ({"impactor.shape": ["flat"]}, r"impactor\.shape"),
        ({"name.first": "x"}, r"name\.first: unknown key; name has no keys of its own"),
        ({"block..rows": 3}, r"'block\.\.rows': must be the key of a value"),
        ({"numerics.end": "rebound", "impactor": None}, "without an impactor"),
    ],
)
def test_what_cannot_be_is_told_with_its_scene(values, says) -> None:
    with pytest.raises(UserError, match=says):
        SCENE.with_values(values)


def test_every_problem_is_told_at_once() -> None:
    with pytest.raises(UserError) as caught:
        SCENE.with_values(block__rows=0, impactor__mass=-1.0)
    title, *problems = str(caught.value).splitlines()
    assert title == "mine: not a valid scene:"
    assert len(problems) == 2


def test_texts_of_the_command_line_are_the_same_values() -> None:
    texts = ["impactor.velocity=3", "foam.rate=none", "block.rows=9", "block.rows=8", "name=a b"]
    values = settings(texts)
    assert values == {"impactor.velocity": 3, "foam.rate": None, "block.rows": 8, "name": "a b"}
    assert load_scene(SCENE, overrides=texts) == SCENE.with_values(values)
    assert load_scene(SCENE, overrides=values) == SCENE.with_values(values)


def test_units_are_told_by_the_field_alone() -> None:
    parts = [type(getattr(SCENE, name)) for name in Scene.model_fields if name != "impactor"]
    fields = {
        (part.__name__, name): field
        for part in [*parts, *SHAPES.values()]
        if hasattr(part, "model_fields")
        for name, field in part.model_fields.items()
    }
    for key, field in fields.items():
        assert not (field.description or "").endswith("]"), key
        if field.annotation in (float, int) or float in get_args(field.annotation):
            assert "unit" in field.json_schema_extra, key
    assert unit_of(fields["Foam", "youngs_modulus"]) == "Pa"
    assert unit_of(fields["Foam", "yield_strain"]) == ""
    assert described(fields["Wedge", "mass"]).endswith(" [kg]")


def test_a_scene_shows_what_it_differs_in() -> None:
    assert repr(SCENE) == "Scene(name='mine', impactor=Wedge(velocity=2.86))"
    assert repr(Scene(numerics={"end": 1.0}).block) == "Block()"
    assert eval(repr(SCENE)) == SCENE


def test_a_long_list_is_told_by_its_range() -> None:
    curve = Curve(strain=[n / 1000 for n in range(1, 801)], stress=[1e3 * n for n in range(1, 801)])
    assert repr(curve) == "Curve(strain=<801 numbers, 0 to 0.8>, stress=<801 numbers, 0 to 800000>)"
    assert len(repr(Scene(foam=TabulatedFoam(curve=curve), numerics={"end": 0.01}))) < 2_000


@pytest.mark.parametrize(
    ("part", "name", "value", "instead"),
    [
        ("block", "height", 0.06, "scene.with_values(block__height=0.06)"),
        ("impactor", "mass", 3.0, "scene.with_values(impactor__mass=3.0)"),
        ("foam", "softening", False, "scene.with_values(foam__softening=False)"),
        (None, "name", "other", "scene.with_values(name='other')"),
    ],
)
def test_an_assignment_says_how_to_get_a_changed_scene(
    part: str | None, name: str, value: object, instead: str
) -> None:
    owner = SCENE if part is None else getattr(SCENE, part)
    before = getattr(owner, name)
    with pytest.raises(ValidationError, match="scenes cannot be changed") as caught:
        setattr(owner, name, value)
    assert instead in str(caught.value)
    assert getattr(owner, name) == before
    key = name if part is None else f"{part}.{name}"
    assert explain(caught.value, Scene).startswith(f"{key}: scenes cannot be changed; {instead}")
    changed = eval(instead, {"scene": SCENE})
    assert getattr(changed if part is None else getattr(changed, part), name) == value


def test_an_assignment_to_one_of_several_parts_says_which_key_is_that_of_which() -> None:
    layers = [{"bottom": 0.0, "top": 0.05}, {"bottom": 0.05, "top": 0.1, "foam": Foam()}]
    block = Scene(block={"layers": layers}, numerics={"end": 0.01}).block
    with pytest.raises(ValidationError, match=r"that you mean, block\.layers\[N\]\.density"):
        block.layers[1].density = 30.0
    with pytest.raises(ValidationError, match=r"foam\.softening or block\.layers\[N\]\.foam\."):
        block.layers[1].foam.softening = False


def test_completion_shows_public_names_only() -> None:
    shown = {name for name in dir(SCENE) if not name.startswith("_")}
    assert set(Scene.model_fields) | {"with_values", "turns"} <= shown
    assert not {name for name in shown if name.startswith(("model_", "dict", "copy"))}
    assert dir(scene) == sorted(scene.__all__)
