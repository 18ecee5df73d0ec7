"""The plan of a sweep: a base scene, the axes along which it varies, repeats, and what to keep.

A plan is a TOML file, or the same as a mapping:

    scene = "paper/wedge-2.86"    # built-in name, a file, or the scene itself as a table

    [[axes]]
    key = "impactor.velocity"
    from = 2.0
    to = 4.0
    count = 9

    [[axes]]
    key = "impactor.mass"
    values = [3.0, 6.0]

    [repeats]
    count = 8
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, ValidationError, model_validator

from taichi_foam.analysis.measures import IN_WORDS, MEASURES
from taichi_foam.catalogue import load_scene
from taichi_foam.errors import UserError
from taichi_foam.parts import Part
from taichi_foam.scene import Scene
from taichi_foam.scene.files import completed_scene
from taichi_foam.scene.messages import explain, shown, titled
from taichi_foam.scene.paths import by_key
from taichi_foam.scene.toml import read_toml
from taichi_foam.scene.values import settings

MOST = 10_000_000
"""Largest number of drops in a sweep."""

# Typical end of an impact that ends by itself [s].
_USUAL_END = 0.06

_Count = Annotated[int, Field(ge=1, le=MOST)]
# Lists are accepted as tuples here, since TOML has only lists.
_Values = Annotated[tuple[Any, ...], Field(strict=False, min_length=1, max_length=MOST)]
_Numbers = Annotated[tuple[int, ...], Field(strict=False)]
_Names = Annotated[tuple[str, ...], Field(strict=False)]
Spacing = Literal["linear", "log"]
Method = Literal["latin-hypercube", "sobol"]


class Axis(Part):
    """One key of the scene and the values that it takes: listed, or a range.

    A range has `count` values, including both ends. If the plan has a `sample`, the sample draws
    the values instead.
    """

    key: str = Field(description="dotted key of the scene")
    values: _Values | None = None
    low: float | None = Field(None, alias="from")
    high: float | None = Field(None, alias="to")
    count: _Count | None = None
    spacing: Spacing = "linear"

    @property
    def is_range(self) -> bool:
        return self.values is None

    @model_validator(mode="after")
    def _check_range(self) -> Axis:
        if self.values is not None:
            if self.low is not None or self.high is not None or self.count is not None:
                raise ValueError(f"{self.key}: has both values and a range; give one or the other")
            return self
        if self.low is None or self.high is None:
            raise ValueError(
                f"{self.key}: has no values; give values = [...], or from, to and count"
            )
        if self.low >= self.high:
            raise ValueError(
                f"{self.key}: from = {self.low:g} is not below to = {self.high:g}; swap them, or "
                "give one value as values = [...]"
            )
        if self.spacing == "log" and self.low <= 0:
            raise ValueError(
                f"{self.key}: from = {self.low:g}: a logarithmic range must start above 0; use "
                'spacing = "linear", or a larger from'
            )
        if self.count == 1:
            raise ValueError(
                f"{self.key}: count = 1: must be at least 2, the ends of the range; for one value, "
                "give values = [...]"
            )
        return self


class Sample(Part):
    """A space-filling sample over all ranges of the plan at once, instead of a grid."""

    method: Method
    count: _Count
    seed: int = Field(0, ge=0, lt=2**32, description="seed of the scrambling")


class Repeats(Part):
    """Repeats of each combination, with differences too small to be measured."""

    count: int = Field(default=1, ge=1, le=100_000)
    vary: Literal["velocity", "seed"] = "velocity"
    within: float = Field(
        default=0.005,
        gt=0,
        lt=1,
        description="largest relative difference of a velocity from its given value",
    )


class Keep(Part):
    """Data of a drop that is kept: the measures in its row of the table, and what is beside it."""

    # None, not all of them: the hash of a plan without it stays
    measures: _Names | None = Field(
        default=None, description="measures that the table has, as in summary.json; none: all"
    )
    histories: Literal["none", "float32", "float64"] = "none"
    full: _Numbers | Literal["all"] = Field(
        default=(), description="numbers of the members whose complete results are kept"
    )

    @property
    def has_histories(self) -> bool:
        """Whether histories are kept."""
        return self.histories != "none"

    @model_validator(mode="after")
    def _check_measures(self) -> Keep:
        for key in self.measures or ():
            if key not in MEASURES and key not in IN_WORDS:
                raise ValueError(
                    f"measures: {key!r} is none; take keys of summary.json, such as max_strain"
                )
        return self


class Plan(Part):
    """A whole sweep, checked as far as possible without its scene."""

    name: str | None = Field(None, min_length=1, max_length=100)
    scene: str | dict[str, Any] = Field(
        json_schema_extra={"allowed": "the name of a scene, the name of its file, or a table"}
    )
    choices: str | None = None
    set: dict[str, Any] = Field(
        {}, json_schema_extra={"allowed": "a table of scene values by dotted key"}
    )
    axes: tuple[Axis, ...] = Field((), strict=False, max_length=20)
    sample: Sample | None = None
    # None, not false: the hash of a plan without it stays
    paired: Literal[True] | None = Field(
        None,
        description="listed values go together, the first of each axis, the second of each, ..., "
        "instead of in every combination",
    )
    repeats: Repeats = Repeats()
    drops: int | None = Field(
        None, ge=1, le=100, description="impacts in a row on each block; none: one"
    )
    keep: Keep = Keep()
    chunk: int | None = Field(
        None, ge=1, le=10_000, description="largest number of drops in one task"
    )

    @model_validator(mode="after")
    def _check_axes(self) -> Plan:
        if not self.axes and self.repeats.count == 1:
            raise ValueError("axes: none given; give at least one axis, or repeats")
        keys = [axis.key for axis in self.axes]
        if (twice := _twice(keys)) is not None:
            raise ValueError(f"axes: {twice} has two axes; give each key only one")
        if not self.paired:
            for axis in self.axes:
                few = [repr(value) for value in (axis.values or ())[:1001]]
                if len(few) <= 1000 and (twice := _twice(few)) is not None:
                    raise ValueError(f"{axis.key}: values contains {twice} twice; leave one out")
        ranges = [axis for axis in self.axes if axis.is_range]
        if self.sample is not None and not ranges:
            raise ValueError(
                "sample: no axis has a range to draw from; give one of them from and to"
            )
        if self.paired and (ranges or len({len(axis.values or ()) for axis in self.axes}) > 1):
            raise ValueError("paired: needs axes that all list equally many values")
        for axis in ranges:
            if self.sample is None and axis.count is None:
                raise ValueError(
                    f"{axis.key}: has no count; give the number of values in the range"
                )
            if self.sample is not None and axis.count is not None:
                raise ValueError(
                    f"{axis.key}: has a count, but sample.count sets the number of points; leave "
                    "one out"
                )
        if self.count > MOST:
            raise ValueError(
                f"{self.count:,} drops: a sweep has at most {MOST:,}; reduce the counts"
            )
        numbers = self.keep.full
        beyond = [n for n in numbers if isinstance(n, int) and not 0 <= n < self.count]
        if beyond:
            raise ValueError(
                f"keep.full: there is no member {beyond[0]}; members are numbered 0 to "
                f"{self.count - 1}"
            )
        return self

    @property
    def count(self) -> int:
        """Number of drops."""
        sizes = [
            len(axis.values) if axis.values is not None else axis.count or 1 for axis in self.axes
        ]
        sizes = sizes[:1] if self.paired else sizes
        return math.prod(sizes) * (self.sample.count if self.sample else 1) * self.repeats.count

    @property
    def impacts(self) -> int:
        """Number of impacts on each block."""
        return self.drops or 1

    @property
    def notes(self) -> list[str]:
        """Remarks, made before anything is computed, on what may not be intended."""
        scatter = next((axis for axis in self.axes if axis.key == "foam.strength_scatter"), None)
        if scatter is None or self.repeats.count == 1 or self.repeats.vary != "seed":
            return []
        if scatter.low == 0 or 0 in (scatter.values or ()):
            return [
                "repeats.vary = 'seed': where foam.strength_scatter = 0, all repeats are the same"
            ]
        return []

    @property
    def hash(self) -> str:
        """Hash of everything in the plan that rows depend on; 16 hexadecimal digits."""
        text = json.dumps(_without_chunk(self.data()), sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()[:16]

    def data(self) -> dict[str, Any]:
        """The plan as plain data that `Plan.checked` accepts."""
        return self.model_dump(mode="json", by_alias=True, exclude_none=True)

    @classmethod
    def checked(cls, data: Mapping[str, Any], source: str) -> Plan:
        """The plan of raw data. Raises UserError that lists every problem, titled with `source`."""
        try:
            return cls.model_validate(data)
        except ValidationError as error:
            raise UserError(titled(source, explain(error, cls), "plan")) from None

    @classmethod
    def load(cls, source: str | Path | Mapping[str, Any] | Plan) -> Plan:
        """The plan of a TOML file or of a mapping, its scene resolved (`resolved`)."""
        if isinstance(source, Plan):
            return source.resolved()
        if isinstance(source, Mapping):
            data = dict(source)
            if isinstance(data.get("scene"), Scene):
                data["scene"] = data["scene"].model_dump(exclude_none=True)
            return cls.checked(data, "plan").resolved()
        path = Path(source)
        if not path.is_file():
            raise UserError(
                f"{path}: no such file. Fix: give a plan, or a scene and what should vary, e.g. "
                "--vary impactor.velocity=2:4:9"
            )
        data = read_toml(path)
        if "scene" not in data and "axes" not in data:
            raise UserError(
                f"{path}: is not a plan, as it has no axes. Fix: say what should vary, e.g. --vary "
                "impactor.velocity=2:4:9"
            )
        return cls.checked(data, str(path)).resolved(path.parent)

    @classmethod
    def of_scene(
        cls, data: Mapping[str, Any], choices: str | None, given: Sequence[str], histories: bool
    ) -> Plan:
        """The plan of a scene and axes given on the command line, with their options applied."""
        path = Path(str(data["scene"]))
        if path.suffix == ".toml" and path.is_file() and "axes" in read_toml(path):
            raise UserError(f"{path}: is a plan, which has axes of its own; leave --vary out")
        keep = {"histories": "float32" if histories else "none"}
        whole = {**data, "choices": choices, "set": settings(given), "keep": keep}
        return cls.checked(whole, str(data["scene"])).resolved()

    def resolved(self, folder: Path | None = None) -> Plan:
        """The same sweep, self-contained: its scene is a table with every value.

        A scene file is looked for first in `folder`; file names in a scene table are relative to
        it. Raises UserError: the scene is invalid.
        """
        if isinstance(self.scene, str):
            near = (folder or Path()) / self.scene
            base = load_scene(near if near.is_file() else self.scene, self.choices, self.set)
        else:
            data = completed_scene(self.scene, folder or Path(), "scene")
            base = load_scene(Scene.checked(data, "scene"), self.choices, self.set)
        _check_repeats(self, base)
        return self.model_copy(
            update={
                "name": self.name or base.name,
                "scene": base.model_dump(mode="json", exclude_none=True),
                "choices": None,
                "set": {},
            }
        )

    @property
    def base(self) -> Scene:
        """The scene that the axes vary; the plan must be resolved."""
        assert isinstance(self.scene, dict)
        return Scene.checked(self.scene, self.name or "scene")

    def differences(self, other: Mapping[str, Any]) -> list[str]:
        """Differences from another plan's data that rows depend on, one line per key."""
        old, new = (by_key(_by_axis(_without_chunk(data))) for data in (other, self.data()))
        return [
            f"{key}: was {shown(old.get(key))}, is {shown(new.get(key))}"
            for key in dict.fromkeys([*old, *new])
            if old.get(key) != new.get(key)
        ]


def _twice(values: Sequence[str]) -> str | None:
    """The first duplicate value, or None."""
    return next((value for value in values if values.count(value) > 1), None)


def axis_of(text: str) -> dict[str, Any]:
    """The axis that "KEY=A:B:N", "KEY=A:B:N:log" or "KEY=a,b,c" describes, as raw data.

    Raises UserError for any other text.
    """
    key, equals, words = (part.strip() for part in text.partition("="))
    if not equals or not key or not words:
        raise UserError(f"{text!r}: must read KEY=A:B:N or KEY=a,b,c, e.g. impactor.velocity=2:4:9")
    parts = words.split(":")
    if len(parts) == 1:
        values = [settings([f"{key}={word}"])[key] for word in words.split(",")]
        return {"key": key, "values": values}
    try:
        low, high, count, *more = parts
        found = {"key": key, "from": float(low), "to": float(high), "count": int(count)}
        if more:
            (found["spacing"],) = more
    except ValueError:
        raise UserError(
            f"{text!r}: a range reads KEY=FROM:TO:COUNT, or KEY=FROM:TO:COUNT:log"
        ) from None
    return found


def work(scene: Scene) -> float:
    """Approximate work of a drop [node steps], estimated from its scene alone."""
    block, foam, numerics = scene.block, scene.foam, scene.numerics
    speed = math.sqrt(foam.youngs_modulus / block.density)
    dt = numerics.dt if isinstance(numerics.dt, float) else 0.25 * min(block.dx, block.dy) / speed
    until = numerics.latest_end
    if numerics.end == "rebound":
        until = min(until, _USUAL_END)
    return block.columns * block.rows * until / dt


def _check_repeats(plan: Plan, base: Scene) -> None:
    """Raise UserError if all repeats would be the same."""
    if plan.repeats.count == 1:
        return
    keys = {axis.key for axis in plan.axes}
    if plan.repeats.vary == "seed":
        if base.foam.strength_scatter == 0 and "foam.strength_scatter" not in keys:
            raise UserError(
                "repeats.vary = 'seed': the foam's strength has no scatter, so all repeats would "
                "be the same; set foam.strength_scatter, or vary the velocity"
            )
        if "foam.strength_seed" in keys:
            raise UserError(
                "repeats.vary = 'seed': foam.strength_seed has an axis of its own; leave one of "
                "the two out"
            )
    elif base.impactor is None or (
        base.impactor.velocity == 0
        and keys.isdisjoint({"impactor.velocity", "impactor.drop_height"})
    ):
        raise UserError(
            "repeats.vary = 'velocity': there is no impact velocity to vary; vary the seed, or "
            "leave the repeats out"
        )


def _without_chunk(data: Mapping[str, Any]) -> dict[str, Any]:
    """A plan's data without `chunk`, which affects how drops are distributed but not their rows."""
    return {key: value for key, value in data.items() if key != "chunk"}


def _by_axis(data: Mapping[str, Any]) -> dict[str, Any]:
    """A plan's data with its axes by key instead of by position."""
    axes = {f"axes[{axis['key']}]": axis for axis in data.get("axes", ())}
    return {**{key: value for key, value in data.items() if key != "axes"}, **axes}
