"""The look that all figures share, and how they are saved."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib as mpl
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from taichi_foam.errors import UserError

BLUE, VERMILION, GREEN, PURPLE, SKY, ORANGE, YELLOW, GREY = (
    "#0072B2", "#D55E00", "#009E73", "#AA4A8A", "#56B4E9", "#E69F00", "#F0E442", "#8C8C8C",
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
    "svg.hashsalt": "taichi-foam",  # the same figure gives the same file
    "figure.dpi": 100,
}

LEGEND: dict[str, Any] = {"frameon": False, "labelcolor": "linecolor"}


def blank(width: float, height: float) -> Figure:
    """An empty figure [inches] that makes room for what is written on it."""
    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def save(figure: Figure, path: str | Path, *, svg: bool = False) -> list[Path]:
    """Write the figure as PNG, and as SVG beside it where asked for; return the paths.

    Raises:
        UserError: another ending, or a file that cannot be written.
    """
    png = Path(path)
    if png.suffix.lower() != ".png":
        raise UserError(f"figure {png}: the name must end in .png")
    written = [png, png.with_suffix(".svg")] if svg else [png]
    try:
        with mpl.rc_context(STYLE):
            for target in written:
                dateless = {"Date": None} if target.suffix == ".svg" else None
                figure.savefig(target, dpi=120, facecolor="white", metadata=dateless)
    except OSError as error:
        raise UserError(
            f"figure {error.filename or png}: it could not be written ({error.strerror}); "
            "check the folder, its permissions and the free space"
        ) from error
    return written
