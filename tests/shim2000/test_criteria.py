"""The criteria of the nine tests: ideal states meet all, and each spoiled one misses its own.

The ideal runs stop after 40 ms at a depth of 60 mm, by a constant deceleration of 75 m/s2.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from taichi_foam import load_scene
from taichi_foam.records.snapshot import Snapshot
from taichi_foam.scene import Block, Scene
from taichi_foam.shim2000.criteria import Criterion, comparing, criteria
from taichi_foam.shim2000.impacts import NAMES, TESTS, PaperTest, paper_scene

FLAT, CYLINDER, WEDGE = "paper/rectangular-3.03", "paper/cylinder-3.32", "paper/wedge-2.86"
BLOCK = Block(mass_points="cells")  # 40 x 20 cells of 5 mm
DX = DY = 0.005
AXIS = 19  # the A bonds that cross x = 0
STOP, DEPTH = 0.040, 0.060
TIP = 0.0975 - DEPTH  # height of the impactor's lowest point at the stop
CRUSHED = -0.85


def on_cells(name: str) -> Scene:
    """A test on 40 x 20 mass points in the middles of their cells, as these snapshots are."""
    return paper_scene(name).model_copy(update={"block": BLOCK})


@pytest.fixture
def judged(make_snapshot, make_result) -> Callable[..., dict[str, Criterion]]:
    """The criteria, by key, of a run that stops in a state; `last` is that at its end."""

    def judge(name: str, stop: Snapshot, last: Snapshot | None = None) -> dict[str, Criterion]:
        t = np.linspace(0.0, 0.045, 46)
        result = make_result(
            scene=on_cells(name),
            time=t,
            displacement_m=3.0 * t - 37.5 * t**2,
            velocity_m_s=3.0 - 75.0 * t,
            contact_force_N=np.where(t > 0, 450.0, 0.0),
            snapshots=[make_snapshot(BLOCK), stop, replace(last or stop, time=t[-1])],
        )
        return {criterion.key: criterion for criterion in criteria(result)}

    return judge


# --- parts ------------------------------------------------------------------------------------


def missed(found: dict[str, Criterion]) -> set[str]:
    return {key for key, criterion in found.items() if not criterion.holds}


@pytest.fixture
def stopped(make_snapshot) -> Snapshot:
    return make_snapshot(BLOCK, time=STOP, impactor_y=TIP)


def crack(
    snapshot: Snapshot,
    rows: range = range(2, 20),
    time: Callable[[int], float] = lambda j: 1e-3 * (20 - j),
    column: Callable[[int], int] = lambda j: AXIS,
) -> None:
    """Break A's from the highest row down; where the column changes, B's join them."""
    before = None
    for j in reversed(rows):
        i = column(j)
        snapshot.break_time_a[i, j] = time(j)
        if before is not None and i > before:
            snapshot.break_time_b[before + 1 : i + 1, j] = time(j)
        before = i


def press(snapshot: Snapshot, row: int, left: float) -> None:
    """Press the foam below the flat face above a row to `left` of its height, and the face on it.

    All columns, so that those beside it are not torn.
    """
    height = snapshot.position[:, :, 1]
    rows = DY * (np.arange(20) - row)
    height[:, row:] = height[:, row : row + 1] + left * rows[row:]
    object.__setattr__(snapshot, "impactor_y", float(height.max()))


def uncrack(snapshot: Snapshot) -> None:
    snapshot.break_time_a[:] = np.nan
    snapshot.break_time_b[:] = np.nan


# --- Fig. 22 ----------------------------------------------------------------------------------


@pytest.fixture
def flat(stopped) -> Snapshot:
    """A crushed rectangle of 15 rows, the worse the higher, which lies below the face."""
    stopped.e_min_b[15:25, 5:19] = -np.linspace(0.8, 0.9, 14)
    press(stopped, 5, 0.25)
    return stopped


def test_fig_22(judged, flat) -> None:
    found = judged(FLAT, flat)
    assert missed(found) == set()
    sources = [criterion.source for criterion in found.values()]
    assert sources == ["Fig. 22"] * 8 + ["section 3.2", "Eq. 26"]
    assert found["flat-layer-3.03"].value == pytest.approx(14 * 0.25 * DY / DEPTH)
    assert found["flat-no-room-3.03"].value == pytest.approx(0.0, abs=1e-3)
    assert found["flat-width"].value == pytest.approx(50.0)
    assert found["flat-rectangle"].value == pytest.approx(1.0)


def crush_elsewhere(flat: Snapshot) -> None:
    flat.e_min_b[2:4, 5:12] = -0.5


def crush_narrowly(flat: Snapshot) -> None:
    flat.e_min_b[[15, 16, 23, 24]] = 0.0


def crush_a_triangle(flat: Snapshot) -> None:
    for k, i in enumerate((15, 16, 17, 18, 21, 22, 23, 24)):
        flat.e_min_b[i, : (18, 15, 12, 9, 9, 12, 15, 18)[k]] = 0.0


def blur_the_sides(flat: Snapshot) -> None:
    flat.e_min_b[[12, 13, 14, 25, 26, 27], 5:19] = -0.2


def blur_the_front(flat: Snapshot) -> None:
    flat.e_min_b[15:25, 3] = -0.2  # cells of rows 3 and 4


def crush_downwards(flat: Snapshot) -> None:
    flat.e_min_b[15:25, 5:19] = -np.linspace(0.9, 0.8, 14)


def crush_few_rows(flat: Snapshot) -> None:
    flat.e_min_b[15:25, 5:10] = 0.0
    press(flat, 10, 0.25)


def fold_the_layer(flat: Snapshot) -> None:
    """A crushed layer that is no thicker than one of its bonds."""
    press(flat, 5, 1 / 60)


def swell_the_layer(flat: Snapshot) -> None:
    press(flat, 5, 0.4)


def crack_through(flat: Snapshot) -> None:
    crack(flat, range(2, 20))


def tear_a_layer_off(flat: Snapshot) -> None:
    flat.break_time_b[:, 9] = 0.01


@pytest.mark.parametrize(
    ("spoil", "expected"),
    [
        (crush_elsewhere, {"flat-confined"}),
        (crush_narrowly, {"flat-width"}),
        (crush_a_triangle, {"flat-rectangle", "flat-layer-3.03"}),
        (blur_the_sides, {"flat-sharp-sides"}),
        (blur_the_front, {"flat-sharp-front"}),
        (crush_downwards, {"flat-severity"}),
        (crush_few_rows, {"flat-layer-3.03"}),
        (fold_the_layer, {"flat-layer-3.03", "flat-no-room-3.03"}),
        (swell_the_layer, {"flat-layer-3.03"}),
        (crack_through, {"flat-no-crack", "flat-whole"}),
        (tear_a_layer_off, {"flat-whole"}),
    ],
)
def test_fig_22_spoiled(judged, flat, spoil, expected) -> None:
    spoil(flat)
    assert missed(judged(FLAT, flat)) == expected


def test_a_run_that_never_stops_has_no_displacement(make_result, flat) -> None:
    """The rest is judged at its last instant."""
    moving = make_result(scene=on_cells(FLAT), snapshots=[flat])
    found = {criterion.key: criterion for criterion in criteria(moving)}
    assert found["flat-layer-3.03"].value is None
    assert missed(found) == {"flat-layer-3.03"}


# --- Fig. 24 ----------------------------------------------------------------------------------


@pytest.fixture
def cylinder(stopped) -> Snapshot:
    """The path crushed from row 8 up, the worst on the axis, and a crack from there down."""
    stopped.e_min_b[15:25, 8:19] = -0.6
    stopped.e_min_b[18:22, 8:11] = -0.9  # 16 cells of 120
    crack(stopped)
    return stopped


def test_fig_24(judged, cylinder) -> None:
    found = judged(CYLINDER, cylinder)
    assert missed(found) == set()
    assert found["cylinder-crack-start"].value == pytest.approx(0.0)
    assert found["cylinder-halves"].value == pytest.approx(0.45)


def crush_the_flank_worse(cylinder: Snapshot) -> None:
    cylinder.e_min_b[15, 8:19] = -0.94


def crack_beside_the_tip(cylinder: Snapshot) -> None:
    uncrack(cylinder)
    crack(cylinder, column=lambda j: AXIS - 3)


def crack_obliquely(cylinder: Snapshot) -> None:
    uncrack(cylinder)
    crack(cylinder, range(2, 20), column=lambda j: AXIS + max(0, 8 - j))


def crack_halfway(cylinder: Snapshot) -> None:
    cylinder.break_time_a[:, :3] = np.nan


OF_THE_SPLIT = {"cylinder-crack-through", "cylinder-halves"}


def tear_from_the_base(cylinder: Snapshot) -> None:
    """Cracked through, but the halves have come off above a layer that stays."""
    cylinder.break_time_b[:, 4] = 0.01


@pytest.mark.parametrize(
    ("spoil", "expected"),
    [
        (crush_elsewhere, {"cylinder-confined"}),
        (crush_the_flank_worse, {"cylinder-worst"}),
        (crack_beside_the_tip, {"cylinder-crack-start"}),
        (crack_obliquely, {"cylinder-crack-vertical"}),
        (crack_halfway, OF_THE_SPLIT),
        (tear_from_the_base, {"cylinder-halves"}),
        (uncrack, {"cylinder-crack-start", "cylinder-crack-vertical", *OF_THE_SPLIT}),
    ],
)
def test_fig_24_spoiled(judged, cylinder, spoil, expected) -> None:
    spoil(cylinder)
    assert missed(judged(CYLINDER, cylinder)) == expected


# --- Fig. 26 ----------------------------------------------------------------------------------


@pytest.fixture
def wedge(stopped) -> Snapshot:
    """Crushed cells along both faces, a crack down from the tip, two small ones at the top."""
    for k in range(5):
        stopped.e_min_b[[19 - k, 20 + k], 8 + k] = CRUSHED
    crack(stopped)
    for i, shift in ((11, -1), (27, 1)):
        stopped.break_time_a[i, 19] = 0.02
        stopped.position[(slice(0, i + 1), slice(i + 1, None))[shift > 0], :, 0] += shift * 5e-4
    return stopped


def test_fig_26(judged, wedge) -> None:
    found = judged(WEDGE, wedge)
    assert missed(found) == set()
    assert found["wedge-top-cracks"].value == 2.0
    # The crack starts after 1 ms at 97.5 mm; the tip is then 1/40 of its way of 60 mm down.
    assert found["wedge-crack-start"].value == pytest.approx(1.5)
    assert found["wedge-crack-time"].value == pytest.approx(1 / 40)


def crush_far_from_the_faces(wedge: Snapshot) -> None:
    wedge.e_min_b[[2, 37], 12] = CRUSHED


def crush_one_side(wedge: Snapshot) -> None:
    wedge.e_min_b[:20] = 0.0


def crush_ahead(wedge: Snapshot) -> None:
    wedge.e_min_b[18:22, 5] = CRUSHED


def deform_ahead(wedge: Snapshot) -> None:
    wedge.e_min_b[18:22, 5] = -0.2


def crack_below_the_tip(wedge: Snapshot) -> None:
    wedge.break_time_a[AXIS, 7:] = np.nan
    crack(wedge, range(2, 7), time=lambda j: 1e-3 * (8 - j))


def crack_late(wedge: Snapshot) -> None:
    """From row 11 (57.5 mm) after 27 ms, when the tip is at 57 mm, both ways."""
    crack(wedge, time=lambda j: 0.027 + 1e-4 * abs(11 - j))


def lean_the_crack(wedge: Snapshot) -> None:
    wedge.break_time_a[AXIS] = np.nan
    crack(wedge, column=lambda j: AXIS + (19 - j) // 3)


def deepen_the_top_cracks(wedge: Snapshot) -> None:
    wedge.break_time_a[[11, 27], 15:] = 0.02


def no_top_cracks(wedge: Snapshot) -> None:
    wedge.break_time_a[[11, 27]] = np.nan


@pytest.mark.parametrize(
    ("spoil", "expected"),
    [
        (crush_far_from_the_faces, {"wedge-faces"}),
        (crush_one_side, {"wedge-both-faces"}),
        (crush_ahead, {"wedge-ahead", "wedge-reach-ahead", "wedge-faces"}),
        (deform_ahead, {"wedge-reach-ahead"}),
        (crack_below_the_tip, {"wedge-crack-start", "wedge-halves"}),
        (crack_late, {"wedge-crack-time"}),
        (lean_the_crack, {"wedge-crack-vertical"}),
        (crack_halfway, {"wedge-crack-through", "wedge-halves"}),
        (deepen_the_top_cracks, {"wedge-top-cracks"}),
        (no_top_cracks, {"wedge-top-cracks"}),
    ],
)
def test_fig_26_spoiled(judged, wedge, spoil, expected) -> None:
    spoil(wedge)
    assert missed(judged(WEDGE, wedge)) == expected


# --- all three --------------------------------------------------------------------------------


@pytest.mark.parametrize("name", [FLAT, CYLINDER, WEDGE])
def test_every_statement_can_be_read(judged, stopped, name) -> None:
    """Of an intact block, too, whose measures have nothing to measure."""
    found = judged(name, stopped)
    assert all(each.text and each.unit and each.allowed for each in found.values())
    unmeasured = {key for key, criterion in found.items() if criterion.value is None}
    assert unmeasured <= missed(found)


def test_a_scene_counts_by_what_it_is(make_result, flat) -> None:
    def keys(scene: Scene, *given: PaperTest) -> list[str]:
        result = make_result(scene=scene, snapshots=[flat])
        return [criterion.key for criterion in criteria(result, *given)]

    on_own = ["block.rows=20", "block.mass_points=cells"]
    heavy = load_scene(FLAT, overrides=["impactor.mass=7", *on_own])
    assert keys(heavy) == []
    assert keys(heavy, TESTS[FLAT]) == keys(on_cells(FLAT)) != []
    assert criteria(make_result(scene=on_cells(FLAT))) == []


# --- layers and room --------------------------------------------------------------------------


def test_keys_are_unique_over_all_tests(judged, flat) -> None:
    keys = [key for name in NAMES for key in judged(name, flat)]
    assert len(keys) == len(set(keys)) == 24 + 3 + 9


@pytest.mark.parametrize("name", [name for name in NAMES if TESTS[name].picture is None])
def test_a_test_without_a_picture_has_its_layer_and_its_room(judged, flat, name) -> None:
    kind, velocity = TESTS[name].kind, f"{TESTS[name].velocity:.2f}"
    shape = "flat" if kind == "rectangular" else kind
    expected = [f"flat-layer-{velocity}"] if shape == "flat" else []
    assert [*judged(name, flat)] == [*expected, f"{shape}-no-room-{velocity}"]


@pytest.mark.parametrize(
    ("velocity", "left", "holds"),
    [
        ("2.46", 0.22, True),
        ("2.46", 0.2, False),
        ("3.03", 0.22, True),
        ("3.03", 0.2, False),
        ("3.60", 0.18, True),
        ("3.60", 0.16, False),
        ("3.60", 0.35, True),
        ("3.60", 0.37, False),
    ],
)
def test_layers_are_about_a_third_and_less_when_fast(judged, flat, velocity, left, holds) -> None:
    """14 bonds of 5 mm pressed to that share, under 60 mm of displacement."""
    press(flat, 5, left)
    found = judged(f"paper/rectangular-{velocity}", flat)[f"flat-layer-{velocity}"]
    assert found.value == pytest.approx(14 * DY * left / DEPTH)
    assert found.holds == holds


def test_layers_and_room_are_judged_at_the_end(judged, make_snapshot, flat) -> None:
    """Pictures show the stop; specimens are looked at after the test."""
    found = judged(FLAT, flat, make_snapshot(BLOCK))
    assert found["flat-width"].value == pytest.approx(50.0)
    assert found["flat-layer-3.03"].value is None
    assert found["flat-no-room-3.03"].value is None


@pytest.mark.parametrize(("spacing", "holds"), [(0.02, True), (0.0, True), (-0.02, False)])
def test_layers_do_not_grow_with_velocity(judged, flat, spacing, holds) -> None:
    found = []
    for place, velocity in enumerate(("2.46", "3.03", "3.60")):
        press(flat, 5, 0.25 - spacing * place)
        found += judged(f"paper/rectangular-{velocity}", flat).values()
    (trend,) = comparing(found)
    assert trend.value == pytest.approx(-spacing * 14 * DY / DEPTH / 0.57, abs=1e-9)
    assert trend.holds == holds
    assert comparing(found[:-2]) == []  # without the layer of the fastest
    unknown = [replace(each, value=None) for each in found]
    assert [(each.value, each.holds) for each in comparing(unknown)] == [(None, False)]
