"""Names of runs that are shown together: the differences come first."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from taichi_foam.laws.bond import BondFoam
from taichi_foam.scene import CHOICE_SETS, Impactor, Scene
from taichi_foam.scene.paths import by_key, unit_at
from taichi_foam.units import si_scale

#: Most keys in a name, and most characters of a key with its value.
MOST_KEYS, LONGEST = 2, 40
#: Last parts of keys that are ambiguous alone: width of what? kind of what?
_VAGUE = frozenset({"width", "height", "kind", "x", "rate", "friction"})
#: Keys that imply others: all keys that only this impactor shape or foam law has.
_KINDS = {"impactor.shape": Impactor, "foam.law": BondFoam}
#: Differences not named if titles differ: the random seed, and the end, which can be seen.
_BY_THE_WAY = frozenset({"foam.strength_seed", "numerics.end"})
#: Units that take an SI prefix.
_SCALED = frozenset({"Pa", "s", "m", "J", "N", "W"})


@dataclass(frozen=True)
class Caption:
    """The display name of a scene.

    title  the name, in one line
    says   dotted keys of the scene whose values are in the title
    """

    title: str
    says: frozenset[str] = frozenset()


def names(
    scenes: Sequence[Scene], folders: Sequence[str], captions: Sequence[Caption] | None = None
) -> list[tuple[str, str]]:
    """For each scene a distinct name, and text that may follow it if there is room.

    Scenes with equal titles are named by their differences, or by `folders`, and the title follows.
    A unique title is used as the name, and the other differences follow.

    Args:
        captions: titles of the scenes; default their names.
    """
    if not scenes:
        return []
    captions = captions or [Caption(scene.name) for scene in scenes]
    titles = [caption.title for caption in captions]
    if len(set(titles)) == 1:
        words = told_apart(scenes) or tuple(folders)
        return [(word, titles[0]) for word in words]
    said = frozenset.intersection(*(caption.says for caption in captions))
    beyond = _differences(scenes, _BY_THE_WAY | said)
    found = []
    for k, title in enumerate(titles):
        alike = [place for place, other in enumerate(titles) if other == title]
        if len(alike) == 1:
            # a user's own name needs no addition; other titles give only a few keys
            rest = "" if title == scenes[k].name else folders[k]
            found.append((title, beyond[k] if beyond else rest))
            continue
        words = beyond and tuple(beyond[place] for place in alike)
        if not words or len(set(words)) < len(words):
            words = told_apart([scenes[place] for place in alike])
        found.append((words[alike.index(k)] if words else folders[k], title))
    return found


def told_apart(scenes: Sequence[Scene]) -> tuple[str, ...] | None:
    """The differences of scenes with equal titles, in a few words each; None if there are too many.

    Names of `CHOICE_SETS`, and up to two keys with their values; `output` is ignored.
    """
    words = _differences(scenes)
    return words if words and len(set(words)) == len(words) else None


def _differences(
    scenes: Sequence[Scene], said: frozenset[str] = frozenset()
) -> tuple[str, ...] | None:
    """All differences except the keys in `said`, in words for each scene; None if too many."""
    aside = {"name", "output", "assumed", "reference"}
    flat = [by_key(scene.model_dump(exclude=aside)) for scene in scenes]
    every = dict.fromkeys(key for one in flat for key in one)
    keys = [key for key in every if any(one.get(key) != flat[0].get(key) for one in flat)]
    for kind, base in _KINDS.items():
        if kind in keys:
            part = kind.partition(".")[0]
            common = {f"{part}.{field}" for field in base.model_fields}
            keys = [key for key in keys if key in common or not key.startswith(f"{part}.")]
    if not any(one.get("foam.strength_scatter") for one in flat):
        said |= {"foam.strength_seed"}
    # computed values follow from given ones
    follow = frozenset.intersection(*(scene.block.computed for scene in scenes))
    said |= {f"block.{field}" for field in follow}
    keys = [key for key in keys if key not in {*said, "foam.source"}]
    parts: list[list[str]] = [[] for _ in scenes]
    sets = [_choice_set(one) for one in flat]
    if None not in sets and len(set(sets)) > 1:
        parts = [[str(name)] for name in sets]
        keys = [key for key in keys if not any(key in choices for choices in CHOICE_SETS.values())]
    if len(keys) > MOST_KEYS:
        return None
    for part, one, scene in zip(parts, flat, scenes, strict=True):
        part += [_phrase(scene, key, one.get(key)) for key in keys]
    if any(len(phrase) > LONGEST for part in parts for phrase in part):
        return None
    return tuple(", ".join(part) for part in parts)


def _choice_set(flat: dict[str, Any]) -> str | None:
    for name, choices in CHOICE_SETS.items():
        if all(flat.get(key, value) == value for key, value in choices.items()):
            return name
    return None


def _phrase(scene: Scene, key: str, value: Any) -> str:
    """A key with its value; the key's table is left out if the key is clear without it."""
    if key == "impactor.shape" and value is not None:
        return str(value)
    last = key.rpartition(".")[2]
    return f"{key if last in _VAGUE else last} = {_shown(value, unit_at(scene, key))}"


def _shown(value: Any, unit: str) -> str:
    """A value with its unit; very large and very small numbers get an SI prefix."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if value is None or isinstance(value, str):
        return value or "none"
    if isinstance(value, float):
        factor, prefix = 1.0, ""
        if unit in _SCALED and value and not 0.01 <= abs(value) < 1e4:
            factor, prefix = si_scale(value)
        text = f"{value / factor:.6g}"
        return f"{text} {prefix}{unit}" if unit else text
    return f"{value} {unit}" if unit else str(value)
