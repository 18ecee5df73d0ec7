"""Crushed foam is weak all round, in tension across the crush too (foam.crushed_strength)."""

import numpy as np
import pytest
from bench import COLUMNS, INSTANT, ROWS, bench, numerics, small_scene

from taichi_foam.scene import Foam, Model

# Table 1's foam, and how far its limit in tension falls where it has been crushed across.
E_T, E_Y, E_D = 0.05, -0.05, -0.8
WEAK = Foam(crushed_strength=0.2, softening=False)
AT = (4, 9)  # a bond in the middle


def broken(
    axis: int, foam: Foam, stretch: float, crush: dict[tuple[int, int], float]
) -> np.ndarray:
    """Which bonds of this axis break in a block stretched along it.

    `crush` gives the worst strains of bonds across, by index.
    """
    scene = small_scene(foam=foam, model=Model(self_contact=False), numerics=numerics(dt=INSTANT))
    block = scene.block
    x = (np.arange(COLUMNS) - (COLUMNS - 1) / 2) * block.dx * (1 + stretch * (axis == 0))
    y = (np.arange(ROWS) + 0.5) * block.dy * (1 + stretch * (axis == 1))
    worst = np.zeros((COLUMNS, ROWS))
    for index, strain in crush.items():
        worst[index] = strain
    given = {"worst_b": worst[:, :-1]} if axis == 0 else {"worst_a": worst[:-1]}
    position = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1)
    with bench(scene, position=position, **given) as loaded:
        found = loaded.step(1)
    return found.broken_a if axis == 0 else found.broken_b


def limit(crush: float, strength: float = 0.2) -> float:
    """Tensile strain that foam crushed across to this strain bears."""
    share = min(max((crush - E_Y) / (E_D - E_Y), 0.0), 1.0)
    return E_T * (1.0 - (1.0 - strength) * share)


# For a bond along each axis: one that crosses it at its first node and one at its second.
ENDS = {0: (AT, (5, 8)), 1: (AT, (3, 10))}


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("crush", [-0.04, -0.05, -0.4, -0.8, -0.9])
def test_it_breaks_at_the_lower_limit(axis: int, crush: float) -> None:
    ends = dict.fromkeys(ENDS[axis], crush)
    assert not broken(axis, WEAK, limit(crush) - 1e-6, ends)[AT]
    assert broken(axis, WEAK, limit(crush) + 1e-6, ends)[AT]


@pytest.mark.parametrize("axis", [0, 1])
def test_the_end_that_is_crushed_less_counts(axis: int) -> None:
    near, far = ENDS[axis]
    crush = {near: -0.8, far: -0.3}
    assert not broken(axis, WEAK, limit(-0.3) - 1e-6, crush)[AT]
    assert broken(axis, WEAK, limit(-0.3) + 1e-6, crush)[AT]


@pytest.mark.parametrize("axis", [0, 1])
def test_only_that_connection_breaks(axis: int) -> None:
    """Its neighbours have a crushed cell at one end only."""
    found = broken(axis, WEAK, 0.03, dict.fromkeys(ENDS[axis], -0.8))
    assert np.argwhere(found).tolist() == [list(AT)]


@pytest.mark.parametrize("axis", [0, 1])
def test_off_it_changes_nothing(axis: int) -> None:
    assert not broken(
        axis, Foam(softening=False), E_T - 1e-6, dict.fromkeys(ENDS[axis], -0.9)
    ).any()
