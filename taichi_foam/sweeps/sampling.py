"""The drops of a plan by number: the values and the scene of each.

Drops are numbered so that values that need other kernels or another lattice (words, switches, whole
numbers) change slowest, and repeats fastest: a chunk then contains few kinds of lattices.
"""

from __future__ import annotations

import hashlib
import json
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property, lru_cache
from itertools import chain
from typing import Any

import numpy as np
from numpy.typing import NDArray

from taichi_foam.errors import UserError
from taichi_foam.scene import Scene
from taichi_foam.scene.paths import by_key
from taichi_foam.scene.values import changed
from taichi_foam.sweeps.plan import Axis, Method, Plan
from taichi_foam.units import rounded

Floats = NDArray[np.float64]

# Seeds of scattered strengths are 32 bits wide.
_SEEDS = 2**32

# Members of a design that are kept, to be built once.
_KEPT = 1024


@dataclass(frozen=True)
class Member:
    """One drop of a sweep.

    number  its index, from 0
    axes    the value on each axis, by the key of the scene
    repeat  index of the repeat, from 0
    varied  value that differs between repeats: initial velocity [m/s] or seed; None without repeats
    scene   its scene
    """

    number: int
    axes: dict[str, Any]
    repeat: int
    varied: float | int | None
    scene: Scene

    @property
    def hash(self) -> str:
        """Hash of the scene's content except its name; 16 hexadecimal digits."""
        text = self.scene.model_dump_json(exclude={"name", "reference"})
        return hashlib.sha256(text.encode()).hexdigest()[:16]


_latest: Design | None = None


class Design:
    """The members of a resolved plan."""

    def __init__(self, plan: Plan) -> None:
        """Raises UserError: a range of a non-numeric key, or with too few whole numbers."""
        self.plan = plan
        base = plan.base
        self._data = base.given_data()
        known = by_key(base.model_dump())
        ranges = [axis for axis in plan.axes if axis.is_range]
        for axis in ranges:
            _check_range(axis, known.get(axis.key))
        whole = {axis.key for axis in ranges if isinstance(known.get(axis.key), int)}
        # each level is a list of combinations: keys, and tuples of their values
        levels: list[tuple[list[str], Sequence[Sequence[Any]]]] = [
            ([axis.key], _numbers(axis, known.get(axis.key)))
            for axis in plan.axes
            if not axis.is_range
        ]
        if plan.paired:
            rows = zip(*(points for _, points in levels), strict=True)
            levels = [([axis.key for axis in plan.axes], [[*chain(*row)] for row in rows])]
        if plan.sample is None:
            levels += [([a.key], _grid(a, a.key in whole)) for a in ranges]
        else:
            points = _drawn(plan, ranges, whole)
            levels.append(([axis.key for axis in ranges], points))
        self._levels = sorted(levels, key=_changes_smoothly)
        self.keys = [axis.key for axis in plan.axes]
        # drops of a sweep are checked, weighed and then computed: few are built three times
        self._built = lru_cache(maxsize=_KEPT)(self._member)

    @classmethod
    def of(cls, plan: Plan) -> Design:
        """The members of a plan, of which many are built already if it is the latest one."""
        global _latest
        if _latest is None or _latest.plan != plan:
            _latest = cls(plan)
        return _latest

    def __len__(self) -> int:
        return self.plan.count

    @cached_property
    def fingerprint(self) -> str:
        """Hash of all values on the axes: another version of SciPy may draw other points."""
        text = json.dumps([[keys, list(points)] for keys, points in self._levels])
        return hashlib.sha256(text.encode()).hexdigest()[:16]

    def axes(self, number: int) -> tuple[dict[str, Any], int]:
        """The values of a member on the axes, in the plan's order, and the index of its repeat."""
        rest, repeat = divmod(number, self.plan.repeats.count)
        found: dict[str, Any] = {}
        for keys, points in reversed(self._levels):
            rest, place = divmod(rest, len(points))
            found |= zip(keys, points[place], strict=True)
        return {key: found[key] for key in self.keys}, repeat

    def member(self, number: int) -> Member:
        """One drop. Raises UserError: its values make an invalid scene."""
        return self._built(number)

    def _member(self, number: int) -> Member:
        axes, repeat = self.axes(number)
        data = changed(self._data, axes)
        varied = None
        if self.plan.repeats.count > 1:
            key, varied = self._varied(data, repeat)
            data = changed(data, {key: varied})
        where = ", ".join(f"{key} = {value!r}" for key, value in axes.items())
        title = f"member {number} ({where})" if where else f"member {number}"
        scene = Scene.checked(data, title)
        if varied is not None and self.plan.repeats.vary == "velocity" and scene.impactor:
            varied = scene.impactor.velocity
        return Member(number, axes, repeat, varied, scene)

    def check(self, most: int) -> None:
        """Build all scenes, or `most` of them spread evenly. Raises UserError: one is invalid."""
        for number in self.spread(most):
            self.member(number)

    def spread(self, most: int) -> list[int]:
        """All numbers, or `most` of them spread evenly."""
        return np.unique(np.linspace(0, len(self) - 1, min(most, len(self))).astype(int)).tolist()

    def _varied(self, data: dict[str, Any], repeat: int) -> tuple[str, float | int]:
        """The key that repeats vary, and its value in one of them.

        Velocities are spread as in an ensemble of `reproduce` (`factors`, `seed_of`). If a scene
        gives a drop height instead, the height is varied such that the velocity is spread in the
        same way.
        """
        repeats = self.plan.repeats
        if repeats.vary == "seed":
            return "foam.strength_seed", seed_of(data["foam"].get("strength_seed", 0), repeat)
        factor = factors(repeats.count, repeats.within)[repeat]
        impactor = data["impactor"]
        height, gap = impactor.get("drop_height"), impactor.get("gap", 0.0)
        if height is not None:
            return "impactor.drop_height", rounded(gap + factor**2 * (height - gap), 12)
        return "impactor.velocity", rounded(factor * impactor["velocity"], 12)


def factors(count: int, within: float) -> list[float]:
    """Velocities of repeats relative to the scene's own, evenly spread within +-`within`.

    A single repeat has the scene's own velocity.
    """
    spread = np.linspace(-1.0, 1.0, count) if count > 1 else np.zeros(1)
    return (1.0 + within * spread).tolist()


def seed_of(first: int, repeat: int) -> int:
    """The seed of a repeat: the scene's seed `first`, then the following numbers."""
    return (first + repeat) % _SEEDS


def unit_points(method: Method, dimension: int, count: int, seed: int) -> Floats:
    """Points (count, dimension) of a scrambled sample, with coordinates from 0 to 1."""
    from scipy.stats import qmc

    kind = qmc.Sobol if method == "sobol" else qmc.LatinHypercube
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # Sobol: counts that are not powers of two
        # SciPy calls it rng since 1.15, and still accepts the older name
        more: Any = {"seed": np.random.default_rng(seed)}
        return kind(dimension, **more).random(count)


def between(low: float, high: float, is_log: bool, unit: Floats) -> Floats:
    """Values at coordinates from 0 to 1 of a range, even in the value or in its logarithm."""
    return low * (high / low) ** unit if is_log else low + unit * (high - low)


def _numbers(axis: Axis, usual: Any) -> list[list[Any]]:
    """The listed values of an axis; integers become floats if the scene's own value is a float.

    Values computed by a script are rounded to 15 digits.
    """
    values = [rounded(v, 15) if type(v) is float else v for v in axis.values or ()]
    if isinstance(usual, float):
        values = [float(v) if type(v) is int else v for v in values]
    return [[value] for value in values]


def _check_range(axis: Axis, usual: Any) -> None:
    """Raise UserError for a range of a non-number; members check whether the key exists."""
    if isinstance(usual, bool) or not isinstance(usual, (int, float, type(None))):
        raise UserError(
            f"axis {axis.key}: a range needs numbers, but the value in the scene is {usual!r}; "
            "give values = [...]"
        )


def _grid(axis: Axis, is_whole: bool) -> list[list[Any]]:
    low, high = _ends(axis)
    assert axis.count is not None  # the plan has checked this
    if axis.spacing == "log":
        inner = np.geomspace(low, high, axis.count)[1:-1]
        values = [low, *(rounded(float(value), 12) for value in inner), high]
    else:
        values = _evenly(low, high, axis.count)
    if is_whole:
        values = [round(value) for value in values]
        if len(set(values)) < len(values):
            raise UserError(
                f"axis {axis.key}: takes whole numbers, but there are fewer than {axis.count} of "
                f"them from {low:g} to {high:g}; use a smaller count"
            )
    return [[value] for value in values]


def _evenly(low: float, high: float, count: int) -> list[float]:
    """Evenly spaced values, computed exactly from the ends' decimals, then rounded to doubles.

    The third of five values from 0.02 to 0.1 is then 0.06, not 0.060000000000000005.
    """
    first = Fraction(repr(low))
    step = (Fraction(repr(high)) - first) / (count - 1)
    whole = first.denominator * step.denominator
    begin, more = int(first * whole), int(step * whole)
    return [(begin + more * place) / whole for place in range(count)]


def _ends(axis: Axis) -> tuple[float, float]:
    assert axis.low is not None  # the plan has checked this
    assert axis.high is not None
    return axis.low, axis.high


def _drawn(plan: Plan, ranges: Sequence[Axis], whole: set[str]) -> list[list[Any]]:
    """The points of a sample, one list of values for each."""
    sample = plan.sample
    assert sample is not None
    unit = unit_points(sample.method, len(ranges), sample.count, sample.seed)
    columns = []
    for axis, u in zip(ranges, unit.T, strict=True):
        low, high = _ends(axis)
        values = between(low, high, axis.spacing == "log", u)
        if axis.key in whole:
            values = np.floor(low + u * (high - low + 1)).clip(low, high).astype(int)
        columns.append(values.tolist())
    return [list(point) for point in zip(*columns, strict=True)]


def _changes_smoothly(level: tuple[list[str], Sequence[Sequence[Any]]]) -> bool:
    """Whether a level changes only floats, which need neither other kernels nor another lattice."""
    _, points = level
    return all(isinstance(value, float) for value in points[0])
