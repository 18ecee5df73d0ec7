"""What computed a study: the processor, and the versions of everything that takes part."""

from __future__ import annotations

import os
import platform
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

_LIBRARIES = ("taichi", "numpy", "scipy", "matplotlib", "imageio-ffmpeg", "pillow", "pydantic")


def machine() -> dict[str, str | int]:
    """Processor, cores and system, in words."""
    return {
        "processor": _processor(),
        "cores": os.cpu_count() or 1,
        "system": f"{platform.system()} {platform.machine()}",
    }


def versions() -> dict[str, str]:
    """Versions of this package, Python and the libraries it stands on."""
    from taichi_foam.version import __version__

    found = {"taichi_foam": __version__, "python": platform.python_version()}
    for name in _LIBRARIES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            continue
    return found


def _processor() -> str:
    """The processor's name; Python itself knows it on some systems only."""
    try:
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    except OSError:
        pass
    return platform.processor() or platform.machine()
