"""The figure and the report of energy absorption: six panels, landmarks, what is assumed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import LogLocator, NullLocator
from numpy.typing import NDArray

from taichi_foam.cushions.display import Unit
from taichi_foam.picture.style import CYCLE, GREY, HALO, INK, STYLE, blank

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from taichi_foam.cushions.efficiency import Absorber, Efficiency
    from taichi_foam.formulas.envelope import Envelope

Array = NDArray[np.float64]
Units = Mapping[str, Unit]

_BEYOND = 4.0
"""Over strain a curve is drawn up to this many times the stress at its shoulder."""

_ROOM = 1.8
"""The panel of stress ends at this many times the largest stress at a shoulder."""

_NAMED, _LINE = 5, 0.065
"""Up to so many foams have their landmarks written into the figure, in lines of this height."""

EXPLAINED = (
    "onset: the strain at which the efficiency W/σ, energy absorbed over stress, is largest, and "
    "densification begins; there: stress, energy, ideality W/(σε), Janssen's factor σ/W"
)
"""What the heads of the landmarks mean."""

_DASHED = (0, (3, 2))
_PERCENT = Unit("%", 0.01)


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
        stress, energy, efficiency, ideality, diagram, best = axes
        _over_strain(stress, foams, shades, "stress", units["stress"])
        top = max(float(foam.stress[foam.shoulder]) for foam in foams) / units["stress"].size
        stress.set_ylim(0, _ROOM * top)
        _over_strain(energy, foams, shades, "energy", units["energy"])
        _over_strain(efficiency, foams, shades, "efficiency", _PERCENT)
        _over_strain(ideality, foams, shades, "ideality", _PERCENT)
        _over_stress(diagram, foams, shades, "energy", units["stress"], units["energy"])
        _over_stress(best, foams, shades, "efficiency", units["stress"], _PERCENT)
        if len(foams) > 1:
            _envelope(diagram, best, found.envelope, units)
        for axis, mark, label in zip(
            axes,
            "abcdef",
            (
                f"compressive stress σ ({units['stress'].name})",
                f"energy absorbed W ({units['energy'].name})",
                "efficiency W / σ (%)",
                "ideality W / (σ ε) (%)",
                f"energy absorbed W ({units['energy'].name})",
                "efficiency W / σ (%)",
            ),
            strict=True,
        ):
            axis.set_title(f"({mark})")
            axis.set_ylabel(label)
        if len(foams) <= _NAMED:
            _landmarks(stress, efficiency, foams, shades, units["stress"])
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


def _over_strain(
    axis: Axes, foams: Sequence[Absorber], shades: Sequence, key: str, unit: Unit
) -> None:
    for foam, shade in zip(foams, shades, strict=True):
        drawn = foam.stress <= _BEYOND * foam.stress[foam.shoulder]
        x, y = 100 * foam.strain[drawn], getattr(foam, key)[drawn] / unit.size
        if key == "ideality":
            x, y = x[1:], y[1:]  # it has no value at rest
        _curve(axis, foam, shade, x, y, 100 * foam.strain[drawn][-x.size :])
        at = foam.shoulder
        axis.plot(
            100 * foam.strain[at], getattr(foam, key)[at] / unit.size, "o", color=shade,
            markersize=8, mec="white", zorder=4,
        )  # fmt: skip
    axis.set_xlabel("compressive strain ε (%)")
    axis.set_xlim(0, 100)
    axis.set_ylim(bottom=0)


def _over_stress(
    axis: Axes, foams: Sequence[Absorber], shades: Sequence, key: str, across: Unit, up: Unit
) -> None:
    """Draw energy or efficiency over stress, which is logarithmic; energy is, too."""
    for foam, shade in zip(foams, shades, strict=True):
        x, y = foam.stress[1:] / across.size, getattr(foam, key)[1:] / up.size
        _curve(axis, foam, shade, x, y, 100 * foam.strain[1:])
        at = foam.shoulder
        axis.plot(
            foam.stress[at] / across.size, getattr(foam, key)[at] / up.size, "o", color=shade,
            markersize=8, mec="white", zorder=4,
        )  # fmt: skip
    shoulders = [foam.stress[foam.shoulder] for foam in foams]
    axis.set_xscale("log")
    axis.set_xlim(0.2 * min(shoulders) / across.size, 5.0 * max(shoulders) / across.size)
    _decades(axis.xaxis)
    if key == "energy":
        energies = [foam.energy[foam.shoulder] for foam in foams]
        axis.set_yscale("log")
        axis.set_ylim(0.02 * min(energies) / up.size, 4.0 * max(energies) / up.size)
        _decades(axis.yaxis)
    else:
        axis.set_ylim(bottom=0)
    axis.set_xlabel(f"compressive stress σ ({across.name})")


def _curve(axis: Axes, foam: Absorber, shade: object, x: Array, y: Array, percent: Array) -> None:
    """Draw a foam's curve, dashed from where it is assumed; `percent` is its strain."""
    known = np.full(x.size, True) if foam.known_to is None else percent <= 100 * foam.known_to
    axis.plot(x[known], y[known], color=shade, label=foam.name)
    if not known.all():
        rest = max(int(np.count_nonzero(known)) - 1, 0)
        axis.plot(x[rest:], y[rest:], color=shade, linestyle=_DASHED)


def _envelope(diagram: Axes, best: Axes, envelope: Envelope, units: Units) -> None:
    """Draw the least stress at each energy, as energy and as efficiency over stress."""
    stress, energy = envelope.stress, envelope.energy
    style: dict = {"color": INK, "linewidth": 6.0, "alpha": 0.22, "zorder": 1.5}
    across = stress / units["stress"].size
    diagram.plot(across, energy / units["energy"].size, **style)
    best.plot(across, 100 * energy / stress, **style)
    diagram.annotate(
        "grey: the least stress\nat each energy", (0.97, 0.04), xycoords="axes fraction",
        ha="right", va="bottom", color=INK, fontsize=12, path_effects=HALO,
    )  # fmt: skip


def _decades(side: object) -> None:
    """Plain numbers at 1, 2 and 5 of each decade."""
    side.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))  # type: ignore[attr-defined]
    side.set_major_formatter("{x:g}")  # type: ignore[attr-defined]
    side.set_minor_locator(NullLocator())  # type: ignore[attr-defined]


def _landmarks(
    stress: Axes, efficiency: Axes, foams: Sequence[Absorber], shades: Sequence, unit: Unit
) -> None:
    """Write plateau stresses and largest efficiencies into two panels, a line for each foam."""
    for line, (foam, shade) in enumerate(zip(foams, shades, strict=True)):
        at = foam.shoulder
        plateau = f"plateau {unit.text(foam.plateau_stress)} {unit.name}"
        onset = f"{100 * foam.efficiency[at]:.1f} % at {100 * foam.strain[at]:.1f} %"
        words = f"{onset} of strain" if foam.densifies else f"{onset}, its end"
        for axis, text, height, step, vertical in (
            (stress, plateau, 0.97, -_LINE, "top"),
            (efficiency, words, 0.03, _LINE, "bottom"),
        ):
            axis.annotate(
                text, (0.04 if vertical == "top" else 0.97, height + step * line),
                xycoords="axes fraction", ha="left" if vertical == "top" else "right", va=vertical,
                color=shade, fontweight="bold", fontsize=12, path_effects=HALO,
            )  # fmt: skip


def landmarks(foams: Sequence[Absorber], units: Units) -> tuple[list[str], list[list[str]]]:
    """The landmarks of each foam as texts: heads with units, and a row for each foam."""
    stress, energy, density = units["stress"], units["energy"], units["density"]
    head = [
        "foam", f"density ({density.name})", f"plateau ({stress.name})", "onset (%)",
        f"stress σ ({stress.name})", f"energy W ({energy.name})", "W/σ (%)", "W/(σε) (%)",
        "σ/W (-)",
    ]  # fmt: skip
    rows = []
    for row in (foam.row for foam in foams):
        onset = f"{100 * row['onset_strain']:.1f}"
        rows.append(
            [
                row["foam"],
                "" if row["density_kg_m3"] is None else density.text(row["density_kg_m3"]),
                stress.text(row["plateau_stress_Pa"]),
                onset if row["densifies"] else f">{onset}",
                stress.text(row["stress_Pa"]),
                energy.text(row["energy_J_m3"]),
                f"{100 * row['efficiency']:.1f}",
                f"{100 * row['ideality']:.1f}",
                f"{row['janssen_factor']:.2f}",
            ]
        )
    return head, rows


def choice(found: Efficiency, units: Units) -> tuple[list[str], list[list[str]]]:
    """Which foam takes an energy at the least stress, as texts; no rows for one foam."""
    stress, energy = units["stress"], units["energy"]
    head = ["least stress", f"from W ({energy.name})", f"to W ({energy.name})",
            f"from σ ({stress.name})", f"to σ ({stress.name})"]  # fmt: skip
    rows = [
        [row["foam"], *map(energy.text, row["energy_J_m3"]), *map(stress.text, row["stress_Pa"])]
        for row in found.choice
    ]
    return head, rows


def report(found: Efficiency, path: Path, units: Units) -> Path:
    """Write landmarks, choice, figure and foams as one HTML file. Raises UserError."""
    from taichi_foam.picture.document import Section, Table, write

    best = max(found.foams, key=lambda foam: foam.efficiency[foam.shoulder])
    at, stress = best.shoulder, units["stress"]
    lead = [
        f"{best.name} has the largest efficiency, {100 * best.efficiency[at]:.1f} % at "
        f"{100 * best.strain[at]:.1f} % of strain and {stress.text(best.stress[at])} {stress.name}."
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
    about = [[foam.name, f"{foam.title}. {foam.source}".strip()] for foam in found.foams]
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
