"""Watch a drop while it is computed, in a window or in a notebook cell."""

from __future__ import annotations

import contextlib
import io
import sys
import time

from PIL import Image

from taichi_foam.errors import RunError
from taichi_foam.live import window
from taichi_foam.live.screen import Screen
from taichi_foam.live.session import PACE, Outcome, Session
from taichi_foam.results.result import Result
from taichi_foam.scene import Scene
from taichi_foam.simulation.simulate import check_scenes

#: Pictures per second: notebooks keep up with this rate even over a slow connection.
FPS = 15
CELL_SIZE = (960, 540)
#: How long to wait for the picture of the last instant [s].
PATIENCE = 1.0
_QUALITY = 88


def watch(
    scene: Scene,
    *,
    size: tuple[int, int] | None = None,
    pace: float | None = PACE,
    arch: str = "cpu",
    threads: int | None = None,
) -> Result:
    """Show a drop of `scene` live: in a notebook below the cell, elsewhere in a window.

    In the window, keys pause, step, change the impactor's speed and drop again (H shows them). In a
    notebook the kernel's interrupt ends the drop early.

    Args:
        scene: what is dropped; `output.mode` and `output.theme` determine how it is drawn.
        size: size of the picture [pixels]; default 1280 x 720, in a notebook 960 x 540.
        pace: initial pace, simulated seconds per second of watching; None: as fast as possible.
        arch, threads: what to compute on, as for `run`.

    Returns:
        The result of the last drop; its `ending` says whether it was cut short.

    Raises:
        UserError: no scene, no display, or the arch is not available.
        RunError: the drop failed, with the data so far in `results`; or it gave no result.
    """
    check_scenes([scene])
    kept: list[Result] = []

    def keep(outcome: Outcome) -> None:
        kept[:] = [outcome.result]  # the last one only: results of a large lattice fill the memory

    session = Session(scene, keep, arch=arch, threads=threads, pace=pace)
    if _is_notebook():
        _show_below(session, size or CELL_SIZE)
    else:
        window.show(session, size or window.SIZE)
    if session.failures:
        raise RunError(session.failures[-1], kept)
    if not kept:
        raise RunError(f"{scene.name}: the window was closed before there was anything to show", [])
    return kept[0]


def _is_notebook() -> bool:
    """Whether this process is a notebook kernel."""
    ipython = sys.modules.get("IPython")
    shell = ipython.get_ipython() if ipython is not None else None
    return getattr(shell, "kernel", None) is not None


def _show_below(session: Session, size: tuple[int, int]) -> None:
    """Show a session's drop below the cell until it ends; the kernel's interrupt ends it early.

    Raises UserError if the arch is not available.
    """
    from IPython.display import DisplayHandle

    handle, screen = DisplayHandle(), Screen(session)
    with session:
        handle.display(_image(screen, size))
        with contextlib.suppress(KeyboardInterrupt):
            while not session.ended:
                due = time.monotonic() + 1 / FPS
                if screen.update(1 / FPS):
                    handle.update(_image(screen, size))
                time.sleep(max(0.0, due - time.monotonic()))
        session.finish()
        until = time.monotonic() + PATIENCE
        while not session.settled and time.monotonic() < until:
            screen.update(PATIENCE / 10)
        handle.update(_image(screen, size))


def _image(screen: Screen, size: tuple[int, int]):
    """The picture as an object that IPython can show."""
    from IPython.display import Image as Shown

    file = io.BytesIO()
    Image.fromarray(screen.picture(size)).save(file, "JPEG", quality=_QUALITY, subsampling=0)
    return Shown(data=file.getvalue(), format="jpeg", width=size[0])
