"""`sweep show`: a measure over one or two axes, with bands over the repeats."""

from __future__ import annotations

import difflib
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import matplotlib as mpl
import numpy as np
from matplotlib import ticker
from matplotlib.figure import Figure
from numpy.typing import NDArray

from taichi_foam.analysis import quantities
from taichi_foam.analysis.quantities import Quantity
from taichi_foam.errors import UserError
from taichi_foam.parts import unit_of
from taichi_foam.picture.labels import beside, spread
from taichi_foam.picture.style import CYCLE, INK, STYLE, blank
from taichi_foam.scene import Scene
from taichi_foam.shim2000.bands import band
from taichi_foam.sweeps import table
from taichi_foam.sweeps.run import Sweep

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_KNOWN = {each.key: each for each in vars(quantities).values() if isinstance(each, Quantity)}

# Points that a sample's drops are gathered into, along an axis.
_BINS = 12

_MOST_CURVES = 12
_MOST_TICKS = 9


@dataclass(frozen=True)
class _Drops:
    """The drops of a sweep that have a row: values on the axes, and of the measure.

    A value of the measure is None for no answer.
    """

    axes: Mapping[str, list[Any]]
    values: list[float | None]
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
    answer counts as larger than any. Drops of a sample are gathered into bins along `x`, and
    stand as points of their own.

    Args:
        measure: a column of the table that holds numbers.
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
            axis.set_ylabel(_label_of_measure(measure))
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
        names = table.measures(shards, keys)
        near = difflib.get_close_matches(measure, names, n=1, cutoff=0.5)
        guess = f"did you mean {near[0]}?" if near else f"there are {', '.join(names)}"
        raise UserError(f"{measure}: no column of the table; {guess}")
    values = found[measure].to_pylist()
    if any(isinstance(value, str) for value in values):
        raise UserError(f"{measure}: holds words, and a figure takes numbers")
    axes = {key: found[key].to_pylist() for key in keys}
    if not axes:  # repeats alone
        axes = {table.MEMBER: found[table.MEMBER].to_pylist()}
    factor = _KNOWN[measure].factor if measure in _KNOWN else 1.0
    return _Drops(
        axes,
        [None if value is None else factor * float(value) for value in values],
        store.plan.sample is not None,
        frozenset(axis.key for axis in store.plan.axes if axis.is_range),
        frozenset(axis.key for axis in store.plan.axes if axis.spacing == "log"),
        store.plan.base,
    )


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
        bands = [band([v for v, a in zip(values, at, strict=True) if a == c]) for c in centres]
        low, median, high = np.array(bands).T
        low, median, high = (np.where(np.isfinite(v), v, np.nan) for v in (low, median, high))
        if np.nanmax(high - low, initial=0.0) > 0:
            axis.fill_between(centres, low, high, color=colour, alpha=0.18, linewidth=0)
        axis.plot(centres, median, "o-", color=colour, markersize=5)
        there = np.flatnonzero(np.isfinite(median))
        if name and there.size:
            ends.append((centres[there[-1]], float(median[there[-1]]), name, colour))
    _scale(axis, "x", x, places, drops)
    _name_curves(axis, ends, by, drops.scene)


def _name_curves(
    axis: Axes, ends: Sequence[tuple[float, float, str, Any]], by: str | None, scene: Scene
) -> None:
    """Write each curve's value beside its end, and above them what it is a value of."""
    if not ends or by is None:
        return
    low, high = axis.get_ylim()
    heights = spread([end[1] for end in ends], 0.055 * (high - low))
    for height, (x, _, name, colour) in zip(heights, ends, strict=True):
        beside(axis, x, height, name, colour, (9, 0), "center")
    axis.set_ylim(min(low, min(heights)), max(high, max(heights)))
    right = axis.get_xlim()
    if axis.get_xscale() == "log":
        axis.set_xlim(right[0], right[1] * (right[1] / right[0]) ** 0.12)
    else:
        axis.set_xlim(right[0], right[1] + 0.12 * (right[1] - right[0]))
    words = f"by {_label_of_axis(by, scene)}"
    axis.text(1.0, 1.02, words, transform=axis.transAxes, ha="right", color=INK)


def _draw_map(figure: Figure, axis: Axes, drops: _Drops, measure: str, x: str, by: str) -> None:
    across, up = _places(drops.axes[x]), _places(drops.axes[by])
    at = [across[_hashable(v)] for v in drops.axes[x]]
    high = [up[_hashable(v)] for v in drops.axes[by]]
    look: dict[str, Any] = {"cmap": "cividis"}
    if drops.sampled:
        drawn = axis.scatter(at, high, c=_finite(drops.values), s=60, **look)
    else:
        columns, rows = sorted(set(at)), sorted(set(high))
        medians = np.full((len(rows), len(columns)), np.nan)
        cells: dict[tuple[float, float], list[float | None]] = {}
        for u, v, value in zip(at, high, drops.values, strict=True):
            cells.setdefault((u, v), []).append(value)
        for (u, v), values in cells.items():
            middle = band(values).median
            medians[rows.index(v), columns.index(u)] = middle if math.isfinite(middle) else np.nan
        drawn = axis.pcolormesh(columns, rows, medians, shading="nearest", **look)
        axis.grid(visible=False)
    _scale(axis, "x", x, across, drops)
    _scale(axis, "y", by, up, drops)
    axis.set_ylabel(_label_of_axis(by, drops.scene))
    figure.colorbar(drawn, ax=axis, label=_label_of_measure(measure))


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
    return {f"{v:g}" if _is_number(v) else str(v): found[v] for v in order}


def _places(values: Sequence[Any]) -> dict[Any, float]:
    """Where each value of an axis stands: numbers at themselves, others side by side."""
    different = list(dict.fromkeys(map(_hashable, values)))
    if all(_is_number(value) for value in different):
        return {value: float(value) for value in different}
    return {value: float(place) for place, value in enumerate(different)}


def _binned(at: NDArray[np.float64]) -> list[float]:
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


def _label_of_measure(key: str) -> str:
    known = _KNOWN.get(key)
    if known is None:
        return key
    return f"{known.label} ({known.unit})" if known.unit else known.label


def _label_of_axis(key: str, scene: Scene) -> str:
    """A key with its unit."""
    part, _, name = key.partition(".")
    owner = getattr(scene, part, None)
    field = type(owner).model_fields.get(name) if owner is not None else None
    unit = unit_of(field) if field is not None else ""
    return f"{key} ({unit})" if unit else key
