"""What the pages of all parts share: tables, and figures in the package's style."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import matplotlib as mpl
from matplotlib.axes import Axes

from taichi_foam.picture import style

MARKS = ("o", "s", "^", "D", "v")


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
