"""The command line in a process of its own, and what it leaves on disk."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

Tree = dict[str, bytes | None]

#: A lattice and pictures so small that a run takes a second.
COARSE = (
    "block.columns=20",
    "block.rows=10",
    "output.width=320",
    "output.height=180",
)
COARSE_OPTIONS = [word for setting in COARSE for word in ("--set", setting)]


def call(*arguments: str, cwd: Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "taichi_foam", *arguments]
    return subprocess.run(
        command, cwd=cwd, capture_output=True, text=True, timeout=240, check=False
    )


def tree(folder: Path) -> Tree:
    """Every path below a folder with its content, None for a folder."""
    return {
        str(path.relative_to(folder)): path.read_bytes() if path.is_file() else None
        for path in sorted(folder.rglob("*"))
    }
