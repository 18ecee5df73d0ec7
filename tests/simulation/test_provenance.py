"""What a result says of where it comes from."""

from __future__ import annotations

import re
import subprocess
import sys
from datetime import datetime, timedelta, timezone
from pathlib import Path

import pytest

from taichi_foam import load_scene
from taichi_foam import version as package
from taichi_foam.scene.files import scene_from_text, scene_to_toml
from taichi_foam.simulation.provenance import content_hash, machine, processor, provenance, versions

WEDGE = load_scene("paper/wedge-2.86")


def test_the_stamp() -> None:
    stamp = provenance(WEDGE)
    age = datetime.now(timezone.utc) - datetime.fromisoformat(stamp["date"])
    assert timedelta(seconds=-2) < age < timedelta(minutes=1)
    assert stamp["taichi_foam"] == package.version() == versions()["taichi_foam"]
    assert stamp["processor"] == processor() == machine()["processor"]
    assert "pytest" in stamp["command"] or Path(sys.executable).name in stamp["command"]


def test_equal_scenes_have_equal_hashes() -> None:
    hashed = content_hash(WEDGE)
    assert re.fullmatch("[0-9a-f]{64}", hashed)
    assert content_hash(scene_from_text(scene_to_toml(WEDGE), "text")) == hashed
    assert content_hash(WEDGE.with_values(impactor__velocity=2.87)) != hashed
    assert content_hash(WEDGE.with_values(name="another")) != hashed


def git(folder: Path, *words: str) -> str:
    names = ["-c", "user.name=a", "-c", "user.email=a@b.c"]
    done = subprocess.run(
        ["git", *names, "-C", str(folder), *words], capture_output=True, text=True, check=True
    )
    return done.stdout.strip()


@pytest.fixture
def checkout(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A repository whose one commit holds the package's module of the version."""
    try:
        git(tmp_path, "init", "-q")
    except FileNotFoundError:
        pytest.skip("needs git")
    file = tmp_path / "taichi_foam" / "version.py"
    file.parent.mkdir()
    file.write_text("1")
    git(tmp_path, "add", ".")
    git(tmp_path, "commit", "-qm", "one")
    git(tmp_path, "tag", "v9")
    monkeypatch.setattr(package, "__file__", str(file))
    monkeypatch.setattr(package, "__version__", "0.9.0.dev0")
    return tmp_path


def test_a_development_version_names_its_commit(
    checkout: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    version = package.version.__wrapped__  # not remembered
    commit = git(checkout, "rev-parse", "--short=9", "HEAD")
    assert version() == f"0.9.0.dev0+g{commit}"
    (checkout / "taichi_foam" / "version.py").write_text("2")
    assert version() == f"0.9.0.dev0+g{commit}.changed"
    monkeypatch.setattr(package, "__version__", "0.9.0")
    assert version() == "0.9.0"


def test_a_development_version_without_git(checkout: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", str(checkout))
    assert package.version.__wrapped__().startswith("0.9.0.dev0")
