"""The page's section on compaction fronts."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from pages import MARKS, Page, Part, cell_axis, key, panels, percent, table

from taichi_foam.picture.style import CYCLE, GREY, INK
from verification import shock
from verification.shock import DENSITY, FOAMS, VELOCITIES, Shock

METHOD = """A bar of foam 1.5 m long, in cells of 5 mm and two columns wide, stands on a support; a
plate of 1 t hits it. The contact force, averaged over the steady part, is the stress behind the
front. *Locking foam* is Table 1's plateau, 50 times as stiff and locked between 0.79 and 0.81 of
strain; *the paper's foam* is Table 1. Theory 1 is Reid and Peng's sigma_p + rho v^2 / e_d with
e_d = 0.80, which knows neither elasticity nor hardening. Theory 2 solves the jump conditions for
the law itself, behind the elastic precursor, which brings foam to yield and to c |e_y| (16.5 m/s in
the paper's foam, 2.3 m/s in the locking one). Dashpots have Table 6's viscosity, 48.8 Pa s.
"""

FINDINGS = """Locking foam obeys Reid and Peng within 4 % at all velocities; what is missing is the
precursor, which has already brought the foam to 2.3 m/s. With it, and with the law as it is, the
jump conditions hold within 0.3 % (0.05 % from 100 m/s on), in both foams, for stress, strain and
energy; momentum, rho c [v] with the front's measured speed, within 0.05 %. Rigid locking foam is
a bad picture of the paper's foam: 20 % too high, since it densifies to 0.92 and not to 0.80, and
since v is counted from rest and not from 16.5 m/s. Below 16.5 m/s it has no front at all. At 20
m/s the front would be 0.9 m thick, and the bar is too short to settle: strain and speed miss,
stress does not. The automatic step does not foresee how densification stiffens: from 100 m/s on
these runs take `numerics.safety = 20 / v`; with 0.8, the run of locking foam at 200 m/s diverges.
"""

LATTICES = """Harrigan, Reid and Yaghoubi argue that mass-spring models cannot have the
discontinuity of a compaction front. A lattice has none, indeed, but it has what a discontinuity
does: stress, strain, speed and dissipation are those of the jump conditions, for every cell, and
they do not depend on the front's thickness. The thickness is that of the dashpots, which a
continuum with the same viscosity has as well, and converges to it with the first power of the
cell (14.6 Pa s: +55, +17, +8, +4 %); at 48.8 Pa s the last 4 % are a front that has not quite
settled. A front that the dashpots would make thinner than about two cells stays 1.6 to 2 cells
thick, and cells ring behind it. So the front sharpens towards a discontinuity with both cell and
viscosity, as with artificial viscosity in any code. They are right about a chain without
dashpots: there nothing takes the energy rho [v]^2 / 2 that a front has to lose, the ringing is as
large as the stress itself (rows swing by 135 % at a hundredth of Table 6's viscosity), and with
none at all plate and foam part and the mean stress is 25 % off. A hundredth is enough for a mean
within 0.7 %, a tenth for 0.2 %.
"""


def section(part: Part, page: Page) -> list[str]:
    """Fronts in both foams, and one of them in other cells and with other dashpots."""
    if not part:
        return []
    return [
        "## Compaction fronts\n",
        METHOD,
        velocities_table(part),
        "In brackets: theory 2; or theory 1 where it does not apply.\n",
        page.picture(
            "verification-shock",
            "Stress behind a compaction front against velocity, and both theories",
            partial(draw_velocities, part),
        ),
        FINDINGS,
        "### Cells and dashpots\n",
        "The paper's foam at 100 m/s, a bar of 0.75 m. *Rows swing by* is the standard deviation "
        "of the contact force; thickness is from 10 to 90 % of the front's strain, and that *of "
        "the dashpots* an integral over the law, without cells.\n",
        lattices_table(part),
        page.picture(
            "verification-front",
            "Profiles of a compaction front in several cells, and its thickness",
            partial(draw_lattices, part),
        ),
        LATTICES,
    ]


def velocities_table(part: Part) -> str:
    """Stress, strain, speed and dissipation by velocity."""
    header = ["foam", "v, m/s", "stress, kPa", "theory 1", "theory 2", "strain behind"]
    header += ["front, m/s", "momentum", "energy dissipated"]
    rows = []
    for name, foam in FOAMS.items():
        for velocity in VELOCITIES:
            run = part.get(f"{name}, {velocity:g} m/s")
            if run is not None:
                rows.append([name, f"{velocity:g}", *_velocity_row(Shock(foam, velocity), run)])
    return table(header, rows)


def _velocity_row(bar: Shock, run: Part) -> list[str]:
    found, jump = run["measured"], run["jump"]
    carried = jump["ahead"]["stress"] + DENSITY * found["speed"] * jump["velocity_jump"]
    idealised = percent(found["stress"] / run["locking_stress"] - 1)
    return [
        f"{1e-3 * found['stress']:.1f}",
        idealised if bar.foam is shock.LOCKING else f"({idealised})",
        percent(found["stress"] / jump["stress"] - 1, 2),
        f"{found['strain']:.4f} ({jump['strain']:.4f})",
        f"{found['speed']:.1f} ({jump['speed']:.1f})",
        percent(carried / found["stress"] - 1, 2),
        percent(found["dissipated"] - 1, 2),
    ]


def lattices_table(part: Part) -> str:
    """Stress, ringing and thickness by cell and viscosity, at one velocity."""
    header = ["viscosity, Pa s", "cell, mm", "stress", "rows swing by", "front, m/s"]
    header += ["thickness, mm", "of the dashpots, mm", "in cells", "energy dissipated"]
    rows = []
    bars = shock.plan()
    for share in (*shock.SHARES, *shock.SMALL_SHARES):
        for cell in shock.CELLS:
            name = shock.lattice_name(cell, share)
            if name in part:
                known = [f"{bars[name].viscosity:.3g}", f"{1e3 * cell:g}"]
                rows.append(known + _lattice_row(part[name], cell))
    return table(header, rows)


def _lattice_row(run: Part, cell: float) -> list[str]:
    if "failed" in run:
        return ["went astray"] + [""] * 6
    found, jump = run["measured"], run["jump"]
    width = found["thickness"]
    return [
        percent(found["stress"] / jump["stress"] - 1, 2),
        f"{100 * found['swing']:.1f} %",
        f"{found['speed']:.2f} ({jump['speed']:.2f})",
        "" if width is None else f"{1e3 * width:.2f}",
        f"{1e3 * jump['thickness']:.2f}",
        "" if width is None else f"{width / cell:.1f}",
        percent(found["dissipated"] - 1, 2),
    ]


def draw_velocities(part: Part, path: Path) -> None:
    """Stress behind the front against velocity, with both theories."""
    names = [name for name in FOAMS if f"{name}, {VELOCITIES[-1]:g} m/s" in part]
    with panels(path, names) as axes:
        for axis, name in zip(axes, names, strict=True):
            runs = [part[f"{name}, {v:g} m/s"] for v in VELOCITIES]
            fine = np.linspace(VELOCITIES[0], VELOCITIES[-1], 60)
            bars = [Shock(FOAMS[name], float(v)) for v in fine]
            axis.plot(
                fine, [1e-3 * bar.locking_stress for bar in bars], "--", color=GREY,
                label="$\\sigma_p + \\rho v^2 / e_d$",
            )  # fmt: skip
            axis.plot(
                fine, [1e-3 * bar.front.stress for bar in bars], color=CYCLE[0],
                label="jump conditions",
            )  # fmt: skip
            axis.plot(
                VELOCITIES, [1e-3 * run["measured"]["stress"] for run in runs], MARKS[0],
                color=CYCLE[1], markersize=8, label="lattice",
            )  # fmt: skip
            axis.set_xlabel("velocity of the plate (m/s)")
            axis.set_ylabel("stress behind the front (kPa)")
            axis.set_ylim(0, 1500)
            key(axis, "upper left")


def draw_lattices(part: Part, path: Path) -> None:
    """Profiles of one front in several cells, and thickness against cell size."""
    with panels(path, ("profile, Table 6's viscosity", "thickness"), 6.2) as (left, right):
        for colour, cell in zip(CYCLE, shock.CELLS, strict=False):
            run = part.get(shock.lattice_name(cell, 1.0))
            if run is not None:
                distance, strain = run["profile"]
                left.plot(
                    1e3 * np.array(distance), strain, color=colour, label=f"{1e3 * cell:g} mm"
                )
        left.set_xlabel("distance from the front's middle (mm)")
        left.set_ylabel("compressive strain")
        left.set_xlim(-60, 60)
        key(left, "lower left", "cell")
        for colour, mark, share in zip(CYCLE, MARKS, shock.SHARES, strict=False):
            _draw_thickness(right, part, share, colour, mark)
        cells = 1e3 * np.array([shock.CELLS[-1], shock.CELLS[0]])
        right.plot(cells, cells, ":", color=INK, linewidth=1.5, label="one cell")
        right.set_yscale("log")
        right.set_yticks([1, 2, 5, 10, 20, 50], ["1", "2", "5", "10", "20", "50"])
        right.set_ylabel("10 to 90 % of the strain (mm)")
        cell_axis(right, shock.CELLS)
        right.set_ylim(1, 200)
        right.legend(loc="upper left", ncols=2, fontsize=11, frameon=False)


def _draw_thickness(axis: Axes, part: Part, share: float, colour: str, mark: str) -> None:
    runs = {cell: part.get(shock.lattice_name(cell, share)) for cell in shock.CELLS}
    known = {cell: run for cell, run in runs.items() if run and run["measured"]["thickness"]}
    if not known:
        return
    cells = [1e3 * cell for cell in known]
    widths = [1e3 * run["measured"]["thickness"] for run in known.values()]
    theory = 1e3 * next(iter(known.values()))["jump"]["thickness"]
    text = f"{share * shock.VISCOSITY:.3g} Pa s"
    axis.plot(cells, widths, mark, color=colour, markersize=8, label=text)
    axis.axhline(theory, color=colour, linewidth=1.2)
