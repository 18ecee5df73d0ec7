"""`taichi-foam efficiency`: what it prints, writes and refuses."""

import csv
from collections.abc import Callable
from pathlib import Path

import pytest
from command_line import assert_refused, tree

import taichi_foam as tf


def test_the_curves_read_back_from_csv_exactly(invoke: Callable, tmp_path: Path) -> None:
    done = invoke("efficiency", "eps-20", "shim2000-pu", "--out", "found", "--units", "us")
    assert done.exit_code == 0, done.output
    names = {path.name for path in (tmp_path / "found").iterdir()} - {"manifest.json"}
    figures = {f"efficiency.{ending}" for ending in ("png", "svg", "pdf", "csv")}
    assert names == figures | {"landmarks.csv", "report.html"}
    found = tf.efficiency("eps-20", "shim2000-pu")
    with (tmp_path / "found" / "efficiency.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    mine = [float(row["energy_J_m3"]) for row in rows if row["foam"] == "eps-20"]
    assert mine == found.foams[0].energy.tolist()
    with (tmp_path / "found" / "landmarks.csv").open(newline="") as file:
        assert [float(row["efficiency"]) for row in csv.DictReader(file)] == [
            row["efficiency"] for row in found.table
        ]
    page = (tmp_path / "found" / "report.html").read_text(encoding="utf-8")
    assert "in·lb/in³" in page
    assert "assumed beyond 10 %" in page
    words = " ".join(done.stdout.split())
    stress = found.table[0]["stress_Pa"] / 6894.757293168361
    assert f" {stress:.3g} " in words
    assert "least stress" in words
    assert "note: eps-20: the curve is assumed" in done.stderr


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["eps-60"], ["foam 'eps-60': ", "from 14.4 to 38.4 kg/m3 only"]),
        (["eps20"], ["did you mean eps-14.4 to eps-38.4?"]),
        (["percent.csv"], ["80: must be below 1", "a first line such as strain [%]"]),
        (["words.csv"], ["words.csv, line 4: 'much' in column 2: must be a number"]),
        (["none.csv"], ["none.csv: cannot be read"]),
        (["eps-20", "eps-20"], ["foam 'eps-20': given 2 times"]),
        (["eps-20", "--units", "metric"], ["units = 'metric': must be si or us"]),
        (["eps-20", "--out", "words.csv"], ["is a file", "choose another folder"]),
    ],
)
def test_bad_input_is_refused_with_a_remedy(
    words: list[str], told: list[str], invoke: Callable, tmp_path: Path
) -> None:
    (tmp_path / "percent.csv").write_text("0,0\n5,100000\n80,200000\n")
    (tmp_path / "words.csv").write_text("strain [%],stress [kPa]\n0,0\n5,100\n60,much\n")
    before = tree(tmp_path)
    assert_refused(invoke("efficiency", *words), *told)
    assert tree(tmp_path) == before
