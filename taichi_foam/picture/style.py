"""The common style of all figures, labels beside curves, and saving of figures."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import matplotlib as mpl
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke
from matplotlib.ticker import LogLocator, NullLocator

from taichi_foam.errors import UserError
from taichi_foam.results.files import whole_file

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis

BLUE, VERMILION, GREEN, PURPLE, SKY, ORANGE, GREY = (
    "#0072B2", "#D55E00", "#009E73", "#AA4A8A", "#56B4E9", "#E69F00", "#8C8C8C",
)  # fmt: skip
CYCLE = (BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY, GREY)
INK = "#202124"

STYLE: Any = {
    "font.family": "DejaVu Sans",
    "font.size": 13,
    "axes.labelsize": 13,
    "axes.titlesize": 14,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.linewidth": 1.0,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#E3E3E0",
    "grid.linewidth": 0.8,
    "lines.linewidth": 2.0,
    "svg.fonttype": "path",
    "pdf.fonttype": 42,  # TrueType: text stays text, and publishers accept it
    "svg.hashsalt": "taichi-foam",  # the same figure gives the same file
    "figure.dpi": 100,
}

#: The style of figures for print, at their size on the page: text of 7 to 8 points.
PRINT: Any = {
    **STYLE,
    "font.size": 7,
    "axes.labelsize": 7.5,
    "axes.titlesize": 7.5,
    "axes.linewidth": 0.6,
    "axes.labelpad": 2.5,
    "grid.linewidth": 0.6,
    "lines.linewidth": 1.0,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "xtick.major.size": 2.5,
    "ytick.major.size": 2.5,
    "xtick.major.pad": 2.0,
    "ytick.major.pad": 2.0,
}

#: Metadata that removes the date from each format, so that files are reproducible.
_DATELESS = {".png": None, ".svg": {"Date": None}, ".pdf": {"CreationDate": None}}
#: Resolution of PNGs, and of images inside vector files.
_SCREEN_DPI, _PRINT_DPI = 120, 600

#: Halo that separates a label from the lines under it.
HALO = [withStroke(linewidth=3, foreground="white")]
LEGEND: dict[str, Any] = {"frameon": False, "labelcolor": "linecolor"}


def blank(width: float, height: float) -> Figure:
    """An empty figure [inches] with an automatic layout."""
    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def save(figure: Figure, path: str | Path, *, svg: bool = False, look: Any = STYLE) -> list[Path]:
    """Write the figure as PNG, SVG or PDF, by the path's extension; return the paths.

    Args:
        svg: also write an SVG beside the PNG.
        look: the settings that the figure was made with, `STYLE` or `PRINT`.

    Raises:
        UserError: another extension, or a file that cannot be written.
    """
    first = Path(path)
    if first.suffix.lower() not in _DATELESS:
        raise UserError(f"figure {first}: the name must end in .png, .svg or .pdf")
    targets = [first, first.with_suffix(".svg")] if svg else [first]
    with mpl.rc_context(look):
        for target in targets:
            ending = target.suffix.lower()
            dpi = _SCREEN_DPI if ending == ".png" else _PRINT_DPI
            with written(target, "figure") as partial:
                metadata = _DATELESS[ending]
                figure.savefig(partial, dpi=dpi, facecolor="white", metadata=metadata)
    return targets


@contextlib.contextmanager
def written(target: Path, what: str) -> Iterator[Path]:
    """`whole_file` for a "figure" or a "report". Raises UserError if it cannot be written."""
    try:
        with whole_file(target) as partial:
            yield partial
    except OSError as error:
        raise UserError(
            f"{what} {target}: it could not be written ({error.strerror}); "
            "check the folder, its permissions and the free space"
        ) from error


def save_all(figure: Figure, stem: Path) -> None:
    """Write the figure as `STEM.png`, `.svg` and `.pdf`. Raises UserError: see `save`."""
    for ending in _DATELESS:
        save(figure, stem.with_name(stem.name + ending))
        figure.set_layout_engine("none")  # once is enough: the layout is half of a drawing


def plain_log(side: Axis, subs: Sequence[float] = (1.0, 2.0, 5.0)) -> None:
    """Plain numbers at `subs` of each decade of a logarithmic axis."""
    side.set_major_locator(LogLocator(subs=subs, numticks=30))
    side.set_major_formatter("{x:g}")
    side.set_minor_locator(NullLocator())


def spread(wanted: Sequence[float], apart: float) -> list[float]:
    """Positions as near as possible to `wanted` (any order), at least `apart` from each other."""
    from scipy.optimize import isotonic_regression

    order = np.argsort(wanted, kind="stable")
    steps = apart * np.arange(len(order))
    placed = np.empty(len(order))
    placed[order] = isotonic_regression(np.asarray(wanted)[order] - steps).x + steps
    return placed.tolist()


def beside(
    axis: Axes,
    x: float,
    y: float,
    text: str,
    colour: str,
    offset: tuple[float, float],
    vertical: str,
    horizontal: str = "left",
) -> None:
    """Write a label in the colour of its curve, `offset` points from (x, y), on a white halo."""
    axis.annotate(
        text,
        (x, y),
        xytext=offset,
        textcoords="offset points",
        ha=horizontal,
        va=vertical,
        color=colour,
        fontweight="bold",
        path_effects=HALO,
    )
