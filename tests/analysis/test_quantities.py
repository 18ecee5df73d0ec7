"""The figures that people are shown: each is a measure of a run, and has one set of words."""

from __future__ import annotations

import pytest

from taichi_foam.analysis import measures
from taichi_foam.analysis.measures import (
    DISPLACEMENT,
    MEASURES,
    RAW_CREST_G,
    RESIDUAL,
    STRAIN,
    shown_in,
    summary,
)
from taichi_foam.cli import tables
from taichi_foam.live.page.numbers import FIGURES

ALL = [each for each in MEASURES.values() if each.label]


def test_every_figure_is_a_measure_of_a_run(make_result) -> None:
    assert {quantity.key for quantity in ALL} <= summary(make_result()).keys()
    assert len({quantity.key for quantity in ALL}) == len(ALL)
    assert len({(quantity.name, quantity.unit) for quantity in ALL}) == len(ALL)  # shown together


def test_a_measure_of_ones_own_follows(make_result, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(measures, "MEASURES", dict(MEASURES))
    rows = measures.measure(
        "rows", lambda record: len(record.history), "rows of the history", "rows", tables="run"
    )
    result = make_result(strain_J=1.0)
    assert list(result.summary)[-4:] == ["rows", "statement", "warnings", "assumed"]
    assert shown_in("run")[-1] is rows
    assert rows.label in list(tables.key_figures(result.scene, result.summary).columns[0].cells)


def test_figures_in_the_unit_of_people() -> None:
    assert DISPLACEMENT.text(0.07512) == "7.51"
    assert RESIDUAL.text(-1.234e-5) == "-0.0012"
    assert DISPLACEMENT.text(None) == "–"
    assert DISPLACEMENT.span(0.07, None) == "7.00 to ∞"


def test_terminal_and_page_say_the_same(make_result) -> None:
    assert [(key, unit, factor) for key, _, unit, factor, _ in FIGURES] == [
        (quantity.key, quantity.unit, quantity.factor) for quantity in shown_in("page")
    ]
    result = make_result(strain_J=1.0, residual_J=(0.0, 0.01))
    labels = list(tables.key_figures(result.scene, result.summary).columns[0].cells)
    assert RESIDUAL.label in labels
    shown = [quantity.label for quantity in shown_in("run")]
    assert labels == [label for label in shown if label in labels]


def test_tables_are_those_that_there_are() -> None:
    named = {table for each in ALL for table in each.tables.split()}
    assert named == {"run", "page", "cell"}


def test_the_largest_strain_stands_beside_the_peaks(make_result) -> None:
    result = make_result(strain_J=1.0)
    figures = {**result.summary, STRAIN.key: 0.4, RAW_CREST_G.key: 50.0}
    labels = list(tables.key_figures(result.scene, figures).columns[0].cells)
    assert labels.index(STRAIN.label) == labels.index(RAW_CREST_G.label) + 1
    on_the_page = shown_in("page")
    assert on_the_page.index(STRAIN) == on_the_page.index(RAW_CREST_G) + 1
