"""Which foam, how thick, how large: a pad for a product's mass, drop height and fragility.

    import taichi_foam as tf
    found = tf.design(mass=5.0, fragility=40.0, out="designs/radio")
    print(found.answer)
    found.plot(), found.report("radio.html")

The formulas rank pads of all foams and stock thicknesses in milliseconds; runs decide. A pad counts
as one only if every run of its ensemble stays below the fragility.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pydantic import ValidationError

from taichi_foam.cushions import handling, own_tests, sizing, verify
from taichi_foam.cushions.own_tests import OwnTests
from taichi_foam.cushions.scenes import FLAT, cushion_scene
from taichi_foam.cushions.shown import UNITS, Units, units_named
from taichi_foam.cushions.sizing import Cushioning, Pad, Relaxed, Wish
from taichi_foam.cushions.verify import Runs
from taichi_foam.errors import UserError
from taichi_foam.interrupts import held_interrupts
from taichi_foam.results.files import write_csv, write_rows
from taichi_foam.results.folders import Claim, claimed
from taichi_foam.scene.messages import explain
from taichi_foam.simulation.progress import Bars
from taichi_foam.units import STANDARD_GRAVITY

if TYPE_CHECKING:
    from matplotlib.figure import Figure

TABLE, RUNS, REPORT = "design.csv", "runs.csv", "report.html"
"""Files of a design's folder, beside its figures."""

FEWEST, MOST = 2, 100
"""Range of an ensemble's size."""

MOST_TRIED = 6
"""Most pads whose runs are computed before the search ends."""


@dataclass(frozen=True)
class Design:
    """Pads for a wish: the ranking by the formulas, and what runs have decided.

    wish         what was asked for
    foams        foams that were tried
    shape        of the pad
    candidates   the thinnest pad of each foam by the formulas, best first
    tried        ensembles, in the order in which they were computed; the last one holds if any does
    tests        own cushion tests; None: not given
    by_mass      whether the drop height is that of ISTA 1A for the mass
    units        in which values are shown
    """

    wish: Wish
    foams: Sequence[Cushioning]
    shape: str
    candidates: Sequence[Pad]
    tried: Sequence[Runs] = ()
    tests: OwnTests | None = None
    by_mass: bool = False
    units: Units = UNITS["si"]

    @property
    def harmless(self) -> bool:
        """Whether no deceleration damages: the drop's velocity change stays below the critical one.

        It is at most twice the velocity of impact, of a full rebound (damage boundary, ASTM D3332).
        """
        critical = self.wish.dv_critical
        return critical is not None and 2.0 * self.velocity < critical

    @property
    def velocity(self) -> float:
        """Velocity of impact [m/s]."""
        return math.sqrt(2.0 * STANDARD_GRAVITY * self.wish.drop)

    @property
    def chosen(self) -> Runs | None:
        """The pad that holds, and its runs; None: none does."""
        return self.tried[-1] if self.tried and self.tried[-1].hold else None

    @property
    def pad(self) -> Pad | None:
        """The chosen pad, or else the best by the formulas; None: nothing fits."""
        if self.chosen is not None:
            return self.chosen.pad
        return self.candidates[0] if self.candidates else None

    @cached_property
    def misses(self) -> list[Relaxed]:
        """What to relax, the smallest change first, if nothing fits by the formulas."""
        return [] if self.candidates or self.harmless else sizing.relaxed(self.foams, self.wish)

    @property
    def shown(self) -> Pad | None:
        """The pad that figures show: the best one, or the closest miss."""
        return self.pad or (self.misses[0].pad if self.misses else None)

    @property
    def table(self) -> dict[str, list[Any]]:
        """The candidates, one value for each, in SI units; of runs, None where there are none."""
        rows = [_row(place, pad, self.runs_of(pad)) for place, pad in enumerate(self.pads, 1)]
        return {key: [row[key] for row in rows] for key in rows[0]} if rows else {}

    @property
    def pads(self) -> list[Pad]:
        """All pads: the candidates, then thicker ones that were tried."""
        more = [each.pad for each in self.tried if each.pad not in self.candidates]
        return [*self.candidates, *more]

    def runs_of(self, pad: Pad) -> Runs | None:
        """The ensemble of a pad; None: not computed."""
        return next((each for each in self.tried if each.pad == pad), None)

    @property
    def answer(self) -> str:
        """The answer in sentences."""
        from taichi_foam.cushions import design_report

        return "\n".join(design_report.lead(self))

    def plot(self) -> Figure:
        """Peak over static stress of the best pad: formula, runs, own tests, safe range."""
        from taichi_foam.cushions import design_figures

        return design_figures.curve(self)

    def report(self, path: str | Path) -> Path:
        """Write the report, one HTML file, and return its path. Raises UserError."""
        from taichi_foam.cushions import design_report

        return design_report.write(self, path)


def design(
    mass: float,
    fragility: float,
    drop: float | None = None,
    *,
    foams: Sequence[str] = (),
    dv_critical: float | None = None,
    max_thickness: float | None = None,
    max_area: float | None = None,
    stock: Sequence[float] | None = None,
    shape: str = FLAT,
    drops: int = 1,
    runs: int = 16,
    braced: bool = False,
    temperature: float | None = None,
    tests: str | Path | None = None,
    units: str = "si",
    out: str | Path | None = None,
    overwrite: bool = False,
    arch: str | None = None,
    threads: int | None = None,
    bars: Bars | None = None,
) -> Design:
    """Find a pad that protects a product, and verify it by runs.

    Args:
        mass: of the product [kg].
        fragility: largest deceleration that it survives [g].
        drop: drop height [m]; None: that of ISTA 1A for the mass.
        foams: names in the foam library, foam files or compression tests; empty: the library's.
        dv_critical: critical velocity change [m/s]: below it no deceleration damages.
        max_thickness: largest thickness that has room [m].
        max_area: largest area of the pad [m2].
        stock: thicknesses to choose from [m]; None: usual ones.
        shape: of the pad, as for `cushion_scene`; the formulas are of a flat one.
        drops: falls on one cushion that the product must survive.
        runs: number of runs of an ensemble, 2 to 100; 0: the formulas alone.
        braced: the pad is held at its sides, so that it does not buckle.
        temperature: most extreme temperature of transport [C].
        tests: CSV file of own cushion tests, to draw and compare.
        units: "si" or "us", for what is shown and for `stock`.
        out: folder for table, figures and report; None: write nothing.
        overwrite, arch, threads: as `run`.
        bars: where progress is shown; None: nowhere.

    Raises:
        UserError: an argument is invalid; nothing has been computed or written.
        RunError: as `simulate_many`.
        KeyboardInterrupt: Ctrl-C. With `out`, what has been computed is kept, and the same call
            goes on from there.
    """
    shown_in = units_named(units)
    try:
        wish = Wish(
            mass=mass, fragility=fragility, drops=drops, max_thickness=max_thickness,
            max_area=max_area, braced=braced, dv_critical=dv_critical, temperature=temperature,
            drop=handling.drop_height(mass) if drop is None else drop,
            stock=tuple(sorted(stock or handling.STOCK[units])),
        )  # fmt: skip
    except ValidationError as error:
        raise UserError(explain(error, Wish)) from None
    found = Design(
        wish=wish,
        foams=[sizing.cushioning(name) for name in foams or sizing.known()],
        shape=shape,
        candidates=(),
        tests=None if tests is None else own_tests.read(Path(tests)),
        by_mass=drop is None,
        units=shown_in,
    )
    if runs and not FEWEST <= runs <= MOST:
        raise UserError(f"runs = {runs}: must be 0, or {FEWEST} to {MOST}; 16 are a good number")
    if not found.harmless:
        found = replace(found, candidates=sizing.candidates(found.foams, found.wish))
    if found.candidates and shape != FLAT:  # an unknown shape is refused before anything is run
        first = found.candidates[0]
        cushion_scene(first.foam.name, first.thickness, found.wish.drop, 1e3, shape=shape)
    bars = bars or Bars()
    if out is None:
        return _verified(found, runs, bars, None, arch, threads)
    with claimed(out, _request(found, runs), overwrite) as claim:
        done = _verified(found, runs, bars, claim, arch, threads)
        with held_interrupts() as pressed, claim.publishing() as staging:
            _write(done, staging)
        claim.finish()
        if pressed.is_set():
            raise KeyboardInterrupt(f"the design is complete in {out}")
    return done


def _verified(
    found: Design,
    count: int,
    bars: Bars,
    claim: Claim | None,
    arch: str | None,
    threads: int | None,
) -> Design:
    """The design with ensembles of its best pads, until one holds.

    A pad that does not hold is followed by the next thickness of its foam, or the next foam,
    whichever is thinner.
    """
    waiting = list(found.candidates) if count else []
    tried: list[Runs] = []
    while waiting and len(tried) < MOST_TRIED and not (tried and tried[-1].hold):
        pad = waiting.pop(0)
        name = f"{pad.foam.label}-{1e3 * pad.thickness:.4g}mm"
        folder = None if claim is None else claim.work / name
        what = f"{pad.foam.label} {found.units.text('length', pad.thickness)}, {count} runs"
        try:
            with bars.computing(what) as on_progress:
                tried.append(
                    verify.runs(
                        pad, found.shape, count, on_progress,
                        checkpoint=folder, arch=arch, threads=threads,
                    )
                )  # fmt: skip
        except KeyboardInterrupt:
            if claim is None:
                raise
            with held_interrupts(), claim.publishing() as staging:
                _write(replace(found, tried=tried), staging)
            raise KeyboardInterrupt(
                f"candidates, and runs of {len(tried)} pads, are in {claim.folder}; the same "
                "command goes on"
            ) from None
        thicker = sizing.thicker(pad)
        if thicker is not None:
            waiting = sorted([*waiting, thicker], key=sizing.rank)
    return replace(found, tried=tried)


def _write(found: Design, folder: Path) -> None:
    """Write table, figures and report into a folder. Raises OSError, UserError."""
    from taichi_foam.cushions import design_figures, design_report
    from taichi_foam.picture import style

    write_csv(folder / TABLE, found.table)
    if found.tried:
        write_rows(folder / RUNS, _members(found.tried))
    style.save_all(design_figures.curve(found), folder / "cushion-curve")
    style.save_all(design_figures.thickness(found), folder / "thickness")
    design_report.write(found, folder / REPORT)


def _row(place: int, pad: Pad, runs: Runs | None) -> dict[str, Any]:
    band = None if runs is None else runs.band
    return {
        "rank": place,
        "foam": pad.foam.name,
        "density_kg_m3": pad.foam.density,
        "thickness_m": pad.thickness,
        "area_m2": pad.area,
        "volume_m3": pad.volume,
        "static_stress_Pa": pad.static_stress,
        "peak_by_formula_g": pad.g,
        "strain_by_formula": pad.strain,
        "reserve": pad.reserve,
        "least_mass_kg": pad.masses[0],
        "largest_mass_kg": pad.masses[1],
        "runs": 0 if runs is None else len(runs.g),
        "runs_below_fragility": 0 if runs is None else runs.below,
        "peak_cfc180_median_g": band and band.median,
        "peak_cfc180_low_g": band and band.low,
        "peak_cfc180_high_g": band and band.high,
        "peak_cfc180_largest_g": runs and max(runs.g),
        "peak_raw_largest_g": runs and max(runs.raw),
        "largest_strain": runs and max(runs.strain),
    }


def _members(tried: Sequence[Runs]) -> list[dict[str, Any]]:
    """A row for each run of every ensemble, in SI units."""
    return [
        {
            "foam": runs.pad.foam.name,
            "thickness_m": runs.pad.thickness,
            "static_stress_Pa": runs.pad.static_stress,
            "velocity_m_s": velocity,
            "peak_cfc180_g": g,
            "peak_raw_g": raw,
            "strain": strain,
            "velocity_change_m_s": change,
        }
        for runs in tried
        for velocity, g, raw, strain, change in zip(
            runs.velocity, runs.g, runs.raw, runs.strain, runs.change, strict=True
        )
    ]


def _request(found: Design, runs: int) -> Mapping[str, Any]:
    """What determines the result, for the claim on its folder."""
    laws = [each.foam.model_dump_json() for each in found.foams]
    return {
        "command": "design",
        **found.wish.model_dump(),
        "foams": [each.name for each in found.foams],
        "foams_sha256": hashlib.sha256("".join(laws).encode()).hexdigest(),
        "shape": found.shape,
        "tests": found.tests and found.tests.rows,
        "units": found.units.name,
        "runs": runs,
    }
