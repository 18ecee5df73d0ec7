"""Foam files: tables for the terminal on a foam, and a file made from its test."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from pydantic import ValidationError
from rich.console import RenderableType
from rich.table import Table
from rich.text import Text

from taichi_foam.cli.outcome import check_name, columns
from taichi_foam.errors import UserError
from taichi_foam.laws.bond import BondFoam, Curve
from taichi_foam.laws.bond.by_curve import CurveFoam
from taichi_foam.laws.bond.fit import CrushableFit, ReturnFit, return_fit
from taichi_foam.laws.bond.kinds.recovering import RecoveringFoam
from taichi_foam.laws.bond.kinds.tabulated import TabulatedFoam
from taichi_foam.parts import unit_of
from taichi_foam.results.files import partial_name, whole_file
from taichi_foam.scene import Scene
from taichi_foam.scene.assumed import Origin
from taichi_foam.scene.csv_file import Column
from taichi_foam.scene.keys import written
from taichi_foam.scene.library import FoamFile, foam_of, listed
from taichi_foam.scene.measured import FINEST, CompressionTest
from taichi_foam.scene.messages import explain, shown
from taichi_foam.scene.paths import NOTHING, at, unit_at
from taichi_foam.units import plain, pressure_text

_HEADER = """\
# If you know a constant better, give it in the table [foam] and remove its [[assumed]] table.
# A scene with foam = "{name}" uses this foam and its density.

"""

_OPTIONS = {"title": "name"}
"""Keys of a foam file whose option has another name."""

_FEWEST = 20
"""Smallest number of parts of its strain that a test is reduced to."""

_BRANCHES = 5
"""Largest number of branches that are listed."""

_NOISY = 1.3
"""If the curve's modulus is more than this many times that of the fit, it may be noise."""


def library() -> Table:
    """The foams of which the library has values, by name."""
    table = columns("name", ">kg/m3", ">plateau", header_style="dim")
    table.add_column("description")
    for name in listed():
        file = foam_of(name)
        plateau = f"{file.foam.landmarks.plateau_stress / 1e3:.3g} kPa"
        table.add_row(Text(name), plain(file.density), plateau, Text(file.title))
    return table


def known(file: FoamFile) -> Iterator[RenderableType]:
    """The descriptive entries of a foam file."""
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
    """The foam's constants with units, and where they are from.

    What is given is as the source states it. Descriptions are cut to their first words;
    `taichi-foam keys foam` shows them in full.
    """
    foam = file.foam
    assumed = {each.key for each in file.assumed}
    derived = {each.key for each in file.derived}
    table = columns(f"law {foam.law}", ">", "unit", "", header_style="dim")
    table.add_column("meaning")
    for key, field in type(foam).model_fields.items():
        if key in ("law", "source"):
            continue
        value = getattr(foam, key)
        about = (field.description or "").partition(";")[0]
        if isinstance(value, Curve):
            about = (
                f"stress over strain in its compression test, up to a strain of {value.tested:.3g}"
            )
        if f"foam.{key}" in assumed:
            origin = "assumed"
        elif f"foam.{key}" in derived:
            origin = "derived"
        elif key in foam.model_fields_set and value is not None:
            origin = "given"
        else:
            origin = "default"
        table.add_row(key, written(value), unit_of(field), origin, Text(about))
    yield table
    yield Text()


def landmarks(foam: BondFoam) -> Iterator[RenderableType]:
    """Strains and stresses that measures and pictures refer to."""
    marks = foam.landmarks
    rows = {
        "plateau": pressure_text(marks.plateau_stress),
        "crushing starts": _percent(marks.crush_start),
        "densification": _percent(marks.crush_end),
        "locking": _percent(marks.limit),
        "breaks in tension": _percent(marks.tensile),
        "breaks in tension, once crushed": _percent(marks.crushed_tensile),
        "breaks in shear": _percent(marks.shear),
    }
    table = columns("landmarks", ">", header_style="dim")
    for row in rows.items():
        table.add_row(*row)
    yield table
    yield Text()


def origins(
    whole: FoamFile | Scene, entries: Sequence[Origin], head: str
) -> Iterator[RenderableType]:
    """A table of values in `whole` that were not measured, with the reason for each; or nothing."""
    if not entries:
        return
    table = columns(head, ">", "unit", header_style="dim")
    table.add_column("why")
    for each in entries:
        value, unit = _value(whole, each.key)
        table.add_row(Text(each.key), value, unit, Text(each.why))
    yield table
    yield Text()


def _value(whole: FoamFile | Scene, key: str) -> tuple[str, str]:
    """Value and unit of an assumed value; empty if a foam file has no such key."""
    value = at(whole, key)
    if value is NOTHING:
        return "", ""
    return written(value), unit_at(whole, key)


def _percent(strain: float) -> str:
    """A strain in percent, negative in compression as for landmarks."""
    return f"{100 * strain:.3g} %"


def targets(test: Path, out: str | None, overwrite: bool) -> tuple[Path, Path]:
    """The paths of the foam file and the picture that will be written.

    Raises UserError: a name is taken or invalid, or the folder cannot be written to.
    """
    target = Path(f"{test.stem}.toml") if out is None else path_of(out)
    if target.suffix != ".toml" or not target.stem:
        raise UserError(f"--out {shown(str(target))}: the name of a foam file must end in .toml")
    for path in (target, picture := target.with_suffix(".png")):
        if path.is_dir():
            raise UserError(f"{path}: is a folder. Fix: choose another name with --out")
        if path.exists() and test.exists() and path.samefile(test):
            raise UserError(f"{path}: is the test itself. Fix: choose another name with --out")
        check_name(path, overwrite, "name")
    try:
        # permission bits do not tell everything (root, /proc, read-only disks): try it
        probe = partial_name(target)
        probe.touch()
        probe.unlink()
    except OSError as error:
        raise UserError(
            f"{target}: cannot be written ({error.strerror}). Fix: choose an existing folder that "
            "you may write to, with --out"
        ) from None
    return target, picture


def path_of(name: str) -> Path:
    if not name.strip() or "\0" in name:
        raise UserError(f"{shown(name)}: not a possible file name")
    return Path(name)


def finest(points: int | None) -> int:
    """Largest number of parts that a test is reduced to. Raises UserError."""
    if points is None:
        return FINEST
    if not _FEWEST <= points <= FINEST:
        raise UserError(f"--points = {points}: must be at least {_FEWEST}, at most {FINEST}")
    return points


def number(given: str | None) -> float | str | None:
    """A number; other text is returned as it is, to be refused later with all other errors."""
    try:
        return None if given is None else float(given)
    except ValueError:
        return given


def column(given: str | None) -> str | int | None:
    """A column by name, or by number from 1."""
    return int(given) if given is not None and re.fullmatch(r"[0-9]{1,6}", given) else given


def returned(path: Path, read: CompressionTest) -> ReturnFit:
    """Hysteresis and set by the test's unloading. Raises UserError: it has none."""
    way_back = read.way_back
    if way_back is None:
        raise UserError(
            f"{path}: --recovering: the test does not unload from its largest strain to a tenth of "
            "its stress; take one with the whole way back, or leave --recovering out, and give "
            "foam.law = 'recovering' and foam.hysteresis_factor in the foam file"
        )
    return return_fit(read.curve, *way_back)


def in_words(returned: ReturnFit, start: float) -> str:
    """The fit of a way back from the strain `start`."""
    return (
        f"fitted to the unloading from {start:.3g}: hysteresis_factor {returned.factor:g}, "
        f"hysteresis_shape {returned.shape:g}, permanent_set {returned.left:g}; the test gives "
        f"{100 * returned.given_back:.3g} % of its energy back, and the fit's stress misses it by "
        f"{100 * returned.error:.2g} % of the largest (root mean square)"
    )


def file_of(
    known: dict[str, Any], read: CompressionTest, returned: ReturnFit | None = None
) -> FoamFile:
    """The foam file of a test; of foam that springs back if the fit of its way back is given.

    Raises UserError: invalid options, or an invalid curve.
    """
    curve = read.curve
    measured = [f"stress up to a strain of {curve.tested:.3g}, {read.strain.size:,} points"]
    measured += [
        _column_in_words(key, column)
        for key, column in zip(("strain", "stress"), read.columns, strict=True)
        if column.over is not None
    ]
    measured += [*_left_out(read), *_reduced(read)]
    kind = TabulatedFoam
    foam: dict[str, Any] = {"law": "tabulated", "curve": curve}
    if returned is not None:
        kind = RecoveringFoam
        foam |= {
            "law": "recovering",
            "hysteresis_factor": returned.factor,
            "hysteresis_shape": returned.shape,
            "permanent_set": returned.left,
        }
        measured.append(in_words(returned, curve.tested))
    assumed = [
        {"key": f"foam.{key}", "why": why}
        for key, why in kind.unless_given.items()
        if key not in foam
    ]
    data = {
        **{key: value for key, value in known.items() if value is not None},
        "measured": measured,
        "assumed": assumed,
        "foam": foam,
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


def write(
    file: FoamFile, read: CompressionTest, fit: CrushableFit, target: Path, picture: Path
) -> None:
    """Write the foam file and its picture, both or neither. Raises UserError, OSError."""
    from taichi_foam.picture import style
    from taichi_foam.picture.figures import compression_test

    assert isinstance(file.foam, CurveFoam)
    text = _HEADER.format(name=_one_line(target.name)) + file.to_toml()
    figure = compression_test(read.strain, read.stress, read.loading, file.foam, fit, file.title)
    with whole_file(target) as foam_file, whole_file(picture) as drawing:
        foam_file.write_text(text, encoding="utf-8")
        try:
            style.save(figure, drawing)
        except UserError as error:  # it names the temporary file
            raise UserError(str(error).replace(str(drawing), str(picture))) from error


def what_was_read(path: Path, read: CompressionTest) -> Iterator[RenderableType]:
    """Points, encoding, columns with their units, and the points that the curve leaves out."""
    curve = read.curve
    encoding = "" if read.encoding == "UTF-8" else f", read as {read.encoding}"
    yield Text(
        f"{path}{encoding}: {read.strain.size:,} points, up to a strain of {curve.tested:.3g}"
    )
    if read.skipped:
        lines = "1 line" if read.skipped == 1 else f"{read.skipped:,} lines"
        yield Text(f"{lines} of text above the header skipped")
    for key, column in zip(("strain", "stress"), read.columns, strict=True):
        yield Text(_column_in_words(key, column))
    yield Text(f"largest stress {pressure_text(float(read.stress.max()))}")
    for text in (*_left_out(read), *_reduced(read)):
        yield Text(text)
    yield Text()


def _column_in_words(key: str, column: Column) -> str:
    """The source of strain or stress: column, unit, and the size it was divided by."""
    kind, over = column.kind, column.over
    what = key if over is None else f"{key}: {kind.name}"
    unit = f"in {column.unit}" if column.unit is not None else f"in {kind.si}, as no unit is given"
    head = "" if column.head is None else f", {shown(column.head)}"
    size = "" if over is None else f", over {plain(over)} {'m' if key == 'strain' else 'm2'}"
    return f"{what} {unit} (column {column.number}{head}){size}"


def _left_out(read: CompressionTest) -> Iterator[str]:
    """Points of a test outside the loading envelope: branches, and strains reached before."""
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
        yield f"left out of the curve: {rest:,} points whose strain had been reached before"


def _reduced(read: CompressionTest) -> Iterator[str]:
    """How the curve differs from the test's loading: fewer points, and no falling stress."""
    curve = read.curve
    if len(curve.strain) < read.loading.sum():
        yield f"thinned to {len(curve.strain):,} points, each the mean of those around it"
    if curve.smoothing > 0.0:
        part = 100.0 * curve.smoothing / curve.plateau_stress
        yield (
            f"smoothed by at most {pressure_text(curve.smoothing)} ({part:.2g} % of the plateau), "
            "so that the stress never falls"
        )


def from_the_curve(foam: BondFoam, fit: CrushableFit) -> Iterator[RenderableType]:
    """Values that follow from the curve, beside those of Eq. 26 fitted to it."""
    assert isinstance(foam, CurveFoam)
    fitted, marks, theirs = fit.foam, foam.landmarks, fit.foam.landmarks
    table = columns("", ">from the curve", ">Eq. 26 fitted", header_style="dim")
    beyond = "not tested"
    rows = [
        (
            "Young's modulus K",
            pressure_text(foam.youngs_modulus),
            pressure_text(fitted.youngs_modulus),
        ),
        ("shear modulus", pressure_text(foam.shear_modulus), pressure_text(fitted.shear_modulus)),
        ("plateau", pressure_text(marks.plateau_stress), pressure_text(fitted.plateau_stress)),
        ("crushing starts", _percent(marks.crush_start), _percent(theirs.crush_start)),
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


def doubts(foam: BondFoam, fit: CrushableFit) -> Iterator[str]:
    """Warnings: the modulus may be noise, since it is the steepest slope."""
    times = foam.youngs_modulus / fit.foam.youngs_modulus
    if times > _NOISY:
        yield (
            f"Young's modulus is the steepest slope of the curve, {times:.2g} times that of the "
            "fit; if that is noise, fewer --points remove it"
        )


def _one_line(text: str) -> str:
    """Text with unprintable characters replaced, as a TOML comment requires."""
    return "".join(c if c.isprintable() else "?" for c in text)
