"""What computes: Taichi, or Quadrants in its place, by an environment variable."""

from __future__ import annotations

import importlib.util
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from processes import ENVIRONMENT

import taichi_foam
from taichi_foam.scene import Scene
from taichi_foam.shim2000.impacts import paper_scene

SHORT = {"block.columns": 20, "block.rows": 10, "numerics.end": 1e-3}

ON_QUADRANTS = f"""
import sys
import numpy as np
import taichi_foam as tf
result = tf.run(tf.paper_scene("paper/wedge-2.86").with_values({SHORT}))
assert result.run["taichi"].startswith("quadrants-"), result.run["taichi"]
np.savez(sys.argv[1], **result.history)
"""

COMMAND = """
import sys
sys.modules["quadrants"] = None
from taichi_foam.cli import main
sys.argv = ["taichi-foam", "foam", "list"]
main()
"""


def _process(program: str, backend: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Python with this backend, in a process of its own."""
    return subprocess.run(
        [sys.executable, "-c", program, *arguments],
        env={**ENVIRONMENT, "TAICHI_FOAM_BACKEND": backend}, capture_output=True, text=True,
        timeout=540, check=False,
    )  # fmt: skip


@pytest.mark.parametrize(
    ("backend", "words"),
    [
        ("another", "TAICHI_FOAM_BACKEND = 'another': choose taichi"),
        ("quadrants", "needs quadrants, which is not installed. Fix: python -m pip install"),
    ],
)
def test_a_backend_that_cannot_be_had_is_refused(backend: str, words: str) -> None:
    done = _process(COMMAND, backend)
    assert done.returncode == 2, done.stderr
    assert words in done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.skipif(
    importlib.util.find_spec("quadrants") is None, reason="Quadrants is not installed"
)
@pytest.mark.usefixtures("taichi_runtime")
def test_quadrants_gives_the_numbers_of_taichi(tmp_path: Path) -> None:
    """To nine digits; where this was written, to the last bit."""
    done = _process(ON_QUADRANTS, "quadrants", str(tmp_path / "history.npz"))
    assert done.returncode == 0, done.stderr
    assert done.stdout == ""
    scene: Scene = paper_scene("paper/wedge-2.86").with_values(SHORT)
    history = taichi_foam.run(scene).history
    with np.load(tmp_path / "history.npz") as other:
        assert set(other) == set(history)
        for name, column in history.items():
            size = np.nanmax(np.abs(column))
            np.testing.assert_allclose(
                other[name], column, rtol=0.0, atol=1e-9 * size, err_msg=name
            )
