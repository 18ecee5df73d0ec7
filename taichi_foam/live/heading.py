"""What a drop is called that differs from the scene that was given."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from taichi_foam import catalogue

if TYPE_CHECKING:
    from taichi_foam.scene import Scene

#: Longest name of a scene that is called after its changes.
MOST_LETTERS = 100


def heading(scene: Scene, given: Scene, changes: Mapping[str, str]) -> tuple[str, list[str]]:
    """A drop's title, and what else is new, both in words.

    changes  by dotted key, in words, how `scene` differs from `given`

    One of the paper's tests that was changed into another impact does not keep the test's name: it
    is called after its impactor.
    """
    known = catalogue.reference_by_name(given)
    if known is None or scene.impactor is None:
        return given.name, list(changes.values())
    if known.fits(scene) and "impactor.velocity" not in changes:
        return known.title or given.name, list(changes.values())
    told = ("impactor.shape", "impactor.velocity")
    title = f"{scene.impactor.label}, {scene.impactor.velocity:.6g} m/s"
    if not changes:
        title = catalogue.title(scene)  # changed already when it was given
    return title, [words for key, words in changes.items() if key not in told]


def renamed(scene: Scene, given: Scene, changes: Mapping[str, str]) -> Scene:
    """`scene` named by its heading, as folders and films are; `given`'s name if nothing is new."""
    if not changes:
        return scene.model_copy(update={"name": given.name})
    title, rest = heading(scene, given, changes)
    name = f"{title} with {', '.join(rest)}" if rest else title
    short = name if len(name) <= MOST_LETTERS else f"{name[: MOST_LETTERS - 1]}…"
    return scene.model_copy(update={"name": short})
