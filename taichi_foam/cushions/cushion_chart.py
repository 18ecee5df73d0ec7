"""The figure and the report of cushion curves."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import matplotlib as mpl
import numpy as np
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from taichi_foam.analysis.measures import assumed_of
from taichi_foam.cushions.cushion import WITHIN, Curve, CushionCurve
from taichi_foam.cushions.shown import Units
from taichi_foam.formulas.energy import USUAL_PEAK
from taichi_foam.picture.document import Section, Table, write
from taichi_foam.picture.style import CYCLE, GREY, HALO, INK, STYLE, blank, plain_log
from taichi_foam.units import rounded

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_WIDE, _HIGH = 6.2, 4.6
"""Size of a panel [inches]."""

_MOST_COLOURS = len(CYCLE)

_WAYS = {
    "thickness": "thickness", "drop_height": "drop height", "number": "drop", "shape": "shape",
}  # fmt: skip
"""In what curves may differ; the first that has several values, and no more than there are
colours, is told by colour, the others by panels."""


def chart(found: CushionCurve, system: Units) -> Figure:
    """Peaks over static stress: a panel for each family of curves."""
    by, families = _families(found.curves)
    telling = [way for way in _differences([family[0] for family in families]) if way != by]
    across = min(2, len(families))
    down = math.ceil(len(families) / across)
    with mpl.rc_context(STYLE):
        figure = blank(_WIDE * across + (1.4 if across == 1 else 0.0), _HIGH * down + 0.9)
        panels = figure.subplots(down, across, squeeze=False).ravel()
        for axis, family in zip(panels, families, strict=False):
            _draw(axis, found, family, by, system)
            if len(families) > 1:
                axis.set_title(", ".join(_one(family[0], way, system) for way in telling))
        for axis in panels[len(families) :]:
            axis.set_visible(False)
        figure.suptitle(_title(found, system), fontsize=15, fontweight="bold")
        figure.legend(
            handles=_key(found), loc="outside lower center", ncols=3, frameon=False, fontsize=10.5
        )
    return figure


def report(
    found: CushionCurve, path: str | Path, system: Units, drawn: Figure | None = None
) -> Path:
    """Write the report, and return its path; `drawn` is its chart if there is one already.

    Raises UserError.
    """
    sections = [
        Section(
            "Peak deceleration over static stress",
            figure=drawn or chart(found, system),
            alt=f"Cushion curves of {found.foam}: peak deceleration in g over static stress in "
            f"{system.unit('stress')}; the minima are in the table below.",
            caption=" ".join(found.conditions),
        ),
        Section(
            "The best static stress",
            words=[
                "Where each curve is lowest, and the range around it in which the peak is larger "
                f"by {100 * WITHIN:.0f} % at most. Divide the product's weight by a static stress "
                "to get the area of the pad.",
            ],
            table=minima(found, system),
        ),
        Section("All points", table=_points(found, system)),
    ]
    measured = _measured(found, system)
    if measured.rows:
        sections.insert(1, Section("Own tests", table=measured))
    assumed = assumed_of(found.scene)
    if assumed:
        sections.append(
            Section(
                "What is assumed of the foam",
                words=["Not given with the foam, and taken as follows:", *assumed],
            )
        )
    title = f"Cushion curves of {found.foam}"
    return write(path, title, _lead(found, system), sections)


def _lead(found: CushionCurve, system: Units) -> list[str]:
    best = min(found.curves, key=lambda curve: curve.median[curve.least])
    g = best.median[best.least]
    if not math.isfinite(g):
        return ["No drop has an answer; the table of points says why."]
    low, high = (system.number("stress", each) for each in best.good_range)
    return [
        f"The lowest peak of all curves is {g:.3g} g ({found.filter}), at a static stress of "
        f"{system.text('stress', best.static_stress[best.least])}: {_words(best, system)}. From "
        f"{low} to {high} {system.unit('stress')} it is larger by {100 * WITHIN:.0f} % at most.",
    ]


def _families(curves: Sequence[Curve]) -> tuple[str, list[list[Curve]]]:
    """What colours tell, and the curves of each panel."""
    values = {way: list(dict.fromkeys(_value(curve, way) for curve in curves)) for way in _WAYS}
    several = [way for way, found in values.items() if 1 < len(found) <= _MOST_COLOURS]
    by = several[0] if several else "thickness"
    families: dict[tuple[Any, ...], list[Curve]] = {}
    for curve in curves:
        rest = tuple(_value(curve, way) for way in _WAYS if way != by)
        families.setdefault(rest, []).append(curve)
    if not several:
        families = {(n,): [curve] for n, curve in enumerate(curves)}
    return by, list(families.values())


def _value(curve: Curve, way: str) -> Any:
    return curve.number if way == "number" else getattr(curve.pad, way)


def _draw(
    axis: Axes,
    found: CushionCurve,
    family: Sequence[Curve],
    by: str,
    system: Units,
) -> None:
    """One panel."""
    lowest = [curve.median[curve.least] for curve in family if math.isfinite(min(curve.median))]
    top = USUAL_PEAK * max(lowest, default=1.0) * 1.1
    ends = [end for curve in family for end in curve.static_stress[[0, -1]]]
    left, right = system.of("stress", min(ends)), system.of("stress", max(ends))
    margin = (right / left) ** 0.03 if right > left else 1.1
    axis.set(xscale="log", xlim=(left / margin, right * margin), ylim=(0.0, top))
    for curve, colour in zip(family, CYCLE, strict=False):
        _draw_curve(axis, found, curve, colour, system, top)
        if curve.bottoms_from is not None:
            start = system.of("stress", curve.bottoms_from)
            axis.axvspan(start, right * margin, color=colour, alpha=0.09, lw=0, zorder=0)
    _label(axis, family, by, system)
    axis.set_xlabel(f"static stress ({system.unit('stress')})")
    axis.set_ylabel(f"peak deceleration G (g, {found.filter})")
    plain_log(axis.xaxis, _subs(right / left))


def _draw_curve(
    axis: Axes, found: CushionCurve, curve: Curve, colour: str, system: Units, top: float
) -> None:
    x = np.array([system.of("stress", each) for each in curve.static_stress])
    finite = 3.0 * top  # an endless peak is drawn beyond the panel
    ys = [np.minimum(y, finite) for y in (curve.low, curve.median, curve.high)]
    median = ys[1]
    # lines between points are straight in the logarithms, as the curve was refined
    between = np.unique(np.append(x, np.geomspace(x[0], x[-1], 400)))
    low, middle, high = (np.exp(np.interp(np.log(between), np.log(x), np.log(y))) for y in ys)
    if found.runs > 1:
        axis.fill_between(between, low, high, color=colour, alpha=0.25, lw=0)
    axis.plot(between, middle, color=colour)
    axis.plot(x, median, "o", color=colour, ms=4)
    if curve.balance is not None:
        fine = curve.balance.fine
        g, across = curve.balance.g(fine), [system.of("stress", each) for each in fine]
        axis.plot(across, g, color=INK, ls=(0, (4, 2)), lw=1.2, zorder=3)
    alike = found.tests_of(curve)
    if found.tests is not None and alike is not None:
        found.tests.draw(axis, alike, system.si("stress", 1.0), colour, markeredgecolor=INK)
    if not math.isfinite(curve.median[curve.least]):
        return
    start, stop = (system.of("stress", each) for each in curve.good_range)
    inside = np.exp(np.linspace(math.log(start), math.log(stop), 60))
    along = np.exp(np.interp(np.log(inside), np.log(x), np.log(median)))
    axis.plot(inside, along, color=colour, lw=8, alpha=0.3, solid_capstyle="butt", zorder=1)
    if curve.is_bracketed:
        least = curve.least
        axis.plot(x[least], median[least], "o", ms=9, mfc="white", mec=colour, mew=2, zorder=4)


def _label(axis: Axes, family: Sequence[Curve], by: str, system: Units) -> None:
    """Name the curves of a panel where they begin, and say their minima."""
    lines = []
    for curve, colour in zip(family, CYCLE, strict=False):
        least = curve.median[curve.least]
        text = _one(curve, by, system).removesuffix(" thick")
        if math.isfinite(least):
            at = system.text("stress", curve.static_stress[curve.least])
            text += f": {least:.3g} g at {at}" if curve.is_bracketed else f": from {least:.3g} g"
        lines.append(Line2D([], [], color=colour, marker="o", ms=4, label=text))
    shown = axis.legend(
        handles=lines, loc="upper center", bbox_to_anchor=(0.45, 1.0),  # between falls and rises
        fontsize=10, labelcolor="linecolor", framealpha=0.7, edgecolor="none",
        title=f"{_WAYS[by]}: least peak", title_fontsize=10, alignment="left",
    )  # fmt: skip
    for text in shown.get_texts():
        text.set_path_effects([*HALO])


def _differences(curves: Sequence[Curve]) -> list[str]:
    """The ways in which curves differ."""
    return [way for way in _WAYS if len({_value(curve, way) for curve in curves}) > 1]


def _title(found: CushionCurve, system: Units) -> str:
    """The foam, and what all curves have in common."""
    first, differ = found.curves[0], _differences(found.curves)
    shared = [
        _one(first, way, system)
        for way in _WAYS
        if way not in differ and not (way == "number" and first.number == 1)
    ]
    return f"{found.foam}: {', '.join(shared)}" if shared else found.foam


def _one(curve: Curve, way: str, system: Units) -> str:
    """One of the ways in which curves differ, in words."""
    value = _value(curve, way)
    if way == "number":
        return f"drop {value}"
    if way == "shape":
        return f"{Path(str(value)).stem} pad"
    if way == "thickness":
        return f"{system.text('length', value)} thick"
    return f"from {system.text('height', value)}"


def _words(curve: Curve, system: Units, among: Sequence[Curve] = ()) -> str:
    """A curve in words; `among` others, how it differs from them."""
    ways = _differences(among)
    if not ways:
        ways = ["shape", "thickness", "drop_height", *(["number"] if curve.number > 1 else [])]
    return ", ".join(_one(curve, way, system) for way in ways)


def _subs(ratio: float) -> list[float]:
    """Multiples of powers of ten that get a tick on a range of a ratio."""
    if ratio > 60.0:
        return [1.0, 3.0]
    return [1.0, 2.0, 5.0] if ratio > 6.0 else [1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 7.0]


def _key(found: CushionCurve) -> list[Any]:
    """What lines and tones mean."""
    key: list[Any] = [Line2D([], [], color=GREY, marker="o", ms=4, label="computed")]
    if found.runs > 1:
        key[0].set_label("computed, median")
        key.append(Patch(color=GREY, alpha=0.25, lw=0, label=f"5 to 95 % of {found.runs} runs"))
    if any(curve.balance is not None for curve in found.curves):
        key.append(Line2D([], [], color=INK, ls=(0, (4, 2)), lw=1.2, label="energy balance"))
    if found.tests is not None:
        key.append(
            Line2D(
                [], [], color=GREY, marker="D", ls="none", markeredgecolor=INK,
                label=f"tests in {found.tests.name}",
            )
        )  # fmt: skip
    key += [
        Line2D(
            [], [], color=GREY, marker="o", ms=8, mfc="white", mew=2, ls="none",
            label="least peak",
        ),
        Line2D([], [], color=GREY, lw=8, alpha=0.4, label="within 10 % of it"),
    ]  # fmt: skip
    if any(curve.bottoms_from is not None for curve in found.curves):
        key.append(Patch(color=GREY, alpha=0.2, lw=0, label="bottoms out"))
    return key


def minima(found: CushionCurve, system: Units) -> Table:
    """The minima, as a table."""
    stress = system.unit("stress")
    head = [
        "curve", "least peak (g)", f"at ({stress})", f"within 10 % ({stress})",
        f"bottoms from ({stress})", "balance: least peak (g)", f"at ({stress})",
    ]  # fmt: skip
    rows = []
    for curve, row in zip(found.curves, found.minima, strict=True):
        static = {
            key: _number(None if row[key] is None else system.of("stress", row[key]))
            for key in row
            if key.endswith("_Pa")
        }
        ends = [static[f"within_10_percent_{end}_Pa"] for end in ("from", "to")]
        rows.append(
            [
                _words(curve, system, found.curves),
                _number(row["least_peak_g"]) + ("" if row["is_bracketed"] else " *"),
                static["at_static_stress_Pa"],
                " to ".join(ends),
                static["bottoms_from_Pa"],
                _number(row["balance_least_peak_g"]),
                static["balance_at_static_stress_Pa"],
            ]
        )
    note = f"Peaks are {found.filter}."
    if not all(row["is_bracketed"] for row in found.minima):
        note += " * The lowest point is at an end of the range: the minimum may lie beyond."
    return Table(head, rows, note)


def _points(found: CushionCurve, system: Units) -> Table:
    head = [
        "curve", f"static stress ({system.unit('stress')})", "peak (g)", "5 to 95 % (g)",
        "energy balance (g)", "largest strain (%)", "runs that bottom (%)",
    ]  # fmt: skip
    rows = []
    for curve in found.curves:
        by_hand = curve.balance and curve.balance.g(curve.static_stress)
        for k, static in enumerate(curve.static_stress):
            rows.append(
                [
                    _words(curve, system, found.curves),
                    system.number("stress", float(static)),
                    _number(curve.median[k]),
                    f"{_number(curve.low[k])} to {_number(curve.high[k])}",
                    _number(None if by_hand is None else by_hand[k]),
                    _number(100.0 * curve.strain[k]),
                    f"{100.0 * curve.bottomed[k]:.0f}",
                ]
            )
    if found.runs == 1:
        head.pop(3)
        for row in rows:
            row.pop(3)
    return Table(head, rows, f"Peaks are {found.filter}.")


def _measured(found: CushionCurve, system: Units) -> Table:
    """Own tests beside the curve that they are of."""
    head = [
        "curve", f"static stress ({system.unit('stress')})", "measured (g)", "computed (g)",
        "measured over computed",
    ]  # fmt: skip
    rows = []
    for curve in found.curves:
        alike = found.tests_of(curve)
        if found.tests is None or alike is None:
            continue
        x, y = np.log(curve.static_stress), np.log(curve.median)
        for static, g in zip(found.tests.static[alike], found.tests.g[alike], strict=True):
            at = float(np.exp(np.interp(np.log(static), x, y, left=np.nan, right=np.nan)))
            rows.append(
                [
                    _words(curve, system, found.curves),
                    system.number("stress", float(static)),
                    _number(float(g)),
                    _number(at),
                    _number(float(g) / at),
                ]
            )
    note = f"Computed peaks are {found.filter}, between the points of the curve."
    return Table(head, rows, note)


def _number(value: float | None) -> str:
    """A number with three digits; a dash: no answer."""
    if value is None or not math.isfinite(value):
        return "–"
    found = rounded(value, 3)
    return f"{found:,.0f}" if abs(found) >= 100 else f"{found:#.3g}"
