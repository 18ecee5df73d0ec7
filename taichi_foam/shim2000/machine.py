"""What computed a study: the processor, and the versions of everything that takes part."""

from __future__ import annotations

import os
import platform
from importlib import metadata

from taichi_foam.simulation.provenance import processor
from taichi_foam.version import version

_LIBRARIES = ("taichi", "numpy", "scipy", "matplotlib", "imageio-ffmpeg", "pillow", "pydantic")


def machine() -> dict[str, str | int]:
    """Processor, cores and system, in words."""
    return {
        "processor": processor(),
        "cores": os.cpu_count() or 1,
        "system": f"{platform.system()} {platform.machine()}",
    }


def versions() -> dict[str, str]:
    """Versions of this package, Python and the libraries it stands on."""
    found = {"taichi_foam": version(), "python": platform.python_version()}
    for name in _LIBRARIES:
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            continue
    return found
