"""Films of a run that is saved."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from taichi_foam.results.result import Result

if TYPE_CHECKING:
    from taichi_foam.simulation.progress import Bars


def draw_films(
    result: Result, folder: Path, bars: Bars, title: str | None = None
) -> BaseException | None:
    """Draw films into the folder of a run that is saved; what kept them from being drawn, if so.

    Whatever it is, the run is not to be lost by it. `title` is by default that of the scene.
    """
    from taichi_foam.catalogue import title as title_of
    from taichi_foam.picture import films
    from taichi_foam.results import manifest

    if not (frames := films.frames_to_draw(result)):
        return None
    try:
        with bars.counting("films", "drawing pictures", frames, "frames") as on_frame:
            words = title_of(result.scene) if title is None else title
            drawn = films.write(result, folder, on_frame, title=words)
        manifest.add(folder, [path.name for path in drawn])
    except (Exception, KeyboardInterrupt) as error:
        return error
    return None
