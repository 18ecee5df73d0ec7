"""Layers of a block: which row is of which foam, and all that a layer's foam may be."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from taichi_foam.analysis.measures import assumed_of
from taichi_foam.catalogue import load_scene
from taichi_foam.engine.grading import cuts
from taichi_foam.errors import UserError
from taichi_foam.scene import Block, FlatBlock, Foam, Layer, Numerics, Scene
from taichi_foam.scene.files import scene_from_text, scene_to_toml
from taichi_foam.scene.filling import filling
from taichi_foam.scene.layers import foams_of, foams_of_bonds, layer_of_rows, loose_rows

SIZE = {"width": 0.1, "height": 0.05, "columns": 20, "rows": 10, "mass_points": "cells"}
DROP = {"impactor": {"shape": "flat", "velocity": 3.0, "width": 0.05}}
STIFF = {"youngs_modulus": 5e6}
CURVE = "strain [%],stress [MPa]\n0,0\n5,0.1\n60,0.16\n80,0.8\n"


def scene_of(*layers: dict[str, Any], **more: Any) -> Scene:
    return Scene.checked({"block": {**SIZE, "layers": list(layers)}, **DROP, **more}, "scene")


def told(*layers: dict[str, Any], **more: Any) -> str:
    with pytest.raises(UserError) as caught:
        scene_of(*layers, **more)
    return str(caught.value)


def keys(scene: Scene) -> set[str]:
    return {each.key for each in scene.assumed or ()}


# --- rows -----------------------------------------------------------------------------------------


def test_a_row_is_of_the_layer_that_holds_its_middle() -> None:
    scene = scene_of({"bottom": 0.0, "top": 0.012, "foam": STIFF}, {"bottom": 0.0375, "top": 0.05})
    np.testing.assert_array_equal(layer_of_rows(scene.block), [0, 0, -1, -1, -1, -1, -1, 1, 1, 1])
    foams, rows = foams_of(scene)
    assert foams[0] == scene.foam == Foam()
    assert foams[1].youngs_modulus == 5e6
    assert len(foams) == 2  # the upper layer is of the block's foam
    np.testing.assert_array_equal(rows, [1, 1, 0, 0, 0, 0, 0, 0, 0, 0])


def test_mass_points_on_the_faces_belong_to_the_layers_there() -> None:
    block = Block(**SIZE | {"mass_points": "faces"}, layers=(
        Layer(bottom=0.0, top=0.02), Layer(bottom=0.03, top=0.05, density=50.0)))  # fmt: skip
    np.testing.assert_array_equal(layer_of_rows(block), [0, 0, 0, 0, -1, -1, 1, 1, 1, 1])
    mass = (0.02 * 50 + 0.03 * block.density) * block.width * block.depth
    assert filling(block).mass.sum() == pytest.approx(mass)


def test_a_bond_between_two_foams_is_of_the_one_that_crushes_first() -> None:
    strong = {"youngs_modulus": 2.78e6, "yield_strain": -0.1}
    for bottom, expected in ((0.0, [1, 0]), (0.025, [0, 0])):
        layer = {"bottom": bottom, "top": bottom + 0.025, "foam": strong}
        _, a, b = foams_of_bonds(scene_of(layer))
        np.testing.assert_array_equal(a[4:6], [1, 0] if bottom == 0 else [0, 1])
        np.testing.assert_array_equal(b[3:5], expected)


def test_foams_that_are_equal_are_one() -> None:
    layer = {"bottom": 0.0, "top": 0.01, "foam": STIFF}
    again = {"bottom": 0.03, "top": 0.04, "foam": STIFF}
    foams, rows = foams_of(scene_of(layer, again))
    assert len(foams) == 2
    np.testing.assert_array_equal(rows, [1, 1, 0, 0, 0, 0, 1, 1, 0, 0])


def test_loose_layers_are_cut_above_and_below() -> None:
    scene = scene_of(
        {"bottom": 0.0, "top": 0.01},
        {"bottom": 0.01, "top": 0.02, "interface": "loose"},
        {"bottom": 0.04, "top": 0.05, "interface": "loose"},
    )
    np.testing.assert_array_equal(loose_rows(scene.block), [1, 3, 7])
    cut = cuts(scene)
    np.testing.assert_array_equal(np.flatnonzero(cut[:, :, 1].all(axis=0)), [1, 3, 7])
    assert cut.sum() == 3 * 20
    assert not loose_rows(scene_of({"bottom": 0.0, "top": 0.05, "interface": "loose"}).block).size


@given(st.floats(0, 0.5), st.floats(0.1, 0.5), st.floats(1, 100), st.integers(5, 40))
def test_masses_are_those_of_layers_wherever_they_lie(
    bottom: float, thick: float, density: float, rows: int
) -> None:
    """A row through which a face of a layer runs has of both what it holds of them."""
    layer = Layer(bottom=bottom, top=bottom + max(thick, 1.21 / (rows - 1)), density=density)
    block = Block(width=1, height=1.2, columns=3, rows=rows, layers=(layer,))
    other = block.height - (layer.top - layer.bottom)
    total = (density * (layer.top - layer.bottom) + block.density * other) * block.depth
    assert filling(block).mass.sum() == pytest.approx(total, rel=1e-8)
    outline = ((-0.4, 0.0), (0.4, 0.0), (0.4, 1.1), (-0.4, 1.1))
    within = block.model_copy(update={"outline": outline})
    inside = max(min(layer.top, 1.1) - layer.bottom, 0.0)
    total = 0.8 * (density * inside + block.density * (1.1 - inside)) * block.depth
    assert filling(within).mass.sum() == pytest.approx(total, rel=1e-8)


# --- foams ----------------------------------------------------------------------------------------


def test_a_layers_foam_has_a_name_a_file_or_a_test(tmp_path: Path) -> None:
    (tmp_path / "test.csv").write_text(CURVE)
    (tmp_path / "own.toml").write_text(
        'title = "mine"\nsource = "me"\ndensity = 44\n[foam]\nyoungs_modulus = 4e6\n'
    )
    text = """
    [impactor]
    shape = "flat"
    velocity = 3
    [block]
    layers = [
      { bottom = 0.0, top = 0.02, foam = "rigid-pu-60" },
      { bottom = 0.02, top = 0.04, foam = "own.toml" },
      { bottom = 0.04, top = 0.06, foam = { like = "shim2000-pu", shear_strain = 0.2 } },
    ]
    """
    (tmp_path / "layers.toml").write_text('foam = "shim2000-pu"\n' + text)
    scene = load_scene(tmp_path / "layers.toml")
    first, second, third = scene.block.layers
    assert (first.density, second.density, third.density) == (60, 44, 25.6)
    assert second.foam.youngs_modulus == 4e6
    assert third.foam.shear_strain == 0.2
    assert "block.layers[0].density" in keys(scene)
    assert "block.layers[1].foam.shear_strain" in keys(scene)
    assert "block.layers[1].foam.youngs_modulus" not in keys(scene)
    assert "block.layers[2].foam.shear_strain" not in keys(scene)
    curved = text.replace('foam = "rigid-pu-60"', 'foam = { curve = "test.csv" }')
    curved = curved[: curved.index("{ bottom = 0.02")] + ']\n[foam]\ncurve = "test.csv"\n'
    (tmp_path / "curve.toml").write_text(curved)
    scene = load_scene(tmp_path / "curve.toml")
    assert scene.block.layers[0].foam.curve == scene.foam.curve
    assert {"foam.locking_strain", "block.layers[0].foam.locking_strain"} <= keys(scene)


def test_what_a_layer_assumes_is_said_with_its_value() -> None:
    scene = scene_of({"bottom": 0.0, "top": 0.02, "foam": STIFF})
    said = assumed_of(scene)
    assert any(
        line.startswith("block.layers[0].foam.shear_strain = 0.1: that of the paper")
        for line in said
    )
    assert "block.layers[0].density = none: that of the block" in said


def test_the_papers_foam_beside_a_layer_stays_the_papers() -> None:
    scene = scene_of({"bottom": 0.0, "top": 0.02, "foam": STIFF})
    again = scene.with_values({"block.rows": 20})
    assert again.foam == Foam()
    assert keys(again) == keys(scene)
    own = scene.with_values({"foam.youngs_modulus": 3e6})
    assert {"foam.shear_modulus", "block.density"} <= keys(own)
    assert keys(own) >= keys(scene)
    plain = scene.with_values({"block.layers": []})
    assert plain.assumed is None
    assert plain.block == Block(**SIZE)


def test_a_layer_is_changed_by_its_keys() -> None:
    scene = scene_of(
        {"bottom": 0.0, "top": 0.02, "foam": "rigid-pu-40"},
        {"bottom": 0.03, "top": 0.05, "foam": STIFF},
    )
    changed = scene.with_values({"block.layers[1].foam.shear_strain": 0.2})
    assert changed.block.layers[1].foam.shear_strain == 0.2
    assert keys(scene) - keys(changed) == {"block.layers[1].foam.shear_strain"}
    other = scene.with_values({"block.layers[0].foam": "rigid-pu-80"})
    assert other.block.layers[0].density == 80
    assert other.block.layers[1] == scene.block.layers[1]
    emptied = scene.with_values({"block.layers[0].foam": None})
    assert emptied.block.layers[0].foam is None
    assert not any(key.startswith("block.layers[0].foam") for key in keys(emptied))
    whole = scene.with_values({"block.layers[1]": Layer(bottom=0.03, top=0.04, density=50.0)})
    assert whole.block.layers[1].density == 50
    given = load_scene(scene, overrides=["block.layers[0].density=50"])
    assert given.block.layers[0].density == 50


def test_layers_are_written_and_read_back() -> None:
    scene = scene_of(
        {"bottom": 0.0, "top": 0.02, "foam": "rigid-pu-40", "interface": "loose"},
        {"bottom": 0.03, "top": 0.05, "foam": STIFF, "density": 30.0},
    )
    copy = scene_from_text(scene_to_toml(scene), "copy")
    assert copy == scene
    assert copy.assumed == scene.assumed


def test_parts_and_tables_say_the_same() -> None:
    layer = Layer(bottom=0.0, top=0.02, foam=Foam(**STIFF), density=30.0)
    scene = Scene(
        block=Block(**SIZE, layers=(layer,)), impactor=FlatBlock(width=0.05, velocity=3.0)
    )
    table = scene_of({"bottom": 0.0, "top": 0.02, "foam": STIFF, "density": 30.0})
    assert scene == table
    assert keys(scene) == keys(table)
    assert scene.with_values({"block.rows": 12}).block.layers == scene.block.layers


def test_readings_hold_for_layers_too() -> None:
    """What a choice set says of the foam, it says of all foams of a block."""
    layer = {"bottom": 0.0, "top": 0.02, "foam": STIFF}
    scene = load_scene(scene_of(layer), "calibrated")
    assert scene.block.layers[0].foam.crush_band == scene.foam.crush_band is not None
    literal = load_scene(scene, "paper-literal")
    assert not literal.block.layers[0].foam.softening
    narrow = scene_of(layer, foam={"crush_band": 0.003})
    assert narrow.block.layers[0].foam.crush_band == 0.003
    assert "block.layers[0].foam.crush_band" in keys(narrow)
    wider = narrow.with_values({"foam.crush_band": 0.004})
    assert wider.block.layers[0].foam.crush_band == 0.004
    layered = load_scene("paper/wedge-2.86").with_values({"block.layers": [layer]})
    foam = layered.block.layers[0].foam
    assert (foam.rate, foam.overshoot_strain) == (7.0, 0.0155)
    same = layered.with_values({"foam.rate": 50.0})
    assert same.block.layers[0].foam.rate == 50.0
    without = {**layer, "foam": {**STIFF, "rate": "none"}}
    with pytest.raises(UserError, match="different in rate, which only one of them gives"):
        load_scene("paper/wedge-2.86").with_values({"block.layers": [without]})


# --- what cannot be -------------------------------------------------------------------------------

BAND = {"bottom": 0.0, "top": 0.02}
TABLE = {"strain": [0.0, 0.05, 0.6, 0.8], "stress": [0.0, 1e5, 1.6e5, 8e5]}


@pytest.mark.parametrize(
    ("layers", "fragment"),
    [
        ([{"bottom": 0.02, "top": 0.01}], "block.layers[0].top = 0.01: must be above its bottom"),
        ([{"bottom": 0.02, "top": 0.06}], "block.layers[0].top = 0.06: above the block"),
        ([BAND, {"bottom": 0.01, "top": 0.03}], "block.layers[1].bottom = 0.01: lies inside"),
        ([{"bottom": 0.0201, "top": 0.0224}], "set block.rows = 22 or more"),
        ([{"bottom": 0.0}], "block.layers[0].top: missing"),
        ([{**BAND, "foam": "nothing"}], "block.layers[0].foam = 'nothing': not in the library"),
        ([{**BAND, "foam": "epe-30"}], "a foam that springs back"),
        ([{**BAND, "foam": {"curve": "no.csv"}}], "block.layers[0].foam.curve: no.csv: cannot be"),
        ([{**BAND, "foam": {"shear_strain": -1}}], "block.layers[0].foam.shear_strain = -1: must"),
        ([{**BAND, "foam": {"plateau_stress": 0.1}}], "block.layers[0].foam.plateau_stress = 0.1"),
        ([{**BAND, "foam": {"law": "hookes"}}], "block.layers[0].foam.law = 'hookes': must be one"),
        ([{**BAND, "foam": {"rate": 3000.0}}], "not match [foam], as it is different in rate"),
        ([{**BAND, "foam": {"curve": TABLE}}], "of the law tabulated; all foams"),
        ([{**BAND, "interface": "glue"}], "block.layers[0].interface = 'glue': must be 'bonded'"),
        ([{**BAND, "density": 0}], "block.layers[0].density = 0: must be"),
        ([{**BAND, "foam": 3}], "block.layers[0].foam = 3: must be a table"),
        ([3], "block.layers[0] = 3: must be a table with keys such as bottom"),
        (3, "block.layers = 3: must be a list"),
        ([{**BAND, "fom": 3}], "block.layers[0].fom: unknown key; did you mean block.layers[0]."),
    ],
)  # fmt: skip
def test_layers_that_cannot_be_are_refused(layers: Any, fragment: str) -> None:
    with pytest.raises(UserError, match=re.escape(fragment)):
        Scene.checked({"block": {**SIZE, "layers": layers}, **DROP}, "scene")


def test_a_layer_without_foam_is_refused() -> None:
    half = {"outline": [[-0.05, 0], [0.05, 0], [0.05, 0.02], [-0.05, 0.02]]}
    layers = [{"bottom": 0.03, "top": 0.04, "foam": STIFF}]
    with pytest.raises(UserError, match=r"block.layers\[0\]: 0.03 to 0.04 m contains no foam"):
        Scene.checked({"block": {**SIZE, **half, "layers": layers}, **DROP}, "scene")


def test_a_turned_lattice_has_no_layers() -> None:
    block = {**SIZE, "width": 0.2, "height": 0.2, "layers": [BAND], "lattice_angle_deg": 10.0,
             "outline": [[-0.05, 0], [0.05, 0], [0.05, 0.05], [-0.05, 0.05]]}  # fmt: skip
    with pytest.raises(UserError, match="must be 0 with"):
        Scene.checked({"block": block, **DROP}, "scene")


@pytest.mark.parametrize(
    ("key", "told_of"),
    [
        ("block.layers[3].density", "length 1, counted from"),
        ("block.layers.density", "a list has no keys"),
        ("block.rows[0]", "no keys of its own"),
        ("block[0].rows", "only lists have entries"),
        ("block.layers[0].bottom.x", "no keys of its own"),
    ],
)
def test_places_that_there_are_not(key: str, told_of: str) -> None:
    scene = Scene(block=Block(**SIZE, layers=(Layer(**BAND),)), numerics=Numerics(end=0.01))
    with pytest.raises(UserError, match=told_of):
        scene.with_values({key: 1.0})


def test_start_strains_stay_above_the_limit_of_every_foam() -> None:
    layer = {**BAND, "foam": {"locking_strain": -0.5, "densification_strain": -0.4}}
    start = {"deformation_gradient": [[1.0, 0.0], [0.0, 0.45]]}
    assert "the foam's limit of -0.5" in told(layer, start=start)
