"""The start of a scene without a lattice is the one that a lattice is loaded with."""

from __future__ import annotations

import numpy as np
import pytest
from bench import bench

import taichi_foam as tf
from taichi_foam.engine.state import initial_state

SCENES = (
    ("paper/wedge-2.86", ["impactor.gap=0.01", "start.cuts=[[0, 0.05, 0, 0.2]]"]),
    ("gallery/shear-patch", []),
    ("gallery/uniaxial-crush", []),
    ("gallery/wave-bar", []),
    ("gallery/shear-patch", ["start.deformation_gradient=[[0.8, 0], [0, 0.7]]"]),
    ("gallery/shear-patch", ["start.deformation_gradient=[[0.98, 0], [0, 0.7]]", "foam.rate=3000"]),
)


@pytest.mark.parametrize(("name", "overrides"), SCENES, ids=range(len(SCENES)))
def test_it_equals_the_first_snapshot_of_a_lattice(name: str, overrides: list[str]) -> None:
    scene = tf.load_scene(name, overrides=overrides)
    with bench(scene) as loaded:
        (expected,) = loaded.snapshots()
    found = initial_state(scene).snapshot()
    for field in ("time", "impactor_y", "position", "velocity"):
        np.testing.assert_allclose(
            getattr(found, field), getattr(expected, field), rtol=1e-14, atol=1e-16
        )
    np.testing.assert_array_equal(found.broken_a, expected.broken_a)
    np.testing.assert_array_equal(found.broken_b, expected.broken_b)
    # the lattice's strains come from positions up to 200 cells from the middle: rounded so often
    np.testing.assert_allclose(found.e_min_a, expected.e_min_a, atol=1e-12)
    np.testing.assert_allclose(found.e_min_b, expected.e_min_b, atol=1e-12)
