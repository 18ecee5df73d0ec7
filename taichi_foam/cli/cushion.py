"""`taichi-foam cushion`: peak deceleration over static stress, for families of pads."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

import typer

from taichi_foam.cli.foam import foams_begun
from taichi_foam.cli.numbers import number, numbers
from taichi_foam.cli.options import Arch, Overwrite, Tests, Threads, Units
from taichi_foam.cli.outcome import command
from taichi_foam.errors import UserError

if TYPE_CHECKING:
    from taichi_foam.cushions import shown
    from taichi_foam.cushions.cushion import CushionCurve


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
    tests: Tests = None,
    units: Units = "si",
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
        from taichi_foam.cushions.scenes import called
        from taichi_foam.cushions.shown import units_named
        from taichi_foam.results.files import file_name

        used = units_named(units)
        more: dict[str, Any] = {}
        if static_stress is not None and ":" in static_stress:
            more["static_range"] = numbers("--static-stress", static_stress, "stress", used, ":")
        elif static_stress is not None:
            more["static_stress"] = numbers("--static-stress", static_stress, "stress", used)
        if width is not None:
            more["width"] = number("--width", width, "length", used)
        if points is not None:
            more["points"] = points
        folder = out or f"cushions/{file_name(called(foam))}"
        found = cushion.cushion_curve(
            foam,
            numbers("--thickness", thickness, "length", used),
            numbers("--drop", drop, "height", used),
            drops=drops,
            shape=[each.strip() for each in shape.split(",")],
            runs=runs,
            channel_class=_channel_class(filter_),
            density=density,
            tests=tests,
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


def _show(terminal: Any, found: CushionCurve, used: shown.Units) -> None:
    """The minima, and what is doubtful."""
    from taichi_foam.cli import tables
    from taichi_foam.cushions.cushion_chart import minima

    made = minima(found, used)
    terminal.show(tables.reported(made), made.note)
    failures = sorted({drop.failure for drop in found.drops if drop.failure})
    terminal.warn(failures)


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
