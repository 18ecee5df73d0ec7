"""What the page offers of a scene, and what it makes of it."""

from __future__ import annotations

import json
import re
from typing import ClassVar, Literal

import numpy as np
import pytest

from taichi_foam import load_scene
from taichi_foam.errors import UserError
from taichi_foam.laws.shape import SHAPES
from taichi_foam.live.controls import Controls, Knob, knobs, offered_shapes
from taichi_foam.live.page import commands
from taichi_foam.live.page.numbers import MOST_POINTS, UNSETTLED, Cursor, Curve, thinned
from taichi_foam.parts import Control
from taichi_foam.scene import FlatBlock, Scene
from taichi_foam.shim2000.impacts import paper_scene

WEDGE = paper_scene("paper/wedge-2.86")
CURVE = {"strain": [0.0, 0.05, 0.5, 0.7], "stress": [0.0, 1e5, 1.2e5, 5e5]}
SERVED = {
    "crushable": WEDGE,
    **{
        law: Scene.checked({**WEDGE.model_dump(), "foam": {"law": law, "curve": CURVE}}, law)
        for law in ("tabulated", "recovering")
    },
}


@pytest.fixture
def controls() -> Controls:
    return Controls(WEDGE)


def test_ranges_and_words_are_those_of_the_fields(controls: Controls) -> None:
    told = {knob["key"]: knob for knob in controls.told()["knobs"]}
    velocity = told["impactor.velocity"]
    assert (velocity["min"], velocity["max"], velocity["open"]) == (0, 500, [])
    assert velocity["about"] == "initial velocity, downwards"
    assert velocity["allowed"] == "0 to 500 m/s"
    modulus = told["foam.youngs_modulus"]
    assert (modulus["min"], modulus["max"], modulus["unit"]) == (1e-3, 1e5, "MPa")
    strain = told["foam.yield_strain"]
    assert (strain["min"], strain["max"], strain["open"]) == (-0.5, 0, ["below"])
    rate = told["foam.rate"]
    assert (rate["optional"], rate["allowed"]) == (True, "none, or 1 to 1,000,000,000 1/s")
    assert told["block.columns"]["whole"]


def test_a_new_shape_brings_its_controls_and_its_place() -> None:
    class Wide(FlatBlock):
        shape: Literal["wide"] = "wide"
        label: ClassVar[str] = "wide block"
        controls: ClassVar[tuple[Control, ...]] = (
            Control("width", "breadth", 100, 400, 5, "mm", 1e-3),
            Control("height", "height", 20, 200, 1, "mm", 1e-3),
        )

    before = offered_shapes()
    assert before == tuple(shape for shape in SHAPES if shape not in ("polygon", "outline"))
    SHAPES.register(Wide)
    try:
        controls = Controls(WEDGE)
        assert controls.shapes == (*before, "wide") == offered_shapes()
        told = {knob["key"]: knob for knob in controls.told()["knobs"]}
        # a size that two shapes have is one control, in the words of the first
        assert told["impactor.width"]["label"] == "width"
        for size, first in (("width", "flat"), ("height", "ellipse")):
            shapes = told[f"impactor.{size}"]["shapes"]
            assert (shapes[0], shapes[-1]) == (first, "wide")
        scene = controls.scene_of("wide", {"impactor.width": 0.12, "impactor.height": 0.06})
        assert isinstance(scene.impactor, Wide)
        assert (scene.impactor.width, scene.impactor.height) == (0.12, 0.06)
        assert list(controls.changes(scene).values()) == ["wide", "width 120 mm", "height 60 mm"]
    finally:
        SHAPES.remove("wide")
    assert all("wide" not in knob.shapes for knob in knobs(WEDGE.foam))


@pytest.mark.parametrize("law", ["crushable", "tabulated", "recovering"])
def test_sliders_stay_within_what_may_be(law: str) -> None:
    controls = Controls(SERVED[law])
    for knob in controls.told()["knobs"]:
        for value in (knob["low"], knob["high"]):
            controls.check("wedge", {knob["key"]: _si(knob, value)})


def test_a_law_brings_its_own_values_and_ranges() -> None:
    """A foam that springs back has no yield strain, and its modulus is in the range of its law."""
    told = {knob["key"]: knob for knob in Controls(SERVED["recovering"]).told()["knobs"]}
    assert "foam.yield_strain" not in told
    assert told["foam.gas_pressure"]["allowed"] == "0 to 10,000 kPa"
    assert told["foam.gas_leak_time"]["optional"]
    assert told["foam.youngs_modulus"]["about"].startswith("Young's modulus K, at least the curve")


def _si(knob: dict, shown: float) -> int | float:
    return int(shown) if knob["whole"] else shown * knob["factor"]


def test_unchanged_settings_are_the_scene_itself(controls: Controls) -> None:
    assert controls.scene_of("wedge", controls.defaults) is WEDGE
    assert controls.changes(WEDGE) == {}


@pytest.mark.parametrize(
    ("law", "knob"),
    [
        pytest.param(law, knob, id=f"{law}-{knob.key}")
        for law, scene in SERVED.items()
        for knob in knobs(scene.foam)
        if law == "crushable" or knob.head == "foam"
    ],
)
def test_every_control_reaches_its_key(law: str, knob: Knob) -> None:
    controls = Controls(SERVED[law])
    shape = knob.shapes[0] if knob.shapes else "wedge"
    value = {"impactor.angle_deg": 80.0, "impactor.radius": 0.03}.get(knob.key)
    if value is None:
        before = controls.defaults[knob.key]
        value = (before or 1) + 1 if isinstance(before, int) else 1.1 * before if before else 0.5
    scene = controls.scene_of(shape, {knob.key: value})
    head, field = knob.key.split(".")
    assert getattr(getattr(scene, head), field) == value
    assert knob.label in controls.changes(scene)[knob.key]
    # what it is called says so, and no test's name stands for another impact
    shown = controls.changes(scene)[knob.key].removeprefix(f"{knob.label} ")
    assert shown in scene.name
    assert scene.name.startswith(SHAPES[shape].label)


def test_another_shape_keeps_what_both_have(controls: Controls) -> None:
    scene = Controls(paper_scene("paper/rectangular-3.03")).scene_of("wedge", {"impactor.mass": 4})
    assert scene.impactor is not None
    assert (scene.impactor.shape, scene.impactor.mass) == ("wedge", 4)
    assert (scene.impactor.velocity, scene.impactor.model_dump()["height"]) == (3.03, 0.2)
    cylinder = controls.scene_of("cylinder", controls.defaults)
    assert controls.changes(cylinder) == {"impactor.shape": "cylinder"}


def test_one_number_of_mass_points_leaves_the_other(controls: Controls) -> None:
    """The page shows both: what is typed is what drops."""
    scene = controls.scene_of("wedge", {"block.rows": 11})
    assert (scene.block.columns, scene.block.rows) == (WEDGE.block.columns, 11)
    assert controls.changes(scene) == {"block.rows": "rows 11"}


def test_a_scene_without_an_impactor_may_get_one() -> None:
    controls = Controls(load_scene("gallery/shear-patch"))
    assert controls.shapes[0] == controls.shape == "none"
    assert controls.scene_of("none", {"impactor.velocity": 9.0}) is controls.given
    scene = controls.scene_of("flat", {"impactor.width": 0.02})
    assert scene.impactor is not None
    assert scene.impactor.shape == "flat"


@pytest.mark.parametrize(
    ("shape", "values", "words"),
    [
        ("hat", {}, "impactor.shape = 'hat': must be one of flat, cylinder, wedge"),
        ("wedge", {"output.fps": 3}, "output.fps: the page has no such control"),
        ("wedge", {"impactor.mass": 0}, "impactor.mass = 0: must be above 0 and at most"),
        ("wedge", {"impactor.mass": None}, "impactor.mass = none: must be"),
        ("wedge", {"block.rows": 5.5}, "block.rows = 5.5: must be a whole number, at least 2"),
        ("wedge", {"foam.yield_strain": 0}, "must be at least -0.5 and below 0; strains are"),
        ("wedge", {"foam.rate": 0.5}, "foam.rate = 0.5: must be none, or at least 1"),
        ("wedge", {"foam.densification_strain": -0.01}, "must be below foam.yield_strain"),
        ("wedge", {"block.rows": 5000}, "200,000 mass points; at most 100,000 here"),
    ],
)
def test_what_cannot_be_is_said_in_the_house_s_words(
    controls: Controls, shape: str, values: dict, words: str
) -> None:
    with pytest.raises(UserError, match=re.escape(words)):
        controls.scene_of(shape, values)


def setting(value: str) -> str:
    """A message that sets the mass to this."""
    return f'{{"do": "set", "shape": "flat", "values": {{"impactor.mass": {value}}}}}'


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "Invalid JSON"),
        ("{", "Invalid JSON"),
        ("\ud800", ""),
        ("[" * 60_000, "recursion limit"),
        ("null", "an object"),
        ('"next"', "an object"),
        ("[]", "an object"),
        ('{"do": null}', "does not match any"),
        ('{"do": "fly"}', "does not match any"),
        ('{"do": "pause"}', "Field required"),
        ('{"do": "pause", "on": 1}', "boolean"),
        ('{"do": "next", "more": 1}', "next.more: Unexpected keyword"),
        ('{"do": "next"} {"do": "next"}', "Invalid JSON"),
        ('{"do": "step", "seconds": -1}', "greater than 0"),
        ('{"do": "step", "seconds": "1e-3"}', "valid number"),
        ('{"do": "step", "seconds": 1e400}', "finite"),
        ('{"do": "pace", "rate": 0}', "greater than"),
        ('{"do": "pace", "rate": 2}', "at most 1"),
        ('{"do": "pace", "rate": NaN}', "finite"),
        (setting("true"), "valid integer"),
        (setting("Infinity"), "valid integer"),
        (setting("1e13"), "valid integer"),
        (setting("9" * 401), "less than or equal to 1000000000000"),
        (setting("-" + "9" * 5000), ""),
        (json.dumps({"do": "set", "shape": "flat", "values": dict.fromkeys(map(str, range(65)))}),
         "at most 64"),
        ('{"do": "watch", "on": true, "tone": "pink"}', "'light' or 'dark'"),
    ],
)  # fmt: skip
def test_messages_that_are_none_are_refused_in_a_line(text: str, words: str) -> None:
    with pytest.raises(ValueError, match=f"^message refused: .*{re.escape(words)}") as error:
        commands.read(text)
    assert len(str(error.value)) < 400


def test_messages_are_read() -> None:
    assert commands.read('{"do": "next"}') == commands.Next()
    let = commands.read('{"do": "drop", "shape": "flat", "values": {"foam.rate": null}}')
    assert let == commands.Drop("flat", {"foam.rate": None})


def test_numbers_keep_their_kind_and_all_that_a_scene_allows_fits(controls: Controls) -> None:
    for knob in controls.told()["knobs"]:
        limits = [each for each in (knob["min"], knob["max"]) if each is not None]
        for value in (_si(knob, limit) for limit in limits):
            text = json.dumps({"do": "set", "shape": "flat", "values": {knob["key"]: value}})
            command = commands.read(text)
            assert isinstance(command, commands.Set)
            assert command.values == {knob["key"]: value}
            assert type(command.values[knob["key"]]) is type(value)


def test_a_curve_arrives_in_parts_as_it_is() -> None:
    rng = np.random.default_rng(3)
    time, cursor = np.arange(9000) * 1e-4, Cursor()
    noise = rng.normal(size=len(time))
    received_t: list[float] = []
    received_a: list[float] = []
    for count in (0, 1, 2, 50, 55, 300, 1999, 2000, 2001, 4100, 9000):
        # the newest part differs each time, as the filter's does
        values = np.sin(time[:count]) + np.where(
            time[:count] > time[max(count - 1, 0)] - 0.9 * UNSETTLED, noise[count - 1], 0.0
        )
        curve = Curve(7, time[:count], values)
        text, cursor = curve.since(cursor)
        part = json.loads(text)
        received_t = received_t[: part["from"]] + part["t"]
        received_a = received_a[: part["from"]] + part["a"]
        assert len(received_t) <= MOST_POINTS + 1
        rows = np.searchsorted(time[:count], np.array(received_t) / 1e3 - 1e-9)
        np.testing.assert_allclose(received_a, values[rows], atol=6e-4)
        if count:
            assert received_t[0] == 0.0
            assert received_t[-1] == pytest.approx(1e3 * time[count - 1])
    # another drop begins anew
    text, _ = Curve(8, time[:10], time[:10]).since(cursor)
    assert json.loads(text)["from"] == 0


def test_a_gap_in_a_curve_is_sent_as_none() -> None:
    text, _ = Curve(1, np.array([0.0, 1e-3]), np.array([1.0, np.nan])).since(Cursor())
    assert json.loads(text)["a"] == [1.0, None]
    assert thinned(np.array([0.0, 1e-3]), np.array([1.0, np.nan]))["a"] == [1.0]
    assert len(thinned(np.arange(5000.0), np.ones(5000))["t"]) <= 400
