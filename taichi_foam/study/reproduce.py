"""The paper's nine impacts in one go: a folder with every run, tables and a report.

    import taichi_foam as tf
    tf.reproduce("reproduction", cases=["wedge-2.86"])

The folder holds report.html (self-contained), tables.csv, summary.json, figures/ and a folder a
case with the run's files and films.
"""

from __future__ import annotations

import difflib
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from taichi_foam import films as film_files
from taichi_foam import simulation
from taichi_foam.engine import runtime
from taichi_foam.errors import RunError, UserError
from taichi_foam.folders import check_output_folder, output_folder
from taichi_foam.interrupts import held_interrupts
from taichi_foam.measures import summary
from taichi_foam.paper import NAMES
from taichi_foam.progress import Bars
from taichi_foam.result import Result, storage_bytes, write_json
from taichi_foam.scene import Scene
from taichi_foam.scene_io import load_scene
from taichi_foam.study import compare, report
from taichi_foam.study.machine import machine, versions

DEFAULT_FOLDER = "reproduction"

# Room for report, tables and figures [bytes].
_REPORT_BYTES = 20_000_000


@dataclass(frozen=True)
class _Computed:
    """What the batch gave: finished runs, names of those that Ctrl-C cut, and a failure's text."""

    finished: list[Result]
    cut: list[str]
    failed: list[Result]
    failure: str | None


def case_names(cases: Sequence[str] | None) -> list[str]:
    """Full names of tests given with or without "paper/"; all nine for None.

    Raises:
        UserError: a name that no test has, or no name at all.
    """
    if cases is None:
        return list(NAMES)
    wanted = [case.strip() for case in cases if case.strip()]
    if not wanted:
        raise UserError(f"cases: none given; choose from {_listed()}")
    full = [f"paper/{case.removeprefix('paper/')}" for case in wanted]
    for given, name in zip(wanted, full, strict=True):
        if name not in NAMES:
            near = difflib.get_close_matches(name, NAMES, n=1, cutoff=0.5)
            guess = f"did you mean {near[0].removeprefix('paper/')}? " if near else ""
            raise UserError(f"cases: {given!r} is not a test; {guess}Choose from {_listed()}")
    return list(dict.fromkeys(full))


def reproduce(
    out: str | Path = DEFAULT_FOLDER,
    cases: Sequence[str] | None = None,
    *,
    choices: str = "calibrated",
    overrides: Sequence[str] = (),
    arch: str = "cpu",
    threads: int | None = None,
    overwrite: bool = False,
    films: bool = True,
    bars: Bars | None = None,
) -> dict[str, Any]:
    """Run the paper's tests side by side and write a folder with results and a report.

    Args:
        out: the folder; it appears when everything in it is complete.
        cases: names of tests, with or without "paper/"; None: all nine.
        choices: a key of `CHOICE_SETS`.
        overrides: "block.rows=10" and the like, for every case.
        arch, threads: as `engine.runtime.start`.
        overwrite: replace a folder that has content.
        films: write film.gif and film.mp4 for each case.
        bars: where progress shows; None: nowhere.

    Returns:
        The content of summary.json. Ctrl-C ends the work early: the cases that had finished are
        kept, `interrupted` is true, `not_finished` names the others.

    Raises:
        UserError: anything that cannot be; nothing has been computed or written then.
        RunError: a run failed; the folder holds what was computed.
        KeyboardInterrupt: Ctrl-C before any case had finished; nothing has been written.
    """
    begun = time.perf_counter()
    bars = bars or Bars()
    scenes = [load_scene(name, choices, overrides) for name in case_names(cases)]
    if not films:
        scenes = [_without_films(scene) for scene in scenes]
    needed = sum(storage_bytes(s) + film_files.storage_bytes(s) for s in scenes) + _REPORT_BYTES
    check_output_folder(out, overwrite, needed)
    runtime.start(arch, threads)

    computed = _compute(scenes, bars)
    with output_folder(out, overwrite) as staging:
        interrupted = _write_runs(staging, computed, bars)
        with held_interrupts():
            finished = computed.finished
            content: dict[str, Any] = {
                "cases": [compare.comparison(r.scene.name, summary(r)) for r in finished],
                "choices": choices,
                "overrides": list(overrides),
                "tolerance": compare.TOLERANCE,
                "interrupted": interrupted,
                "not_finished": computed.cut,
                "failed": [r.scene.name for r in computed.failed],
                "failure": computed.failure,
                "machine": machine(),
                "versions": versions(),
            }
            content["within_tolerance"] = compare.hits(content["cases"])
            compare.write_tables(staging / "tables.csv", content["cases"])
            report.write(staging, finished, content, bars, begun)
            content["seconds"] = {**bars.seconds, "total": time.perf_counter() - begun}
            write_json(staging / "summary.json", content)
    if computed.failure is not None:
        raise RunError(
            f"{computed.failure}\nWhat was computed is in {out}.",
            [*computed.finished, *computed.failed],
        )
    return content


def case_folder(name: str) -> str:
    """Folder of a case within the study's: "paper/wedge-2.86" has its own in wedge-2.86/."""
    return name.removeprefix("paper/")


def _listed() -> str:
    return ", ".join(case_folder(name) for name in NAMES)


def _without_films(scene: Scene) -> Scene:
    return load_scene(scene, overrides=["output.film=false", "output.frames=false"])


def _compute(scenes: Sequence[Scene], bars: Bars) -> _Computed:
    """Run all scenes as one batch and sort what comes out."""
    failure = None
    what = "1 impact" if len(scenes) == 1 else f"{len(scenes)} impacts"
    with bars.computing(what) as on_progress:
        try:
            results = simulation.run_many(scenes, on_progress)
        except RunError as error:
            results, failure = error.results, str(error)
    cut = [r.scene.name for r in results if r.run["interrupted"]]
    ended = [r for r in results if not r.run["interrupted"]]
    failed = [r for r in ended if r.run["ended_by"] not in ("rebound", "end time")]
    finished = [r for r in ended if r not in failed]
    if cut and not finished and not failed:
        raise KeyboardInterrupt("no case had finished; nothing was written")
    return _Computed(finished, cut, failed, failure)


def _write_runs(staging: Path, computed: _Computed, bars: Bars) -> bool:
    """Write the runs' files and films; return whether Ctrl-C has cut the work short."""
    results = [*computed.finished, *computed.failed]
    with held_interrupts() as pressed:
        for result in results:
            folder = staging / case_folder(result.scene.name)
            folder.mkdir()
            result.write(folder)
    if pressed.is_set() or computed.cut:
        return True
    frames = sum(map(film_files.frames_to_draw, computed.finished))
    if frames == 0:
        return False
    try:
        with bars.counting("films", "drawing films", frames, "frames") as on_frame:
            for result in computed.finished:
                film_files.write(result, staging / case_folder(result.scene.name), on_frame)
    except KeyboardInterrupt:
        return True
    return False
