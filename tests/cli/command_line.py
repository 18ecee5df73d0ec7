"""The command line in a process of its own, and what it leaves on disk."""

from __future__ import annotations

import errno
import os
import subprocess
import sys
from pathlib import Path

from processes import ENVIRONMENT

Tree = dict[str, bytes | None]

#: A lattice and pictures so small that a run takes a second.
COARSE = (
    "block.columns=20",
    "block.rows=10",
    "output.width=320",
    "output.height=180",
)
COARSE_OPTIONS = [word for setting in COARSE for word in ("--set", setting)]


def call(*arguments: str, cwd: Path | None = None) -> subprocess.CompletedProcess[str]:
    """Run `python` with these arguments to its end."""
    return subprocess.run(
        [sys.executable, *arguments],
        cwd=cwd,
        env=ENVIRONMENT,
        capture_output=True,
        text=True,
        timeout=240,
        check=False,
    )


def fill_disk(path: Path) -> None:
    """Write half of a file, then find the disk full."""
    path.write_bytes(b"half")
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(path))


def tree(folder: Path) -> Tree:
    """Every path below a folder with its content, None for a folder."""
    return {
        str(path.relative_to(folder)): path.read_bytes() if path.is_file() else None
        for path in sorted(folder.rglob("*"))
    }


def assert_refused(result, *fragments: str) -> None:
    """The request was refused with exit code 2 and these words, and nothing on stdout."""
    assert result.exit_code == 2, result.output
    assert result.stdout == ""
    assert "Traceback" not in result.stderr
    for fragment in fragments:
        assert fragment in result.stderr
