"""The command line: `taichi-foam run`, `serve`, `reproduce` ..., and `python scenes/wedge.py`.

Exit codes: 0 done; 1 a run failed (what was computed is saved); 2 the request cannot be met
(nothing was computed or written); 130 Ctrl-C (what there is has been saved).
"""

from __future__ import annotations

import sys
from importlib import import_module
from typing import TYPE_CHECKING, Any

from taichi_foam.cli import streams

if TYPE_CHECKING:
    from taichi_foam.scene import Scene

__all__ = ["main", "run_script"]


def main() -> None:
    """Entry point of `taichi-foam`."""
    with streams.robust():
        _app().main()


def run_script(scene: Scene) -> None:
    """Run a script's own scene, with the options of `taichi-foam run` from the command line.

    Ends the process as that command does.
    """
    with streams.robust():
        _app().run_script(scene)


def _app() -> Any:
    """The commands; Ctrl-C while they are loaded is no traceback either."""
    try:
        return import_module("taichi_foam.cli.app")
    except KeyboardInterrupt:
        sys.exit(130)
