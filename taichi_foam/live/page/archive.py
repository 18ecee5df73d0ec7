"""Drops that are over: saved one after another in folders of their own, listed, and filmed.

As a program, `python -m taichi_foam.live.page.archive FOLDER/film.mp4`, it draws one film.
"""

from __future__ import annotations

import asyncio
import json
import os
import sys
import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from taichi_foam.analysis.measures import DISPLACEMENT, DURATION, PLATEAU
from taichi_foam.errors import UserError
from taichi_foam.live.page.numbers import thinned
from taichi_foam.results.files import file_name, next_numbered
from taichi_foam.results.folders import check_output_folder
from taichi_foam.results.result import OUTPUTS, Result, storage_bytes

if TYPE_CHECKING:
    from taichi_foam.scene import Scene

#: Drops that are listed, and former curves that are shown.
MOST_LISTED, MOST_CURVES = 50, 5
#: Results that may wait for a disk to have room; beyond that no drop begins, so that none is lost.
MOST_WAITING = 4
#: How long to wait before trying a disk again [s].
TRY_AGAIN = 10.0

#: Films that may be waited for.
MOST_FILMS = 6

#: What can be downloaded of a drop: what its link is called, if there is one, and says.
FILES = {name: (file.link, file.about) for name, file in OUTPUTS.items()}
#: The same of what has to be drawn first.
FILMS = {
    "film.mp4": ("MP4", "film; drawn when first asked for"),
    "film.gif": ("GIF", "film; drawn when first asked for"),
}
#: The figures of the list of drops.
FIGURES = (DISPLACEMENT, DURATION, PLATEAU)


@dataclass(eq=False)
class Finished:
    """A drop that is over.

    about    how its scene differs from the one that is served, and how it ended
    result   what it gave, until that is saved
    folder   where it is saved
    problem  why it is not saved yet
    figures  its measures, once saved
    films    by file name: "waiting", "drawing", "ready", or why there is none
    """

    number: int
    about: list[str]
    ended: str
    result: Result | None
    folder: Path | None = None
    problem: str | None = None
    figures: dict[str, Any] = field(default_factory=dict)
    films: dict[str, str] = field(default_factory=dict)
    curve: dict[str, list[float]] = field(default_factory=dict)


class Archive:
    """Saves what drops have given, in a thread of its own, and keeps the list of them."""

    def __init__(self, out: Path, on_change: Callable[[], object]) -> None:
        """Folders lie in `out`, called after what was dropped, and numbered.

        `on_change` is called, by any thread, when the list has changed.
        """
        self._out = out
        self._on_change = on_change
        self._drops: list[Finished] = []
        self._state = threading.Condition()  # guards the list and what follows
        self._is_closing = False
        self._tries = 0  # grows when somebody asks to try again
        self._thread = threading.Thread(target=self._save_all, name="archive", daemon=True)

    def check(self, scene: Scene) -> None:
        """Raise UserError if a result of this scene could not be saved."""
        waiting = self._waiting()
        if len(waiting) >= MOST_WAITING:
            problem = next(filter(None, (drop.problem for drop in waiting)), "")
            raise UserError(f"{len(waiting)} drops are waiting to be saved; {problem}")
        check_output_folder(self._next_folder(scene), needed_bytes=storage_bytes(scene))

    def add(self, number: int, about: list[str], ended: str, result: Result) -> None:
        """Save what a drop has given, soon."""
        history = result.history
        curve = thinned(history["time_s"], history["deceleration_smoothed_m_s2"])
        drop = Finished(number, about, ended, result, curve=curve)
        with self._state:
            if self._thread.ident is None:
                self._thread.start()
            self._drops.append(drop)
            self._forget()
            for old in self._drops[:-MOST_CURVES]:
                old.curve = {}
            self._state.notify()
        self._on_change()

    def find(self, number: int) -> Finished | None:
        """The drop of this number, if it is over and still listed."""
        with self._state:
            return next((drop for drop in self._drops if drop.number == number), None)

    def set_film(self, drop: Finished, name: str, standing: str | None) -> None:
        """Say how far a film is; None: nobody has asked for it."""
        with self._state:
            drop.films.pop(name, None)
            if standing is not None:
                drop.films[name] = standing
        self._on_change()

    def told(self) -> dict[str, Any]:
        """The list as the page shows it, the latest first."""
        with self._state:
            return {"drops": [_told(drop) for drop in reversed(self._drops)]}

    def curves(self) -> dict[str, Any]:
        """The curves of the last drops, the latest first."""
        with self._state:
            shown = [drop for drop in reversed(self._drops) if drop.curve]
            return {"curves": [{"drop": drop.number, **drop.curve} for drop in shown]}

    def try_again(self) -> None:
        """Save at once what could not be saved."""
        with self._state:
            self._tries += 1
            self._state.notify()

    def close(self) -> list[Finished]:
        """Save all that waits, and return what could not be saved."""
        with self._state:
            self._is_closing = True
            self._state.notify()
        if self._thread.ident is not None:
            self._thread.join()
        return self._waiting()

    def _next_folder(self, scene: Scene) -> Path:
        return next_numbered(self._out / file_name(scene.name))

    def _waiting(self) -> list[Finished]:
        with self._state:
            return [drop for drop in self._drops if drop.result is not None]

    def _save_all(self) -> None:
        while True:
            tries = self._tries
            for drop in self._waiting():
                self._save(drop)
            with self._state:
                waiting = self._waiting()
                if self._is_closing and all(drop.problem for drop in waiting):
                    return
                if any(drop.problem is None for drop in waiting) or self._tries != tries:
                    continue
                self._state.wait(TRY_AGAIN if waiting else None)

    def _forget(self) -> None:
        """Leave out the oldest beyond what is listed, except what is yet to be saved."""
        for old in self._drops[:-MOST_LISTED]:
            if old.result is None:
                self._drops.remove(old)

    def _save(self, drop: Finished) -> None:
        result = drop.result
        assert result is not None
        try:
            folder = result.save(self._next_folder(result.scene))
            figures = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
        except Exception as error:
            # whatever it is: the thread has other drops to save, and this one once more
            known = isinstance(error, (UserError, OSError))
            with self._state:
                drop.problem = str(error) if known else f"{type(error).__name__}: {error}"
        else:
            with self._state:
                drop.folder, drop.figures = folder, figures
                drop.result = drop.problem = None
                self._forget()
        self._on_change()


def _told(drop: Finished) -> dict[str, Any]:
    figures = drop.figures
    return {
        "number": drop.number,
        "about": drop.about,
        "ended": drop.ended,
        "figures": {q.key: figures.get(q.key) for q in FIGURES},
        "folder": str(drop.folder) if drop.folder else None,
        "problem": drop.problem,
        "films": dict(drop.films),
    }


class Films:
    """Draws films into the folders of drops, where they stay."""

    def __init__(self, archive: Archive) -> None:
        self._archive = archive
        self._one_at_a_time = asyncio.Lock()
        self._tasks: dict[tuple[int, str], asyncio.Task[None]] = {}

    async def film(self, drop: Finished, name: str) -> Path:
        """The file of a film of a saved drop, drawn if need be.

        It is drawn to its end even if the viewer who asked has left. Raises UserError if it fails.
        """
        assert drop.folder is not None
        path = drop.folder / name
        if path.is_file():
            return path
        key = (drop.number, name)
        if key not in self._tasks:
            if len(self._tasks) >= MOST_FILMS:
                raise UserError("too many films are being drawn; try again in a minute")
            self._tasks[key] = asyncio.create_task(self._draw(drop, path))
            self._tasks[key].add_done_callback(lambda task: self._tasks.pop(key, None))
        try:
            await asyncio.shield(self._tasks[key])
        except asyncio.CancelledError:
            raise UserError("the server is shutting down and draws no more films") from None
        return path

    async def close(self) -> None:
        """Give up what is being drawn."""
        tasks = list(self._tasks.values())
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)

    async def _draw(self, drop: Finished, path: Path) -> None:
        self._archive.set_film(drop, path.name, "waiting")
        try:
            async with self._one_at_a_time:
                self._archive.set_film(drop, path.name, "drawing")
                await _drawn_apart(path)
        except UserError as error:
            self._archive.set_film(drop, path.name, str(error))
            raise
        except asyncio.CancelledError:
            self._archive.set_film(drop, path.name, None)
            raise
        self._archive.set_film(drop, path.name, "ready")


async def _drawn_apart(path: Path) -> None:
    """Draw a film in a process that gives way to the run."""
    process = await asyncio.create_subprocess_exec(
        sys.executable,
        "-m",
        __name__,
        str(path),
        stdin=asyncio.subprocess.DEVNULL,
        stdout=asyncio.subprocess.DEVNULL,
        stderr=asyncio.subprocess.PIPE,
        start_new_session=True,  # the server decides what Ctrl-C means
    )
    try:
        _, words = await process.communicate()
    except asyncio.CancelledError:
        process.terminate()
        await process.wait()
        raise
    if process.returncode != 0:
        last = words.decode(errors="replace").strip().splitlines()[-1:]
        raise UserError(f"{path.name} could not be drawn: {' '.join(last) or 'no reason given'}")


def main(path: Path) -> None:
    """Draw the film of this name into the folder of the run that it lies in."""
    from taichi_foam import catalogue
    from taichi_foam.picture import films

    if hasattr(os, "nice"):
        os.nice(10)
    ending = path.suffix[1:]
    try:
        result, names = Result.load(path.parent), films.Names(**{ending: path.name})
        films.Reel.of(result, catalogue.title(result.scene)).write(path.parent, names=names)
    except UserError as error:
        sys.exit(str(error))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
