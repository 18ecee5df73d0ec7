"""Scenes as TOML, in and out."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import tomli_w

from taichi_foam.errors import UserError
from taichi_foam.scene import Scene, library
from taichi_foam.scene.messages import titled
from taichi_foam.scene.toml import parsed, read_toml
from taichi_foam.scene.values import following


def scene_to_toml(scene: Scene) -> str:
    """A scene as TOML with every default filled in; `scene_from_toml` gives an equal scene back.

    Values that follow from a key given in their place are left out: the velocity of a fall, the end
    time of a crosshead's travel, the numbers of cells that follow from their size.
    """
    data = scene.model_dump(exclude_none=True)
    for key in following(scene):
        part, _, name = key.partition(".")
        del data[part][name]
    return tomli_w.dumps(data)


def scene_from_toml(path: Path) -> Scene:
    """The scene of a TOML file. Raises UserError: unreadable, or an invalid scene."""
    return Scene.checked(read_scene(path), str(path))


def read_scene(path: Path) -> dict[str, Any]:
    """The raw data of a scene's TOML file, with the files that it names read in, not yet checked.

    Names are relative to the file. Raises UserError: the file or a named one is unreadable.
    """
    return completed_scene(read_toml(path), path.parent, str(path))


def completed_scene(data: Mapping[str, Any], folder: Path, source: str) -> dict[str, Any]:
    """Raw data of a scene with the files that it names read in; relative names are in `folder`.

    Raises UserError, titled with the source.
    """
    try:
        return library.completed(data, folder)
    except ValueError as error:
        raise UserError(titled(source, str(error))) from None


def scene_from_text(text: str, source: str) -> Scene:
    """The scene of TOML text from `source`. Raises UserError: not TOML, or an invalid scene."""
    return Scene.checked(parsed(text, source), source)
