"""Figures of a calibration: the posterior, the predicted trace, and the errors of the emulator."""

from __future__ import annotations

from typing import TYPE_CHECKING

import matplotlib as mpl
import numpy as np

from taichi_foam.calibration.outcome import NINETY, Calibration, Parameter
from taichi_foam.formulas.traces import channel
from taichi_foam.picture.style import BLUE, GREY, INK, STYLE, VERMILION, blank
from taichi_foam.units import si_scale

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_BINS = 30
_MOST_DOTS = 1500

_PREFIXED = ("Pa", "m", "s", "J/m2", "J", "N", "m/s")
"""Units before which a prefix means what it says: not with powers, nor with kg."""


def posterior(found: Calibration) -> Figure:
    """Each parameter's posterior on the diagonal, and each pair below it."""
    parameters, count = found.parameters, len(found.parameters)
    random = np.random.default_rng(0)
    chosen = random.choice(len(found.samples), min(_MOST_DOTS, len(found.samples)), replace=False)
    side = 3.4 if count > 1 else 4.6
    with mpl.rc_context(STYLE):
        figure = blank(max(6.4, side * count), side * count)
        axes = np.atleast_2d(figure.subplots(count, count))
        for row, below in enumerate(parameters):
            for column, across in enumerate(parameters):
                axis = axes[row, column]
                if column > row:
                    axis.set_visible(False)
                    continue
                scale, label = _axis_of(across)
                axis.set_xlim(across.prior[0] / scale, across.prior[1] / scale)
                if row == count - 1:
                    axis.set_xlabel(label)
                else:
                    axis.tick_params(labelbottom=False)
                axis.locator_params(nbins=3)
                if row == column:
                    _marginal(axis, found, column, scale, named=row == 0)
                    continue
                other, other_label = _axis_of(below)
                axis.scatter(
                    found.samples[chosen, column] / scale,
                    found.samples[chosen, row] / other,
                    s=6, color=BLUE, alpha=0.25, linewidths=0, rasterized=True,
                )  # fmt: skip
                axis.set_ylim(below.prior[0] / other, below.prior[1] / other)
                axis.set_title(f"correlation {found.correlation[row, column]:+.2f}", fontsize=11)
                if column == 0:
                    axis.set_ylabel(other_label)
                else:
                    axis.tick_params(labelleft=False)
    return figure


def trace(found: Calibration) -> Figure:
    """The measured trace, and the band of traces that the posterior predicts.

    Raises UserError: there is no trace.
    """
    own, whole = found.bands
    reading = found.reading
    assert reading is not None  # the bands have checked this
    time = 1e3 * reading.reader.time
    with mpl.rc_context(STYLE):
        figure = blank(9.0, 5.0)
        axis = figure.subplots()
        axis.fill_between(
            time, whole[0], whole[2], color=BLUE, alpha=0.15, linewidth=0,
            label="5-95 % with noise and model discrepancy",
        )  # fmt: skip
        axis.fill_between(
            time, own[0], own[2], color=BLUE, alpha=0.35, linewidth=0, label="5-95 % of runs"
        )
        axis.plot(time, own[1], color=BLUE, label="median of runs")
        axis.plot(time, reading.series, color=INK, linewidth=1.6, label="measured")
        for edge in reading.reader.edges:
            axis.axvline(1e3 * edge, color=GREY, linewidth=0.7, linestyle=":")
        axis.set_xlabel("time from onset (ms)")
        axis.set_ylabel(f"deceleration, {channel(reading.reader.channel_class)} (m/s²)")
        axis.legend(frameon=False)
    return figure


def errors(found: Calibration) -> Figure:
    """Errors of the emulator, each run left out once, in predicted standard deviations."""
    emulator = found.target.emulator
    away = emulator.errors / emulator.widening
    with mpl.rc_context(STYLE):
        figure = blank(9.0, 0.9 + 0.5 * len(found.names))
        axis = figure.subplots()
        random = np.random.default_rng(0)
        for place, each in enumerate(away.T):
            jitter = random.uniform(-0.25, 0.25, len(each))
            axis.scatter(each, place + jitter, s=12, color=BLUE, alpha=0.6, linewidths=0)
        for end in (-NINETY, NINETY):
            axis.axvline(end, color=VERMILION, linewidth=1.2)
        axis.set_yticks(range(len(found.names)), found.names)
        axis.invert_yaxis()
        reach = max(4.0, 1.05 * float(np.abs(away).max()))
        axis.set_xlim(-reach, reach)
        axis.set_xlabel("error of a run left out, in predicted deviations (-)")
    return figure


def _marginal(axis: Axes, found: Calibration, d: int, scale: float, named: bool) -> None:
    """The posterior of one parameter as a histogram, with its interval and the prior."""
    one, parameter = found.space.ranges[d], found.parameters[d]
    ends = one.value(np.linspace(0.0, 1.0, _BINS + 1))
    counts, _ = np.histogram(found.posterior.unit[:, d], _BINS, (0.0, 1.0))
    density = counts / counts.sum() * _BINS
    colour = BLUE if parameter.is_determined else VERMILION
    axis.stairs(density, ends / scale, fill=True, color=colour, alpha=0.5, label="posterior")
    axis.axhline(1.0, color=GREY, linestyle="--", linewidth=1.2, label="prior")
    for value in (parameter.low, parameter.high):
        axis.axvline(value / scale, color=colour, linewidth=1.2)
    axis.set_title(parameter.verdict, color=colour, fontsize=11)
    axis.set_yticks([])
    axis.set_ylim(0.0, 1.15 * max(density.max(), 1.2))
    axis.set_ylabel("density" if d == 0 else "")
    if named:
        axis.legend(loc="upper right", fontsize=9, frameon=False)


def _axis_of(parameter: Parameter) -> tuple[float, str]:
    """The factor of a parameter's axis, and its label."""
    scale, prefix = 1.0, ""
    if parameter.unit in _PREFIXED:
        scale, prefix = si_scale(max(map(abs, parameter.prior)))
    return scale, f"{parameter.key} ({prefix}{parameter.unit or '-'})"
