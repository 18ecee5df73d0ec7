"""Dotted keys of a scene, including those of lists: `block.layers[0].foam.shear_strain`."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from taichi_foam.errors import UserError
from taichi_foam.laws.bond import FOAMS, BondFoam
from taichi_foam.laws.shape import SHAPES
from taichi_foam.parts import Part, unit_of
from taichi_foam.scene.messages import key_shown

NOTHING = object()
"""Result for a key under which there is nothing."""

_STEP = re.compile(r"([^\[\]]+)((?:\[\d{1,6}\])*)")


def at(data: Any, key: str) -> Any:
    """The value under a dotted key, in raw data or in parts; NOTHING if there is none."""
    for step in _steps(key) if key else ():
        if isinstance(step, int):
            listed = isinstance(data, list | tuple) and step < len(data)
            data = data[step] if listed else NOTHING  # type: ignore[index]
        elif isinstance(data, Mapping):
            data = data.get(step, NOTHING)
        else:
            fields = getattr(type(data), "model_fields", {})
            data = getattr(data, step) if step in fields else NOTHING
    return data


def unit_at(parts: Any, key: str) -> str:
    """The unit of a dotted key in parts of a scene; empty if it has none."""
    head, _, last = key.rpartition(".")
    field = getattr(type(at(parts, head)), "model_fields", {}).get(last)
    return unit_of(field) if field else ""


def heads_of_foams(data: Any) -> Iterator[str]:
    """Yield the beginnings of the keys of a scene's foams: "", "across.", "block.layers[0]." etc.

    `data` is a scene, or raw data of one.
    """
    yield ""
    if at(data, "across.foam") not in (None, NOTHING):
        yield "across."
    layers = at(data, "block.layers")
    if isinstance(layers, list | tuple):
        for number, layer in enumerate(layers):
            if at(layer, "foam") not in (None, NOTHING):
                yield f"block.layers[{number}]."


def by_key(data: Mapping[str, Any], head: str = "") -> dict[str, Any]:
    """Nested data of a scene as values by dotted key."""
    found: dict[str, Any] = {}
    for name, value in data.items():
        nested = by_key(value, f"{head}{name}.") if isinstance(value, Mapping) else None
        found |= {head + name: value} if nested is None else nested
    return found


def copied(data: Any) -> Any:
    """A copy of raw data, with tables and lists that can be changed."""
    if isinstance(data, Mapping):
        return {key: copied(each) for key, each in data.items()}
    if isinstance(data, list | tuple):  # most are the numbers of a curve
        return [each if isinstance(each, float) else copied(each) for each in data]
    return data


def put(data: dict[str, Any], key: str, value: Any) -> None:
    """Set a dotted key in nested dictionaries and lists, creating missing tables.

    A new shape or law removes the old one's keys that it does not have. Raises UserError: the key
    is below one that has no keys of its own, or beyond the end of a list.
    """
    *heads, last = _steps(key)
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
    for part, registry in (("impactor", SHAPES), ("foam", FOAMS)):
        if [*heads[-1:], last] == [part, registry.tag] and value in [*registry]:
            # keys of the old class that the new one lacks would be refused as unknown
            for old in table.keys() - registry[value].model_fields.keys():
                del table[old]
    if last == "foam" and isinstance(value, str):
        value = {"like": value}
    if isinstance(last, int):
        _place(table, last, key)
    elif not isinstance(table, dict):
        raise UserError(
            f"{key_shown(key)}: a list has no keys; say which of its entries is meant, such as "
            "[0] for the first"
        )
    table[last] = _plain(value)


def _steps(key: str) -> list[str | int]:
    """The names and indices of a dotted key; malformed parts are kept as they are."""
    found: list[str | int] = []
    for part in key.split("."):
        step = _STEP.fullmatch(part)
        found.append(step[1] if step else part)
        if step:
            found += map(int, re.findall(r"\d+", step[2]))
    return found


def _place(listed: Any, number: int, key: str) -> Any:
    """The item of a list at an index. Raises UserError: not a list, or no such item."""
    if not isinstance(listed, list):
        raise UserError(
            f"{key_shown(key)}: unknown key; only lists have entries [0], [1] and so on"
        )
    if number >= len(listed):
        raise UserError(
            f"{key_shown(key)}: beyond the end of the list (length {len(listed)}, counted from "
            "[0]); give the whole list to make it longer"
        )
    return listed[number]


def _plain(value: Any) -> Any:
    """A part as raw data, and a NumPy number as a Python number, as scenes accept them."""
    if isinstance(value, Part):
        names = type(value).model_fields
        if isinstance(value, BondFoam):  # keep only the keys that were given
            names = [name for name in names if name in {*value.model_fields_set, FOAMS.tag}]
        found = ((name, getattr(value, name)) for name in names)
        return {name: _plain(each) for name, each in found if each is not None}
    if isinstance(value, list | tuple):
        return [_plain(each) for each in value]
    return value.item() if isinstance(value, np.generic) else value
