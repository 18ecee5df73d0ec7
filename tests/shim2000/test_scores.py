"""How many runs meet each criterion: of a test on its own, and of tests that are compared."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
from tables_shown import printed

from taichi_foam.cli import tables
from taichi_foam.shim2000.criteria import Criterion
from taichi_foam.shim2000.impacts import paper_scene
from taichi_foam.shim2000.scores import judged
from taichi_foam.shim2000.study import Case, Member, faster

FLATS = ("2.46", "3.03", "3.60")
EMPTY = np.zeros(0)


def layer(velocity: str, value: float) -> Criterion:
    key = f"flat-layer-{velocity}"
    return Criterion(key, "A layer", "section 3.2", value, "-", "0.2 to 0.4", 0.2 <= value <= 0.4)


def ensemble(make_result, velocity: str, runs: Sequence[tuple[float, float]]) -> Case:
    """A flat test whose runs have these velocities, over its own, and layers."""
    scene = paper_scene(f"paper/rectangular-{velocity}")
    members = [
        Member(faster(scene, factor), {}, [layer(velocity, value)], EMPTY, EMPTY)
        for factor, value in runs
    ]
    return Case(scene, make_result(scene=scene), members)


def test_runs_are_compared_with_those_as_much_faster(make_result) -> None:
    """One run of the second test has failed: the first and the third have it without a partner."""
    content = judged(
        [
            ensemble(make_result, "2.46", [(0.995, 0.30), (1.0, 0.1), (1.005, 0.35)]),
            ensemble(make_result, "3.03", [(0.995, 0.30), (1.005, 0.35)]),
            ensemble(make_result, "3.60", [(0.995, 0.28), (1.0, 0.5), (1.005, 0.40)]),
        ]
    )
    counts = {
        each["key"]: (each["case"], each["met"], each["of"], each["holds"]) for each in content
    }
    assert counts == {
        "flat-layer-2.46": ("paper/rectangular-2.46", 2, 3, False),
        "flat-layer-3.03": ("paper/rectangular-3.03", 2, 2, True),
        "flat-layer-3.60": ("paper/rectangular-3.60", 2, 3, False),
        "flat-layer-trend": (None, 1, 2, False),
    }
    trend = content[-1]["median"]
    assert trend == pytest.approx((-0.02 + 0.05) / 2 / 1.14)


def test_tests_are_compared_only_where_all_are_there(make_result) -> None:
    cases = [ensemble(make_result, velocity, [(1.0, 0.3)]) for velocity in FLATS[:2]]
    assert [each["key"] for each in judged(cases)] == ["flat-layer-2.46", "flat-layer-3.03"]


def test_a_single_run_is_judged_by_itself(make_result, make_snapshot) -> None:
    """Nothing is crushed in it, so that nothing can be measured."""
    scene = paper_scene("paper/rectangular-3.60")
    case = Case(scene, make_result(scene=scene, snapshots=[make_snapshot(scene.block)]))
    content = judged([case])
    assert [each["key"] for each in content] == ["flat-layer-3.60", "flat-no-room-3.60"]
    assert {(each["met"], each["of"], each["median"]) for each in content} == {(0, 1, None)}


@pytest.mark.parametrize("ensemble", [None, {"runs": 16}])
def test_the_table_of_criteria_has_those_that_are_not_met(ensemble) -> None:
    met = {"case": "paper/wedge-2.86", "text": "Small cracks", "unit": "cracks", "median": 2.0}
    met |= {"allowed": "at least 1", "met": 13, "of": 16, "holds": True}
    missed = met | {"text": "A crack", "unit": "mm", "median": 12.345, "allowed": "at most 10"}
    missed |= {"met": 3, "holds": False}
    content = {"ensemble": ensemble, "criteria": [met, missed, missed | {"case": None}]}
    shown = printed(tables.criteria(content), width=80)
    assert "1 of 3 met" in shown
    assert "Small cracks" not in shown
    assert "wedge-2.86: A crack" in shown
    assert "12.3 mm" in shown
    assert "at most 10 mm" in shown
    assert ("3 of 16" in shown) == (ensemble is not None)
    assert max(map(len, shown.splitlines())) <= 80
    assert "1 of 1 met" in printed(
        tables.criteria({"ensemble": ensemble, "criteria": [met]}), width=80
    )
