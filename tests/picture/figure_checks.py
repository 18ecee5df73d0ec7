"""What holds of every figure, on a screen and for print."""

from __future__ import annotations

import itertools
from collections.abc import Mapping

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.text import Text


def shown_texts(figure: Figure) -> list[Text]:
    figure.draw_without_rendering()
    seen = []
    for text in figure.findobj(Text):
        assert isinstance(text, Text)
        if text.get_visible() and text.get_text().strip():
            seen.append(text)
    # Matplotlib keeps tick labels beyond the axes' limits, and those of shared axes, unseen.
    hidden = set()
    for axes in figure.axes:
        for axis, low, high in (
            (axes.xaxis, *axes.get_xlim()),
            (axes.yaxis, *axes.get_ylim()),
        ):
            for tick in axis.get_major_ticks():
                inside = low - 1e-9 <= tick.get_loc() <= high + 1e-9
                if not (inside and tick.label1.get_visible()):
                    hidden.add(tick.label1)
    return [text for text in seen if text not in hidden]


def check_texts(figure: Figure, least: int = 8) -> None:
    """At least so many texts, of which none lies over another or beyond the page."""
    texts = shown_texts(figure)
    canvas = figure.canvas
    assert isinstance(canvas, FigureCanvasAgg)
    # An annotation's own extent would hold its leader line too.
    boxes = [(t.get_text(), Text.get_window_extent(t, canvas.get_renderer())) for t in texts]
    assert len(boxes) >= least
    for (first, a), (second, b) in itertools.combinations(boxes, 2):
        assert not a.padded(-0.5).overlaps(b.padded(-0.5)), f"{first!r} over {second!r}"
    page = figure.bbox
    for text, box in boxes:
        assert page.x0 <= box.x0, text
        assert box.x1 <= page.x1, text
        assert page.y0 <= box.y0, text
        assert box.y1 <= page.y1, text


def check_motion(figure: Figure, history: Mapping[str, np.ndarray]) -> None:
    """The first three axes have deceleration, velocity and displacement in their units."""
    for axis, column, factor, unit in zip(
        figure.axes[:3],
        ("deceleration_smoothed_m_s2", "velocity_m_s", "displacement_m"),
        (1, 1, 100),
        ("m/s²", "m/s", "cm"),
        strict=True,
    ):
        np.testing.assert_allclose(axis.lines[0].get_xdata(), 1e3 * history["time_s"])
        np.testing.assert_allclose(axis.lines[0].get_ydata(), factor * history[column])
        assert axis.get_ylabel().endswith(f"({unit})")
