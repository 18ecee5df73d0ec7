"""Foams as tables for the terminal: the library, and what is known of one."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from rich.console import RenderableType
from rich.table import Table
from rich.text import Text

from taichi_foam.laws.bond import BondFoam, Curve
from taichi_foam.parts import unit_of
from taichi_foam.scene import Scene
from taichi_foam.scene.assumed import Assumed
from taichi_foam.scene.keys import written
from taichi_foam.scene.library import FoamFile, foam_of, packaged
from taichi_foam.scene.paths import NOTHING, at
from taichi_foam.units import plain, si_scale


def library() -> Table:
    """The foams that come with the package, by name."""
    table = Table(box=None, pad_edge=False, header_style="dim")
    table.add_column("name", no_wrap=True)
    table.add_column("kg/m3", justify="right", no_wrap=True)
    table.add_column("plateau", justify="right", no_wrap=True)
    table.add_column("what it is")
    for name in packaged():
        file = foam_of(name)
        plateau = f"{file.foam.landmarks.plateau_stress / 1e3:.3g} kPa"
        table.add_row(Text(name), plain(file.density), plateau, Text(file.title))
    return table


def known(file: FoamFile) -> Iterator[RenderableType]:
    """What a file says of a foam in words."""
    rate = "not stated" if file.rate is None else f"{plain(file.rate)} 1/s"
    facts = {
        "source": file.source,
        "licence": file.licence,
        "density": f"{plain(file.density)} kg/m3",
        "rate": rate,
        "direction": file.direction or "not stated",
        "measured": "\n".join(file.measured) or "not stated",
    }
    yield Text(file.title, style="bold")
    table = Table(box=None, show_header=False, pad_edge=False)
    table.add_column(style="dim", no_wrap=True)
    table.add_column()
    for key, value in facts.items():
        table.add_row(key, Text(value))
    yield table
    yield Text()


def constants(file: FoamFile) -> Iterator[RenderableType]:
    """The foam's constants with units, and whether they were given.

    Meanings are cut to their first words; `taichi-foam keys foam` has all of them.
    """
    foam = file.foam
    assumed = {each.key for each in file.assumed}
    table = Table(box=None, pad_edge=False, header_style="dim")
    table.add_column(f"law {foam.law}", no_wrap=True)
    table.add_column("", justify="right", no_wrap=True)
    table.add_column("unit", no_wrap=True)
    table.add_column("", no_wrap=True)
    table.add_column("meaning")
    for key, field in type(foam).model_fields.items():
        if key in ("law", "source"):
            continue
        value = getattr(foam, key)
        if isinstance(value, Curve):
            text = f"{len(value.strain):,} points"
            about = f"stress over strain of its compression test, to {value.tested:.3g} of strain"
        else:
            text, about = written(value), (field.description or "").partition(";")[0]
        if f"foam.{key}" in assumed:
            origin = "assumed"
        elif key in foam.model_fields_set and value is not None:
            origin = "given"
        else:
            origin = "default"
        table.add_row(key, text, unit_of(field), origin, Text(about))
    yield table
    yield Text()


def landmarks(foam: BondFoam) -> Iterator[RenderableType]:
    """Strains and stresses that measures and pictures refer to."""
    marks = foam.landmarks
    rows = {
        "plateau": pressure(marks.plateau_stress),
        "crush starts": percent(marks.crush_start),
        "densification": percent(marks.crush_end),
        "locking": percent(marks.limit),
        "breaks in tension": percent(marks.tensile),
        "breaks in tension, once crushed": percent(marks.crushed_tensile),
        "breaks in shear": percent(marks.shear),
    }
    table = Table(box=None, pad_edge=False, header_style="dim")
    table.add_column("landmarks", no_wrap=True)
    table.add_column("", justify="right", no_wrap=True)
    for row in rows.items():
        table.add_row(*row)
    yield table
    yield Text()


def assumed(whole: FoamFile | Scene, entries: Sequence[Assumed]) -> Iterator[RenderableType]:
    """What of a foam nobody has measured, each with what stands for it in `whole`."""
    if not entries:
        return
    table = Table(box=None, pad_edge=False, header_style="dim")
    table.add_column("assumed", no_wrap=True)
    table.add_column("", justify="right", no_wrap=True)
    table.add_column("unit", no_wrap=True)
    table.add_column("why")
    for each in entries:
        value, unit = _value(whole, each.key)
        table.add_row(Text(each.key), value, unit, Text(each.why))
    yield table
    yield Text()


def _value(whole: FoamFile | Scene, key: str) -> tuple[str, str]:
    """Value and unit of what is assumed; nothing of what a foam file has no key for."""
    value = at(whole, key)
    if value is NOTHING:
        return "", ""
    part, _, last = key.rpartition(".")
    return written(value), unit_of(type(at(whole, part)).model_fields[last])


def pressure(stress: float) -> str:
    scale, prefix = si_scale(stress, digits=3)
    return f"{stress / scale:.3g} {prefix}Pa"


def percent(strain: float) -> str:
    """A strain as landmarks have it, negative in compression."""
    return f"{100 * strain:.3g} %"
