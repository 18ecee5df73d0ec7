"""The page's section on waves."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np
from pages import MARKS, Page, Part, cell_axis, key, panels, percent, table

from taichi_foam.picture.style import CYCLE, INK
from verification import waves

METHOD = """A heavy plate taps a bar of 1 m at 0.1 m/s; 2 ms later the front has come c t = 0.66 m,
c = sqrt(K / rho) = 330 m/s. Without dashpots its place is where v = v0 / 3 and its width that of
Airy's integral; with Table 6's dashpots the place is at v0 / 2 and the width that of diffusion with
eta / rho. Width is from 10 to 90 % of v0. The lattice's exact dispersion, of longitudinal and of
shear waves, and its second order are tests: `tests/conservation/test_waves.py`.
"""

FINDINGS = """Without dashpots the front's place errs by a sixth of a cell, first order, from where
the plate meets the first mass point; its width is Airy's within 1.4 % in the coarsest cells, and
shrinks with the power 2/3 of the cell. With Table 6's dashpots the width is that of the
continuum, 158 mm, within 0.6 % in any cell: there the cells do not matter, and what is left of
the place, 2 mm or 0.3 %, is the dashpots' too and does not go away.
"""


def section(part: Part, page: Page) -> list[str]:
    """Place and width of an elastic front."""
    if not part:
        return []
    return [
        "## Waves\n",
        METHOD,
        fronts_table(part),
        page.picture(
            "verification-waves",
            "Place and width of an elastic front against cell size",
            partial(draw, part),
        ),
        FINDINGS,
    ]


def fronts_table(part: Part) -> str:
    """Place and width of the front by cell."""
    header = ["dashpots", "cell, mm", "place - c t, mm", "of c t", "width, mm", "theory", "error"]
    rows = []
    for name, (cell, damping_time) in waves.plan().items():
        if name in part:
            run = part[name]
            rows.append(
                [
                    "Table 6" if damping_time else "none",
                    f"{1e3 * cell:g}",
                    f"{1e3 * run['late']:+.2f}",
                    percent(run["late"] / (waves.SOUND * waves.TIME), 2),
                    f"{1e3 * run['width']:.2f}",
                    f"{1e3 * run['theory']:.2f}",
                    percent(run["width"] / run["theory"] - 1, 2),
                ]
            )
    return table(header, rows)


def draw(part: Part, path: Path) -> None:
    """Error of the front's place, and its width, against cell size."""
    with panels(path, ("place of the front", "width of the front")) as (left, right):
        for colour, mark, kind in zip(CYCLE, MARKS, ("undamped", "damped"), strict=False):
            runs = [
                part[name] for name in waves.plan() if name in part and name.endswith(f", {kind}")
            ]
            cells = 1e3 * np.array([run["cell"] for run in runs])
            late = 1e3 * np.array([run["late"] for run in runs])
            left.plot(cells, late, mark, color=colour, markersize=8, label=kind)
            width = 1e3 * np.array([run["width"] for run in runs])
            right.plot(cells, width, mark, color=colour, markersize=8, label=kind)
            theory = 1e3 * np.array([run["theory"] for run in runs])
            right.plot(cells, theory, color=colour, linewidth=1.4)
        left.axhline(0, color=INK, linewidth=0.8)
        left.set_ylabel("behind or ahead of c t (mm)")
        right.set_ylabel("10 to 90 % of the velocity (mm)")
        right.set_yscale("log")
        right.set_yticks([10, 20, 50, 100, 200], ["10", "20", "50", "100", "200"])
        for axis in (left, right):
            cell_axis(axis, waves.CELLS)
        key(left)
        key(right, "center left", "lines: theory")
