"""The paper's nine impacts in one go: a folder with every run, tables and a report.

    import taichi_foam as tf
    tf.reproduce("reproduction", cases=["wedge-2.86"])
    tf.reproduce("medians", ensemble=16)

What the folder holds is in docs/architecture.md, among the files.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from taichi_foam.analysis.bands import bands
from taichi_foam.catalogue import title
from taichi_foam.engine import runtime
from taichi_foam.errors import RunError, warn_of_run
from taichi_foam.interrupts import held_interrupts
from taichi_foam.picture import films as film_files
from taichi_foam.results import manifest
from taichi_foam.results.files import write_json
from taichi_foam.results.folders import Claim, claimed
from taichi_foam.results.result import storage_bytes
from taichi_foam.scene.values import settings
from taichi_foam.shim2000 import compare, report, study
from taichi_foam.shim2000.impacts import brief, case_names, paper_scene
from taichi_foam.shim2000.scores import judged, scores
from taichi_foam.shim2000.study import Case, Computed
from taichi_foam.simulation.progress import Bars
from taichi_foam.simulation.provenance import machine, versions

# Disk space for report, tables and figures [bytes].
_REPORT_BYTES = 20_000_000


def reproduce(
    out: str | Path = "reproduction",
    cases: Sequence[str] | None = None,
    *,
    ensemble: int | None = None,
    choices: str = "calibrated",
    overrides: Mapping[str, Any] | Sequence[str] = (),
    arch: str | None = None,
    threads: int | None = None,
    overwrite: bool = False,
    films: bool = True,
    bars: Bars | None = None,
) -> dict[str, Any]:
    """Run the paper's tests side by side and write a folder with results and a report.

    Args:
        out: the folder; it appears when its content is complete.
        cases: names of tests, with or without "paper/"; None: all nine.
        ensemble: number of runs of each test, 2 to 100, with velocities within 0.5 %, and with
            different strengths if the foam's strength scatters; the tables then contain medians and
            bands. None: each test once.
        choices: a key of `CHOICE_SETS`.
        overrides: values by dotted key for every case, as for `Scene.with_values`; or texts such
            as "block.rows=10".
        arch, threads: device and number of threads, as for `init`.
        overwrite: replace a folder that has content.
        films: write film.gif and film.mp4 for each case.
        bars: progress display; None: none.

    Returns:
        The content of summary.json. Ctrl-C ends the work early: finished runs are kept,
        `interrupted` is true, and `not_finished` names the cases without a finished run. The same
        call continues from there, also after the process was killed.

    Raises:
        UserError: invalid arguments; nothing has been computed or written.
        RunError: a run failed; the folder holds what was computed.
        KeyboardInterrupt: Ctrl-C before any run had finished.
    """
    begun = time.perf_counter()
    bars = bars or Bars()
    if ensemble is not None:
        study.check(ensemble)
    values = settings(overrides)
    scenes = [paper_scene(name, choices).with_values(values) for name in case_names(cases)]
    if not films:
        scenes = [s.with_values(output__film=False, output__frames=False) for s in scenes]
    pictures = sum(map(film_files.storage_bytes, scenes)) + _REPORT_BYTES
    needed = (ensemble or 1) * sum(map(storage_bytes, scenes)) + pictures
    request = {
        "command": "reproduce",
        "cases": [scene.name for scene in scenes],
        "ensemble": ensemble,
        "choices": choices,
        "films": films,
        **values,
    }
    with claimed(out, request, overwrite, needed) as claim:
        runtime.start(arch, threads)
        computed = study.compute(scenes, ensemble, bars, claim)
        content = _content(computed, ensemble) | {
            "choices": choices,
            "overrides": [f"{key}={value}" for key, value in values.items()],
            "interrupted": computed.interrupted,
            "machine": machine(),
            "versions": versions(),
        }
        no_films = _written(claim, computed, content, bars, begun)
        if not content["interrupted"]:
            claim.finish()
    if ensemble is not None and content["warnings"]:  # for single runs, simulate has warned already
        warn_of_run("\n  ".join(("reproduce:", *content["warnings"])))
    if computed.failure is not None:
        raise RunError(
            f"{computed.failure}\nWhat was computed is in {out}.",
            [*(case.result for case in computed.cases), *computed.failed],
        )
    if isinstance(no_films, Exception):
        raise RunError(f"{no_films}; all but the films is in {out}")
    return content


def _written(
    claim: Claim, computed: Computed, content: dict[str, Any], bars: Bars, begun: float
) -> BaseException | None:
    """Write figures, films and report, and update `content`.

    Returns the error that prevented films, if any.
    """
    # figures first: whatever happens to films and report, they are safe
    with held_interrupts() as pressed, claim.publishing() as staging:
        _write_runs(staging, computed)
        compare.write_tables(staging / "tables.csv", content["cases"])
        if content["ensemble"] is not None:
            study.write_members(staging / "members.csv", computed.cases)
        write_json(staging / "summary.json", content)
    no_films = None
    if not (pressed.is_set() or computed.interrupted):
        no_films = _draw_films(claim.folder, computed, bars)
    cut = pressed.is_set() or isinstance(no_films, KeyboardInterrupt)
    content["interrupted"] = content["interrupted"] or cut
    with held_interrupts(), claim.publishing() as staging:
        report.write(staging, computed.cases, content, bars, begun, with_films=not no_films)
        content["seconds"] = {**bars.seconds, "total": time.perf_counter() - begun}
        write_json(staging / "summary.json", content)
    return no_films


def _content(computed: Computed, runs: int | None) -> dict[str, Any]:
    """The content of summary.json; `runs` is the requested number of runs per test."""
    entries = [_entry(case) for case in computed.cases]
    return {
        "cases": entries,
        "ensemble": None if runs is None else scores(entries, runs),
        "criteria": judged(computed.cases),
        "tolerance": compare.TOLERANCE,
        "within_tolerance": compare.hits(entries),
        "not_finished": computed.cut,
        "failed": [result.scene.name for result in computed.failed],
        "failure": computed.failure,
        "warnings": [text for case in computed.cases for text in _warnings(case)],
    }


def _entry(case: Case) -> dict[str, Any]:
    reference = case.test and case.test.reference
    if not case.members:
        return compare.comparison(case.name, reference, case.figures)
    found = bands([compare.at_rest(member.figures) for member in case.members])
    return compare.comparison_of_medians(case.name, reference, found, len(case.members))


def _warnings(case: Case) -> list[str]:
    """Warnings of a case's runs, with the case's name; each warning of its members once."""
    if not case.members:
        return [f"{brief(case.name)}: {text}" for text in case.figures["warnings"]]
    doubtful = [member for member in case.members if member.figures["warnings"]]
    if not doubtful:
        return []
    worst = max(doubtful, key=lambda member: len(member.figures["warnings"]))
    return [
        f"{brief(case.name)}: {len(doubtful)} of {len(case.members)} runs are doubtful, "
        f"such as that at {worst.velocity:.4g} m/s: {text}"
        for text in worst.figures["warnings"]
    ]


def _write_runs(staging: Path, computed: Computed) -> None:
    """Write each run's files into a folder of its own."""
    for result in [*(case.result for case in computed.cases), *computed.failed]:
        folder = staging / brief(result.scene.name)
        folder.mkdir()
        result.write(folder)


def _draw_films(out: Path, computed: Computed, bars: Bars) -> BaseException | None:
    """Draw the films of the saved runs; returns the error that prevented it, if any."""
    results = [case.result for case in computed.cases]
    reels = [film_files.Reel.of(result, title(result.scene)) for result in results]
    frames = sum(reel.frames_to_draw() for reel in reels)
    if frames == 0:
        return None
    try:
        with (
            bars.counting("films", "drawing films", frames, "frames") as on_frame,
            ExitStack() as test_before,
        ):
            for result, reel in zip(results, reels, strict=True):
                folder, films = out / brief(result.scene.name), ExitStack()
                drawn = films.enter_context(reel.drawn(folder, on_frame))
                # the films of the test before were encoded while these were drawn
                test_before.close()
                test_before.callback(_finish_films, films, folder, drawn)
    except (Exception, KeyboardInterrupt) as error:
        return error
    return None


def _finish_films(films: ExitStack, folder: Path, paths: Sequence[Path]) -> None:
    films.close()
    manifest.add(folder, [path.name for path in paths])
