"""Medians and bands against numbers worked out by hand."""

from __future__ import annotations

from math import inf

import numpy as np
import pytest

from taichi_foam.analysis.bands import band, band_of_curves, bands, nearest, quantile


@pytest.mark.parametrize(
    ("values", "share", "expected"),
    [
        ([5, 1, 4, 2, 3], 0.5, 3),
        ([1, 2, 3, 4, 5], 0.05, 1.2),  # rank 0.2
        ([1, 2, 3, 4, 5], 0.95, 4.8),  # rank 3.8
        ([1, 2], 0.5, 1.5),
        ([7], 0.95, 7),
        ([None, 1, 2], 0.5, 2),
        ([None, None, 1, 2], 0.5, inf),  # half way between 2 and none
        ([None, None, 1], 0.5, inf),
        ([1, 2, None], 0.95, inf),
        ([None, None], 0.05, inf),
        ([0.0, None], 0.0, 0.0),
        ([True, False], 1.0, 1.0),
    ],
)
def test_quantiles_lie_between_ranks_and_no_answer_is_beyond_all(
    values: list[float | None], share: float, expected: float
) -> None:
    assert quantile(values, share) == pytest.approx(expected)


@pytest.mark.parametrize("count", range(21, 202, 20))
def test_a_rank_that_is_whole_takes_nothing_from_its_neighbour(count: int) -> None:
    """0.95 (n - 1) is whole for n = 21, 41, ...: none of the runs above it may show."""
    rank = 19 * (count - 1) // 20
    values = [float(k) if k <= rank else None for k in range(count)]
    assert quantile(values, 0.95) == rank


def test_a_band_goes_from_five_to_ninety_five_per_cent() -> None:
    assert band([10.0 * k for k in range(21)]) == pytest.approx((10, 100, 190))
    assert band([3, None, 1], ends=(0, 1)) == (1, 3, inf)


def test_every_figure_has_a_band_and_names_and_flags_have_none() -> None:
    runs = [
        {"scene": "a", "interrupted": False, "depth": 1.0, "pieces": 2, "crack": None},
        {"scene": "a", "interrupted": False, "depth": None, "pieces": 1, "crack": None},
        {"scene": "a", "interrupted": False, "depth": 3.0, "pieces": 1, "crack": None},
    ]
    found = bands(runs)
    assert set(found) == {"depth", "pieces", "crack"}
    assert found["depth"].median == 3.0
    assert found["pieces"].median == 1
    assert found["crack"] == (inf, inf, inf)


def test_the_nearest_run_is_the_one_whose_worst_figure_is_least_far_off() -> None:
    """Medians are 10 and 100: the runs are off by 20 and 0, 3 and 5, 0 and 30 per cent."""
    runs = [{"a": 12.0, "b": 100.0}, {"a": 9.7, "b": 95.0}, {"a": 10.0, "b": 130.0}]
    assert nearest(runs, ["a", "b"]) == 1
    assert nearest(runs, ["a"]) == 2


def test_runs_without_an_answer_are_near_to_none_only() -> None:
    assert nearest([{"a": None}, {"a": 4.0}, {"a": 1.0}], ["a"]) == 1
    assert nearest([{"a": 1.0}, {"a": None}, {"a": None}], ["a"]) == 1


def test_curves_end_with_the_median_one_and_those_before_keep_their_last_value() -> None:
    """Ends at 1, 2 and 4 ms: the axis goes to 2 ms. Values: 10, 20, and 0 to 40 evenly."""
    constant = [(np.array([0.0, end]), np.array([v, v])) for end, v in ((1e-3, 10.0), (2e-3, 20.0))]
    rising = (np.array([0.0, 4e-3]), np.array([0.0, 40.0]))
    found = band_of_curves([*constant, rising])
    assert found.time[0] == 0.0
    assert found.time[-1] == pytest.approx(2e-3)
    assert found.median[0] == 10.0  # of 10, 20, 0
    assert found.median[-1] == 20.0  # of 10, 20, 20
    assert found.low[-1] == pytest.approx(11.0)  # a tenth of the way from 10 to 20
    np.testing.assert_allclose(np.interp(1.5e-3, found.time, found.median), 15.0)
