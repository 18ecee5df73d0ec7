"""Scenes of cushions, without computing them."""

from pathlib import Path

import numpy as np
import pytest

from taichi_foam.analysis.balance import balance
from taichi_foam.cushions.scenes import cushion_scene
from taichi_foam.errors import UserError
from taichi_foam.scene import Scene
from taichi_foam.units import STANDARD_GRAVITY

TEST = Path(__file__).parents[2] / "scenes" / "own_foam.csv"
TRAPEZOID = [(0.0, 0.0), (4.0, 0.0), (3.0, 2.0), (1.0, 2.0)]


def area_under_product(scene: Scene, height: float) -> float:
    """The level area of a pad at a height that the impactor covers [m2]."""
    assert scene.impactor is not None
    corners = np.array(scene.block.corners)
    at = corners[np.isclose(corners[:, 1], height), 0]
    ends = scene.impactor.x + scene.impactor.outline()[:, 0]
    return (min(at.max(), ends.max()) - max(at.min(), ends.min())) * scene.block.depth


@pytest.mark.parametrize("shape", ["flat", "edge", "rib"])
def test_the_product_weighs_the_static_stress_times_the_area_it_rests_on(shape: str) -> None:
    scene = cushion_scene(TEST, 0.06, 0.76, 4e3, shape=shape, width=0.18, depth=0.1)
    assert scene.impactor is not None
    area = area_under_product(scene, 0.06)
    clearance = 0.005 * 0.1 if shape == "edge" else 0.0
    weight = scene.impactor.mass * STANDARD_GRAVITY
    assert weight == pytest.approx(4e3 * (area + clearance))


def test_the_strip_of_a_flat_pad_meets_the_conditions_of_the_energy_balance() -> None:
    found = balance(cushion_scene(str(TEST), 0.05, 1.0, 5.23e3))
    assert found is not None
    assert found.static_stress == pytest.approx(5.23e3)
    assert found.strain == pytest.approx(0.710, abs=2e-3)  # as in scenes/own_foam.toml


def test_an_outline_is_scaled_to_the_thickness() -> None:
    scene = cushion_scene(TEST, 0.05, 0.76, 4e3, shape=TRAPEZOID)
    assert scene.block.outline == ((-0.05, 0.0), (0.05, 0.0), (0.025, 0.05), (-0.025, 0.05))
    assert scene.impactor is not None
    assert scene.impactor.width > scene.block.width


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"thickness": 0.0}, "thickness = 0: must be a number above 0 m; 50 mm is"),
        ({"drop_height": float("nan")}, "drop_height = nan"),
        ({"thickness": "thick"}, "thickness = 'thick'"),
        ({"static_stress": -1.0}, "static_stress = -1: "),
        ({"shape": "round"}, "shape = 'round': must be flat, edge, rib, or a CSV file"),
        ({"shape": [(0, 0), (1, 0)]}, "the outline has no height"),
        ({"shape": 3}, "shape = 3"),
        ({"foam": "no foam"}, "not in the library"),
    ],
)
def test_what_makes_no_cushion_is_refused(values: dict, words: str) -> None:
    usual = {"foam": TEST, "thickness": 0.05, "drop_height": 0.76, "static_stress": 4e3}
    with pytest.raises(UserError, match=words):
        cushion_scene(**{**usual, **values})
