"""Foam files: a foam's constants, and where each of them comes from.

A foam file is TOML: a description of the foam, and its constants in a table `[foam]` with the same
keys as a scene's. `taichi-foam foam import` writes one from a test.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import tomli_w
from pydantic import Field, ValidationError

from taichi_foam.errors import UserError
from taichi_foam.laws.bond import FOAMS, BondFoam
from taichi_foam.parts import Part, quantity, text
from taichi_foam.scene.assumed import Origin
from taichi_foam.scene.measured import curve_of
from taichi_foam.scene.messages import explain, titled
from taichi_foam.scene.toml import read_toml


class FoamFile(Part):
    """The contents of a foam file.

    A constant in its table [foam] is as its source states it, unless it is listed as derived or
    assumed.
    """

    title: str = text(..., "description of the foam", 200)
    source: str = text(..., "who measured it, and where", 1000)
    licence: str = text("not stated", "licence of the data", 200)
    density: float = quantity(..., "kg/m3", "density of the foam", at_least=1, at_most=5000)
    rate: float | None = quantity(None, "1/s", "strain rate of the test", above=0, at_most=1e6)
    direction: str | None = text(None, "direction of the test: rise, across, ...", 100)
    measured: tuple[str, ...] = Field(
        default=(), strict=False, description="what was measured, in words", max_length=50
    )
    known_to: float | None = quantity(
        None,
        "-",
        "strain in compression up to which its curve is from the source, if it is assumed beyond",
        above=0,
        below=1,
    )
    derived: tuple[Origin, ...] = Field(
        default=(),
        strict=False,
        description="values that follow from these, by key of a scene",
        max_length=100,
    )
    assumed: tuple[Origin, ...] = Field(
        default=(), strict=False, description="assumed values, by key of a scene", max_length=100
    )
    foam: Annotated[BondFoam, FOAMS] = Field(description="its constants")

    @property
    def foam_given(self) -> dict[str, Any]:
        """The constants that the file gives, as raw data."""
        given = self.foam.model_dump(exclude_unset=True, exclude_none=True)
        return {FOAMS.tag: self.foam.law, **given}

    def to_toml(self) -> str:
        """The file's text; `read_foam` gives an equal one back."""
        data = self.model_dump(exclude_none=True, exclude={"foam"}, exclude_defaults=True)
        return tomli_w.dumps({**data, "foam": self.foam_given})


def read_foam(path: Path) -> FoamFile:
    """The foam of a file; the path of a curve's file is relative to it.

    Raises UserError: unreadable, not TOML, or an invalid foam.
    """
    data = read_toml(path)
    foam = data.get("foam")
    if isinstance(foam, dict) and isinstance(foam.get("curve"), str | dict):
        try:
            curve = curve_of(foam["curve"], "foam.curve", path.parent)
        except ValueError as error:
            raise UserError(f"{path}: {error}") from None
        data = {**data, "foam": {**foam, "curve": curve}}
    return checked(data, str(path))


def checked(data: dict[str, Any], source: str) -> FoamFile:
    """The foam of raw data from a `source`, which begins messages. Raises UserError: invalid."""
    try:
        return FoamFile.model_validate(data)
    except ValidationError as error:
        raise UserError(titled(source, explain(error, FoamFile), "foam file")) from None
