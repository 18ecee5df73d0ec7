"""`taichi-foam calibrate`: parameters of a scene from a measured trace, with their uncertainty."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer
from rich.table import Table

from taichi_foam.cli.options import Arch, Choices, Overwrite, SceneName, Set, Threads
from taichi_foam.cli.outcome import command
from taichi_foam.errors import UserError

if TYPE_CHECKING:
    from taichi_foam.calibration.outcome import Calibration

_NONE = "none"


def calibrate_command(
    trace: Annotated[
        str,
        typer.Argument(
            metavar="TRACE.csv",
            help="Time, and acceleration or force, with units in the header; none: only --figure.",
        ),
    ],
    scene: SceneName,
    fit: Annotated[
        list[str] | None,
        typer.Option(
            metavar="KEY=LOW..HIGH",
            help="A parameter and its range; KEY=LOW..HIGH:log for a logarithmic one; repeatable.",
        ),
    ] = None,
    figure: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME=VALUE[+-DEVIATION]",
            help="A measured key figure, by its name in summary.json; repeatable.",
        ),
    ] = None,
    runs: Annotated[int, typer.Option(metavar="N", help="Runs of each wave.")] = 64,
    waves: Annotated[int, typer.Option(metavar="N", help="Number of waves.")] = 2,
    cfc: Annotated[
        int,
        typer.Option("--cfc", "--filter", help="Channel class of the filter: 60, 180, 600, 1000."),
    ] = 180,
    column: Annotated[
        str | None,
        typer.Option(metavar="HEADER", help="Column of the trace, if the file has several."),
    ] = None,
    offset: Annotated[
        float | None,
        typer.Option(help="Reading before the impact [m/s2]; default: found in the trace."),
    ] = None,
    noise: Annotated[
        float | None,
        typer.Option(help="Noise of the trace, as a part of its peak; default: found in it."),
    ] = None,
    discrepancy: Annotated[
        float | None,
        typer.Option(help="What the model may lack, as a part of the figures; default: estimated."),
    ] = None,
    seed: Annotated[int, typer.Option(help="Seed of all random numbers.")] = 0,
    out: Annotated[str | None, typer.Option(help="Folder; default calibrations/NAME.")] = None,
    set_: Set = None,
    choices: Choices = None,
    arch: Arch = "cpu",
    threads: Threads = None,
    overwrite: Overwrite = False,
) -> None:
    """Determine parameters of a scene from a measured trace: intervals, not a single best fit.

    The same command goes on where it was interrupted.
    """
    with command() as terminal:
        from taichi_foam.calibration.calibrate import calibrate
        from taichi_foam.catalogue import load_scene
        from taichi_foam.results.files import file_name

        base = load_scene(scene, choices, set_ or [])
        folder = out or f"calibrations/{file_name(base.name)}"
        found = calibrate(
            None if trace == _NONE else trace,
            base,
            fit or [],
            folder,
            figures=dict(map(_figure, figure or ())),
            runs=runs,
            waves=waves,
            channel_class=cfc,
            column=column,
            offset=offset,
            noise=noise,
            discrepancy=discrepancy,
            seed=seed,
            overwrite=overwrite,
            arch=arch,
            threads=threads,
            bars=terminal.bars,
        )
        terminal.show(_table(found))
        terminal.where(folder)
        terminal.warn(found.notes, "note")


def _figure(text: str) -> tuple[str, float | tuple[float, float]]:
    """A key figure in text. Raises UserError."""
    name, equals, words = (part.strip() for part in text.partition("="))
    value, _, deviation = words.partition("+-")
    try:
        if not (name and equals):
            raise ValueError
        return name, (float(value), float(deviation)) if deviation else float(value)
    except ValueError:
        raise UserError(
            f"figure {text!r}: must read NAME=VALUE or NAME=VALUE+-DEVIATION, e.g. "
            "max_displacement_m=0.075+-0.002"
        ) from None


def _table(found: Calibration) -> Table:
    shown = Table(box=None, pad_edge=False)
    for head in ("parameter", "unit", "5 %", "median", "95 %", "width/prior", ""):
        shown.add_column(head)
    for each in found.parameters:
        ends = (f"{value:.4g}" for value in (each.low, each.median, each.high))
        shown.add_row(each.key, each.unit, *ends, f"{each.width:.2f}", each.verdict)
    return shown
