"""Running one scene to its end."""

from __future__ import annotations

from taichi_foam.results.result import Result
from taichi_foam.scene import Scene
from taichi_foam.simulation.simulate import run


def whole(scene: Scene) -> Result:
    """Its result. Ctrl-C is raised: figures of half a run must not be kept."""
    result = run(scene)
    if result.run["interrupted"]:
        raise KeyboardInterrupt
    return result
