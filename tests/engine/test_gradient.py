"""Forces of bonds and cells are less the gradient of the energy that they store, to rounding.

The energy is written down here once more, in NumPy, for any block, and its gradient is taken by
complex steps: f(x + i h) is f(x) + i h f'(x) to the last bit, for an h however small.
"""

import numpy as np
import pytest
from bench import LIFT, bench, node_forces, small_scene

from taichi_foam.engine import transfer
from taichi_foam.records.history import row_columns
from taichi_foam.scene import Base, Block, Foam, Model, Scene
from taichi_foam.scene.filling import filling
from taichi_foam.scene.layers import foams_of_bonds

STRONG = {"tensile_strain": 1.0, "shear_strain": 2.0}
SOFT = Foam(**STRONG)
STIFF = Foam(youngs_modulus=5e6, shear_modulus=1.7e6, plateau_stress=0.25e6, **STRONG)
LACKING = 1e-9  # of its area at rest a cell may lack without pressure, for rounding
PACKED = 4.0  # stiffness of crushed foam without room, over K

Arrays = dict[str, np.ndarray]


def block(**values: object) -> Block:
    given = {"width": 0.03, "height": 0.04, "columns": 6, "rows": 8, "mass_points": "cells"}
    return Block(**{**given, **values})


BLOCKS = {
    "square cells": block(),
    "wide cells": block(width=0.048),
    "flat cells": block(height=0.02),
    "outline with a hole": block(
        outline=[(-0.015, 0), (0.015, 0), (0.0108, 0.04), (-0.012, 0.04)],
        holes=[[(-0.0042, 0.016), (0.0048, 0.016), (0.0, 0.024)]],
    ),
    "outline on faces": block(
        outline=[(-0.015, 0), (0.015, 0), (0.0108, 0.04), (-0.012, 0.04)], mass_points="faces"
    ),
    "two layers on faces": block(
        mass_points="faces",
        layers=[{"bottom": 0.0172, "top": 0.04, "foam": STIFF, "density": 45.0}],
    ),
}
GRADIENTS = {
    "stretched and turned": ((0.8, -0.58), (0.6, 0.81)),
    "sheared": ((1.0, 0.12), (-0.03, 0.98)),
    # bonds B half as long and leaning over: cells lack room
    "crushed": ((0.97, 0.5), (0.0, 0.15)),
}


def start_of(scene: Scene, name: str, cracked: bool) -> Arrays:
    """A state near a gradient, in which each bond unloads, or is elastic: nothing is lost."""
    rng = np.random.default_rng(21)
    block, filled = scene.block, filling(scene.block)
    cell = np.array([block.dx, block.dy])
    position = block.positions @ np.array(GRADIENTS[name]).T
    position = position + rng.uniform(-0.004, 0.004, position.shape) * cell + LIFT
    found: Arrays = {"position": position}
    for axis, face in enumerate((filled.face_a, filled.face_b)):
        key = "ab"[axis]
        strain = np.linalg.norm(np.diff(position, axis=axis), axis=-1) / cell[axis] - 1.0
        met = np.where(strain < -0.05, strain - rng.uniform(0.0, 0.1, strain.shape), 0.0)
        found[f"worst_{key}"] = np.where(face > 0.0, np.minimum(met, strain * (strain < 0.0)), 0.0)
        if cracked:
            soft = rng.integers(1, 16, strain.shape) / 16.0  # which 32 bits hold
            found[f"intact_{key}"] = np.where(rng.random(strain.shape) < 0.3, soft, 1.0)
            broken = (rng.random(strain.shape) < 0.2) & (face > 0.0)
            found[f"broken_{key}"] = [tuple(map(int, at)) for at in np.argwhere(broken)]
    return found


def stored(scene: Scene, start: Arrays, position: np.ndarray) -> dict[str, float]:
    """Energies [J] of bonds, of the cells' shear and of their room at complex positions."""
    block, filled = scene.block, filling(scene.block)
    cell = (block.dx, block.dy)
    volume = block.dx * block.dy * block.depth
    foams, *rows = foams_of_bonds(scene)
    found = {"in_bonds": 0.0}
    left = []
    for axis, face in enumerate((filled.face_a, filled.face_b)):
        key = "ab"[axis]
        share = np.array(start.get(f"intact_{key}", np.ones(face.shape)))
        for place in start.get(f"broken_{key}", ()):
            share[place] = 0.0
        left.append(share)
        way = np.diff(position, axis=axis)
        strain = np.sqrt((way**2).sum(axis=-1)) / cell[axis] - 1.0
        worst = start[f"worst_{key}"]
        for number, foam in enumerate(foams):
            K, e_y, e_c = foam.youngs_modulus, foam.yield_strain, 0.5 * foam.tensile_strain
            crushed = worst < e_y
            permanent = np.where(crushed, np.maximum(worst, foam.densification_strain) - e_y, 0.0)
            elastic = strain - permanent
            assert elastic.real[(face > 0.0)].min() > e_y - 1e-12
            weaker = np.where(crushed, e_c / (e_c - permanent), 1.0) * share
            energy = 0.5 * K * elastic**2 * np.where(elastic.real > 0.0, weaker, 1.0)
            mine = np.broadcast_to(rows[axis] == number, face.shape)
            found["in_bonds"] += volume * (energy * face * mine).sum()
    first, second = position[:-1, :-1], position[1:, :-1]
    third, fourth = position[1:, 1:], position[:-1, 1:]
    along_x = 0.5 * ((second - first) + (third - fourth)) / block.dx
    along_y = 0.5 * ((fourth - first) + (third - second)) / block.dy
    gamma = (along_x * along_y).sum(axis=-1) - start.get("shear_set", 0.0)
    a, b = left
    grip = np.maximum(a[:, :-1], a[:, 1:]) * np.maximum(b[:-1], b[1:]) * filled.cell
    one, other = third - first, fourth - second
    area = 0.5 * (one[..., 0] * other[..., 1] - one[..., 1] * other[..., 0]) / (cell[0] * cell[1])
    worst_a, worst_b = start["worst_a"], start["worst_b"]
    room = 1.0 + 0.5 * (worst_a[:, :-1] + worst_a[:, 1:])
    room = room * (1.0 + 0.5 * (worst_b[:-1] + worst_b[1:]))
    found |= {"in_shear": 0.0, "in_room": 0.0}
    for number, foam in enumerate(foams):
        mine = filled.cell * np.broadcast_to(rows[1] == number, grip.shape)
        shear = 0.5 * foam.shear_modulus * gamma**2 * (grip * (mine > 0.0))
        found["in_shear"] += volume * shear.sum()
        lacks = np.minimum(room, 1.0 + foam.densification_strain) - area - LACKING
        pressed = 0.5 * PACKED * foam.youngs_modulus * lacks**2 * (lacks.real > 0.0)
        found["in_room"] += volume * (pressed * mine).sum()
    return found


def gradient(scene: Scene, start: Arrays) -> np.ndarray:
    """Of all stored energy by all positions [N], (I, J, 2)."""
    found = np.zeros_like(start["position"])
    for index in np.argwhere(np.ones(found.shape)):
        position = start["position"].astype(complex)
        position[tuple(index)] += 1e-30j
        found[tuple(index)] = sum(stored(scene, start, position).values()).imag / 1e-30
    return found


@pytest.mark.parametrize("cracked", [False, True], ids=["whole", "cracked"])
@pytest.mark.parametrize("shape", BLOCKS)
@pytest.mark.parametrize("name", GRADIENTS)
def test_forces_are_less_the_gradient_of_the_stored_energy(
    name: str, shape: str, cracked: bool
) -> None:
    """And the ledger has that energy, each part by itself."""
    scene = small_scene(
        block=BLOCKS[shape], foam=SOFT, base=Base(kind="floor"),
        model=Model(self_contact=False, shear_yield=False),
    )  # fmt: skip
    start = start_of(scene, name, cracked)
    check(scene, start)
    energies = stored(scene, start, start["position"].astype(complex))
    assert (energies["in_room"].real > 0.0) == (name == "crushed")


def test_so_are_those_of_cells_whose_shear_has_yielded() -> None:
    """The part of their shear that lasts stores nothing."""
    scene = small_scene(
        block=BLOCKS["wide cells"], foam=SOFT, base=Base(kind="floor"),
        model=Model(self_contact=False),
    )  # fmt: skip
    start = start_of(scene, "crushed", cracked=True)
    shape = start["worst_a"].shape[0], start["worst_b"].shape[1]
    start["shear_set"] = np.random.default_rng(4).integers(-12, 13, shape) / 128.0  # in 32 bits
    for key, axis in (("worst_a", 0), ("worst_b", 1)):  # none yields further
        cell = scene.block.dy if axis else scene.block.dx
        strain = np.linalg.norm(np.diff(start["position"], axis=axis), axis=-1) / cell - 1.0
        start[key] = np.minimum(strain, 0.0) + SOFT.yield_strain - 0.01
    check(scene, start)


def check(scene: Scene, start: Arrays) -> None:
    """Forces by the gradient, and energies by the ledger's, each part by itself.

    Forces of some 100 N round to 1e-9 N, as in bench.py.
    """
    forces = node_forces(scene, **start)
    there = filling(scene.block).there
    expected = np.where(there[..., None], -gradient(scene, start), 0.0)
    assert np.abs(expected).max() > 10.0
    np.testing.assert_allclose(forces, expected, rtol=1e-11, atol=2e-9)
    with bench(scene, **start) as loaded:
        transfer.advance_of(loaded.lattice)(loaded.lattice, 1)
        row = dict(
            zip(row_columns(turns=False), transfer.harvest(loaded.lattice)[1][0][0], strict=True)
        )
    assert row["clock.time"] == 0.0
    energies = stored(scene, start, start["position"].astype(complex))
    assert energies["in_bonds"].real > 0.0
    assert energies["in_shear"].real > 0.0
    for part, energy in energies.items():
        assert row[part] == pytest.approx(energy.real, rel=1e-10, abs=1e-15), part
