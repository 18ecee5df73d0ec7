"""Values of a scene by dotted key: read from text, put into raw data that is yet to be checked."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from taichi_foam.errors import UserError
from taichi_foam.scene import assumed, block
from taichi_foam.scene.messages import shown
from taichi_foam.scene.paths import NOTHING, at, by_key, copied, put
from taichi_foam.scene.toml import DEEPEST, LONGEST_LINE, parsed

__all__ = ["by_key", "changed", "settings"]

_FIRST = ("impactor.shape", "foam.law")
"""Keys on which it depends which others there are."""

_STANDS_FOR = {
    "block.cell": ("block.columns", "block.rows"),
    "impactor.drop_height": ("impactor.velocity",),
    "impactor.travel": ("numerics.end",),
}
"""Keys that are given in place of others, which follow from them."""


def settings(given: Mapping[str, Any] | Sequence[str]) -> dict[str, Any]:
    """Values by dotted key, given so, or as "block.rows=40" and the like, the later ones winning.

    A value in text is read as TOML, otherwise as a plain word; `none` is None. Raises UserError for
    text that does not read so.
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
    """A value read as TOML, or the word itself; None for `none`."""
    if word == "none":
        return None
    try:
        table = parsed(f"value = {word}", "a value")
    except UserError:
        return word
    return table["value"] if table.keys() == {"value"} else word


def changed(data: Mapping[str, Any], values: Mapping[str, Any]) -> dict[str, Any]:
    """Nested data of a scene with other values by dotted key; None empties an optional key.

    Whole parts come first, the impactor's shape and the foam's law next, in whatever order they are
    given: a new one drops what the old one had and it lacks. What follows from other values follows
    anew, and a value that is given does away with what stood for it. Raises UserError for a key
    that is malformed, or below one that has no keys of its own.
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
    """Keys of values that follow from others, which were given in their place."""
    found = []
    for key, others in _STANDS_FOR.items():
        part = at(scene, others[0].partition(".")[0])
        if at(scene, key) not in (None, NOTHING):
            found += [k for k in others if k.partition(".")[2] not in part.model_fields_set]
    return found


def _settle(data: dict[str, Any], values: Mapping[str, Any]) -> None:
    """Take from data whose `values` have just been changed what stands for these, or follows."""
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
    if falls and (gravity is None or (gravity == 0.0 and not given)):  # nothing falls without
        del data["numerics"]["gravity"]
