"""Figures of runs, drops and foams, with Matplotlib's object interface (no global state).

Every function takes values in SI units and returns a `Figure`; `style.save` writes it. Curves are
labelled directly, in colours that colour-blind readers can distinguish (Okabe and Ito).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy.typing import ArrayLike, NDArray

from taichi_foam.analysis.impact import first_contact
from taichi_foam.errors import UserError
from taichi_foam.picture.style import (
    BLUE,
    CYCLE,
    GREEN,
    GREY,
    HALO,
    INK,
    LEGEND,
    ORANGE,
    STYLE,
    VERMILION,
    beside,
    blank,
    plain_log,
    spread,
)
from taichi_foam.records.history import COLUMNS, FILTER, LEDGER
from taichi_foam.units import STANDARD_GRAVITY, pressure_text, si_scale

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from taichi_foam.laws.bond.by_curve import CurveFoam
    from taichi_foam.laws.bond.fit import CrushableFit
    from taichi_foam.records.record import Record
    from taichi_foam.results.result import Result

Array = NDArray[np.float64]
History = Mapping[str, Array]

#: Columns of the history for the motion of the impactor.
MOTION = tuple(
    COLUMNS[name] for name in ("deceleration_smoothed_m_s2", "velocity_m_s", "displacement_m")
)
#: The same for a crosshead, which is not slowed down.
PRESSING = (COLUMNS["contact_force_N"], *MOTION[1:])
#: Negative energies smaller than this share of the largest are rounding errors.
_ROUNDING = 1e-3

_BESIDE, _UPPER = 0.04, 0.55
"""Width of a landmark's name in strain, and the part of the height above which it is placed."""

_PLATEAUS, _ROOM = 2.0, 1.25
"""The left panel ends at this many plateau stresses, or this multiple of the stress at the start of
densification. Higher stresses would flatten the plateau."""

_DECADES = (0.1, 3.0)
"""Ends of the logarithmic panel: factors of the plateau stress and of the largest stress."""

_APART = 0.12
"""Landmarks nearer than this in strain have their names on opposite sides."""


@dataclass(frozen=True)
class Absorption:
    """Energy absorbed [J] against volume crushed [m3] in one impact, arrays (n,)."""

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
        low, high = axes[-1].get_ylim()  # only the displacement curves end at different values
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
    measured_slopes: Mapping[str, Sequence[float]],
) -> Figure:
    """Energy absorbed against volume crushed, a panel for each shape (Fig. 13).

    Args:
        groups: by the impactor's name, its impacts.
        measured_slopes: by the same names, measured energies per volume [J/m3] (Table 5), drawn
            as a wedge from the smallest to the largest.
    """
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
            if name in measured_slopes:
                _mark_slopes(axis, measured_slopes[name], right, top)
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
        history: columns time_s and energies of the ledger [J]; rare ones may be absent.

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

    A part that returns more energy than it took, such as the shear of an initially sheared block,
    becomes negative: it is counted from its minimum, and its name says so. The height of the stack
    does not change. Energy from a crosshead or a pulse is not a part: the stack of such a test
    grows by it.

    Raises UserError if there are no layers.
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
            # Stacked areas cannot be negative. Rounding may also make a part negative.
            given_back = lowest < -_ROUNDING * largest
            layers.append(total - lowest if given_back else np.maximum(total, 0.0))
            names.append(f"{layer.label}, above its minimum" if given_back else layer.label)
            tones.append(layer.colour)
    if not layers:
        raise UserError("energy ledger: the history holds no energy to show")
    return names, layers, tones


def _mark_slopes(axis: Axes, slopes: Sequence[float], right: float, top: float) -> None:
    """Draw the measured energies per volume as a wedge of straight lines from the origin."""
    low, high = 1e-6 * min(slopes), 1e-6 * max(slopes)
    x = np.array([0.0, right])
    axis.fill_between(x, low * x, high * x, color=ORANGE, alpha=0.30, linewidth=0)
    middle = (low + high) / 2
    axis.plot(x, middle * x, color=VERMILION, linewidth=1.2, linestyle=(0, (5, 3)))
    x_text = 0.97 * right
    span = f"{10 * low:.2f}" if low == high else f"{10 * low:.2f} to {10 * high:.2f}"
    text = f"measured\n{span} · 10⁵ J/m³"
    axis.annotate(text, (x_text, 0.05 * top), ha="right", va="bottom", color=VERMILION)


# --- drops on one block -------------------------------------------------------------------------


def drops_figure(results: Sequence[Result]) -> Figure:
    """Smoothed decelerations over time on the left, peaks and strains by drop on the right."""
    shades = mpl.colormaps["viridis"](np.linspace(0.0, 0.85, max(len(results), 2)))
    with mpl.rc_context(STYLE):
        figure = blank(12.0, 5.0)
        name = results[0].scene.name
        figure.suptitle(f"{name}: drops on one block", x=0.01, ha="left", fontweight="bold")
        left, right = figure.subplots(1, 2, width_ratios=(1.9, 1.0))
        for result, shade in zip(results, shades, strict=False):
            time, deceleration = _since_contact(result)
            left.plot(1e3 * time, deceleration, color=shade, label=f"drop {result.drop}")
        left.set_xlabel("time after contact (ms)")
        left.set_ylabel(f"deceleration, {FILTER} (g)")
        left.set_xlim(0.0, None)
        left.legend(frameon=False, fontsize=11, ncols=1 + len(results) // 9)
        numbers = [result.drop for result in results]
        peaks = [result.summary["peak_deceleration_cfc180_g"] for result in results]
        strains = [result.summary["max_strain"] for result in results]
        shown = [np.nan if peak is None else peak for peak in peaks]
        right.plot(numbers, shown, color=INK, zorder=2)
        right.scatter(numbers, shown, c=shades[: len(results)], s=60, zorder=3)
        for number, peak, strain in zip(numbers, peaks, strains, strict=True):
            if peak is not None and strain is not None and len(results) <= 12:
                right.annotate(
                    f"{100 * strain:.0f} %", (number, peak), (-4, 7), textcoords="offset points",
                    ha="right", fontsize=10,
                )  # fmt: skip
        right.set_ylim(0.0, 1.18 * (max((p for p in peaks if p is not None), default=0.0) or 1.0))
        right.set_xlim(min(numbers) - 0.7, max(numbers) + 0.5)
        right.xaxis.set_major_locator(MaxNLocator(integer=True))
        right.set_xlabel("drop")
        right.set_ylabel(f"peak deceleration, {FILTER} (g), with strain")
    return figure


def _since_contact(record: Record) -> tuple[np.ndarray, np.ndarray]:
    """Times since first contact [s], and smoothed decelerations [g]."""
    touch, history = first_contact(record), record.history
    time = history["time_s"] - (touch.contact if touch else 0.0)
    return time, history["deceleration_smoothed_m_s2"] / STANDARD_GRAVITY


# --- a foam's compression test ------------------------------------------------------------------


def compression_test(
    strain: Array,
    stress: Array,
    loading: NDArray[np.bool_],
    foam: CurveFoam,
    fit: CrushableFit,
    title: str,
) -> Figure:
    """A compression test in three panels: plateau, whole test, and energy efficiency.

    On the left stress over strain for the plateau, in the middle for the whole test on a
    logarithmic axis, since densification would flatten the plateau; on the right the efficiency.

    Args:
        strain, stress: points of the test (n,), fractions and Pa, compression positive.
        loading: which of them make up the curve (n,); the others are unloading and reloading.
        foam: the foam with the curve made from them.
        fit: Eq. 26 fitted to that curve.
        title: name of the foam.
    """
    marks = foam.landmarks
    densified = float(foam.curve.stress_at(np.array(-marks.crush_end)))
    top = max(_PLATEAUS * marks.plateau_stress, _ROOM * densified)
    largest = max(float(stress.max()), foam.curve.stress[-1])
    with mpl.rc_context(STYLE):
        figure = blank(16.0, 5.8)
        left, middle, right = figure.subplots(1, 3, width_ratios=(1.6, 1.0, 1.0))
        scale, prefix = si_scale(top)
        left.set_ylim(0, top / scale)
        _stresses(left, strain, stress, loading, foam, fit, scale)
        _names(left, foam, fit, scale)
        left.set_ylabel(f"compressive stress ({prefix}Pa)", labelpad=7)
        scale, prefix = si_scale(largest)
        middle.set_yscale("log")
        middle.set_ylim(_DECADES[0] * marks.plateau_stress / scale, _DECADES[1] * largest / scale)
        plain_log(middle.yaxis)
        _stresses(middle, strain, stress, loading, foam, fit, scale)
        middle.set_ylabel(f"the whole test, logarithmic ({prefix}Pa)", labelpad=7)
        _efficiency(right, foam)
        for axis in (left, middle, right):
            axis.set_xlabel("compressive strain (%)")
            axis.set_xlim(0, 103)
        figure.legend(
            *left.get_legend_handles_labels(), loc="outside upper left", ncols=5, frameon=False,
            fontsize=11, handlelength=2.0, columnspacing=1.4,
            title=_cut(title), title_fontproperties={"weight": "bold", "size": 15},
            alignment="left",
        )  # fmt: skip
    return figure


def _stresses(
    axis: Axes,
    strain: Array,
    stress: Array,
    loading: NDArray[np.bool_],
    foam: CurveFoam,
    fit: CrushableFit,
    scale: float,
) -> None:
    """Draw the points, the curve with its continuation, the fit, and lines at landmarks."""
    curve, marks, table = foam.curve, foam.landmarks, foam.table[:, 0]
    if not loading.all():
        axis.plot(
            100 * strain[~loading], stress[~loading] / scale, ".", color=GREY, markersize=5, mew=0,
            label=f"unloading and reloading, {np.count_nonzero(~loading):,} points",
        )  # fmt: skip
    largest = pressure_text(stress.max())
    axis.plot(
        100 * strain[loading], stress[loading] / scale, "o", color=GREY, markersize=6, alpha=0.5,
        mew=0, label=f"test, {np.count_nonzero(loading):,} points, to {largest}",
    )  # fmt: skip
    along = np.linspace(0.0, 1.0, table.size)
    beyond = along >= curve.tested
    tested = np.array([curve.tested, curve.stress[-1]])
    axis.plot(100 * curve.points[0], curve.points[1] / scale, color=BLUE, label="curve used")
    axis.plot(
        100 * np.append(tested[0], along[beyond]),
        np.append(tested[1], table[beyond]) / scale,
        color=BLUE, linestyle=(0, (3, 2)), label="extrapolated beyond the test",
    )  # fmt: skip
    # only over the tested range: beyond it the two differ
    fine = np.linspace(0.0, curve.tested, 800)
    axis.plot(
        100 * fine, fit.foam.loading(fine) / scale, color=VERMILION, linewidth=1.5,
        label=f"Eq. 26 fitted, median error {100 * fit.error:.2g} %",
    )  # fmt: skip
    for at in (marks.crush_start, marks.crush_end, marks.limit):
        axis.axvline(-100 * at, color=INK, linewidth=1.0, linestyle=(0, (1, 2)))


def _names(axis: Axes, foam: CurveFoam, fit: CrushableFit, scale: float) -> None:
    """Write the names of the landmarks, and the plateau stress."""
    marks = foam.landmarks
    start, end, limit = (-100 * s for s in (marks.crush_start, marks.crush_end, marks.limit))
    ends = f"densification, {end:.3g} %" if fit.densifies else f"test ends, {end:.3g} %"
    _landmark(axis, foam, scale, start, f"crushing starts, {start:.2g} %", to_the_right=True)
    _landmark(axis, foam, scale, end, ends, to_the_right=end < start + 100 * _APART)
    _landmark(axis, foam, scale, limit, f"locking, {limit:.3g} %", to_the_right=False)
    _plateau(axis, foam, fit, scale)


def _plateau(axis: Axes, foam: CurveFoam, fit: CrushableFit, scale: float) -> None:
    """Write the plateau stress above the middle of the plateau, or below it if there is no room."""
    plateau = foam.landmarks.plateau_stress
    middle = 0.5 * (-foam.landmarks.crush_start + foam.curve.densification)
    covered = np.linspace(middle - 0.2, min(middle + 0.2, foam.curve.tested), 50)
    lines = np.concatenate([foam.curve.stress_at(covered), fit.foam.loading(covered)]) / scale
    below = lines.max() > 0.88 * axis.get_ylim()[1]
    height, text = float(lines.min() if below else lines.max()), f"plateau {pressure_text(plateau)}"
    offset, vertical = ((0, -9), "top") if below else ((0, 7), "bottom")
    beside(axis, 100 * middle, height, text, BLUE, offset, vertical, "center")


def _landmark(
    axis: Axes, foam: CurveFoam, scale: float, at: float, text: str, *, to_the_right: bool
) -> None:
    """Write a landmark's name along its line at a strain [%], away from the curve."""
    side = np.linspace(0.0, _BESIDE if to_the_right else -_BESIDE, 20) + at / 100
    side = np.clip(side, 0.0, 1.0)
    height = np.interp(side, np.linspace(0.0, 1.0, len(foam.table)), foam.table[:, 0]) / scale
    crossed = height[height < axis.get_ylim()[1]]  # points outside the panel do not matter
    low = crossed.size > 0 and crossed.max() > _UPPER * axis.get_ylim()[1]
    axis.annotate(
        text, (at, 0.02 if low else 0.985), xycoords=axis.get_xaxis_transform(),
        xytext=(4 if to_the_right else -4, 0), textcoords="offset points", rotation=90,
        ha="left" if to_the_right else "right", va="bottom" if low else "top", color=INK,
        fontsize=11, path_effects=HALO,
    )  # fmt: skip


def _efficiency(axis: Axes, foam: CurveFoam) -> None:
    """Draw energy absorbed over stress, with its maximum, where densification begins."""
    curve = foam.curve
    strain, values = curve.points[0], curve.efficiency
    top = int(np.argmax(values))
    axis.plot(100 * strain, 100 * values, color=GREEN)
    axis.plot(100 * strain[top], 100 * values[top], "o", color=GREEN, markersize=9, mec="white")
    axis.annotate(
        f"largest: {100 * values[top]:.3g} %\nat {100 * strain[top]:.3g} % of strain",
        (100 * strain[top], 100 * values[top]), xytext=(0, 10), textcoords="offset points",
        ha="right" if strain[top] > 0.5 else "center" if strain[top] > 0.25 else "left",
        va="bottom", color=GREEN, fontweight="bold",
    )  # fmt: skip
    axis.set_ylim(0, 122 * values[top])
    axis.set_ylabel("energy efficiency: energy over stress (%)", labelpad=7)


def _cut(title: str, most: int = 100) -> str:
    """A title cut to the figure's width, with signs escaped that Matplotlib reads as formulas."""
    text = title if len(title) <= most else title[: most - 3] + "..."
    return text.replace("$", r"\$")
