"""One table, for a terminal and for Markdown; and how results are written."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from rich.table import Table as RichTable

from taichi_foam.results.files import whole_file


@dataclass
class Table:
    """Heads and rows of text. Rich prints it; `markdown` is for files."""

    heads: Sequence[str]
    rows: list[Sequence[str]] = field(default_factory=list)

    def __rich__(self) -> RichTable:
        table = RichTable(*self.heads)
        for row in self.rows:
            table.add_row(*row)
        return table

    def markdown(self) -> str:
        lines = [self.heads, ["---"] * len(self.heads), *self.rows]
        return "\n".join("| " + " | ".join(line) + " |" for line in lines)

    def records(self) -> list[dict[str, str]]:
        """Rows by heads, for JSON."""
        return [dict(zip(self.heads, row, strict=True)) for row in self.rows]


def write(path: Path, text: str) -> None:
    """Write a file of results; whoever reads meanwhile sees the old one, whole."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with whole_file(path) as file:
        file.write_text(text, encoding="utf-8")
