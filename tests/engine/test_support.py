"""A rigid support with an outline beneath the block: ribs, and any polygon."""

import numpy as np
import pytest
import shapely
from bench import node_forces
from pydantic import ValidationError
from reference_lattice import reference_positions

import taichi_foam as tf
from taichi_foam.results.result import Result
from taichi_foam.scene import Base, Block, FlatBlock, Numerics, Output, Scene, Support

FLOOR = Base(kind="floor")
LEVEL = Support(kind="outline", outline=((-1, -0.1), (1, -0.1), (1, 0), (-1, 0)))
RIBS = Support(kind="ribs", pitch=0.025, width=0.01, depth=0.02)
BLOCK = Block(mass_points="cells", width=0.1, height=0.05, columns=20, rows=10)
K, YIELD, FACE = 2.78e6, 0.05, 0.005 * 0.057  # Pa, -, m2

# Of the mass points at odd multiples of 2.5 mm: two on each of three ribs, one on each outer one.
ON_RIBS = [0, 4, 5, 9, 10, 14, 15, 19]


def drop(support: Support, block: Block = BLOCK, mass: float = 1.0, end: float = 6e-3) -> Scene:
    return Scene(
        block=block,
        impactor=FlatBlock(width=0.12, height=0.02, mass=mass, velocity=3.0),
        base=FLOOR,
        support=support,
        numerics=Numerics(end=end, gravity=9.81),
        output=Output(history_interval=2e-5, snapshot_interval=5e-4),
    )


def unaccounted(result: Result) -> float:
    """The ledger's residual over the energy of the fall."""
    impactor = result.scene.impactor
    assert impactor is not None
    return float(
        np.abs(result.history["residual_J"]).max() / (0.5 * impactor.mass * impactor.velocity**2)
    )


CUT_FACES = Block(mass_points="faces",
    width=0.1, height=0.05, columns=20, rows=10,
    outline=((-0.041, 0), (0.041, 0), (0.05, 0.031), (0.05, 0.05), (-0.05, 0.05), (-0.05, 0.031)),
)  # fmt: skip


@pytest.mark.parametrize("block", [BLOCK, CUT_FACES], ids=["plain", "cut, on faces"])
def test_a_level_support_is_the_floor(block: Block) -> None:
    """Every column of the history, to rounding."""
    on_floor, on_level = (tf.run(drop(each, block)).history for each in (Support(), LEVEL))
    assert np.nanmax(on_floor["contact_force_N"]) > 300.0
    for name, column in on_floor.items():
        scale = np.nanmax(np.abs(column), initial=1e-12)
        np.testing.assert_allclose(on_level[name], column, atol=1e-9 * scale, err_msg=name)


@pytest.fixture(scope="module")
def on_ribs() -> Result:
    return tf.run(drop(RIBS, end=8e-3))


def test_a_drop_on_ribs_is_accounted_for(on_ribs: Result) -> None:
    by_ribs = ("contact_J", "contact_loss_J", "friction_J")
    assert sum(on_ribs.history[name][-1] for name in by_ribs) > 0.5
    assert unaccounted(on_ribs) < 1e-3


def test_a_symmetric_drop_on_ribs_stays_symmetric_to_the_last_bit(on_ribs: Result) -> None:
    position = on_ribs.snapshots[-1].position
    np.testing.assert_array_equal(position[::-1] * [-1.0, 1.0], position)


def test_foam_sinks_between_ribs_and_not_into_them(on_ribs: Result) -> None:
    """The lowest mass points hang between ribs, and none is inside of one."""
    outline = RIBS.outline_under(BLOCK)
    assert outline is not None
    body = shapely.Polygon(outline)
    points = np.concatenate([each.position.reshape(-1, 2) for each in on_ribs.snapshots])
    assert points[:, 1].min() < -BLOCK.dy
    inside = points[shapely.contains_xy(body, *points.T)]
    deep = shapely.distance(body.exterior, shapely.points(inside))
    assert deep.max(initial=0.0) < 0.02 * BLOCK.dy


def test_foam_crushed_flat_between_impactor_and_ribs_is_accounted_for() -> None:
    """Mass points that both touch do not need shorter steps than the bound gives."""
    result = tf.run(drop(RIBS, mass=30.0, end=20e-3))
    assert result.history["displacement_m"].max() > 0.95 * BLOCK.height
    assert unaccounted(result) < 1e-3


def test_ribs_that_a_crosshead_presses_on_yield_by_their_own_faces() -> None:
    """The force is the plateau stress times the faces on ribs, worked out by hand."""
    press = FlatBlock(width=0.12, height=0.02, motion="crosshead", velocity=0.2, travel=2e-3)
    scene = drop(RIBS).model_copy(
        update={"impactor": press, "numerics": Numerics(end=10e-3, gravity=0.0)}
    )
    history = tf.run(scene).history
    yielding = history["displacement_m"] > 1.75e-3  # the swing of the yield has decayed
    plateau = len(ON_RIBS) * K * YIELD * FACE
    np.testing.assert_allclose(history["contact_force_N"][yielding], plateau, rtol=2e-3)
    assert history["broken_bonds"][-1] == 0


@pytest.mark.parametrize(("sunk", "share"), [(0.05e-3, 0.02), (1.5e-3, 0.05)])
def test_ribs_push_up_what_stands_on_them(sunk: float, share: float) -> None:
    """The floor's law with half a cell of 2.5 mm, elastic and on the plateau; nothing in gaps."""
    still = {"impactor": None, "numerics": Numerics(end=1e-3, gravity=0.0)}
    scene = drop(RIBS).model_copy(update=still)
    position = reference_positions(scene) - [0.0, sunk]
    expected = np.zeros_like(position)
    expected[ON_RIBS, 0, 1] = K * FACE * share
    np.testing.assert_allclose(node_forces(scene, position=position), expected, atol=1e-8)


def test_a_wall_beside_the_block_presses_by_the_faces_of_bonds_along_x() -> None:
    """Cells of 5 by 8 mm, moved by 0.05 mm against it: half a cell's width gives way by 2 %."""
    block = Block(mass_points="cells", width=0.1, height=0.08, columns=20, rows=10)
    wall = ((0.05, -0.02), (0.06, -0.02), (0.06, 0.1), (0.05, 0.1))
    scene = drop(Support(kind="outline", outline=wall), block)
    scene = scene.model_copy(update={"impactor": None, "numerics": Numerics(end=1e-3, gravity=0.0)})
    rest = reference_positions(scene)
    np.testing.assert_allclose(node_forces(scene, position=rest), 0.0, atol=1e-9)
    expected = np.zeros_like(rest)
    expected[-1, :, 0] = -K * 0.008 * 0.057 * 0.02
    found = node_forces(scene, position=rest + np.array([0.05e-3, 0.0]))
    np.testing.assert_allclose(found, expected, atol=1e-8)


def test_ribs_lie_as_they_are_told() -> None:
    """Their middles are at the offset and whole pitches from it; a comb of level tops."""
    support = Support(kind="ribs", pitch=0.03, width=0.012, depth=0.02, offset=0.01)
    outline = support.outline_under(BLOCK)
    assert outline is not None
    body = shapely.Polygon(outline)
    assert body.is_valid
    for x in (-0.05, -0.02, 0.01, 0.04):
        rib = shapely.box(x - 0.006, -0.02, x + 0.006, 0.0)
        assert body.intersection(rib).area == pytest.approx(rib.area)
        gap = shapely.box(x + 0.006, -0.02, x + 0.024, 0.0)
        assert body.intersection(gap).area == pytest.approx(0.0, abs=1e-12)
    mirrored = RIBS.outline_under(BLOCK)
    assert mirrored is not None
    assert {(-x, y) for x, y in mirrored.tolist()} == {(x, y) for x, y in mirrored.tolist()}


BAD = {
    "held": ({"base": Base()}, RIBS, ["support.kind = 'ribs'", "set base.kind = 'floor'"]),
    "overlaps": (
        {},
        Support(kind="outline", outline=((-0.1, -0.1), (0.1, -0.1), (0.0, 0.01))),
        ["support.outline: overlaps the foam", "at most at y = 0"],
    ),
    "too many": (
        {"block": Block(mass_points="cells", width=1.0, height=0.5, columns=20, rows=10)},
        Support(kind="ribs", pitch=0.01, width=0.006, depth=0.02),
        ["support.pitch = 0.01", "at most 128", "wider pitch"],
    ),
    "thin": (
        {}, Support(kind="ribs", pitch=0.02, width=0.002, depth=0.02),
        ["support.width = 0.002", "thinner than a cell"],
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", BAD)
def test_a_support_that_the_block_cannot_stand_on(name: str) -> None:
    parts, support, words = BAD[name]
    given = {"base": FLOOR, "block": BLOCK, "numerics": Numerics(end=1e-3), **parts}
    with pytest.raises(ValidationError) as caught:
        Scene(**given, support=support)
    for word in words:
        assert word in str(caught.value)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"kind": "ribs", "pitch": 0.02}, ["support.width: missing", "support.depth: missing"]),
        (
            {"kind": "ribs", "pitch": 0.02, "width": 0.02, "depth": 0.01},
            ["support.width = 0.02", "must be below support.pitch = 0.02"],
        ),
        ({"pitch": 0.02}, ["support.pitch = 0.02", "support.kind = 'ribs'"]),
        ({"kind": "outline"}, ["support.outline: missing"]),
        ({"kind": "outline", "outline": ((0, 0), (1, 0))}, ["2 corners", "at least 3"]),
        (
            {"kind": "outline", "outline": ((-1, -1), (1, 0), (1, -1), (-1, 0))},
            ["support.outline: crosses or touches itself"],
        ),
    ],
)
def test_a_support_that_cannot_be(given: dict, words: list[str]) -> None:
    with pytest.raises(ValidationError) as caught:
        Support(**given)
    for word in words:
        assert word in str(caught.value)
