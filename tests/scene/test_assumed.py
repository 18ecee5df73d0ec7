"""What a scene says of a foam of one's own that nobody gave."""

import re

import pytest

from taichi_foam.catalogue import load_scene
from taichi_foam.errors import UserError
from taichi_foam.scene import CHOICE_SETS, Block, Foam, Model, Numerics, Scene
from taichi_foam.scene.files import scene_from_text, scene_to_toml

AT_REST = {"numerics": {"end": 0.01}}
CURVE = {"strain": [0.0, 0.05, 0.6, 0.8], "stress": [0.0, 1e5, 1.6e5, 8e5]}
MATERIAL = {
    "youngs_modulus", "shear_modulus", "yield_strain", "tensile_strain", "shear_strain",
    "densification_strain", "locking_strain", "densification_a", "densification_b",
    "crushed_tensile_fraction", "fracture_energy", "shear_fracture_energy",
}  # fmt: skip
ELSEWHERE = {"block.density", "numerics.damping_time", "model.shear_pressure_coefficient"}


def assumed(scene: Scene) -> set[str]:
    return {each.key for each in scene.assumed or ()}


def of_foam(scene: Scene) -> set[str]:
    return {key.partition(".")[2] for key in assumed(scene) if key.startswith("foam.")}


def test_the_papers_foam_assumes_nothing() -> None:
    assert Scene(**AT_REST).assumed is None
    readings = {"crush_band": 0.0075, "softening": False}
    assert Scene.checked({"foam": readings, **AT_REST}, "scene").assumed is None


def test_one_constant_makes_the_others_assumed() -> None:
    scenes = [
        Scene.checked({"foam": {"youngs_modulus": 1e6}, **AT_REST}, "scene"),
        Scene(foam=Foam(youngs_modulus=1e6), numerics=Numerics(end=0.01)),
        Scene(**AT_REST).with_values({"foam.youngs_modulus": 1e6}),
    ]
    for scene in scenes:
        assert of_foam(scene) >= MATERIAL - {"youngs_modulus"}
        assert "foam.youngs_modulus" not in assumed(scene)
        assert assumed(scene) >= ELSEWHERE


def test_what_is_given_is_not_assumed() -> None:
    foam = Foam()
    values = {key: getattr(foam, key) for key in MATERIAL if getattr(foam, key) is not None}
    scene = Scene(
        foam=Foam(**values, fracture_energy=50.0, shear_fracture_energy=30.0,
                  crush_band=0.005),
        block=Block(density=30.0),
        model=Model(shear_pressure_coefficient=1.0),
        numerics=Numerics(end=0.01, damping_time=1e-6),
    )  # fmt: skip
    assert assumed(scene) == set()


def test_it_is_written_and_read_back() -> None:
    scene = Scene.checked({"foam": {"curve": CURVE}, **AT_REST}, "scene")
    assert of_foam(scene) >= {"youngs_modulus", "locking_strain", "fracture_energy"}
    copy = scene_from_text(scene_to_toml(scene), "copy")
    assert copy == scene
    assert copy.assumed == scene.assumed


def test_what_followed_from_a_changed_constant_follows_anew() -> None:
    scene = Scene.checked({"foam": {"curve": CURVE}, **AT_REST}, "scene")
    stiffer = scene.with_values({"foam.youngs_modulus": 4e6})
    assert "foam.youngs_modulus" not in assumed(stiffer)
    assert stiffer.foam.shear_modulus == pytest.approx(3 / 8 * 4e6)
    again = scene_from_text(scene_to_toml(scene), "copy").with_values({"foam.youngs_modulus": 4e6})
    assert again.foam == stiffer.foam


def test_a_curve_makes_another_foam_of_it() -> None:
    own = Scene(foam=Foam(tensile_strain=0.2, crush_band=0.0075), numerics=Numerics(end=0.01))
    scene = own.with_values({"foam.curve": CURVE})
    assert scene.foam.law == "tabulated"
    assert scene.foam.crush_band == 0.0075
    assert "tensile_strain" in of_foam(scene)


def test_a_plateau_stress_stands_for_the_yield_strain() -> None:
    given = {"youngs_modulus": 2e6, "plateau_stress": 1e5}
    scene = Scene.checked({"foam": given, **AT_REST}, "scene")
    assert scene.foam.landmarks.crush_start == pytest.approx(-0.05)
    assert not {"yield_strain", "plateau_stress"} & of_foam(scene)
    lower = scene.with_values({"foam.plateau_stress": 5e4})
    assert lower.foam.landmarks.crush_start == pytest.approx(-0.025)
    assert Foam(plateau_stress=1.39e5).yield_strain == pytest.approx(-0.05)


@pytest.mark.parametrize(
    ("values", "told"),
    [
        ({"plateau_stress": -1e5}, "at least 500 Pa"),
        ({"plateau_stress": 0.12}, "stresses are in pascals"),
        ({"plateau_stress": 2e6}, "at most half"),
        ({"plateau_stress": "high"}, "must be a number"),
        ({"plateau_stress": 1e5, "yield_strain": -0.1}, "give one of the two"),
    ],
)
def test_a_plateau_stress_that_cannot_be_is_refused(values: dict, told: str) -> None:
    with pytest.raises(ValueError, match=told):
        Foam(**values)


def test_a_foam_put_in_as_a_whole_keeps_what_was_not_given_apart() -> None:
    scene = Scene(**AT_REST).with_values({"foam": Foam(youngs_modulus=3e6)})
    assert of_foam(scene) >= MATERIAL - {"youngs_modulus"}


def test_a_curve_may_be_changed_in_part() -> None:
    scene = Scene.checked({"foam": {"curve": CURVE, "source": "a test"}, **AT_REST}, "scene")
    doubled = scene.with_values({"foam.curve.stress": [2 * s for s in CURVE["stress"]]})
    assert doubled.foam.youngs_modulus == pytest.approx(2 * scene.foam.youngs_modulus)
    assert doubled.foam.source is None


@pytest.mark.parametrize("choices", CHOICE_SETS)
def test_choice_sets_leave_out_what_another_law_lacks(choices: str) -> None:
    scene = load_scene(Scene.checked({"foam": {"curve": CURVE}, **AT_REST}, "scene"), choices)
    assert scene.foam.law == "tabulated"


@pytest.mark.parametrize(
    ("entries", "told"),
    [
        (3, "assumed = 3: must be none, or a list"),
        ({"key": "foam.law"}, "must be none, or a list"),
        ([{"key": "foo.bar", "why": "x"}], "'foo.bar': must be the key of a value"),
        ([{"key": "foam.will", "why": "x"}], "'foam.will': must be the key of a value"),
        ([{"key": "block", "why": "x"}], "'block': must be the key of a value"),
        ([{"key": [1], "why": "x"}], "assumed[0].key = [1]: must be text"),
        ([{"key": {"a": 1}, "why": "x"}], "assumed[0].key = {'a': 1}: must be text"),
        ([{"key": "foam.law"}], "assumed[0].why: missing; must be text"),
        (["foam.law"], "assumed[0] = 'foam.law': must be a table with keys such as key, why"),
    ],
)
def test_entries_that_cannot_be_are_refused(entries: object, told: str) -> None:
    for foam in ("rigid-pu-60", {"youngs_modulus": 3e6}):
        with pytest.raises(UserError, match=re.escape(told)):
            Scene.checked({"foam": foam, "assumed": entries, **AT_REST}, "scene")


def test_a_place_in_a_list_is_no_value_of_a_foam() -> None:
    block = {"outline": [[-0.1, 0.0], [0.1, 0.0], [0.0, 0.1]]}
    entries = [{"key": "block.outline[0]", "why": "x"}]
    with pytest.raises(UserError, match="must be the key of a value"):
        Scene.checked({"block": block, "assumed": entries, **AT_REST}, "scene")


def test_only_the_program_says_what_is_assumed() -> None:
    with pytest.raises(UserError, match="written by the program"):
        Scene(**AT_REST).with_values({"assumed": None})
