"""Three of the paper's impacts in ever smaller cells, alone and in ensembles.

Strength as the paper has it is a strain. A crack then costs the energy of the bonds that it
breaks, (K e_t^2 / 2) times the cell's size: it falls with the cells. `scaled` strains grow with one
over the square root of the cell's size, which keeps that energy (Bazant and Oh 1983, Materials and
Structures 16:155, for a law without softening); at 5 mm both are the same.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import asdict, dataclass

import numpy as np

from taichi_foam.analysis.measures import summary
from taichi_foam.errors import RunError
from taichi_foam.laws.bond.base import OPENING, SLIDING
from taichi_foam.results.result import Result
from taichi_foam.scene import Base, Foam, Model, Scene
from taichi_foam.shim2000.impacts import paper_scene
from verification.runs import whole

CASES = ("rectangular-3.03", "cylinder-2.94", "wedge-2.86")
CELLS = (0.010, 0.005, 0.0025, 0.00125)  # m
STRENGTHS = ("strain", "scaled")
REFERENCE = 0.005  # m, the paper's cells
WITHIN = 0.005
# Of the velocity, the test's own first: by the cells, as far as they are quick to compute.
FACTORS = tuple(1.0 + WITHIN * step for step in (0.0, -1.0, 1.0, -0.5, 0.5))
RUNS = {0.010: 5, 0.005: 5, 0.0025: 3, 0.00125: 1}
KEPT_EVERY = 2.5e-4  # s: rows of the histories that are kept

# All that decides a result, so that it does not change with the package's defaults.
MODEL = Model(
    shear_failure="pressure-dependent",
    shear_pressure_coefficient=18.0,
    broken_contact="reload",
    self_contact=True,
)
FRICTION = 0.15
TENSILE, SHEAR = 0.05, 0.10

FIGURES = (
    "impact_duration_s",
    "max_displacement_m",
    "plateau_deceleration_m_s2",
    "energy_per_volume_J_m3",
    "crushed_width_m",
    "crushed_height_m",
    "crack_lowest_height_m",
    "pieces",
    "steps",
    "energy_residual",
)


@dataclass(frozen=True)
class Impact:
    """One run."""

    case: str
    cell: float  # m
    strength: str
    factor: float = 1.0  # of the velocity

    @property
    def name(self) -> str:
        return f"{self.case}, {1e3 * self.cell:g} mm, {self.strength}, {self.factor:.4f}"


def impacts() -> Iterator[Impact]:
    """All runs, the quick ones first: an ensemble for each cell, of the finest one run."""
    for cell in CELLS:
        for strength in STRENGTHS if cell != REFERENCE else STRENGTHS[:1]:
            for case in CASES:
                for factor in FACTORS[: RUNS[cell]]:
                    yield Impact(case, cell, strength, factor)


def plan() -> dict[str, Impact]:
    """All runs by name."""
    return {each.name: each for each in impacts()}


def of_cell(case: str, cell: float, strength: str) -> list[Impact]:
    """The runs of one case, cell and strength; at the reference cell both strengths agree."""
    known = "strain" if cell == REFERENCE else strength
    return [
        each for each in impacts() if (each.case, each.cell, each.strength) == (case, cell, known)
    ]


def scene(impact: Impact, **numerics: object) -> Scene:
    """The paper's impact in other cells."""
    given = paper_scene(f"paper/{impact.case}")
    assert given.impactor is not None
    size = math.sqrt(REFERENCE / impact.cell) if impact.strength == "scaled" else 1.0
    block = given.block.model_copy(
        update={
            "columns": round(given.block.width / impact.cell),
            "rows": round(given.block.height / impact.cell),
        }
    )
    impactor = given.impactor.model_copy(
        update={"velocity": impact.factor * given.impactor.velocity, "friction": FRICTION}
    )
    return given.model_copy(
        update={
            "block": block,
            "foam": _brittle(size * TENSILE, size * SHEAR, impact.cell),
            "impactor": impactor,
            "base": Base(kind="gripped"),
            "model": MODEL,
            "numerics": given.numerics.model_copy(update=numerics),
        }
    )


def _brittle(tensile: float, shear: float, cell: float) -> Foam:
    """Foam whose bonds break at these strains, at once, in cells of this size [m]."""
    foam = Foam()
    return Foam(
        tensile_strain=tensile,
        shear_strain=shear,
        softening=False,
        fracture_energy=OPENING * 0.5 * foam.youngs_modulus * tensile**2 * cell,
        shear_fracture_energy=SLIDING * 0.5 * foam.shear_modulus * shear**2 * cell,
    )


def compute(impact: Impact) -> dict[str, object]:
    """Run it; its figures, and of the ensembles' middle also its history."""
    try:
        result = whole(scene(impact))
    except RunError as error:
        return {"impact": asdict(impact), "failed": str(error)}
    figures = figures_of(impact, result)
    if impact.factor == 1.0:
        figures["history"] = kept_history(result)
    return figures


def figures_of(impact: Impact, result: Result) -> dict[str, object]:
    """What is compared."""
    summed, history, block = summary(result), result.history, result.scene.block
    broken = history["broken_bonds"]
    first = np.flatnonzero(broken)
    last = result.snapshots[-1]
    face = block.dx * block.depth
    return {
        "impact": asdict(impact),
        **{name: summed[name] for name in FIGURES},
        "first_failure_s": float(history["time_s"][first[0]]) if len(first) else None,
        "broken_area_m2": float(np.sum(last.broken_a) + np.sum(last.broken_b)) * face,
        "fracture_J": float(history["fracture_J"][-1]),
        "shear_J": float(history["shear_J"][-1] + history["shearing_J"][-1]),
    }


def kept_history(result: Result) -> dict[str, list[float]]:
    """Displacement and fracture energy at instants that all runs share."""
    time = result.history["time_s"]
    instants = np.arange(0.0, time[-1], KEPT_EVERY)
    return {
        name: [float(f"{x:.6g}") for x in np.interp(instants, time, result.history[name])]
        for name in ("displacement_m", "deceleration_smoothed_m_s2", "fracture_J")
    }
