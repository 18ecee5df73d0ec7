"""Films of finished drops, drawn when somebody asks, one at a time, in a process of their own."""

from __future__ import annotations

import asyncio
import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from taichi_foam.errors import UserError

if TYPE_CHECKING:
    from taichi_foam.live.page.archive import Archive, Finished

#: Films that may be waited for.
MOST_FILMS = 6


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
            raise UserError("the server ends; no film is drawn any more") from None
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
    from taichi_foam.catalogue import title
    from taichi_foam.picture import films
    from taichi_foam.results.result import Result

    if hasattr(os, "nice"):
        os.nice(10)
    ending = path.suffix[1:]
    try:
        result, names = Result.load(path.parent), films.Names(**{ending: path.name})
        films.write(result, path.parent, names=names, title=title(result.scene))
    except UserError as error:
        sys.exit(str(error))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
