"""Columns of numbers in text files: encoding, separator, and where the numbers begin.

Testing machines and spreadsheets write such files: free text, a header, then rows of numbers
separated by commas, semicolons, tabs or spaces.
"""

from __future__ import annotations

import codecs
import csv
import math
import re
from collections import Counter
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from taichi_foam.errors import UserError
from taichi_foam.scene.messages import shown

MOST_BYTES = 20_000_000

IN_BRACKETS = re.compile(r"[\[(]\s*([^\])]+?)\s*[\])]")
"""A unit in a header."""

_NUMBER = re.compile(r"[-+]?(\d+([.,]\d*)?|[.,]\d+)([eE][-+]?\d+)?$")
_LINE_END = re.compile(r"\r\n?|\n")
_MARKS = (";", "\t", ",", None)
"""Possible separators of cells, the likeliest first; None: spaces."""

_LOOKED_AT = 200
"""Lines at either end of a file by which its separator is determined."""

Row = tuple[int, list[str]]
"""Number of a line, from 1, and its cells."""


@dataclass(frozen=True)
class Rows:
    """The lines of a file, without empty ones and comments, as cells.

    encoding  the file's encoding
    above     lines before the first row of numbers
    body      that row and all after it
    """

    encoding: str
    above: list[Row]
    body: list[Row]

    def header(self, units: Collection[str]) -> tuple[list[str] | None, int]:
        """The last row above the numbers with at least two cells, and its number of lines.

        If a line of `units` follows the names, each name is returned with its unit in brackets.
        (None, 0): there is no header.
        """
        lines = [cells for _, cells in self.above if sum(map(bool, cells)) >= 2]
        if not lines:
            return None, 0
        said = [IN_BRACKETS.fullmatch(cell) for cell in lines[-1]]
        bare = [match[1] if match else cell for match, cell in zip(said, lines[-1], strict=True)]
        is_units = all(
            match or plain_unit(cell) in units for match, cell in zip(said, bare, strict=True)
        )
        if len(lines) > 1 and len(lines[-2]) == len(bare) and is_units:
            pairs = zip(lines[-2], bare, strict=True)
            return [f"{name} [{unit}]" if unit else name for name, unit in pairs], 2
        return lines[-1], 1


@dataclass(frozen=True)
class Kind:
    """A kind of column: the words by which its header is recognised, and its possible units."""

    name: str
    units: Mapping[str, float]
    si: str
    words: tuple[str, ...] = ()

    def known_in(self, heads: Sequence[str]) -> list[int]:
        """The columns whose header has one of its words."""
        return [
            n for n, head in enumerate(heads) if any(word in head.lower() for word in self.words)
        ]


@dataclass(frozen=True)
class Column:
    """A column of a file.

    kind    the kind of its values
    number  number of the column, from 1
    head    its header; None: it has none
    unit    its unit from the header or the options; None: SI
    over    the size by which it was divided [m or m2]; None: it was not
    values  (n,) SI
    """

    kind: Kind
    number: int
    head: str | None
    unit: str | None
    over: float | None
    values: NDArray[np.float64]


def read_rows(path: Path, needs: str) -> Rows:
    """The rows of a text file, without empty lines and those that begin with `#`.

    Raises UserError: it cannot be read, or has no row of two numbers; `needs` says which numbers
    are needed.
    """
    text, encoding = _text(path)
    return rows_in(text, path, needs, encoding)


def rows_in(text: str, path: Path | str, needs: str, encoding: str = "UTF-8") -> Rows:
    """The same of a text; messages begin with `path`, or where else the text is from."""
    lines = [
        (number, line.strip())
        for number, line in enumerate(_LINE_END.split(text), 1)
        if line.strip() and not line.lstrip().startswith("#")
    ]
    if not lines:
        raise UserError(f"{path}: empty; must have lines of {needs}")
    between = _separator([line for _, line in lines[:_LOOKED_AT] + lines[-_LOOKED_AT:]])
    rows = [(number, _cells(path, number, line, between)) for number, line in lines]
    first = _first(rows)
    if first is None:
        raise UserError(f"{path}: no numbers; must have lines of {needs} below the header")
    return Rows(encoding, rows[:first], rows[first:])


def two_columns(path: Path, needs: str, kinds: tuple[Kind, Kind]) -> tuple[Column, Column]:
    """The first two columns of a text file.

    Units are in brackets in the header, or in a line of units below it; by default they are SI.
    Raises UserError with file, line and value: unreadable, not a number, an unknown unit, or a
    header with units that is separated from the numbers by text.
    """
    rows = read_rows(path, needs)
    heads, _ = rows.header({"", *kinds[0].units, *kinds[1].units})
    if heads and not any(map(IN_BRACKETS.search, heads)):
        for line, cells in rows.above:
            if sum(map(bool, cells)) >= 2 and any(map(IN_BRACKETS.search, cells)):
                raise UserError(
                    f"{path}, line {line}: this header has units, but text stands between it and "
                    "the numbers; remove that text, or begin its lines with #"
                )
    one, two = (
        column(path, rows, kind, n, unit_in(heads[n]) if heads else None)
        for n, kind in enumerate(kinds)
    )
    return one, two


def column(
    path: Path | str,
    rows: Rows,
    kind: Kind,
    at: int,
    unit: str | None,
    where: str | None = None,
    head: str | None = None,
    over: float | None = None,
) -> Column:
    """The column at an index, from 0, in a given unit; `where` names the unit's source in messages.

    Raises UserError with file, line and value: an unknown unit, not a number.
    """
    if unit is not None and plain_unit(unit) not in kind.units:
        raise UserError(
            f"{path}: {where or f'the header of column {at + 1}'}: unit {shown(unit)}: must be one "
            f"of {', '.join(kind.units)}"
        )
    factor = 1.0 if unit is None else kind.units[plain_unit(unit)]
    values = factor * np.array([number_in(path, line, cells, at) for line, cells in rows.body])
    return Column(kind, at + 1, head, unit, over, values if over is None else values / over)


def unit_in(head: str) -> str | None:
    """The unit in a header's brackets; None: it has none."""
    found = IN_BRACKETS.search(head)
    return found[1] if found else None


def named(heads: Sequence[str], name: str, among: Iterable[int] | None = None) -> list[int]:
    """The columns with a name, else those whose header contains it; all, or those `among` which.

    A name is a header without its unit, in any case.
    """
    places = list(range(len(heads)) if among is None else among)
    bare = {n: IN_BRACKETS.sub("", heads[n]).strip().lower() for n in places}
    exact = [n for n in places if bare[n] == name.lower()]
    return exact or [n for n in places if name.lower() in heads[n].lower()]


def plain_unit(unit: str) -> str:
    """A unit in the spelling by which it is looked up."""
    return unit.strip().lower().replace("²", "2")


def is_number(cell: str) -> bool:
    """Whether a cell holds a number, finite or not."""
    return _NUMBER.match(cell) is not None or cell.lower().lstrip("+-") in ("nan", "inf")


def number_in(path: Path | str, line: int, cells: Sequence[str], at: int) -> float:
    """The number in a cell. Raises UserError: text, or not finite."""
    cell = cells[at] if at < len(cells) else ""
    try:
        value = float(cell.replace(",", "."))
    except ValueError:
        raise UserError(
            f"{path}, line {line}: {shown(cell)} in column {at + 1}: must be a number; remove the "
            "line, or begin it with #"
        ) from None
    if not math.isfinite(value):
        raise UserError(
            f"{path}, line {line}: {cell} in column {at + 1}: must be finite; remove the line"
        )
    return value


def _text(path: Path) -> tuple[str, str]:
    """The text of a file and its encoding: UTF-16 if it has a mark, else UTF-8, else Latin-1."""
    try:
        if path.stat().st_size > MOST_BYTES:
            raise UserError(f"{path}: more than {MOST_BYTES:,} bytes; reduce the number of lines")
        data = path.read_bytes()
    except OSError as error:
        raise UserError(f"{path}: cannot be read: {error.strerror}") from None
    except ValueError:
        raise UserError(f"{shown(str(path))}: not a possible file name") from None
    marked = data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))
    if b"\0" in data and not marked:
        raise UserError(f"{path}: not a text file; save the table as CSV")
    codec, name = ("utf-16", "UTF-16") if marked else ("utf-8-sig", "UTF-8")
    try:
        return data.decode(codec), name
    except UnicodeDecodeError:
        if marked:
            raise UserError(
                f"{path}: not complete UTF-16 text, as if cut off; save it again"
            ) from None
        return data.decode("latin-1"), "Latin-1"


def _separator(lines: Sequence[str]) -> str | None:
    """The separator with which most lines consist of numbers, entirely or in part."""

    def numbers(mark: str | None) -> tuple[int, int]:
        rows = [cells for line in lines if (cells := _split(line, mark)) and len(cells) > 1]
        found = [[is_number(cell) for cell in cells if cell] for cells in rows]
        return sum(len(row) > 1 and all(row) for row in found), sum(sum(row) > 1 for row in found)

    return max(_MARKS, key=numbers)


def _split(line: str, between: str | None) -> list[str] | None:
    """The cells of a line; None if it is not CSV. An unclosed quote ends with the line."""
    if between is None:
        return line.split()
    try:
        (cells,) = csv.reader([line], delimiter=between, skipinitialspace=True)
    except csv.Error:
        return None
    return [cell.strip() for cell in cells]


def _cells(path: Path | str, number: int, line: str, between: str | None) -> list[str]:
    cells = _split(line, between)
    if cells is None:
        raise UserError(f"{path}, line {number}: not CSV (a cell is too long); remove the line")
    return cells


def _first(rows: list[Row]) -> int | None:
    """Index of the first row of numbers: the first with numbers in the same cells as most rows.

    Rows directly above it with a number in one of these cells count as rows of numbers with a
    mistake.
    """
    ends = rows[:_LOOKED_AT] + rows[-_LOOKED_AT:]
    counts = Counter(places for _, cells in ends if len(places := _places(cells)) > 1)
    if not counts:
        return None
    usual, _ = counts.most_common(1)[0]
    first = next(n for n, (_, cells) in enumerate(rows) if _places(cells) >= usual)
    while first > 0 and _places(rows[first - 1][1]) & usual:
        first -= 1
    return first


def _places(cells: Sequence[str]) -> frozenset[int]:
    """Which cells hold numbers."""
    return frozenset(n for n, cell in enumerate(cells) if is_number(cell))
