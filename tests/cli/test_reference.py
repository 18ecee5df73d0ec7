"""`taichi-foam keys`: the keys of a scene are complete, true, and as docs/scene.md has them."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Literal

import pytest
from command_line import assert_refused

from taichi_foam.cli.reference import COMMAND, keys_of, page
from taichi_foam.laws.bond import FOAMS
from taichi_foam.laws.bond.by_curve import FROM_CURVE
from taichi_foam.laws.bond.kinds.crushable import Foam
from taichi_foam.laws.shape import SHAPES
from taichi_foam.parts import Part, quantity
from taichi_foam.scene import CHOICE_SETS, Scene
from taichi_foam.scene.block import SQUARE
from taichi_foam.scene.files import scene_from_text
from taichi_foam.scene.keys import REQUIRED, keys, listed
from taichi_foam.scene.values import settings

PAGE = Path(__file__).parents[2] / "docs" / "scene.md"
KEYS = list(keys(Scene))
PARTS = ("block", "across", "base", "support", "model", "numerics", "start", "output")
PART_NAMES = (
    "scene, block, block.layers[], foam, across, impactor, base, support, model, numerics, start, "
    "output"
)
CHOSEN = {"foam": FOAMS, "impactor": SHAPES}

#: Every class that a scene can hold: its part, its tag where it is one of several, the class.
KINDS: list[tuple[str, str, type[Part]]] = [
    *((part, "", type(Scene.model_fields[part].default)) for part in PARTS),
    *((part, tag, kind) for part, registry in CHOSEN.items() for tag, kind in registry.items()),
    *((head, "", kind) for head, kind in listed(Scene).items()),
]


def has(key, part: str, tag: str, field: str) -> bool:
    return key.key == f"{part}.{field}" and (not key.only or tag in key.only)


def test_the_page_is_as_it_is_written_now() -> None:
    assert PAGE.read_text(encoding="utf-8") == page(), f"docs/scene.md is old; renew it: {COMMAND}"


@pytest.mark.parametrize(("part", "tag", "kind"), KINDS, ids=lambda value: str(value)[:20])
def test_every_field_is_there_once_with_its_default(part: str, tag: str, kind: type[Part]) -> None:
    for name, field in kind.model_fields.items():
        (key,) = [key for key in KEYS if has(key, part, tag, name)]
        assert key.meaning
        assert key.allowed
        if part in CHOSEN and name == CHOSEN[part].tag:
            assert tag in key.allowed.split(", ")
            assert key.default == (CHOSEN[part].default or REQUIRED)
        elif field.is_required():
            assert key.default in (REQUIRED, FROM_CURVE)
        elif (part, name) in {("block", "columns"), ("block", "rows")}:  # computed
            assert key.default == SQUARE
        else:
            # what the table says is what one would write
            told = settings([f"{key.key}={key.default}"])[key.key]
            default = field.default
            if isinstance(default, float):
                assert not isinstance(told, str)
                assert told == pytest.approx(default, rel=1e-4, abs=0)
            elif isinstance(default, tuple):
                assert told == [list(row) for row in default]
            else:
                assert told == default
                assert type(told) is type(default)


def test_there_is_nothing_else() -> None:
    fields = {f"{part}.{name}" for part, _, kind in KINDS for name in kind.model_fields}
    assert {key.key for key in KEYS} == fields | {"name", "reference", "assumed"}
    # one of a name is for other shapes or laws than the next
    for key, count in Counter(key.key for key in KEYS).items():
        tags = [tag for each in KEYS if each.key == key for tag in each.only]
        assert count == 1 or len(tags) == len(set(tags)) >= count


@pytest.mark.parametrize("key", KEYS, ids=lambda key: key.key)
def test_a_number_has_a_unit_or_says_that_it_is_a_plain_one(key) -> None:
    texts = {
        "name", "reference", "assumed", "foam.source", "foam.curve", "block.layers",
        "base.acceleration",
    }  # fmt: skip
    words = key.key in texts or key.key.endswith(".foam") or key.default in ("true", "false")
    choice = re.fullmatch(r"[\w-]+(, [\w-]+)*", key.allowed) is not None
    assert (key.unit == "") == (words or choice)


def test_a_key_says_which_shapes_have_it() -> None:
    assert [key.about for key in keys_of("impactor.radius")] == ["radius (shape cylinder only)"]
    (turn,) = keys_of("impactor.rotation_deg")
    assert turn.only == ()
    heights = [(tag,) for tag, kind in SHAPES.items() if "height" in kind.model_fields]
    assert [key.only for key in keys_of("impactor.height")] == heights
    assert [key.only for key in keys_of("impactor.mass")] == [()]


@pytest.fixture
def stubborn() -> Iterator[None]:
    class Stubborn(Foam):
        law: Literal["stubborn"] = "stubborn"
        will: float = quantity(3e7, "Pa", "how much it resists", above=0, at_most=1e6)
        rate: float | None = quantity(100.0, "1/s", "how fast it gives in", above=0)

    FOAMS.register(Stubborn)
    yield
    FOAMS.remove("stubborn")


@pytest.mark.usefixtures("stubborn")
def test_a_law_that_comes_later_is_in_it() -> None:
    (law,), (will,) = keys_of("foam.law"), keys_of("foam.will")
    assert law.allowed == "crushable, tabulated, recovering, stubborn"
    assert (will.unit, will.default, will.allowed) == ("Pa", "3e7", "above 0 and at most 1e6 Pa")
    assert will.about == "how much it resists (law stubborn only)"
    assert [key.only for key in keys_of("foam.yield_strain")] == [("crushable", "stubborn")]


@pytest.mark.usefixtures("stubborn")
def test_choice_sets_stand_beside_the_default_of_the_default_law() -> None:
    assert "100" in [key.default for key in keys_of("foam.rate")]
    (row,) = [line for line in page().splitlines() if line.startswith("| `foam.rate` | `")]
    assert row.startswith("| `foam.rate` | `none` | `7` |")


def test_numbers_are_as_one_would_write_them() -> None:
    told = {key.key: key.default for key in KEYS if not {"tabulated", "recovering"} & {*key.only}}
    assert told["foam.youngs_modulus"] == "2.78e6"
    assert told["output.snapshot_interval"] == "0.001"
    assert told["foam.rate"] == "none"
    assert told["output.film"] == "true"
    assert told["start.deformation_gradient"] == "[[1, 0], [0, 1]]"


def test_the_page_has_the_choice_sets() -> None:
    for key in {key for chosen in CHOICE_SETS.values() for key in chosen}:
        (row,) = re.findall(rf"^\| `{key}` \|(.*)\|$", PAGE.read_text().split("## Keys")[0], re.M)
        for cell, chosen in zip(row.split("|")[1:], CHOICE_SETS.values(), strict=True):
            assert bool(cell.strip()) == (key in chosen)
            if key in chosen:
                assert settings([f"{key}={cell.strip(' `')}"])[key] == chosen[key]


def test_the_two_scenes_of_the_page_are_one() -> None:
    toml, python = (
        re.findall(rf"```{language}\n(.*?)```", PAGE.read_text(), re.S)[0]
        for language in ("toml", "python")
    )
    names: dict = {}
    exec(python, names)
    assert scene_from_text(toml, "the page") == names["scene"]
    assert names["faster"].impactor.velocity == 3.0


def test_all_keys_fit_into_eighty_columns(invoke: Callable) -> None:
    done = invoke("keys")
    assert (done.exit_code, done.stderr) == (0, "")
    lines = done.stdout.splitlines()
    assert max(map(len, lines)) <= 80
    for key in KEYS:
        assert any(
            line.startswith(f"{key.key} ") and f" {key.default} " in line for line in lines
        ), key.key
        assert " ".join(key.about.split()) in " ".join(done.stdout.split())


def test_a_part_and_a_key(invoke: Callable) -> None:
    part = invoke("keys", "block").stdout
    assert part.startswith("block: the foam block and its lattice\n")
    assert "impactor" not in part.replace("of the impactor", "")
    one = invoke("keys", "impactor.radius").stdout
    assert "impactor.radius  m     0.025    at least 0.0001 and at most 2 m" in one
    assert "radius (shape cylinder only)" in one
    assert "velocity" not in one


def test_brackets_are_no_markup(invoke: Callable) -> None:
    assert "[[1, 0], [0, 1]]" in invoke("keys", "start").stdout


@pytest.mark.parametrize(
    ("asked", "guess"),
    [
        ("blok", "did you mean block?"),
        ("impacter", "did you mean impactor?"),
        ("impactor.raduis", "did you mean impactor.radius?"),
        ("velocity", "did you mean impactor.velocity?"),
        ("xyzzy", "neither a part nor a key of a scene; the parts"),
        ("", "'': neither a part nor a key"),
        ("block.", "neither a part nor a key"),
        ("[/red]\n", "neither a part nor a key"),
        ("k" * 5000, "neither a part nor a key"),
    ],
)
def test_what_there_is_not_is_refused(asked: str, guess: str, invoke: Callable) -> None:
    done = invoke("keys", asked)
    assert_refused(done, guess, PART_NAMES)
    assert len(done.stderr) < 400


def test_the_page(invoke: Callable) -> None:
    assert invoke("keys", "--markdown").stdout == page()
    assert_refused(invoke("keys", "block", "--markdown"), "leave PART out")
