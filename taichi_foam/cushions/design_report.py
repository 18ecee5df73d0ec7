"""A design in words and tables: what to do, how sure it is, and what was not looked at."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING

from taichi_foam.cushions import design_figures, handling, sizing, verify
from taichi_foam.cushions.checks import Check, checks
from taichi_foam.cushions.own_tests import OwnTests
from taichi_foam.cushions.scenes import FLAT
from taichi_foam.cushions.shown import Units
from taichi_foam.cushions.sizing import Pad, Relaxed
from taichi_foam.cushions.verify import Runs
from taichi_foam.picture import document
from taichi_foam.picture.document import Section, Table
from taichi_foam.records.history import FILTER

if TYPE_CHECKING:
    from taichi_foam.cushions.design import Design

_VERDICT = {True: "holds", False: "FAILS", None: "open"}

_METHOD = (
    "Energy balance: T W(e) = sigma_st (h + e T), with the thickness T, the drop height h, the "
    "static stress sigma_st = m g / A, the strain e at the stop and the area W under the foam's "
    "stress-strain curve; G = sigma / sigma_st - 1 is the deceleration in g, and G + 1 the force "
    "over the weight (Gruenbaum & Miltz 1983).",
    f"A pad leaves {100 * sizing.RESERVE:g} % of the fragility unused by this formula, and holds a "
    f"product that is {100 * sizing.HEAVIER:g} % heavier; its static stress is the geometric "
    "middle of those that do. The thinnest pad is the best, then the one of the least foam.",
    f"Runs: drops of a lattice of mass points, with velocities within {100 * verify.WITHIN:g} % of "
    f"that of the drop height. Their peaks are filtered with {FILTER} (SAE J211); compare them "
    "with measurements that went through the same filter.",
)


def lead(found: Design) -> list[str]:
    """The answer, in paragraphs."""
    units, wish = found.units, found.wish
    by = " (ISTA 1A for this mass)" if found.by_mass else ""
    times = "" if wish.drops == 1 else f", {wish.drops} times on one cushion"
    asked = (
        f"{units.text('mass', wish.mass)}, a fall of {units.text('height', wish.drop)}{by}{times}, "
        f"fragility {wish.fragility:g} g."
    )
    if found.harmless:
        assert wish.dv_critical is not None
        return [
            asked,
            f"No cushion is needed: the product hits at {units.text('velocity', found.velocity)}, "
            f"and its velocity changes by twice that at most, below the critical "
            f"{units.text('velocity', wish.dv_critical)} (damage boundary, ASTM D3332).",
        ]
    chosen = found.chosen
    if chosen is not None:
        return [asked, f"Take {described(found, chosen.pad)}.", *_verdicts(found, chosen)]
    if found.candidates and not found.tried:
        pad = found.candidates[0]
        return [
            asked,
            f"By the formulas, not verified by runs: {described(found, pad)}.",
            _by_formula(pad),
            _range(found, pad),
        ]
    if found.tried:
        first = found.tried[0]
        return [
            asked,
            f"No pad holds in all runs. {described(found, first.pad).capitalize()} comes first by "
            f"the formulas ({first.pad.g:.1f} g), but {len(first.g) - first.below} of "
            f"{len(first.g)} runs reach {wish.fragility:g} g or more, the largest "
            f"{max(first.g):.1f} g ({FILTER}).",
            "Relax the wish, give thicker stock, or look at the runs: a shape that is not flat is "
            "stiffer or softer than the formula's.",
        ]
    misses = found.misses
    if not misses:
        return [asked, "Nothing fits, and no single wish that is relaxed helps."]
    return [
        asked,
        "Nothing fits. One of these would, the smallest change first:",
        *(f"- {_relaxation(found, each)}" for each in misses),
    ]


def described(found: Design, pad: Pad) -> str:
    """Foam, thickness, area and static stress of a pad, in words."""
    units, side = found.units, math.sqrt(pad.area)
    return (
        f"{pad.foam.label}, {units.text('length', pad.thickness)} thick, "
        f"{units.text('area', pad.area)} (such as {units.number('length', side)} x "
        f"{units.text('length', side)}), static stress {units.text('stress', pad.static_stress)}"
    )


def _by_formula(pad: Pad) -> str:
    return (
        f"By the formula {pad.g:.1f} g at {100 * pad.strain:.0f} % of strain, "
        f"{100 * pad.reserve:.0f} % below the fragility."
    )


def _range(found: Design, pad: Pad) -> str:
    low, high = (found.units.number("mass", each) for each in pad.masses)
    return (
        f"By the formula the same pad protects products of {low} to {high} "
        f"{found.units.unit('mass')} of this fragility: lighter ones are stopped too hard, heavier "
        "ones bottom out."
    )


def _verdicts(found: Design, runs: Runs) -> list[str]:
    pad, band = runs.pad, runs.band
    said = [
        _by_formula(pad),
        f"{runs.below} of {len(runs.g)} runs stay below {found.wish.fragility:g} g: median "
        f"{band.median:.1f} g, 5-95 % band {band.low:.1f} to {band.high:.1f} g, largest "
        f"{max(runs.g):.1f} g ({FILTER}; raw {max(runs.raw):.1f} g), strain up to "
        f"{100 * max(runs.strain):.0f} %; {100 * (1 - max(runs.g) / found.wish.fragility):.0f} % "
        "are left.",
        _range(found, pad),
    ]
    change, critical = max(runs.change), found.wish.dv_critical
    if critical is not None and math.isfinite(change):
        below = "below" if change < critical else "not below"
        said.append(
            f"The velocity changes by up to {found.units.text('velocity', change)}, {below} the "
            f"critical {found.units.text('velocity', critical)}."
        )
    failing = [each for each in checks(pad, found.units) if each.holds is False]
    said += [f"Check {each.name}: {each.found}." for each in failing]
    return said


def _relaxation(found: Design, relaxed: Relaxed) -> str:
    units, value = found.units, relaxed.value
    words = {
        "fragility": lambda: f"a fragility of {value:.3g} g",
        "drop": lambda: f"a fall of {units.text('height', value)}",
        "max_thickness": lambda: f"room for {units.text('length', value)}",
        "max_area": lambda: f"an area of {units.text('area', value)}",
        "braced": lambda: "a pad that is held at its sides, so that it does not buckle",
    }[relaxed.key]()
    by = "" if relaxed.key == "braced" else f" ({100 * relaxed.by:+.0f} %)"
    return f"{words}{by}: {described(found, relaxed.pad)}, {relaxed.pad.g:.1f} g by the formula"


def candidates_table(found: Design) -> Table:
    """The candidates and the pads that were tried, best first."""
    units = found.units
    head = [
        "foam",
        f"thickness ({units.unit('length')})",
        f"area ({units.unit('area')})",
        f"static stress ({units.unit('stress')})",
        "formula (g)",
        "strain (%)",
        "runs below",
        "runs, 5-95 % (g)",
        f"masses ({units.unit('mass')})",
    ]
    rows = []
    for pad in found.pads:
        runs = found.runs_of(pad)
        rows.append(
            [
                pad.foam.label,
                units.number("length", pad.thickness),
                units.number("area", pad.area),
                units.number("stress", pad.static_stress),
                f"{pad.g:.1f}",
                f"{100 * pad.strain:.0f}",
                "" if runs is None else f"{runs.below} of {len(runs.g)}",
                "" if runs is None else f"{runs.band.low:.1f} to {runs.band.high:.1f}",
                " to ".join(units.number("mass", each) for each in pad.masses),
            ]
        )
    return Table(head, rows, f"Peaks of runs: {FILTER}. Thinnest first, then the least foam.")


def checks_table(found: list[Check]) -> Table:
    """The checks of a pad."""
    rows = [[each.name, _VERDICT[each.holds], each.found, each.source] for each in found]
    return Table(["check", "verdict", "found, limit", "source of the limit"], rows, is_text=True)


def tests_table(tests: OwnTests, pad: Pad, units: Units) -> Table:
    """Own cushion tests beside the formula of a pad's foam."""
    rows = []
    columns = (tests.height, tests.thickness, tests.static, tests.g)
    for height, thickness, static, g in zip(*(each.tolist() for each in columns), strict=True):
        by, _ = sizing.response(pad.foam, thickness, height).at(static)
        known = math.isfinite(by)
        rows.append(
            [
                units.number("height", height),
                units.number("length", thickness),
                units.number("stress", static),
                f"{g:.1f}",
                f"{by:.1f}" if known else "bottoms out",
                f"{100 * (by / g - 1):+.0f}" if known else "",
            ]
        )
    head = [
        f"height ({units.unit('height')})",
        f"thickness ({units.unit('length')})",
        f"static stress ({units.unit('stress')})",
        "measured (g)",
        f"{pad.foam.label} by formula (g)",
        "difference (%)",
    ]
    return Table(head, rows, "The formula has no rate and no air in the cells: it is of the test.")


def write(found: Design, path: str | Path) -> Path:
    """Write the report as one HTML file. Raises UserError."""
    pad = found.shown
    sections = []
    if pad is not None:
        sections = [
            Section(
                "Peak over static stress",
                figure=design_figures.curve(found),
                alt="Peak deceleration over static stress of the pad's foam for several "
                "thicknesses, with the fragility, the safe range and the runs",
                caption="Lines: formula. Left of the minimum the foam is too strong for the load, "
                "right of it the load uses it up.",
            ),
            Section(
                "How thick",
                figure=design_figures.thickness(found),
                alt="Least peak of each foam over the thickness, with the fragility",
                caption="No area brings a foam below its line: only more thickness, or a foam that "
                "absorbs more energy at the same stress.",
            ),
        ]
    if found.pads:
        sections.append(Section("Candidates", table=candidates_table(found)))
    if pad is not None:
        made = checks(pad, found.units)
        heading = "Checks" if found.pad is not None else "Checks of the closest miss"
        sections.append(Section(heading, table=checks_table(made)))
        foam = pad.foam
        words = [f"{foam.title}. Source: {foam.source}."]
        rows = [each.split(": ", 1) for each in foam.assumed]
        table = Table(["assumed", "why"], rows, is_text=True) if rows else None
        sections.append(Section("The foam", words, table=table))
        if found.tests is not None:
            words = [f"Read from {found.tests.name}; the filter is that of the measurement."]
            sections.append(
                Section("Own tests", words, table=tests_table(found.tests, pad, found.units))
            )
    warnings = list(dict.fromkeys(text for runs in found.tried for text in runs.warnings))
    if warnings:
        sections.append(Section("Doubts about the runs", warnings))
    sections.append(Section("How it was found", _METHOD))
    sections.append(Section("What was not looked at", _not_looked_at(found)))
    wish, units = found.wish, found.units
    title = (
        f"A cushion for {units.text('mass', wish.mass)}, {wish.fragility:g} g, a fall of "
        f"{units.text('height', wish.drop)}"
    )
    return document.write(path, title, lead(found), sections)


def _not_looked_at(found: Design) -> list[str]:
    """Limits of a design, in sentences."""
    said = [
        f"{handling.SEQUENCE}.",
        "The product is rigid, falls level, and hits the pad at once. A pulse of the same peak "
        "may damage more or less, by its shape: fragility of the damage boundary is that of a "
        "rectangular pulse, which is the worst.",
        "Vibration, humidity and ageing of the foam are left out. Make a prototype, and drop it.",
    ]
    if found.shape != FLAT:
        said.insert(
            0, f"The formulas are of a flat pad; only the runs know the shape {found.shape!r}."
        )
    if found.wish.drops > 1:
        said.insert(0, "Foams do not recover between the drops: each begins where one has ended.")
    return said
