"""`taichi-foam keys`: what a scene can say, as tables for the terminal or as the page of them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from itertools import groupby
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console, RenderableType
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from taichi_foam.cli.outcome import exit_codes
from taichi_foam.errors import UserError

if TYPE_CHECKING:
    from taichi_foam.scene.keys import Key


def keys_command(
    part: Annotated[
        str | None,
        typer.Argument(metavar="PART", help="Part of a scene, or one key; default: all."),
    ] = None,
    markdown: Annotated[
        bool, typer.Option("--markdown", help="Print the page docs/scene.md instead.")
    ] = False,
) -> None:
    """List the keys of a scene: unit (- is a plain number), default, what is allowed, meaning."""
    console, errors = Console(highlight=False), Console(stderr=True, highlight=False)
    with exit_codes(errors):
        from taichi_foam.cli.reference import described, keys_of, page

        if markdown and part is not None:
            raise UserError("--markdown: the page is of all keys; leave out PART")
        if markdown:
            typer.echo(page(), nl=False)
            return
        for name, keys in groupby(keys_of(part), key=lambda key: key.part):
            for line in _part(f"{name}: {described(name)}", list(keys)):
                console.print(line)


def _part(title: str, keys: Sequence[Key]) -> Iterator[RenderableType]:
    """A heading, then two rows for each key: what fits into columns, and the meaning below."""
    yield Text(title, style="bold")
    heads = ("key", "unit", "default", "allowed")
    rows = [(key.key, key.unit, key.default, key.allowed) for key in keys]
    widths = [max(map(len, column)) for column in zip(heads, *rows, strict=True)][:-1]
    yield _row(heads, widths, "dim")
    for key, row in zip(keys, rows, strict=True):
        yield _row(row, widths)
        yield Padding(Text(key.about), (0, 0, 0, 4), expand=False)
    yield Text()


def _row(cells: Iterable[str], widths: Sequence[int], style: str = "") -> Table:
    """A line of columns as wide as these, and of one more that takes the rest."""
    row = Table(box=None, show_header=False, pad_edge=False)
    for width in widths:
        row.add_column(width=width, no_wrap=True)
    row.add_column()
    row.add_row(*map(Text, cells), style=style)
    return row
