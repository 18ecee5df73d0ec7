"""Foams with a name or in a file of their own: what was measured, what is assumed, and by whom.

A foam file is TOML: what is known of the foam, and its constants in a table `[foam]`, which has the
keys of a scene's. `taichi-foam foam import` writes one from a test. The library's own are in
`foams/`; rigid polyurethane of any density follows from a scaling.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Mapping
from importlib import resources
from pathlib import Path
from typing import Annotated, Any

import tomli_w
from pydantic import Field, ValidationError, field_validator

from taichi_foam.errors import UserError
from taichi_foam.laws.bond import FOAMS, BondFoam
from taichi_foam.laws.bond.crushable import Foam
from taichi_foam.parts import Part, quantity
from taichi_foam.scene.assumed import Assumed
from taichi_foam.scene.measured import curve_of
from taichi_foam.scene.messages import explain, shown
from taichi_foam.scene.toml import parsed, read_toml

CELL_WALLS = 127e6
"""Yield stress of solid polyurethane [Pa] (Gibson & Ashby 1997)."""

SOLID = 1200.0
"""Density of solid polyurethane [kg/m3] (Gibson & Ashby 1997)."""

SCALED = (20, 100)
"""Densities [kg/m3] for which the plateau of rigid polyurethane is scaled."""

_SCALED_NAME = re.compile(r"rigid-pu-(\d+(?:\.\d+)?)")

_RESILIENT = ("epe", "eva", "epp", "pe-foam", "sponge", "latex", "memory", "neoprene", "flexible")


def _words(default: Any, meaning: str, most: int) -> Any:
    """A field for words, from one letter up to so many."""
    return Field(
        default=default,
        description=meaning,
        min_length=1,
        max_length=most,
        json_schema_extra={"allowed": f"1 to {most:,} characters"},
    )


class FoamFile(Part):
    """A foam as its file tells of it."""

    title: str = _words(..., "what foam it is", 200)
    source: str = _words(..., "who measured it, where", 1000)
    licence: str = _words("not stated", "licence of the data", 200)
    density: float = quantity(..., "kg/m3", "density of the foam", at_least=1, at_most=5000)
    rate: Annotated[float, Field(gt=0, le=1e6)] | None = quantity(
        None, "1/s", "strain rate of the test", allowed="none, or above 0 and at most 1e6 1/s"
    )
    direction: str | None = _words(None, "direction of the test: rise, across, ...", 100)
    measured: tuple[str, ...] = Field(
        default=(), description="what was measured, in words", max_length=50
    )
    assumed: tuple[Assumed, ...] = Field(
        default=(), description="what is assumed, key by key of a scene", max_length=100
    )
    foam: Annotated[BondFoam, FOAMS] = Field(description="its constants")

    @field_validator("measured", "assumed", mode="before")
    @classmethod
    def _as_tuple(cls, value: Any) -> Any:
        return tuple(value) if isinstance(value, list) else value

    @property
    def foam_given(self) -> dict[str, Any]:
        """The constants that the file gives, as raw data."""
        given = self.foam.model_dump(exclude_unset=True, exclude_none=True)
        return {FOAMS.tag: self.foam.law, **given}

    def to_toml(self) -> str:
        """The file's text; `read_foam` gives an equal one back."""
        data = self.model_dump(exclude_none=True, exclude={"foam"}, exclude_defaults=True)
        return tomli_w.dumps({**data, "foam": self.foam_given})


def packaged() -> list[str]:
    """The names of the foams that the library has files of."""
    files = resources.files("taichi_foam.scene").joinpath("foams").iterdir()
    return sorted(file.name.removesuffix(".toml") for file in files if file.name.endswith(".toml"))


def names() -> list[str]:
    """The names of the library, those of a scaling with their densities."""
    return [*packaged(), f"rigid-pu-{SCALED[0]} to rigid-pu-{SCALED[1]}"]


def foam_of(name: str, folder: Path = Path(), asked: str = "foam = ") -> FoamFile:
    """The foam of a name, or of a file whose name ends with .toml; `asked` begins messages.

    Raises UserError: no such name or file, a foam file that cannot be, resilient foam.
    """
    if name.endswith(".toml"):
        return read_foam(folder / name)
    if scaled := _SCALED_NAME.fullmatch(name):
        return _rigid_pu(name, float(scaled[1]), asked)
    packaged = resources.files("taichi_foam.scene").joinpath("foams", f"{name}.toml")
    if re.fullmatch(r"[\w.-]+", name) and packaged.is_file():
        return _checked(parsed(packaged.read_text(encoding="utf-8"), name), name)
    if any(word in name.lower() for word in _RESILIENT):
        raise UserError(
            f"{asked}{shown(name)}: not in the library; resilient foam springs back by the gas in "
            "its cells, which the model leaves out (docs/limits.md)"
        )
    near = difflib.get_close_matches(name, names(), n=1, cutoff=0.6)
    meant = f"did you mean {near[0]}?" if near else f"known: {', '.join(names())}."
    raise UserError(
        f"{asked}{shown(name)}: not in the library; {meant} A foam file's name ends with .toml, "
        "and a test in a CSV file is the foam's curve; `taichi-foam foam list` lists the foams, "
        "`taichi-foam foam import` makes one of a test"
    )


def read_foam(path: Path) -> FoamFile:
    """The foam of a file; a curve's file that it names lies beside it.

    Raises UserError: unreadable, not TOML, or a foam that cannot be.
    """
    data = read_toml(path)
    foam = data.get("foam")
    if isinstance(foam, dict) and isinstance(foam.get("curve"), str | dict):
        try:
            curve = curve_of(foam["curve"], "foam.curve", path.parent)
        except ValueError as error:
            raise UserError(f"{path}: {error}") from None
        data = {**data, "foam": {**foam, "curve": curve}}
    return _checked(data, str(path))


def _checked(data: dict[str, Any], source: str) -> FoamFile:
    try:
        return FoamFile.model_validate(data)
    except ValidationError as error:
        listed = "\n".join(f"  {line}" for line in explain(error, FoamFile).splitlines())
        raise UserError(f"{source}: not a valid foam file:\n{listed}") from None


def _rigid_pu(name: str, density: float, asked: str) -> FoamFile:
    """Rigid polyurethane of a density [kg/m3]: the plateau scales, the rest is assumed."""
    if not SCALED[0] <= density <= SCALED[1]:
        raise UserError(
            f"{asked}{shown(name)}: the plateau is scaled for densities from {SCALED[0]} to "
            f"{SCALED[1]} kg/m3 only; take the test of a foam of that density (foam.curve)"
        )
    plateau = 0.3 * CELL_WALLS * (density / SOLID) ** 1.5
    paper = Foam()
    young = plateau / -paper.yield_strain
    shear = paper.shear_modulus / paper.youngs_modulus * young
    missed = (
        "that of the paper's foam, {}: the scaling misses it there ({}), and is not used for it"
    )
    why = {
        "youngs_modulus": "plateau over the paper's yield strain of 0.05: the scaling for open "
        "cells misses the paper's modulus (0.73 against 2.78 MPa), and is not used for it",
        "shear_modulus": "as much of Young's modulus as in the paper's foam, 0.30",
        "densification_strain": missed.format("-0.80", "-0.97"),
        **dict.fromkeys(
            ("yield_strain", "tensile_strain", "shear_strain", "locking_strain",
             "densification_a", "densification_b", "crushed_tensile_fraction"),
            "that of the paper's foam",
        ),
    }  # fmt: skip
    return FoamFile(
        title=f"Rigid polyurethane foam of {density:g} kg/m3, scaled",
        source="plateau 0.3 x 127 MPa x (density / 1200 kg/m3)^1.5 (Gibson & Ashby 1997): 0.119 "
        "MPa at 25.6 kg/m3, where 0.12 MPa was measured (Shim, Tu & Lim 2000)",
        licence="formula and figures as published",
        density=density,
        measured=(f"nothing at this density; plateau {plateau / 1e3:.1f} kPa by the scaling",),
        assumed=tuple(Assumed(key=f"foam.{key}", why=words) for key, words in why.items()),
        foam=Foam(
            youngs_modulus=young,
            shear_modulus=shear,
            **{key: getattr(paper, key) for key in why if not key.endswith("modulus")},
        ),
    )


def used(foam: FoamFile, more: Mapping[str, Any]) -> tuple[dict[str, Any], list[Assumed]]:
    """Raw data of a scene's foam table after a file, `more` going before, and what it assumes."""
    if "curve" in more and foam.foam.implied_by != "curve":
        return dict(more), []  # a curve says all that the file's law does
    table = {**foam.foam_given, **more}
    if isinstance(foam.foam, Foam) and "yield_strain" not in more:
        if "plateau_stress" in more:
            del table["yield_strain"]
        elif "youngs_modulus" in more:  # a stiffer foam has the same plateau
            del table["yield_strain"]
            table["plateau_stress"] = foam.foam.plateau_stress
    table.setdefault("source", f"{foam.title}: {foam.source}"[:1000])
    return table, [each for each in foam.assumed if each.key.partition(".")[2] not in more]
