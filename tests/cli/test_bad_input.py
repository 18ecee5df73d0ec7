"""Every bad request gets a clear line and exit code 2, and nothing is written or lost."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import pytest
from command_line import COARSE_OPTIONS, assert_refused, call, fill_disk, tree

from taichi_foam.results import result as result_module
from taichi_foam.results.folders import output_folder
from taichi_foam.simulation import batches

WEDGE = "paper/wedge-2.86"

# Others have their messages in tests/scene/test_bad_scenes.py.
BAD_VALUES = {
    "yield sign": ("foam.yield_strain=0.05", "negative in compression"),
    "no value": ("block.rows", "KEY=VALUE"),
}


@pytest.fixture
def ask(invoke: Callable, monkeypatch: pytest.MonkeyPatch) -> Callable:
    """Call the command line; any computing fails the test."""

    def refuse(*arguments: object, **options: object) -> None:
        raise AssertionError("the request should have been refused before computing")

    monkeypatch.setattr(batches, "advance_all", refuse)
    return invoke


def assert_error(result, fragment: str) -> None:
    assert_refused(result, fragment)
    assert result.stderr.startswith("error: ")


@pytest.mark.parametrize("case", BAD_VALUES)
def test_bad_value(case: str, ask: Callable, tmp_path: Path) -> None:
    assignment, fragment = BAD_VALUES[case]
    assert_error(ask("run", WEDGE, "--set", assignment), fragment)
    assert tree(tmp_path) == {}


def test_a_platen_wider_than_the_block_is_no_mistake(ask: Callable) -> None:
    """It gets as far as computing."""
    result = ask("run", "paper/rectangular-3.03", "--set", "impactor.width=0.3")
    assert isinstance(result.exception, AssertionError)


@pytest.mark.parametrize(
    ("arguments", "fragment"),
    [
        (["run", "nowhere.toml"], "no such file"),
        (["run", "paper/wedge-2.68"], "did you mean paper/wedge-2.86?"),
        (["run", WEDGE, "--dt", "soon"], "must be 'auto' or above 0"),
        (["run", WEDGE, "--dt", "1"], "numerics.dt = 1"),
        (["run", WEDGE, "--choices", "literal"], "calibrated, paper-literal"),
        (["run", WEDGE, "--arch", "abacus"], "cpu, cuda, vulkan, metal"),
        (["run", WEDGE, "--threads", "0"], "threads = 0"),
        (["run", WEDGE, "--out", ""], "not a path"),
        (["reproduce", "--cases", "wedge-2.68"], "did you mean wedge-2.86?"),
        (["reproduce", "--cases", ","], "none given"),
        (["reproduce", "--choices", "literal"], "calibrated, paper-literal"),
        (["reproduce", "--ensemble", "1"], "ensemble = 1: must be at least 2 and at most 100"),
        (["reproduce", "--ensemble", "0"], "leave the option out for single runs"),
        (["reproduce", "--ensemble", "9" * 30], "at most 100 runs of each test"),
    ],
)
def test_bad_argument(arguments: list[str], fragment: str, ask: Callable, tmp_path: Path) -> None:
    assert_error(ask(*arguments), fragment)
    assert tree(tmp_path) == {}


def test_a_mass_in_grams_is_asked_about_before_the_run(ask: Callable, tmp_path: Path) -> None:
    """No gravity, so that it can be meant: a note, and then the run (here: the claimed folder)."""
    (tmp_path / "taken").mkdir()
    (tmp_path / "taken" / "mine.txt").write_text("mine")
    cushion = ["--set", "impactor.width=0.3", "--set", "impactor.mass=5000"]
    result = ask("run", "paper/rectangular-3.03", *cushion, "--out", str(tmp_path / "taken"))
    assert (
        "note: by energy balance, 5000 kg at 3.03 m/s is more than this foam can absorb"
        in result.stderr
    )
    assert "masses are in kilograms" in result.stderr


def test_malformed_toml(ask: Callable, tmp_path: Path) -> None:
    (tmp_path / "scene.toml").write_text("[block\nwidth = 0.2\n")
    before = tree(tmp_path)
    assert_error(ask("run", "scene.toml"), "scene.toml: not valid TOML")
    assert tree(tmp_path) == before


OUTPUT_FOLDERS = {
    "below a file": (["--out", "note/result"], "is a file, not a folder"),
    "a file": (["--out", "note", "--overwrite"], "note: is a file"),
    "other content": (["--out", "kept"], "holds no result that could be replaced, only note"),
    "other content, still": (
        ["--out", "kept", "--overwrite"],
        "holds no result that could be replaced, only note",
    ),
    "a result": (["--out", "old"], "pass --overwrite to replace the result"),
    "the current folder": (["--out", ".", "--overwrite"], "holds no result"),
}


@pytest.mark.parametrize("command", [["run", WEDGE], ["reproduce", "--cases", "wedge-2.86"]])
class TestOutputFolder:
    @pytest.mark.parametrize("case", OUTPUT_FOLDERS)
    def test_is_taken(self, case: str, command: list[str], ask: Callable, tmp_path: Path) -> None:
        options, fragment = OUTPUT_FOLDERS[case]
        (tmp_path / "kept").mkdir()
        for note in ("note", "kept/note"):
            (tmp_path / note).write_text("mine")
        with output_folder(tmp_path / "old") as staging:
            (staging / "summary.json").write_text("{}")
        before = tree(tmp_path)
        result = ask(*command, *options)
        assert_error(result, fragment)
        assert "overwrite=True" not in result.stderr
        assert tree(tmp_path) == before

    def test_has_too_little_room(
        self,
        command: list[str],
        ask: Callable,
        tmp_path: Path,
        monkeypatch: pytest.MonkeyPatch,
    ) -> None:
        usage = type("usage", (), {"free": 1_000_000})
        monkeypatch.setattr("taichi_foam.results.folders.shutil.disk_usage", lambda path: usage)
        assert_error(ask(*command), "1 MB free")
        assert tree(tmp_path) == {}


def test_disk_that_fills_up_at_the_end(
    invoke: Callable, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The old result is kept; the same command has only to write the new one."""
    with output_folder(tmp_path / "old") as staging:
        (staging / "notes.txt").write_text("older")
    before = tree(tmp_path)

    command = ["run", WEDGE, *COARSE_OPTIONS, "--set", "numerics.end=1e-3", "--no-film"]
    with monkeypatch.context() as patched:
        full = result_module.RunFile(lambda result, path: fill_disk(path))
        patched.setitem(result_module.OUTPUTS, "snapshots.npz", full)
        result = invoke(*command, "--out", "old", "--overwrite")
    assert result.exit_code == 2
    assert "the disk is full" in result.stderr
    assert tree(tmp_path).items() >= before.items()
    assert set(os.listdir(tmp_path / "old")) == {"notes.txt", "manifest.json", "unfinished"}
    result = invoke(*command, "--out", "old")
    assert result.exit_code == 0, result.output
    assert "(0 steps" in result.stderr
    assert "history.csv" in os.listdir(tmp_path / "old")
    assert not {"notes.txt", "unfinished"} & set(os.listdir(tmp_path / "old"))


def test_absent_gpu(tmp_path: Path) -> None:
    from taichi._lib import core

    absent = [arch for arch in ("cuda", "metal") if not getattr(core, f"with_{arch}")()]
    done = call("-m", "taichi_foam", "run", WEDGE, "--arch", absent[0], cwd=tmp_path)
    assert done.returncode == 2
    assert f"this machine offers no {absent[0]} device" in done.stderr
    assert "use --arch cpu, or install" in done.stderr
    assert "Traceback" not in done.stderr
    assert tree(tmp_path) == {}
