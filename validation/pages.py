"""What the pages of all studies share: their head, tables, and pictures in the package's style."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib as mpl
from matplotlib.axes import Axes

from taichi_foam.picture import style
from taichi_foam.simulation.provenance import machine, versions

RESULTS = Path(__file__).parent / "results"
FIGURES = Path(__file__).parents[1] / "docs" / "figures"
Part = dict[str, Any]
"""What is kept of a study's runs, by their names."""

MARKS = ("o", "s", "^", "D", "v")


@dataclass(frozen=True)
class Page:
    """Where a page goes, and the folder of its pictures."""

    path: Path
    figures: Path

    def picture(self, name: str, caption: str, draw: Callable[[Path], object]) -> str:
        """Have a picture drawn as PNG and SVG; the paragraph that shows it."""
        path = self.figures / f"{name}.png"
        draw(path)
        return f"![{caption}]({os.path.relpath(path, self.path.parent)})\n"

    def write(self, text: str) -> None:
        """Write it, into a folder that is made if need be."""
        self.path.parent.mkdir(parents=True, exist_ok=True)
        self.path.write_text(text, encoding="utf-8")


def headed(title: str, script: str, parts: Sequence[str]) -> str:
    """The text of a page: title, machine, versions and script, then its paragraphs."""
    here, known = machine(), versions()
    return "\n".join(
        [
            f"# {title}\n",
            f"taichi_foam {known['taichi_foam']}, Taichi {known['taichi']}, {here['processor']}. "
            f"Written by `python validation/{script}`.\n",
            *parts,
        ]
    )


def table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A Markdown table."""
    lines = [header, ["---"] * len(header), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines) + "\n"


def percent(value: float, digits: int = 1) -> str:
    """A relative error."""
    return f"{100 * value:+.{digits}f} %"


@contextmanager
def panels(path: Path, titles: Sequence[str], width: float = 5.6) -> Iterator[Sequence[Axes]]:
    """A row of axes with titles, saved as PNG and SVG."""
    with mpl.rc_context(style.STYLE):
        figure = style.blank(width * len(titles), 4.9)
        axes = figure.subplots(1, len(titles), squeeze=False)[0]
        for axis, mark, title in zip(axes, "abcd", titles, strict=False):
            axis.set_title(f"({mark}) {title}")
        yield axes
        path.parent.mkdir(parents=True, exist_ok=True)
        style.save(figure, path, svg=True)


def key(axis: Axes, place: Any = "best", title: str | None = None) -> None:
    """The key of one panel."""
    axis.legend(loc=place, title=title, fontsize=11, title_fontsize=11, frameon=False)


def cell_axis(axis: Axes, cells: Sequence[float]) -> None:
    """A logarithmic axis of cell sizes [mm] that names the ones used."""
    axis.set_xscale("log")
    axis.set_xticks([1e3 * cell for cell in cells], [f"{1e3 * cell:g}" for cell in cells])
    axis.minorticks_off()
    axis.set_xlabel("cell (mm)")
