"""`run --live`: drops in a window, each kept in a folder of its own as it ends."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from pathlib import Path

from rich.console import Console

from taichi_foam.catalogue import title
from taichi_foam.cli import tables
from taichi_foam.cli.outcome import say_assumed, say_warnings, say_where
from taichi_foam.errors import RunError
from taichi_foam.live import window
from taichi_foam.live.controller import Controller, Outcome
from taichi_foam.live.messages import Keeping
from taichi_foam.picture import films
from taichi_foam.results import manifest
from taichi_foam.results.files import next_numbered
from taichi_foam.results.folders import Claim, claimed
from taichi_foam.results.result import Result, request_of, storage_bytes
from taichi_foam.scene import Scene
from taichi_foam.simulation.progress import Bars


class _Folders:
    """Where drops are kept: the first in the folder that was claimed, the next beside it.

    Until the first is kept, drops of the scene as it was given leave checkpoints in the claim, from
    which the same command goes on. Later ones, and those that keys have changed, leave none.

    kept  folders of the drops that are kept, in order
    """

    def __init__(
        self, scene: Scene, folder: str, claim: Claim, every: float | None, release: Callable
    ) -> None:
        """`release` gives the claim up; checkpoints are written `every` seconds."""
        self.kept: list[Path] = []
        self._scene, self._first, self._claim, self._every = scene, Path(folder), claim, every
        self._release = release
        self._has_begun = False
        self._drops: set[int] = set()

    def keeping(self, scene: Scene) -> Keeping | None:
        """Where a drop leaves checkpoints; the very first goes on from what is there."""
        if self.kept or scene != self._scene:
            return None
        goes_on, self._has_begun = not self._has_begun, True
        return Keeping(self._claim.work, self._every, goes_on)

    def keep(self, outcome: Outcome) -> None:
        """Save what a drop has given. Raises UserError, OSError."""
        if outcome.drop in self._drops:
            return  # Ctrl-C came when it had just been kept
        if self.kept:
            path = next_numbered(self._first, digits=1, first=2)
            outcome.result.save(path)
            self._note(outcome, path)
            return
        try:
            with self._claim.publishing() as staging:
                outcome.result.write(staging)
        except KeyboardInterrupt:
            self._note(outcome, self._first)  # it is whole: Ctrl-C is held until then
            raise
        self._note(outcome, self._first)
        # what was cut short the same command continues
        if not (outcome.ended == "cut short" and outcome.result.scene == self._scene):
            self._claim.finish()
            self._release()

    def _note(self, outcome: Outcome, path: Path) -> None:
        self._drops.add(outcome.drop)
        self.kept.append(path)


def run_live(
    scene: Scene,
    folder: str,
    overwrite: bool,
    every: float | None,
    arch: str,
    threads: int | None,
    bars: Bars,
    console: Console,
    errors: Console,
) -> None:
    """Watch drops of `scene` until the window is closed; then draw their films, and say what came.

    The first drop becomes `folder`, the next `folder`-2 and so on.
    """
    window.check_display()
    needed = storage_bytes(scene) + films.storage_bytes(scene)
    with contextlib.ExitStack() as claims:
        claim = claims.enter_context(claimed(folder, request_of(scene), overwrite, needed))
        folders = _Folders(scene, folder, claim, every, claims.close)
        controller = Controller(
            scene, folders.keep, arch=arch, threads=threads, keeping=folders.keeping
        )
        window.show(controller, shots=Path(f"{Path(folder)}-shots"))
    kept = folders.kept
    if not kept and not controller.failures and not controller.unkept:
        raise KeyboardInterrupt("the window was closed before there was anything to save")
    # What has failed or was cut short has no film, as in `run` without a window.
    whole = kept[:-1] if controller.was_cut else kept
    has_films = bool(controller.failures) or _draw_films(whole, bars)
    if kept:
        last = Result.load(kept[-1])
        console.print(tables.key_figures(last.scene, last.summary))
        say_assumed(console, last, kept[-1])
        for path in kept:
            say_where(console, str(path))
        if not controller.failures:
            say_warnings(errors, last)
    if controller.problem:
        raise RunError(f"{controller.unkept[0].result.scene.name}: {controller.problem}")
    if controller.failures:
        where = "; what was computed is in the folders above" if kept else ""
        raise RunError(f"{controller.failures[-1]}{where}")
    if controller.was_cut:
        is_given = len(kept) == 1 and controller.scene == scene
        goes_on = "; the same command goes on from there" if is_given else ""
        raise KeyboardInterrupt(f"closed before its end: what there was is in {kept[-1]}{goes_on}")
    if not has_films:
        raise KeyboardInterrupt("films may be missing")


def _draw_films(folders: list[Path], bars: Bars) -> bool:
    """Draw the films of stored runs into their folders; whether Ctrl-C let it."""
    try:
        for folder in folders:
            result = Result.load(folder)
            frames = films.frames_to_draw(result)
            if frames:
                with bars.counting("films", f"films of {folder}", frames, "frames") as on_frame:
                    drawn = films.write(result, folder, on_frame, title=title(result.scene))
                manifest.add(folder, [path.name for path in drawn])
    except KeyboardInterrupt:
        return False
    return True
