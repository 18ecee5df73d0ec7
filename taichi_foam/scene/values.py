"""Values of a scene by dotted key: read from text, and put into raw data not yet checked."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from taichi_foam.errors import UserError
from taichi_foam.scene import assumed, block
from taichi_foam.scene.messages import shown
from taichi_foam.scene.paths import NOTHING, at, copied, put
from taichi_foam.scene.toml import DEEPEST, LONGEST_LINE, parsed

_FIRST = ("impactor.shape", "foam.law")
"""Keys that determine which other keys exist."""

_STANDS_FOR = {
    "block.cell": ("block.columns", "block.rows"),
    "impactor.drop_height": ("impactor.velocity",),
    "impactor.travel": ("numerics.end",),
}
"""Keys that may be given in place of others, which then follow from them."""


def settings(given: Mapping[str, Any] | Sequence[str]) -> dict[str, Any]:
    """Values by dotted key, from a mapping or from text such as "block.rows=40"; the last one wins.

    A value in text is read as TOML, or else as a plain word; `none` is None. Raises UserError for
    text that is not KEY=VALUE.
    """
    if isinstance(given, Mapping):
        return dict(given)
    values = {}
    for text in given:
        key, equals, word = (part.strip() for part in text.partition("="))
        if not equals or not all(key.split(".")) or not word:
            raise UserError(f"{shown(text)}: must read KEY=VALUE, e.g. block.rows=40")
        if len(word) > LONGEST_LINE:
            raise UserError(
                f"{shown(key)}: a value of {len(word):,} characters; at most {LONGEST_LINE:,}; "
                "shorten it"
            )
        values[key] = _value(word)
    return values


def _value(word: str) -> Any:
    """The word as a TOML value, or else the word itself; None for `none`."""
    if word == "none":
        return None
    try:
        table = parsed(f"value = {word}", "a value")
    except UserError:
        return word
    return table["value"] if table.keys() == {"value"} else word


def changed(data: Mapping[str, Any], values: Mapping[str, Any]) -> dict[str, Any]:
    """Nested data of a scene with other values by dotted key; None clears an optional key.

    Whatever their order, whole parts are set first, then the impactor's shape and the foam's law: a
    new shape or law drops the keys that it does not have. Values that follow from changed ones are
    removed, to be derived again, and so is a key in whose place another is given. Raises UserError
    for a key that is malformed, or below one that has no keys of its own.
    """
    values = {block.todays_key(key): value for key, value in values.items()}
    found = copied(data)
    assumed.make_way(found, values)
    for key in sorted(values, key=lambda key: (key.count("."), not key.endswith(_FIRST))):
        if not all(key.split(".")) or key.count(".") > DEEPEST:
            raise UserError(f"{shown(key)}: must be the key of a value, e.g. block.rows")
        put(found, key, values[key])
    _settle(found, values)
    assumed.settle(found, values)
    return found


def following(scene: Any) -> list[str]:
    """Keys whose values follow from others that were given in their place."""
    found = []
    for key, others in _STANDS_FOR.items():
        part = at(scene, others[0].partition(".")[0])
        if at(scene, key) not in (None, NOTHING):
            found += [k for k in others if k.partition(".")[2] not in part.model_fields_set]
    return found


def _settle(data: dict[str, Any], values: Mapping[str, Any]) -> None:
    """Remove from data what follows from the changed `values`, and keys that these replace."""
    for key, following in _STANDS_FOR.items():
        (part, name), (other, _) = key.split("."), following[0].split(".")
        table = data.get(part)
        if other in values or not isinstance(table, dict) or table.get(name) is None:
            continue
        if not values.keys() & {*following}:
            for each in following:
                if isinstance(data.get(other), dict):
                    data[other].pop(each.partition(".")[2], None)
        elif key not in values:
            del table[name]
    falls = isinstance(at(data, "impactor.drop_height"), int | float)
    given = {"numerics", "numerics.gravity"} & values.keys()
    gravity = at(data, "numerics.gravity")
    if falls and (gravity is None or (gravity == 0.0 and not given)):  # a fall needs gravity
        del data["numerics"]["gravity"]
