"""`taichi-foam design`: a pad for a product's mass, drop height and fragility."""

from __future__ import annotations

from typing import Annotated

import typer

from taichi_foam.cli.numbers import number, numbers
from taichi_foam.cli.options import Arch, Overwrite, Tests, Threads, Units
from taichi_foam.cli.outcome import command


def design_command(
    mass: Annotated[str, typer.Option(metavar="M", help="Mass of the product [kg; us: lb].")],
    fragility: Annotated[
        float, typer.Option(metavar="G", help="Largest deceleration that it survives [g].")
    ],
    drop: Annotated[
        str | None,
        typer.Option(
            metavar="H", help="Drop height [m; us: in]; default: that of ISTA 1A for the mass."
        ),
    ] = None,
    dv_critical: Annotated[
        str | None,
        typer.Option(
            metavar="V",
            help="Critical velocity change [m/s; us: in/s]: below it no deceleration damages.",
        ),
    ] = None,
    foam: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME|FILE",
            help="Foam of the library, foam file or compression test (CSV); repeatable; default: "
            "all of the library.",
        ),
    ] = None,
    max_thickness: Annotated[
        str | None, typer.Option(metavar="T", help="Largest thickness with room [mm; us: in].")
    ] = None,
    max_area: Annotated[
        str | None, typer.Option(metavar="A", help="Largest area of the pad [cm2; us: in2].")
    ] = None,
    stock: Annotated[
        str | None,
        typer.Option(
            metavar="T,...", help="Thicknesses to choose from [mm; us: in]; default: usual ones."
        ),
    ] = None,
    shape: Annotated[
        str, typer.Option(metavar="flat|edge|rib|FILE.csv", help="Shape of the pad.")
    ] = "flat",
    drops: Annotated[
        int, typer.Option(metavar="N", help="Falls on one cushion that it must survive.")
    ] = 1,
    runs: Annotated[
        int, typer.Option(metavar="N", help="Runs that must all hold; 0: the formulas alone.")
    ] = 16,
    braced: Annotated[
        bool, typer.Option("--braced", help="The pad is held at its sides: it does not buckle.")
    ] = False,
    temperature: Annotated[
        float | None, typer.Option(metavar="C", help="Most extreme temperature of transport [C].")
    ] = None,
    tests: Tests = None,
    units: Units = "si",
    out: Annotated[
        str | None, typer.Option(help="Folder for the report; default designs/MASS-FRAGILITY.")
    ] = None,
    arch: Arch = "cpu",
    threads: Threads = None,
    overwrite: Overwrite = False,
) -> None:
    """Find a foam, a thickness and an area that protect a product, and verify them by runs.

    Numbers may carry their unit: 500g, 12lb, 76cm, 2in, 400cm2.
    """
    with command() as terminal:
        from taichi_foam.cli import tables
        from taichi_foam.cushions import design_report
        from taichi_foam.cushions.checks import checks
        from taichi_foam.cushions.design import design
        from taichi_foam.cushions.shown import units_named

        used = units_named(units)

        def si(option: str, text: str | None, kind: str) -> float | None:
            return None if text is None else number(option, text, kind, used)

        weighed = number("--mass", mass, "mass", used)
        name = f"{used.number('mass', weighed)}{used.unit('mass')}-{fragility:g}g"
        folder = out or f"designs/{name}"
        found = design(
            weighed,
            fragility,
            si("--drop", drop, "height"),
            foams=foam or (),
            dv_critical=si("--dv-critical", dv_critical, "velocity"),
            max_thickness=si("--max-thickness", max_thickness, "length"),
            max_area=si("--max-area", max_area, "area"),
            stock=None if stock is None else numbers("--stock", stock, "length", used),
            shape=shape,
            drops=drops,
            runs=runs,
            braced=braced,
            temperature=temperature,
            tests=tests,
            units=units,
            out=folder,
            overwrite=overwrite,
            arch=arch,
            threads=threads,
            bars=terminal.bars,
        )
        for text in design_report.lead(found):
            terminal.show(text)
        if found.pads:
            terminal.show("", tables.reported(design_report.candidates_table(found), "Candidates"))
        if found.pad is not None:
            made = design_report.checks_table(checks(found.pad, used))
            terminal.show("", tables.reported(made, "Checks"), "")
        terminal.where(folder)
