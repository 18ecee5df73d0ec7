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
from matplotlib import ticker
from matplotlib.figure import Figure
from numpy.typing import NDArray

from taichi_foam.analysis.bands import band
from taichi_foam.analysis.quantities import QUANTITIES
from taichi_foam.errors import UserError
from taichi_foam.parts import unit_of
from taichi_foam.picture.labels import beside, spread
from taichi_foam.picture.style import CYCLE, INK, STYLE, blank
from taichi_foam.scene import Scene
from taichi_foam.sweeps import table
from taichi_foam.sweeps.run import Sweep

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Floats = NDArray[np.float64]

# Points that a sample's drops are gathered into, along an axis.
_BINS = 12

_MOST_CURVES = 12
_MOST_TICKS = 9

# A map of so few columns and rows is drawn as a table: cells of one size, with their numbers.
_MOST_COLUMNS, _MOST_ROWS = 12, 20

# What the names of figures and keys of a scene end in, and how people write it.
_UNITS = {
    "per_s": "1/s", "m_s2": "m/s²", "rad_s": "rad/s", "m_s": "m/s", "J_m3": "J/m³",
    "m3": "m³", "Pa": "Pa", "rad": "rad", "kg": "kg", "J": "J", "g": "g", "m": "m", "s": "s",
}  # fmt: skip


@dataclass(frozen=True)
class _Drops:
    """The drops of a sweep that have a row: values on the axes, and of the measure.

    A value of the measure is None for no answer. Of one that is true or false it is 100 or 0, and
    the mean of many is the share of drops [%] that it is true of.
    """

    axes: Mapping[str, list[Any]]
    values: list[float | None]
    shares: bool
    sampled: bool
    ranges: frozenset[str]
    logarithmic: frozenset[str]
    scene: Scene


def shown(
    sweep: Sweep,
    measure: str,
    *,
    x: str | None = None,
    by: str | None = None,
    as_map: bool = False,
) -> Figure:
    """A measure over the axis `x`, a curve for each value of `by`; or over both as a map.

    Medians, and bands from 5 to 95 %, over all drops that share these values. A drop without an
    answer counts as larger than any. Of what is true or false the share of drops that it is true
    of. Drops of a sample are gathered into bins along `x`, and stand as points of their own.

    Args:
        measure: a column of the table that holds numbers, or true and false.
        x, by: keys of axes; None: the first, and the second if there is one.

    Raises:
        UserError: no such measure or axis, nothing computed yet, or too many curves.
    """
    drops = _drops(sweep, measure)
    keys = list(drops.axes)
    x = _axis(x, keys, keys[0] if keys else None, "x")
    rest = [key for key in keys if key != x]
    by = _axis(by, rest, rest[0] if rest else None, "by") if by or rest else None
    if as_map and by is None:
        raise UserError("map: it takes two axes, and the sweep has one")
    with mpl.rc_context(STYLE):
        figure = blank(8.0, 5.4)
        axis = figure.subplots()
        if as_map:
            assert by is not None
            _draw_map(figure, axis, drops, measure, x, by)
        else:
            _draw_curves(axis, drops, x, by)
            axis.set_ylabel(_label_of_measure(measure, drops.shares))
        axis.set_xlabel(_label_of_axis(x, drops.scene))
        axis.set_title(sweep.store.plan.name or "")
    return figure


def _drops(sweep: Sweep, measure: str) -> _Drops:
    store = sweep.store
    shards = store.shards()
    if not shards:
        raise UserError(f"{store.folder}: nothing is complete yet")
    keys = store.design.keys
    found = table.read(shards, [*keys, measure, table.MEMBER])
    if measure not in found.column_names:
        raise UserError(f"{measure}: no column of the table; {_guess(measure, shards, keys)}")
    values = found[measure].to_pylist()
    if all(value is None for value in values):
        raise UserError(f"{measure}: no drop has an answer; docs/results.md says when there is one")
    shares = all(value is None or isinstance(value, bool) for value in values)
    if any(isinstance(value, str) for value in values):
        raise UserError(f"{measure}: holds words, and a figure takes numbers")
    axes = {key: found[key].to_pylist() for key in keys}
    if not axes:  # repeats alone
        axes = {table.MEMBER: found[table.MEMBER].to_pylist()}
    factor = 100.0 if shares else QUANTITIES[measure].factor if measure in QUANTITIES else 1.0
    return _Drops(
        axes,
        [None if value is None else factor * float(value) for value in values],
        shares,
        store.plan.sample is not None,
        frozenset(axis.key for axis in store.plan.axes if axis.is_range),
        frozenset(axis.key for axis in store.plan.axes if axis.spacing == "log"),
        store.plan.base,
    )


def _guess(measure: str, shards: Sequence[table.Shard], keys: Sequence[str]) -> str:
    """What may have been meant by the name of no column: those with its words, or one like it.

    Of the former only such as have answers: a box that rails guide has no peak of its resultant.
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
    return f"did you mean {near[0]}?" if near else f"there are {', '.join(names)}"


def _axis(given: str | None, keys: Sequence[str], usual: str | None, name: str) -> str:
    if given is None:
        assert usual is not None
        return usual
    if given not in keys:
        raise UserError(f"{name} = {given!r}: no axis of the sweep; there are {', '.join(keys)}")
    return given


def _draw_curves(axis: Axes, drops: _Drops, x: str, by: str | None) -> None:
    groups = _groups(drops, by)
    if len(groups) > _MOST_CURVES:
        raise UserError(
            f"{by}: {len(groups)} curves are too many for a figure; take another axis, or a map"
        )
    places = _places(drops.axes[x])
    colours = CYCLE if len(groups) <= len(CYCLE) else _shades(len(groups))
    ends: list[tuple[float, float, str, Any]] = []
    for colour, (name, members) in zip(colours, groups.items(), strict=False):
        at = [places[_hashable(drops.axes[x][k])] for k in members]
        values = [drops.values[k] for k in members]
        if drops.sampled and _is_number(drops.axes[x][0]):
            axis.plot(at, _finite(values), ".", color=colour, alpha=0.35, markersize=5)
            at = _binned(np.array(at))
        centres = sorted(set(at))
        cells = [[v for v, a in zip(values, at, strict=True) if a == c] for c in centres]
        low, median, high = np.array([_summed_up(cell, drops.shares) for cell in cells]).T
        low, median, high = (np.where(np.isfinite(v), v, np.nan) for v in (low, median, high))
        if np.nanmax(high - low, initial=0.0) > 0:
            axis.fill_between(centres, low, high, color=colour, alpha=0.18, linewidth=0)
        axis.plot(centres, median, "o-", color=colour, markersize=5)
        there = np.flatnonzero(np.isfinite(median))
        if name and there.size:
            ends.append((centres[there[-1]], float(median[there[-1]]), name, colour))
    if drops.shares:
        axis.set_ylim(-3.0, 103.0)
    _scale(axis, "x", x, places, drops)
    _name_curves(axis, ends, by, drops.scene)


def _name_curves(
    axis: Axes, ends: Sequence[tuple[float, float, str, Any]], by: str | None, scene: Scene
) -> None:
    """Write each curve's value beside its end, and above them what it is a value of."""
    if not ends or by is None:
        return
    low, high = axis.get_ylim()
    heights = np.array(spread([end[1] for end in ends], 0.055 * (high - low)))
    margin = 0.02 * (high - low)  # as many as there can be have room between the ends of the axis
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
    words = f"by {_label_of_axis(by, scene)}"
    axis.text(1.0, 1.02, words, transform=axis.transAxes, ha="right", color=INK)


def _summed_up(values: Sequence[float | None], shares: bool) -> tuple[float, float, float]:
    """Low end of the band, median, high end; of what is true or false its mean share, thrice.

    Infinite where most drops have no answer; NaN where a share has none at all.
    """
    if not shares:
        return band(values)
    known = [value for value in values if value is not None]
    mean = float(np.mean(known)) if known else math.nan
    return mean, mean, mean


def _draw_map(figure: Figure, axis: Axes, drops: _Drops, measure: str, x: str, by: str) -> None:
    across, up = _places(drops.axes[x]), _places(drops.axes[by])
    look: dict[str, Any] = {"cmap": "cividis"}
    if drops.shares:
        look |= {"vmin": 0.0, "vmax": 100.0}
    is_table = not drops.sampled and len(across) <= _MOST_COLUMNS and len(up) <= _MOST_ROWS
    if is_table:
        across, up = _side_by_side(across), _side_by_side(up)
    at = [across[_hashable(v)] for v in drops.axes[x]]
    high = [up[_hashable(v)] for v in drops.axes[by]]
    if drops.sampled:
        drawn = axis.scatter(at, high, c=_finite(drops.values), s=60, **look)
    else:
        columns, rows = sorted(set(at)), sorted(set(high))
        medians = np.full((len(rows), len(columns)), np.nan)
        cells: dict[tuple[float, float], list[float | None]] = {}
        for u, v, value in zip(at, high, drops.values, strict=True):
            cells.setdefault((u, v), []).append(value)
        for (u, v), values in cells.items():
            _, middle, _ = _summed_up(values, drops.shares)
            medians[rows.index(v), columns.index(u)] = middle if math.isfinite(middle) else np.nan
        drawn = axis.pcolormesh(columns, rows, medians, shading="nearest", **look)
        axis.grid(visible=False)
        if is_table:
            _print_numbers(axis, drawn, columns, rows, medians)
    for which, key, places in (("x", x, across), ("y", by, up)):
        if is_table:
            _name_cells(axis, which, places)
        else:
            _scale(axis, which, key, places, drops)
    axis.set_ylabel(_label_of_axis(by, drops.scene))
    figure.colorbar(drawn, ax=axis, label=_label_of_measure(measure, drops.shares))


def _side_by_side(places: Mapping[Any, float]) -> dict[Any, float]:
    """The same values at equal distances, in the order of their places."""
    return {value: float(k) for k, value in enumerate(sorted(places, key=lambda v: places[v]))}


def _name_cells(axis: Axes, which: str, places: Mapping[Any, float]) -> None:
    """Write the value of each column or row of a table beside it."""
    names = [f"{value:.4g}" if _is_number(value) else str(value) for value in places]
    own = getattr(axis, f"{which}axis")
    own.set_ticks(list(places.values()), names)
    own.set_tick_params(length=0)


def _print_numbers(
    axis: Axes, drawn: Any, columns: Sequence[float], rows: Sequence[float], values: Floats
) -> None:
    """Write its number into each cell of a map, as colours are hard to read off."""
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


def _scale(axis: Axes, which: str, key: str, places: Mapping[Any, float], drops: _Drops) -> None:
    """Give an axis of the figure the scale and the ticks of the sweep's."""
    own = getattr(axis, f"{which}axis")
    is_numeric = _is_number(next(iter(places)))
    if key in drops.logarithmic:
        getattr(axis, f"set_{which}scale")("log")
        own.set_major_locator(ticker.LogLocator(subs=(1.0, 2.0, 5.0)))
        own.set_minor_formatter(ticker.NullFormatter())
        own.set_major_formatter(ticker.StrMethodFormatter("{x:g}"))
    if not is_numeric:
        own.set_ticks(list(places.values()), [str(value) for value in places])
    elif len(places) <= _MOST_TICKS and not (drops.sampled and key in drops.ranges):
        own.set_ticks(list(places.values()), [f"{value:.4g}" for value in places], minor=False)


def _groups(drops: _Drops, by: str | None) -> dict[str, list[int]]:
    """Places of drops by the value of an axis, in rising order; of a sampled range by its bin."""
    if by is None:
        return {"": list(range(len(drops.values)))}
    values = drops.axes[by]
    numbers = all(_is_number(value) for value in values)
    if drops.sampled and numbers and len(set(values)) > _MOST_CURVES:
        edges = np.quantile(values, [0, 1 / 3, 2 / 3, 1])
        bins = np.clip(np.searchsorted(edges, values, side="right") - 1, 0, 2)
        names = [f"{edges[k]:.3g} to {edges[k + 1]:.3g}" for k in range(3)]
        return {names[k]: np.flatnonzero(bins == k).tolist() for k in range(3)}
    found: dict[Any, list[int]] = {}
    for place, value in enumerate(values):
        found.setdefault(_hashable(value), []).append(place)
    order = sorted(found) if numbers else list(found)
    names = {v: f"{v:.4g}" if _is_number(v) else str(v) for v in order}
    if len(set(names.values())) < len(names):  # closer together than four digits tell
        names = {v: str(v) for v in order}
    return {names[v]: found[v] for v in order}


def _places(values: Sequence[Any]) -> dict[Any, float]:
    """Where each value of an axis stands: numbers at themselves, others side by side."""
    different = list(dict.fromkeys(map(_hashable, values)))
    if all(_is_number(value) for value in different):
        return {value: float(value) for value in different}
    return {value: float(place) for place, value in enumerate(different)}


def _binned(at: Floats) -> list[float]:
    """The centre of the bin of each value: bins of equally many."""
    count = max(1, min(_BINS, len(at) // 5))
    order = np.array_split(np.argsort(at, kind="stable"), count)
    centres = np.empty(len(at))
    for places in order:
        centres[places] = at[places].mean()
    return centres.tolist()


def _shades(count: int) -> list[Any]:
    return list(mpl.colormaps["cividis"](np.linspace(0.0, 0.9, count)))


def _finite(values: Sequence[float | None]) -> list[float]:
    return [math.nan if value is None else value for value in values]


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def _hashable(value: Any) -> Any:
    return value if not isinstance(value, (list, dict)) else str(value)


def _label_of_measure(key: str, is_share: bool) -> str:
    """A column in words with its unit."""
    known = QUANTITIES.get(key)
    if known is not None:
        return f"{known.label} ({known.unit})" if known.unit else known.label
    unit = next((unit for unit in _UNITS if key.endswith(f"_{unit}")), None)
    words = key.removesuffix(f"_{unit}").replace("_", " ")
    if is_share:
        return f"{words}: share of drops (%)"
    return f"{words} ({_UNITS[unit]})" if unit else words


def _label_of_axis(key: str, scene: Scene) -> str:
    """A key of the scene in words, with its unit."""
    part, _, name = key.partition(".")
    owner = getattr(scene, part, None)
    field = type(owner).model_fields.get(name) if owner is not None else None
    unit = unit_of(field) if field is not None else ""
    words = key.replace(".", " ").replace("_", " ")
    if not unit:
        return words
    words = words.removesuffix(f" {unit}")  # impactor.rotation_deg
    return f"{words} ({_written(unit)})"


def _written(unit: str) -> str:
    """A unit as people write it: m/s2 is m/s²."""
    return re.sub(r"(?<=[a-zA-Z])[23]", lambda found: "²³"[int(found[0]) - 2], unit)
