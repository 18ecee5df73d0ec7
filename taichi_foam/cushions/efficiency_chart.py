"""The figure and the report of energy absorption: six panels, landmarks, what is assumed."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from taichi_foam.cushions.shown import Units
from taichi_foam.picture.style import CYCLE, GREY, HALO, INK, STYLE, blank, plain_log

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from taichi_foam.cushions.efficiency import Absorber, Efficiency
    from taichi_foam.formulas.envelope import Envelope

Array = NDArray[np.float64]

_BEYOND = 4.0
"""Over strain a curve is drawn up to this many times the stress at its shoulder."""

_ROOM = 1.8
"""The panel of stress ends at this many times the largest stress at a shoulder."""

_NAMED, _LINE = 5, 0.065
"""Up to so many foams have their landmarks written into the figure, in lines of this height."""

EXPLAINED = (
    "onset: the strain ε at which the efficiency W/σ, energy absorbed over stress, is largest, and "
    "densification begins; there: stress σ, energy W, ideality W/(σε), Janssen's factor σ/W"
)
"""What the heads of the landmarks mean."""

_DASHED = (0, (3, 2))


def chart(found: Efficiency, units: Units) -> Figure:
    """Stress, energy, efficiency and ideality over strain, energy and efficiency over stress.

    A dot is the shoulder, where densification begins; a curve is dashed where it is assumed. Over
    stress the envelope of several foams is a broad grey line beneath them.
    """
    foams = found.foams
    shades = _shades(foams)
    with mpl.rc_context(STYLE):
        figure = blank(16.0, 10.0)
        axes = figure.subplots(2, 3).ravel()
        stress, _, efficiency, _, diagram, best = axes
        for axis, key in zip(axes, ("stress", "energy", "efficiency", "ideality"), strict=False):
            _over_strain(axis, foams, shades, key, units)
        top = max(float(_shown(foam, "stress", units)[foam.shoulder]) for foam in foams)
        stress.set_ylim(0, _ROOM * top)
        for axis, key in ((diagram, "energy"), (best, "efficiency")):
            _over_stress(axis, foams, shades, key, units)
        if len(foams) > 1:
            _envelope(diagram, best, found.envelope, units)
        for axis, mark, label in zip(
            axes,
            "abcdef",
            (
                f"compressive stress σ ({units.unit('stress')})",
                f"energy absorbed W ({units.unit('energy')})",
                "efficiency W / σ (%)",
                "ideality W / (σ ε) (%)",
                f"energy absorbed W ({units.unit('energy')})",
                "efficiency W / σ (%)",
            ),
            strict=True,
        ):
            axis.set_title(f"({mark})")
            axis.set_ylabel(label)
        if len(foams) <= _NAMED:
            _landmarks(stress, efficiency, foams, shades, units)
        figure.legend(
            handles=[*stress.get_legend_handles_labels()[0], *_signs(foams)],
            loc="outside upper left", frameon=False, ncols=min(len(foams) + 2, 7), fontsize=12,
            handlelength=1.8, columnspacing=1.6,
        )  # fmt: skip
    return figure


def _signs(foams: Sequence[Absorber]) -> list[Line2D]:
    """What dots and dashes mean, for the legend."""
    dot = Line2D(
        [], [], color=GREY, marker="o", markersize=8, mec="white", linestyle="none",
        label="onset of densification",
    )  # fmt: skip
    dashes = Line2D([], [], color=GREY, linestyle=_DASHED, label="assumed")
    return [dot, dashes] if any(foam.known_to is not None for foam in foams) else [dot]


def _shades(foams: Sequence[Absorber]) -> list:
    """A colour for each foam; many are told apart by shade, in their order."""
    if len(foams) <= len(CYCLE):
        return [*CYCLE[: len(foams)]]
    return [*mpl.colormaps["viridis"](np.linspace(0.0, 0.92, len(foams)))]


def _shown(foam: Absorber, key: str, units: Units) -> Array:
    """The values of a curve as they are drawn: in these units, or in percent."""
    size = units.si(key, 1.0) if key in ("stress", "energy") else 0.01
    return getattr(foam, key) / size


def _over_strain(
    axis: Axes, foams: Sequence[Absorber], shades: Sequence, key: str, units: Units
) -> None:
    for foam, shade in zip(foams, shades, strict=True):
        drawn = foam.stress <= _BEYOND * foam.stress[foam.shoulder]
        drawn[0] = key != "ideality"  # which has no value at rest
        x, y = 100 * foam.strain, _shown(foam, key, units)
        _curve(axis, foam, shade, x, y, drawn)
    axis.set_xlabel("compressive strain ε (%)")
    axis.set_xlim(0, 100)
    axis.set_ylim(bottom=0)


def _over_stress(
    axis: Axes, foams: Sequence[Absorber], shades: Sequence, key: str, units: Units
) -> None:
    """Draw energy or efficiency over stress, which is logarithmic; energy is, too."""
    shoulders = []
    for foam, shade in zip(foams, shades, strict=True):
        x, y = _shown(foam, "stress", units), _shown(foam, key, units)
        _curve(axis, foam, shade, x, y, foam.stress > 0.0)
        shoulders.append((x[foam.shoulder], y[foam.shoulder]))
    (left, low), (right, high) = np.min(shoulders, axis=0), np.max(shoulders, axis=0)
    axis.set_xscale("log")
    axis.set_xlim(0.2 * left, 5.0 * right)
    plain_log(axis.xaxis)
    if key == "energy":
        axis.set_yscale("log")
        axis.set_ylim(0.02 * low, 4.0 * high)
        plain_log(axis.yaxis)
    else:
        axis.set_ylim(bottom=0)
    axis.set_xlabel(f"compressive stress σ ({units.unit('stress')})")


def _curve(
    axis: Axes, foam: Absorber, shade: object, x: Array, y: Array, drawn: NDArray[np.bool_]
) -> None:
    """Draw some points of a foam's curve, dashed from where it is assumed, and its shoulder."""
    known_to = foam.strain[-1] if foam.known_to is None else foam.known_to
    known, beyond = drawn & (foam.strain <= known_to), drawn & (foam.strain >= known_to)
    axis.plot(x[known], y[known], color=shade, label=foam.name)
    axis.plot(x[beyond], y[beyond], color=shade, linestyle=_DASHED)
    at = foam.shoulder
    axis.plot(x[at], y[at], "o", color=shade, markersize=8, mec="white", zorder=4)


def _envelope(diagram: Axes, best: Axes, envelope: Envelope, units: Units) -> None:
    """Draw the least stress at each energy, as energy and as efficiency over stress."""
    stress, energy = envelope.stress, envelope.energy
    style: dict = {"color": INK, "linewidth": 6.0, "alpha": 0.22, "zorder": 1.5}
    across = stress / units.si("stress", 1.0)
    diagram.plot(across, energy / units.si("energy", 1.0), **style)
    best.plot(across, 100 * energy / stress, **style)
    diagram.annotate(
        "grey: the least stress\nat each energy", (0.97, 0.04), xycoords="axes fraction",
        ha="right", va="bottom", color=INK, fontsize=12, path_effects=HALO,
    )  # fmt: skip


def _landmarks(
    stress: Axes, efficiency: Axes, foams: Sequence[Absorber], shades: Sequence, units: Units
) -> None:
    """Write plateau stresses and largest efficiencies above the curves, a line for each foam."""
    efficiency.set_ylim(top=efficiency.get_ylim()[1] * (1.0 + 1.2 * _LINE * len(foams)))
    for line, (foam, shade) in enumerate(zip(foams, shades, strict=True)):
        at = foam.shoulder
        plateau = f"plateau {units.text('stress', foam.plateau_stress)}"
        largest = f"{100 * foam.efficiency[at]:.1f} % at {100 * foam.strain[at]:.1f} % of strain"
        for axis, text in (
            (stress, plateau),
            (efficiency, largest if foam.densifies else f"{largest}, its end"),
        ):
            axis.annotate(
                text, (0.03, 0.97 - _LINE * line), xycoords="axes fraction", va="top", color=shade,
                fontweight="bold", fontsize=12, path_effects=HALO,
            )  # fmt: skip


def landmarks(foams: Sequence[Absorber], units: Units) -> tuple[list[str], list[list[str]]]:
    """The landmarks of each foam as texts: heads with units, and a row for each foam."""
    stress, energy = units.unit("stress"), units.unit("energy")
    head = [
        "foam", f"density ({units.unit('density')})", f"plateau ({stress})", "onset (%)",
        f"σ ({stress})", f"W ({energy})", "W/σ (%)", "W/(σε) (%)", "σ/W (-)",
    ]  # fmt: skip
    rows = []
    for row in (foam.row for foam in foams):
        density, onset = row["density_kg_m3"], f"{100 * row['onset_strain']:.1f}"
        rows.append(
            [
                row["foam"],
                "" if density is None else units.number("density", density),
                units.number("stress", row["plateau_stress_Pa"]),
                onset if row["densifies"] else f">{onset}",
                units.number("stress", row["stress_Pa"]),
                units.number("energy", row["energy_J_m3"]),
                f"{100 * row['efficiency']:.1f}",
                f"{100 * row['ideality']:.1f}",
                f"{row['janssen_factor']:.2f}",
            ]
        )
    return head, rows


def choice(found: Efficiency, units: Units) -> tuple[list[str], list[list[str]]]:
    """Which foam takes an energy at the least stress, as texts; no rows for one foam."""
    stress, energy = units.unit("stress"), units.unit("energy")
    head = [
        "least stress", f"from W ({energy})", f"to W ({energy})", f"from σ ({stress})",
        f"to σ ({stress})",
    ]  # fmt: skip
    rows = [
        [
            row["foam"],
            *(units.number("energy", each) for each in row["energy_J_m3"]),
            *(units.number("stress", each) for each in row["stress_Pa"]),
        ]
        for row in found.choice
    ]
    return head, rows


def report(found: Efficiency, path: Path, units: Units) -> Path:
    """Write landmarks, choice, figure and foams as one HTML file. Raises UserError."""
    from taichi_foam.picture.document import Section, Table, write

    best = max(found.foams, key=lambda foam: foam.efficiency[foam.shoulder])
    at = best.shoulder
    lead = [
        f"{best.name} has the largest efficiency, {100 * best.efficiency[at]:.1f} % at "
        f"{100 * best.strain[at]:.1f} % of strain and {units.text('stress', best.stress[at])}."
    ]
    caveats = " ".join(f"{each}." for each in found.caveats)
    marks = Table(*landmarks(found.foams, units), caveats)
    sections = [Section("Landmarks", [f"{EXPLAINED[0].upper()}{EXPLAINED[1:]}."], table=marks)]
    if len(found.foams) > 1:
        words = (
            "Which foam takes an energy per volume at the least stress: the envelope of the "
            "foams' shoulders (Maiti, Gibson & Ashby 1984)."
        )
        sections.append(Section("Choice", [words], table=Table(*choice(found, units))))
    about = [
        [foam.name, f"{foam.title}. Source: {foam.source}" if foam.source else foam.title]
        for foam in found.foams
    ]
    names = ", ".join(foam.name for foam in found.foams)
    sections += [
        Section(
            "Curves",
            figure=chart(found, units),
            alt=f"Six panels of curves of {names}: stress, energy, efficiency and ideality over "
            "strain, energy and efficiency over stress",
            caption="A dot is the onset of densification. Curves are dashed where they are "
            "assumed.",
        ),
        Section("Foams", table=Table((), about, is_text=True)),
    ]
    return write(path, "Energy absorption of foams", lead, sections)
