"""Ensembles of the paper's tests with some settings changed: their runs, and what they come to."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from hashlib import sha256
from typing import Any

from ensembles import ORDER, short
from store import Store

from taichi_foam.analysis.bands import bands
from taichi_foam.analysis.measures import PEAK, summary
from taichi_foam.catalogue import load_scene
from taichi_foam.results.result import Result
from taichi_foam.scene import Scene
from taichi_foam.scene.files import scene_to_toml
from taichi_foam.shim2000.compare import at_rest, comparison_of_medians
from taichi_foam.shim2000.criteria import criteria
from taichi_foam.shim2000.impacts import TESTS, PaperTest
from taichi_foam.shim2000.study import members_of
from taichi_foam.simulation.progress import Bars
from taichi_foam.simulation.simulate import simulate_many

JUDGED = (*ORDER, PEAK)
"""The figures that are kept of a run, as far as they were measured in its test ..."""

TITLES = ("duration", "displacement", "plateau", "energy/volume", "initial peak")
"""... and their titles in tables and pictures."""

Kept = Mapping[str, Any]
"""What is kept of runs, by their names: `figures`, and by key which `criteria` hold."""

Entry = dict[str, Any]
"""A test's medians beside what was measured, as in `cases` of a study's summary.json."""


@dataclass(frozen=True)
class Ensemble:
    """A test with settings changed from the calibrated ones, at several velocities."""

    test: str
    overrides: tuple[str, ...]
    velocities: int

    @property
    def members(self) -> dict[str, Scene]:
        """Its scenes, by the names under which their runs are kept."""
        return _members(self)

    def runs(self, kept: Kept) -> list[Any]:
        """What is kept of its runs; [] unless all have ended."""
        found = [kept.get(name) for name in self.members]
        return found if all(found) else []


@cache
def _members(ensemble: Ensemble) -> dict[str, Scene]:
    """Scenes of an ensemble. Pages ask for equal ones again and again, and drawing up is slow."""
    scene = load_scene(ensemble.test, "calibrated", ensemble.overrides)
    return {_run_name(member): member for member in members_of(scene, ensemble.velocities)}


def compute(part: str, ensembles: Sequence[Ensemble], store: Store, bars: Bars) -> None:
    """Run what is not kept yet, all side by side; each run is kept as it ends."""
    asked = {name: (each.test, scene) for each in ensembles for name, scene in each.members.items()}
    missing = [(name, *rest) for name, rest in asked.items() if name not in store.part(part)]
    if not missing:
        return
    with bars.computing(f"{part}: {len(missing)} impacts") as on_progress:
        for place, result in simulate_many([scene for *_, scene in missing], on_progress):
            name, test, _ = missing[place]
            store.keep(part, name, figures_of(result, TESTS[test]))


def entry(ensemble: Ensemble, kept: Kept) -> Entry | None:
    """The ensemble's medians and their errors; None unless all its runs have ended."""
    runs = ensemble.runs(kept)
    if not runs:
        return None
    return comparison_of_medians(
        ensemble.test,
        TESTS[ensemble.test].reference,
        bands([run["figures"] for run in runs]),
        runs=len(runs),
    )


def shares(ensemble: Ensemble, kept: Kept) -> dict[str, float]:
    """Which share of the runs meets each of the test's criteria; one that failed meets none."""
    runs = ensemble.runs(kept)
    keys = dict.fromkeys(key for run in runs for key in run["criteria"])
    return {key: sum(run["criteria"].get(key, False) for run in runs) / len(runs) for key in keys}


def _run_name(scene: Scene) -> str:
    """The test, and a digest of every setting: another calibration does not take old runs."""
    assert scene.impactor is not None  # every test has one
    bare = scene.model_copy(update={"reference": None})
    digest = sha256(scene_to_toml(bare).encode()).hexdigest()[:12]
    return f"{short(scene.name)} at {scene.impactor.velocity:.4f} m/s, {digest}"


def figures_of(result: Result, test: PaperTest) -> dict[str, Any]:
    """What is kept of a run. One that failed has no answers.

    It is judged as `test` even if its settings make it another impact: that is what a study of
    readings such as another yield strain is for.
    """
    measured = test.measured
    keys = [quantity.key for quantity in JUDGED if quantity.key in measured]
    if result.failure:
        return {"figures": dict.fromkeys(keys), "criteria": {}, "failed": result.run["ended_by"]}
    found = at_rest(summary(result))
    return {
        "figures": {key: _rounded(found[key]) for key in keys},
        "criteria": {each.key: bool(each.holds) for each in criteria(result, test)},
    }


def _rounded(value: float | None) -> float | None:
    return None if value is None else float(f"{value:.6g}")
