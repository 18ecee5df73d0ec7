"""Pieces and cracks on lattices small enough to draw."""

from __future__ import annotations

from itertools import pairwise, product

import numpy as np
import pytest
from paper_lattices import (
    ALONE,
    AXIS,
    FACES,
    FLAT,
    PAPER,
    WEDGE,
    WEDGE_ON_FACES,
    column,
    downwards,
)

from taichi_foam.analysis.fragments import (
    crack_below_impactor,
    crack_over_time,
    cracks,
    parts,
    piece_sizes,
    pieces,
)
from taichi_foam.scene import Block, Cylinder, FlatBlock, Scene, Wedge

SMALL = Block(width=0.08, height=0.03, columns=8, rows=6, mass_points="cells")  # of 10 x 5 mm

# --- pieces -----------------------------------------------------------------------------------


ALL_BONDS = {"a": [*product(range(9), range(10))], "b": [*product(range(10), range(9))]}


# 48 nodes: a corner of 2 nodes is 4.2 %, one of 3 is 6.3 %; one node of 20 is 5 %
@pytest.mark.parametrize(
    ("block", "broken", "count"),
    [
        (SMALL, {}, 1),
        (SMALL, {"a": column(3, range(6))}, 2),
        (SMALL, {"a": column(3, range(1, 6))}, 1),
        (SMALL, {"a": [(0, 5), (0, 4)], "b": [(0, 3)]}, 1),
        (SMALL, {"a": [(0, 5), (0, 4), (0, 3)], "b": [(0, 2)]}, 2),
        (Block(columns=10, rows=2), {"a": [(0, 1)], "b": [(0, 0)]}, 2),
        (Block(columns=10, rows=10), ALL_BONDS, 0),
    ],
    ids=["intact", "cut", "cut short", "crumb", "just a piece", "exactly 5 %", "powder"],
)
def test_pieces_are_parts_of_five_percent_or_more(make_snapshot, block, broken, count) -> None:
    assert pieces(make_snapshot(block, **broken), block) == count


def test_sizes_are_shares_of_the_mass_points(make_snapshot) -> None:
    """A corner of two nodes, and a cut between columns 3 and 4 of 8: 24, 22 and 2 of 48."""
    snapshot = make_snapshot(SMALL, a=[(0, 5), (0, 4), *column(3, range(6))], b=[(0, 3)])
    assert piece_sizes(snapshot, SMALL) == pytest.approx([24 / 48, 22 / 48, 2 / 48])
    assert piece_sizes(make_snapshot(SMALL), SMALL) == pytest.approx([1.0])


def test_parts_without_the_rows_that_hold_them_together(make_snapshot) -> None:
    """A crack that leaves the bottom row whole parts what is above it."""
    snapshot = make_snapshot(SMALL, a=column(3, range(1, 6)))
    assert np.ptp(parts(snapshot, SMALL)) == 0
    above = parts(snapshot, SMALL, bottom_rows=1)
    assert above.shape == (8, 5)
    assert np.ptp(above[:4]) == np.ptp(above[4:]) == 0
    assert above[0, 0] != above[4, 0]


# --- crack polylines --------------------------------------------------------------------------


def as_set(line: np.ndarray) -> set[tuple[float, float]]:
    return {(round(x, 9), round(y, 9)) for x, y in line.tolist()}


def test_no_crack(make_snapshot) -> None:
    assert cracks(make_snapshot(SMALL), SMALL) == []


def test_vertical_crack(make_snapshot) -> None:
    (line,) = cracks(make_snapshot(SMALL, a=column(3, range(2, 6))), SMALL)
    line = line[np.argsort(line[:, 1])]
    assert line[:, 0] == pytest.approx(0.0)  # between columns 3 and 4 of 8: the middle
    assert line[:, 1] == pytest.approx([0.010, 0.015, 0.020, 0.025, 0.030])


def test_horizontal_crack(make_snapshot) -> None:
    (line,) = cracks(make_snapshot(SMALL, b=[(0, 1), (1, 1), (2, 1)]), SMALL)
    line = line[np.argsort(line[:, 0])]
    assert line[:, 0] == pytest.approx([-0.04, -0.03, -0.02, -0.01])
    assert line[:, 1] == pytest.approx(0.010)  # between rows 1 and 2


def test_two_separate_cracks_longest_first(make_snapshot) -> None:
    snapshot = make_snapshot(SMALL, a=[*column(1, range(3)), *column(5, range(1, 6))])
    long, short = cracks(snapshot, SMALL)
    assert len(long) == 6
    assert set(np.round(long[:, 0], 9)) == {0.02}
    assert len(short) == 4
    assert set(np.round(short[:, 0], 9)) == {-0.02}


def test_length_is_measured_in_metres(make_snapshot) -> None:
    """Two wide cells (20 mm) are longer than three low ones (15 mm)."""
    first, second = cracks(make_snapshot(SMALL, a=column(6, range(3)), b=[(0, 4), (1, 4)]), SMALL)
    assert len(first) == 3
    assert len(second) == 4


def test_t_junction_splits_into_three(make_snapshot) -> None:
    """A vertical crack of three cells hangs from the middle of a horizontal one of four."""
    snapshot = make_snapshot(SMALL, a=column(3, range(1, 4)), b=[(i, 3) for i in range(2, 6)])
    lines = cracks(snapshot, SMALL)
    junction = (0.0, 0.020)
    assert sorted(len(line) - 1 for line in lines) == [2, 2, 3]
    for line in lines:
        ends = as_set(line[[0, -1]])
        assert junction in ends
        assert junction not in as_set(line[1:-1])


def test_closed_loop_repeats_its_first_corner(make_snapshot) -> None:
    """All four bonds of cell (3, 2) are broken."""
    (line,) = cracks(make_snapshot(SMALL, a=[(2, 2), (3, 2)], b=[(3, 1), (3, 2)]), SMALL)
    assert line.shape == (5, 2)
    assert line[0].tolist() == line[-1].tolist()
    assert as_set(line) == {(-0.01, 0.010), (0.0, 0.010), (0.0, 0.015), (-0.01, 0.015)}


def test_every_broken_connection_is_drawn_once(make_snapshot) -> None:
    rng = np.random.default_rng(7)
    a = [tuple(ij) for ij in np.argwhere(rng.random((7, 6)) < 0.4)]
    b = [tuple(ij) for ij in np.argwhere(rng.random((8, 5)) < 0.4)]
    lines = cracks(make_snapshot(SMALL, a=a, b=b), SMALL)
    middles = [tuple(np.round(xy, 9)) for line in lines for xy in (line[1:] + line[:-1]) / 2]
    expected = {(round((i - 3) * 0.01, 9), round((j + 0.5) * 0.005, 9)) for i, j in a}
    expected |= {(round((i - 3.5) * 0.01, 9), round((j + 1) * 0.005, 9)) for i, j in b}
    assert len(middles) == len(a) + len(b)
    assert set(middles) == expected


def test_with_mass_points_on_the_faces_cracks_end_at_them(make_snapshot) -> None:
    """A cut through the block is as long as it is high, its cells half as high at both ends."""
    (line,) = cracks(make_snapshot(FACES, a=column(AXIS, range(21))), FACES)
    expected = [0.0, *np.arange(0.0025, 0.1, 0.005), 0.1]
    assert np.sort(line[:, 1]) == pytest.approx(expected)
    (level,) = cracks(make_snapshot(FACES, b=[(0, 0), (1, 0)]), FACES)
    assert level[:, 1] == pytest.approx(0.0025)  # between the row on the bottom and the next


# --- the crack below the impactor -------------------------------------------------------------


def test_crack_from_the_tip_to_the_gripped_base(make_snapshot) -> None:
    snapshot = make_snapshot(PAPER, a=column(AXIS, range(1, 20)), times=downwards)
    crack = crack_below_impactor(snapshot, WEDGE)
    assert crack.lowest_height == pytest.approx(0.005)  # the bottom row cannot open
    assert crack.start_x == pytest.approx(0.0)
    assert crack.start_height == pytest.approx(0.0975)
    assert crack.start_time == pytest.approx(1e-3)


def test_an_intact_block_and_a_scene_without_impactor_have_none(make_snapshot) -> None:
    split = make_snapshot(PAPER, a=column(AXIS, range(20)), times=downwards)
    assert crack_below_impactor(make_snapshot(PAPER), WEDGE) is None
    assert crack_below_impactor(split, ALONE) is None


@pytest.mark.parametrize(("first", "height"), [(1, 0.0025), (0, 0.0)])
def test_crack_from_face_to_face(make_snapshot, first: int, height: float) -> None:
    """Its first bond lies on the top; the gripped row on the bottom is half a cell high."""
    snapshot = make_snapshot(FACES, a=column(AXIS, range(first, 21)), times=downwards)
    crack = crack_below_impactor(snapshot, WEDGE_ON_FACES)
    assert crack.start_height == pytest.approx(FACES.height)
    assert crack.lowest_height == pytest.approx(height, abs=1e-12)
    assert crack.path[-1] == pytest.approx((0.0, 0.005 * first), abs=1e-12)


@pytest.mark.parametrize("scene", [WEDGE, WEDGE_ON_FACES], ids=["cells", "faces"])
@pytest.mark.parametrize(("cells", "counts"), [(2, False), (3, True)])
def test_it_needs_three_cells(make_snapshot, scene: Scene, cells: int, counts: bool) -> None:
    snapshot = make_snapshot(scene.block, a=column(AXIS, range(12, 12 + cells)), times=downwards)
    assert (crack_below_impactor(snapshot, scene) is not None) == counts


def test_a_finer_lattice_needs_the_same_length(make_snapshot) -> None:
    fine = Block(columns=80, rows=40, mass_points="cells")
    scene = Scene(name="fine", block=fine, impactor=Wedge())
    for cells, counts in ((5, False), (6, True)):  # 12.5 and 15 mm
        rows = range(20, 20 + cells)
        snapshot = make_snapshot(fine, a=column(39, rows), times=lambda i, j: 1e-3 * (40 - j))
        assert (crack_below_impactor(snapshot, scene) is not None) == counts


NO_CRACKS = {
    "powder below a flat block, ten cells wide and twelve deep": {
        "a": list(product(range(15, 24), range(8, 20))),
        "b": list(product(range(15, 25), range(8, 19))),
    },
    "bonds that share no corner: a third of the rows, every other column": {
        "a": list(product(range(15, 24, 2), range(2, 20, 3)))
    },
    "a punch shears the foam off at both its edges, x = -25 and 25 mm": {
        "a": column(14, range(6, 20)) + column(24, range(6, 20))
    },
    "a layer that comes off": {"b": list(product(range(5, 35), [7]))},
}


@pytest.mark.parametrize("what", NO_CRACKS)
def test_what_is_no_crack(make_snapshot, what: str) -> None:
    snapshot = make_snapshot(PAPER, **NO_CRACKS[what], times=downwards)
    assert crack_below_impactor(snapshot, FLAT) is None


def test_a_tear_within_the_flanks_is_one(make_snapshot) -> None:
    inside = make_snapshot(PAPER, a=column(15, range(6, 20)), times=downwards)
    assert crack_below_impactor(inside, FLAT) is not None


def test_a_crack_out_of_shattered_foam_is_one(make_snapshot) -> None:
    powder_a = list(product(range(15, 24), range(16, 20)))
    powder_b = list(product(range(15, 25), range(16, 19)))
    snapshot = make_snapshot(
        PAPER, a=powder_a + column(AXIS, range(3, 16)), b=powder_b, times=downwards
    )
    crack = crack_below_impactor(snapshot, FLAT)
    assert crack.lowest_height == pytest.approx(0.015)
    assert crack.start_time == pytest.approx(1e-3)


def test_a_crack_that_rises_from_the_base_does_not_count(make_snapshot) -> None:
    rising = make_snapshot(PAPER, a=column(AXIS, range(10)), times=lambda i, j: 1e-3 * (j + 1))
    assert crack_below_impactor(rising, WEDGE) is None


def test_it_is_followed_where_it_wanders(make_snapshot) -> None:
    """Down the axis, aslant beyond the impactor's width, then down again."""
    down, further = column(AXIS, range(12, 20)), column(AXIS + 8, range(2, 4))
    aslant = [(AXIS + 12 - j, j) for j in range(4, 12)]
    snapshot = make_snapshot(PAPER, a=down + aslant + further, times=downwards)
    crack = crack_below_impactor(snapshot, WEDGE)
    assert crack.lowest_height == pytest.approx(0.010)
    assert crack.start_x == pytest.approx(0.0)


def test_of_two_the_deeper_counts(make_snapshot) -> None:
    snapshot = make_snapshot(
        PAPER, a=column(17, range(10, 20)) + column(21, range(5, 12)), times=downwards
    )
    crack = crack_below_impactor(snapshot, WEDGE)
    assert crack.lowest_height == pytest.approx(0.025)
    assert crack.start_x == pytest.approx(0.010)
    assert crack.start_height == pytest.approx(0.0575)


def test_it_lies_below_the_impactor_wherever_that_is(make_snapshot) -> None:
    snapshot = make_snapshot(PAPER, a=column(29, range(5, 20)), times=downwards)  # x = 50 mm
    assert crack_below_impactor(snapshot, WEDGE) is None
    beside = Scene(name="beside", block=PAPER, impactor=Cylinder(x=0.05))
    crack = crack_below_impactor(snapshot, beside)
    assert crack.start_x == pytest.approx(0.05)


def test_a_narrow_impactor_still_has_an_axis(make_snapshot) -> None:
    narrow = Scene(name="narrow", block=PAPER, impactor=FlatBlock(width=0.006))
    snapshot = make_snapshot(PAPER, a=column(AXIS, range(5, 20)), times=downwards)
    assert crack_below_impactor(snapshot, narrow) is not None


def stairs(tread: int) -> tuple[list[tuple[int, int]], list[tuple[int, int]]]:
    """A and B of a crack down from the axis that goes a cell to the right every `tread` rows."""
    a = [(AXIS + (19 - j) // tread, j) for j in range(19, 1, -1)]
    b = [(i + 1, j - 1) for (i, j), (after, _) in pairwise(a) if after > i]
    return a, b


@pytest.mark.parametrize("tread", [1, 2, 3])
def test_a_crack_leans_as_it_runs(make_snapshot, tread: int) -> None:
    a, b = stairs(tread)
    crack = crack_below_impactor(make_snapshot(PAPER, a=a, b=b, times=downwards), WEDGE)
    assert len(crack.path) == 18
    assert crack.path[0] == pytest.approx((0.0, 0.0975))
    assert crack.path[-1] == pytest.approx(((17 // tread) * 0.005, 0.0125))
    lean = np.degrees(np.arctan(1 / tread))
    assert crack.direction_deg == pytest.approx(lean, abs=1e-9 if tread == 1 else 1.0)


def test_a_crack_to_the_left_leans_the_other_way(make_snapshot) -> None:
    a, b = stairs(1)
    mirrored = make_snapshot(
        PAPER, a=[(38 - i, j) for i, j in a], b=[(39 - i, j) for i, j in b], times=downwards
    )
    assert crack_below_impactor(mirrored, WEDGE).direction_deg == pytest.approx(-45.0)
    straight = make_snapshot(PAPER, a=column(AXIS, range(1, 20)), times=downwards)
    assert crack_below_impactor(straight, WEDGE).direction_deg == pytest.approx(0.0)


def test_the_path_keeps_to_its_branch(make_snapshot) -> None:
    """Two legs that hang from one crossbar: the path goes down the one that it started on."""
    legs = column(17, range(4, 16)) + column(22, range(4, 15))
    bar = [(i, 14) for i in range(18, 23)]
    snapshot = make_snapshot(PAPER, a=legs, b=bar, times=downwards)
    crack = crack_below_impactor(snapshot, WEDGE)
    assert [x for x, _ in crack.path] == pytest.approx([-0.010] * 12)


def test_over_time_it_keeps_its_start_and_its_deepest_path(make_snapshot) -> None:
    young = make_snapshot(PAPER, a=column(AXIS, range(12, 20)), times=downwards, time=8e-3)
    deep = make_snapshot(PAPER, a=column(AXIS, range(4, 20)), times=downwards, time=16e-3)
    deep.e_min_b[AXIS : AXIS + 2, 15:] = -0.9  # powder by then
    hidden = make_snapshot(PAPER, time=20e-3)
    crack = crack_over_time([make_snapshot(PAPER), young, deep, hidden], WEDGE)
    assert crack.start_height == pytest.approx(0.0975)
    assert crack.lowest_height == pytest.approx(0.020)
    assert crack.path[-1] == pytest.approx((0.0, 0.0225))
    assert crack_over_time([], WEDGE) is None
    assert crack_over_time([hidden], WEDGE) is None
