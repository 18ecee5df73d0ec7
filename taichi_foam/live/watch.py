"""Watch a drop while it is computed, wherever Python runs: in a window, or in a notebook's cell."""

from __future__ import annotations

from taichi_foam.errors import RunError
from taichi_foam.live import cell, window
from taichi_foam.live.controller import PACE, Controller, Outcome
from taichi_foam.results.result import Result
from taichi_foam.scene import Scene


def watch(
    scene: Scene,
    *,
    size: tuple[int, int] | None = None,
    pace: float | None = PACE,
    arch: str = "cpu",
    threads: int | None = None,
) -> Result:
    """Drop `scene` before your eyes: in a notebook below the cell, elsewhere in a window.

    In the window, keys pause, step, turn the impactor's speed and drop again (H shows them). In a
    notebook the kernel's interrupt ends the drop early.

    Args:
        scene: what is dropped; `output.mode` and `output.theme` say how it is drawn.
        size: of the picture [pixels]; default 1280 x 720, in a notebook 960 x 540.
        pace: simulated seconds in one of watching at first; None: as fast as it goes.
        arch, threads: what to compute on, as for `run`.

    Returns:
        The result of the last drop; its `ending` tells whether it was cut short.

    Raises:
        UserError: no display, or an arch that cannot be had.
        RunError: the drop failed, its `results` holding what came before; or it gave nothing.
    """
    kept: list[Result] = []

    def keep(outcome: Outcome) -> None:
        kept[:] = [outcome.result]  # the last one only: a big lattice's results fill the memory

    controller = Controller(scene, keep, arch=arch, threads=threads, pace=pace)
    place = cell if cell.is_notebook() else window
    place.show(controller, size or place.SIZE)
    if controller.failures:
        raise RunError(controller.failures[-1], kept)
    if not kept:
        raise RunError(f"{scene.name}: it was closed before it gave anything", [])
    return kept[0]
