"""What a scene says of a foam of one's own without having been told.

The paper's foam is known as a whole. Of a foam of which somebody gave some constants, the others
are derived from these, or are those of the paper's foam: each such key stands in the scene's
`assumed`, with what stands for it, so that no result hides them.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from pydantic import Field, ValidationError

from taichi_foam.errors import UserError
from taichi_foam.laws.bond import FOAMS, BondFoam
from taichi_foam.parts import Part
from taichi_foam.scene.block import Block
from taichi_foam.scene.options import Model, Numerics

_READINGS = frozenset({"crush_band", "crushed_strength"})
"""Of a foam's keys, those that sets of choices give, too: they alone make no foam of one's own."""

_KEPT = frozenset({*_READINGS, "softening", "strength_scatter", "strength_seed"})
"""What a foam keeps when a curve takes the place of its law."""

_ELSEWHERE = {
    "block.density": "that of the paper's foam",
    "numerics.damping_time": "that of the paper's foam: dashpots of so much of its stiffness",
    "model.shear_pressure_coefficient": "calibrated on the paper's foam",
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
    kind, earlier = FOAMS.kind_of(data.get("foam")), data.get("assumed")
    if kind is None or not isinstance(earlier, list | tuple | None):
        return data  # what is wrong with it is said where it is checked
    given = _given(data.get("foam"))
    if "plateau_stress" in given:
        given |= {"yield_strain"}
    elif earlier is None and not any(
        _value(data["foam"], key) != kind.model_fields[key].default
        for key in given & {*_own(kind), *_implied(kind)}
    ):
        return data
    known = {_key(each) for each in earlier or ()}
    found = [
        Assumed(key=key, why=why)
        for key, why in _unless_given(kind).items()
        if key not in known
        and key.rpartition(".")[2] not in (given if key.startswith("foam.") else _around(data, key))
    ]
    return {**data, "assumed": (*(earlier or ()), *found)}


def given_data(scene: Any) -> dict[str, Any]:
    """Nested data of a scene, without what follows from the rest: to be changed, and checked anew.

    Of the paper's foam nothing was given. What a foam file assumes stays, with its entry.
    """
    data = scene.model_dump(exclude_none=True)
    kind, foam = type(scene.foam), scene.foam
    reasons = _unless_given(kind)
    if scene.assumed is None:
        left = {f"foam.{key}" for key in _own(kind)} | _ELSEWHERE.keys()
        left = {key for key in left if _of(scene, key) == _default(kind, key)}
    else:
        left = {each.key for each in scene.assumed if each.why == reasons.get(each.key)}
        data["assumed"] = [each for each in data["assumed"] if each["key"] not in left]
        try:  # a value that somebody wrote over what was assumed is given
            rest = {key: data["foam"][key] for key in data["foam"] if f"foam.{key}" not in left}
            fresh = kind.model_validate(rest)
            left = {
                key
                for key in left
                if not key.startswith("foam.") or getattr(fresh, key[5:]) == getattr(foam, key[5:])
            }
        except ValidationError:
            left = {key for key in left if not key.startswith("foam.")}
    for key in left:
        part, _, last = key.partition(".")
        data[part].pop(last, None)
    return data


def make_way(data: dict[str, Any], values: Mapping[str, Any]) -> None:
    """Take from nested data of a scene what described a foam that `values` are about to replace.

    A name, a file or a whole foam replaces it, and so does a curve where there was none.

    Raises:
        UserError: `values` say what is assumed, which only the program does.
    """
    if any(key.partition(".")[0].partition("[")[0] == "assumed" for key in values):
        raise UserError("assumed: written by the program; give the keys that it names instead")
    foam = data.get("foam")
    named = {"foam", "foam.like"} & values.keys()
    kind = FOAMS.kind_of(foam)
    curved = "foam.curve" in values and kind is not None and not _implied(kind)
    if not (named or curved):
        return
    for entry in _entries(data.pop("assumed", None)):
        part, _, last = str(_key(entry)).partition(".")
        if isinstance(data.get(part), dict):
            data[part].pop(last, None)
    data["foam"] = {}
    if curved and not named and isinstance(foam, dict):
        data["foam"] = {key: foam[key] for key in _KEPT & foam.keys()}


def settle(data: dict[str, Any], values: Mapping[str, Any]) -> None:
    """Nested data of a scene whose `values` have just been changed: what is assumed no longer."""
    foam = data.get("foam")
    if not isinstance(foam, dict):
        return
    if values.get("foam.plateau_stress") is not None and "foam.yield_strain" not in values:
        foam.pop("yield_strain", None)
    kind = FOAMS.kind_of(foam)
    own = (
        {f"foam.{key}" for key in (*_own(kind), *_implied(kind), "plateau_stress")} if kind else ()
    )
    changed = any(key in own or key.startswith("foam.curve.") for key in values)
    if changed and "foam.source" not in values:
        foam.pop("source", None)  # it is that foam no longer
    if data.get("assumed"):
        entries = _entries(data["assumed"])
        data["assumed"] = [each for each in entries if _key(each) not in values]


def problems(entries: Iterable[Assumed], scene: Any) -> list[str]:
    """Entries whose key is none of a scene's values."""
    return [
        f"assumed.key = {each.key!r}: must be the key of a value of block, foam, model or "
        "numerics; leave assumed out, the program writes it"
        for each in entries
        if each.key.partition(".")[0] not in ("foam", *_PARTS) or _of(scene, each.key) is scene
    ]


def _unless_given(kind: type[BondFoam]) -> dict[str, str]:
    """All keys of a scene that describe a foam of a law, and what they are unless given."""
    return {f"foam.{key}": why for key, why in kind.unless_given.items()} | _ELSEWHERE


def _of(scene: Any, key: str) -> Any:
    """The value of a dotted key; the scene itself if there is no such value."""
    part, _, last = key.partition(".")
    fields = type(getattr(scene, part)).model_fields
    return getattr(getattr(scene, part), last) if last in fields else scene


def _default(kind: type[BondFoam], key: str) -> Any:
    part, _, last = key.partition(".")
    return (kind if part == "foam" else _PARTS[part]).model_fields[last].default


def _entries(value: Any) -> Iterable[Any]:
    return value if isinstance(value, list | tuple) else ()


def _key(entry: Any) -> Any:
    """The key of an entry, or of its raw data."""
    return entry.get("key") if isinstance(entry, Mapping) else getattr(entry, "key", None)


def _own(kind: type[BondFoam]) -> set[str]:
    """Keys of a law of which one alone makes a foam of one's own."""
    return kind.unless_given.keys() - _READINGS


def _implied(kind: type[BondFoam]) -> set[str]:
    return {kind.implied_by} if kind.implied_by else set()


def _around(data: Mapping[str, Any], key: str) -> frozenset[str]:
    return _given(data.get(key.partition(".")[0]))


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
