"""Provenance of a result: software, machine, date, command and scene."""

from __future__ import annotations

import hashlib
import json
import os
import platform
import shlex
import sys
from datetime import datetime, timezone
from functools import cache
from importlib import metadata
from pathlib import Path

import numpy as np

from taichi_foam import backend
from taichi_foam.scene import Scene
from taichi_foam.version import version

_LONGEST_COMMAND = 2_000

_LIBRARIES = ("taichi", "numpy", "scipy", "matplotlib", "imageio-ffmpeg", "pillow", "pydantic")


def provenance(scene: Scene) -> dict[str, str]:
    """Provenance of a run that ends now, for `run` in summary.json.

    taichi_foam   version; for a development version with its commit
    taichi, numpy, python
    machine, processor
    date          UTC, ISO 8601
    command       command line of the process, quoted for a shell
    scene_sha256  see `content_hash`
    """
    return {
        "taichi_foam": version(),
        "taichi": backend.version(),
        "numpy": np.__version__,
        "python": platform.python_version(),
        "machine": platform.platform(),
        "processor": processor(),
        "date": datetime.now(timezone.utc).isoformat(timespec="seconds"),
        "command": shlex.join(sys.orig_argv)[:_LONGEST_COMMAND],
        "scene_sha256": content_hash(scene),
    }


def content_hash(scene: Scene) -> str:
    """SHA-256 of a scene's values, with every default filled in: equal scenes have equal hashes.

    Measured values (the scene's reference) are left out.
    """
    data = scene.model_dump(mode="json", exclude={"reference"})
    text = json.dumps(data, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()


@cache
def processor() -> str:
    """The processor's name; Python itself knows it only on some systems."""
    try:
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    except OSError:
        pass
    return platform.processor() or platform.machine()


def machine() -> dict[str, str | int]:
    """Processor, cores and system, in words."""
    return {
        "processor": processor(),
        "cores": os.cpu_count() or 1,
        "system": f"{platform.system()} {platform.machine()}",
    }


def versions() -> dict[str, str]:
    """Versions of this package, Python and the libraries it depends on."""
    found = {"taichi_foam": version(), "python": platform.python_version()}
    for name in _LIBRARIES:
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            continue
    return found
