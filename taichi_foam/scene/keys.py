"""The keys of a scene: the one walk over its fields, for messages and for the reference."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, Literal, get_args, get_origin

from pydantic.fields import FieldInfo

from taichi_foam.laws.bond import FOAMS
from taichi_foam.laws.shape import SHAPES
from taichi_foam.parts import Part, Registry, hints_of
from taichi_foam.units import plain

CHOSEN: Mapping[str, Registry[Any]] = {"foam": FOAMS, "impactor": SHAPES}
"""Parts of a scene that are one of several classes, by their key."""

REQUIRED = "must be given"
"""Text in place of a default for a key that has none."""


@dataclass(frozen=True)
class Key:
    """A key of a scene, described in words.

    key      dotted key, as in TOML
    unit     SI, degrees or pixels; "-" for a plain number; empty if it is not a number
    default  as written in a scene
    allowed  range or choices
    meaning  description
    only     shapes or laws that have this key with this meaning; empty: all
    others   whether others have the key with another meaning
    """

    key: str
    unit: str
    default: str
    allowed: str
    meaning: str
    only: tuple[str, ...] = ()
    others: bool = False

    @property
    def part(self) -> str:
        """The part that has the key; "scene" for a key outside parts."""
        return self.key.rpartition(".")[0] or "scene"

    @property
    def about(self) -> str:
        """The meaning, and the shapes or laws that have the key, if not all do."""
        if not self.only:
            return self.meaning
        which = f"{CHOSEN[self.part].tag} {' or '.join(self.only)}"
        return f"{self.meaning} ({f'with {which}' if self.others else f'{which} only'})"


@lru_cache
def parts(scene: type[Part]) -> dict[str, type[Part]]:
    """Classes of a scene's parts by their key, except those that are chosen by tag.

    A field that states its allowed values is treated as a single key, whatever its class.
    """
    return {
        name: kind
        for name, field in scene.model_fields.items()
        for kind in (field.annotation, *get_args(field.annotation))
        if name not in CHOSEN
        and "allowed" not in hints_of(field)
        and get_origin(kind) is None
        and isinstance(kind, type)
        and issubclass(kind, Part)
    }


@lru_cache
def listed(scene: type[Part]) -> dict[str, type[Part]]:
    """Classes of which a scene's parts have lists, by the key of the list with "[]"."""
    found = {}
    for head, part in parts(scene).items():
        for name, field in part.model_fields.items():
            if kind := listed_in(field):
                found[f"{head}.{name}[]"] = kind
    return found


def listed_in(field: FieldInfo) -> type[Part] | None:
    """The class of the parts in a field's list; None: it is not a list of parts."""
    kind = field.annotation  # a list, or a list or none
    lists = (one for one in (kind, *get_args(kind)) if get_origin(one) is tuple)
    first = next((get_args(one)[0] for one in lists), None)
    return first if isinstance(first, type) and issubclass(first, Part) else None


def all_parts(scene: type[Part]) -> Iterator[tuple[str, type[Part]]]:
    """Yield every class of parts that a scene can have, with its key."""
    yield from listed(scene).items()
    yield from parts(scene).items()
    for name, registry in CHOSEN.items():
        yield from ((name, kind) for kind in registry.values())


def keys(scene: type[Part]) -> Iterator[Key]:
    """Yield every key of a scene, part by part.

    A key that has different meanings for different shapes or laws comes once for each meaning.
    """
    for name, field in scene.model_fields.items():
        if name in CHOSEN:
            yield from _chosen(name, CHOSEN[name])
        elif name in parts(scene):
            fields = parts(scene)[name].model_fields
            yield from (_key(f"{name}.{last}", field) for last, field in fields.items())
            for head, kind in listed(scene).items():
                if head.startswith(f"{name}."):
                    yield from (_key(f"{head}.{k}", f) for k, f in kind.model_fields.items())
        else:
            yield _key(name, field)


def written(value: Any) -> str:
    """A value as in TOML, but text without quotes; None is "none"."""
    if value is None:
        return "none"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, float):
        return plain(value)
    if isinstance(value, tuple):
        return f"[{', '.join(map(written, value))}]"
    return str(value)


def _chosen(part: str, registry: Registry[Any]) -> Iterator[Key]:
    """Yield the key that selects the class of a part, then the keys of the classes."""
    default, tags = registry.default or REQUIRED, ", ".join(registry)
    yield Key(f"{part}.{registry.tag}", "", default, tags, registry.meaning)
    having: dict[Key, list[str]] = {}
    for tag, kind in registry.items():
        for name, field in kind.model_fields.items():
            if name != registry.tag:
                having.setdefault(_key(f"{part}.{name}", field), []).append(tag)
    readings = [key.key for key in having]
    for key, only in having.items():
        others = readings.count(key.key) > 1
        all_have = len(only) == len(registry)
        yield key if all_have else replace(key, only=tuple(only), others=others)


def _key(key: str, field: FieldInfo) -> Key:
    hints = hints_of(field)
    return Key(
        key,
        unit=(hints["unit"] or "-") if "unit" in hints else "",
        default=hints.get("unless")
        or (REQUIRED if field.is_required() else written(field.default)),
        allowed=_allowed(field.annotation, hints.get("allowed", "")),
        meaning=field.description or "",
    )


def _allowed(kind: Any, stated: str) -> str:
    if kind is bool:
        return "true, false"
    if get_origin(kind) is Literal:
        return ", ".join(map(str, get_args(kind)))
    # Other ranges already say what kind of number is allowed.
    return (
        f"whole number, {stated}" if kind is int and stated.startswith(("above", "at")) else stated
    )
