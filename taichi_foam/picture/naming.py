"""What runs are called where several are shown: what tells them apart stands first."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from taichi_foam.laws.bond import BondFoam
from taichi_foam.parts import unit_of
from taichi_foam.scene import CHOICE_SETS, Impactor, Scene
from taichi_foam.scene.values import by_key
from taichi_foam.units import si_scale

#: A name holds so many keys at most, of values that are no longer than so many letters.
MOST_KEYS, LONGEST = 2, 40
#: Last parts of keys that say too little alone: width of what? kind of what?
_VAGUE = frozenset({"width", "height", "kind", "x", "rate", "friction"})
#: Keys that stand for others: all that only this shape of impactor or this law of the foam has.
_KINDS = {"impactor.shape": Impactor, "foam.law": BondFoam}
#: What runs of different titles need no words for: the draw of chance, and the end, which shows.
_BY_THE_WAY = frozenset({"foam.strength_seed", "numerics.end"})
#: Units that take a prefix.
_SCALED = frozenset({"Pa", "s", "m", "J", "N", "W"})


@dataclass(frozen=True)
class Caption:
    """What a scene is called for people.

    title  in one line
    says   dotted keys of the scene whose values the title tells
    """

    title: str
    says: frozenset[str] = frozenset()


def names(
    scenes: Sequence[Scene], folders: Sequence[str], captions: Sequence[Caption] | None = None
) -> list[tuple[str, str]]:
    """For each scene a name that tells it apart, and what may follow where there is room.

    Scenes of one title are called by what differs, or by `folders`, and their title follows.
    A title that is the only one of its kind is a name; what else differs follows.

    Args:
        captions: what the scenes are called; default their names.
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
            # a name that somebody chose speaks for itself; other titles say a few keys only
            rest = "" if title == scenes[k].name else folders[k]
            found.append((title, beyond[k] if beyond else rest))
            continue
        words = beyond and tuple(beyond[place] for place in alike)
        if not words or len(set(words)) < len(words):
            words = told_apart([scenes[place] for place in alike])
        found.append((words[alike.index(k)] if words else folders[k], title))
    return found


def told_apart(scenes: Sequence[Scene]) -> tuple[str, ...] | None:
    """What tells scenes of one title apart, in a few words each; None if it takes too many.

    Names of `CHOICE_SETS`, and up to two keys with their values; `output` does not count.
    """
    words = _differences(scenes)
    return words if words and len(set(words)) == len(words) else None


def _differences(
    scenes: Sequence[Scene], said: frozenset[str] = frozenset()
) -> tuple[str, ...] | None:
    """All that differs but keys `said` otherwise, in words for each; None for more than a few."""
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
    # what nobody gave follows from what somebody did
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
    """A key with its value, the key without its table where it is clear without."""
    if key == "impactor.shape" and value is not None:
        return str(value)
    last = key.rpartition(".")[2]
    return f"{key if last in _VAGUE else last} = {_shown(value, _unit(scene, key))}"


def _shown(value: Any, unit: str) -> str:
    """A value with its unit; very large and very small figures have the unit's prefix."""
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


def _unit(scene: Scene, key: str) -> str:
    """The unit of a scene's key; empty without one."""
    owner: Any = scene
    *heads, last = key.split(".")
    for head in heads:
        owner = getattr(owner, head, None)
    field = getattr(type(owner), "model_fields", {}).get(last)
    return unit_of(field) if field else ""
