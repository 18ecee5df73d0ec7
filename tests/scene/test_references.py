"""What a scene's reference holds for: the impact that it was measured in, and no other."""

from __future__ import annotations

from pathlib import Path

import pytest

from taichi_foam import Scene, UserError, load_scene
from taichi_foam.catalogue import reference_by_name, reference_of, references, title
from taichi_foam.scene import CHOICE_SETS
from taichi_foam.scene.files import scene_from_toml, scene_to_toml

OWN = """
name = "my drop"
numerics.gravity = 9.81
block = { width = 0.1, height = 0.05, depth = 0.1 }
foam = { curve = { strain = [0.0, 0.05, 0.5, 0.7], stress = [0.0, 1e5, 1.2e5, 4e5] } }
impactor = { shape = "flat", width = 0.15, mass = 4.0, drop_height = 0.3 }

[reference]
source = "our laboratory, 2024"
figures = { peak_deceleration_g = 31.0 }
"""


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "own.toml"
    path.write_text(OWN)
    return path


def test_a_scene_of_ones_own_has_what_was_measured_in_it(file: Path) -> None:
    scene = load_scene(file)
    assert reference_of(scene).figures == {"peak_deceleration_g": 31.0}
    assert reference_of(scene).name == "my drop"
    assert title(scene) == "my drop"
    finer = scene.with_values({"block.rows": 30, "impactor.friction": 0.3, "name": "finer"})
    assert reference_of(finer) == scene.reference
    assert title(finer) == "finer"


@pytest.mark.parametrize(
    "change",
    [
        "impactor.mass=5", "impactor.drop_height=0.4", "block.height=0.06",
        "foam.curve.stress[3]=5e5", "impactor.shape=cylinder", "base.stops_impactor=false",
        "block.density=30",
    ],
)  # fmt: skip
def test_it_is_not_that_of_another_impact_and_is_again_of_the_same(file: Path, change: str) -> None:
    changed = load_scene(file, overrides=[change])
    assert reference_of(changed) is None
    assert title(changed) == "my drop, changed"
    key = change.partition("=")[0]
    if key in ("impactor.mass", "block.height", "block.density"):
        part, name = key.split(".")
        same = changed.with_values({key: getattr(getattr(load_scene(file), part), name)})
        assert reference_of(same) is not None


def test_a_resolved_scene_that_is_edited_is_another_impact(file: Path, tmp_path: Path) -> None:
    text = scene_to_toml(load_scene(file))
    path = tmp_path / "scene.toml"
    path.write_text(text)
    assert scene_from_toml(path) == load_scene(file)
    assert reference_of(scene_from_toml(path)) is not None
    path.write_text(text.replace("mass = 4.0", "mass = 4.5"))
    assert reference_of(scene_from_toml(path)) is None


def test_a_reference_has_a_source_and_figures() -> None:
    with pytest.raises(UserError, match="reference: missing; must be none, or a table with source"):
        Scene.checked({"impactor": {"shape": "flat"}, "reference": {"figures": {}}}, "scene")
    with pytest.raises(UserError, match=r"reference"):
        Scene.checked({"impactor": {"shape": "flat"}, "reference": "Table 2"}, "scene")
    scene = load_scene("gallery/own-foam")
    assert scene.reference is None
    assert reference_by_name(scene) is None


def test_a_figure_that_no_run_has_is_refused(file: Path) -> None:
    file.write_text(OWN.replace("peak_deceleration_g", "peak_decelleration_g"))
    with pytest.raises(UserError, match=r"figures.* did you mean peak_deceleration_g\?"):
        load_scene(file)


@pytest.mark.parametrize("choices", CHOICE_SETS)
def test_a_scene_without_a_reference_is_known_by_its_impact(choices: str) -> None:
    """Those of results that an older version has saved."""
    scene = load_scene("paper/cylinder-2.94", choices)
    old = scene.model_copy(update={"reference": None})
    assert reference_of(old) == references()["paper/cylinder-2.94"]
    assert title(old) == "cylinder, 2.94 m/s"
    heavier = old.with_values(impactor__mass=7.0)
    assert reference_of(heavier) is None
    assert title(heavier) == "paper/cylinder-2.94, changed"


@pytest.mark.parametrize("name", references())
def test_the_papers_scenes_are_read_as_calibrated(name: str) -> None:
    scene = load_scene(name)
    assert scene == load_scene(name, "calibrated")
    assert scene == load_scene(scene, "calibrated")
    assert scene.reference.impact == load_scene(name, "paper-literal").reference.impact
    assert [reference.fits(scene) for reference in references().values()].count(True) == 1
