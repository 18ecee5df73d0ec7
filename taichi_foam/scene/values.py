"""Values of a scene by dotted key: read from text, put into raw data that is yet to be checked."""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from taichi_foam.errors import UserError
from taichi_foam.laws.bond import FOAMS, BondFoam
from taichi_foam.laws.shape import SHAPES
from taichi_foam.parts import Part
from taichi_foam.scene import assumed, block, driven, fall
from taichi_foam.scene.messages import key_shown, shown
from taichi_foam.scene.paths import steps
from taichi_foam.scene.toml import DEEPEST, LONGEST_LINE, parsed

_FIRST = ("impactor.shape", "foam.law")
"""Keys on which it depends which others there are."""


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


def changed(data: Mapping[str, Any], values: Mapping[str, Any]) -> dict[str, Any]:
    """Nested data of a scene with other values by dotted key; None empties an optional key.

    Whole parts come first, the impactor's shape and the foam's law next, in whatever order they are
    given: a new one drops what the old one had and it lacks. A velocity and a drop height stand for
    each other (`fall.settle`), so do a cell's edge and the numbers of cells (`block.settle`), and
    some of a foam's values for others (`assumed.settle`). Raises
    UserError for a key that is malformed, or below one that has no keys of its own.
    """
    values = {block.todays_key(key): value for key, value in values.items()}
    found = _listed(dict(data))
    assumed.make_way(found, values)
    for key in sorted(values, key=lambda key: (key.count("."), not key.endswith(_FIRST))):
        if not all(key.split(".")) or key.count(".") > DEEPEST:
            raise UserError(f"{shown(key)}: must be the key of a value, e.g. block.rows")
        _put(found, key, values[key])
    block.settle(found, values)
    fall.settle(found, values)
    driven.settle(found, values)
    assumed.settle(found, values)
    return found


def _listed(value: Any) -> Any:
    """A copy of raw data, down to its values, whose lists can be changed."""
    if isinstance(value, Mapping):
        return {key: _listed(each) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [_listed(each) for each in value]
    return copy.deepcopy(value)


def by_key(data: Mapping[str, Any], head: str = "") -> dict[str, Any]:
    """Nested data of a scene as values by dotted key."""
    found: dict[str, Any] = {}
    for name, value in data.items():
        nested = by_key(value, f"{head}{name}.") if isinstance(value, Mapping) else None
        found |= {head + name: value} if nested is None else nested
    return found


def _put(data: dict[str, Any], key: str, value: Any) -> None:
    """Set a dotted key in nested dictionaries and lists, making tables on the way."""
    *heads, last = steps(key)
    table: Any = data
    for step in heads:
        if isinstance(step, int):
            table = _place(table, step, key)
            continue
        if isinstance(table, dict) and table.get(step) is None:
            table[step] = {}
        if not isinstance(table, dict) or not isinstance(table[step], dict | list):
            raise UserError(
                f"{key_shown(key)}: unknown key; {key_shown(str(step))} has no keys of its own"
            )
        table = table[step]
    if key == "impactor.shape" and isinstance(value, str) and value in SHAPES:
        # Keys of the old shape that the new one lacks would be refused as unknown.
        for old in table.keys() - SHAPES[value].model_fields.keys():
            del table[old]
    if last == "law" and heads[-1:] == ["foam"] and isinstance(value, str) and value in FOAMS:
        for old in table.keys() - FOAMS[value].model_fields.keys():
            del table[old]
    if last == "foam" and isinstance(value, str):
        value = {"like": value}
    if isinstance(last, int):
        _place(table, last, key)
    elif not isinstance(table, dict):
        raise UserError(f"{key_shown(key)}: a list has no keys; say which of it, [0] the first")
    table[last] = _plain(value)


def _place(listed: Any, number: int, key: str) -> Any:
    """What a list has in a place. Raises UserError: it is none, or has no such place."""
    if not isinstance(listed, list):
        raise UserError(f"{key_shown(key)}: unknown key; only lists have places [0], [1] and so on")
    if number >= len(listed):
        raise UserError(
            f"{key_shown(key)}: beyond the end of the list, which has {len(listed)}, counted from "
            "[0]; give the whole list to make it longer"
        )
    return listed[number]


def _plain(value: Any) -> Any:
    """A part as its data, and a NumPy number as Python's: scenes take no other types."""
    if isinstance(value, BondFoam):  # what was not given is to be told from what was
        kept = value.model_fields_set | {FOAMS.tag}
        return {key: _plain(each) for key, each in _values(value) if key in kept}
    if isinstance(value, Part):
        return {key: _plain(each) for key, each in _values(value)}
    if isinstance(value, list | tuple):
        return [_plain(each) for each in value]
    return value.item() if isinstance(value, np.generic) else value


def _values(part: Part) -> list[tuple[str, Any]]:
    """Those of a part that are not none, by name."""
    given = ((name, getattr(part, name)) for name in type(part).model_fields)
    return [(name, value) for name, value in given if value is not None]


def _value(word: str) -> Any:
    """A value read as TOML, or the word itself; None for `none`."""
    if word == "none":
        return None
    try:
        table = parsed(f"value = {word}", "a value")
    except UserError:
        return word
    return table["value"] if table.keys() == {"value"} else word
