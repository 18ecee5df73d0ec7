"""A live cell: a drop watched inside a notebook, as a picture that is drawn again and again."""

from __future__ import annotations

import contextlib
import io
import sys
import time

from PIL import Image

from taichi_foam.live.controller import Controller
from taichi_foam.live.screen import Screen

#: Pictures a second: notebooks keep up with as many over a slow line, too.
FPS = 15
SIZE = (960, 540)
#: How long the picture of the last instant may take [s].
PATIENCE = 1.0
_QUALITY = 88


def is_notebook() -> bool:
    """Whether this process is the kernel of a notebook."""
    ipython = sys.modules.get("IPython")
    shell = ipython.get_ipython() if ipython is not None else None
    return getattr(shell, "kernel", None) is not None


def show(controller: Controller, size: tuple[int, int] = SIZE) -> None:
    """Show a controller's drop below the cell until it ends; the kernel's interrupt ends it early.

    Raises UserError for an arch that cannot be had.
    """
    from IPython.display import DisplayHandle

    handle, screen = DisplayHandle(), Screen(controller)
    with controller:
        handle.display(_image(screen, size))
        with contextlib.suppress(KeyboardInterrupt):
            while not controller.ended:
                due = time.monotonic() + 1 / FPS
                if screen.update(1 / FPS):
                    handle.update(_image(screen, size))
                time.sleep(max(0.0, due - time.monotonic()))
        controller.finish()
        until = time.monotonic() + PATIENCE
        while not controller.settled and time.monotonic() < until:
            screen.update(PATIENCE / 10)
        handle.update(_image(screen, size))


def _image(screen: Screen, size: tuple[int, int]):
    """The picture as IPython shows one."""
    from IPython.display import Image as Shown

    file = io.BytesIO()
    Image.fromarray(screen.picture(size)).save(file, "JPEG", quality=_QUALITY, subsampling=0)
    return Shown(data=file.getvalue(), format="jpeg", width=size[0])
