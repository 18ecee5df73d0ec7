"""`taichi-foam efficiency`: how much energy foams absorb, and at what stress."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from taichi_foam.cli.foam import foams_begun
from taichi_foam.cli.options import OverwriteFiles
from taichi_foam.cli.outcome import command
from taichi_foam.cli.replay import Job, deliver

if TYPE_CHECKING:
    from collections.abc import Callable

    from taichi_foam.cushions.efficiency import Efficiency


def efficiency_command(
    foams: Annotated[
        list[str],
        typer.Argument(
            metavar="FOAM...",
            help="Names in the library, foam files (.toml), compression tests (.csv).",
            autocompletion=foams_begun,
        ),
    ],
    units: Annotated[str, typer.Option(metavar="si|us", help="Units that are shown.")] = "si",
    out: Annotated[
        str | None,
        typer.Option(
            help="Folder for efficiency.csv, landmarks.csv, report.html and the figure as PNG, SVG "
            "and PDF; default: nothing is written."
        ),
    ] = None,
    overwrite: OverwriteFiles = False,
) -> None:
    """Show where foams absorb energy best: efficiency, ideality, onset of densification."""
    with command() as terminal:
        from taichi_foam.cli import tables
        from taichi_foam.cushions.efficiency import efficiency
        from taichi_foam.cushions.efficiency_chart import EXPLAINED, choice, landmarks
        from taichi_foam.cushions.shown import units_named
        from taichi_foam.picture.document import Table

        system = units_named(units)
        found = efficiency(*foams)
        if out is not None:
            deliver(_jobs(found, units), out, overwrite, terminal)
        terminal.show(tables.reported(Table(*landmarks(found.foams, system))), EXPLAINED)
        if len(foams) > 1:
            terminal.show("", tables.reported(Table(*choice(found, system))))
        terminal.warn(found.caveats, "note")


def _jobs(found: Efficiency, units: str) -> list[Job]:
    """What is written: data, the figure, and the report."""

    def data(folder: Path, on_piece: Callable[[], None]) -> None:
        from taichi_foam.results.files import whole_file, write_csv, write_rows

        with whole_file(folder / _DATA[0]) as partial:
            write_csv(partial, found.curves)
        with whole_file(folder / _DATA[1]) as partial:
            write_rows(partial, found.table)
        on_piece()

    def figure(folder: Path, on_piece: Callable[[], None]) -> None:
        from taichi_foam.picture import style

        drawn = found.plot(units)
        style.save_all(drawn, folder / "efficiency")
        on_piece()

    def report(folder: Path, on_piece: Callable[[], None]) -> None:
        found.report(folder / _REPORT, units)
        on_piece()

    return [Job(_DATA, 1, data), Job(_FIGURES, 1, figure), Job((_REPORT,), 1, report)]


_DATA = ("efficiency.csv", "landmarks.csv")
_FIGURES = ("efficiency.png", "efficiency.svg", "efficiency.pdf")
_REPORT = "report.html"
