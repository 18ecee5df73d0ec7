"""Plans: what they say, what is refused before anything is computed, which drops they make."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from drops import axis, plan_of

from taichi_foam.errors import UserError
from taichi_foam.sweeps.plan import Plan, axis_of
from taichi_foam.sweeps.sampling import Design

MASS = {"key": "impactor.mass", "values": [3, 6.0]}
VELOCITY = {"key": "impactor.velocity", "from": 2.0, "to": 4.0}


def design_of(*axes: dict, **more: object) -> Design:
    return Design(Plan.load(plan_of(*axes, **more)))


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"axis": [VELOCITY]}, "axis: unknown key; did you mean axes?"),
        ({"axes": [{**axis(), "cont": 3}]}, "axes[0].cont: unknown key; did you mean axes[0].cou"),
        ({"axes": [3]}, "axes[0] = 3: must be a table with keys such as key, values, from, to"),
        ({"sample": {"method": "sobol", "cout": 8}}, "sample.cout: unknown key; did you mean samp"),
        ({"axes": [axis(), axis()]}, "impactor.velocity has two axes"),
        ({"axes": []}, "none given"),
        ({"axes": [VELOCITY]}, "impactor.velocity: has no count"),
        ({"axes": [axis(low=4.0, high=2.0)]}, "from = 4 is not below to = 2"),
        ({"axes": [{**axis(low=-1.0), "spacing": "log"}]}, "must start above 0"),
        ({"axes": [axis(count=1)]}, "must be at least 2, the ends of the range"),
        ({"axes": [{"key": "impactor.mass", "values": [3, 3]}]}, "contains 3 twice"),
        ({"axes": [{**MASS, "count": 3}]}, "has both values and a range"),
        ({"axes": [{**axis(), "spacing": "even"}]}, "axes[0].spacing = 'even': must be"),
        ({"axes": [axis(count=4000), axis("impactor.mass", 1, 9, 4000)]}, "at most 10,000,000"),
        ({"axes": [axis(count=10**8)]}, "axes[0].count = 100000000"),
        ({"repeats": {"count": 3, "within": 0.0}}, "repeats.within = 0.0"),
        ({"repeats": {"count": 3, "vary": "seed"}}, "strength has no scatter"),
        ({"keep": {"measures": ["max_strain", "depth"]}}, "'depth' is none; take keys of summary"),
        ({"keep": {"full": [5]}}, "there is no member 5; members are numbered 0 to 4"),
        ({"sample": {"method": "sobol", "count": 8}}, "has a count, but sample.count sets"),
        (
            {"sample": {"method": "sobol", "count": 8}, "axes": [MASS]},
            "no axis has a range to draw from",
        ),
        ({"axes": [axis(count=float("nan"))]}, "axes[0].count = nan"),
        ({"paired": True}, "needs axes that all list equally many values"),
        ({"scene": 3}, "scene"),
    ],
)
def test_what_makes_no_plan_is_refused_by_name(change: dict, says: str) -> None:
    with pytest.raises(UserError) as refused:
        Plan.load({**plan_of(), **change})
    assert says in str(refused.value)


@pytest.mark.parametrize(
    ("axes", "says"),
    [
        ([axis("impactor.velocty")], "impactor.velocty: unknown key; did you mean impactor.vel"),
        ([axis("impactor.velocity", -9.0, 1.0)], "impactor.velocity = -9.0: must be"),
        ([{"key": "impactor.shape", "values": ["wedge", "ball"]}], "member 1 (impactor.shape ="),
        (
            [axis("model.damping", 1, 2)],
            "a range needs numbers, but the value in the scene is 'stiffness'",
        ),
        ([axis("block.rows", 10, 12, 9)], "fewer than 9 of them from 10 to 12"),
    ],
)
def test_values_that_make_no_scene_are_refused(axes: list, says: str) -> None:
    with pytest.raises(UserError) as refused:
        design_of(*axes).check(100)
    assert says in str(refused.value)


def test_a_grid_has_every_combination_once_and_slow_changes_first() -> None:
    shapes = {"key": "impactor.shape", "values": ["wedge", "flat"]}
    found = design_of(axis(count=3), MASS, shapes, repeats={"count": 2})
    members = [found.member(n) for n in range(len(found))]
    assert len(members) == 24
    combinations = {(*m.axes.values(), m.repeat) for m in members}
    assert len(combinations) == 24
    assert {m.axes["impactor.velocity"] for m in members} == {2.0, 3.0, 4.0}
    # what needs other kernels changes once, although it is the last axis; repeats change fastest
    assert [m.scene.impactor.shape for m in members] == ["wedge"] * 12 + ["flat"] * 12
    assert [m.repeat for m in members[:4]] == [0, 1, 0, 1]
    first, second = members[:2]
    assert first.scene.impactor.velocity == pytest.approx(0.995 * 2.0)
    assert second.varied == second.scene.impactor.velocity == pytest.approx(1.005 * 2.0)
    assert list(first.axes) == ["impactor.velocity", "impactor.mass", "impactor.shape"]
    assert len({m.hash for m in members}) == 24


def test_log_ranges_have_equal_ratios_and_whole_numbers_stay_whole() -> None:
    found = design_of({**axis("impactor.mass", 1.0, 16.0, 5), "spacing": "log"})
    masses = [found.axes(n)[0]["impactor.mass"] for n in range(5)]
    assert masses == pytest.approx([1, 2, 4, 8, 16])
    found = design_of(axis("block.rows", 10, 20, 3))
    assert [found.member(n).scene.block.rows for n in range(3)] == [10, 15, 20]


def test_values_of_ranges_and_lists_are_those_that_one_writes() -> None:
    found = design_of(axis("block.width", 0.02, 0.1, 5), axis("impactor.gap", 0.0, 0.3, 4))
    pairs = [tuple(found.axes(n)[0].values()) for n in range(20)]
    assert {width for width, _ in pairs} == {0.02, 0.04, 0.06, 0.08, 0.1}
    assert {gap for _, gap in pairs} == {0.0, 0.1, 0.2, 0.3}
    found = design_of(axis("impactor.x", -0.1, 0.1, 3))
    assert found.axes(1)[0] == {"impactor.x": 0.0}
    found = design_of({**axis("impactor.mass", 0.001, 1000.0, 7), "spacing": "log"})
    masses = [found.axes(n)[0]["impactor.mass"] for n in range(7)]
    assert masses == [0.001, 0.01, 0.1, 1.0, 10.0, 100.0, 1000.0]
    # a script has computed the list
    listed = {"key": "block.width", "values": np.linspace(0.02, 0.1, 5).tolist()}
    assert [design_of(listed).axes(n)[0]["block.width"] for n in range(5)][2] == 0.06
    # a third has no short decimals, and is the nearest double
    assert design_of(axis(low=2.0, high=3.0, count=4)).axes(1)[0] == {"impactor.velocity": 7 / 3}
    assert design_of(repeats={"count": 3}).member(2).varied == 2.01


@pytest.mark.parametrize("scene", ["fall", "gap", "axis"])
def test_repeats_of_a_fall_vary_its_height_so_that_velocities_are_within(scene: str) -> None:
    """v = sqrt(2 g (h - gap)), by hand."""
    given = {"impactor.drop_height": 0.6, "impactor.gap": 0.1 if scene == "gap" else 0.0}
    heights = {"key": "impactor.drop_height", "values": [0.3, 0.6]}
    other = {"key": "impactor.mass", "values": [2.0, 3.0]}
    axes = [heights if scene == "axis" else other]
    found = design_of(*axes, set=given, repeats={"count": 3, "within": 0.01})
    members = [found.member(n) for n in range(len(found))][-3:]
    exact = (2 * 9.80665 * (0.6 - given["impactor.gap"])) ** 0.5
    for member, factor in zip(members, (0.99, 1.0, 1.01), strict=True):
        impactor = member.scene.impactor
        assert impactor.velocity == member.varied == pytest.approx(factor * exact, rel=1e-11)
        assert member.scene.numerics.gravity == 9.80665
        fall = impactor.drop_height - impactor.gap
        assert (2 * 9.80665 * fall) ** 0.5 == pytest.approx(impactor.velocity, rel=1e-9)


@pytest.mark.parametrize("method", ["sobol", "latin-hypercube"])
def test_a_sample_fills_its_space_evenly_and_is_the_same_again(method: str) -> None:
    mass = {"key": "impactor.mass", "from": 1.0, "to": 100.0, "spacing": "log"}
    drawn = {"method": method, "count": 64, "seed": 3}
    found = design_of(VELOCITY, mass, sample=drawn)
    points = np.array([list(found.axes(n)[0].values()) for n in range(64)])
    # each 1/64 of both axes holds a point of its own
    u = (points[:, 0] - 2.0) / 2.0
    w = np.log(points[:, 1]) / np.log(100.0)
    for share in (u, w):
        assert sorted(np.floor(64 * share).astype(int)) == list(range(64))
    again = design_of(VELOCITY, mass, sample=drawn)
    assert again.fingerprint == found.fingerprint
    other = design_of(VELOCITY, mass, sample={**drawn, "seed": 4})
    assert other.fingerprint != found.fingerprint
    assert other.plan.hash != found.plan.hash


def test_seeds_of_repeats_follow_the_scenes_own() -> None:
    scatter = {"foam.strength_scatter": 0.1, "foam.strength_seed": 7}
    found = design_of(set=scatter, repeats={"count": 3, "vary": "seed"})
    assert [found.member(n).scene.foam.strength_seed for n in range(3)] == [7, 8, 9]


def test_a_content_hash_hangs_on_all_but_the_name() -> None:
    one = design_of().member(0)
    renamed = design_of(set={"name": "other"}).member(0)
    assert renamed.scene.name == "other"
    assert one.hash == renamed.hash != design_of(set={"block.rows": 10}).member(0).hash


def test_a_plan_is_a_file_whose_scene_lies_beside_it(tmp_path: Path) -> None:
    (tmp_path / "own.toml").write_text('name = "Own"\n[impactor]\nshape = "flat"\n')
    path = tmp_path / "plan.toml"
    path.write_text(
        'scene = "own.toml"\n[[axes]]\nkey = "impactor.velocity"\nvalues = [1.0, 2.0]\n'
    )
    plan = Plan.load(path)
    assert (plan.name, plan.count, plan.base.impactor.shape) == ("Own", 2, "flat")
    assert Plan.load(Plan.checked(plan.data(), "again")) == plan


@pytest.mark.parametrize(
    ("text", "axis"),
    [
        ("a.b=1:2:3", {"key": "a.b", "from": 1.0, "to": 2.0, "count": 3}),
        ("a.b = 1:2:3:log", {"key": "a.b", "from": 1.0, "to": 2.0, "count": 3, "spacing": "log"}),
        ("a.b=1,2.5", {"key": "a.b", "values": [1, 2.5]}),
        ("a.b=flat,wedge", {"key": "a.b", "values": ["flat", "wedge"]}),
    ],
)
def test_axes_read_from_the_command_line(text: str, axis: dict) -> None:
    assert axis_of(text) == axis


@pytest.mark.parametrize("text", ["a.b", "a.b=", "=1:2:3", "a=1:2", "a=1:2:x", "a=1:2:3:log:4"])
def test_axes_that_do_not_read_so_are_refused(text: str) -> None:
    with pytest.raises(UserError, match=r"must read KEY=|a range reads KEY="):
        axis_of(text)


def test_files_that_a_plans_own_scene_names_lie_beside_the_plan(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "plans").mkdir()
    (tmp_path / "plans" / "test.csv").write_text("strain,stress [kPa]\n0,0\n0.05,100\n0.8,200\n")
    (tmp_path / "plans" / "plan.toml").write_text(
        '[scene.impactor]\nshape = "flat"\n[scene.foam]\ncurve = "test.csv"\n'
        '[[axes]]\nkey = "impactor.velocity"\nvalues = [2.0, 3.0]\n'
    )
    monkeypatch.chdir(tmp_path)
    base = Plan.load("plans/plan.toml").base
    assert base.foam.curve.stress[-1] == 200e3
    (tmp_path / "plans" / "test.csv").unlink()
    with pytest.raises(UserError, match=r"foam.curve: plans/test.csv: cannot be read"):
        Plan.load("plans/plan.toml")


def test_listed_values_can_go_together_instead_of_in_every_combination() -> None:
    heights = {"key": "impactor.drop_height", "values": [0.3, 0.6, 0.9]}
    masses = {"key": "impactor.mass", "values": [3, 6.0, 4.5]}
    design = design_of(masses, heights, paired=True)
    assert [tuple(design.axes(n)[0].values()) for n in range(len(design))] == [
        (3.0, 0.3), (6.0, 0.6), (4.5, 0.9),
    ]  # fmt: skip
    with pytest.raises(UserError, match="equally many"):
        design_of(MASS, heights, paired=True)
