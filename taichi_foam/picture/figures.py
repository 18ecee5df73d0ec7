"""Figures in the manner of the paper's, with Matplotlib's object interface (no global state).

Every function takes plain arrays in SI units and returns a `Figure`; `style.save` writes it. Curves
are labelled where they are, in colours that colour-blind readers can tell apart (Okabe and Ito).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from numpy.typing import ArrayLike, NDArray

from taichi_foam.errors import UserError
from taichi_foam.picture.labels import beside, spread
from taichi_foam.picture.style import (
    CYCLE,
    INK,
    LEGEND,
    ORANGE,
    STYLE,
    VERMILION,
    blank,
)
from taichi_foam.records.history import COLUMNS, LEDGER

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Array = NDArray[np.float64]
History = Mapping[str, Array]

#: Columns of the history that show how the impactor moves.
MOTION = tuple(
    COLUMNS[name] for name in ("deceleration_smoothed_m_s2", "velocity_m_s", "displacement_m")
)
#: Those of a crosshead, which is not slowed down.
PRESSING = (COLUMNS["contact_force_N"], *MOTION[1:])
#: Energies below zero by less than this share of the largest are rounding.
_ROUNDING = 1e-3


@dataclass(frozen=True)
class Absorption:
    """Energy absorbed [J] against volume crushed [m3], arrays (n,), of one impact."""

    velocity: float
    volume: Array
    energy: Array


def impact_histories(histories: Mapping[float, History]) -> Figure:
    """Deceleration, velocity and displacement of impacts at several velocities (Fig. 5).

    Args:
        histories: by impact velocity [m/s]: columns time_s, deceleration_smoothed_m_s2,
            velocity_m_s and displacement_m.
    """
    with mpl.rc_context(STYLE):
        figure = blank(8.0, 10.5)
        axes = figure.subplots(3, 1, sharex=True)
        ends = []
        for axis, column, mark in zip(axes, MOTION, "abc", strict=True):
            label, factor = column.axis
            ends.clear()
            for colour, (velocity, history) in zip(CYCLE, sorted(histories.items()), strict=False):
                time, values = 1e3 * history["time_s"], factor * history[column.name]
                axis.plot(time, values, color=colour, label=f"{velocity:.2f} m/s")
                ends.append((time[-1], values[-1], f"{velocity:.2f} m/s", colour))
            axis.set_ylabel(label)
            axis.set_title(f"({mark})")
            axis.axhline(0, color=INK, linewidth=0.8)
        low, high = axes[-1].get_ylim()  # only the displacements end apart from one another
        heights = spread([value for _, value, *_ in ends], 0.075 * (high - low))
        for height, (x, _, name, colour) in zip(heights, ends, strict=True):
            beside(axes[-1], x, height, name, colour, (7, 0), "center")
        axes[0].set_ylim(bottom=min(0.0, axes[0].get_ylim()[0]))
        handles, labels = axes[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside upper right", ncols=len(labels), **LEGEND)
        axes[-1].set_xlabel("time (ms)")
        latest = max(float(history["time_s"][-1]) for history in histories.values())
        axes[-1].set_xlim(0, 1e3 * latest * 1.18)
    return figure


def energy_against_volume(
    groups: Mapping[str, Sequence[Absorption]],
    measured_slopes: Mapping[str, Sequence[float]] | None = None,
) -> Figure:
    """Energy absorbed against volume crushed, a panel for each shape (Fig. 13).

    Args:
        groups: by the impactor's name, its impacts.
        measured_slopes: by the same names, measured energies per volume [J/m3] (Table 5), drawn
            as a wedge from the smallest to the largest.
    """
    slopes = measured_slopes or {}
    with mpl.rc_context(STYLE):
        figure = blank(4.6 * max(1, len(groups)), 4.9)
        axes = figure.subplots(1, len(groups), sharex=True, sharey=True, squeeze=False)[0]
        widest = max(float(a.volume.max()) for group in groups.values() for a in group)
        tallest = max(float(a.energy.max()) for group in groups.values() for a in group)
        right, top = 1e6 * widest * 1.12, tallest * 1.14
        for axis, mark, (name, group) in zip(axes, "abcdefghi", groups.items(), strict=False):
            axis.set_title(f"({mark}) {name}")
            axis.set_xlabel("volume crushed (cm³)")
            axis.set_xlim(0, right)
            axis.set_ylim(0, top)
            if name in slopes:
                _mark_slopes(axis, slopes[name], right, top)
            for colour, impact in zip(CYCLE, group, strict=False):
                volume = 1e6 * impact.volume
                axis.plot(volume, impact.energy, color=colour, solid_capstyle="round")
                axis.plot(volume[-1], impact.energy[-1], "o", color=colour, markersize=6)
                name, end = f"{impact.velocity:.2f} m/s", impact.energy[-1]
                beside(axis, volume[-1], end, name, colour, (-9, 3), "bottom", "right")
        axes[0].set_ylabel("energy absorbed (J)")
    return figure


def stress_strain(branches: Mapping[str, tuple[ArrayLike, ArrayLike]]) -> Figure:
    """The foam's law: loading, unloading and re-tension (Fig. 19).

    Args:
        branches: by name, engineering strain and stress [Pa] along the branch (n,), tension
            positive; drawn with compression to the right and upwards, as crush curves are.
    """
    with mpl.rc_context(STYLE):
        figure = blank(8.0, 5.4)
        axis = figure.subplots()
        for colour, (name, (strain, stress)) in zip(CYCLE, branches.items(), strict=False):
            x, y = -100 * np.asarray(strain), -1e-6 * np.asarray(stress)
            axis.plot(x, y, color=colour, label=name)
            for k in (0, -1):
                if y[k] < 0:  # a branch that ends in tension ends where the bond breaks
                    axis.plot(x[k], y[k], "x", color=colour, markersize=10, mew=2.5)
                    beside(axis, x[k], y[k], "breaks", colour, (9, -3), "top")
        axis.axhline(0, color=INK, linewidth=0.9)
        axis.axvline(0, color=INK, linewidth=0.9)
        axis.set_xlabel("compressive engineering strain (%)")
        axis.set_ylabel("compressive engineering stress (MPa)")
        axis.legend(loc="lower right", **LEGEND)
    return figure


def energy_ledger(history: History) -> Figure:
    """Where the impact energy goes: the ledger's parts stacked over time.

    Args:
        history: columns time_s and energies of the ledger [J]; those that only a few runs have
            may be absent.

    Raises UserError for a history without energy.
    """
    time = 1e3 * history["time_s"]
    names, layers, tones = ledger_layers(history)
    with mpl.rc_context(STYLE):
        figure = blank(9.0, 5.2)
        axis = figure.subplots()
        axis.stackplot(time, layers, colors=tones, edgecolor="white", linewidth=0.6)
        axis.set_xlim(time[0], time[-1])
        axis.set_ylim(0, 1.04 * float(np.max(np.sum(layers, axis=0))))
        axis.set_xlabel("time (ms)")
        axis.set_ylabel("energy (J)")
        axis.grid(visible=False)

        edges = np.concatenate([[0.0], np.cumsum([layer[-1] for layer in layers])])
        middles = (edges[:-1] + edges[1:]) / 2
        shown = [k for k, layer in enumerate(layers) if layer.max() > 0.004 * edges[-1]]
        spots = spread([middles[k] for k in shown], 0.062 * axis.get_ylim()[1])
        for k, spot in zip(shown, spots, strict=True):
            axis.annotate(
                f"{names[k]}  {layers[k][-1]:.2g} J",
                (1.0, middles[k]),
                xycoords=axis.get_yaxis_transform(),
                xytext=(1.04, spot),
                textcoords=axis.get_yaxis_transform(),
                va="center",
                annotation_clip=False,
                arrowprops={
                    "arrowstyle": "-",
                    "color": tones[k],
                    "linewidth": 2.5,
                    "relpos": (0, 0.5),
                    "shrinkA": 2,
                    "shrinkB": 0,
                },
            )
    return figure


def ledger_layers(history: History) -> tuple[list[str], list[Array], list[str]]:
    """Names, energies (n,) [J] and colours of the layers of LEDGER that a history has.

    A part that gives back more than it took, such as the shear of a block that starts sheared, goes
    below zero: it is counted from its lowest, and its name says so. The stack keeps its height.
    What a crosshead or a pulse gives is no part: the stack of such a test grows by it.

    Raises UserError where there are none.
    """
    names, layers, tones = [], [], []
    largest = max(
        (
            float(np.max(np.abs(history[c])))
            for layer in LEDGER
            for c in layer.columns
            if c in history
        ),
        default=0.0,
    )
    drives = float(np.min(history.get("base_J", 0.0))) < -_ROUNDING * largest
    for layer in LEDGER:
        if drives and layer.columns == ("base_J",):
            continue
        nothing = np.zeros_like(history["time_s"])
        total = sum((history[c] for c in layer.columns if c in history), start=nothing)
        if np.any(np.abs(total) > 0):
            lowest = float(total.min())
            # A stack of areas has no place below zero. By rounding a part may dip there, too.
            given_back = lowest < -_ROUNDING * largest
            layers.append(total - lowest if given_back else np.maximum(total, 0.0))
            names.append(f"{layer.label}, from its lowest" if given_back else layer.label)
            tones.append(layer.colour)
    if not layers:
        raise UserError("energy ledger: the history holds no energy to show")
    return names, layers, tones


def _mark_slopes(axis: Axes, slopes: Sequence[float], right: float, top: float) -> None:
    """The measured energies per volume as a wedge of straight lines from the origin."""
    low, high = 1e-6 * min(slopes), 1e-6 * max(slopes)
    x = np.array([0.0, right])
    axis.fill_between(x, low * x, high * x, color=ORANGE, alpha=0.30, linewidth=0)
    middle = (low + high) / 2
    axis.plot(x, middle * x, color=VERMILION, linewidth=1.2, linestyle=(0, (5, 3)))
    x_text = 0.97 * right
    span = f"{10 * low:.2f}" if low == high else f"{10 * low:.2f} to {10 * high:.2f}"
    text = f"measured\n{span} · 10⁵ J/m³"
    axis.annotate(text, (x_text, 0.05 * top), ha="right", va="bottom", color=VERMILION)
