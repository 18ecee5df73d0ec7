"""Do the intervals of `calibrate` hold the truth? `python validation/calibration.py`.

Synthetic traces, each with other parameters drawn from the ranges, another seed of the foam's
strengths, and 5 % noise: 90 % intervals should hold the truth in 90 % of the cases, and a parameter
without influence should be flagged each time. There are two cases: a cushion that springs back,
whose trace determines most parameters, and a small block that breaks, whose traces scatter from
seed to seed. All traces of a case share one wave of runs, since it depends on the scene and the
ranges only; each posterior is that of a calibration with one wave. The traces come from the model,
so its discrepancy is 0.

With --paper instead: friction and the shear coefficient from the paper's nine tests.
"""

from __future__ import annotations

import json
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from pages import RESULTS
from rich.console import Console
from store import Smoke

from taichi_foam.calibration.calibrate import FIGURE_NOISE, target_of
from taichi_foam.calibration.emulator import emulator_of, spreads
from taichi_foam.calibration.outcome import parameters_of
from taichi_foam.calibration.posterior import Target, sample
from taichi_foam.calibration.reading import Measured, reading_of
from taichi_foam.calibration.runs import computed, first_plan, plan_at, runs_of, traces_of
from taichi_foam.calibration.space import Space, space_of
from taichi_foam.catalogue import load_scene
from taichi_foam.cushions.scenes import cushion_scene
from taichi_foam.results.files import write_json
from taichi_foam.scene import Scene
from taichi_foam.shim2000.impacts import case_names, paper_scene
from taichi_foam.simulation.progress import Bars

FOAM = Path(__file__).parents[1] / "scenes" / "own_foam.csv"


@dataclass(frozen=True)
class Case:
    """What traces are made and calibrated with.

    scene   of the impact
    fit     ranges of the parameters [SI]
    idle    the parameter without influence; None: each has one
    length  compared time [s]: the same for all traces, so that they share an emulator
    """

    scene: Scene
    fit: Mapping[str, tuple[Any, ...]]
    idle: str | None
    length: float


def springs_back() -> Case:
    """A cushion whose foam gives energy back; how it recovers later does not matter in one drop."""
    foam = {"law": "recovering", "curve": str(FOAM), "gas_pressure": 1e5, "strength_scatter": 0.1}
    return Case(
        cushion_scene(foam, 0.05, 0.76, 4e3),
        {
            "foam.hysteresis_factor": (0.1, 0.8),
            "foam.gas_pressure": (0.0, 2e5),
            "impactor.drop_height": (0.7, 0.82),
            "foam.recovery_time": (1.0, 1000.0, "log"),
        },
        "foam.recovery_time",
        0.025,
    )


def breaks(**more: Any) -> Case:
    """A flat cushion of 0.06 x 0.1 m that is crushed to about a third, and breaks.

    At 80 % its few cells would fall apart, and chaos would hide what the parameters do.
    """
    small = {
        "block.width": 0.06, "block.columns": 6, "block.rows": 10, "impactor.mass": 2.4,
        "foam.strength_scatter": 0.1, "output.film": False,
    }  # fmt: skip
    return Case(
        load_scene("paper/rectangular-3.03", None, {**small, **more}),
        {
            "foam.yield_strain": (-0.06, -0.04),
            "impactor.velocity": (2.8, 3.3),
            "impactor.friction": (0.0, 0.4),
        },
        None,
        0.06,
    )


STEPS = 300  # of each chain
NOISE, CHANNEL_CLASS = 0.05, 180
BEFORE, AFTER = 0.02, 0.02  # s of the trace before the impact, and after its end
SEED = 2029  # of the truths

PAPER_FIT = {"impactor.friction": (0.0, 0.4), "model.shear_pressure_coefficient": (0.2, 1.2)}
PAPER_FIGURES = ("impact_duration_s", "max_displacement_m", "plateau_deceleration_m_s2")
"""The figures that Tables 2 to 4 give of all nine tests."""


def main(
    traces: Annotated[int, typer.Option(help="Synthetic traces.")] = 50,
    runs: Annotated[int, typer.Option(help="Runs of the wave, or of that of each test.")] = 96,
    paper: Annotated[bool, typer.Option("--paper", help="The paper's nine tests instead.")] = False,
    out: Annotated[str | None, typer.Option(help="Folder that keeps the runs.")] = None,
    threads: Annotated[int | None, typer.Option(help="CPU threads.")] = None,
    smoke_test: Smoke = False,
) -> None:
    """Print what came out, and keep it in results/."""
    if smoke_test:
        smoke()
        return
    bars = Bars(Console(stderr=True))
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(out or temporary)
        how = {"threads": threads, "bars": bars}
        if paper:
            found = {"paper": of_paper(folder, runs, how)}
        else:
            found = {
                case.__name__: coverage(case(), folder / case.__name__, traces, runs, how, bars)
                for case in (springs_back, breaks)
            }
    name = "calibration-paper" if paper else "calibration"
    write_json(RESULTS / f"{name}.json", found)
    print(json.dumps({case: each["summary"] for case, each in found.items()}, indent=2))


def smoke() -> None:
    """Two traces and a coarse wave, with kernels that come with the package."""
    with tempfile.TemporaryDirectory() as temporary:
        how = {"threads": None, "bars": Bars()}
        coverage(breaks(**{"foam.strength_scatter": 0.0}), Path(temporary), 2, 16, how, Bars())


def coverage(
    case: Case, folder: Path, traces: int, runs: int, how: dict[str, Any], bars: Bars
) -> dict[str, Any]:
    """How often intervals hold the truth, and which parameters are flagged."""
    scene = case.scene
    space = space_of(scene, case.fit)
    wave = computed(first_plan(scene, space, runs, 0), folder / "wave", **how)
    random = np.random.default_rng(SEED)
    truths = space.values(random.random((traces, len(space))))
    made = computed(plan_at(scene, space, truths, 1), folder / "truths", **how)
    rows, emulators = [], {}
    with bars.counting("posteriors", "posteriors", traces, "traces") as advance:
        for number, (time, deceleration) in traces_of(made).items():
            # a sensor shows nothing in free fall
            trace = noisy(time, deceleration + scene.numerics.gravity, number)
            reading = reading_of(trace, CHANNEL_CLASS, NOISE, seed=number, length=case.length)
            if reading.reader not in emulators:
                seen = runs_of(wave, space, reading.reader, ())
                figures = seen.figures(reading.reader)
                kept = spreads(figures)
                emulators[reading.reader] = (
                    emulator_of(space.unit(seen.values), figures[:, kept]), kept,
                )  # fmt: skip
            emulator, kept = emulators[reading.reader]
            target = target_of(emulator, reading, {}, kept)
            posterior = sample([target], len(space), 0.0, seed=number, most=STEPS)
            rows += [
                {
                    "trace": number,
                    "parameter": each.key,
                    "truth": truth,
                    "low": each.low,
                    "high": each.high,
                    "width": each.width,
                    "verdict": each.verdict,
                    "holds": each.low <= truth <= each.high,
                }
                for each, truth in zip(parameters_of(space, posterior), truths[number], strict=True)
            ]
            advance()
            if number % 10 == 9:
                held = summed(rows, space, case.idle)["90 % intervals that hold the truth"]
                bars.say(f"{number + 1} traces: {100 * held:.0f} % of the intervals hold the truth")
    return {"summary": summed(rows, space, case.idle), "intervals": rows}


def noisy(time: np.ndarray, deceleration: np.ndarray, seed: int) -> Measured:
    """A trace as a recorder would give it: begun before the impact, and with noise."""
    step = float(np.median(np.diff(time)))
    middle = 0.5 * (time[1:] + time[:-1])
    before = np.arange(middle[0] - BEFORE, middle[0] - 0.5 * step, step)
    after = middle[-1] + step * np.arange(1, round(AFTER / step))
    values = np.concatenate([np.zeros(len(before)), deceleration[1:], np.zeros(len(after))])
    random = np.random.default_rng([seed, 1])
    values = values + random.normal(scale=NOISE * values.max(), size=len(values))
    return Measured(np.concatenate([before, middle, after]), values)


def summed(rows: list[dict[str, Any]], space: Space, idle: str | None) -> dict[str, Any]:
    """Shares, by parameter and over those that have an influence."""
    told = [row for row in rows if row["parameter"] != idle]
    found: dict[str, Any] = {
        "90 % intervals that hold the truth": np.mean([r["holds"] for r in told])
    }
    for key in space.keys:
        own = [row for row in rows if row["parameter"] == key]
        found[key] = {
            "holds": np.mean([row["holds"] for row in own]),
            "median width over prior": np.median([row["width"] for row in own]),
            "flagged": np.mean([row["verdict"] == "not determined" for row in own]),
        }
    return json.loads(json.dumps(found, default=float))


def of_paper(folder: Path, runs: int, how: dict[str, Any]) -> dict[str, Any]:
    """Friction and the shear coefficient from the figures of all nine tests together."""
    targets = []
    for name in case_names(None):
        scene = paper_scene(name)
        space = space_of(scene, PAPER_FIT)
        found = computed(
            first_plan(scene, space, runs, 0, PAPER_FIGURES), folder / name.replace("/", "-"), **how
        )
        assert scene.reference is not None
        given = scene.reference.figures
        known = {key: (given[key], FIGURE_NOISE * given[key]) for key in PAPER_FIGURES}
        seen = runs_of(found, space, None, PAPER_FIGURES)
        emulator = emulator_of(space.unit(seen.values), seen.measures)
        kept = spreads(seen.measures)
        targets.append((name, target_of(emulator, None, known, kept)))
    return {"summary": posterior_of(targets)}


def posterior_of(targets: list[tuple[str, Target]]) -> dict[str, Any]:
    """Intervals from all tests, and from each alone."""
    space = space_of(paper_scene("paper/wedge-2.86"), PAPER_FIT)
    groups = {"all": [target for _, target in targets]}
    for shape in ("rectangular", "wedge", "cylinder"):
        groups[shape] = [target for name, target in targets if shape in name]
    found: dict[str, Any] = {}
    for group, chosen in groups.items():
        posterior = sample(chosen, len(space), None)
        found[group] = {
            each.key: {"low_5": each.low, "median": each.median, "high_95": each.high,
                       "width": each.width, "verdict": each.verdict}
            for each in parameters_of(space, posterior)
        }  # fmt: skip
        low, high = np.quantile(posterior.discrepancy, (0.05, 0.95))
        found[group]["model discrepancy"] = {"low_5": float(low), "high_95": float(high)}
    return found


if __name__ == "__main__":
    typer.run(main)
