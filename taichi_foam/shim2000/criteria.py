"""The paper's statements and pictures of the crushed foam, as criteria that a program can check.

Three tests have pictures (Figs 22, 24, 26). For the other flat tests the crushed layer is known
(section 3.2), and for all tests that crushed foam keeps its room. Each statement has a figure from
`analysis.pattern` or `analysis.room`, and limits, whose origin is documented with them. The limits
interpret words ("about one third", "hardly any") as widely as the words allow, whatever the model
gives.

Pictures are judged when the impactor has stopped, or at the end of a run in which it never stops,
by the snapshot nearest to that time, unless the statement is about another time. Layers and room
are judged by the last snapshot: the paper measured its layers on specimens after the test.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType
from typing import Any

import numpy as np

from taichi_foam.analysis import pattern, room
from taichi_foam.analysis.fragments import Crack, crack_over_time
from taichi_foam.analysis.impact import Impact, impact
from taichi_foam.records.snapshot import Snapshot
from taichi_foam.results.result import Result
from taichi_foam.scene import Block, Impactor, Scene
from taichi_foam.shim2000.impacts import TESTS, PaperTest, test_of


@dataclass(frozen=True)
class Criterion:
    """One statement of the paper, and whether a run agrees.

    key      name, unique over all tests
    text     the statement in one short sentence
    source   its source: a picture, a section, an equation
    value    the figure in `unit`; None if there is nothing to measure
    unit     unit in readable form; "-" for a ratio
    allowed  limits of the value in readable form
    holds    whether the value lies within them
    """

    key: str
    text: str
    source: str
    value: float | None
    unit: str
    allowed: str
    holds: bool


def criteria(result: Result, test: PaperTest | None = None) -> list[Criterion]:
    """The criteria of a test: those of its picture, in the order of the paper's text, and of room.

    [] for a scene that is not one of the tests, and for a result without snapshots.

    Args:
        test: judge the run as this test; default: that of `test_of`. For studies that deliberately
            change a test.
    """
    test = test or test_of(result.scene)
    if test is None or not result.snapshots or not result.scene.impactor:
        return []
    run = _Run(result, result.scene.impactor, test)
    shown = _JUDGES[test.kind](run) if test.picture else []
    layers = [_layer(run)] if test.name in LAYERS else []
    return [*shown, *layers, _no_room(run)]


def comparing(found: Iterable[Criterion]) -> list[Criterion]:
    """The criteria that compare tests with each other, from the criteria of one run of each.

    [] if one of the tests needed is missing.
    """
    values = {criterion.key: criterion.value for criterion in found}
    keys = [_key(TESTS[name], "layer") for name in LAYERS]
    if not values.keys() >= {*keys}:
        return []
    return [_trend([values[key] for key in keys])]


@dataclass(frozen=True)
class _Run:
    """A run, with the values that several criteria need."""

    result: Result
    impactor: Impactor
    test: PaperTest

    @property
    def scene(self) -> Scene:
        return self.result.scene

    @property
    def block(self) -> Block:
        return self.scene.block

    @property
    def cell(self) -> float:
        """The longer side of a cell [m]."""
        return max(self.block.dx, self.block.dy)

    @cached_property
    def impact(self) -> Impact | None:
        return impact(self.result)

    @cached_property
    def stop(self) -> Snapshot:
        """The instant nearest to the impactor's stop."""
        snapshots = self.result.snapshots
        when = self.impact.stop if self.impact else snapshots[-1].time
        return min(snapshots, key=lambda snapshot: abs(snapshot.time - when))

    @property
    def last(self) -> Snapshot:
        return self.result.snapshots[-1]

    @cached_property
    def until_stop(self) -> list[Snapshot]:
        return [s for s in self.result.snapshots if s.time <= self.stop.time]

    @cached_property
    def crack(self) -> Crack | None:
        """The crack below the impactor, up to the stop."""
        return crack_over_time(self.until_stop, self.scene)

    def judged(self, key: str, text: str, value: float | None, **limits: Any) -> Criterion:
        """A criterion of the test's picture, with limits as for `_judged`."""
        return _judged(key, text, f"Fig. {self.test.picture}", value, **limits)


def _judged(
    key: str,
    text: str,
    source: str,
    value: float | None,
    *,
    low: float = -math.inf,
    high: float = math.inf,
    unit: str = "-",
) -> Criterion:
    """A criterion that a value lies between two limits, or on one side of one limit."""
    holds = value is not None and low - _ROUNDING <= value <= high + _ROUNDING
    if math.isinf(low):
        allowed = f"at most {high:.3g}"
    else:
        allowed = f"at least {low:.3g}" if math.isinf(high) else f"{low:.3g} to {high:.3g}"
    return Criterion(key, text, source, value, unit, allowed, holds)


def _key(test: PaperTest, about: str) -> str:
    """The key of a criterion that several tests have."""
    shape = "flat" if test.kind == "rectangular" else test.kind
    return f"{shape}-{about}-{test.velocity:.2f}"


# --- limits -------------------------------------------------------------------------------------

CONFINED = 0.05
"""Crushed cells outside the path: at most one in twenty. Figs 22 and 24 show none; a few crumbs
that break off do not make a region."""

SHARP_CELLS = 1.0
"""A sharp boundary takes one cell on average: a front that stands within a cell leaves it half
crushed, and no lattice shows less. Two would be 10 mm, a fifth of the flat face."""

RECTANGLE_FILL = 0.9
"""A region is rather a rectangle than half an ellipse (0.79 of its box) above the middle of the
two."""

FALLS = 2 / 3
"""Severity falls with distance if the nearer row is the more crushed one in at least this fraction
of the pairs of crushed rows. Uniform crushing gives a half; among 14 rows chance gives two thirds
in one case of twenty (Kendall's tau)."""

LAYERS: Mapping[str, tuple[float, float]] = MappingProxyType(
    {
        "paper/rectangular-2.46": (0.25, 0.42),
        "paper/rectangular-3.03": (0.25, 0.42),
        "paper/rectangular-3.60": (0.2, 0.42),
    }
)
"""The layer that is left is about one third of the displacement, less at higher velocity: a third
within a quarter of it, and down to a fifth for the fastest. Foam that Table 1's law crushes just to
its strain of densification, -0.8, has 0.2 / 0.8 = 0.25, and once it has sprung back to -0.75 it has
0.25 / 0.8 = 0.31."""

NO_ROOM = 0.05
"""Crushed foam without room: at most one part in twenty. In a test all foam has its room; in a
lattice, crumbs that overlap by a part of a cell say nothing about the layer."""

QUARTER = 0.25
"""A half has at least a quarter of the mass points. Impactors are a quarter as wide as the block,
so that a plug punched out of their path, which is lower than the block, has less."""

MAJORITY = 0.5
"""The worst crushing is beneath the impactor if at least half of the worst cells are there."""

VERTICAL_DEG = 15.0
"""A crack is vertical if it leans by no more than about one in four."""

NEAR_TIP_CELLS = 2.0
"""A crack starts at the tip within two cells of it: one of them may be crushed foam, which does not
count as cracked, and the other has the bond that opens."""

ALONG_FACES_CELLS = 2.0
ALONG_FACES = 0.9
"""Deformation follows the faces if nine of ten crushed cells are within two cells of the cavity:
10 mm, on each side two fifths of the wedge's half width."""

BOTH_FACES = (0.4, 0.6)
"""Two faces: neither has more than one and a half times the other's crushed cells."""

HARDLY_ANY = 0.05
"""Almost no crushing ahead of the tip: at most one crushed cell in twenty."""

REACH_AHEAD = 0.1
"""Almost no deformation ahead of the tip: no deeper than a tenth of the penetration. Below a flat
face it is the third of Fig. 22 and more."""

EARLY = 0.5
"""Section 3.4 ascribes the plateau's decline to the crack; it must then be there by the middle of
the impact."""

SMALL_CRACK = 0.2
"""A crack of the top surface is small up to this share of the block's height (4 of 20 cells)."""

_ROUNDING = 1e-9


# --- the three tests ----------------------------------------------------------------------------


def _flat(run: _Run) -> list[Criterion]:
    scene, stop = run.scene, run.stop
    region = pattern.crushed_region(stop, scene)
    beside, below = pattern.boundary_cells(stop, scene) or (None, None)
    # A crushed bond across the path's edge widens the region by a cell.
    cell, width = 1e3 * run.cell, 1e3 * run.impactor.extent
    return [
        _confined("flat-confined", "Gross crushing only under the impactor", run),
        run.judged(
            "flat-width", "The crushed region is as wide as the impactor",
            1e3 * region.width if region else None,
            low=width - 2 * cell, high=width + 2 * cell, unit="mm",
        ),
        run.judged(
            "flat-rectangle", "The crushed region is a rectangle (share of its box)",
            region.fill if region else None, low=RECTANGLE_FILL,
        ),
        run.judged(
            "flat-sharp-sides", "Its sides are sharp (cells between crushed and elastic)",
            beside, high=SHARP_CELLS, unit="cells",
        ),
        run.judged(
            "flat-sharp-front", "Its lower side is sharp (cells between crushed and elastic)",
            below, high=SHARP_CELLS, unit="cells",
        ),
        run.judged(
            "flat-severity",
            "Severity falls with distance from the impactor (share of pairs of rows)",
            pattern.severity_falls(stop, scene), low=FALLS,
        ),
        _no_crack_through(run),
        run.judged(
            "flat-whole", "The block is not split (share of its second largest part)",
            pattern.second_part(stop, run.block), high=QUARTER,
        ),
    ]  # fmt: skip


def _no_crack_through(run: _Run) -> Criterion:
    """Unlike in `_split`, the limit itself is excluded: no run can both split and not split."""
    return Criterion(
        key="flat-no-crack",
        text="No crack runs through the block (share of its height)",
        source=f"Fig. {run.test.picture}",
        value=pattern.crack_reach(run.crack, run.block),
        unit="-",
        allowed=f"below {1 - pattern.SPLIT_FRACTION:.3g}",
        holds=not pattern.splits(run.crack, run.block),
    )


def _cylinder(run: _Run) -> list[Criterion]:
    offset = run.crack and 1e3 * abs(run.crack.start_x - run.impactor.x)
    return [
        _confined("cylinder-confined", "Crushing is confined to the impactor's path", run),
        run.judged(
            "cylinder-worst",
            "The worst crushing is beneath the impactor (share of the worst cells)",
            pattern.worst_beneath(run.stop, run.scene), low=MAJORITY,
        ),
        # Section 3.3: it extends from the tip, on a circle at most the middle half.
        run.judged(
            "cylinder-crack-start", "A crack starts below the impactor (distance from its axis)",
            offset, high=1e3 * run.impactor.extent / 4, unit="mm",
        ),
        _vertical("cylinder-crack-vertical", run),
        *_split("cylinder", run),
    ]  # fmt: skip


def _wedge(run: _Run) -> list[Criterion]:
    scene, stop = run.scene, run.stop
    reach = pattern.reach_ahead(stop, scene)
    return [
        run.judged(
            "wedge-faces", "Crushing follows the wedge's faces (share of the crushed cells)",
            pattern.crushed_along_faces(stop, scene, ALONG_FACES_CELLS * run.cell),
            low=ALONG_FACES,
        ),
        run.judged(
            "wedge-both-faces", "It follows both faces (share of the left one)",
            pattern.crushed_left(stop, scene), low=BOTH_FACES[0], high=BOTH_FACES[1],
        ),
        run.judged(
            "wedge-ahead", "Almost no crushing ahead of the tip (share of the crushed cells)",
            pattern.crushed_ahead(stop, scene), high=HARDLY_ANY,
        ),
        run.judged(
            "wedge-reach-ahead",
            "Almost no lasting deformation ahead of the tip (its depth over the displacement)",
            reach / run.impact.depth if reach is not None and run.impact else None,
            high=REACH_AHEAD,
        ),
        run.judged(
            "wedge-crack-start", "A crack starts at the tip (distance from it)",
            _crack_from_tip(run), high=1e3 * NEAR_TIP_CELLS * run.cell, unit="mm",
        ),
        run.judged(
            "wedge-crack-time",
            "The crack is there while the wedge sinks (start over the impact's duration)",
            _crack_time(run), high=EARLY,
        ),
        _vertical("wedge-crack-vertical", run),
        *_split("wedge", run),
        _small_top_cracks(run),
    ]  # fmt: skip


def _crack_from_tip(run: _Run) -> float | None:
    if run.crack is None:
        return None
    distance = pattern.crack_from_tip(run.crack, run.until_stop, run.scene)
    return None if distance is None else 1e3 * distance


def _crack_time(run: _Run) -> float | None:
    if run.crack is None or run.impact is None:
        return None
    return (run.crack.start_time - run.impact.contact) / run.impact.duration


def _small_top_cracks(run: _Run) -> Criterion:
    """Cracks at the top surface: there are some, and all are small."""
    found = pattern.top_cracks(run.until_stop, run.scene)
    longest = SMALL_CRACK * run.block.height
    return Criterion(
        key="wedge-top-cracks",
        text="Small tensile cracks at the top surface near the cavity",
        source=f"Fig. {run.test.picture}",
        value=found and float(found.count),
        unit="cracks",
        allowed=f"1 or more cracks, none deeper than {1e3 * longest:.3g} mm",
        holds=found is not None and found.count >= 1 and found.depth <= longest + _ROUNDING,
    )


_JUDGES: Mapping[str, Callable[[_Run], list[Criterion]]] = MappingProxyType(
    {"rectangular": _flat, "cylinder": _cylinder, "wedge": _wedge}
)


# --- statements about more than one test --------------------------------------------------------


def _confined(key: str, text: str, run: _Run) -> Criterion:
    outside = pattern.crushed_outside(run.stop, run.scene, margin=run.block.dx)
    return run.judged(key, f"{text} (share of crushed cells outside)", outside, high=CONFINED)


def _vertical(key: str, run: _Run) -> Criterion:
    lean = run.crack and abs(run.crack.direction_deg)
    return run.judged(key, "The crack is vertical (its lean)", lean, high=VERTICAL_DEG, unit="deg")


def _split(shape: str, run: _Run) -> list[Criterion]:
    """The crack runs through the block, and two halves are left."""
    reach = pattern.crack_reach(run.crack, run.block)
    half = pattern.second_half(run.stop, run.block)
    through = "The crack runs through the block (share of its height)"
    halves = "It splits the block into halves (share of the smaller one)"
    return [
        run.judged(f"{shape}-crack-through", through, reach, low=1 - pattern.SPLIT_FRACTION),
        run.judged(f"{shape}-halves", halves, half, low=QUARTER),
    ]


def _layer(run: _Run) -> Criterion:
    low, high = LAYERS[run.test.name]
    layer = room.crushed_layer(run.last, run.scene)
    return _judged(
        _key(run.test, "layer"),
        "The crushed layer left under the face (over the displacement)",
        "section 3.2",
        layer / run.impact.depth if layer is not None and run.impact else None,
        low=low,
        high=high,
    )


def _no_room(run: _Run) -> Criterion:
    return _judged(
        _key(run.test, "no-room"),
        "Crushed foam keeps its room (share that lies inside other foam)",
        "Eq. 26",
        room.without_room(run.last, run.scene),
        high=NO_ROOM,
    )


def _trend(layers: list[float | None]) -> Criterion:
    """The slope of the best-fit straight line over the tests of `LAYERS`."""
    known = [layer for layer in layers if layer is not None]
    slope = None
    if len(known) == len(layers):
        slope = float(np.polyfit([TESTS[name].velocity for name in LAYERS], known, 1)[0])
    return _judged(
        "flat-layer-trend",
        "The layer does not grow with velocity (slope of layer over displacement)",
        "section 3.2",
        slope,
        high=0.0,
        unit="s/m",
    )
