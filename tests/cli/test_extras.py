"""Packages that only the live window, the live page and sweeps need may be absent."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from command_line import call, tree

from taichi_foam import live

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


@pytest.fixture
def take_away(monkeypatch: pytest.MonkeyPatch) -> Callable:
    """As if packages were not installed, and nothing of the page had been loaded with them."""
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")  # a display is not what is missing

    def take(*absent: str) -> None:
        for name in list(sys.modules):
            if name.startswith((*(f"{each}." for each in absent), "taichi_foam.live.page")):
                monkeypatch.delitem(sys.modules, name)
        if hasattr(live, "page"):
            monkeypatch.delattr(live, "page")
        for name in absent:
            monkeypatch.setitem(sys.modules, name, None)

    return take


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
    invoke: Callable,
    take_away: Callable,
    absent: list[str],
    arguments: list[str],
    says: str,
    extra: str,
    tmp_path: Path,
) -> None:
    take_away(*absent)
    done = invoke(*arguments)
    assert done.exit_code == 2
    assert done.stdout == ""
    (line,) = done.stderr.splitlines()
    assert says in line
    assert line.endswith(f"Fix: python -m pip install 'taichi-foam[{extra}]'")
    assert tree(tmp_path) == {}


def test_all_else_works_without_them(tmp_path: Path) -> None:
    """All commands that compute nothing, and the modules of those that compute and draw."""
    modules = "shim2000.reproduce", "live.notebook", "live.watch", "sweeps.compute", "sweeps.run"
    absent = f"import sys\nfor name in {LIVE + SWEEP}:\n    sys.modules[name] = None\n"
    loaded = "".join(f"import taichi_foam.{name}\n" for name in modules)
    command = "from taichi_foam.cli import main\nsys.argv = ['taichi-foam', 'scenes']\nmain()"
    done = call("-c", absent + loaded + command, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "paper/wedge-2.86" in done.stdout


def test_a_sweep_in_this_process_needs_none_of_them(
    invoke: Callable, take_away: Callable, tmp_path: Path
) -> None:
    take_away(*SWEEP)
    coarse = ("block.columns=20", "block.rows=10", "numerics.end=1e-3")
    values = [word for each in coarse for word in ("--set", each)]
    done = invoke(*VARIED, *values, "--out", "three")
    assert done.exit_code == 0, done.stderr
    assert len((tmp_path / "three" / "results.csv").read_text().splitlines()) == 1 + 3
