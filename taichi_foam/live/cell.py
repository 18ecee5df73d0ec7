"""A live cell: a drop watched inside a notebook, as a picture that is drawn again and again."""

from __future__ import annotations

import io
import sys
import time

from PIL import Image

from taichi_foam.live.stage import PACE, Keep, Stage
from taichi_foam.scene import Scene

#: Pictures a second: notebooks keep up with as many over a slow line, too.
FPS = 15
SIZE = (960, 540)
_QUALITY = 88


def is_notebook() -> bool:
    """Whether this process is the kernel of a notebook."""
    ipython = sys.modules.get("IPython")
    shell = ipython.get_ipython() if ipython is not None else None
    return getattr(shell, "kernel", None) is not None


def watch(
    scene: Scene,
    keep: Keep,
    *,
    size: tuple[int, int] = SIZE,
    arch: str = "cpu",
    threads: int | None = None,
    pace: float | None = PACE,
) -> Stage:
    """Show a drop of `scene` below the cell until it ends; the kernel's interrupt ends it early.

    Arguments and errors as for `window.watch`; `pace` as for `Stage`. Returns the stage,
    its run ended.
    """
    from IPython.display import DisplayHandle

    handle = DisplayHandle()
    with Stage(scene, keep, arch=arch, threads=threads, pace=pace) as stage:
        handle.display(_image(stage, size))
        try:
            while not stage.ended:
                due = time.monotonic() + 1 / FPS
                if stage.update(1 / FPS):
                    handle.update(_image(stage, size))
                time.sleep(max(0.0, due - time.monotonic()))
        except KeyboardInterrupt:
            pass
        stage.finish()
        stage.update(1.0)  # the last instant
        handle.update(_image(stage, size))
    return stage


def _image(stage: Stage, size: tuple[int, int]):
    """The stage's picture as IPython shows one."""
    from IPython.display import Image as Shown

    file = io.BytesIO()
    Image.fromarray(stage.picture(size)).save(file, "JPEG", quality=_QUALITY, subsampling=0)
    return Shown(data=file.getvalue(), format="jpeg", width=size[0])
