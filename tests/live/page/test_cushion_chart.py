"""The cushion chart: the formula at once, simulated drops as they come, and what is refused."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from processes import until

from taichi_foam.errors import UserError
from taichi_foam.formulas import energy
from taichi_foam.live.controls import Controls
from taichi_foam.live.page.commands import Cushion
from taichi_foam.live.page.cushion import INPUTS, OWN, POINTS, Charts
from taichi_foam.scene.library import foam_of
from taichi_foam.shim2000.impacts import paper_scene
from taichi_foam.simulation.simulate import run

WEDGE = paper_scene("paper/wedge-2.86")
TESTS = """height [cm],thickness [mm],static stress [kPa],peak [g]
76,50,5.2,41
60,50,5.2,35
"""


@pytest.fixture
def charts(monkeypatch: pytest.MonkeyPatch) -> Iterator[Charts]:
    monkeypatch.setattr("taichi_foam.live.page.cushion._Process", _Idle)
    found = Charts(WEDGE)
    yield found
    found.close()


class _Idle:
    """A process that simulates nothing."""

    problem = ""
    begun: list[_Idle]

    def __init__(self, drops: object) -> None:
        self.is_closed = False
        self.begun.append(self)

    def take(self) -> list[tuple[int, dict]]:
        return []

    def close(self) -> None:
        self.is_closed = True


_Idle.begun = []


def test_the_formula_is_there_at_once_and_nothing_else(charts: Charts) -> None:
    charts.ask(Cushion("eps-20", 0.05, 0.76, 2e3, 8e3))
    assert charts.chart is not None
    told = charts.chart.told(WEDGE)
    statics = np.array([point["static"] for point in told["points"]])
    assert (len(statics), statics[0], statics[-1]) == (POINTS, 2e3, 8e3)
    assert {point["state"] for point in told["points"]} == {"waiting"}
    curve = foam_of("eps-20").foam.curve.points  # type: ignore[attr-defined]
    by_hand = energy.cushion_curve(*curve, 0.76, 0.05, statics)
    # the curve is taken at 2001 strains: a kink between two of them is cut, by 1e-3 at most
    np.testing.assert_allclose([each["by_hand"] for each in told["points"]], by_hand, rtol=1e-3)
    best, stop = energy.optimum(*curve, 0.76, 0.05)
    assert told["least"] == pytest.approx((best, stop.g), rel=1e-3)


def test_own_tests_of_its_height_and_thickness_are_on_the_chart(charts: Charts) -> None:
    charts.ask(Cushion("eps-20", 0.05, 0.76, None, None, TESTS.replace(",", "\t")))
    assert charts.chart is not None
    told = charts.chart.told(WEDGE)["tests"]
    assert (told["static"].tolist(), told["g"].tolist(), told["all"]) == ([5200.0], [41.0], 2)
    charts.ask(Cushion("eps-20", 0.04, 0.76, None, None, " "))
    assert charts.chart.told(WEDGE)["tests"] is None


def test_the_usual_range_holds_the_optimum_of_every_foam(charts: Charts) -> None:
    for foam in (OWN, "rigid-pu-40", "eps-14.4"):
        charts.ask(Cushion(foam, 0.02, 1.0, None, None))
        assert charts.chart is not None
        statics = charts.chart.drops.statics
        assert statics[0] < charts.chart.least[0] < statics[-1]
        # a thick pad and a short fall: its optimum would crush it by the weight alone
        charts.ask(Cushion(foam, 0.3, 0.01, None, None))


def test_another_chart_ends_the_one_before(charts: Charts) -> None:
    _Idle.begun.clear()
    charts.ask(Cushion("eps-20", 0.05, 0.76, None, None))
    assert charts.chart is not None
    first = charts.chart.number
    charts.ask(Cushion("eps-30", 0.05, 0.76, None, None))
    assert [each.is_closed for each in _Idle.begun] == [True, False]
    with pytest.raises(UserError, match="has been replaced"):
        charts.scene(first, 0)
    with pytest.raises(UserError, match="point = 10: must be 0 to 9"):
        charts.scene(first + 1, POINTS)


@pytest.mark.parametrize(
    ("foam", "values", "words"),
    [
        ("no foam", {}, "foam = 'no foam': must be of this scene, or in the library"),
        ("../foam.toml", {}, "must be of this scene, or in the library"),
        ("/etc/passwd.csv", {}, "must be of this scene, or in the library"),
        ("eps-99", {}, "foam = 'eps-99': resistances are specified"),
        ("eps-20", {"thickness": 0.0}, "thickness = 0 mm: must be 5 to 300 mm"),
        ("eps-20", {"drop_height": None}, "drop_height = nothing: must be 1 to 500 cm"),
        ("eps-20", {"least": 8e3, "most": 4e3}, "most = 4 kPa: must be above the least one, 8 kPa"),
        ("eps-20", {"least": 4e3, "most": 4.01e3}, "at least 5 % above"),
        ("eps-20", {"most": 5e5}, "most = 500 kPa: must be below the foam's plateau stress"),
        ("eps-20", {"most": 1e9}, "must be nothing, or 0.01 to 1000 kPa"),
        ("eps-20", {"tests": "76,50,5,41"}, "own tests: has no header; its first line must be"),
        ("eps-20", {"tests": "G,thick\n41,much"}, "own tests: no numbers; must have lines of drop"),
        ("eps-20", {"tests": f"{TESTS}76,50,0,41"}, "own tests, line 4: the static stress must be"),
    ],
)
def test_what_makes_no_chart_is_refused_and_the_chart_stays(
    charts: Charts, foam: str, values: dict, words: str
) -> None:
    charts.ask(Cushion(OWN, 0.05, 0.76, None, None))
    before = charts.chart
    given = dict.fromkeys(each.key for each in INPUTS) | {"thickness": 0.05, "drop_height": 0.76}
    with pytest.raises(UserError, match=words):
        charts.ask(Cushion(foam, **{**given, **values}))
    assert charts.chart is before


def test_simulated_drops_are_those_that_a_run_gives(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("taichi_foam.live.page.cushion.POINTS", 2)
    charts = Charts(WEDGE.with_values({"foam.rate": None}))
    charts.ask(Cushion(OWN, 0.04, 0.3, None, None))
    chart = charts.chart
    assert chart is not None

    def is_complete() -> bool:
        charts.take()
        assert not chart.problem
        return None not in chart.points

    until(is_complete, "drops are missing")
    assert chart.told(WEDGE)["waits"] == 0
    point, figures = chart.points[0], run(charts.scene(chart.number, 0)).summary
    assert point is not None
    assert point["g"] == figures["peak_deceleration_g"]
    assert point["g_cfc180"] == figures["peak_deceleration_cfc180_g"]
    assert (point["strain"], point["bottomed"]) == (figures["max_strain"], False)
    # the foam's own mass and dashpots are not in the formula, nor is an overshoot
    assert point["g"] == pytest.approx(chart.by_hand[0], rel=0.05)


def test_a_process_that_is_ended_is_told_with_what_there_is() -> None:
    charts = Charts(WEDGE)
    charts.ask(Cushion(OWN, 0.04, 0.3, None, None))
    chart = charts.chart
    assert chart is not None
    assert charts._process is not None
    charts._process._process.kill()
    until(charts.take, "nothing is told")
    assert chart.problem == "the process that simulates was ended with exit code -9"
    assert chart.told(WEDGE)["waits"] == 0
    assert not charts.take()


def test_controls_describe_what_they_have_made_and_no_cushion(charts: Charts) -> None:
    controls = Controls(WEDGE)
    charts.ask(Cushion(OWN, 0.05, 0.76, None, None))
    assert charts.chart is not None
    assert not controls.describes(charts.chart.scene(3))
    assert controls.describes(WEDGE)
    changed = {"impactor.velocity": 3.0, "block.rows": 30, "foam.rate": None}
    for shape in controls.shapes:
        assert controls.describes(controls.scene_of(shape, changed))
