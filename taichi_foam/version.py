"""The version of this package, and the commit of a development version."""

from __future__ import annotations

from functools import cache
from pathlib import Path

__version__ = "0.2.0.dev0"


@cache
def version() -> str:
    """The version; for a development version with its commit, as 0.2.0.dev0+g1a2b3c4d5.

    The commit is known for a checkout, and for a package that pip installed from a repository. A
    checkout with uncommitted changes is marked: 0.2.0.dev0+g1a2b3c4d5.changed.
    """
    if "dev" not in __version__:
        return __version__
    commit = _of_checkout(Path(__file__).parents[1]) or _of_installation()
    return f"{__version__}+g{commit}" if commit else __version__


def _of_checkout(root: Path) -> str | None:
    """The commit of the checkout that contains the package, if there is one."""
    import subprocess  # here, since it takes longer to load than the rest of the package

    if not (root / ".git").exists():
        return None
    describe = ["git", "-C", str(root), "describe", "--always", "--abbrev=9", "--exclude=*"]
    try:
        told = subprocess.run(
            [*describe, "--dirty=.changed"], capture_output=True, text=True, timeout=5, check=True
        )
    except (OSError, subprocess.SubprocessError):
        return None
    return told.stdout.strip() or None


def _of_installation() -> str | None:
    """The commit that pip installed from a repository."""
    import json
    from importlib import metadata

    try:
        told = metadata.distribution("taichi-foam").read_text("direct_url.json")
        return str(json.loads(told or "{}")["vcs_info"]["commit_id"])[:9]
    except (metadata.PackageNotFoundError, OSError, ValueError, KeyError, TypeError):
        return None
