"""Where the next points of a curve go."""

import numpy as np

from taichi_foam.cushions.refine import next_points


def test_a_kink_gets_the_points() -> None:
    x = np.linspace(0.0, 1.0, 9)
    found = next_points(x, np.abs(x - 0.55)[:, None], 4, 1e-3)
    assert len(found) == 4
    assert all(0.35 < place < 0.8 for place in found)


def test_a_line_gets_none() -> None:
    x = np.array([0.0, 0.1, 0.5, 1.0])
    assert next_points(x, np.column_stack([2.0 * x, 1.0 - x]), 5, 1e-9) == []


def test_of_a_parabola_halves_are_missed_by_a_quarter() -> None:
    """Lines over w miss x^2 by w^2 / 4: 1/16 in each of two halves, 1/64 in four quarters."""
    x = np.array([0.0, 0.5, 1.0])
    y = (x**2)[:, None]
    assert next_points(x, y, 9, 0.99 / 16) == [0.25, 0.75]
    assert next_points(x, y, 9, 1.01 / 16) == []


def test_what_does_not_count_gets_none() -> None:
    x = np.array([0.0, 0.5, 1.0])
    counts = np.array([False, True])
    assert next_points(x, (x**2)[:, None], 3, 1e-6, counts) == [0.625, 0.75, 0.875]
