"""`taichi-foam cushion`: peak deceleration over static stress, for families of pads."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.markup import escape
from rich.table import Table

from taichi_foam.cli.foam import foams_begun
from taichi_foam.cli.options import Arch, Overwrite, Threads
from taichi_foam.cli.outcome import command
from taichi_foam.errors import UserError
from taichi_foam.units import LENGTH_UNITS, STRESS_UNITS

if TYPE_CHECKING:
    from taichi_foam.cushions.cushion import CushionCurve
    from taichi_foam.cushions.shown import Units

_KINDS = {"length": LENGTH_UNITS, "height": LENGTH_UNITS, "stress": STRESS_UNITS}
_SUCH = {"length": "25,50", "height": "0.46,0.76", "stress": "2,5,10 or 2:10"}
_NUMBER = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:e[-+]?\d+)?)\s*(.*?)\s*", re.IGNORECASE)


def cushion_command(
    foam: Annotated[
        str,
        typer.Option(
            metavar="NAME|FILE",
            help="Foam of the library, foam file (.toml) or compression test (.csv).",
            autocompletion=foams_begun,
        ),
    ],
    thickness: Annotated[
        str, typer.Option(metavar="T,...", help="Thicknesses of the pad [mm; us: in].")
    ],
    drop: Annotated[str, typer.Option(metavar="H,...", help="Heights of the fall [m; us: in].")],
    static_stress: Annotated[
        str | None,
        typer.Option(
            metavar="S,...|FROM:TO",
            help="Static stresses [kPa; us: psi], or a range to choose them from; default: around "
            "the optimum of the energy balance.",
        ),
    ] = None,
    drops: Annotated[
        int, typer.Option(metavar="N", help="Drops on the same pad, a curve for each; 1 to 5.")
    ] = 1,
    shape: Annotated[
        str,
        typer.Option(metavar="flat|edge|rib|FILE.csv,...", help="Shapes of the pad."),
    ] = "flat",
    runs: Annotated[
        int,
        typer.Option(
            metavar="N",
            help="Runs of each point with velocities within 0.5 %: medians and 5-95 % bands.",
        ),
    ] = 1,
    filter_: Annotated[
        str,
        typer.Option("--filter", metavar="raw|CFC", help="Filter of the peaks: 60, 180, 600, 1000"),
    ] = "raw",
    points: Annotated[
        int | None,
        typer.Option(metavar="N", help="Most static stresses of a curve; default 16."),
    ] = None,
    width: Annotated[
        str | None,
        typer.Option(metavar="W", help="Width under the product, in the plane [mm]; default 200."),
    ] = None,
    density: Annotated[
        float | None,
        typer.Option(metavar="D", help="Density of the foam [kg/m3]; default: as the foam says."),
    ] = None,
    units: Annotated[
        str, typer.Option(metavar="si|us", help="Units of the options and of the answer.")
    ] = "si",
    out: Annotated[str | None, typer.Option(help="Folder; default cushions/FOAM.")] = None,
    arch: Arch = "cpu",
    threads: Threads = None,
    overwrite: Overwrite = False,
) -> None:
    """Compute cushion curves: peak g over static stress, with bands, beside the energy balance.

    Numbers may carry their unit: 50mm, 2in, 76cm, 4kPa, 0.6psi.
    """
    with command() as terminal:
        from taichi_foam.cushions import cushion
        from taichi_foam.cushions.shown import units as units_of
        from taichi_foam.results.files import file_name

        used = units_of(units)
        more: dict[str, Any] = {}
        if static_stress is not None and ":" in static_stress:
            more["static_range"] = _numbers("--static-stress", static_stress, "stress", used, ":")
        elif static_stress is not None:
            more["static_stress"] = _numbers("--static-stress", static_stress, "stress", used)
        if width is not None:
            (more["width"],) = _numbers("--width", width, "length", used, between=None)
        if points is not None:
            more["points"] = points
        folder = out or f"cushions/{file_name(cushion.name_of(foam))}"
        found = cushion.cushion_curve(
            foam,
            _numbers("--thickness", thickness, "length", used),
            _numbers("--drop", drop, "height", used),
            drops=drops,
            shape=[each.strip() for each in shape.split(",")],
            runs=runs,
            channel_class=_channel_class(filter_),
            density=density,
            out=folder,
            overwrite=overwrite,
            units=units,
            arch=arch,
            threads=threads,
            bars=terminal.bars,
            **more,
        )
        _show(terminal, found, used)
        terminal.where(folder)


def _show(terminal: Any, found: CushionCurve, used: Units) -> None:
    """The minima, and what is doubtful."""
    from taichi_foam.cushions.cushion_chart import minima

    made = minima(found, used)
    table = Table(box=None, pad_edge=False)
    for place, head in enumerate(made.head):
        table.add_column(head.replace(" (", "\n("), justify="right" if place else "left")
    for row in made.rows:
        table.add_row(*map(escape, row))
    terminal.show(table, made.note)
    failures = sorted({drop.failure for drop in found.drops if drop.failure})
    terminal.warn(failures)


def _numbers(
    option: str, text: str, kind: str, used: Units, between: str | None = ","
) -> list[float]:
    """The numbers of an option in SI units: bare ones are in the unit of the kind."""
    known = _KINDS[kind]
    found = []
    for word in [text] if between is None else text.split(between):
        match = _NUMBER.fullmatch(word)
        unit = match[2].lower() if match else ""
        if match is None or (unit and unit not in known):
            raise UserError(
                f"{option} {text}: {word.strip()!r} is no number with or without a unit. Fix: "
                f"numbers in {used.unit(kind)}, such as {_SUCH[kind]}, or with a unit "
                f"({', '.join(known)})"
            )
        value = float(match[1])
        if value <= 0.0:
            raise UserError(
                f"{option} {text}: {word.strip()} must be above 0. Fix: numbers in "
                f"{used.unit(kind)}, or with a unit ({', '.join(known)})"
            )
        found.append(float(f"{value * known[unit]:.12g}") if unit else used.si(kind, value))
    return found


def _channel_class(text: str) -> int | None:
    """The class of a filter: 180, CFC180, CFC 180; None for raw."""
    word = text.strip().lower().removeprefix("cfc").strip()
    if word == "raw":
        return None
    if not word.isdecimal():
        raise UserError(
            f"--filter {text}: must be raw, or a channel class of SAE J211: 60, 180, 600 or 1000"
        )
    return int(word)
