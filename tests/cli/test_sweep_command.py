"""`taichi-foam sweep`: a plan or a scene, how far it is, its table, a figure, one drop again."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pandas as pd
import pytest
from command_line import assert_refused

import taichi_foam as tf
from taichi_foam.sweeps.plan import Plan
from taichi_foam.sweeps.sampling import Design

SMALL = [
    "--set", "block.columns=10", "--set", "block.rows=5", "--set", "numerics.end=1e-3",
]  # fmt: skip
VARIED = ["paper/wedge-2.86", "--vary", "impactor.velocity=2:4:3", *SMALL]


def test_a_scene_swept_shown_and_one_drop_computed_again(invoke: Callable, tmp_path: Path) -> None:
    done = invoke("sweep", *VARIED, "--repeat", "2", "--out", "s")
    assert done.exit_code == 0, done.stderr
    assert done.stdout.splitlines()[0] == "6 of 6 drops"
    table = pd.read_parquet("s/results.parquet")
    assert table["varied"].tolist() == pytest.approx([1.99, 2.01, 2.985, 3.015, 3.98, 4.02])

    status = invoke("sweep", "status", "s")
    assert status.stdout == "6 of 6 drops; not being computed\n"
    Path("s/results.csv").unlink()
    assert invoke("sweep", "collect", "s").exit_code == 0
    assert len(pd.read_csv("s/results.csv")) == 6
    assert invoke("sweep", "show", "s", "steps").exit_code == 0
    assert Path("s/steps.png").read_bytes().startswith(b"\x89PNG")
    # what is there stays, and a picture of another kind has another name
    before = Path("s/steps.png").read_bytes()
    assert_refused(invoke("sweep", "show", "s", "steps"), "steps.png: already exists", "--overw")
    other = invoke("sweep", "show", "s", "steps", "--x", "impactor.velocity")
    assert other.stdout == "s/steps-over-impactor.velocity.png\n"
    assert Path("s/steps.png").read_bytes() == before
    assert invoke("sweep", "show", "s", "steps", "--overwrite").exit_code == 0
    again = invoke("sweep", "again", "s", "4")
    assert again.exit_code == 0, again.stderr
    assert tf.load("s-4").summary["energy_residual"] == table["energy_residual"][4]

    # the same command again computes nothing; another one is refused, naming what differs
    assert invoke("sweep", "run", *VARIED, "--repeat", "2", "--out", "s").exit_code == 0
    other = invoke("sweep", *VARIED, "--repeat", "3", "--out", "s")
    assert_refused(other, "holds a sweep of another plan", "repeats.count: was 2, is 3")


def test_a_dry_run_writes_nothing(invoke: Callable, tmp_path: Path) -> None:
    told = invoke("sweep", *VARIED, "--dry-run")
    assert told.exit_code == 0, told.stderr
    lines = [line.split(maxsplit=1) for line in told.stdout.splitlines()]
    assert [name for name, _ in lines] == ["drops", "time", "disk"]
    assert lines[0][1].strip() == "3"
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["paper/wedge-2.86"], ["no such file", "--vary"]),
        (["nowhere", "--vary", "impactor.velocity=2:4:3"], ["no built-in scene"]),
        (["paper/wedge-2.86", "--vary", "impactor.velocity=2:4"], ["a range reads KEY=FROM"]),
        (["paper/wedge-2.86", "--vary", "impactor.velocty=2:4:3"], ["did you mean impactor.vel"]),
        (["paper/wedge-2.86", "--vary", "impactor.mass=-1,2"], ["impactor.mass = -1"]),
        (
            [*VARIED, "--workers", "2", "--scheduler", "tcp://x"],
            ["workers, scheduler: give only one"],
        ),
        ([*VARIED, "--workers", "0"], ["workers = 0: choose 1 to 1000"]),
        (["plan.toml", "--vary", "impactor.velocity=2:4:3"], ["is a plan"]),
        (["plan.toml", "--set", "block.rows=10"], ["--set: only applies with --vary"]),
        (["scene.toml"], ["is not a plan, as it has no axes"]),
        (["status", "nowhere"], ["nowhere: is not the folder of a sweep"]),
        (["again", "nowhere", "3"], ["nowhere: is not the folder of a sweep"]),
    ],
)
def test_what_cannot_be_swept_is_refused_and_leaves_nothing(
    invoke: Callable, tmp_path: Path, arguments: list[str], says: list[str]
) -> None:
    (tmp_path / "plan.toml").write_text(
        'scene = "paper/wedge-2.86"\n[[axes]]\nkey = "impactor.mass"\nvalues = [1.0, 2.0]\n'
    )
    (tmp_path / "scene.toml").write_text('[impactor]\nshape = "flat"\n')
    assert_refused(invoke("sweep", *arguments), *says)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["plan.toml", "scene.toml"]


def test_a_folder_that_is_not_a_sweeps_stays(invoke: Callable, tmp_path: Path) -> None:
    (tmp_path / "thesis.tex").write_text("mine")
    assert_refused(invoke("sweep", *VARIED, "--out", "."), "not empty and does not hold a sweep")
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.tex"]


def test_the_example_plans_are_plans() -> None:
    plans = sorted((Path(tf.__file__).parents[1] / "scenes" / "plans").glob("*.toml"))
    assert plans
    for path in plans:
        plan = Plan.load(path)
        assert json.loads(json.dumps(plan.data())) == plan.data()
        Design(plan).check(20)
