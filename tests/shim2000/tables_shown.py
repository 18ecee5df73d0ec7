"""Tables as a terminal shows them."""

from __future__ import annotations

from io import StringIO

from rich.console import Console


def printed(table: object, width: int = 120) -> str:
    console = Console(width=width, record=True, file=StringIO())
    console.print(table)
    return console.export_text()
