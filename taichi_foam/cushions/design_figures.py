"""Figures of a design: its cushion curve with runs, and how thick each foam must be."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import matplotlib as mpl
import numpy as np
from numpy.typing import NDArray

from taichi_foam.cushions import sizing
from taichi_foam.cushions.sizing import Pad
from taichi_foam.picture.style import (
    BLUE,
    CYCLE,
    GREEN,
    GREY,
    HALO,
    INK,
    STYLE,
    VERMILION,
    blank,
    plain_log,
)
from taichi_foam.records.history import FILTER

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from taichi_foam.cushions.design import Design

Array = NDArray[np.float64]

_TOP = 2.5
"""Height of a figure over the fragility."""

_COLOURS = (*CYCLE, INK)

_SAME = 0.02
"""Largest relative difference of curves that are drawn as one."""

_NAMED = 3
"""Most foams that a legend names beside one curve."""


def curve(found: Design) -> Figure:
    """Peak over static stress of one foam and drop height, for neighbouring thicknesses."""
    pad, units, wish = found.shown, found.units, found.wish
    with mpl.rc_context(STYLE):
        figure = blank(8.0, 6.2)
        axis = figure.subplots()
        if pad is None:
            axis.set_title("no pad of any foam and thickness comes near")
            axis.set_axis_off()
            return figure
        top = _TOP * max(wish.fragility, pad.g)
        beyond = replace(pad.foam, to_limit=True)
        for each in _neighbours(found, pad):
            own = each == pad.thickness
            colour, width = (BLUE, 2.6) if own else (GREY, 1.4)
            for foam, dashes in ((beyond, ":"), (pad.foam, "-")):
                response = sizing.response(foam, each, pad.wish.drop, wish.drops)
                there = np.isfinite(response.g)
                static, g = units.of("stress", 1.0) * response.static[there], response.g[there]
                axis.plot(static, g, dashes, color=colour, linewidth=width, zorder=2 + own)
            axis.plot(static[-1], g[-1], "x", color=colour, markersize=8, zorder=2 + own)
            best = int(np.argmin(g))
            axis.annotate(
                units.text("length", each), (static[best], g[best]), xytext=(-5, -5),
                textcoords="offset points", color=colour, fontweight="bold",
                path_effects=HALO, va="top", ha="right", clip_on=True,
            )  # fmt: skip
        low, high = (units.of("stress", each) for each in pad.statics)
        axis.axvspan(low, high, color=GREEN, alpha=0.13, linewidth=0)
        masses = " to ".join(units.number("mass", each) for each in pad.masses)
        _draw_fragility(axis, wish.fragility)
        _draw_runs(axis, found, pad)
        _draw_tests(axis, found, pad)
        at = units.of("stress", pad.static_stress)
        axis.plot(at, pad.g, "o", color="white", markeredgecolor=BLUE, markersize=9,
                  markeredgewidth=2, zorder=5, label="this pad, by the formula")  # fmt: skip
        axis.set_xscale("log")
        axis.set_xlim(at / 8.0, at * 4.0)
        plain_log(axis.xaxis)
        axis.set_ylim(0.0, top)
        axis.set_xlabel(f"static stress ({units.unit('stress')})")
        axis.set_ylabel("peak deceleration (g)")
        last = "" if wish.drops == 1 else f", drop {wish.drops}"
        axis.set_title(f"{pad.foam.label}, fall of {units.text('height', pad.wish.drop)}{last}")
        axis.plot([], [], "x", color=GREY, label="end of the foam's test: it bottoms out beyond")
        axis.fill_between([], [], color=GREEN, alpha=0.13,
                          label=f"safe with this pad: {masses} {units.unit('mass')}")  # fmt: skip
        figure.legend(loc="outside lower center", ncols=2, frameon=False, fontsize=11)
    return figure


def thickness(found: Design) -> Figure:
    """The least peak of each foam, at its best static stress, over the thickness."""
    units, wish = found.units, found.wish
    foams = [each.foam for each in found.candidates]
    foams += [each for each in found.foams if each not in foams]
    least, most = 0.8 * min(wish.stock), 1.25 * max(wish.stock)
    with mpl.rc_context(STYLE):
        figure = blank(8.0, 6.2)
        axis = figure.subplots()
        across = np.geomspace(least, most, 80)
        top = _TOP * wish.fragility
        curves = {}
        for foam in foams:
            by_formula = (sizing.response(foam, t, wish.drop, wish.drops) for t in across)
            curves[foam.label] = np.array([each.g[each.best] for each in by_formula])
        for colour, group in zip(_COLOURS, _alike(curves), strict=False):
            x = units.of("length", 1.0) * across
            axis.plot(x, curves[group[0]], color=colour, label=_listed(group))
            for pad in (each for each in found.candidates if each.foam.label in group):
                x = units.of("length", pad.thickness)
                axis.plot(x, pad.g, "o", color=colour, markersize=8, markeredgecolor="white")
        _draw_fragility(axis, wish.fragility)
        if wish.max_thickness is not None:
            axis.axvline(units.of("length", wish.max_thickness), color=INK, linestyle="--")
        axis.set_xscale("log")
        axis.set_xlim(*(units.of("length", each) for each in (least, most)))
        plain_log(axis.xaxis)
        axis.set_ylim(0.0, top)
        axis.set_xlabel(f"thickness ({units.unit('length')})")
        axis.set_ylabel("least peak, at the best static stress (g)")
        axis.set_title(f"How thick: fall of {units.text('height', wish.drop)}")
        axis.plot([], [], "o", color=GREY, label="pads of the table")
        figure.legend(loc="outside lower center", ncols=2, frameon=False, fontsize=11)
    return figure


def _draw_fragility(axis: Axes, fragility: float) -> None:
    """A labelled line at the product's fragility [g]."""
    axis.axhline(fragility, color=VERMILION)
    axis.annotate(
        f"fragility {fragility:g} g", (0.01, fragility), xytext=(0, 5),
        xycoords=("axes fraction", "data"), textcoords="offset points",
        color=VERMILION, fontweight="bold", path_effects=HALO,
    )  # fmt: skip


def _draw_runs(axis: Axes, found: Design, pad: Pad) -> None:
    """Median, band and largest peak of the ensembles of a foam."""
    label = f"runs: median, 5-95 % band ({FILTER})"
    for runs in found.tried:
        if runs.pad.foam == pad.foam and all(map(math.isfinite, runs.g)):
            x, band = found.units.of("stress", runs.pad.static_stress), runs.band
            spans: Any = [[band.median - band.low], [band.high - band.median]]
            axis.errorbar(
                x, band.median, yerr=spans, fmt="s", color=INK, markersize=6, capsize=5,
                zorder=6, label=label,
            )  # fmt: skip
            label = None


def _draw_tests(axis: Axes, found: Design, pad: Pad) -> None:
    tests = found.tests
    if tests is None:
        return
    alike, unit = tests.alike(pad.wish.drop, pad.thickness), found.units.si("stress", 1.0)
    if alike.any():
        tests.draw(axis, alike, unit, VERMILION, label=f"{tests.name}: this height and thickness")
    if not alike.all():
        tests.draw(axis, ~alike, unit, VERMILION, fillstyle="none", label=f"{tests.name}: others")


def _neighbours(found: Design, pad: Pad) -> list[float]:
    """The pad's thickness, the next thinner and thicker in stock, and half of it."""
    stock = sorted(found.wish.stock)
    thinner = [each for each in stock if each < pad.thickness][-1:]
    thicker = [each for each in stock if each > pad.thickness][:1]
    return sorted({pad.thickness / 2, *thinner, pad.thickness, *thicker})


def _alike(curves: Mapping[str, Array]) -> list[list[str]]:
    """Names of curves that cannot be told apart, together."""
    groups: list[list[str]] = []
    for name, values in curves.items():
        for group in groups:
            if np.allclose(values, curves[group[0]], rtol=_SAME):
                group.append(name)
                break
        else:
            groups.append([name])
    return groups


def _listed(names: Sequence[str]) -> str:
    """Names for a legend, of many the first ones."""
    more = len(names) - _NAMED
    return ", ".join(names[:_NAMED]) + (f" and {more} more" if more > 0 else "")
