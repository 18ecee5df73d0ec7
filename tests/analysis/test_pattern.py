"""What the pictures show, measured on lattices whose answers are known by construction."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from paper_lattices import (
    ALONE,
    AXIS,
    CYLINDER,
    DX,
    DY,
    FACES,
    FLAT,
    FLAT_ON_FACES,
    PAPER,
    WEDGE,
    WEDGE_ON_FACES,
    column,
    downwards,
    mirrored,
)

from taichi_foam.analysis import pattern
from taichi_foam.analysis.fragments import crack_below_impactor
from taichi_foam.records.snapshot import Snapshot
from taichi_foam.scene import Block, FlatBlock, Scene, Wedge

PATH = slice(15, 25)  # columns in the path of an impactor 50 mm wide
CRUSHED = -0.85  # beyond the densification strain
LASTING = -0.2  # beyond yield, far from crushed


# --- the crushed region -----------------------------------------------------------------------


def test_crushed_rectangle(make_snapshot) -> None:
    """Ten columns wide, its upper seven rows of bonds down to 40 % of their length."""
    snapshot = make_snapshot(PAPER)
    snapshot.e_min_b[15:25, 12:19] = -0.6
    snapshot.e_min_b[2:4, 3] = -0.9  # a smaller patch elsewhere
    region = pattern.crushed_region(snapshot, FLAT)
    assert region.columns == (15, 24)
    assert region.rows == (12, 19)
    assert region.width == pytest.approx(0.05)
    assert region.height == pytest.approx(0.04)
    assert region.fill == pytest.approx(1.0)


def test_a_block_crushed_all_through_is_as_high_as_it_was(make_snapshot) -> None:
    """Mass points on the faces: what is counted from row to row ends at the faces."""
    snapshot = make_snapshot(FACES)
    snapshot.e_min_b[:] = -0.6
    region = pattern.crushed_region(snapshot, FLAT_ON_FACES)
    assert region.height == pytest.approx(FACES.height)
    assert region.width == pytest.approx(FACES.width)
    assert region.fill == pytest.approx(1.0)
    snapshot.e_min_b[:, 10:] = 0.0  # cells of rows 0 to 10, ten and a half high
    assert pattern.crushed_region(snapshot, FLAT_ON_FACES).height == pytest.approx(10.5 * DY)


def test_what_a_row_on_a_face_lacks_does_not_fill_the_box(make_snapshot) -> None:
    """Ten columns of rows 17 to 20, three and a half cells, and ten more of the last, a half."""
    snapshot = make_snapshot(FACES)
    snapshot.e_min_a[10:19, 17:] = snapshot.e_min_a[19:29, 20] = CRUSHED
    region = pattern.crushed_region(snapshot, FLAT_ON_FACES)
    assert region.fill == pytest.approx((10 * 3.5 + 10 * 0.5) / (20 * 3.5))


def test_a_crushed_triangle_fills_half_its_box(make_snapshot) -> None:
    """Columns of 2, 4, ... 20 crushed cells, as a staircase: 110 of 200."""
    snapshot = make_snapshot(PAPER)
    for k in range(10):
        snapshot.e_min_b[15 + k, 18 - 2 * k : 19] = CRUSHED
    region = pattern.crushed_region(snapshot, FLAT)
    assert region.fill == pytest.approx(0.55)


@pytest.mark.parametrize(("strain", "counts"), [(-0.42, False), (-0.43, True)])
def test_crushed_is_halfway_from_yield_to_densification(make_snapshot, strain, counts) -> None:
    snapshot = make_snapshot(PAPER)
    snapshot.e_min_a[10, 7] = strain
    region = pattern.crushed_region(snapshot, FLAT)
    assert (region is not None) == counts
    if region is not None:
        assert region.columns == (10, 11)
        assert region.rows == (7, 7)


def test_boundary_is_counted_from_crushed_to_elastic(make_snapshot) -> None:
    snapshot = make_snapshot(PAPER)
    snapshot.e_min_b[PATH, 6:19] = CRUSHED
    assert pattern.boundary_cells(snapshot, FLAT) == (0.0, 0.0)
    snapshot.e_min_b[13:15, 6:19] = LASTING  # two columns on the left, none on the right
    snapshot.e_min_b[PATH, 3:5] = LASTING  # cells of rows 3 to 5, three below the region
    assert pattern.boundary_cells(snapshot, FLAT) == (1.0, 3.0)


def test_foam_at_the_plateau_is_as_good_as_elastic(make_snapshot) -> None:
    """Twice the yield strain is the limit; beyond a gap of elastic foam nothing counts."""
    snapshot = make_snapshot(PAPER)
    snapshot.e_min_b[PATH, 6:19] = CRUSHED
    snapshot.e_min_b[13:15, 6:19] = -0.099
    snapshot.e_min_b[8:13, 6:19] = LASTING
    assert pattern.boundary_cells(snapshot, FLAT) == (0.0, 0.0)
    snapshot.e_min_b[13:15, 6:19] = -0.101
    assert pattern.boundary_cells(snapshot, FLAT) == (3.5, 0.0)  # seven on one side


# --- where foam is crushed --------------------------------------------------------------------


def test_crushed_outside_the_path(make_snapshot) -> None:
    """A region twelve columns wide, one too many on each side, and 2 of 122 cells far away."""
    snapshot = make_snapshot(PAPER)
    snapshot.e_min_b[14:26, 10:19] = CRUSHED
    snapshot.e_min_b[3, 3] = CRUSHED
    assert pattern.crushed_outside(snapshot, FLAT, margin=0.0) == pytest.approx(22 / 122)
    assert pattern.crushed_outside(snapshot, FLAT, margin=DX) == pytest.approx(2 / 122)
    aside = FLAT.model_copy(update={"impactor": FlatBlock(x=0.06)})
    assert pattern.crushed_outside(snapshot, aside, margin=DX) == pytest.approx(1.0)


def test_severity_by_row(make_snapshot) -> None:
    """A's of the path's columns give each row its own strain; foam beside the path is left out."""
    snapshot = make_snapshot(PAPER)
    strain = -np.linspace(0.05, 0.9, 20)
    snapshot.e_min_a[15:24] = strain
    snapshot.e_min_a[2:8] = -0.94
    severity = pattern.severity_by_row(snapshot, FLAT)
    assert severity == pytest.approx(-strain[::-1])


@pytest.mark.parametrize(
    ("strains", "expected"),
    [
        ([0.6, 0.7, 0.8, 0.9], 1.0),  # from the lowest row up
        ([0.9, 0.8, 0.7, 0.6], 0.0),
        ([0.8, 0.8, 0.8, 0.8], 0.5),  # evenly crushed above whole foam
        ([0.6, 0.8, 0.7, 0.9], 5 / 6),  # one of six pairs the wrong way round
        ([0.9], None),
    ],
)
def test_severity_falls_within_the_crushed_region(make_snapshot, strains, expected) -> None:
    snapshot = make_snapshot(PAPER)
    snapshot.e_min_a[15:24, 20 - len(strains) :] = -np.array(strains)
    found = pattern.severity_falls(snapshot, FLAT)
    assert found == (None if expected is None else pytest.approx(expected))


@pytest.mark.parametrize(
    ("columns", "expected"), [([18], 1.0), ([14], 0.0), ([18, 14], 0.5), ([20], 1.0), ([16], 1.0)]
)
def test_the_worst_is_beneath_within_the_width(make_snapshot, columns, expected) -> None:
    """Of 20 cells in columns at -27.5, -17.5, -7.5 and 2.5 mm the worst two; equals count too."""
    snapshot = make_snapshot(PAPER, impactor_y=0.05)
    snapshot.e_min_b[14:22:2, 4:8] = -0.6
    for i in columns:
        snapshot.e_min_b[i, 6] = -0.9
    assert pattern.worst_beneath(snapshot, CYLINDER) == pytest.approx(expected)


def test_what_lies_above_the_nose_is_not_beneath(make_snapshot) -> None:
    snapshot = make_snapshot(PAPER, impactor_y=0.01)
    snapshot.e_min_b[19, 6] = CRUSHED  # at 32.5 and 37.5 mm; the nose is fully in at 35 mm
    assert pattern.worst_beneath(snapshot, CYLINDER) == pytest.approx(0.5)


@pytest.mark.parametrize(
    ("x", "y", "distance"),
    [
        (0.02, 0.05, 0.02 / 2**0.5),  # from the face at 45 degrees
        (-0.02, 0.05, 0.02 / 2**0.5),
        (0.0, 0.04, 0.01),  # below the tip
        (0.031, 0.09, 0.006),  # beside the shank
        (0.03, 0.07, 0.01 / 2**0.5),  # the shoulder itself is nearest
        (0.0, 0.09, 0.0),  # within the cavity
    ],
)
def test_distance_from_the_cavity(make_snapshot, x, y, distance) -> None:
    """Tip at 50 mm, shoulders at (25, 75) mm."""
    snapshot = make_snapshot(PAPER, impactor_y=0.05)
    snapshot.e_min_b[3, 3] = CRUSHED
    snapshot.position[3, 3:5] = x, y
    within = pattern.crushed_along_faces(snapshot, WEDGE, margin=distance + 1e-9)
    assert within == pytest.approx(1.0)
    if distance:
        assert pattern.crushed_along_faces(snapshot, WEDGE, margin=distance - 1e-6) == 0.0


def test_share_along_the_faces(make_snapshot) -> None:
    snapshot = make_snapshot(PAPER, impactor_y=0.05)
    snapshot.e_min_b[20, 10] = snapshot.e_min_b[0, 10] = CRUSHED
    assert pattern.crushed_along_faces(snapshot, WEDGE, margin=DX) == pytest.approx(0.5)


def test_share_on_the_left(make_snapshot) -> None:
    snapshot = make_snapshot(PAPER)
    snapshot.e_min_b[18, 5] = snapshot.e_min_b[17, 5] = snapshot.e_min_b[20, 5] = CRUSHED
    assert pattern.crushed_left(snapshot, WEDGE) == pytest.approx(2 / 3)
    on_a_column = WEDGE.model_copy(update={"impactor": Wedge(x=-0.0075)})  # column 18
    assert pattern.crushed_left(snapshot, on_a_column) == pytest.approx(1.5 / 3)


def test_crushed_ahead_of_the_tip(make_snapshot) -> None:
    """Cells of rows 8 to 11, mass points at 42.5, 47.5, 52.5 and 57.5 mm, tip at 50 mm."""
    snapshot = make_snapshot(PAPER, impactor_y=0.05)
    snapshot.e_min_b[19, 8:11] = CRUSHED
    assert pattern.crushed_ahead(snapshot, WEDGE) == pytest.approx(0.5)
    assert pattern.reach_ahead(snapshot, WEDGE) == pytest.approx(0.010)  # to row 8's lower side


def test_reach_counts_lasting_deformation_in_the_middle_only(make_snapshot) -> None:
    snapshot = make_snapshot(PAPER, impactor_y=0.05)
    snapshot.e_min_b[15, 2] = CRUSHED
    assert pattern.reach_ahead(snapshot, WEDGE) == 0.0
    snapshot.e_min_b[18, 5] = LASTING  # mass points at 27.5 and 32.5 mm
    assert pattern.reach_ahead(snapshot, WEDGE) == pytest.approx(0.025)


def test_foam_on_the_bottom_face_reaches_to_it(make_snapshot) -> None:
    """Not half a cell further down."""
    snapshot = make_snapshot(FACES, impactor_y=0.03)
    snapshot.e_min_a[19, 0] = LASTING
    assert pattern.reach_ahead(snapshot, FLAT_ON_FACES) == pytest.approx(0.03)
    snapshot.e_min_a[19, :2] = 0.0, LASTING  # the row above, from 2.5 mm up
    assert pattern.reach_ahead(snapshot, FLAT_ON_FACES) == pytest.approx(0.0275)


# --- cracks -----------------------------------------------------------------------------------


@pytest.mark.parametrize(("lowest", "through"), [(1, True), (2, True), (3, False)])
def test_a_crack_splits_within_a_tenth_of_the_height(make_snapshot, lowest, through) -> None:
    snapshot = make_snapshot(PAPER, a=column(AXIS, range(lowest, 20)), times=downwards)
    crack = crack_below_impactor(snapshot, WEDGE)
    assert pattern.crack_reach(crack, PAPER) == pytest.approx(1 - 0.05 * lowest)
    assert pattern.splits(crack, PAPER) == through
    # Two rows of twenty are left out: 20 columns of 18 mass points of 800.
    half = 0.45 if through else 0.0
    assert pattern.second_half(snapshot, PAPER) == pytest.approx(half)
    assert pattern.second_part(snapshot, PAPER) == pytest.approx(half)


def test_a_layer_torn_off_is_a_part_but_no_half(make_snapshot) -> None:
    """Broken between rows 9 and 10: 8 rows above the base and 10 above those."""
    snapshot = make_snapshot(PAPER, b=[(i, 9) for i in range(40)])
    assert pattern.second_part(snapshot, PAPER) == pytest.approx(0.4)
    assert pattern.second_half(snapshot, PAPER) == 0.0


@pytest.mark.parametrize(("lowest", "through"), [(1, True), (2, True), (3, False)])
def test_it_splits_between_faces_too(make_snapshot, lowest, through) -> None:
    """Lowest ends 2.5, 7.5 and 12.5 mm above the bottom; two rows of 21 are left out."""
    snapshot = make_snapshot(FACES, a=column(AXIS, range(lowest, 21)), times=downwards)
    crack = crack_below_impactor(snapshot, WEDGE_ON_FACES)
    assert pattern.crack_reach(crack, FACES) == pytest.approx(1 - 0.05 * (lowest - 0.5))
    assert pattern.splits(crack, FACES) == through
    half = 20 * 19 / (40 * 21) if through else 0.0
    assert pattern.second_half(snapshot, FACES) == pytest.approx(half)


def test_what_is_left_out_ends_within_a_tenth_of_the_height(make_snapshot) -> None:
    """Six rows, the first of them half a cell and so a tenth: what is above it is parted."""
    block = Block(columns=8, rows=6)
    cut = make_snapshot(block, a=[(3, j) for j in range(1, 6)])
    assert pattern.second_half(cut, block) == pytest.approx(20 / 48)


def test_no_crack_does_not_split() -> None:
    assert pattern.crack_reach(None, PAPER) == 0.0
    assert not pattern.splits(None, PAPER)


def test_distance_of_a_crack_from_the_tip(make_snapshot) -> None:
    """It starts at (0, 72.5) mm after 6 ms, when the tip is on its way from 97.5 to 57.5 mm."""
    a = column(AXIS, range(3, 15))
    end = make_snapshot(PAPER, a=a, times=downwards, time=0.010, impactor_y=0.0575)
    crack = crack_below_impactor(end, WEDGE)
    assert crack.start_time == pytest.approx(6e-3)
    distance = pattern.crack_from_tip(crack, [make_snapshot(PAPER), end], WEDGE)
    assert distance == pytest.approx(0.0735 - 0.0725)
    aside = WEDGE.model_copy(update={"impactor": Wedge(x=0.003)})
    distance = pattern.crack_from_tip(crack, [make_snapshot(PAPER), end], aside)
    assert distance == pytest.approx(np.hypot(0.001, 0.003))


# --- cracks at the top surface ----------------------------------------------------------------


def pulled(snapshot: Snapshot, i: int, gap: float) -> Snapshot:
    """All columns right of A(i, j) moved to the right by a gap."""
    snapshot.position[i + 1 :, :, 0] += gap
    return snapshot


def test_a_crack_that_opens_at_the_top(make_snapshot) -> None:
    """Three rows deep at x = 40 mm, 10 % apart."""
    a = [(27, j) for j in (19, 18, 17)]
    snapshot = pulled(make_snapshot(PAPER, a=a, times=downwards), 27, 0.1 * DX)
    found = pattern.top_cracks([make_snapshot(PAPER), snapshot], WEDGE)
    assert found == pattern.TopCracks(count=1, depth=pytest.approx(0.015), first_time=1e-3)


def test_it_may_wander_and_close_again(make_snapshot) -> None:
    a = [(27, 19), (28, 18), (28, 17)]
    open_now = pulled(pulled(make_snapshot(PAPER, a=a), 27, 0.1 * DX), 28, 0.1 * DX)
    found = pattern.top_cracks([open_now, make_snapshot(PAPER, a=a)], WEDGE)
    assert found.count == 1
    assert found.depth == pytest.approx(0.015)


@pytest.mark.parametrize(
    ("column", "row", "why"),
    [
        (24, 19, "the flank, where a shank tears the foam off"),
        (AXIS, 19, "under the impactor"),
        (36, 19, "further away than the impactor is wide"),
        (27, 18, "below the surface"),
    ],
)
def test_what_is_no_crack_of_the_top(make_snapshot, column, row, why) -> None:
    snapshot = pulled(make_snapshot(PAPER, a=[(column, row)]), column, 0.1 * DX)
    assert pattern.top_cracks([snapshot], WEDGE) == pattern.TopCracks(0, 0.0, None), why


def test_a_tear_that_slides_has_not_opened(make_snapshot) -> None:
    """Sheared by 20 %, the bond is 2 % longer."""
    snapshot = make_snapshot(PAPER, a=[(27, 19)])
    snapshot.position[28:, :, 1] -= 0.2 * DX
    assert pattern.top_cracks([snapshot], WEDGE).count == 0


def test_a_crack_of_the_top_may_run_through(make_snapshot) -> None:
    a = [(27, j) for j in range(20)]
    snapshot = pulled(make_snapshot(PAPER, a=a), 27, 0.1 * DX)
    assert pattern.top_cracks([snapshot], WEDGE).depth == pytest.approx(PAPER.height)


def test_the_row_on_the_top_is_half_a_cell_deep(make_snapshot) -> None:
    for rows, depth in ((1, 0.0025), (3, 0.0125), (21, FACES.height)):
        a = [(27, 20 - k) for k in range(rows)]
        snapshot = pulled(make_snapshot(FACES, a=a), 27, 0.1 * DX)
        found = pattern.top_cracks([snapshot], WEDGE_ON_FACES)
        assert found.depth == pytest.approx(depth)


# --- nothing to measure, and mirror images ----------------------------------------------------


def measured(snapshot: Snapshot, scene: Scene) -> dict[str, Any]:
    """Every measure of an instant but those with a side."""
    region = pattern.crushed_region(snapshot, scene)
    severity = pattern.severity_by_row(snapshot, scene)
    return {
        "extent": region and (region.width, region.height, region.fill),
        "boundary": pattern.boundary_cells(snapshot, scene),
        "outside": pattern.crushed_outside(snapshot, scene, DX),
        "severity": None if severity is None else severity.tolist(),
        "falls": pattern.severity_falls(snapshot, scene),
        "worst": pattern.worst_beneath(snapshot, scene),
        "along": pattern.crushed_along_faces(snapshot, scene, DX),
        "ahead": pattern.crushed_ahead(snapshot, scene),
        "reach": pattern.reach_ahead(snapshot, scene),
        "top": pattern.top_cracks([snapshot], scene),
        "part": pattern.second_part(snapshot, scene.block),
        "half": pattern.second_half(snapshot, scene.block),
    }


@pytest.mark.parametrize("scene", [FLAT, CYLINDER, WEDGE])
def test_an_intact_block_has_no_pattern(make_snapshot, scene) -> None:
    found = measured(make_snapshot(PAPER), scene)
    known = {key: value for key, value in found.items() if value is not None}
    assert known == {
        "severity": [0.0] * 20,
        "reach": 0.0,
        "top": pattern.TopCracks(0, 0.0, None),
        "part": 0.0,
        "half": 0.0,
    }
    assert pattern.crushed_left(make_snapshot(PAPER), scene) is None
    assert pattern.top_cracks([], scene) is None


def test_without_an_impactor_there_is_no_path(make_snapshot) -> None:
    snapshot = make_snapshot(PAPER, a=column(AXIS, range(3, 15)), times=downwards)
    crack = crack_below_impactor(snapshot, WEDGE)
    snapshot.e_min_b[PATH, 6:19] = CRUSHED
    known = {key for key, value in measured(snapshot, ALONE).items() if value is not None}
    assert known == {"extent", "boundary", "part", "half"}
    assert pattern.crushed_left(snapshot, ALONE) is None
    assert pattern.crack_from_tip(crack, [snapshot], ALONE) is None


@pytest.mark.parametrize("scene", [FLAT, CYLINDER, WEDGE])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_mirror_image_measures_the_same(make_snapshot, scene, seed) -> None:
    rng = np.random.default_rng(seed)
    snapshot = make_snapshot(PAPER, impactor_y=0.045)
    for strain, times in (
        (snapshot.e_min_a, snapshot.break_time_a),
        (snapshot.e_min_b, snapshot.break_time_b),
    ):
        strain[:] = -0.6 * rng.random(strain.shape)
        broken = rng.random(times.shape) < 0.45
        times[broken] = rng.random(np.count_nonzero(broken))
    snapshot.position[:] += rng.normal(scale=1e-3, size=snapshot.position.shape)
    image = mirrored(snapshot)
    one, other = measured(snapshot, scene), measured(image, scene)
    tops = one.pop("top"), other.pop("top")
    assert tops[0] == tops[1]
    for key, value in one.items():
        assert other[key] == pytest.approx(value, abs=1e-12), key
    left = pattern.crushed_left(snapshot, scene)
    assert left is not None
    assert left != pytest.approx(0.5, abs=1e-6)
    assert pattern.crushed_left(image, scene) == pytest.approx(1 - left)
