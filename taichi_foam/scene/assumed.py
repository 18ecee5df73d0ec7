"""What a scene says of a foam of one's own without having been told.

The paper's foam is known as a whole. Of a foam of which somebody gave some constants, the others
are derived from these, or are those of the paper's foam: each such key stands in the scene's
`assumed`, with what stands for it, so that no result hides them.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from pydantic import Field

from taichi_foam.laws.bond import FOAMS, BondFoam
from taichi_foam.parts import Part
from taichi_foam.scene.block import Block
from taichi_foam.scene.options import Model, Numerics

_READINGS = frozenset({"crush_band", "crushed_strength"})
"""Of a foam's keys, those that sets of choices give, too: they alone make no foam of one's own."""

_ELSEWHERE = {
    ("block", "density"): "that of the paper's foam",
    ("numerics", "damping_time"): "that of the paper's foam: dashpots of so much of its stiffness",
    ("model", "shear_pressure_coefficient"): "calibrated on the paper's foam",
}
"""What describes a foam and stands in other parts of a scene, and what it is unless given."""

_PARTS: Mapping[str, type[Part]] = {"block": Block, "numerics": Numerics, "model": Model}


class Assumed(Part):
    """A key that nobody gave, and what stands for its value."""

    key: str = Field(description="dotted key of the scene", max_length=100)
    why: str = Field(description="where its value is from", max_length=1000)


def completed(data: Any) -> Any:
    """Raw data of a scene with what it assumes of a foam of one's own."""
    if not isinstance(data, Mapping):
        return data
    kind = _kind(data.get("foam"))
    if kind is None:
        return data
    given = _given(data.get("foam"))
    own = (kind.unless_given.keys() - _READINGS) | _implied(kind)
    earlier = data.get("assumed")
    if (
        earlier is None
        and not any(
            _value(data["foam"], key) != kind.model_fields[key].default for key in given & own
        )
        and "plateau_stress" not in given
    ):
        return data
    if not isinstance(earlier, list | tuple | None):
        return data  # what is wrong with it is said where it is checked
    if "plateau_stress" in given:
        given |= {"yield_strain"}
    found = [
        Assumed(key=f"foam.{key}", why=why)
        for key, why in kind.unless_given.items()
        if key not in given
    ]
    found += [
        Assumed(key=f"{part}.{key}", why=why)
        for (part, key), why in _ELSEWHERE.items()
        if key not in _given(data.get(part))
    ]
    known = {_key(each) for each in earlier or ()}
    new = (each for each in found if each.key not in known)
    return {**data, "assumed": (*(earlier or ()), *new)}


def settle(data: dict[str, Any], values: Mapping[str, Any]) -> None:
    """Nested data of a scene whose `values` have just been changed: what is assumed now.

    A curve makes the foam one of its own law. What an earlier foam was derived from, or was the
    paper's, is so no longer when one of its constants is changed.
    """
    foam = data.get("foam")
    if "foam" in values or not isinstance(foam, dict):
        data.pop("assumed", None)
        _forget_elsewhere(data, values)
        return
    if "foam.plateau_stress" in values and "foam.yield_strain" not in values:
        foam.pop("yield_strain", None)
    before, law = _kind(foam), _kind({**foam, FOAMS.tag: None})
    if law is not None and law.implied_by and law is not before and "foam.law" not in values:
        for key in [*foam]:  # what described the old foam
            if f"foam.{key}" not in values and key not in {*_READINGS, "softening", "source"}:
                del foam[key]
        data.pop("assumed", None)
        _forget_elsewhere(data, values)
        return
    if before is None:
        return
    changed = {key for key in before.unless_given if f"foam.{key}" in values}
    if "plateau_stress" in foam:
        changed.add("yield_strain")
    changed |= {key for key in _implied(before) if f"foam.{key}" in values}
    earlier = data.get("assumed")
    if earlier is None:
        if changed - _READINGS and _is_default(foam, before, changed):
            for key in before.unless_given.keys() - changed - _READINGS:
                foam.pop(key, None)
            _forget_elsewhere(data, values)
        return
    data["assumed"] = []
    for each in earlier:
        key = _key(each)
        part, _, last = key.partition(".")
        if key in values:
            continue
        if changed and _implied(before) and part == "foam":
            foam.pop(last, None)  # it follows from what was changed
        else:
            data["assumed"].append(each)


def _forget_elsewhere(data: dict[str, Any], values: Mapping[str, Any]) -> None:
    """Take out what other parts say of the paper's foam, if it is what they say anyway."""
    for (part, key), _ in _ELSEWHERE.items():
        table, default = data.get(part), _PARTS[part].model_fields[key].default
        if part in values or f"{part}.{key}" in values or not isinstance(table, dict):
            continue
        if table.get(key) == default:
            del table[key]


def _is_default(foam: Mapping[str, Any], kind: type[BondFoam], changed: set[str]) -> bool:
    """Whether a table has all values of a law's default foam, but for what was changed."""
    fields = kind.model_fields
    return all(
        key in changed or foam.get(key) == fields[key].default
        for key in kind.unless_given.keys() - _READINGS
    )


def _key(entry: Any) -> Any:
    """The key of an entry, or of its raw data."""
    return entry.get("key") if isinstance(entry, Mapping) else getattr(entry, "key", None)


def _kind(foam: Any) -> type[BondFoam] | None:
    if isinstance(foam, BondFoam):
        return type(foam)
    if not isinstance(foam, Mapping):
        return None
    tag = FOAMS.tag_of(foam)
    return FOAMS.get(tag) if isinstance(tag, str) else None


def _implied(kind: type[BondFoam]) -> set[str]:
    return {kind.implied_by} if kind.implied_by else set()


def _value(part: Any, key: str) -> Any:
    """The value of a part, or in its raw data."""
    return part[key] if isinstance(part, Mapping) else getattr(part, key)


def _given(part: Any) -> frozenset[str]:
    """The keys of a part, or of its raw data, that were given."""
    if isinstance(part, Part):
        return frozenset(key for key in part.model_fields_set if getattr(part, key) is not None)
    if isinstance(part, Mapping):
        return frozenset(key for key, value in part.items() if value is not None)
    return frozenset()
