"""`taichi-foam foam`: list foams, show one, import one from a test, list assumed values."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated

import typer

from taichi_foam.cli.options import OverwriteFiles
from taichi_foam.cli.outcome import command
from taichi_foam.errors import UserError
from taichi_foam.units import FORCE_UNITS, LENGTH_UNITS, STRAIN_UNITS, STRESS_UNITS


def foams_begun(word: str) -> list[str]:
    """Completions of a word from the library; the shell completes files."""
    from taichi_foam.scene.library import listed

    return [name for name in listed() if name.startswith(word)]


app = typer.Typer(
    no_args_is_help=True,
    rich_markup_mode=None,
    help="Foams: those of the library, those in files, and making one from a compression test.",
)


@app.command("list")
def list_command() -> None:
    """List the foams of the library."""
    with command() as terminal:
        from taichi_foam.cli import foam_files
        from taichi_foam.scene.families import FAMILIES

        terminal.show(foam_files.library(), "", *(family.words for family in FAMILIES))


@app.command("show")
def show_command(
    name: Annotated[
        str,
        typer.Argument(
            metavar="NAME|FILE.toml",
            help="Name in the library, or a foam file.",
            autocompletion=foams_begun,
        ),
    ],
) -> None:
    """Describe a foam: source, constants, landmarks, and what is assumed."""
    with command() as terminal:
        from taichi_foam.cli import foam_files
        from taichi_foam.scene.library import foam_of

        file = foam_of(name, asked="foam ")
        terminal.show(
            *foam_files.known(file),
            *foam_files.constants(file),
            *foam_files.landmarks(file.foam),
            *foam_files.origins(file, file.derived, "derived"),
            *foam_files.origins(file, file.assumed, "assumed"),
        )


@app.command("import")
def import_command(
    test: Annotated[str, typer.Argument(metavar="TEST.csv", help="Compression test: a CSV file.")],
    density: Annotated[
        str | None, typer.Option(metavar="KG_M3", help="Density of the foam; required.")
    ] = None,
    name: Annotated[
        str | None,
        typer.Option(metavar="TITLE", help="Description of the foam; default: the file's name."),
    ] = None,
    source: Annotated[
        str | None,
        typer.Option(metavar="TEXT", help="Who measured it, and where; default: the file."),
    ] = None,
    licence: Annotated[
        str | None, typer.Option(metavar="TEXT", help="Licence of the data; default: not stated.")
    ] = None,
    rate: Annotated[
        str | None, typer.Option(metavar="1/S", help="Strain rate of the test.")
    ] = None,
    direction: Annotated[
        str | None, typer.Option(metavar="TEXT", help="Direction of the test: rise, across, ...")
    ] = None,
    area: Annotated[
        str | None,
        typer.Option(
            metavar="M2", help="Area of the specimen, by which a column of force is divided."
        ),
    ] = None,
    height: Annotated[
        str | None,
        typer.Option(
            metavar="M",
            help="Height of the specimen, by which a column of displacement is divided.",
        ),
    ] = None,
    strain: Annotated[
        str | None,
        typer.Option(
            metavar="COLUMN",
            help="Column of strain, or of displacement: part of its name, or its number.",
        ),
    ] = None,
    stress: Annotated[
        str | None,
        typer.Option(
            metavar="COLUMN", help="Column of stress, or of force: part of its name, or its number."
        ),
    ] = None,
    strain_unit: Annotated[
        str | None,
        typer.Option(
            metavar="UNIT",
            help=f"{', '.join(STRAIN_UNITS)}; with --height {', '.join(LENGTH_UNITS)}; default: "
            "the header's, else SI.",
        ),
    ] = None,
    stress_unit: Annotated[
        str | None,
        typer.Option(
            metavar="UNIT",
            help=f"{', '.join(STRESS_UNITS)}; with --area {', '.join(FORCE_UNITS)}; default: the "
            "header's, else SI.",
        ),
    ] = None,
    points: Annotated[
        int | None,
        typer.Option(
            metavar="N",
            help="Average a test with more points over N equal intervals of strain; fewer points "
            "remove noise. Default: the largest allowed number.",
        ),
    ] = None,
    recovering: Annotated[
        bool,
        typer.Option(
            "--recovering",
            help="Foam that springs back: fit hysteresis and set to the test's unloading.",
        ),
    ] = False,
    out: Annotated[
        str | None,
        typer.Option(metavar="FILE.toml", help="Default: the test's name, in this folder."),
    ] = None,
    overwrite: OverwriteFiles = False,
) -> None:
    """Make a foam file from a compression test, with a picture of both beside it."""
    with command() as terminal:
        from taichi_foam.cli import foam_files
        from taichi_foam.laws.bond.fit import crushable_fit
        from taichi_foam.scene.measured import Columns, read_test

        path = foam_files.path_of(test)
        targets = foam_files.targets(path, out, overwrite)
        finest = foam_files.finest(points)
        columns = Columns(
            foam_files.column(strain), foam_files.column(stress), strain_unit, stress_unit,
            area=foam_files.number(area),  # type: ignore[arg-type]  # it reports errors
            height=foam_files.number(height),  # type: ignore[arg-type]
        )  # fmt: skip
        read = read_test(path, columns, finest)
        known = {
            "title": path.stem if name is None else name,
            "source": f"compression test in {path.name}" if source is None else source,
            "density": foam_files.number(density),
            "rate": foam_files.number(rate),
            "direction": direction,
            "licence": licence,
        }
        returned = foam_files.returned(path, read) if recovering else None
        file = foam_files.file_of(known, read, returned)
        fit = crushable_fit(read.curve)
        foam_files.write(file, read, fit, *targets)
        terminal.show(
            *foam_files.what_was_read(path, read),
            *([] if returned is None else [foam_files.in_words(returned, read.curve.tested)]),
            *foam_files.from_the_curve(file.foam, fit),
            *foam_files.origins(file, file.assumed, "assumed"),
        )
        terminal.warn(foam_files.doubts(file.foam, fit))
        terminal.line(f"in {targets[0].parent}: {targets[0].name}, {targets[1].name}")
        terminal.line(f'in a scene: foam = "{targets[0].name}", if the scene is in that folder')


@app.command("assumed")
def assumed_command(
    source: Annotated[
        str,
        typer.Argument(
            metavar="RUN_DIR|SCENE", help="Folder of a run, or a scene: built-in name or file."
        ),
    ],
) -> None:
    """List the values that a scene assumes of its foam, with the origin of each."""
    with command() as terminal:
        from taichi_foam.catalogue import load_scene
        from taichi_foam.cli import foam_files

        folder = Path(source)
        if os.path.isdir(folder) and not (folder / "scene.toml").is_file():
            raise UserError(
                f"{source}: not the folder of a run, as it has no scene.toml. Fix: give the folder "
                "of a run, or a scene"
            )
        scene = load_scene(folder / "scene.toml" if os.path.isdir(folder) else source)
        if not scene.assumed:
            terminal.show("no value of the foam is assumed")
        terminal.show(*foam_files.origins(scene, scene.assumed or (), "assumed"))
