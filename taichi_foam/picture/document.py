"""HTML reports in one self-contained file: paragraphs, figures as vector graphics, and tables."""

from __future__ import annotations

import base64
import io
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import matplotlib as mpl
from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined, Template

from taichi_foam.picture.style import STYLE, written
from taichi_foam.version import version

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_HOME = "taichi_foam.picture"


@dataclass(frozen=True)
class Table:
    """A table of texts; the first cell of each row is its head.

    head     heads of the columns, with units; empty: none
    rows     rows of texts, all of the same length
    note     a remark below it
    is_text  whether its cells are words, which are aligned left and may break into lines
    """

    head: Sequence[str]
    rows: Sequence[Sequence[str]]
    note: str = ""
    is_text: bool = False


@dataclass(frozen=True)
class Section:
    """A part of a report, in this order: title, paragraphs, figure, table.

    alt      what the figure shows, for readers who cannot see it; needed with a figure
    caption  a sentence below the figure
    """

    title: str
    words: Sequence[str] = ()
    figure: Figure | None = None
    alt: str = ""
    caption: str = ""
    table: Table | None = None


class _Picture(NamedTuple):
    source: str
    size: tuple[int, int]


def write(
    path: str | Path,
    title: str,
    lead: Sequence[str],
    sections: Sequence[Section],
    look: Any = STYLE,
) -> Path:
    """Write a report as one HTML file without links to other files, and return its path.

    Args:
        title: heading of the page.
        lead: the paragraphs that sum it up.
        sections: the rest, in order.
        look: the settings that the figures were made with, `STYLE` or `PRINT`.

    Raises:
        UserError: the file cannot be written.
    """
    page = template(_HOME, "document.html.j2").render(
        title=title,
        lead=lead,
        sections=[_shown(section, look) for section in sections],
        created=datetime.now().astimezone().strftime("%Y-%m-%d %H:%M %Z"),
        version=version(),
    )
    target = Path(path)
    with written(target, "report") as partial:
        partial.write_text(page, encoding="utf-8")
    return target


def template(package: str, name: str) -> Template:
    """A page's template in a package; it may include `document.css`, the style of all pages."""
    environment = Environment(
        loader=ChoiceLoader([PackageLoader(package, "."), PackageLoader(_HOME, ".")]),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template(name)


def _shown(section: Section, look: Any) -> dict[str, Any]:
    figure = section.figure
    if figure is not None and not section.alt:
        raise ValueError(f"section {section.title!r}: its figure needs an alt text")
    return {**vars(section), "figure": None if figure is None else _embedded(figure, look)}


def _embedded(figure: Figure, look: Any) -> _Picture:
    """A figure as an SVG in a data address, and its size in the pixels of a page."""
    text = io.BytesIO()
    with mpl.rc_context(look):
        figure.savefig(text, format="svg", facecolor="white", metadata={"Date": None})
    width, height = (round(96 * inches) for inches in figure.get_size_inches())
    return _Picture(data_address("image/svg+xml", text.getvalue()), (width, height))


def data_address(kind: str, content: bytes) -> str:
    """A file of a MIME type as an address, for pages that hold all that they show."""
    return f"data:{kind};base64,{base64.b64encode(content).decode('ascii')}"
