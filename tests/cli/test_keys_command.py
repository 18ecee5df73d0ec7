"""`taichi-foam keys`: tables that fit the terminal, and nothing beside them."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from command_line import assert_refused

from taichi_foam.cli.reference import page
from taichi_foam.scene import Scene
from taichi_foam.scene.keys import keys

PARTS = (
    "scene, block, block.layers[], foam, across, impactor, base, support, model, numerics, start, "
    "output"
)


def test_all_keys_fit_into_eighty_columns(invoke: Callable) -> None:
    done = invoke("keys")
    assert (done.exit_code, done.stderr) == (0, "")
    lines = done.stdout.splitlines()
    assert max(map(len, lines)) <= 80
    for key in keys(Scene):
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
    assert_refused(done, guess, PARTS)
    assert len(done.stderr) < 400


def test_the_page(invoke: Callable) -> None:
    assert invoke("keys", "--markdown").stdout == page()
    assert_refused(invoke("keys", "block", "--markdown"), "leave PART out")
