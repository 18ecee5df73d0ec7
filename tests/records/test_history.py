"""The one table of the history: what follows from it, and how a history is handled in Python."""

from __future__ import annotations

import copy
import pickle
import sys
from pathlib import Path

import numpy as np
import pytest

from taichi_foam.analysis.columns import history_of
from taichi_foam.engine.state import Body, Clock, Turn
from taichi_foam.errors import UserError
from taichi_foam.live.page.numbers import ENERGIES as ON_THE_PAGE
from taichi_foam.picture.figures import ledger_layers
from taichi_foam.records.history import (
    BOOKED,
    COLUMNS,
    ENERGIES,
    ENERGIES_NOW,
    HISTORY_COLUMNS,
    LEDGER,
    row_columns,
)
from taichi_foam.scene import Scene, Wedge

ROW = row_columns(turns=False)
DOCS = Path(__file__).parents[2] / "docs" / "results.md"


def test_names_end_with_their_unit() -> None:
    in_names = {"m/s²": "m_s2", "m/s": "m_s", "rad/s": "rad_s"}
    for column in COLUMNS.values():
        if column.unit:
            assert column.name.endswith("_" + in_names.get(column.unit, column.unit))


def test_columns_use_all_energies_and_otherwise_members_of_the_state() -> None:
    members = {"clock": Clock, "body": Body, "turn": Turn}
    others = set(row_columns(turns=True)) - {*ENERGIES_NOW, *BOOKED}
    assert len(others) == len(row_columns(turns=True)) - len(ENERGIES_NOW) - len(BOOKED)
    for source in others:
        part, name = source.split(".")
        assert name in members[part].members, source


def test_layers_hold_the_ledger_but_gravity() -> None:
    held = [name for layer in LEDGER for name in layer.columns]
    assert sorted(held) == sorted(
        column.name for column in ENERGIES if column.in_ledger and column.name != "gravity_J"
    )
    assert len({layer.colour for layer in LEDGER}) == len({layer.label for layer in LEDGER}) == 6
    assert all(layer.columns for layer in LEDGER)


def test_pictures_and_page_tell_the_ledger_as_the_table_does(make_result) -> None:
    ones = dict.fromkeys((name for layer in LEDGER for name in layer.columns), 1.0)
    names, layers, tones = ledger_layers(make_result(**ones).history)
    assert names == [layer.label for layer in LEDGER]
    assert tones == [layer.colour for layer in LEDGER]
    assert [layer[0] for layer in layers] == [len(layer.columns) for layer in LEDGER]
    on_the_page = [(layer.label, layer.columns) for layer in LEDGER]
    assert [*ON_THE_PAGE[:-2]] == on_the_page
    shown = [name for _, names in ON_THE_PAGE for name in names]
    assert sorted(shown) == sorted(column.name for column in ENERGIES)


def test_the_ledger_and_its_residual_stay_what_they_were() -> None:
    rows = np.random.default_rng(3).random((20, len(ROW)))
    rows[:, ROW.index("clock.time")] = np.arange(20.0)
    history = history_of(Scene(impactor=Wedge(velocity=1.0)), rows)
    assert tuple(history) == HISTORY_COLUMNS
    total = np.sum([history[column.name] for column in ENERGIES], axis=0)
    np.testing.assert_allclose(total, total[0], rtol=1e-12)
    assert np.ptp(history.residual_J) > 0.1
    np.testing.assert_array_equal(history.damping_J, rows[:, ROW.index("dashpots")])


def test_columns_are_attributes_that_can_be_completed(make_result) -> None:
    history = make_result(velocity_m_s=3.0).history
    assert history.velocity_m_s is history["velocity_m_s"]
    assert {*HISTORY_COLUMNS, "units", "to_pandas"} <= set(dir(history))
    with pytest.raises(AttributeError, match="no column 'speed'; it has time_s, displacement_m"):
        _ = history.speed
    assert history.units["deceleration_m_s2"] == "m/s²"
    assert history.units["broken_bonds"] == ""
    assert tuple(history.units) == HISTORY_COLUMNS


def test_a_history_is_copied_and_pickled_as_a_history(make_result) -> None:
    history = make_result(velocity_m_s=3.0).history
    for other in (copy.deepcopy(history), pickle.loads(pickle.dumps(history))):
        assert type(other) is type(history)
        np.testing.assert_array_equal(other.velocity_m_s, history.velocity_m_s)


def test_a_history_as_a_frame(make_result) -> None:
    pytest.importorskip("pandas")
    result = make_result(time=(0.0, 1e-4, 2e-4), broken_bonds=(0, 1, 2))
    frame = result.to_pandas()
    assert list(frame.columns) == list(HISTORY_COLUMNS)
    assert frame["broken_bonds"].tolist() == [0.0, 1.0, 2.0]
    assert frame.attrs["units"] == result.history.units


def test_without_pandas_one_line_says_what_to_install(
    make_result, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(UserError, match=r"needs pandas.*python -m pip install 'pandas'"):
        make_result().to_pandas()


def test_the_docs_have_every_column() -> None:
    text = DOCS.read_text(encoding="utf-8")
    for column in COLUMNS.values():
        assert f"| `{column.name}` | {column.unit} | {column.meaning} |" in text
