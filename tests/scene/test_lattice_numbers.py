"""How many mass points a block has: square cells, of an edge that is given or not."""

from __future__ import annotations

import warnings

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from taichi_foam.errors import SceneNote, UserError
from taichi_foam.scene import Block, FlatBlock, Scene
from taichi_foam.scene.block import advice

lengths = st.floats(0.01, 0.5)
points = st.sampled_from(["cells", "faces"])


def scene(**block: object) -> Scene:
    return Scene.checked({"block": block, "impactor": {"shape": "flat"}}, "a scene")


@given(lengths, lengths, points)
def test_cells_are_square_by_default(width: float, height: float, mass_points: str):
    block = Block(width=width, height=height, mass_points=mass_points)
    least = min(block.columns, block.rows)
    # Nearest whole numbers: off by half a cell in the number of cells.
    assert block.dx / block.dy == pytest.approx(1.0, abs=1.1 / least)
    assert block.dy <= height / 20 * (1 + 1e-9) or block.columns == 10


@given(lengths, lengths, points, st.integers(3, 60))
def test_one_number_brings_the_other(width: float, height: float, mass_points: str, number: int):
    size = {"width": width, "height": height, "mass_points": mass_points}
    across, upwards = Block(**size, columns=number), Block(**size, rows=number)
    assert (across.columns, upwards.rows) == (number, number)
    found = across.rows - (mass_points == "faces")
    for block, cells in ((across, found), (upwards, upwards.columns)):
        nearest = 0.5 / (cells - 0.5)  # rounded to a whole number, but two at least
        assert cells <= 2 or block.dx / block.dy == pytest.approx(1.0, abs=nearest + 1e-9)


def test_an_edge_is_one_number_for_both():
    block = Block(width=0.2, height=0.05, cell=0.005, mass_points="faces")
    assert (block.columns, block.rows) == (40, 11)
    assert block.dx == pytest.approx(0.005)
    assert block.dy == pytest.approx(0.005)


def test_the_papers_lattice_is_the_default():
    """The paper's 40 by 20 cells, mass points on the faces of the block above and below."""
    assert (Block().columns, Block().rows) == (40, 21)
    assert Block(mass_points="cells").rows == 20
    assert repr(Block()) == "Block()"
    assert repr(Block(cell=0.01)) == "Block(cell=0.01)"


def test_what_contradicts_an_edge_is_refused():
    with pytest.raises(ValidationError, match=r"block.cell = 0.005 m make 40 columns"):
        Block(cell=0.005, columns=41)


def test_numbers_follow_what_they_follow_from():
    edge = scene(cell=0.01)
    assert edge.with_values(block__height=0.05).block.rows == 6
    changed = edge.with_values(block__rows=21).block
    assert (changed.cell, changed.columns, changed.rows) == (None, 40, 21)
    counted = scene(columns=40, rows=20).with_values(block__cell=0.004).block
    assert (counted.columns, counted.rows) == (50, 26)
    assert scene().with_values(block__mass_points="cells").block.rows == 20
    assert scene(rows=21).with_values(block__mass_points="cells").block.rows == 21


def test_a_written_scene_is_read_as_it_was():
    for block in ({"cell": 0.01}, {"rows": 10}, {}):
        given_ = scene(**block)
        data = given_.model_dump(exclude_none=True)
        assert Scene.checked(data, "again").block == given_.block


def test_the_old_name_of_the_depth_is_read_with_a_note():
    with pytest.warns(SceneNote, match=r"block.thickness is now block.depth"):
        assert Block(thickness=0.1) == Block(depth=0.1)
    with pytest.warns(SceneNote, match=r"block.depth"):
        assert scene().with_values({"block.thickness": 0.1}).block.depth == 0.1
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        Block(depth=0.1)
    with pytest.raises(UserError, match=r"block.thickness: unknown key; .*"):
        scene(thickness=0.1, depth=0.1)


def test_a_scene_with_impactor_is_unchanged_by_the_order_of_keys():
    plate = FlatBlock()
    first = Scene(block=Block(), impactor=plate).with_values(block__cell=0.005, block__height=0.05)
    second = Scene(block=Block(), impactor=plate).with_values(block__height=0.05, block__cell=0.005)
    assert first == second


def test_oblong_cells_are_advised_against() -> None:
    assert advice(Block()) is None
    assert advice(Block(width=0.15, height=0.05)) is None
    said = advice(Block(width=0.205, height=0.05, columns=41, rows=21))
    assert said is not None
    assert said.startswith("cells are 5 mm wide and 2.5 mm high: ")
    assert "block.cell = 0.0025" in said
