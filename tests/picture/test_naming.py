"""What runs are called side by side: what differs, all of it, and where it is not cut."""

from __future__ import annotations

from typing import Literal

import pytest

from taichi_foam import catalogue, load_scene
from taichi_foam.laws.bond import FOAMS
from taichi_foam.picture.naming import names, told_apart
from taichi_foam.scene import Foam, Scene

FOLDERS = ("a", "b", "c", "d")


def paper(name: str, *settings: str) -> Scene:
    """A test of the paper."""
    return load_scene(f"paper/{name}", overrides=list(settings))


def called(*scenes: Scene) -> list[tuple[str, str]]:
    return names(scenes, FOLDERS[: len(scenes)], [catalogue.caption(scene) for scene in scenes])


def renamed(name: str, *settings: str) -> Scene:
    return paper("wedge-2.86", *settings).model_copy(update={"name": name})


def test_names_are_those_of_the_scenes() -> None:
    one, two = (renamed(name) for name in ("one", "two"))
    assert called(one, two) == [("one", ""), ("two", "")]


def test_names_are_the_titles_of_the_papers_tests() -> None:
    scenes = [paper("wedge-2.86"), paper("rectangular-3.03"), paper("cylinder-3.32")]
    titles = ["wedge, 2.86 m/s", "flat block, 3.03 m/s", "cylinder, 3.32 m/s"]
    assert called(*scenes) == [(title, "") for title in titles]


def test_a_test_that_was_changed_has_not_the_title_of_the_test() -> None:
    velocities = (2.5, 2.86, 4.0)
    scenes = [paper("wedge-2.86", f"impactor.velocity={v}") for v in velocities]
    changed = "paper/wedge-2.86, changed"
    assert called(*scenes) == [
        ("velocity = 2.5 m/s", changed),
        ("wedge, 2.86 m/s", "velocity = 2.86 m/s"),
        ("velocity = 4 m/s", changed),
    ]
    many = ["impactor.velocity=4", "impactor.mass=5", "block.rows=40"]
    assert called(paper("wedge-2.86"), paper("wedge-2.86", *many)) == [
        ("wedge, 2.86 m/s", "a"), (changed, "b"),
    ]  # fmt: skip


def test_without_captions_scenes_have_their_names() -> None:
    scenes = [paper("wedge-2.86"), paper("rectangular-3.03", "foam.rate=3000")]
    found = names(scenes, FOLDERS[:2])
    assert [name for name, _ in found] == ["paper/wedge-2.86", "paper/rectangular-3.03"]


def test_what_differs_besides_follows_a_title() -> None:
    soft, stiff = "foam.youngs_modulus=2.5e6", "foam.youngs_modulus=50e6"
    words = ["youngs_modulus = 2.5 MPa", "youngs_modulus = 50 MPa"]
    pair = called(paper("wedge-2.86", soft), paper("cylinder-3.32", stiff))
    titles = ["paper/wedge-2.86, changed", "paper/cylinder-3.32, changed"]
    assert pair == list(zip(titles, words, strict=True))
    readings = [paper("wedge-2.86", "foam.rate=3000"), paper("cylinder-3.32")]
    assert called(*readings) == [
        ("wedge, 2.86 m/s", "foam.rate = 3000 1/s"), ("cylinder, 3.32 m/s", "foam.rate = 7 1/s"),
    ]  # fmt: skip
    assert called(renamed("one", soft), renamed("two", stiff)) == [
        ("one", words[0]), ("two", words[1]),
    ]  # fmt: skip
    many = ["block.rows=40", "block.columns=80", "foam.rate=3000"]
    pair = called(paper("wedge-2.86"), paper("cylinder-3.32", *many))
    assert pair == [("wedge, 2.86 m/s", "a"), ("cylinder, 3.32 m/s", "b")]


def test_the_draw_of_an_ensemble_is_no_difference_between_tests() -> None:
    scattered = "foam.strength_scatter=0.1"
    pair = called(
        paper("wedge-2.86", scattered, "foam.strength_seed=3"),
        paper("cylinder-3.32", scattered, "foam.strength_seed=8"),
    )
    assert [aside for _, aside in pair] == ["", ""]
    seeds = [paper("wedge-2.86", scattered, f"foam.strength_seed={n}") for n in (3, 8)]
    assert told_apart(seeds) == ("strength_seed = 3", "strength_seed = 8")


def test_what_differs_stands_before_the_title_that_all_share() -> None:
    pair = called(*(paper("wedge-2.86", f"impactor.gap={gap}") for gap in (0.01, 0.05)))
    title = "paper/wedge-2.86, changed"
    assert pair == [("gap = 0.01 m", title), ("gap = 0.05 m", title)]
    rows = [paper("wedge-2.86", f"block.rows={n}") for n in (21, 41)]
    found = called(rows[0], renamed("other"), rows[1])
    title = "wedge, 2.86 m/s"
    assert found == [("rows = 21", title), ("other", "rows = 21"), ("rows = 41", title)]
    found = called(rows[0], renamed("other"), rows[0])
    assert found == [("a", title), ("other", ""), ("c", title)]


def test_choice_sets_do_not_hide_what_else_differs() -> None:
    literal = load_scene("paper/wedge-2.86", "paper-literal")
    assert told_apart([paper("wedge-2.86"), literal]) == ("calibrated", "paper-literal")
    other = load_scene(literal, overrides=["impactor.gap=0.01"])
    expected = ("calibrated, gap = 0 m", "paper-literal, gap = 0.01 m")
    assert told_apart([paper("wedge-2.86"), other]) == expected
    many = load_scene(other, overrides=["block.rows=40", "foam.tensile_strain=0.06"])
    assert told_apart([paper("wedge-2.86"), many]) is None


def test_a_shape_hides_its_own_sizes_only() -> None:
    wedge = paper("wedge-2.86")
    cylinder = load_scene(wedge, overrides=["impactor.shape=cylinder"])
    assert told_apart([wedge, cylinder]) == ("wedge", "cylinder")
    heavy = load_scene(cylinder, overrides=["impactor.mass=7"])
    assert told_apart([wedge, heavy]) == ("mass = 6 kg, wedge", "mass = 7 kg, cylinder")
    many = ["impactor.mass=7", "impactor.x=0.01", "foam.rate=3000"]
    assert told_apart([wedge, load_scene(cylinder, overrides=many)]) is None


def test_a_law_hides_its_own_constants_only() -> None:
    class OtherFoam(Foam):
        law: Literal["other"] = "other"
        stickiness: float = 1.0
        springiness: float = 2.0

    FOAMS.register(OtherFoam)
    try:
        wedge = paper("wedge-2.86")
        foam = OtherFoam(shear_modulus=0.8e6, crush_band=wedge.foam.crush_band)
        other = wedge.model_copy(update={"foam": foam})
        assert told_apart([wedge, other]) == (
            "law = crushable, shear_modulus = 840 kPa", "law = other, shear_modulus = 800 kPa"
        )  # fmt: skip
    finally:
        FOAMS.remove("other")


def test_names_are_what_differs_among_three_and_four() -> None:
    a = paper("wedge-2.86")
    rows = [load_scene(a, overrides=[f"block.rows={n}"]) for n in (21, 40, 10, 30)]
    for count in (3, 4):
        expected = tuple(f"rows = {n}" for n in (21, 40, 10, 30)[:count])
        assert told_apart(rows[:count]) == expected
    assert told_apart([a, rows[0], rows[1]]) is None  # the first two do not differ


@pytest.mark.parametrize(
    ("settings", "expected"),
    [
        (["model.damping=absolute"], ("damping = stiffness", "damping = absolute")),
        (["impactor.velocity=3"], ("velocity = 2.86 m/s", "velocity = 3 m/s")),
        (["impactor.friction=0.5"], ("impactor.friction = 0.13", "impactor.friction = 0.5")),
        (["block.width=0.3"], ("block.width = 0.2 m", "block.width = 0.3 m")),
        (["numerics.dt=2e-6"], ("dt = auto", "dt = 2 µs")),
        (["foam.densification_strain=-0.7"],
         ("densification_strain = -0.8", "densification_strain = -0.7")),
        (["model.self_contact=false", "block.rows=40"],
         ("rows = 21, self_contact = true", "rows = 40, self_contact = false")),
        (["output.mode=stress"], None),
        (["block.rows=40", "block.columns=80", "foam.rate=3000"], None),
    ],
)  # fmt: skip
def test_names_are_what_differs(settings: list[str], expected: tuple | None) -> None:
    a = paper("wedge-2.86")
    assert told_apart([a, load_scene(a, overrides=settings)]) == expected


def test_names_are_the_folders_where_nothing_else_helps() -> None:
    one = paper("wedge-2.86")
    assert called(one, one) == [("a", "wedge, 2.86 m/s"), ("b", "wedge, 2.86 m/s")]
