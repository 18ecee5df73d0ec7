"""Common base of all parts of a scene: a frozen model, fields with ranges, registries."""

from __future__ import annotations

import reprlib
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Generic, TypeVar

from pydantic import BaseModel, ConfigDict, Field, GetCoreSchemaHandler, ValidationError
from pydantic.fields import FieldInfo
from pydantic_core import CoreSchema, InitErrorDetails, PydanticCustomError, core_schema

from taichi_foam.units import plain

FIX_BY_UNIT = {
    "m": "lengths are in metres (200 mm is 0.2)",
    "s": "times are in seconds (1 ms is 1e-3)",
    "ms": "this is in milliseconds (11 ms is 11)",
    "g": "this is in g of 9.80665 m/s2 (490 m/s2 is 50)",
    "m/s": "speeds are in metres per second (3030 mm/s is 3.03), positive downwards",
    "m/s2": "accelerations are in m/s2 (free fall is 9.81)",
    "kg": "masses are in kilograms (500 g is 0.5)",
    "kg/m3": "densities are in kg/m3 (0.0256 g/cm3 is 25.6)",
    "Pa": "moduli and stresses are in pascals (2.78 MPa is 2.78e6)",
    "tension": "strains are fractions (5 % is 0.05), positive in tension",
    "compression": "strains are fractions (5 % is 0.05), negative in compression: -0.05",
    "deg": "angles are in degrees",
    "rad/s": "spins are in radians per second (one turn per second is 6.283), counter-clockwise",
    "kg m2": "moments of inertia are in kg m2 (1 kg cm2 is 1e-4)",
    "1/s": "rates are in 1/s",
    "J/m2": "energies per area are in joules per square metre (0.0174 N/mm is 17.4)",
    "-": "it is a plain number",
    "px": "sizes are in pixels",
}
"""Advice for a value out of range, by the field's unit."""

# The two strain entries differ in sign convention only.
_WITHOUT_UNIT = frozenset({"tension", "compression", "-", "count"})


MOST_SHOWN = 12
"""A longer list is represented by the number of its values and their range."""

Coordinate = Annotated[float, Field(ge=-5, le=5)]
# Lists are accepted as tuples here, since TOML and most scripts use lists.
Corner = Annotated[tuple[Coordinate, Coordinate], Field(strict=False)]
"""A point [x, y] [m]."""


Kind = TypeVar("Kind", bound="Part")


class Part(BaseModel):
    """A frozen piece of a scene: no unknown keys, no silent conversion, no NaN or infinity."""

    places: ClassVar[tuple[str, ...]] = ()
    """The keys under which a scene has parts of this kind; empty string for the scene itself."""

    model_config = ConfigDict(
        frozen=True, extra="forbid", strict=True, allow_inf_nan=False, hide_input_in_errors=True
    )

    def with_computed(self: Kind, **values: Any) -> Kind:
        """A copy with computed values; `model_fields_set` still lists only the given ones."""
        return _given_only(self.model_copy(update=values), self.model_fields_set)

    def __repr_args__(self) -> Iterator[tuple[str | None, Any]]:
        """The given values that differ from the defaults, as a user would write them."""
        for name, value in super().__repr_args__():
            field = type(self).model_fields.get(name or "")
            if field is None or (name in self.model_fields_set and value != field.default):
                is_long = isinstance(value, tuple) and len(value) > MOST_SHOWN
                yield name, _Told(value) if is_long else value

    def __setattr__(self, name: str, value: Any) -> None:
        """Refuse to change a value, and say how to make a changed scene."""
        if not self.places or name.startswith("_"):
            super().__setattr__(name, value)
            return
        keys = [f"{place}.{name}".lstrip(".") for place in self.places]
        key, given = keys[0].replace("[]", "[0]"), reprlib.repr(value)
        changed = f"{{{key!r}: {given}}}" if "[" in key else f"{key.replace('.', '__')}={given}"
        text = (
            f"{key}: scenes cannot be changed; scene.with_values({changed}) returns a changed copy"
        )
        if len(keys) > 1 or "[" in key:
            others = " or ".join(keys).replace("[]", "[N]")
            text += f"; use the key of the part that you mean, {others}"
        problem = PydanticCustomError("value_error", "{error}", {"error": text})
        details = InitErrorDetails(type=problem, loc=(name,), input=value)
        raise ValidationError.from_exception_data(type(self).__name__, [details], hide_input=True)

    def __dir__(self) -> list[str]:
        """Its own names, without pydantic's."""
        own = {name for name in super().__dir__() if not name.startswith("_")}
        return sorted(own - {*dir(BaseModel)} | {*dir(object)})


def completed(given: Mapping[str, Any], computed: Mapping[str, Any], handler: Any) -> Any:
    """For a "wrap" validator: the part made of given values, and computed ones for the rest.

    `model_fields_set` lists only the given values.
    """
    return _given_only(handler({**computed, **given}), given)


def _given_only(part: Kind, given: Iterable[str]) -> Kind:
    object.__setattr__(part, "__pydantic_fields_set__", set(given))
    return part


class _Told:
    """Stands for a long list in a representation."""

    def __init__(self, values: tuple[Any, ...]) -> None:
        self._values = values

    def __repr__(self) -> str:
        count = f"{len(self._values):,}"
        if not all(isinstance(each, int | float) for each in self._values):
            return f"<{count} values>"
        return f"<{count} numbers, {min(self._values):g} to {max(self._values):g}>"


@dataclass(frozen=True)
class Control:
    """A value that a live page offers: its field, label, range and step [shown unit].

    low, high, step  of its slider, which covers the usual values
    unit             shown unit, of `factor` SI units
    log              whether the slider is logarithmic
    """

    field: str
    label: str
    low: float
    high: float
    step: float
    unit: str = ""
    factor: float = 1.0
    log: bool = False


def quantity(
    default: Any,
    unit: str,
    meaning: str,
    *,
    above: float | None = None,
    at_least: float | None = None,
    below: float | None = None,
    at_most: float | None = None,
    allowed: str | None = None,
    fix: str | None = None,
    unless: str | None = None,
    **more: Any,
) -> Any:
    """Return a pydantic field for a number with its unit and its range.

    Args:
        default: value if the scene does not give one; `...`: required.
        unit: key of `FIX_BY_UNIT`.
        meaning: what the number is; becomes the field's description.
        above, at_least, below, at_most: the range, enforced and described; with the default None,
            None is allowed, too.
        allowed: the range in words, for a field whose type enforces it.
        fix: what to do about a value out of range; default `FIX_BY_UNIT[unit]`.
        unless: shown instead of the default if that follows from other values.
        more: passed on to `pydantic.Field`.
    """
    shown = "" if unit in _WITHOUT_UNIT else unit
    limits = {"above": above, "at least": at_least, "below": below, "at most": at_most}
    given = [
        f"{text} {format(limit, ',') if isinstance(limit, int) else plain(limit)}"
        for text, limit in limits.items()
        if limit is not None
    ]
    bounds = {"gt": above, "ge": at_least, "lt": below, "le": at_most}
    none = "none, or " if default is None else ""
    allowed = allowed or f"{none}{' and '.join(given)} {shown}".rstrip()
    return Field(
        default=default,
        description=meaning,
        json_schema_extra={
            "allowed": allowed,
            "fix": fix or FIX_BY_UNIT[unit],
            "unit": shown,
            **({"unless": unless} if unless else {}),
        },
        **{name: limit for name, limit in bounds.items() if limit is not None},
        **more,
    )


def text(default: Any, meaning: str, most: int) -> Any:
    """Return a pydantic field for text of 1 to `most` characters; default `...`: required."""
    none = "none, or " if default is None else ""
    return Field(
        default=default,
        description=meaning,
        min_length=1,
        max_length=most,
        json_schema_extra={"allowed": f"{none}text of 1 to {most:,} characters"},
    )


def choice(default: Any, meaning: str) -> Any:
    """Return a pydantic field for a named option or a switch."""
    return Field(default=default, description=meaning)


def is_number(value: Any) -> bool:
    """Whether raw data is a finite number that a double holds."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return False
    return -sys.float_info.max <= value <= sys.float_info.max


def hints_of(field: FieldInfo) -> Mapping[str, Any]:
    """Hints that `quantity` stored: `allowed`, `fix`, `unit`, `unless`; empty for other fields."""
    extra = field.json_schema_extra
    return extra if isinstance(extra, dict) else {}


def unit_of(field: FieldInfo) -> str:
    """Unit of a field (SI, degrees or pixels); empty for plain numbers and other fields."""
    return str(hints_of(field).get("unit", ""))


def described(field: FieldInfo) -> str:
    """A field's description, with its unit in brackets if it has one."""
    unit = unit_of(field)
    return f"{field.description or ''}{f' [{unit}]' if unit else ''}"


class Registry(dict[str, type[Kind]], Generic[Kind]):
    """Classes of one kind by their tag, the word by which a scene selects one.

    tag       name of the field with the tag, a Literal in each class
    meaning   description of that field
    default   tag of a table that gives none; None: a table must give one
    watchers  functions called when a class is registered
    """

    def __init__(self, tag: str, meaning: str, default: str | None = None) -> None:
        self.tag, self.meaning, self.default = tag, meaning, default
        self.watchers: list[Callable[[], object]] = []

    def register(self, kind: type[Kind]) -> type[Kind]:
        """Add a class, or replace the one with its tag; returns it, for use as a decorator."""
        self[kind.model_fields[self.tag].default] = kind
        for watcher in self.watchers:
            watcher()
        return kind

    def remove(self, tag: str) -> None:
        """Remove a class."""
        del self[tag]
        for watcher in self.watchers:
            watcher()

    __hash__ = object.__hash__  # type: ignore[assignment]  # one registry per kind

    def __get_pydantic_core_schema__(
        self, source: Any, handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        """As metadata of a field: a union of all classes, discriminated by their tag."""
        return core_schema.tagged_union_schema(
            {tag: handler.generate_schema(kind) for tag, kind in self.items()},
            discriminator=self.tag_of,
        )

    def kind_of(self, value: Any) -> type[Kind] | None:
        """The class of a table or an instance; None if it has none."""
        tag = self.tag_of(value)
        return self.get(tag) if isinstance(tag, str) else None

    def tag_of(self, value: Any) -> Any:
        """The tag of a table or an instance; if a table gives none, its keys may imply one."""
        if not isinstance(value, Mapping):
            return getattr(value, self.tag, None)
        tag = value.get(self.tag)
        if tag is None:
            implied = (n for n, kind in self.items() if getattr(kind, "implied_by", None) in value)
            tag = next(implied, self.default)
        return tag if tag is None or isinstance(tag, str) else ""  # a tag that no class has
