"""Figures of a sweep: what they show of known drops, and what they refuse."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from drops import Solver, axis, plan_of
from matplotlib.figure import Figure

import taichi_foam as tf
from taichi_foam.errors import UserError
from taichi_foam.sweeps import figure
from taichi_foam.sweeps.figure import _print_numbers, shown
from taichi_foam.sweeps.run import Sweep

MASS = {"key": "impactor.mass", "values": [3.0, 6.0]}


@pytest.fixture(scope="module")
def swept(tmp_path_factory: pytest.TempPathFactory) -> Sweep:
    """Velocities from 2.1 to 4.1, two masses, each drop three times."""
    plan = plan_of(axis(low=2.1, high=4.1, count=5), MASS, chunk=16, repeats={"count": 3})
    return tf.sweep(plan, tmp_path_factory.mktemp("figure") / "s", solve=Solver())


def test_a_curve_has_the_median_and_its_band_the_spread(swept: Sweep) -> None:
    (axes,) = shown(swept, "max_displacement_m").axes
    assert axes.get_xlabel() == "impactor velocity (m/s)"
    assert axes.get_ylabel() == "maximum displacement (cm)"
    assert [text.get_text() for text in axes.texts] == ["3", "6", "by impactor mass (kg)"]
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
    assert axes.get_ylabel() == "impactor mass (kg)"
    assert bar.get_ylabel() == "maximum displacement (cm)"


def test_few_cells_have_their_numbers_and_the_values_of_both_axes_beside_them(
    swept: Sweep,
) -> None:
    axes, _ = shown(swept, "max_displacement_m", as_map=True).axes
    numbers = {text.get_position(): text.get_text() for text in axes.texts}
    across = enumerate(["2.10", "2.60", "3.10", "3.60", "–"])
    assert numbers == {(i, j): text for i, text in across for j in (0, 1)}
    across, up = axes.get_xticklabels(), axes.get_yticklabels()
    assert [tick.get_text() for tick in across] == ["2.1", "2.6", "3.1", "3.6", "4.1"]
    assert [tick.get_text() for tick in up] == ["3", "6"]


def test_a_map_whose_cells_all_lack_an_answer(swept: Sweep) -> None:
    """Of each pair half of the drops have none, so that no median has a number."""
    figure = Figure()
    values = np.full((2, 2), np.nan)
    axes = figure.subplots()
    _print_numbers(axes, axes.pcolormesh(np.ones((2, 2))), [0, 1], [0, 1], values)
    assert [text.get_text() for text in axes.texts] == ["–"] * 4


def test_a_map_of_many_cells_is_to_scale_and_has_no_numbers(tmp_path: Path) -> None:
    plan = plan_of(axis(count=13), MASS, chunk=None)
    axes, _ = shown(tf.sweep(plan, tmp_path / "s", solve=Solver()), "pieces", as_map=True).axes
    assert not axes.texts
    assert axes.get_xlim() == pytest.approx((2.0 - 1 / 12, 4.0 + 1 / 12))


def test_of_what_is_true_or_false_the_share_of_drops_is_shown(swept: Sweep) -> None:
    """True above 3.4 m/s; at 3.6 within 0.5 % of all three repeats, at 3.1 of none."""
    (axes,) = shown(swept, "bottomed").axes
    assert axes.get_ylabel() == "bottomed: share of drops (%)"
    assert axes.get_ylim() == (-3.0, 103.0)
    assert axes.lines[0].get_ydata().tolist() == [0.0, 0.0, 0.0, 100.0, 100.0]
    axes, bar = shown(swept, "bottomed", as_map=True).axes
    assert bar.get_ylim() == (0.0, 100.0)
    assert [text.get_text() for text in axes.texts[:5]] == ["0", "0", "0", "100", "100"]


def test_a_share_is_of_the_drops_that_have_an_answer() -> None:
    assert figure._summed_up([100.0, 0.0, 0.0, None], shares=True) == (100 / 3,) * 3


@pytest.mark.parametrize(
    ("measure", "label"),
    [
        ("peak_deceleration_g", "peak deceleration, raw (g)"),
        ("peak_deceleration_cfc180_g", "peak deceleration (CFC 180) (g)"),
        ("static_stress_Pa", "static stress (Pa)"),
        ("node_stages_per_s", "node stages (1/s)"),
        ("contact_height_m", "contact height (m)"),
        ("max_overlap_cells", "max overlap cells"),
    ],
)
def test_measures_have_words_and_units(measure: str, label: str) -> None:
    assert figure._label_of_measure(measure, is_share=False) == label


@pytest.mark.parametrize(
    ("key", "label"),
    [
        ("foam.fracture_energy", "foam fracture energy (J/m²)"),
        ("block.density", "block density (kg/m³)"),
        ("impactor.rotation_deg", "impactor rotation (deg)"),
        ("block.rows", "block rows"),
    ],
)
def test_axes_have_words_and_units(key: str, label: str) -> None:
    assert figure._label_of_axis(key, tf.paper_scene("paper/wedge-2.86")) == label


def test_axes_can_be_exchanged(swept: Sweep) -> None:
    (axes,) = shown(swept, "pieces", x="impactor.mass", by="impactor.velocity").axes
    assert len(axes.lines) == 5
    assert axes.get_xlabel() == "impactor mass (kg)"


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
        ({"measure": "max_displacment_m"}, "is not a column of the table; did you mean max_displ"),
        # a guided impactor has no peak of its resultant
        ({"measure": "peak_g"}, "mean peak_deceleration_g or peak_deceleration_cfc180_g?"),
        ({"measure": "peak_resultant_g"}, "peak_resultant_g: has no value in any drop"),
        ({"measure": "warnings"}, "warnings: holds text"),
        (
            {"measure": "pieces", "x": "block.rows"},
            "is not an axis of the sweep; its axes are impactor.v",
        ),
        ({"measure": "pieces", "by": "impactor.velocity"}, "is not an axis of the sweep"),
    ],
)
def test_what_cannot_be_shown_is_refused(swept: Sweep, asked: dict, says: str) -> None:
    with pytest.raises(UserError) as refused:
        shown(swept, **asked)
    assert says in str(refused.value)
