"""`taichi-foam foam`: the foams that there are, what is known of one, and a foam out of a test."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from pydantic import ValidationError
from rich.console import Console, RenderableType
from rich.table import Table
from rich.text import Text

from taichi_foam.catalogue import load_scene
from taichi_foam.cli.outcome import exit_codes
from taichi_foam.errors import UserError
from taichi_foam.laws.bond import BondFoam, Curve
from taichi_foam.laws.bond.tabulated import TabulatedFoam
from taichi_foam.parts import unit_of
from taichi_foam.results.files import partial_name, whole_file
from taichi_foam.scene import Scene
from taichi_foam.scene.assumed import Assumed
from taichi_foam.scene.csv_file import LENGTH_UNITS
from taichi_foam.scene.keys import written
from taichi_foam.scene.library import SCALED, FoamFile, foam_of, packaged
from taichi_foam.scene.measured import (
    FINEST,
    FORCE_UNITS,
    STRAIN_UNITS,
    STRESS_UNITS,
    Columns,
    CompressionTest,
    read_test,
)
from taichi_foam.scene.measured import Column as FileColumn
from taichi_foam.scene.messages import explain, shown
from taichi_foam.scene.paths import NOTHING, at
from taichi_foam.units import plain, si_scale

if TYPE_CHECKING:
    from taichi_foam.laws.bond.fit import CrushableFit

_HEADER = """\
# A constant that you know better goes into the table [foam]; then take its [[assumed]] table out.
# A scene that says foam = "{name}" has this foam and its density.

"""

_OPTIONS = {"title": "name"}
"""Keys of a foam file whose option is called otherwise."""

_FEWEST = 20
"""Parts of its strain, at least, that a test is thinned to."""

_BRANCHES = 5
"""So many branches are named at most."""

_NOISY = 1.3
"""So many times the modulus of the fit, that of the curve is one of its noise."""

app = typer.Typer(
    no_args_is_help=True,
    rich_markup_mode=None,
    help="Foams: the library's, those in files, and how to make one of a compression test.",
)


@app.command("list")
def list_command() -> None:
    """List the foams of the library."""
    console, errors = Console(highlight=False), Console(stderr=True, highlight=False)
    with exit_codes(errors):
        table = Table(box=None, pad_edge=False, header_style="dim")
        table.add_column("name", no_wrap=True)
        table.add_column("kg/m3", justify="right", no_wrap=True)
        table.add_column("plateau", justify="right", no_wrap=True)
        table.add_column("what it is")
        for name in packaged():
            file = foam_of(name)
            plateau = f"{file.foam.landmarks.plateau_stress / 1e3:.3g} kPa"
            table.add_row(Text(name), plain(file.density), plateau, Text(file.title))
        console.print(table)
        console.print()
        console.print(
            f"rigid-pu-NN: rigid polyurethane of NN kg/m3, {SCALED[0]} to {SCALED[1]}, by a scaling"
        )


@app.command("show")
def show_command(
    name: Annotated[
        str,
        typer.Argument(
            metavar="NAME|FILE.toml",
            help="Name in the library, or a foam file.",
            autocompletion=lambda incomplete: [n for n in packaged() if n.startswith(incomplete)],
        ),
    ],
) -> None:
    """Say all that is known of a foam: source, constants, landmarks, and what is assumed."""
    console, errors = Console(highlight=False), Console(stderr=True, highlight=False)
    with exit_codes(errors):
        file = foam_of(name, asked="foam ")
        for part in (
            *_known(file),
            *_constants(file),
            *_landmarks(file.foam),
            *_assumed(file, file.assumed),
        ):
            console.print(part)


@app.command("import")
def import_command(
    test: Annotated[
        str, typer.Argument(metavar="TEST.csv", help="Compression test: columns of a CSV file.")
    ],
    density: Annotated[
        str | None, typer.Option(metavar="KG_M3", help="Density of the foam; must be given.")
    ] = None,
    name: Annotated[
        str | None, typer.Option(metavar="TITLE", help="What foam it is; default: the file's name.")
    ] = None,
    source: Annotated[
        str | None, typer.Option(metavar="TEXT", help="Who measured it, where; default: the file.")
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
            metavar="M2", help="Area of the specimen: stress is a column of force over it."
        ),
    ] = None,
    height: Annotated[
        str | None,
        typer.Option(
            metavar="M", help="Height of the specimen: strain is a column of displacement over it."
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
        int,
        typer.Option(
            metavar="N",
            help="A test of more points is read as means over N equal parts of its strain: fewer "
            "take noise out.",
        ),
    ] = FINEST,
    out: Annotated[
        str | None,
        typer.Option(metavar="FILE.toml", help="Default: the test's name, in this folder."),
    ] = None,
    overwrite: Annotated[
        bool, typer.Option("--overwrite", help="Replace files that are there already.")
    ] = False,
) -> None:
    """Make a foam file of a compression test, and a picture of both beside it."""
    console, errors = Console(highlight=False), Console(stderr=True, highlight=False)
    with exit_codes(errors):
        path = _path(test)
        targets = _targets(path, out, overwrite)
        if not _FEWEST <= points <= FINEST:
            raise UserError(f"--points = {points}: must be at least {_FEWEST}, at most {FINEST}")
        columns = Columns(
            _column(strain), _column(stress), strain_unit, stress_unit,
            area=_number(area), height=_number(height),  # type: ignore[arg-type]  # told by it
        )  # fmt: skip
        read = read_test(path, columns, points)
        known = {
            "title": path.stem if name is None else name,
            "source": f"compression test in {path.name}" if source is None else source,
            "density": _number(density),
            "rate": _number(rate),
            "direction": direction,
            "licence": licence,
        }
        file = _file(known, read)
        # drawing takes a second to load: after all that may be wrong
        from taichi_foam.laws.bond.fit import crushable_fit

        fit = crushable_fit(read.curve)
        _write(file, read, fit, *targets)
        for part in (
            *_what_was_read(path, read),
            *_derived(file.foam, fit),
            *_assumed(file, file.assumed),
        ):
            console.print(part)
        _say_noise(errors, file.foam, fit)
        _line(console, f"in {targets[0].parent}: {targets[0].name}, {targets[1].name}")
        _line(console, f'in a scene: foam = "{targets[0].name}", if the scene is in that folder')


@app.command("assumed")
def assumed_command(
    source: Annotated[
        str,
        typer.Argument(
            metavar="RUN_DIR|SCENE", help="Folder of a run, or a scene: built-in name or file."
        ),
    ],
) -> None:
    """List what a scene assumes of its foam: each value that nobody gave, and where it is from."""
    console, errors = Console(highlight=False), Console(stderr=True, highlight=False)
    with exit_codes(errors):
        folder = Path(source)
        if os.path.isdir(folder) and not (folder / "scene.toml").is_file():
            raise UserError(
                f"{source}: not the folder of a run, as it has no scene.toml. Fix: give a run's, "
                "or a scene"
            )
        scene = load_scene(folder / "scene.toml" if os.path.isdir(folder) else source)
        if not scene.assumed:
            console.print("nothing is assumed of the foam")
        for part in _assumed(scene, scene.assumed or ()):
            console.print(part)


def _targets(test: Path, out: str | None, overwrite: bool) -> tuple[Path, Path]:
    """The foam file and the picture that will be written.

    Raises UserError: names that are taken or cannot be, a folder that cannot be written to.
    """
    target = Path(f"{test.stem}.toml") if out is None else _path(out)
    if target.suffix != ".toml" or not target.stem:
        raise UserError(f"--out {shown(str(target))}: the name of a foam file must end in .toml")
    for path in (target, picture := target.with_suffix(".png")):
        if path.is_dir():
            raise UserError(f"{path}: that is a folder. Fix: choose another name with --out")
        if path.exists() and test.exists() and path.samefile(test):
            raise UserError(f"{path}: that is the test itself. Fix: choose another name with --out")
        if os.path.lexists(path) and not overwrite:
            raise UserError(
                f"{path}: it is there already. Fix: pass --overwrite to replace it, or choose "
                "another name with --out"
            )
    try:
        # permission bits do not tell all (root, /proc, read-only disks): try it
        probe = partial_name(target)
        probe.touch()
        probe.unlink()
    except OSError as error:
        raise UserError(
            f"{target}: cannot be written ({error.strerror}). Fix: choose a folder that is there "
            "and that you may write to, with --out"
        ) from None
    return target, picture


def _path(name: str) -> Path:
    if not name.strip() or "\0" in name:
        raise UserError(f"{shown(name)}: not the name of a file")
    return Path(name)


def _number(given: str | None) -> float | str | None:
    """A number; text that is none is refused with all else that is wrong with the options."""
    try:
        return None if given is None else float(given)
    except ValueError:
        return given


def _column(given: str | None) -> str | int | None:
    """A column by name, or by number from 1."""
    return int(given) if given is not None and re.fullmatch(r"[0-9]{1,6}", given) else given


def _file(known: dict[str, Any], read: CompressionTest) -> FoamFile:
    """The foam file of a test. Raises UserError: options or a curve that cannot be."""
    curve = read.curve
    measured = [f"stress to {curve.tested:.3g} of strain, {read.strain.size:,} points"]
    measured += [
        _column_in_words(key, column)
        for key, column in zip(("strain", "stress"), read.columns, strict=True)
        if column.over is not None
    ]
    measured += _left_out(read)
    if len(curve.strain) < read.loading.sum():
        measured.append(f"thinned to {len(curve.strain):,} points, means of those around them")
    if curve.smoothing > 0.0:
        part = 100.0 * curve.smoothing / curve.plateau_stress
        measured.append(
            f"smoothed by at most {_pressure(curve.smoothing)}, {part:.2g} % of the plateau, so "
            "that no stress falls"
        )
    assumed = [
        {"key": f"foam.{key}", "why": why} for key, why in TabulatedFoam.unless_given.items()
    ]
    data = {
        **{key: value for key, value in known.items() if value is not None},
        "measured": measured,
        "assumed": assumed,
        "foam": {"law": "tabulated", "curve": curve},
    }
    try:
        return FoamFile.model_validate(data)
    except ValidationError as error:
        lines = [
            re.sub(r"^\w+", lambda key: f"--{_OPTIONS.get(key[0], key[0])}", line)
            if line.partition(" ")[0].rstrip(":") in FoamFile.model_fields
            else line
            for line in explain(error, FoamFile).splitlines()
        ]
        raise UserError("\n".join(lines)) from None


def _write(
    file: FoamFile, read: CompressionTest, fit: CrushableFit, target: Path, picture: Path
) -> None:
    """Write the foam file and its picture, both or neither. Raises UserError, OSError."""
    from taichi_foam.picture import style
    from taichi_foam.picture.foam_figure import compression_test

    assert isinstance(file.foam, TabulatedFoam)
    text = _HEADER.format(name=_one_line(target.name)) + file.to_toml()
    figure = compression_test(read.strain, read.stress, read.loading, file.foam, fit, file.title)
    with whole_file(target) as foam_file, whole_file(picture) as drawing:
        foam_file.write_text(text, encoding="utf-8")
        try:
            style.save(figure, drawing)
        except UserError as error:  # it names the name that the file has until it is whole
            raise UserError(str(error).replace(str(drawing), str(picture))) from error


def _what_was_read(path: Path, read: CompressionTest) -> Iterator[RenderableType]:
    """Points, encoding, columns with their units, and what of it the curve leaves out."""
    curve = read.curve
    encoding = "" if read.encoding == "UTF-8" else f", read as {read.encoding}"
    yield Text(f"{path}{encoding}: {read.strain.size:,} points, to a strain of {curve.tested:.3g}")
    if read.skipped:
        lines = "1 line" if read.skipped == 1 else f"{read.skipped:,} lines"
        yield Text(f"{lines} of text above the header skipped")
    for key, column in zip(("strain", "stress"), read.columns, strict=True):
        yield Text(_column_in_words(key, column))
    yield Text(f"largest stress {_pressure(float(read.stress.max()))}")
    for text in _left_out(read):
        yield Text(text)
    if len(curve.strain) < read.loading.sum():
        yield Text(f"thinned to {len(curve.strain):,} points")
    if curve.smoothing > 0.0:
        yield Text(f"smoothed by at most {_pressure(curve.smoothing)}, so that no stress falls")
    yield Text()


def _column_in_words(key: str, column: FileColumn) -> str:
    """Where strain or stress are from: column, unit, and what it was divided by."""
    kind, over = column.kind, column.over
    what = key if over is None else f"{key}: {kind.name}"
    unit = f"in {column.unit}" if column.unit is not None else f"in {kind.si}, as no unit is given"
    head = "" if column.head is None else f", {shown(column.head)}"
    size = "" if over is None else f", over {plain(over)} {'m' if key == 'strain' else 'm2'}"
    return f"{what} {unit} (column {column.number}{head}){size}"


def _left_out(read: CompressionTest) -> Iterator[str]:
    """What the loading envelope leaves out of a test: branches, and strains met before."""
    ways = [f"from {each.start:.3g} to {each.lowest:.3g}" for each in read.branches]
    if ways:
        points = sum(each.points for each in read.branches)
        which = "1 unloading branch" if len(ways) == 1 else f"{len(ways)} unloading branches"
        more = ", ..." if len(ways) > _BRANCHES else ""
        yield (
            f"left out of the curve: {which} ({points:,} points, with reloading), strain "
            f"{', '.join(ways[:_BRANCHES])}{more}"
        )
    rest = int((~read.loading).sum()) - sum(each.points for each in read.branches)
    if rest:
        yield f"left out of the curve: {rest:,} points whose strain was reached before"


def _derived(foam: BondFoam, fit: CrushableFit) -> Iterator[RenderableType]:
    """What follows from the curve, beside the constants of Eq. 26 fitted to it."""
    assert isinstance(foam, TabulatedFoam)
    fitted, marks, theirs = fit.foam, foam.landmarks, fit.foam.landmarks
    table = Table(box=None, pad_edge=False, header_style="dim")
    table.add_column("", no_wrap=True)
    table.add_column("from the curve", justify="right", no_wrap=True)
    table.add_column("Eq. 26 fitted", justify="right", no_wrap=True)
    beyond = "not tested"
    rows = [
        ("Young's modulus K", _pressure(foam.youngs_modulus), _pressure(fitted.youngs_modulus)),
        ("shear modulus", _pressure(foam.shear_modulus), _pressure(fitted.shear_modulus)),
        ("plateau", _pressure(marks.plateau_stress), _pressure(fitted.plateau_stress)),
        ("crush starts", _percent(marks.crush_start), _percent(theirs.crush_start)),
        (
            "densification" if fit.densifies else "densification, where the test ends",
            _percent(marks.crush_end),
            _percent(theirs.crush_end) if fit.densifies else beyond,
        ),
        ("locking", _percent(marks.limit), _percent(theirs.limit) if fit.densifies else beyond),
        ("breaks in tension", _percent(marks.tensile), _percent(theirs.tensile)),
        ("breaks in shear", _percent(marks.shear), _percent(theirs.shear)),
        ("constant a", "", f"{fitted.densification_a:.4g}" if fit.densifies else beyond),
        ("constant b", "", f"{fitted.densification_b:.4g}" if fit.densifies else beyond),
        ("median error in stress", "", f"{100 * fit.error:.2g} %"),
    ]
    for row in rows:
        table.add_row(*row)
    yield table
    yield Text()


def _say_noise(errors: Console, foam: BondFoam, fit: CrushableFit) -> None:
    """Warn of a modulus that may be the noise's: the steepest slope has the worst of it."""
    times = foam.youngs_modulus / fit.foam.youngs_modulus
    if times > _NOISY:
        _line(
            errors,
            f"warning: Young's modulus is the steepest slope of the curve, {times:.2g} times that "
            "of the fit; if that is noise, fewer --points take it out",
        )


def _known(file: FoamFile) -> Iterator[RenderableType]:
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


def _constants(file: FoamFile) -> Iterator[RenderableType]:
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


def _landmarks(foam: BondFoam) -> Iterator[RenderableType]:
    """Strains and stresses that measures and pictures refer to."""
    marks = foam.landmarks
    rows = {
        "plateau": _pressure(marks.plateau_stress),
        "crush starts": _percent(marks.crush_start),
        "densification": _percent(marks.crush_end),
        "locking": _percent(marks.limit),
        "breaks in tension": _percent(marks.tensile),
        "breaks in tension, once crushed": _percent(marks.crushed_tensile),
        "breaks in shear": _percent(marks.shear),
    }
    table = Table(box=None, pad_edge=False, header_style="dim")
    table.add_column("landmarks", no_wrap=True)
    table.add_column("", justify="right", no_wrap=True)
    for row in rows.items():
        table.add_row(*row)
    yield table
    yield Text()


def _assumed(whole: FoamFile | Scene, entries: Sequence[Assumed]) -> Iterator[RenderableType]:
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


def _pressure(stress: float) -> str:
    scale, prefix = si_scale(stress, digits=3)
    return f"{stress / scale:.3g} {prefix}Pa"


def _percent(strain: float) -> str:
    """A strain as landmarks have it, negative in compression."""
    return f"{100 * strain:.3g} %"


def _one_line(text: str) -> str:
    """Text as a comment of TOML may hold it."""
    return "".join(c if c.isprintable() else "?" for c in text)


def _line(console: Console, text: str) -> None:
    console.print(text, soft_wrap=True, markup=False)
