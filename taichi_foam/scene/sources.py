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
from taichi_foam.scene.measured import curve_of
from taichi_foam.scene.messages import shown
from taichi_foam.scene.paths import NOTHING, at, heads_of_foams, put
from taichi_foam.scene.pulse_file import read_pulse


def completed(data: Any, folder: Path = Path()) -> Any:
    """Raw data of a scene with what its names and files of foam and impactor stand for.

    `folder` is where relative paths begin. Raises ValueError, in whole sentences.
    """
    if not isinstance(data, Mapping):
        return data
    impactor = data.get("impactor")
    if isinstance(impactor, Mapping) and "file" in impactor:
        data = {**data, "impactor": _drawn(impactor, folder)}
    for head in heads_of_foams(data):
        data = _completed(data, head, folder)
    base = data.get("base")
    if isinstance(base, Mapping) and isinstance(base.get("acceleration"), str | Path | Mapping):
        data = {**data, "base": {**base, "acceleration": _pulse(base["acceleration"], folder)}}
    return data


def _pulse(pulse: Any, folder: Path) -> Any:
    """A pulse, read from its file if it names one."""
    if isinstance(pulse, str | Path):
        pulse = {"file": pulse}
    if "file" not in pulse:
        return pulse
    if set(pulse) != {"file"} or not isinstance(pulse["file"], str | Path):
        raise ValueError(
            "base.acceleration: must be the name of a CSV file, or a table of time and acceleration"
        )
    try:
        return read_pulse(folder / pulse["file"])
    except UserError as error:
        raise ValueError(f"base.acceleration: {error}") from None


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


def _completed(data: Mapping[str, Any], head: str, folder: Path) -> Mapping[str, Any]:
    """Raw data of a scene with what names and files of one of its foams stand for."""
    foam = at(data, f"{head}foam")
    if isinstance(foam, str | Path):
        foam = {"like": foam}
    if isinstance(foam, Mapping) and isinstance(foam.get("like"), str | Path):
        data = _with_foam(data, head, foam, folder)
        foam = at(data, f"{head}foam")
    if isinstance(foam, Mapping) and isinstance(foam.get("curve"), str | Path | Mapping):
        curve = curve_of(foam["curve"], f"{head}foam.curve", folder)
        if curve is not foam["curve"]:
            return put(data, f"{head}foam", {**foam, "curve": curve})
    return data


def _with_foam(
    data: Mapping[str, Any], head: str, foam: Mapping[str, Any], folder: Path
) -> Mapping[str, Any]:
    """Raw data of a scene with the foam that a foam's `like` names, and its density."""
    try:
        file = foam_of(str(foam["like"]), folder)
    except UserError as error:
        text = str(error)
        raise ValueError(f"{head}{text}" if text.startswith("foam = ") else text) from None
    table, assumed = used(file, {key: value for key, value in foam.items() if key != "like"})
    assumed = [Assumed(key=f"{head}{each.key}", why=each.why) for each in assumed if not head
               or each.key.startswith("foam.")]  # fmt: skip
    data = put(data, f"{head}foam", table)
    if head == "across.":  # it is the same foam, and so as dense
        return _assuming(data, assumed)
    dense = f"{head or 'block.'}density"
    why = Assumed(key=dense, why=f"that of the foam: {file.title}")
    place = at(data, dense.rpartition(".")[0])
    if place in (None, NOTHING) or isinstance(place, Mapping):
        if place in (None, NOTHING) or "density" not in place:
            assumed.append(why)
            data = put(data, dense, file.density)
    elif isinstance(place, Part) and "density" not in place.model_fields_set:
        assumed.append(why)
        data = put(data, dense, file.density)
    return _assuming(data, assumed)


def _assuming(data: Mapping[str, Any], assumed: list[Assumed]) -> Mapping[str, Any]:
    """Raw data of a scene that assumes some more."""
    earlier = data.get("assumed") or ()
    if not isinstance(earlier, list | tuple):
        return data  # what is wrong with it is said where it is checked
    known = {each.key for each in assumed}
    assumed = [*(each for each in earlier if getattr(each, "key", None) not in known), *assumed]
    return {**data, "assumed": tuple(assumed)}
