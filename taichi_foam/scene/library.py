"""Foams and files that a scene names: the foam library, foam files, tests, drawings and pulses.

The library has foam files in `foams/`, and families of which any density in a range can be named.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Mapping
from importlib import resources
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from taichi_foam.errors import UserError
from taichi_foam.laws.bond import Curve
from taichi_foam.laws.bond.kinds.crushable import Foam
from taichi_foam.parts import Part
from taichi_foam.scene.assumed import Origin
from taichi_foam.scene.csv_file import Kind, two_columns
from taichi_foam.scene.families import FAMILIES
from taichi_foam.scene.foam_file import FoamFile, checked, read_foam
from taichi_foam.scene.measured import curve_of, read_curve
from taichi_foam.scene.messages import shown
from taichi_foam.scene.options import Pulse
from taichi_foam.scene.paths import NOTHING, at, copied, heads_of_foams, put
from taichi_foam.scene.toml import parsed
from taichi_foam.scene.traces import ACCELERATION, TIME
from taichi_foam.units import LENGTH_UNITS

_LENGTH = Kind("length", LENGTH_UNITS, "m")

_RESILIENT = ("epe", "eva", "epp", "pe-foam", "sponge", "latex", "memory", "neoprene", "flexible")


def packaged() -> list[str]:
    """The names of the foams for which the library has files."""
    files = resources.files("taichi_foam.scene").joinpath("foams").iterdir()
    return sorted(file.name.removesuffix(".toml") for file in files if file.name.endswith(".toml"))


def listed() -> list[str]:
    """The names of all foams of which the library has values: its files, and points of families."""
    return [*packaged(), *(name for family in FAMILIES for name in family.names())]


def names() -> list[str]:
    """The names in the library, families as ranges."""
    return [*packaged(), *(family.span() for family in FAMILIES)]


def foam_of(name: str, folder: Path = Path(), asked: str = "foam = ") -> FoamFile:
    """The foam with a name, or of a file whose name ends with .toml; `asked` begins messages.

    Raises UserError: no such name or file, or an invalid foam file.
    """
    if name.endswith(".toml"):
        return read_foam(folder / name)
    for family in FAMILIES:
        if (density := family.density(name)) is not None:
            low, high = family.range
            if low <= density <= high:
                return family.make(density)
            raise UserError(
                f"{asked}{shown(name)}: {family.limit} from {low:g} to {high:g} kg/m3 only; use a "
                "test of a foam of that density (foam.curve)"
            )
    packaged = resources.files("taichi_foam.scene").joinpath("foams", f"{name}.toml")
    if re.fullmatch(r"[\w.-]+", name) and packaged.is_file():
        return checked(parsed(packaged.read_text(encoding="utf-8"), name), name)
    if any(word in name.lower() for word in _RESILIENT):
        raise UserError(
            f"{asked}{shown(name)}: not in the library; give the test of a foam that springs back "
            "as foam.curve, with foam.law = 'recovering'"
        )
    near = [each.span() for each in FAMILIES if name.lower().startswith(each.head.rstrip("-"))]
    near = near or [each for each in names() if name and name.lower() in each]
    near = near or difflib.get_close_matches(name, names(), n=1, cutoff=0.6)
    meant = f"did you mean {near[0]}?" if near else f"known: {', '.join(names())}."
    raise UserError(
        f"{asked}{shown(name)}: not in the library; {meant} The name of a foam file ends with "
        ".toml, and a test in a CSV file is given as foam.curve; `taichi-foam foam list` lists "
        "the foams, `taichi-foam foam import` makes one from a test"
    )


def is_test(foam: Any) -> bool:
    """Whether a foam is given as the CSV file of a compression test."""
    return isinstance(foam, str | Path) and str(foam).lower().endswith(".csv")


def foam_or_curve(name: str | Path, asked: str = "foam = ") -> FoamFile | Curve:
    """What `foam_of` finds, or the curve of a compression test (.csv). Raises UserError as both."""
    return read_curve(Path(name)) if is_test(name) else foam_of(str(name), asked=asked)


def completed(data: Any, folder: Path = Path()) -> Any:
    """Raw data of a scene in which names and files of foam, impactor and pulse are replaced.

    Their contents replace them before a scene is checked, so that a scene is written in full.
    Relative paths are in `folder`. Raises ValueError, in whole sentences.
    """
    if not isinstance(data, Mapping):
        return data
    found = copied(data)
    impactor, base = found.get("impactor"), found.get("base")
    if isinstance(impactor, dict) and "file" in impactor:
        found["impactor"] = _drawn(impactor, folder)
    for head in heads_of_foams(data):
        _complete(found, head, folder)
    if isinstance(base, dict) and isinstance(base.get("acceleration"), str | Path | dict):
        base["acceleration"] = _pulse(base["acceleration"], folder)
    return found


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
    """Raw data of an impactor with the corners from its file."""
    rest = {key: value for key, value in impactor.items() if key != "file"}
    name = impactor["file"]
    if rest.get("shape", "outline") != "outline":
        raise ValueError(
            f"impactor.file = {shown(name)}: holds the corners of an outline, but impactor.shape = "
            f"{shown(rest['shape'])}; must be outline, or leave the file out"
        )
    if "vertices" in rest:
        raise ValueError("impactor.file: impactor.vertices are given too; leave one of them out")
    if not isinstance(name, str | Path):
        raise ValueError(f"impactor.file = {shown(name)}: must be the name of a file")
    try:
        return {"shape": "outline", **rest, "vertices": read_corners(folder / name)}
    except UserError as error:
        raise ValueError(f"impactor.file: {error}") from None


def _complete(data: dict[str, Any], head: str, folder: Path) -> None:
    """Replace names and files of one of a scene's foams in its raw data."""
    foam = at(data, f"{head}foam")
    if isinstance(foam, str | Path):
        foam = {"like": foam}
    if not isinstance(foam, dict):
        return
    # TOML has no value for what is left out, and `like` may have given one
    foam = {key: None if value == "none" else value for key, value in foam.items()}
    if isinstance(foam.get("like"), str | Path):
        foam = _like(data, head, foam, folder)
    if isinstance(foam.get("curve"), str | Path | dict):
        foam["curve"] = curve_of(foam["curve"], f"{head}foam.curve", folder)
    put(data, f"{head}foam", foam)


def _like(data: dict[str, Any], head: str, foam: dict[str, Any], folder: Path) -> dict[str, Any]:
    """A foam's table completed by its `like`; puts density and assumptions into `data`."""
    try:
        file = foam_of(str(foam.pop("like")), folder)
    except UserError as error:
        text = str(error)
        raise ValueError(f"{head}{text}" if text.startswith("foam = ") else text) from None
    table, assumed = _used(file, foam)
    assumed = [
        Origin(key=f"{head}{each.key}", why=each.why)
        for each in assumed
        if not head or each.key.startswith("foam.")
    ]
    dense = f"{head or 'block.'}density"
    place = at(data, dense.rpartition(".")[0])
    place = {} if place in (None, NOTHING) else place
    given = place.model_fields_set if isinstance(place, Part) else place
    # across its rise it is the same foam, with the same density
    if head != "across." and isinstance(given, dict | set) and "density" not in given:
        assumed.append(Origin(key=dense, why=f"that of the foam: {file.title}"))
        if isinstance(place, Part):
            data["block"] = place.with_computed(density=file.density)
        else:
            put(data, dense, file.density)
    known, earlier = {each.key for each in assumed}, data.get("assumed") or []
    if isinstance(earlier, list):  # otherwise a later check reports the error
        earlier = [each for each in earlier if getattr(each, "key", None) not in known]
        data["assumed"] = [*earlier, *assumed]
    return table


def _used(foam: FoamFile, more: Mapping[str, Any]) -> tuple[dict[str, Any], list[Origin]]:
    """Raw data of a scene's foam table from a file, overridden by `more`, and its assumptions."""
    if "curve" in more and foam.foam.implied_by != "curve":
        return dict(more), []  # a curve replaces the file's law
    table = {**foam.foam_given, **more}
    if isinstance(foam.foam, Foam) and "yield_strain" not in more:
        if more.get("plateau_stress") is not None:
            del table["yield_strain"]
        elif "youngs_modulus" in more:  # a stiffer foam has the same plateau
            del table["yield_strain"]
            table["plateau_stress"] = foam.foam.plateau_stress
    table.setdefault("source", f"{foam.title}: {foam.source}"[:1000])
    replaced = {*more, *(foam.foam_given.keys() - table.keys())}
    return table, [each for each in foam.assumed if each.key.partition(".")[2] not in replaced]


def read_corners(path: Path) -> list[tuple[float, float]]:
    """The corners (x, y) [m] of an outline in a CSV file, in its order.

    The first two columns are x and y; a header may give their unit in brackets, by default metres.
    A last corner that repeats the first is left out, and so are lines that begin with `#`. Raises
    UserError with file, line and value: unreadable, not a number, an unknown unit.
    """
    x, y = two_columns(path, "x and y", (_LENGTH, _LENGTH))
    if x.unit != y.unit:
        raise UserError(
            f"{path}: the header must give x and y the same unit, such as x [mm],y [mm]"
        )
    found = list(zip(x.values.tolist(), y.values.tolist(), strict=True))
    return found[:-1] if len(found) > 1 and found[0] == found[-1] else found


def read_pulse(path: Path) -> Pulse:
    """The pulse of a CSV file: its first two columns are time and acceleration.

    A header may give their units in brackets, such as time [ms],acceleration [g], or in a line of
    their own; by default they are s and m/s2. Raises UserError with file, line and value.
    """
    columns = two_columns(path, "time and acceleration", (TIME, ACCELERATION))
    time, acceleration = (column.values.tolist() for column in columns)
    try:
        return Pulse(time=time, acceleration=acceleration)
    except ValidationError as error:
        first = error.errors()[0]
        told = first.get("ctx", {}).get("error")
        if told is None:
            key, place = str(first["loc"][0]), first["loc"][-1]
            told = (
                f"{key} = {first['input']:g} in row {place + 1 if isinstance(place, int) else 1}: "
                f"must be {'0 to 10 s' if key == 'time' else '-1e6 to 1e6 m/s2'}; "
                "give units in the header, such as time [ms],acceleration [g]"
            )
        raise UserError(f"{path}: {told}") from None
