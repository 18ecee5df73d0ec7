"""Determine parameters of a scene from a measured trace, with their uncertainty.

import taichi_foam as tf
done = tf.calibrate("trace.csv", "my_cushion.toml", {"foam.yield_strain": (-0.06, -0.03)})
print(done)
done.report("calibration.html")

A wave of runs over the ranges makes an emulator (`emulator`), which rules out what does not agree
with the trace (`posterior`); another wave goes into the rest, and so on. The posterior is sampled
with the last emulator, and an ensemble of runs at samples of it shows what the model predicts.
"""

from __future__ import annotations

import hashlib
import tempfile
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from taichi_foam.calibration.emulator import LEAST_RUNS, Emulator, emulator_of, spreads
from taichi_foam.calibration.outcome import Calibration
from taichi_foam.calibration.posterior import (
    DISCREPANCY,
    FAR,
    RULED_OUT,
    Posterior,
    Target,
    next_points,
    sample,
)
from taichi_foam.calibration.reading import Measured, Reader, Reading, measured_in, reading_of
from taichi_foam.calibration.runs import (
    Runs,
    computed,
    first_plan,
    joined,
    plan_at,
    runs_of,
)
from taichi_foam.calibration.space import Space, space_of
from taichi_foam.catalogue import load_scene
from taichi_foam.errors import UserError, installed, warn_of_run
from taichi_foam.formulas.traces import check_channel_class
from taichi_foam.results.folders import Claim, claimed
from taichi_foam.results.result import request_of
from taichi_foam.scene import Scene
from taichi_foam.simulation.progress import Bars

Array = NDArray[np.float64]

PREDICTIVE = 32
"""Runs at samples of the posterior."""

FIGURE_NOISE = 0.05
"""Standard deviation of a key figure, as a part of it, if none is given."""

_FEW_SAMPLES = 200  # independent ones that a 90 % interval needs

_MOST_RUNS, _MOST_WAVES = 4096, 10


def calibrate(
    trace: str | Path | tuple[Any, Any] | Measured | None,
    scene: str | Path | Scene,
    fit: Mapping[str, Sequence[Any]] | Sequence[str],
    out: str | Path | None = None,
    *,
    figures: Mapping[str, float | tuple[float, float]] | None = None,
    runs: int = 64,
    waves: int = 2,
    channel_class: int = 180,
    column: str | None = None,
    offset: float | None = None,
    noise: float | None = None,
    discrepancy: float | None = None,
    seed: int = 0,
    choices: str | None = None,
    overrides: Mapping[str, Any] | Sequence[str] = (),
    overwrite: bool = False,
    arch: str | None = None,
    threads: int | None = None,
    bars: Bars | None = None,
    solve: Any = None,
) -> Calibration:
    """Determine parameters of a scene from a measured trace, key figures, or both.

    Args:
        trace: a CSV file of time and acceleration or force; the same as two arrays (n,) of time [s]
            and deceleration [m/s2]; a `Measured`; None: only key figures.
        scene: name, file or `Scene` of the measured impact.
        fit: the ranges of the parameters, by dotted key: (low, high), or (low, high, "log").
        out: folder of the result; None: nothing is kept.
        figures: measured key figures, by name in summary.json: value, or value and standard
            deviation; without one it is `noise`, or 5 %, of the value.
        runs: runs of each wave.
        waves: number of waves; those after the first go where the trace has ruled nothing out.
        channel_class: CFC of the filter that both traces go through.
        column: header of the trace's values, or a part of it, if the file has several columns.
        offset: what the sensor shows before the impact [m/s2]; None: found in the trace.
        noise: standard deviation of the trace's samples, as a part of its peak; None: found in it.
        discrepancy: what the model may lack, as a part of the figures; None: it is estimated.
        seed: of all random numbers.
        choices, overrides: as for `run`.
        overwrite: replace a folder that holds a result.
        arch, threads: device and number of threads, as for `init`.
        bars: progress display; None: none.
        solve: function that computes scenes, instead of `simulate_many`.

    Raises:
        UserError: invalid arguments, a trace that cannot be read, ranges in which hardly any run
            succeeds; scikit-learn or emcee are not installed.
        RunError: runs could not be computed.
        KeyboardInterrupt: Ctrl-C. Complete runs are kept in `out`, and the same call goes on.
    """
    with installed("calibrating", "taichi-foam[calibrate]"):
        import emcee  # noqa: F401
        import sklearn  # noqa: F401
    bars = bars or Bars()
    _check_numbers(runs, waves, channel_class, noise, discrepancy, seed)
    base = load_scene(scene, choices, overrides)
    space = space_of(base, fit)
    known = {name: _with_deviation(name, each, noise) for name, each in (figures or {}).items()}
    measured = _measured(trace, base, column)
    if measured is None and not known:
        raise UserError("neither a trace nor a key figure is given; give one of them")
    reading = None if measured is None else reading_of(measured, channel_class, noise, offset, seed)
    scene = _for_runs(base, channel_class)
    request = {
        "command": "calibrate",
        **{f"fit.{one.key}": [one.low, one.high, one.log] for one in space.ranges},
        "trace": measured and _digest(measured),
        "figures": known,
        "runs": runs,
        "waves": waves,
        "channel_class": channel_class,
        "offset": offset,
        "noise": noise,
        "discrepancy": discrepancy,
        "seed": seed,
        **request_of(scene),
    }
    with ExitStack() as stack:
        if out is None:
            out = Path(stack.enter_context(tempfile.TemporaryDirectory())) / "calibration"
        claim = stack.enter_context(claimed(out, request, overwrite))
        how = {"arch": arch, "threads": threads, "solve": solve}
        study = _Study(claim, scene, space, reading, known, discrepancy, seed, bars, how)
        try:
            done = study.done(runs, waves)
            with bars.counting("report", "report", 1, "report") as advance:
                with claim.publishing() as staging:
                    from taichi_foam.calibration import report

                    report.write_folder(done, staging)
                advance()
        except KeyboardInterrupt:
            raise KeyboardInterrupt(
                f"the runs that are complete are in {out}; the same command goes on"
            ) from None
        claim.finish()
    for note in done.notes:
        warn_of_run(note)
    return done


@dataclass(frozen=True)
class _Study:
    """The waves of one calibration, one after the other.

    known  measured key figures and their standard deviations, by name
    given  the model discrepancy; None: it is estimated
    how    options of `sweep`
    """

    claim: Claim
    scene: Scene
    space: Space
    reading: Reading | None
    known: Mapping[str, tuple[float, float]]
    given: float | None
    seed: int
    bars: Bars
    how: Mapping[str, Any]

    @property
    def reader(self) -> Reader | None:
        """How traces are read; None: only key figures are compared."""
        return self.reading and self.reading.reader

    def done(self, count: int, waves: int) -> Calibration:
        """All waves, the posterior, and the runs that it predicts."""
        first = first_plan(self.scene, self.space, count, self.seed, [*self.known])
        parts = [self._runs("wave-1", first)]
        left: list[float] = []
        whole, before = parts[0], None
        for wave in range(2, waves + 2):
            kept, target = self._target(whole, wave, before)
            points, part = next_points(target, len(self.space), count, self.seed + wave)
            left.append(part)
            if wave > waves:
                break
            parts.append(self._runs_at(f"wave-{wave}", points, wave))
            whole, before = _near(joined(parts), len(parts[-1]), target, self.space), target
        with self.bars.counting("posterior", "posterior", 1, "chain") as advance:
            found = sample([target], len(self.space), self.given, self.seed)
            advance()
        # a chain stays where a proposal was refused: each point once, as likely as it is frequent
        points, counts = np.unique(found.unit, axis=0, return_counts=True)
        chosen = np.random.default_rng(self.seed).choice(
            len(points), PREDICTIVE, replace=False, p=counts / counts.sum()
        )
        predicted = self._runs_at("predicted", points[chosen], 0)
        names = [*(self.reader.names if self.reader else ()), *self.known]
        return Calibration(
            scene=self.scene,
            space=self.space,
            reading=self.reading,
            names=tuple(name for name, keep in zip(names, kept, strict=True) if keep),
            kept=kept,
            target=target,
            posterior=found,
            runs=tuple(parts),
            left=tuple(left),
            predicted=predicted,
            given=self.given,
            notes=tuple(self._notes(parts, left, found)),
        )

    def _runs_at(self, name: str, points: Array, seed: int) -> Runs:
        """Runs at points (n, d) of the space."""
        values = self.space.values(points)
        return self._runs(name, plan_at(self.scene, self.space, values, seed, [*self.known]))

    def _runs(self, name: str, plan: dict[str, Any]) -> Runs:
        found = computed(plan, self.claim.work / name, bars=self.bars, **self.how)
        return runs_of(found, self.space, self.reader, [*self.known])

    def _target(
        self, runs: Runs, wave: int, before: Target | None
    ) -> tuple[NDArray[np.bool_], Target]:
        """Which figures differ between runs, and these with the emulator of the runs."""
        figures = runs.figures(self.reader)
        kept = spreads(figures)
        if not kept.any():
            raise UserError(
                "no figure differs between the runs: nothing depends on these parameters. Fix: "
                "choose others, or wider ranges"
            )
        with self.bars.counting(f"emulator {wave - 1}", "emulator", 1, "emulator") as advance:
            emulator = emulator_of(self.space.unit(runs.values), figures[:, kept], self.seed)
            advance()
        found = target_of(emulator, self.reading, self.known, kept)
        tolerated = DISCREPANCY if self.given is None else self.given
        return kept, replace(found, tolerated=tolerated, before=before)

    def _notes(self, parts: Sequence[Runs], left: Sequence[float], found: Posterior) -> list[str]:
        """Remarks on the data, and on how far the result can be trusted."""
        notes = [*(self.reading.notes if self.reading else ())]
        reasons = [reason for part in parts for reason in part.failures if reason is not None]
        if reasons:
            notes.append(
                f"{len(reasons)} of {sum(map(len, parts))} runs failed, the first because: "
                f"{reasons[0].splitlines()[0]}; where runs fail, the posterior is low"
            )
        if left[-1] == 0.0:
            notes.append(
                "no point in the ranges agrees with the measurement within "
                f"{RULED_OUT:g} deviations: the ranges, the scene or the trace are wrong, or the "
                "model lacks more than was allowed for"
            )
        if found.independent < _FEW_SAMPLES:
            notes.append(
                f"the chain is worth {found.independent:.0f} independent samples only: intervals "
                "are rough"
            )
        return notes


def target_of(
    emulator: Emulator,
    reading: Reading | None,
    known: Mapping[str, tuple[float, float]],
    kept: NDArray[np.bool_],
) -> Target:
    """Measured figures, of a trace and by name, with the emulator of those that are `kept`."""
    values = np.array([value for value, _ in known.values()])
    covariance = np.diag([deviation**2 for _, deviation in known.values()])
    size = np.abs(values)
    if reading is not None:
        level = np.full(len(reading.figures) - 1, reading.level)
        size = np.concatenate([reading.figures[:1], level, size])
        values = np.concatenate([reading.figures, values])
        covariance = np.asarray(block_diag(reading.covariance, covariance), dtype=np.float64)
    return Target(emulator, values[kept], covariance[np.ix_(kept, kept)], size[kept])


def _near(runs: Runs, new: int, target: Target, space: Space) -> Runs:
    """The `new` last runs, those of earlier waves that are not far from them, and all failed ones.

    What is far away would only stretch the next emulator over figures that do not matter.
    """
    away = target.implausibility(space.unit(runs.values))
    near = (away <= FAR) | runs.failed
    near[-new:] = True
    return Runs(*(getattr(runs, each.name)[near] for each in fields(runs)))


def _for_runs(scene: Scene, channel_class: int) -> Scene:
    """The scene with rows often enough for the filter, and without what is not needed."""
    interval = min(scene.output.history_interval, 0.1 / channel_class)
    return scene.with_values({"output.history_interval": interval, "output.film": False})


def _check_numbers(
    runs: int,
    waves: int,
    channel_class: int,
    noise: float | None,
    discrepancy: float | None,
    seed: int,
) -> None:
    """Raise UserError for a number that is out of range."""
    if not LEAST_RUNS <= runs <= _MOST_RUNS:
        raise UserError(f"runs = {runs}: choose {LEAST_RUNS} to {_MOST_RUNS:,}, e.g. 64")
    if not 1 <= waves <= _MOST_WAVES:
        raise UserError(f"waves = {waves}: choose 1 to {_MOST_WAVES}")
    check_channel_class(channel_class)
    for name, part in (("noise", noise), ("discrepancy", discrepancy)):
        if part is not None and not 0 <= part <= 1:
            raise UserError(
                f"{name} = {part:g}: must be 0 to 1; it is a part of the peak, 0.05 for 5 %"
            )
    if not 0 <= seed < 2**31:
        raise UserError(f"seed = {seed}: must be 0 to {2**31 - 1}")


def _with_deviation(
    name: str, given: float | tuple[float, float], noise: float | None
) -> tuple[float, float]:
    """A key figure and its standard deviation. Raises UserError."""
    part = FIGURE_NOISE if noise is None else noise
    value, deviation = given if isinstance(given, tuple) else (given, part * abs(given))
    if not (np.isfinite(value) and np.isfinite(deviation) and deviation > 0):
        raise UserError(
            f"figure {name} = {value:g}, deviation {deviation:g}: must be finite, the deviation "
            "above 0"
        )
    return float(value), float(deviation)


def _measured(trace: Any, scene: Scene, column: str | None) -> Measured | None:
    """The trace of an argument of `calibrate`. Raises UserError: the file cannot be read."""
    if trace is None or isinstance(trace, Measured):
        return trace
    if isinstance(trace, (str, Path)):
        return measured_in(Path(trace), scene, column)
    time, deceleration = (np.asarray(each, dtype=float) for each in trace)
    return Measured(time, deceleration)


def _digest(trace: Measured) -> str:
    """Hash of a trace; 16 hexadecimal digits."""
    data = trace.time.tobytes() + trace.deceleration.tobytes()
    return hashlib.sha256(data).hexdigest()[:16]
