"""`taichi-foam sweep`: many drops in one folder, their progress, table and figures."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.table import Table
from typer.core import TyperGroup

from taichi_foam.cli.options import Arch, Choices, OverwriteFiles, Set, Threads
from taichi_foam.cli.outcome import Terminal, check_name, command
from taichi_foam.errors import UserError

if TYPE_CHECKING:
    from taichi_foam.sweeps.dealing import Estimate
    from taichi_foam.sweeps.store import Standing, Sweep

_DIR = "Folder of a sweep."


class _RunUnlessNamed(TyperGroup):
    """`sweep PLAN` is `sweep run PLAN`: a first word that is not a command is the plan."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        if args and args[0] not in self.commands and args[0] != "--help":
            args = ["run", *args]
        return super().parse_args(ctx, args)


app = typer.Typer(
    cls=_RunUnlessNamed,
    no_args_is_help=True,
    rich_markup_mode=None,
    help="Many drops that differ in a few values: `sweep PLAN.toml`, `sweep SCENE --vary ...`.",
)


@app.command("run")
def run_command(
    source: Annotated[
        str,
        typer.Argument(metavar="PLAN|SCENE", help="A plan; or, with --vary or --repeat, a scene."),
    ],
    vary: Annotated[
        list[str] | None,
        typer.Option(
            metavar="KEY=A:B:N|KEY=a,b,c",
            help="An axis: N values from A to B (A:B:N:log for equal ratios), or those listed; "
            "repeatable.",
        ),
    ] = None,
    repeat: Annotated[
        int,
        typer.Option(
            metavar="N",
            help="Compute each drop N times, with slightly different velocities or other seeds.",
        ),
    ] = 1,
    within: Annotated[
        float, typer.Option(help="Largest relative difference of the velocities of repeats.")
    ] = 0.005,
    seeds: Annotated[
        bool, typer.Option("--seeds", help="Repeats differ in foam.strength_seed, not in velocity.")
    ] = False,
    histories: Annotated[
        bool, typer.Option("--histories", help="Keep the histories, too, as float32.")
    ] = False,
    out: Annotated[str | None, typer.Option(help="Folder; default: sweeps/NAME.")] = None,
    set_: Set = None,
    choices: Choices = None,
    workers: Annotated[
        int | None,
        typer.Option(metavar="N", help="Compute in N processes; default: in this one."),
    ] = None,
    scheduler: Annotated[
        str | None,
        typer.Option(metavar="ADDRESS", help="Compute on a Dask cluster that shares the folder."),
    ] = None,
    arch: Arch = "cpu",
    threads: Annotated[
        int | None,
        typer.Option(
            help="CPU threads; default: all cores, or 1 per process with --workers or a cluster."
        ),
    ] = None,
    dry_run: Annotated[
        bool,
        typer.Option(
            "--dry-run", help="Only estimate the number of drops, the time and the disk space."
        ),
    ] = False,
) -> None:
    """Compute the drops of a plan; the same command continues a sweep that was stopped."""
    with command() as terminal:
        from taichi_foam.results.files import file_name
        from taichi_foam.sweeps import run
        from taichi_foam.sweeps.plan import Plan, axis_of

        if vary or repeat != 1:
            data = {
                "scene": source,
                "axes": [axis_of(text) for text in vary or ()],
                "repeats": {
                    "count": repeat, "within": within, "vary": "seed" if seeds else "velocity",
                },
            }  # fmt: skip
            plan = Plan.of_scene(data, choices, set_ or [], histories)
        else:
            _check_plan_alone(set_, choices, histories, seeds)
            plan = Plan.load(source)
        folder = out or f"sweeps/{file_name(plan.name or 'sweep')}"
        run.prepare(plan, folder, workers, scheduler)
        if dry_run:
            terminal.warn(plan.notes, "note")
            found = run.tried(plan, arch, threads, terminal.bars)
            terminal.show(_estimate(found, workers, threads))
            return
        found = run.sweep(
            plan, folder, workers=workers, scheduler=scheduler, arch=arch, threads=threads,
            bars=terminal.bars,
        )  # fmt: skip
        _say(terminal, found, found.standing)
        _say_balance(terminal, found)


@app.command("status")
def status_command(
    folder: Annotated[str, typer.Argument(metavar="DIR", help=_DIR)],
) -> None:
    """Report the progress of a sweep, and what has failed."""
    with command() as terminal:
        found = _opened(folder)
        _say(terminal, found, found.standing, at_work=True)


@app.command("collect")
def collect_command(
    folder: Annotated[str, typer.Argument(metavar="DIR", help=_DIR)],
) -> None:
    """Write results.csv and results.parquet from all complete drops, during a sweep or after it."""
    with command() as terminal:
        found = _opened(folder)
        count = found.collect()
        if not count:
            raise UserError(f"{folder}: nothing is complete yet")
        terminal.show(f"{count:,} drops {_tables_in(found)}")


@app.command("show")
def show_command(
    folder: Annotated[str, typer.Argument(metavar="DIR", help=_DIR)],
    measure: Annotated[
        str,
        typer.Argument(metavar="MEASURE", help="A column, e.g. max_displacement_m."),
    ],
    x: Annotated[
        str | None,
        typer.Option("--x", metavar="KEY", help="Horizontal axis; default: the first."),
    ] = None,
    by: Annotated[
        str | None, typer.Option("--by", metavar="KEY", help="Second axis: a curve for each value.")
    ] = None,
    map_: Annotated[bool, typer.Option("--map", help="Draw a map over both axes instead.")] = False,
    out: Annotated[
        str | None,
        typer.Option(
            help="PNG, SVG or PDF; default: DIR/MEASURE.png, with --x, --by and --map in its name."
        ),
    ] = None,
    overwrite: OverwriteFiles = False,
) -> None:
    """Draw a measure over one or two axes: medians, and bands from 5 to 95 % of the repeats."""
    with command() as terminal:
        found = _opened(folder)
        from taichi_foam.picture import style
        from taichi_foam.sweeps import figure

        path = Path(out) if out else found.folder / _figure_name(measure, x, by, map_)
        check_name(path, overwrite, "file")
        style.save(figure.shown(found, measure, x=x, by=by, as_map=map_), path)
        terminal.line(f"{path}")


@app.command("again")
def again_command(
    folder: Annotated[str, typer.Argument(metavar="DIR", help=_DIR)],
    member: Annotated[int, typer.Argument(metavar="MEMBER", help="Its number in the table.")],
    out: Annotated[str | None, typer.Option(help="Folder; default: DIR-MEMBER.")] = None,
    threads: Threads = None,
) -> None:
    """Compute one drop of a sweep again and keep its complete result; the numbers are the same."""
    with command() as terminal:
        found = _opened(folder)
        from taichi_foam.cli import tables
        from taichi_foam.results.folders import check_output_folder
        from taichi_foam.results.result import storage_bytes

        scene = found.member(member).scene
        target = out or f"{Path(folder)}-{member}"
        check_output_folder(target, needed_bytes=storage_bytes(scene))
        with terminal.bars.computing(f"member {member}") as on_progress:
            result = found.again(member, on_progress, threads=threads)
        result.save(target)
        terminal.show(tables.key_figures(result.scene, result.summary))
        terminal.line(f"in {target}")


def _figure_name(measure: str, x: str | None, by: str | None, as_map: bool) -> str:
    """A distinct name for each kind of figure: max_displacement_m-map.png is not a curve."""
    parts = [measure]
    if as_map:
        parts.append("map")
    if x:
        parts.append(f"over-{x}")
    if by:
        parts.append(f"by-{by}")
    return f"{'-'.join(parts)}.png"


def _opened(folder: str) -> Sweep:
    from taichi_foam.sweeps.store import Sweep

    return Sweep.open(folder)


def _check_plan_alone(
    set_: list[str] | None, choices: str | None, histories: bool, seeds: bool
) -> None:
    """Raise UserError for options that a plan itself specifies."""
    given = {"--set": set_, "--choices": choices, "--histories": histories, "--seeds": seeds}
    for option, value in given.items():
        if value:
            raise UserError(
                f"{option}: only applies with --vary or --repeat. Fix: write it into the plan"
            )


def _estimate(found: Estimate, workers: int | None, threads: int | None) -> Table:
    from taichi_foam.results.folders import size_text
    from taichi_foam.sweeps.dealing import cores
    from taichi_foam.units import duration_text

    assert found.core_seconds is not None
    count = cores(workers, threads)
    shown = Table(box=None, show_header=False, pad_edge=False)
    shown.add_row("drops", f"{found.drops:,}")
    took = duration_text(found.core_seconds / count)
    shown.add_row(
        "time", f"about {took} on {count} core{'' if count == 1 else 's'} of this machine"
    )
    shown.add_row("disk", f"at most {size_text(found.bytes)}")
    return shown


def _say(terminal: Terminal, found: Sweep, standing: Standing, at_work: bool = False) -> None:
    """Print the progress of a sweep."""
    each = found.plan.impacts
    parts = [f"{each * standing.done:,} of {each * standing.members:,} drops"]
    if standing.failed:
        parts.append(f"{standing.failed:,} failed (see the column failure)")
    if standing.lost:
        parts.append(f"{standing.lost:,} lost, will be tried again (see {found.folder / 'lost'})")
    if at_work:
        parts.append("being computed" if standing.at_work else "not being computed")
    terminal.line("; ".join(parts))
    if not at_work:
        terminal.line(_tables_in(found))


def _tables_in(found: Sweep) -> str:
    from taichi_foam.sweeps import table

    return f"in {found.folder}: {table.CSV}, {table.PARQUET}"


def _say_balance(terminal: Terminal, found: Sweep) -> None:
    """Print peaks from the energy balance of level cushions, and the deviation of computed ones."""
    from taichi_foam.sweeps import table

    if not (found.folder / table.PARQUET).is_file():
        return
    keys = ("balance_peak_g", "peak_deceleration_g")
    rows = table.read([table.Shard(found.folder / table.PARQUET)], keys).to_pylist()
    peaks = [(row[keys[0]], row[keys[1]]) for row in rows if None not in map(row.get, keys)]
    if not peaks:
        return
    by_hand = [f"{end(peak for peak, _ in peaks):.1f}" for end in (min, max)]
    off = max(abs(computed / peak - 1.0) for peak, computed in peaks)
    terminal.line(
        f"peaks of {len(peaks):,} level cushions: by energy balance "
        f"{' to '.join(dict.fromkeys(by_hand))} g, computed raw peaks within {100 * off:.1f} % of "
        "that"
    )
