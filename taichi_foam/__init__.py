"""Impact on crushable foam: a breakable particle lattice on Taichi, after Shim, Tu & Lim (2000).

    import taichi_foam as tf
    result = tf.run(tf.paper_scene("paper/wedge-2.86"))
    print(result.summary)
    result.save("runs/wedge")

Taichi, SciPy and Matplotlib load when something first needs them, not on import.
"""

from __future__ import annotations

import os
import sys
from importlib import import_module
from typing import TYPE_CHECKING, Any

from taichi_foam.version import __version__

if TYPE_CHECKING:
    from taichi_foam.analysis.measures import summary
    from taichi_foam.calibration.calibrate import calibrate
    from taichi_foam.catalogue import load_scene
    from taichi_foam.cushions.cushion import cushion_curve
    from taichi_foam.cushions.design import design
    from taichi_foam.cushions.efficiency import efficiency
    from taichi_foam.errors import Interrupted, RunError, RunWarning, UserError
    from taichi_foam.live.watch import watch
    from taichi_foam.records.ending import Ending
    from taichi_foam.records.history import History
    from taichi_foam.records.snapshot import Snapshot
    from taichi_foam.results.result import Result, load
    from taichi_foam.scene import Scene
    from taichi_foam.shim2000.impacts import paper_scene
    from taichi_foam.shim2000.reproduce import reproduce
    from taichi_foam.simulation.simulate import (
        init,
        resume,
        run,
        run_drops,
        run_many,
        simulate,
        simulate_many,
    )
    from taichi_foam.sweeps.run import sweep

# Taichi prints a banner when it is first imported, and another line in a notebook.
os.environ.setdefault("ENABLE_TAICHI_HEADER_PRINT", "0")
os.environ.setdefault("TI_LOG_LEVEL", "error")

__all__ = [
    "Ending",
    "History",
    "Interrupted",
    "Result",
    "RunError",
    "RunWarning",
    "Scene",
    "Snapshot",
    "UserError",
    "__version__",
    "calibrate",
    "cushion_curve",
    "design",
    "efficiency",
    "init",
    "load",
    "load_scene",
    "paper_scene",
    "reproduce",
    "resume",
    "run",
    "run_drops",
    "run_many",
    "simulate",
    "simulate_many",
    "summary",
    "sweep",
    "watch",
]

_HOMES = {
    "Ending": "records.ending",
    "History": "records.history",
    "Interrupted": "errors",
    "Result": "results.result",
    "RunError": "errors",
    "RunWarning": "errors",
    "Scene": "scene",
    "Snapshot": "records.snapshot",
    "UserError": "errors",
    "calibrate": "calibration.calibrate",
    "cushion_curve": "cushions.cushion",
    "design": "cushions.design",
    "efficiency": "cushions.efficiency",
    "init": "simulation.simulate",
    "load": "results.result",
    "load_scene": "catalogue",
    "paper_scene": "shim2000.impacts",
    "reproduce": "shim2000.reproduce",
    "resume": "simulation.simulate",
    "run": "simulation.simulate",
    "run_drops": "simulation.simulate",
    "run_many": "simulation.simulate",
    "simulate": "simulation.simulate",
    "simulate_many": "simulation.simulate",
    "summary": "analysis.measures",
    "sweep": "sweeps.run",
    "watch": "live.watch",
}


def __getattr__(name: str) -> Any:
    """Load a public name from its module on first use (PEP 562)."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)


if "IPython" in sys.modules:  # rich display of scenes and results in a notebook
    import_module("taichi_foam.live.notebook").install()
