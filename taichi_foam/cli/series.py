"""`run --drops`: several drops on one block, each into a folder of its own, and their table."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console

from taichi_foam.cli.films import draw_films
from taichi_foam.cli.outcome import say_assumed, say_where
from taichi_foam.errors import RunError, UserError
from taichi_foam.interrupts import held_interrupts
from taichi_foam.records.ending import Ending
from taichi_foam.results.folders import Claim, claimed
from taichi_foam.results.result import Result, storage_bytes, write_drops
from taichi_foam.scene import Scene

if TYPE_CHECKING:
    from taichi_foam.simulation.progress import Bars

TABLE, FIGURE = "drops.csv", "drops.png"


def run_series(
    scene: Scene,
    count: int,
    folder: str,
    arch: str,
    threads: int | None,
    overwrite: bool,
    every: float | None,
    bars: Bars,
    console: Console,
    errors: Console,
) -> None:
    """Compute, save and show `count` drops; the same command goes on where it stopped."""
    from taichi_foam.engine import runtime
    from taichi_foam.picture import films
    from taichi_foam.simulation import simulate

    simulate.check_drops(count)
    if scene.impactor is None:
        raise UserError("drops: nothing falls without an impactor; give [impactor] a shape")
    needed = count * (storage_bytes(scene) + films.storage_bytes(scene))
    request = simulate.drops_request(scene, count)
    with claimed(folder, request, overwrite, needed) as claim:
        runtime.start(arch, threads)
        failure = None
        with bars.computing(f"{count} drops of {scene.name}") as on_progress:
            try:
                results = simulate.run_drops(
                    scene, count, on_progress, checkpoint=claim, every=every
                )
            except RunError as error:
                if not error.results:
                    raise
                results, failure = error.results, error
        cut = _publish(results, claim) or results[-1].ending is Ending.INTERRUPTED
        no_film = None if cut or failure else _draw_all(results, claim, bars)
        if not cut and not isinstance(no_film, KeyboardInterrupt):
            claim.finish()
        from taichi_foam.cli import tables

        console.print(tables.drops(results))
        say_assumed(console, results[0], Path(folder) / simulate.drop_name(1))
        say_where(console, folder)
        for result in results:
            for text in result.warnings if failure is None else ():
                errors.print(f"warning: drop {result.drop}: {text}", soft_wrap=True, markup=False)
        if failure is not None:
            raise RunError(f"{failure}; what was computed until then is in {folder}")
        if cut or isinstance(no_film, KeyboardInterrupt):
            raise KeyboardInterrupt(
                f"what there was is in {folder}; the same command goes on from there"
            )
        if no_film is not None:
            raise RunError(f"{no_film}; the drops themselves are complete in {folder}")


def _publish(results: list[Result], claim: Claim) -> bool:
    """Write every drop's folder, the table and the figure; whether Ctrl-C was pressed meanwhile."""
    from taichi_foam.picture import style
    from taichi_foam.picture.figures import drops_figure
    from taichi_foam.simulation.simulate import drop_name

    with held_interrupts() as pressed, claim.publishing() as staging:
        for result in results:
            inner = staging / drop_name(result.drop)
            inner.mkdir()
            result.write(inner)
        write_drops(staging / TABLE, [result.summary for result in results])
        style.save(drops_figure(results), staging / FIGURE)
    return pressed.is_set()


def _draw_all(results: list[Result], claim: Claim, bars: Bars) -> BaseException | None:
    """Draw the films of all drops; what kept one from being drawn, if so."""
    from taichi_foam.simulation.simulate import drop_name

    for result in results:
        title = f"{result.scene.name}, drop {result.drop}"
        if error := draw_films(result, claim.folder / drop_name(result.drop), bars, title):
            return error
    return None
