"""Progress on a terminal: bars with the rate and the time left, and a line for each stage done.

Without a terminal (a log, a pipe) only the lines are written, and for counts one every half minute.
"""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn
from rich.text import Text

from taichi_foam.units import duration_text, si_scale

if TYPE_CHECKING:
    from taichi_foam.simulation.simulate import Progress as Standing


LINE_S = 30.0
"""Interval between lines of a count in a log [s]."""


class Bars:
    """Shows the progress of each stage of a long task.

    seconds  wall time of each finished stage, by name, in order
    """

    def __init__(self, console: Console | None = None) -> None:
        """`console` None: show nothing, only record times."""
        self._console = console
        self.seconds: dict[str, float] = {}

    @contextlib.contextmanager
    def computing(self, what: str) -> Iterator[Callable[[Standing], None]]:
        """A bar for a run or a batch; yields the callback for `simulation.run_many`."""
        with self._stage("computing", what, f"computing {what}", 1.0) as (show, close):
            last: list[Standing] = []

            def update(standing: Standing) -> None:
                last[:] = [standing]
                pace = standing.steps / max(standing.wall, 1e-9)
                done = f"{1e3 * standing.time:.1f} ms"
                if standing.of > 1:
                    done = f"{standing.finished} of {standing.of} runs"
                show(standing.fraction, f"{done}, {_count(pace)} steps/s")

            yield update
            if last:
                steps, wall = last[0].steps, last[0].wall
                close(f"{steps:,} steps, {_count(steps / max(wall, 1e-9))} steps/s")

    @contextlib.contextmanager
    def counting(
        self, name: str, what: str, total: int, unit: str
    ) -> Iterator[Callable[..., None]]:
        """A bar for `total` equal pieces of work.

        Yields a function to call after each piece, or with n after n pieces.
        """
        with self._stage(name, what, what, total) as (show, close):
            done, start = 0, time.perf_counter()

            def rate() -> float:
                return done / max(time.perf_counter() - start, 1e-9)

            def advance(count: int = 1) -> None:
                nonlocal done
                done += count
                show(done, f"{done} of {total} {unit}, {_count(rate())}/s")

            def line() -> str:
                if not done:
                    return f"0 of {total:,} {unit}"
                left = duration_text((total - done) / rate())
                return f"{done:,} of {total:,} {unit}, {_count(rate())}/s, about {left} left"

            with self._lines(line):
                yield advance
            close(f"{done} {unit}")

    @contextlib.contextmanager
    def _lines(self, line: Callable[[], str]) -> Iterator[None]:
        """Without a terminal, print `line()` at intervals until the block ends."""
        if self._console is None or self._console.is_terminal:
            yield
            return
        ended = threading.Event()

        def tell() -> None:
            while not ended.wait(LINE_S):
                self.say(line())

        teller = threading.Thread(target=tell, daemon=True)
        teller.start()
        try:
            yield
        finally:
            ended.set()
            teller.join()

    @contextlib.contextmanager
    def _stage(
        self, name: str, short: str, what: str, total: float
    ) -> Iterator[tuple[Callable[[float, str], None], Callable[[str], None]]]:
        """Yield two functions: one moves the bar, one sets the closing line's words in brackets.

        Bars fit 80 columns: `short` is shown beside them, `what` in the closing line.
        """
        start, closing = time.perf_counter(), ""

        def close(words: str) -> None:
            nonlocal closing
            closing = words

        bar = Progress(
            TextColumn("{task.description}"),
            BarColumn(bar_width=14),
            TextColumn("{task.percentage:>3.0f} %"),
            TextColumn("{task.fields[detail]}", style="dim"),
            TimeRemainingColumn(),
            TextColumn("left", style="dim"),
            console=self._console,
            transient=True,
            disable=self._console is None or not self._console.is_terminal,
        )
        try:
            with bar:
                # Without a total the bar swings until the first update, as while kernels compile.
                task = bar.add_task(_cut(short), total=None, detail="preparing")
                yield (
                    lambda done, detail: bar.update(
                        task, completed=done, total=total, detail=detail
                    ),
                    close,
                )
        finally:
            took = time.perf_counter() - start
            self.seconds[name] = self.seconds.get(name, 0.0) + took
        self.say(f"{what}: {took:.1f} s" + (f" ({closing})" if closing else ""))

    def say(self, text: str) -> None:
        """Print a line of plain text, unwrapped if there is no terminal."""
        if self._console is not None:
            self._console.print(Text(text), soft_wrap=not self._console.is_terminal)


def _count(number: float) -> str:
    """A number of steps, abbreviated: 940, 9.4k, 1.2M."""
    scale, prefix = si_scale(number, least=0, digits=3)
    return f"{number / scale:.3g}{prefix}"


def _cut(text: str, length: int = 22) -> str:
    return text if len(text) <= length else f"{text[: length - 1]}…"
