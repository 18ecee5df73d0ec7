"""Where foam and impactor come from: a name of the library, a foam file, a test, a drawing.

What a name or a file stands for takes its place before a scene is checked, so that a scene that
is written holds all of it.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from taichi_foam.errors import UserError
from taichi_foam.parts import Part
from taichi_foam.scene.assumed import Assumed
from taichi_foam.scene.drawings import read_corners
from taichi_foam.scene.library import foam_of, used
from taichi_foam.scene.measured import Columns, read_curve
from taichi_foam.scene.messages import shown

_COLUMN_KEYS = ("strain", "stress", "strain_unit", "stress_unit")


def completed(data: Any, folder: Path = Path()) -> Any:
    """Raw data of a scene with what its names and files of foam and impactor stand for.

    `folder` is where relative paths begin. Raises ValueError, in whole sentences.
    """
    if not isinstance(data, Mapping):
        return data
    impactor = data.get("impactor")
    if isinstance(impactor, Mapping) and "file" in impactor:
        data = {**data, "impactor": _drawn(impactor, folder)}
    if "foam" not in data:
        return data
    foam = data["foam"]
    if isinstance(foam, str | Path):
        foam = {"like": foam}
    if isinstance(foam, Mapping) and isinstance(foam.get("like"), str | Path):
        data = _with_foam(data, foam, folder)
        foam = data["foam"]
    if isinstance(foam, Mapping) and isinstance(foam.get("curve"), str | Path | Mapping):
        curve = _curve(foam["curve"], folder)
        if curve is not foam["curve"]:
            return {**data, "foam": {**foam, "curve": curve}}
    return data


def _drawn(impactor: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """Raw data of an impactor with the corners that its file holds."""
    rest = {key: value for key, value in impactor.items() if key != "file"}
    name = impactor["file"]
    if rest.get("shape", "outline") != "outline":
        raise ValueError(
            f"impactor.file = {shown(name)}: holds the corners of an outline; impactor.shape = "
            f"{shown(rest['shape'])}: must be outline; or leave the file out"
        )
    if "vertices" in rest:
        raise ValueError("impactor.file: impactor.vertices are given too; leave one of them out")
    if not isinstance(name, str | Path):
        raise ValueError(f"impactor.file = {shown(name)}: must be the name of a file")
    try:
        return {"shape": "outline", **rest, "vertices": read_corners(folder / name)}
    except UserError as error:
        raise ValueError(f"impactor.file: {error}") from None


def _with_foam(data: Mapping[str, Any], foam: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """Raw data of a scene with the foam that `foam.like` names, and its density."""
    try:
        file = foam_of(str(foam["like"]), folder)
    except UserError as error:
        raise ValueError(str(error)) from None
    table, assumed = used(file, {key: value for key, value in foam.items() if key != "like"})
    block = data.get("block")
    if block is None or isinstance(block, Mapping):
        if "density" not in (block or {}):
            assumed.append(Assumed(key="block.density", why=f"that of the foam: {file.title}"))
        block = {"density": file.density, **(block or {})}
    elif isinstance(block, Part) and "density" not in block.model_fields_set:
        assumed.append(Assumed(key="block.density", why=f"that of the foam: {file.title}"))
        block = block.model_copy(update={"density": file.density})
    earlier = data.get("assumed") or ()
    if not isinstance(earlier, list | tuple):
        return {**data, "foam": table}  # what is wrong with it is said where it is checked
    known = {each.key for each in assumed}
    assumed = [*(each for each in earlier if getattr(each, "key", None) not in known), *assumed]
    return {**data, "foam": table, "block": block, "assumed": tuple(assumed)}


def _curve(curve: Any, folder: Path) -> Any:
    """A curve, read from its file if it names one."""
    if isinstance(curve, str | Path):
        curve = {"file": curve}
    if "file" not in curve:
        return curve
    unknown = sorted(curve.keys() - {"file", *_COLUMN_KEYS})
    if unknown:
        raise ValueError(
            f"foam.curve.{unknown[0]}: unknown key; beside a file there are "
            f"{', '.join(_COLUMN_KEYS)}"
        )
    if not isinstance(curve["file"], str | Path):
        raise ValueError(f"foam.curve.file = {shown(curve['file'])}: must be the name of a file")
    options = {key: curve[key] for key in _COLUMN_KEYS if key in curve}
    for key, value in options.items():
        if not isinstance(value, str) and not (type(value) is int and "unit" not in key):
            raise ValueError(f"foam.curve.{key} = {shown(value)}: must be text")
    try:
        return read_curve(folder / curve["file"], Columns(**options))
    except UserError as error:
        raise ValueError(f"foam.curve: {error}") from None
