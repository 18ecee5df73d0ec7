"""`sweep show`: a measure over one or two axes, with bands over the repeats."""

from __future__ import annotations

import difflib
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from taichi_foam.analysis.bands import band
from taichi_foam.analysis.measures import MEASURES
from taichi_foam.errors import UserError
from taichi_foam.parts import is_number
from taichi_foam.picture.style import CYCLE, INK, STYLE, beside, blank, plain_log, spread
from taichi_foam.scene import Scene
from taichi_foam.scene.paths import unit_at
from taichi_foam.sweeps import table
from taichi_foam.sweeps.plan import Plan
from taichi_foam.sweeps.store import Sweep

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Floats = NDArray[np.float64]

# Number of bins along an axis for the drops of a sample.
_BINS = 12

_MOST_CURVES = 12
_MOST_TICKS = 9

# A map with at most this many columns and rows is drawn as a table: equal cells with numbers.
_MOST_COLUMNS, _MOST_ROWS = 12, 20

# Unit suffixes in the names of measures and keys, and how they are displayed.
_UNITS = {
    "per_s": "1/s", "m_s2": "m/s²", "rad_s": "rad/s", "m_s": "m/s", "J_m3": "J/m³",
    "m3": "m³", "Pa": "Pa", "rad": "rad", "kg": "kg", "J": "J", "g": "g", "m": "m", "s": "s",
}  # fmt: skip


class _Axis:
    """An axis of a sweep: its value for each drop that has a row.

    names   labels of its distinct values; numbers are in rising order
    places  position of each: numbers at their value, others side by side
    """

    def __init__(self, key: str, values: list[Any], plan: Plan) -> None:
        given = next((axis for axis in plan.axes if axis.key == key), None)
        self.key, self.values = key, values
        self.label = _label_of_axis(key, plan.base)
        self.is_log = given is not None and given.spacing == "log"
        self.is_drawn = given is not None and given.is_range and plan.sample is not None
        different = dict.fromkeys(values)
        self.is_numeric = all(map(is_number, different))
        order = sorted(different) if self.is_numeric else [*different]
        self.names = {v: f"{v:.4g}" if is_number(v) else str(v) for v in order}
        if len(set(self.names.values())) < len(order):  # four digits do not distinguish them
            self.names = {v: str(v) for v in order}
        self.places = {v: float(v if self.is_numeric else k) for k, v in enumerate(order)}


@dataclass(frozen=True)
class _Drops:
    """The drops of a sweep that have a row: values on the axes, by key, and of the measure.

    A value of the measure is None if undefined. A boolean measure has values 100 or 0, so that a
    mean is the percentage of drops for which it is true.
    """

    axes: Mapping[str, _Axis]
    values: list[float | None]
    shares: bool
    sampled: bool


def shown(
    sweep: Sweep,
    measure: str,
    *,
    x: str | None = None,
    by: str | None = None,
    as_map: bool = False,
) -> Figure:
    """A measure over the axis `x`, with a curve for each value of `by`; or over both as a map.

    Shows medians, and bands from 5 to 95 %, over all drops that share these values. An undefined
    value counts as larger than any other. For a boolean measure, shows the share of drops for which
    it is true. Drops of a sample are collected into bins along `x`, and also drawn as points.

    Args:
        measure: a column of the table that holds numbers, or true and false.
        x, by: keys of axes; None: the first, and the second if there is one.

    Raises:
        UserError: no such measure or axis, nothing computed yet, or too many curves.
    """
    drops = _drops(sweep, measure)
    keys = list(drops.axes)
    x = _chosen(x, keys, "x")
    rest = [key for key in keys if key != x]
    across, up = drops.axes[x], drops.axes[_chosen(by, rest, "by")] if by or rest else None
    label = _label_of_measure(measure, drops.shares)
    with mpl.rc_context(STYLE):
        figure = blank(8.0, 5.4)
        axis = figure.subplots()
        if not as_map:
            _draw_curves(axis, drops, across, up)
            axis.set_ylabel(label)
        elif up is not None:
            _draw_map(axis, drops, across, up, label)
        else:
            raise UserError("map: needs two axes, but the sweep has one")
        axis.set_xlabel(across.label)
        axis.set_title(sweep.plan.name or "")
    return figure


def _drops(sweep: Sweep, measure: str) -> _Drops:
    shards = sweep.shards()
    if not shards:
        raise UserError(f"{sweep.folder}: nothing is complete yet")
    keys = sweep.design.keys
    found = table.read(shards, [*keys, measure, table.MEMBER])
    if measure not in found.column_names:
        raise UserError(f"{measure}: is not a column of the table; {_guess(measure, shards, keys)}")
    values = found[measure].to_pylist()
    if all(value is None for value in values):
        raise UserError(
            f"{measure}: has no value in any drop; docs/results.md says when it has one"
        )
    shares = all(value is None or isinstance(value, bool) for value in values)
    if any(isinstance(value, str) for value in values):
        raise UserError(f"{measure}: holds text, but a figure needs numbers")
    factor = 100.0 if shares else MEASURES[measure].factor if measure in MEASURES else 1.0
    plan = sweep.plan
    return _Drops(
        # if there are only repeats, each has its own place
        {key: _Axis(key, found[key].to_pylist(), plan) for key in keys or [table.MEMBER]},
        [None if value is None else factor * float(value) for value in values],
        shares,
        plan.sample is not None,
    )


def _guess(measure: str, shards: Sequence[table.Shard], keys: Sequence[str]) -> str:
    """Suggestions for an unknown column: columns that contain its words, or a similar one.

    The former only if they have values: a box guided on rails has no peak of its resultant.
    """
    names = table.measures(shards, keys)
    words = measure.split("_")
    alike = [name for name in names if all(word in name.split("_") for word in words)]
    answers = table.read(shards, alike) if alike else None
    alike = [name for name in alike if answers and answers[name].null_count < len(answers)]
    if alike:
        alike.sort(key=lambda name: (not name.startswith(words[0]), len(name)))
        return f"did you mean {' or '.join(alike[:3])}?"
    near = difflib.get_close_matches(measure, names, n=1, cutoff=0.5)
    return f"did you mean {near[0]}?" if near else f"its columns are {', '.join(names)}"


def _chosen(given: str | None, keys: Sequence[str], name: str) -> str:
    """The key of an axis; the first if none is given."""
    if given is not None and given not in keys:
        raise UserError(
            f"{name} = {given!r}: is not an axis of the sweep; its axes are {', '.join(keys)}"
        )
    return given or keys[0]


def _draw_curves(axis: Axes, drops: _Drops, x: _Axis, by: _Axis | None) -> None:
    groups = _groups(drops, by)
    if by is not None and len(groups) > _MOST_CURVES:
        raise UserError(
            f"{by.key}: {len(groups)} curves are too many for one figure; choose another axis, or "
            "a map"
        )
    shades = mpl.colormaps["cividis"](np.linspace(0.0, 0.9, len(groups)))
    colours = CYCLE if len(groups) <= len(CYCLE) else list(shades)
    ends: list[tuple[float, float, str, Any]] = []
    for colour, (name, members) in zip(colours, groups.items(), strict=False):
        at = [x.places[x.values[k]] for k in members]
        values = [drops.values[k] for k in members]
        if drops.sampled and x.is_numeric:
            axis.plot(at, np.array(values, float), ".", color=colour, alpha=0.35, markersize=5)
            at = _binned(np.array(at))
        cells = _cells(at, values)
        centres = list(cells)
        low, median, high = np.array([_summed_up(cell, drops.shares) for cell in cells.values()]).T
        if np.nanmax(high - low, initial=0.0) > 0:
            axis.fill_between(centres, low, high, color=colour, alpha=0.18, linewidth=0)
        axis.plot(centres, median, "o-", color=colour, markersize=5)
        there = np.flatnonzero(np.isfinite(median))
        if name and there.size:
            ends.append((centres[there[-1]], float(median[there[-1]]), name, colour))
    if drops.shares:
        axis.set_ylim(-3.0, 103.0)
    _scale(axis, "x", x)
    if by is not None and ends:
        _name_curves(axis, ends, f"by {by.label}")


def _name_curves(axis: Axes, ends: Sequence[tuple[float, float, str, Any]], words: str) -> None:
    """Write each curve's value beside its end, and above these the name of the key."""
    low, high = axis.get_ylim()
    heights = np.array(spread([end[1] for end in ends], 0.055 * (high - low)))
    margin = 0.02 * (high - low)  # the axis has room for the largest number of curves
    heights -= max(0.0, heights.max() + margin - high)
    heights += max(0.0, low + margin - heights.min())
    for height, (x, _, name, colour) in zip(heights, ends, strict=True):
        beside(axis, x, height, name, colour, (9, 0), "center")
    axis.set_ylim(low, high)
    right = axis.get_xlim()
    if axis.get_xscale() == "log":
        axis.set_xlim(right[0], right[1] * (right[1] / right[0]) ** 0.12)
    else:
        axis.set_xlim(right[0], right[1] + 0.12 * (right[1] - right[0]))
    axis.text(1.0, 1.02, words, transform=axis.transAxes, ha="right", color=INK)


def _cells(places: Sequence[Any], values: Sequence[float | None]) -> dict[Any, list[float | None]]:
    """The values at each place, in rising order of places."""
    found: dict[Any, list[float | None]] = {place: [] for place in sorted(set(places))}
    for place, value in zip(places, values, strict=True):
        found[place].append(value)
    return found


def _summed_up(values: Sequence[float | None], shares: bool) -> tuple[float, float, float]:
    """Low end of the band, median, high end; for a boolean measure three times the mean share.

    NaN if the measure is undefined for most drops, or for a share if it is undefined for all.
    """
    if not shares:
        low, median, high = (end if math.isfinite(end) else math.nan for end in band(values))
        return low, median, high
    known = [value for value in values if value is not None]
    mean = float(np.mean(known)) if known else math.nan
    return mean, mean, mean


def _draw_map(axis: Axes, drops: _Drops, x: _Axis, by: _Axis, label: str) -> None:
    look: dict[str, Any] = {"cmap": "cividis"}
    if drops.shares:
        look |= {"vmin": 0.0, "vmax": 100.0}
    is_table = not drops.sampled and len(x.places) <= _MOST_COLUMNS and len(by.places) <= _MOST_ROWS
    across, up = (
        {value: float(k) for k, value in enumerate(each.places)} if is_table else each.places
        for each in (x, by)
    )
    at, high = [across[v] for v in x.values], [up[v] for v in by.values]
    if drops.sampled:
        drawn = axis.scatter(at, high, c=np.array(drops.values, float), s=60, **look)
    else:
        columns, rows = sorted(set(at)), sorted(set(high))
        medians = np.full((len(rows), len(columns)), np.nan)
        for (u, v), values in _cells(list(zip(at, high, strict=True)), drops.values).items():
            medians[rows.index(v), columns.index(u)] = _summed_up(values, drops.shares)[1]
        drawn = axis.pcolormesh(columns, rows, medians, shading="nearest", **look)
        axis.grid(visible=False)
        if is_table:
            _print_numbers(axis, drawn, columns, rows, medians)
    for which, each, places in (("x", x, across), ("y", by, up)):
        if is_table:
            own = getattr(axis, f"{which}axis")
            own.set_ticks(list(places.values()), list(each.names.values()))
            own.set_tick_params(length=0)
        else:
            _scale(axis, which, each)
    axis.set_ylabel(by.label)
    axis.figure.colorbar(drawn, ax=axis, label=label)


def _print_numbers(
    axis: Axes, drawn: Any, columns: Sequence[float], rows: Sequence[float], values: Floats
) -> None:
    """Write its number into each cell of a map, since colours are hard to read."""
    top = float(np.abs(values[np.isfinite(values)]).max(initial=1e-9))
    digits = max(0, 2 - math.floor(math.log10(top)))
    for (j, i), value in np.ndenumerate(values):
        if math.isfinite(value):
            red, green, blue, _ = drawn.cmap(drawn.norm(value))
            is_light = 0.299 * red + 0.587 * green + 0.114 * blue > 0.5
            text = f"{value:.{digits}f}"
        else:
            is_light, text = True, "–"
        axis.text(
            columns[i], rows[j], text, ha="center", va="center", fontsize=11,
            color=INK if is_light else "white",
        )  # fmt: skip


def _scale(axis: Axes, which: str, given: _Axis) -> None:
    """Give an axis of the figure the scale and the ticks of the sweep's axis."""
    own = getattr(axis, f"{which}axis")
    if given.is_log:
        getattr(axis, f"set_{which}scale")("log")
        plain_log(own)
    if not given.is_numeric or (len(given.places) <= _MOST_TICKS and not given.is_drawn):
        own.set_ticks(list(given.places.values()), list(given.names.values()), minor=False)


def _groups(drops: _Drops, by: _Axis | None) -> dict[str, list[int]]:
    """Indices of drops by the value of an axis, in rising order, or by bin for a sampled range."""
    if by is None:
        return {"": list(range(len(drops.values)))}
    if drops.sampled and by.is_numeric and len(by.places) > _MOST_CURVES:
        edges = np.quantile(by.values, [0, 1 / 3, 2 / 3, 1])
        bins = np.clip(np.searchsorted(edges, by.values, side="right") - 1, 0, 2)
        names = [f"{edges[k]:.3g} to {edges[k + 1]:.3g}" for k in range(3)]
        return {names[k]: np.flatnonzero(bins == k).tolist() for k in range(3)}
    found: dict[str, list[int]] = {name: [] for name in by.names.values()}
    for place, value in enumerate(by.values):
        found[by.names[value]].append(place)
    return found


def _binned(at: Floats) -> list[float]:
    """The centre of the bin of each value; bins hold equally many values."""
    count = max(1, min(_BINS, len(at) // 5))
    order = np.array_split(np.argsort(at, kind="stable"), count)
    centres = np.empty(len(at))
    for places in order:
        centres[places] = at[places].mean()
    return centres.tolist()


def _label_of_measure(key: str, is_share: bool) -> str:
    """A column in words with its unit."""
    known = MEASURES.get(key)
    if known and known.label:
        return f"{known.label} ({known.unit})" if known.unit else known.label
    unit = next((unit for unit in _UNITS if key.endswith(f"_{unit}")), None)
    words = key.removesuffix(f"_{unit}").replace("_", " ")
    if is_share:
        return f"{words}: share of drops (%)"
    return f"{words} ({_UNITS[unit]})" if unit else words


def _label_of_axis(key: str, scene: Scene) -> str:
    """A key of the scene in words, with its unit."""
    unit = unit_at(scene, key)
    words = key.replace(".", " ").replace("_", " ")
    if not unit:
        return words
    written = re.sub(r"(?<=[a-zA-Z])[23]", lambda found: "²³"[int(found[0]) - 2], unit)
    return f"{words.removesuffix(f' {unit}')} ({written})"  # impactor.rotation_deg
