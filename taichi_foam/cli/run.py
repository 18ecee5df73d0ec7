"""`run` and `resume`: a run, drops on one block, or a live window, with saving and pictures."""

from __future__ import annotations

import contextlib
import hashlib
import os
import shlex
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.table import Table

from taichi_foam.analysis import balance
from taichi_foam.catalogue import load_scene
from taichi_foam.cli.options import RunRequest
from taichi_foam.cli.outcome import Terminal
from taichi_foam.errors import RunError, UserError
from taichi_foam.interrupts import held_interrupts
from taichi_foam.records.ending import Ending
from taichi_foam.results import manifest
from taichi_foam.results.files import drop_name, file_name, next_numbered
from taichi_foam.results.folders import Claim, claimed, size_text
from taichi_foam.results.result import Result, request_of, storage_bytes
from taichi_foam.scene import Scene, block
from taichi_foam.scene.values import settings

if TYPE_CHECKING:
    from taichi_foam.live.messages import Keeping
    from taichi_foam.live.session import Outcome
    from taichi_foam.simulation.after import After
    from taichi_foam.simulation.progress import Bars
    from taichi_foam.simulation.simulate import ProgressCallback

# The disk space of a run is announced before it begins if it may exceed this [bytes].
_WORTH_SAYING = 1e9
# The default folder's name lists the changes, up to this many characters.
_LONGEST_CHANGES = 60

TABLE, FIGURE = "drops.csv", "drops.png"
"""Files of a series of drops, beside the drops' own folders."""


def run(source: str | Scene, asked: RunRequest, terminal: Terminal) -> None:
    """`run`: load, check, compute, save, show. Raises UserError, RunError, KeyboardInterrupt."""
    overrides = asked.overrides
    scene = load_scene(source, asked.choices, overrides)
    _check_combination(asked)
    terminal.warn(filter(None, (balance.doubt(scene), block.advice(scene.block))), "note")
    folder = asked.out
    if folder is None:
        words = [] if asked.after is None else [f"after-{Path(asked.after).resolve().name}"]
        words += [] if asked.drops is None else [f"{asked.drops}-drops"]
        folder = _default_folder(scene, asked.choices, overrides, words)
    # Names and values are valid: now import modules that load Taichi.
    if asked.live:
        _watch(scene, folder, asked, terminal)
        return
    if asked.drops is not None:
        work = _series(scene, asked.drops)
    else:
        from taichi_foam.simulation.after import After

        work = _single(scene, None if asked.after is None else After.of(scene, asked.after))
    needed = (asked.drops or 1) * _needed(scene)
    with claimed(folder, work.request, asked.overwrite, needed) as claim:
        if needed > _WORTH_SAYING:
            terminal.bars.say(f"{folder} may take up to {size_text(needed)} of disk space")
        _compute(work, claim, folder, asked, terminal)


def resume(folder: str, asked: RunRequest, terminal: Terminal) -> None:
    """`resume`: as `run`, but from the checkpoint in a folder, with its scene."""
    from taichi_foam.simulation.after import After
    from taichi_foam.simulation.checkpoint import Checkpoint, work_in

    scene, arch, told = Checkpoint.head(work_in(Path(folder)))
    work = _single(scene, None if told is None else After(told))
    with claimed(folder, work.request) as claim:
        _compute(work, claim, folder, replace(asked, arch=arch), terminal)


def _needed(scene: Scene) -> int:
    """Disk space that a run and its pictures need [bytes]."""
    from taichi_foam.picture import films

    return storage_bytes(scene) + films.storage_bytes(scene)


def _default_folder(
    scene: Scene, choices: str | None, overrides: list[str], more: Sequence[str]
) -> str:
    """A separate folder for a scene and each set of changes, except changes of `output`."""
    values = {key: v for key, v in settings(overrides).items() if not key.startswith("output.")}
    words = [*([choices] if choices else []), *more]
    words += [f"{key}-{value}" for key, value in sorted(values.items())]
    name, changes = file_name(scene.name), file_name("-".join(words)) if words else ""
    if len(changes) > _LONGEST_CHANGES:
        changes = hashlib.sha256(changes.encode()).hexdigest()[:12]
    return f"runs/{name}-{changes}" if changes else f"runs/{name}"


def _check_combination(asked: RunRequest) -> None:
    """Raise UserError for incompatible options."""
    if asked.live and (asked.after is not None or asked.drops is not None):
        option = "--after" if asked.drops is None else "--drops"
        raise UserError(
            f"--live: shows drops on fresh blocks only, not {option}; leave out one of the two"
        )
    if asked.after is not None and asked.drops is not None:
        raise UserError("--drops: a series begins on a fresh block; leave out --after")


@dataclass(frozen=True)
class _Work:
    """A run, or a series of drops on one block.

    name       text beside its progress bar
    request    the request that identifies it when a folder is claimed
    compute    returns its results, or raises RunError with those so far
    is_series  whether each result has its own subfolder in the claimed folder
    """

    name: str
    request: Mapping[str, Any]
    compute: Callable[[ProgressCallback, Claim, float | None], list[Result]]
    is_series: bool = False

    def place(self, folder: str | Path, result: Result) -> str:
        """The folder of a result."""
        return os.path.join(folder, drop_name(result.drop)) if self.is_series else str(folder)

    def write(self, results: Sequence[Result], folder: Path) -> None:
        """Write results into the folder; for a series, also its table and figure."""
        for result in results:
            place = Path(self.place(folder, result))
            place.mkdir(exist_ok=True)
            result.write(place)
        if self.is_series:
            from taichi_foam.cli import tables
            from taichi_foam.picture import style
            from taichi_foam.picture.figures import drops_figure

            tables.write_drops(folder / TABLE, results)
            style.save(drops_figure(results), folder / FIGURE)

    def table(self, results: Sequence[Result]) -> Table:
        from taichi_foam.cli import tables

        if self.is_series:
            return tables.drops(results)
        return tables.key_figures(results[0].scene, results[0].summary)


def _single(scene: Scene, after: After | None) -> _Work:
    """A run of `scene`, on the block of another run if `after` is given."""
    from taichi_foam.simulation import simulate

    return _Work(
        scene.name,
        request_of(scene, after and after.told),
        lambda on_progress, claim, every: [
            simulate.run(scene, on_progress, after=after, checkpoint=claim, every=every)
        ],
    )


def _series(scene: Scene, count: int) -> _Work:
    """A series of drops on one block. Raises UserError: invalid count, or nothing falls."""
    from taichi_foam.simulation import simulate

    simulate.check_drops(count)
    if scene.impactor is None:
        raise UserError("drops: nothing falls without an impactor; give [impactor] a shape")
    return _Work(
        f"{count} drops of {scene.name}",
        simulate.drops_request(scene, count),
        lambda on_progress, claim, every: simulate.run_drops(
            scene, count, on_progress, checkpoint=claim, every=every
        ),
        is_series=True,
    )


def _compute(work: _Work, claim: Claim, folder: str, asked: RunRequest, terminal: Terminal) -> None:
    """Compute with a progress bar, write the folder, draw films, and finish."""
    from taichi_foam.engine import runtime

    runtime.start(asked.arch, asked.threads)  # before the bar: an error here is not a failed run
    failure = None
    with terminal.bars.computing(work.name) as on_progress:
        try:
            results = work.compute(on_progress, claim, asked.checkpoint)
        except RunError as error:
            if not error.results:
                raise
            results, failure = error.results, error
    with held_interrupts() as pressed, claim.publishing() as staging:
        work.write(results, staging)
    cut = pressed.is_set() or results[-1].ending is Ending.INTERRUPTED
    no_film = None
    if not cut and failure is None:
        places = [Path(work.place(claim.folder, result)) for result in results]
        no_film = _draw_films(zip(places, results, strict=True), terminal.bars, work.is_series)
    if not cut and not isinstance(no_film, KeyboardInterrupt):
        claim.finish()
    one = "run is", "run itself is"
    it_is, itself_is = ("drops are", "drops themselves are") if work.is_series else one
    also = "" if work.is_series else f", and so does `taichi-foam resume {folder}`"
    end = None
    if failure is not None:
        end = RunError(f"{failure}; what was computed up to then is in {folder}")
    elif cut:
        end = KeyboardInterrupt(
            f"what was computed is in {folder}; the same command continues from there{also}"
        )
    elif isinstance(no_film, KeyboardInterrupt):
        end = KeyboardInterrupt(
            f"the {it_is} in {folder}, but films may be missing; the same command draws them{also}"
        )
    elif no_film is not None:
        end = RunError(f"{no_film}; the {itself_is} complete in {folder}")
    doubts = _doubts(results if failure is None else (), work.is_series)
    place = work.place(folder, results[0])
    _finish(terminal, lambda: work.table(results), results[0], place, [folder], doubts, end)


def _draw_films(
    kept: Iterable[tuple[Path, Result]],
    bars: Bars,
    is_series: bool = False,
    names_folders: bool = False,
) -> BaseException | None:
    """Draw films into the folders of saved runs; return the error that prevented this, or None.

    No such error may lose the runs.
    """
    from taichi_foam import catalogue
    from taichi_foam.picture import films

    try:
        for folder, result in kept:
            title = catalogue.title(result.scene)
            if is_series:
                title = f"{result.scene.name}, drop {result.drop}"
            reel = films.Reel.of(result, title)
            if not (frames := reel.frames_to_draw()):
                continue
            what = f"films of {folder}" if names_folders else "drawing pictures"
            with bars.counting("films", what, frames, "frames") as on_frame:
                drawn = reel.write(folder, on_frame)
            manifest.add(folder, [path.name for path in drawn])
    except (Exception, KeyboardInterrupt) as error:
        return error
    return None


def _doubts(results: Iterable[Result], is_series: bool = False) -> Iterator[str]:
    """Warnings of results, computed when they are iterated."""
    for result in results:
        for text in result.warnings:
            yield f"drop {result.drop}: {text}" if is_series else text


def _finish(
    terminal: Terminal,
    table: Callable[[], Table],
    result: Result,
    folder: str,
    written: Iterable[str],
    doubts: Iterable[str],
    end: BaseException | None,
) -> None:
    """Report on saved runs, and end by raising the error that occurred, if there was one.

    Args:
        terminal: where to report.
        table: makes the table of their figures.
        result: the result whose foam is checked for assumed values, in the folder `folder`.
        written: all folders.
        doubts: warnings about the figures.
        end: error to raise at the end.

    Raises:
        RunError: the runs cannot be measured.
    """
    try:
        # measures are slow to import: after the run, not before it
        terminal.show(table())
    except Exception as error:
        told = f"{type(error).__name__}: {error}"
        raise RunError(
            f"the measures of the run could not be computed ({told}); its data are in {folder}"
        ) from error
    if count := len(result.summary["assumed"]):
        one = count == 1
        values = "1 value of the foam is" if one else f"{count} values of the foam are"
        shows = f"`taichi-foam foam assumed {shlex.quote(folder)}` shows {'it' if one else 'them'}"
        terminal.line(f"{values} assumed: {shows}")
    for each in written:
        terminal.where(each)
    terminal.warn(doubts)
    if end is not None:
        raise end


class _Folders:
    """Folders for a window's drops: the first drop in the claimed folder, later ones beside it.

    Until the first is kept, drops of the unchanged scene write checkpoints into the claim, from
    which the same command continues. Later drops, and drops of a changed scene, write none.

    kept  folders of the drops that are kept, in order
    """

    def __init__(
        self, scene: Scene, folder: str, claim: Claim, every: float | None, release: Callable
    ) -> None:
        """`release` gives up the claim; checkpoints are written every `every` seconds."""
        self.kept: list[Path] = []
        self._scene, self._first, self._claim, self._every = scene, Path(folder), claim, every
        self._release = release
        self._has_begun = False
        self._drops: set[int] = set()

    def keeping(self, scene: Scene) -> Keeping | None:
        """Where a drop writes checkpoints; the very first drop continues from an existing one."""
        from taichi_foam.live.messages import Keeping

        if self.kept or scene != self._scene:
            return None
        goes_on, self._has_begun = not self._has_begun, True
        return Keeping(self._claim.work, self._every, goes_on)

    def keep(self, outcome: Outcome) -> None:
        """Save the result of a drop. Raises UserError, OSError."""
        if outcome.drop in self._drops:
            return  # Ctrl-C came just after it was kept
        if self.kept:
            path = next_numbered(self._first, digits=1, first=2)
            outcome.result.save(path)
            self._note(outcome, path)
            return
        try:
            with self._claim.publishing() as staging:
                outcome.result.write(staging)
        except KeyboardInterrupt:
            self._note(outcome, self._first)  # it is complete: Ctrl-C is deferred until then
            raise
        self._note(outcome, self._first)
        # a drop that was cut short can be continued by the same command
        if not (outcome.ended == "cut short" and outcome.result.scene == self._scene):
            self._claim.finish()
            self._release()

    def _note(self, outcome: Outcome, path: Path) -> None:
        self._drops.add(outcome.drop)
        self.kept.append(path)


def _watch(scene: Scene, folder: str, asked: RunRequest, terminal: Terminal) -> None:
    """`run --live`: drops in a window until it is closed, each kept as it ends; then their films.

    The first drop becomes `folder`, the next `folder`-2 and so on.
    """
    from taichi_foam.cli import tables
    from taichi_foam.live import window
    from taichi_foam.live.session import Session

    window.check_display()
    with contextlib.ExitStack() as claims:
        claim = claims.enter_context(
            claimed(folder, request_of(scene), asked.overwrite, _needed(scene))
        )
        folders = _Folders(scene, folder, claim, asked.checkpoint, claims.close)
        session = Session(
            scene, folders.keep, arch=asked.arch, threads=asked.threads, keeping=folders.keeping
        )
        window.show(session, shots=Path(f"{Path(folder)}-shots"))
    kept = folders.kept
    no_film = None
    if not session.failures:
        # A drop that failed or was cut short gets no film, as in `run` without a window.
        whole = kept[:-1] if session.was_cut else kept
        stored = ((path, Result.load(path)) for path in whole)
        no_film = _draw_films(stored, terminal.bars, names_folders=True)
    end = None
    if session.problem:
        end = RunError(f"{session.unkept[0].result.scene.name}: {session.problem}")
    elif session.failures:
        where = "; what was computed is in the folders above" if kept else ""
        end = RunError(f"{session.failures[-1]}{where}")
    elif not kept:
        end = KeyboardInterrupt("the window was closed before there was anything to save")
    elif session.was_cut:
        is_given = len(kept) == 1 and session.scene == scene
        goes_on = "; the same command continues from there" if is_given else ""
        end = KeyboardInterrupt(
            f"closed before the end of the drop: what was computed is in {kept[-1]}{goes_on}"
        )
    elif isinstance(no_film, KeyboardInterrupt):
        end = KeyboardInterrupt("films may be missing")
    elif no_film is not None:
        end = RunError(f"{no_film}; the drops themselves are complete in the folders above")
    if not kept:
        assert end is not None
        raise end
    last = Result.load(kept[-1])
    _finish(
        terminal, lambda: tables.key_figures(last.scene, last.summary), last, str(kept[-1]),
        map(str, kept), _doubts([] if session.failures else [last]), end,
    )  # fmt: skip
