"""Every script of validation/ in its short form: a change of choices or fields breaks one here.

What designs.py computes is in tests/cushions/test_design.py.
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from types import ModuleType

import calibration
import cells
import fidelity
import model_tables
import odd_scenes
import pytest
import step_size
import verify

VALIDATION = Path(verify.__file__).parent


SCRIPTS = [calibration, cells, fidelity, step_size, model_tables, odd_scenes, verify]


@pytest.mark.parametrize("script", SCRIPTS)
def test_the_short_form_works_and_leaves_nothing(script: ModuleType) -> None:
    before = {path: path.stat().st_mtime_ns for path in VALIDATION.rglob("*.[mj][ds]*")}
    script.smoke()
    assert before == {path: path.stat().st_mtime_ns for path in VALIDATION.rglob("*.[mj][ds]*")}


def test_scripts_find_their_modules_from_any_folder(tmp_path: Path) -> None:
    """Without computing anything: the page of nothing, in a folder of its own."""
    command = [sys.executable, str(VALIDATION / "verify.py"), "--no-compute"]
    command += ["--out", str(tmp_path / "page.md"), "--figures", str(tmp_path)]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "page.md").read_text().startswith("# The lattice against theory")
