"""Figures of a sweep: what they show of known drops, and what they refuse."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from drops import Solver, axis, plan_of

import taichi_foam as tf
from taichi_foam.errors import UserError
from taichi_foam.sweeps.figure import shown
from taichi_foam.sweeps.run import Sweep

MASS = {"key": "impactor.mass", "values": [3.0, 6.0]}


@pytest.fixture(scope="module")
def swept(tmp_path_factory: pytest.TempPathFactory) -> Sweep:
    """Velocities from 2.1 to 4.1, two masses, each drop three times."""
    plan = plan_of(axis(low=2.1, high=4.1, count=5), MASS, chunk=16, repeats={"count": 3})
    return tf.sweep(plan, tmp_path_factory.mktemp("figure") / "s", solve=Solver())


def test_a_curve_has_the_median_and_its_band_the_spread(swept: Sweep) -> None:
    (axes,) = shown(swept, "max_displacement_m").axes
    assert axes.get_xlabel() == "impactor.velocity (m/s)"
    assert axes.get_ylabel() == "maximum displacement (cm)"
    assert [text.get_text() for text in axes.texts] == ["3", "6", "by impactor.mass (kg)"]
    curve, _ = axes.lines
    velocities = np.linspace(2.1, 4.1, 5)
    # a drop at more than 3.9 m/s has no answer, and two of three then have no median
    np.testing.assert_allclose(curve.get_xdata(), velocities)
    np.testing.assert_allclose(curve.get_ydata(), [*velocities[:4], np.nan])
    edges = np.asarray(axes.collections[0].get_paths()[0].vertices)
    at_first = edges[np.isclose(edges[:, 0], 2.1), 1]
    # from the 5 to the 95 % quantile of three repeats within 0.5 %
    assert at_first.max() == pytest.approx(2.1 * (1 + 0.9 * 0.005))
    assert at_first.min() == pytest.approx(2.1 * (1 - 0.9 * 0.005))


def test_a_map_has_a_cell_for_each_pair(swept: Sweep) -> None:
    axes, bar = shown(swept, "max_displacement_m", as_map=True).axes
    values = axes.collections[0].get_array()
    assert values.shape == (2, 5)
    assert np.isnan(np.ma.filled(values, np.nan)[:, 4]).all()
    assert axes.get_ylabel() == "impactor.mass (kg)"
    assert bar.get_ylabel() == "maximum displacement (cm)"


def test_axes_can_be_exchanged(swept: Sweep) -> None:
    (axes,) = shown(swept, "pieces", x="impactor.mass", by="impactor.velocity").axes
    assert len(axes.lines) == 5
    assert axes.get_xlabel() == "impactor.mass (kg)"


def test_a_sample_is_gathered_into_bins(tmp_path: Path) -> None:
    velocity = {"key": "impactor.velocity", "from": 2.0, "to": 3.8}
    mass = {"key": "impactor.mass", "from": 1.0, "to": 10.0, "spacing": "log"}
    plan = plan_of(velocity, mass, chunk=64, sample={"method": "sobol", "count": 60})
    swept = tf.sweep(plan, tmp_path / "s", solve=Solver())
    (axes,) = shown(swept, "max_displacement_m").axes
    points, curve, *_ = axes.lines
    assert len(points.get_xdata()) == 20  # a third of the masses
    assert len(curve.get_xdata()) == 4
    np.testing.assert_allclose(curve.get_xdata(), curve.get_ydata(), rtol=0.06)
    shown(swept, "max_displacement_m", as_map=True)


@pytest.mark.parametrize(
    ("asked", "says"),
    [
        ({"measure": "max_displacment_m"}, "no column of the table; did you mean max_displ"),
        ({"measure": "warnings"}, "warnings: holds words"),
        ({"measure": "pieces", "x": "block.rows"}, "no axis of the sweep; there are impactor.v"),
        ({"measure": "pieces", "by": "impactor.velocity"}, "no axis of the sweep"),
    ],
)
def test_what_cannot_be_shown_is_refused(swept: Sweep, asked: dict, says: str) -> None:
    with pytest.raises(UserError) as refused:
        shown(swept, **asked)
    assert says in str(refused.value)
