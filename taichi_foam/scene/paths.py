"""Dotted keys of a scene, those of lists among them: `block.layers[0].foam.shear_strain`."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import Any

NOTHING = object()
"""What stands where a key leads nowhere."""

_STEP = re.compile(r"([^\[\]]+)((?:\[\d{1,6}\])*)")


def steps(key: str) -> list[str | int]:
    """The names and places of a dotted key; a part that is no name stays as it is."""
    found: list[str | int] = []
    for part in key.split("."):
        step = _STEP.fullmatch(part)
        found.append(step[1] if step else part)
        if step:
            found += map(int, re.findall(r"\d+", step[2]))
    return found


def at(data: Any, key: str) -> Any:
    """What stands under a dotted key, in raw data or in parts; NOTHING if nothing does."""
    for step in steps(key) if key else ():
        if isinstance(step, int):
            listed = isinstance(data, list | tuple) and step < len(data)
            data = data[step] if listed else NOTHING  # type: ignore[index]
        elif isinstance(data, Mapping):
            data = data.get(step, NOTHING)
        else:
            fields = getattr(type(data), "model_fields", {})
            data = getattr(data, step) if step in fields else NOTHING
    return data


def put(data: Any, key: str, value: Any) -> Any:
    """Raw data or a part with another value under a dotted key, as a copy; tables are made.

    What the key leads through is a table, a part, a list with that place, or nothing.
    """
    return _put(data, steps(key), value)


def _put(data: Any, left: list[str | int], value: Any) -> Any:
    if not left:
        return value
    step, *rest = left
    if isinstance(step, int):
        return [*data[:step], _put(data[step], rest, value), *data[step + 1 :]]
    if isinstance(data, Mapping) or data in (None, NOTHING):
        table = {} if data in (None, NOTHING) else data
        return {**table, step: _put(table.get(step), rest, value)}
    return data.model_copy(update={step: _put(getattr(data, step), rest, value)})


def heads_of_foams(data: Any) -> Iterator[str]:
    """Yield what stands before `foam` of a scene's foams: "", "across.", layers by number.

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
