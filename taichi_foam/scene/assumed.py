"""Values of a user's foam that the program assumed.

The paper's foam is fully known. If a user gives some constants of a foam, the others are derived
from them, or are those of the paper's foam. Each such key is listed in the scene's `assumed` with
the origin of its value, so that no result hides it.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from typing import Any

from pydantic import ValidationError

from taichi_foam.choices import PAPERS_FOAM
from taichi_foam.errors import UserError
from taichi_foam.laws.bond import FOAMS, BondFoam, Curve
from taichi_foam.parts import Part, text
from taichi_foam.scene.paths import NOTHING, at, heads_of_foams

READINGS = frozenset({"crush_band", "rate", "rate_exponent", "overshoot_strain"})
"""Keys of a foam that sets of choices give, or that go with these: alone they do not make it a
user's foam, and the other foams of a block have those of [foam] unless they give their own."""

_RATE = READINGS - {"crush_band"}
"""Those of them that have to be equal in all foams of a block, given or not."""

KEPT = frozenset({"crush_band", "softening", "strength_scatter", "strength_seed"})
"""Keys that a foam keeps when a curve replaces its law."""

_ELSEWHERE = {
    "block.density": "that of the paper's foam",
    "numerics.damping_time": "that of the paper's foam: its dashpots, in proportion to stiffness",
    "model.shear_pressure_coefficient": "calibrated on the paper's foam",
}
"""Keys in other parts of a scene that describe a foam, with the origin of their defaults."""

_WHOLE = re.compile(r"block(\.layers(\[\d+\])?)?")
"""Keys of the block, of its layers, or of a single layer."""

_PARTS = ("across", "block", "numerics", "model")
"""Parts of a scene, other than the foam, that have such values."""

_OTHERS = ("across.", "block.layers[")
"""Beginnings of keys of foams other than [foam]."""


class Origin(Part):
    """A key of a scene, and the origin of its value."""

    key: str = text(..., "dotted key of the scene", 100)
    why: str = text(..., "origin of its value", 1000)


def followed(scene: Any) -> dict[str, Any]:
    """Changed parts of a scene by name: its `assumed`, and parts with foams completed by [foam]."""
    found = [_unsaid(scene, head) for head in heads_of_foams(scene)]
    parts = _with_readings(scene)
    if any(entries is not None for entries in found):
        unsaid = (each for entries in found for each in entries or ())
        parts["assumed"] = (*(scene.assumed or ()), *unsaid)
    return parts


def _with_readings(scene: Any) -> dict[str, Any]:
    """Parts whose foams take the readings of [foam] that they do not give themselves."""

    readings = READINGS & _given(scene.foam)
    if not readings:
        return {}

    def read(part: Any) -> Any:
        if (foam := part.foam) is None:
            return part
        stated = _given(foam) | (foam.model_fields_set & _RATE)
        missing = readings & type(foam).model_fields.keys() - stated
        values = {key: getattr(scene.foam, key) for key in missing}
        return part.with_computed(foam=foam.with_computed(**values))

    layers = tuple(map(read, scene.block.layers))
    return {"across": read(scene.across), "block": scene.block.with_computed(layers=layers)}


def _unsaid(scene: Any, head: str) -> list[Origin] | None:
    """Assumptions about one of a scene's foams that are not listed yet; None: the paper's foam."""
    foam, earlier = at(scene, f"{head}foam"), scene.assumed
    kind, given = type(foam), _given(foam)
    known = {each.key for each in earlier or ()}
    of_others = {key for key in known if key.startswith(_OTHERS)}
    if head:
        said = any(key.startswith(f"{head}foam.") for key in of_others)
    else:  # an empty list means that all of [foam] was given
        said = earlier is not None and (not known or bool(known - of_others))
    if not said and all(
        getattr(foam, key) in (kind.model_fields[key].default, PAPERS_FOAM.get(key))
        for key in given & _telling(kind)
    ):
        return None
    return [
        Origin(key=key, why=why)
        for key, why in _unless_given(kind, head).items()
        if key not in known and not _is_given(scene, key)
    ]


def given_data(scene: Any) -> dict[str, Any]:
    """Nested data of a scene without values that follow from others, to be changed and rechecked.

    Of the paper's foam no key counts as given. The assumptions of a foam file stay, with their
    entries.
    """
    data = scene.model_dump(exclude_none=True)
    for key in scene.block.computed:
        del data["block"][key]
    unsaid = {key for head in heads_of_foams(scene) for key in _not_given(scene, data, head)}
    if scene.assumed is not None:
        data["assumed"] = [each for each in data["assumed"] if each["key"] not in unsaid]
        if not data["assumed"] and _is_papers(scene, ""):
            del data["assumed"]  # an empty list would mean that all of [foam] was given
    for key in unsaid:
        _take(data, key)
    return data


def _not_given(scene: Any, data: Mapping[str, Any], head: str) -> set[str]:
    """Keys of one of a scene's foams that were not given; `data` is the scene's nested data.

    Their values are those that the foam has if they are left out: a value that replaces an assumed
    one counts as given.
    """
    foam, own = at(scene, f"{head}foam"), f"{head}foam."
    reasons = _unless_given(type(foam), head)
    shared = READINGS & type(foam).model_fields.keys() & type(scene.foam).model_fields.keys()
    readings = {own + key for key in shared} if head else set()
    if _is_papers(scene, head):
        keys = {*(own + key for key in _own(type(foam))), *_around_foam(head), *readings}
    else:
        keys = {each.key for each in scene.assumed if each.why == reasons.get(each.key)}
    rest = {key: value for key, value in at(data, own[:-1]).items() if own + key not in keys}
    rest |= {key: getattr(scene.foam, key) for key in shared if own + key in keys & readings}
    try:
        fresh = type(foam).model_validate(rest)
    except ValidationError:
        fresh = None

    def is_unchanged(key: str) -> bool:
        head, _, last = key.rpartition(".")
        if f"{head}." == own:
            return fresh is not None and getattr(fresh, last) == getattr(foam, last)
        return at(scene, key) == type(at(scene, head)).model_fields[last].default

    return set(filter(is_unchanged, keys))


def _is_papers(scene: Any, head: str) -> bool:
    """Whether one of a scene's foams is the paper's, since none of its keys was given."""
    if scene.assumed is None:
        return True
    if not head and len(list(heads_of_foams(scene))) == 1:
        return False  # the scene's assumptions are about this foam
    foam = at(scene, f"{head}foam")
    described = {f"{head}foam.{key}" for key in type(foam).model_fields} | _around_foam(head).keys()
    return not any(each.key in described for each in scene.assumed) and all(
        getattr(foam, key) == type(foam).model_fields[key].default for key in _own(type(foam))
    )


def make_way(data: dict[str, Any], values: Mapping[str, Any]) -> None:
    """Remove from nested data of a scene what describes foams that `values` are about to replace.

    A name, a file or a whole foam replaces a foam, and so does a curve if the foam had none.

    Raises:
        UserError: `values` contain `assumed`, which only the program writes.
    """
    if any(key.partition(".")[0].partition("[")[0] == "assumed" for key in values):
        raise UserError("assumed: is written by the program; instead, give the keys that it names")
    for key in values:
        if data.get("assumed") and _WHOLE.fullmatch(
            key
        ):  # layers are replaced together with the assumptions about them
            _forget(data, key if key.endswith("]") else "block.layers[")
    for head in list(heads_of_foams(data)):
        place = at(data, head.rstrip("."))
        foam, kind = place.get("foam"), FOAMS.kind_of(place.get("foam"))
        named = {f"{head}foam", f"{head}foam.like"} & values.keys()
        curved = f"{head}foam.curve" in values and kind is not None and kind.implied_by is None
        if not (named or curved):
            continue
        for key in _forget(data, head):
            _take(data, key)
        place["foam"] = {}
        if curved and not named and isinstance(foam, dict):
            place["foam"] = {key: foam[key] for key in KEPT & foam.keys()}


def _forget(data: dict[str, Any], head: str) -> list[str]:
    """Remove entries whose keys begin with `head`, or those of [foam] if it is empty.

    Returns their keys.
    """
    entries = data.get("assumed")
    if not isinstance(entries, list):
        return []  # a later check reports the error
    keys = [str(_key(each)) for each in entries]
    gone = [key.startswith(head) if head else not key.startswith(_OTHERS) for key in keys]
    data["assumed"] = [each for each, goes in zip(entries, gone, strict=True) if not goes]
    if not data["assumed"]:
        del data["assumed"]
    return [key for key, goes in zip(keys, gone, strict=True) if goes]


def _take(data: Any, key: str) -> None:
    """Remove a dotted key from nested data, if present."""
    part, _, last = key.rpartition(".")
    if isinstance(table := at(data, part), dict):
        table.pop(last, None)


def settle(data: dict[str, Any], values: Mapping[str, Any]) -> None:
    """Remove from nested data the entries and sources that no longer hold once `values` changed."""
    for head in heads_of_foams(data):
        own, foam = f"{head}foam.", at(data, f"{head}foam")
        kind = FOAMS.kind_of(foam)
        if not isinstance(foam, dict):
            continue
        if values.get(f"{own}plateau_stress") is not None and f"{own}yield_strain" not in values:
            foam.pop("yield_strain", None)
        keys = {own + key for key in (*_telling(kind), "plateau_stress")} if kind else ()
        changed = any(key in keys or key.startswith(f"{own}curve.") for key in values)
        if changed and f"{own}source" not in values:
            foam.pop("source", None)  # it is no longer the foam from that source
        if kind and f"{own}law" in values and isinstance(data.get("assumed"), list):
            there = {own + key for key in kind.model_fields}
            data["assumed"] = [
                each
                for each in data["assumed"]
                if not (_key(each) or "").startswith(own) or _key(each) in there
            ]
    if isinstance(entries := data.get("assumed"), list) and entries:
        replaced = {re.sub(r"\.curve\..*", ".curve", key) for key in values}
        data["assumed"] = [each for each in entries if _key(each) not in replaced]


def problems(entries: Iterable[Origin], scene: Any) -> list[str]:
    """Problems of entries whose key is not that of a value of the scene."""
    return [
        f"assumed.key = {each.key!r}: must be the key of a value in across, block, foam, model or "
        "numerics; leave assumed out: the program writes it"
        for each in entries
        if each.key.partition(".")[0] not in ("foam", *_PARTS) or not _is_value(scene, each.key)
    ]


def _is_value(scene: Any, key: str) -> bool:
    """Whether a key is that of a value of a part, and not of a part or a list of parts."""
    head, _, last = key.rpartition(".")
    part, found = at(scene, head), at(scene, key)
    if not isinstance(part, Part) or last not in type(part).model_fields:
        return False
    first = found[0] if isinstance(found, tuple) and found else found
    return found is not NOTHING and (isinstance(first, Curve) or not isinstance(first, Part))


def _unless_given(kind: type[BondFoam], head: str) -> dict[str, str]:
    """All keys of a scene that describe a foam of a law, with the origin of their defaults."""
    shared = {"shear_modulus", *READINGS} if head == "across." else READINGS if head else set()
    shared = shared & kind.model_fields.keys()
    reasons = dict(kind.unless_given) | dict.fromkeys(shared, "that of [foam]")
    own = {f"{head}foam.{key}": why for key, why in reasons.items()}
    return {**own, **_around_foam(head)}


def _around_foam(head: str) -> Mapping[str, str]:
    """The same for keys outside the foam's table."""
    if head == "across.":  # the same foam has the same density
        return {}
    return {f"{head}density": "that of the block"} if head else _ELSEWHERE


def _key(entry: Any) -> str | None:
    """The key of an entry, or of its raw data; None if it is not text."""
    key = entry.get("key") if isinstance(entry, Mapping) else getattr(entry, "key", None)
    return key if isinstance(key, str) else None


def _own(kind: type[BondFoam]) -> set[str]:
    """Keys of a law any of which, if given, makes it a user's foam."""
    return kind.unless_given.keys() - READINGS


def _telling(kind: type[BondFoam]) -> set[str]:
    """These keys, and the one that implies the law."""
    return _own(kind) | ({kind.implied_by} if kind.implied_by else set())


def _given(part: Part) -> set[str]:
    """The keys of a part that were given."""
    return {key for key in part.model_fields_set if getattr(part, key) is not None}


def _is_given(scene: Any, key: str) -> bool:
    head, _, last = key.rpartition(".")
    return last in _given(at(scene, head))
