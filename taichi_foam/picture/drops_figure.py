"""Drops on one block, one after the other: their decelerations, and how they grow."""

from __future__ import annotations

from collections.abc import Sequence

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from taichi_foam.analysis.impact import first_contact
from taichi_foam.picture.style import INK, STYLE, blank
from taichi_foam.records.record import Record
from taichi_foam.results.result import Result
from taichi_foam.units import STANDARD_GRAVITY


def drops_figure(results: Sequence[Result]) -> Figure:
    """Decelerations (CFC 180) over time to the left, peaks and strains by number to the right."""
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
        left.set_ylabel("deceleration, CFC 180 (g)")
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
        right.set_ylabel("peak deceleration (g), with its strain")
    return figure


def _since_contact(record: Record) -> tuple[np.ndarray, np.ndarray]:
    """Times since first contact [s], and decelerations [g], CFC 180."""
    touch, history = first_contact(record), record.history
    time = history["time_s"] - (touch.contact if touch else 0.0)
    return time, history["deceleration_smoothed_m_s2"] / STANDARD_GRAVITY
