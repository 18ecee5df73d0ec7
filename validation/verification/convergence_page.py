"""The page's section on impacts in ever smaller cells."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from itertools import product
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from pages import MARKS, Page, Part, cell_axis, key, panels, table

from taichi_foam.picture.style import CYCLE
from verification import smooth
from verification.convergence import CASES, CELLS, KEPT_EVERY, STRENGTHS, Impact, of_cell

NAMES = {"rectangular": "flat", "cylinder": "cylinder", "wedge": "wedge"}

METHOD = """Three of the paper's impacts in cells of 10, 5, 2.5 and 1.25 mm: medians (ranges) of
runs with velocities within 0.5 %, five for the coarser cells, three for 2.5 mm, one for 1.25 mm.
*Strain*: bonds break at the paper's strains, 0.05 and 0.10, whatever the cell. *Scaled*:
these times sqrt(5 mm / cell), so that a bond holds the same energy per area of crack,
(K e_t^2 / 2) dx (crack band, Bazant and Oh 1983). In cells of 10 mm a flat face of 50 mm covers
four mass points, 40 mm: that row is as much about contact as about foam. Readings: Eq. 27 as
printed, dashpots of one size, a shear coefficient of 18, friction 0.15, no rate (`MODEL` in
`validation/verification/convergence.py`).
"""

FINDINGS = """With strains as the limits nothing that has to do with cracks converges: the
broken area grows by 1.7 to 2.2 with each halving of the cell down to 2.5 mm, since a crack costs
half as much, the flat face sinks ever deeper (5.9, 6.6, 7.2, 7.6 cm), and under the cylinder the
block of 2.5 mm cells splits and lets it through to the support. Differences between cells are
larger than the ensembles' ranges. With scaled strains, cells of 2.5 mm give what those of 5 mm
give: displacement +1, -3 and -5 %, within or next to the ranges, with histories a few millimetres
apart; so the remedy works there. The broken area itself still changes by up to a factor of two.
Cells of 10 mm agree with neither: four mass points below a flat face, and limits so low that they
are reached before yield (0.035). The crushed zone's width is the flat face's 50 mm to the cell
from 5 mm on, with either strength. Single histories after the first break are chance, and have no
order of convergence: only medians can be compared. Where a row of a cell is missing it was not
computed.
"""

SMOOTH = """Foam that crushes but does not break converges with about the first power of the cell,
by no clean order: mass points meet a curved or pointed impactor one by one, the wedge's tip finds
the first of them half a cell away, and the edges of a flat face are singular. The step's error is
below 1e-3 with the automatic step, and below 3e-6 in the motion.
"""

COLUMNS = (
    ("impact_duration_s", "duration, ms", 1e3, ".1f"),
    ("max_displacement_m", "displacement, cm", 1e2, ".2f"),
    ("plateau_deceleration_m_s2", "plateau, m/s²", 1.0, ".0f"),
    ("energy_per_volume_J_m3", "energy/volume, 10⁵ J/m³", 1e-5, ".2f"),
    ("crushed_width_m", "crushed width, mm", 1e3, ".0f"),
    ("crushed_height_m", "crushed height, mm", 1e3, ".0f"),
    ("first_failure_s", "first break, ms", 1e3, ".2f"),
    ("broken_area_m2", "broken faces, cm²", 1e4, ".0f"),
)


def section(part: Part, smooth_part: Part, page: Page) -> list[str]:
    """Impacts that break the foam, case by case, and impacts that do not."""
    parts = []
    if part:
        parts += ["## Impacts in smaller cells\n", METHOD]
        for case in CASES:
            parts += [f"### {case}\n", impacts_table(part, case)]
        parts += [
            "*Apart* is the largest difference of the displacement from that in cells half as "
            "large, at any time, single runs.\n",
            page.picture(
                "verification-cells",
                "Displacement, crushed width and broken faces against cell size",
                partial(draw_figures, part),
            ),
            page.picture(
                "verification-histories",
                "Displacement against time in cells of 10 to 1.25 mm",
                partial(draw_histories, part),
            ),
            FINDINGS,
        ]
    if smooth_part:
        parts += [
            "### Foam that does not break\n",
            smooth_table(smooth_part),
            "Step, flat face in cells of 5 mm, against 53 ns:\n",
            steps_table(smooth_part),
            SMOOTH,
        ]
    return parts


def values(part: Part, case: str, cell: float, strength: str, name: str) -> list[float]:
    """A figure of all runs that have it; a run that never stopped counts as infinite."""
    found = []
    for impact in of_cell(case, cell, strength):
        run = part.get(impact.name)
        if run is not None and "failed" not in run:
            found.append(np.inf if run[name] is None else run[name])
    return found


def impacts_table(part: Part, case: str) -> str:
    """All figures of one impact, by strength and cell."""
    rows = []
    for strength in STRENGTHS:
        for cell in CELLS:
            if values(part, case, cell, strength, "steps"):
                cells = [
                    _spread(values(part, case, cell, strength, name), factor, form)
                    for name, _, factor, form in COLUMNS
                ]
                rows.append(
                    [strength, f"{1e3 * cell:g}", *cells, _apart(part, case, cell, strength)]
                )
    titles = [title for _, title, _, _ in COLUMNS]
    return table(["strength", "cell, mm", *titles, "apart, mm"], rows)


def _spread(found: Sequence[float], factor: float, form: str) -> str:
    texts = [
        format(factor * value, form) if np.isfinite(value) else "-"
        for value in (float(np.median(found)), min(found), max(found))
    ]
    return texts[0] if len(found) == 1 else f"{texts[0]} ({texts[1]} to {texts[2]})"


def _history(part: Part, case: str, cell: float, strength: str) -> Part | None:
    run = part.get(of_cell(case, cell, strength)[0].name)
    return None if run is None else run.get("history")


def _apart(part: Part, case: str, cell: float, strength: str) -> str:
    """The largest difference of the displacement from that in cells half as large [mm]."""
    if cell == CELLS[-1]:
        return ""
    here = _history(part, case, cell, strength)
    finer = _history(part, case, CELLS[CELLS.index(cell) + 1], strength)
    if here is None or finer is None:
        return ""
    one, two = (np.array(each["displacement_m"]) for each in (here, finer))
    rows = min(len(one), len(two))
    return f"{1e3 * np.abs(one[:rows] - two[:rows]).max():.1f}"


def smooth_table(part: Part) -> str:
    """What foam that does not break has taken after 2 ms, by cell, and the order."""
    rows = []
    for case in CASES:
        names = [smooth.cell_name(case, cell) for cell in CELLS]
        if all(name in part for name in names):
            for figure, unit in (("lost", "velocity lost, m/s"), ("crushing", "crushing, J")):
                found = [part[name][figure] for name in names]
                orders = [smooth.order(*found[n : n + 3]) for n in (0, 1)]
                rows.append(
                    [case, unit, *(f"{value:.4f}" for value in found)]
                    + ["none" if order is None else f"{order:.1f}" for order in orders]
                )
    cells = [f"{1e3 * cell:g} mm" for cell in CELLS]
    return table(["impact", "after 2 ms", *cells, "order, 10 to 2.5", "order, 5 to 1.25"], rows)


def steps_table(part: Part) -> str:
    """Errors by step, against the finest."""
    names = [smooth.step_name(parts) for parts in smooth.STEPS]
    exact = part.get(smooth.step_name(smooth.EXACT))
    if exact is None or not all(name in part for name in names):
        return ""
    rows = []
    for figure, title in (("lost", "velocity lost"), ("crushing", "crushing")):
        errors = [part[name][figure] / exact[figure] - 1 for name in names]
        slope = np.polyfit(np.log(smooth.STEPS), np.log(np.abs(errors)), 1)[0]
        rows.append([title, *(f"{error:+.1e}" for error in errors), f"{-slope:.1f}"])
    steps = [f"{1e6 * smooth.COARSEST_STEP / parts:.2f} µs" for parts in smooth.STEPS]
    return table(["relative error with a step of", *steps, "order"], rows)


def draw_figures(part: Part, path: Path) -> None:
    """Displacement, broken faces and crushed width against cell size, for both strengths."""
    shown = (
        ("max_displacement_m", "largest displacement (cm)", 1e2),
        ("crushed_width_m", "width of the crushed zone (cm)", 1e2),
        ("broken_area_m2", "broken faces (cm²)", 1e4),
    )
    with panels(path, [title for _, title, _ in shown], 5.2) as axes:
        for axis, (name, title, factor) in zip(axes, shown, strict=True):
            for place, (case, strength) in enumerate(product(CASES, STRENGTHS)):
                beside = 1.02 ** (2 * place - 5)  # ranges must not hide one another
                _draw_ranges(axis, part, (case, strength, name), factor, beside)
            cell_axis(axis, CELLS)
            axis.set_ylabel(title)
            axis.set_ylim(bottom=0)
        axes[0].legend(fontsize=10, frameon=False, ncols=2, loc="lower center")


def _draw_ranges(
    axis: Axes, part: Part, of: tuple[str, str, str], factor: float, beside: float
) -> None:
    """Medians and ranges of one figure by cell, of one impact and strength."""
    case, strength, name = of
    number = CASES.index(case)
    colour, mark = CYCLE[number], MARKS[number]
    scaled = strength == STRENGTHS[1]
    cells = [cell for cell in CELLS if _finite(part, case, cell, strength, name)]
    found = [factor * np.array(_finite(part, case, cell, strength, name)) for cell in cells]
    middle = np.array([np.median(each) for each in found])
    low, high = (np.array([end(each) for each in found]) for end in (np.min, np.max))
    axis.errorbar(
        1e3 * beside * np.array(cells),
        middle,
        [middle - low, high - middle],
        fmt=mark + (":" if scaled else "-"),
        color=colour,
        markerfacecolor="white" if scaled else colour,
        capsize=3,
        linewidth=1.6,
        markersize=7,
        label=f"{NAMES[case.split('-')[0]]}, {strength}",
    )


def _finite(part: Part, case: str, cell: float, strength: str, name: str) -> list[float]:
    return [value for value in values(part, case, cell, strength, name) if np.isfinite(value)]


def draw_histories(part: Part, path: Path) -> None:
    """Displacement against time in all cells, at the paper's strains and at scaled ones."""
    titles = [f"{NAMES[case.split('-')[0]]}, {case.split('-')[1]} m/s" for case in CASES]
    with panels(path, titles, 5.2) as axes:
        for axis, case in zip(axes, CASES, strict=True):
            for strength, line in zip(STRENGTHS, ("-", ":"), strict=True):
                for colour, cell in zip(CYCLE, CELLS, strict=False):
                    _draw_history(axis, part, Impact(case, cell, strength), colour, line)
            axis.set_xlabel("time (ms)")
            axis.set_ylabel("displacement (cm)")
            axis.set_xlim(0, 60)
            axis.set_ylim(0, 10.5)
        key(axes[0], "lower right", "solid: strain, dotted: scaled")


def _draw_history(axis: Axes, part: Part, impact: Impact, colour: str, line: str) -> None:
    history = part.get(impact.name, {}).get("history")
    if history is not None:
        depth = 1e2 * np.array(history["displacement_m"])
        time = 1e3 * KEPT_EVERY * np.arange(len(depth))
        label = f"{1e3 * impact.cell:g} mm" if line == "-" else None
        axis.plot(time, depth, line, color=colour, linewidth=1.8, label=label)
