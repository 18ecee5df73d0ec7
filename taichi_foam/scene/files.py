"""Scenes as TOML, in and out."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import tomli_w

from taichi_foam.errors import UserError
from taichi_foam.scene import Scene

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib


def scene_to_toml(scene: Scene) -> str:
    """A scene as TOML with every value resolved; `scene_from_toml` gives an equal scene back."""
    return tomli_w.dumps(scene.model_dump(exclude_none=True))


def scene_from_toml(path: Path) -> Scene:
    """The scene of a TOML file. Raises UserError: unreadable, or a scene that cannot be."""
    return Scene.checked(read_toml(path), str(path))


def scene_from_text(text: str, source: str) -> Scene:
    """The scene of TOML text from `source`. Raises UserError: not TOML, or no scene."""
    try:
        return Scene.checked(tomllib.loads(text), source)
    except tomllib.TOMLDecodeError as error:
        raise UserError(f"{source}: not valid TOML: {error}") from None


def read_toml(path: Path) -> dict[str, Any]:
    """Return the data of a TOML file, not yet validated."""
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except tomllib.TOMLDecodeError as error:
        raise UserError(f"{path}: not valid TOML: {error}") from None
    except UnicodeDecodeError as error:
        raise UserError(f"{path}: not UTF-8 text (byte {error.start}); save it as UTF-8") from None
    except OSError as error:
        raise UserError(f"{path}: cannot be read: {error.strerror}") from None
