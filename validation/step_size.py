"""The automatic step against Table 6's: `python validation/step_size.py`.

Three questions. How many steps fewer? Do the figures of the nine tests differ by more than chance?
And how far apart are the histories before anything breaks, when there is no chance yet?

With 1e-7 s an impact has some 500,000 steps, half a minute of one core: the whole takes half an
hour on two. Ctrl-C keeps the tests that are done.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated, Any

import numpy as np
import typer
from ensembles import COARSE, ORDER, full_names, median_and_range, short
from pages import FIGURES, RESULTS, Page, headed, table
from rich.console import Console
from scipy.stats import mannwhitneyu
from store import Out, Smoke, leave

from taichi_foam.analysis.measures import Quantity, summary
from taichi_foam.catalogue import load_scene
from taichi_foam.results.result import Result
from taichi_foam.scene import Scene
from taichi_foam.shim2000.compare import at_rest
from taichi_foam.shim2000.impacts import TESTS
from taichi_foam.shim2000.study import WITHIN, faster
from taichi_foam.simulation.progress import Bars
from taichi_foam.simulation.simulate import run, simulate_many
from taichi_foam.sweeps.sampling import factors

FINE = 1e-7  # s, Table 6
STEPS = ("auto", "fine")

# Before anything breaks: what is compared, as the history has it.
COLUMNS = (
    "displacement_m", "velocity_m_s", "deceleration_smoothed_m_s2", "contact_force_N",
    "impactor_kinetic_J", "foam_kinetic_J", "strain_J", "crushing_J", "shearing_J", "damping_J",
    "friction_J", "contact_J",
)  # fmt: skip
SCOUTED = 5e-3  # s: by then every test has broken something
ROWS_EVERY = 10  # automatic steps
REFINED = (1, 2)  # the automatic step, and half of it


Figures = dict[str, Any]
"""The content of a run's summary.json, and `simulated_s`, how long the run was."""


@dataclass
class Test:
    """What one test has given: figures by step and by the velocity's factor, and deviations."""

    name: str
    fine: float = FINE  # s
    settings: tuple[str, ...] = ()  # of the scene, beyond the test's own
    scouted_every: float = 1e-5  # s: more than two automatic steps, or they are cut to fit
    single: dict[str, Figures] = field(default_factory=dict)
    ensemble: dict[str, list[Figures]] = field(default_factory=lambda: {"auto": [], "fine": []})
    first_failure: float = math.nan  # s
    # by how many times the step was refined, and by column: the largest, and the median row's
    deviations: dict[int, dict[str, tuple[float, float]]] = field(default_factory=dict)

    def scene(self, values: Mapping[str, object], factor: float = 1.0) -> Scene:
        """The test with other values by key, and its velocity times a factor."""
        settings = [*self.settings, *(f"{key}={value}" for key, value in values.items())]
        return faster(load_scene(self.name, "calibrated", settings), factor)


def impacts(test: Test, counts: dict[str, int], bars: Bars) -> None:
    """Run the test itself and its ensembles with either step."""
    runs = [(step, None) for step in STEPS]
    runs += [(step, factor) for step in STEPS for factor in factors(counts[step], WITHIN)]
    steps = {"auto": "auto", "fine": repr(test.fine)}
    scenes = [test.scene({"numerics.dt": steps[step]}, f or 1.0) for step, f in runs]
    with bars.computing(f"{short(test.name)}: {len(runs)} runs") as on_progress:
        for place, result in simulate_many(scenes, on_progress):
            if result.failure:
                raise RuntimeError(f"{result.scene.name}: ended by {result.run['ended_by']}")
            figures = at_rest(summary(result))
            figures["simulated_s"] = float(result.history["time_s"][-1])
            step, factor = runs[place]
            if factor is None:
                test.single[step] = figures
            else:
                test.ensemble[step].append(figures)


def before_failure(test: Test) -> None:
    """How far the histories are from those of 1e-7 s, relative to each column's largest value.

    Until something breaks the automatic step is constant: nothing is densified yet. Rows are asked
    for at multiples of it, and the other steps divide it, so that all have rows at the same
    instants; the fine one is the largest of these that is not above 1e-7 s.
    """
    scout = _until(test, "auto", SCOUTED, test.scouted_every).history
    failed = np.flatnonzero(scout["broken_bonds"])
    last = failed[0] - 1
    test.first_failure = float(scout["time_s"][failed[0]])
    step = scout["dt_s"][0]
    assert np.all(scout["dt_s"][: last + 1] == step)
    # a little less than a multiple: sums of steps may fall short of it by rounding
    interval = ROWS_EVERY * step * (1.0 - 1e-9)
    end = float(scout["time_s"][last])
    fine = _until(test, step / math.ceil(step / test.fine), end, interval)
    for parts in REFINED:
        given = "auto" if parts == 1 else step / parts
        coarse = _until(test, given, end, interval)
        test.deviations[parts] = _deviations(coarse, fine)


def _until(test: Test, dt: float | str, end: float, interval: float) -> Result:
    values = {"numerics.dt": dt, "numerics.end": end, "output.history_interval": interval}
    return run(test.scene(values))


def _deviations(result: Result, exact: Result) -> dict[str, tuple[float, float]]:
    one, two = result.history, exact.history
    # the last row is that of the run's end, which need not be the same instant
    rows = min(np.count_nonzero(h["broken_bonds"][:-1] == 0.0) for h in (one, two))
    np.testing.assert_allclose(one["time_s"][:rows], two["time_s"][:rows], rtol=0.0, atol=1e-12)
    found = {}
    for name in COLUMNS:
        coarse, fine = one[name][:rows], two[name][:rows]
        apart = np.abs(coarse - fine) / np.abs(fine).max()
        found[name] = float(apart.max()), float(np.median(apart))
    return found


def page(tests: list[Test], counts: dict[str, int]) -> str:
    """All tables, as Markdown."""
    done = [test for test in tests if test.single]
    compared = [test for test in tests if test.deviations]
    parts = []
    if done:
        parts += ["## Steps\n", _steps_table(done), "## Figures of the tests\n"]
        parts += [
            "Single runs of the tests, and medians (ranges in brackets) of runs with velocities "
            f"within {100 * WITHIN:g} %: {counts['auto']} with the automatic step, "
            f"{counts['fine']} with 1e-7 s. The last column says how often the same distribution "
            "would give two such ensembles or more different ones (Mann and Whitney's test of "
            "ranks): of 36, some two below 5 % are to be expected.\n"
        ]
        parts += [text for q in ORDER for text in (f"### {q.label}, {q.unit}\n", _figures(done, q))]
    if compared:
        parts += ["## Before anything breaks\n", _explained(compared), _deviations_table(compared)]
    return headed("The automatic step against 1e-7 s", "step_size.py", parts)


def _steps_table(tests: list[Test]) -> str:
    rows = []
    for test in tests:
        auto, fine = (test.single[step] for step in ("auto", "fine"))
        taken = f"{1e6 * auto['dt_min_s']:.2f} to {1e6 * auto['dt_max_s']:.2f}"
        ratio = (fine["steps"] / _seconds(fine)) / (auto["steps"] / _seconds(auto))
        rows.append(
            [short(test.name), f"{auto['steps']:,}", taken, f"{fine['steps']:,}", f"{ratio:.1f}"]
        )
    header = ["test", "automatic: steps", "their size, µs", "1e-7 s: steps"]
    return table([*header, "fewer steps per simulated time"], rows)


def _seconds(figures: Figures) -> float:
    return float(figures["simulated_s"])


def _figures(tests: list[Test], quantity: Quantity) -> str:
    header = ["test", "measured", "single, automatic", "single, 1e-7 s", "automatic", "1e-7 s"]
    rows = []
    for test in tests:
        spread = {s: [run[quantity.key] for run in test.ensemble[s]] for s in STEPS}
        rows.append(
            [
                short(test.name),
                quantity.text(TESTS[test.name].measured[quantity.key]),
                *(quantity.text(test.single[step][quantity.key]) for step in STEPS),
                *(_spread_text(spread[step], quantity) for step in STEPS),
                _chance(spread["auto"], spread["fine"]),
            ]
        )
    return table([*header, "by chance"], rows)


def _spread_text(values: list[float | None], quantity: Quantity) -> str:
    if not values:
        return ""
    found = median_and_range(values)
    least, middle, largest = (quantity.text(x if math.isfinite(x) else None) for x in found)
    return f"{middle} ({least} to {largest})"


def _chance(one: list[float | None], other: list[float | None]) -> str:
    """How often samples of one and the same distribution rank at least as differently."""
    if not one or not other:
        return ""
    first, second = ([math.inf if x is None else x for x in values] for values in (one, other))
    return f"{100 * mannwhitneyu(first, second).pvalue:.0f} %"


def _explained(tests: list[Test]) -> str:
    earliest, latest = (1e3 * f(t.first_failure for t in tests) for f in (min, max))
    return (
        f"Until the first bond breaks, after {earliest:.1f} to {latest:.1f} ms: the largest "
        "difference of any row from the history with 1e-7 s, that of the median row in brackets, "
        "and the largest with half the automatic step. Relative to the largest value of the "
        "column; the worst of the tests with that impactor.\n"
    )


def _deviations_table(tests: list[Test]) -> str:
    shapes = list(dict.fromkeys(short(test.name).split()[0] for test in tests))
    rows = []
    for name in COLUMNS:
        cells = []
        for shape in shapes:
            found = [test.deviations for test in tests if short(test.name).startswith(shape)]
            whole, half = (
                np.max([each[parts][name] for each in found], axis=0) for parts in REFINED
            )
            cells.append(f"{whole[0]:.0e} ({whole[1]:.0e}), {half[0]:.0e}")
        rows.append([f"`{name}`", *cells])
    return table(["column", *shapes], rows)


def _raw(tests: list[Test]) -> dict[str, dict[str, dict[str, list[float | None]]]]:
    """The figures of every run, in SI units: by test, step and figure, the single run's first."""
    return {
        test.name: {
            step: {
                quantity.key: [
                    run[quantity.key] for run in (test.single[step], *test.ensemble[step])
                ]
                for quantity in ORDER
            }
            for step in test.single
        }
        for test in tests
    }


def smoke() -> None:
    """A coarse, short impact, 1e-6 s for the fine step, and its tables: whether it all still works.

    Raises AssertionError or whatever goes wrong; writes nothing.
    """
    coarse = (*COARSE, "numerics.end=8e-3")
    test = Test("paper/wedge-2.86", fine=1e-6, settings=coarse, scouted_every=4e-5)
    counts = {"auto": 2, "fine": 2}
    before_failure(test)
    impacts(test, counts, Bars())
    text = page([test], counts)
    assert all(title in text for title in ("## Steps", "## Figures", "## Before anything breaks"))
    json.dumps(_raw([test]))


def main(
    cases: Annotated[
        str | None, typer.Option(help="Tests, as in wedge-2.86,cylinder-3.32.")
    ] = None,
    velocities: Annotated[int, typer.Option(min=0, help="Velocities of each ensemble.")] = 8,
    fine: Annotated[int, typer.Option(min=0, help="The same with 1e-7 s.")] = 8,
    impacts_too: Annotated[bool, typer.Option("--impacts/--no-impacts")] = True,
    out: Out = RESULTS / "step_size.md",
    smoke_test: Smoke = False,
) -> None:
    """Compare both steps and write the tables."""
    if smoke_test:
        smoke()
        return
    bars = Bars(Console(highlight=False))
    counts = {"auto": velocities, "fine": fine}
    tests = [Test(name) for name in full_names(cases)]
    interrupted = False
    try:
        with bars.counting("before", "before anything breaks", len(tests), "tests") as on_test:
            for test in tests:
                before_failure(test)
                on_test()
        for test in tests if impacts_too else []:
            impacts(test, counts, bars)
    except KeyboardInterrupt:
        interrupted = True
    # a test that was cut short is left out
    for test in tests:
        if any(len(test.ensemble[step]) < counts[step] for step in STEPS) or len(test.single) < 2:
            test.single.clear()
    text = page(tests, counts)
    Page(out, FIGURES).write(text)
    out.with_suffix(".json").write_text(json.dumps(_raw(tests), indent=1), encoding="utf-8")
    bars.say(text)
    leave(bars, out, not interrupted)


if __name__ == "__main__":
    typer.run(main)
