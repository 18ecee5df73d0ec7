"""Packages that only the live window, the live page and sweeps need may be absent."""

from __future__ import annotations

from pathlib import Path

import pytest
from command_line import call, tree

#: The command line where these packages are not installed.
PROGRAM = """
import os, sys
os.environ["SDL_VIDEODRIVER"] = "dummy"  # a display is not what is missing
for name in {absent}:
    sys.modules[name] = None
from taichi_foam.cli import main
sys.argv = ["taichi-foam", *{arguments}]
main()
"""

LIVE = ("pygame", "starlette", "uvicorn", "websockets", "plotly")
SWEEP = ("dask", "distributed", "cryptography")
VARIED = ["sweep", "paper/wedge-2.86", "--vary", "impactor.velocity=2:4:3"]
CALIBRATED = [
    "calibrate",
    "trace.csv",
    "paper/wedge-2.86",
    "--fit",
    "foam.yield_strain=-0.06..-0.03",
]
ELSEWHERE = "a sweep in other processes: needs "


@pytest.mark.parametrize(
    ("absent", "arguments", "says", "extra"),
    [
        (LIVE, ["serve", "paper/wedge-2.86", "--no-open"], "a live page: needs ", "live"),
        (["plotly"], ["serve", "paper/wedge-2.86", "--no-open"], "page: needs plotly", "live"),
        (LIVE, ["run", "paper/wedge-2.86", "--live"], "a live window: needs pygame", "live"),
        (SWEEP, [*VARIED, "--workers", "2"], ELSEWHERE, "sweep"),
        (["distributed"], [*VARIED, "--scheduler", "x"], f"{ELSEWHERE}distributed", "sweep"),
        (["sklearn"], CALIBRATED, "calibrating: needs sklearn", "calibrate"),
        (["emcee"], CALIBRATED, "calibrating: needs emcee", "calibrate"),
    ],
)
def test_one_line_says_what_to_install(
    absent: list[str], arguments: list[str], says: str, extra: str, tmp_path: Path
) -> None:
    done = call("-c", PROGRAM.format(absent=list(absent), arguments=arguments), cwd=tmp_path)
    assert done.returncode == 2
    assert done.stdout == ""
    (line,) = done.stderr.splitlines()
    assert says in line
    assert line.endswith(f"Fix: python -m pip install 'taichi-foam[{extra}]'")
    assert tree(tmp_path) == {}


def test_all_else_works_without_them(tmp_path: Path) -> None:
    """All commands that compute nothing, and the modules of those that compute and draw."""
    modules = "taichi_foam.shim2000.reproduce, taichi_foam.live.notebook, taichi_foam.live.watch"
    program = f"import {modules}\n" + PROGRAM.format(absent=[], arguments=["scenes"])
    absent = f"import sys\nfor name in {LIVE + SWEEP}:\n    sys.modules[name] = None\n"
    done = call("-c", absent + program, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "paper/wedge-2.86" in done.stdout


def test_a_sweep_in_this_process_needs_none_of_them(tmp_path: Path) -> None:
    coarse = ("block.columns=20", "block.rows=10", "numerics.end=1e-3")
    values = [word for each in coarse for word in ("--set", each)]
    arguments = [*VARIED, *values, "--out", "three"]
    done = call("-c", PROGRAM.format(absent=list(SWEEP), arguments=arguments), cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert len((tmp_path / "three" / "results.csv").read_text().splitlines()) == 1 + 3
