"""Figures for print: their size on the page, text that is text, and nothing over anything else."""

from __future__ import annotations

import re
import zlib
from pathlib import Path

import numpy as np
import pytest
from figure_checks import check_motion, check_texts, shown_texts
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.figure import Figure
from picture_states import dented, intact, scene_of, split
from test_figures import history_of

from taichi_foam import load_scene
from taichi_foam.errors import UserError
from taichi_foam.picture import printed, style
from taichi_foam.picture.look import levels, shades
from taichi_foam.picture.modes import MODES

MM = 72 / 25.4  # points
SCENE = scene_of(20, 10)
RUN = [dented(SCENE, 0.004 * k, time=0.002 * k) for k in range(11)]
HISTORY = history_of(3.03)


def figure_of(name: str) -> Figure:
    """A figure by its kind and width."""
    kind, column = name.split()
    if kind == "montage":
        return printed.montage(RUN, SCENE, column=column)
    return printed.curves(HISTORY, SCENE, column=column)


NAMES = [f"{kind} {column}" for kind in ("montage", "curves") for column in printed.COLUMNS]


def pdf_of(figure: Figure, folder: Path) -> bytes:
    (path,) = style.save(figure, folder / "figure.pdf", look=style.PRINT)
    return path.read_bytes()


def streams(pdf: bytes) -> list[bytes]:
    """The contents of a PDF's streams, uncompressed."""
    found = []
    for match in re.finditer(rb"stream\r?\n(.*?)\r?\nendstream", pdf, re.DOTALL):
        try:
            found.append(zlib.decompress(match[1]))
        except zlib.error:
            found.append(match[1])
    return found


@pytest.mark.parametrize("name", NAMES)
def test_files_are_as_wide_as_the_column_and_the_same_each_time(name: str, tmp_path: Path) -> None:
    wanted = {"single": 84, "double": 174}[name.split()[1]] * MM
    written = []
    for _ in range(2):
        figure = figure_of(name)
        pdf = pdf_of(figure, tmp_path)
        (svg,) = style.save(figure, tmp_path / "figure.svg", look=style.PRINT)
        written.append((pdf, svg.read_bytes()))
    assert written[0] == written[1]
    pdf, svg = written[0]
    box = re.search(rb"/MediaBox \[ ?0 0 ([0-9.]+) ([0-9.]+) ?\]", pdf)
    assert box is not None
    assert float(box[1]) == pytest.approx(wanted, abs=0.5)
    assert float(box[2]) < 240 * MM
    wide = re.search(rb'<svg[^>]* width="([0-9.]+)pt"', svg)
    assert wide is not None
    assert float(wide[1]) == pytest.approx(wanted, abs=0.5)
    assert b"Date" not in pdf
    assert b"<dc:date>" not in svg


@pytest.mark.parametrize("name", NAMES)
def test_text_in_a_pdf_is_text_with_its_fonts(name: str, tmp_path: Path) -> None:
    figure = figure_of(name)
    texts = [text for text in shown_texts(figure) if text.get_text()]
    pdf = pdf_of(figure, tmp_path)
    everything = pdf + b"".join(streams(pdf))
    assert b"/FontFile2" in everything  # a TrueType font, embedded
    assert b"/CIDFontType2" in everything
    assert b"/Type3" not in everything
    drawn = sum(len(re.findall(rb"\bT[jJ]\b", stream)) for stream in streams(pdf))
    assert drawn >= len(texts)


@pytest.mark.parametrize("name", NAMES)
def test_no_text_overlaps_or_is_cut(name: str) -> None:
    check_texts(figure_of(name))


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("column", printed.COLUMNS)
def test_no_key_is_too_crowded_for_its_column(mode: str, column: str) -> None:
    check_texts(printed.montage(RUN, SCENE.with_values(output__mode=mode), column=column))


@pytest.mark.parametrize("name", NAMES)
def test_text_and_lines_have_a_printers_sizes(name: str) -> None:
    figure = figure_of(name)
    assert all(7 <= float(text.get_fontsize()) <= 8 for text in shown_texts(figure))
    for axis in figure.axes:
        assert all(0.6 <= line.get_linewidth() <= 1.0 for line in axis.lines)
        assert all(0.6 <= spine.get_linewidth() <= 1.0 for spine in axis.spines.values())
        for lines in axis.collections:
            if isinstance(lines, LineCollection):
                assert all(0.6 <= width <= 1.0 for width in np.ravel(lines.get_linewidth()))


def panels(figure: Figure) -> list[tuple[PolyCollection, LineCollection]]:
    """Cells and lines of each instant."""
    found = []
    for axis in figure.axes:
        cells = [c for c in axis.collections if isinstance(c, PolyCollection)]
        lines = [c for c in axis.collections if isinstance(c, LineCollection)]
        if cells and lines:
            found.append((cells[0], lines[0]))
    return found


def test_cells_have_the_colours_of_the_mode() -> None:
    figure = printed.montage(RUN, SCENE.with_values(output__mode="strain"), n=2)
    (_, _), (cells, _) = panels(figure)
    mode = MODES["strain"]
    level = levels(mode.values(RUN[-1], SCENE), mode.key(SCENE).top)
    wanted = shades("heat")[level].reshape(-1, 3) / 255
    np.testing.assert_allclose(np.asarray(cells.get_facecolor())[:, :3], wanted)
    assert len(np.unique(wanted, axis=0)) > 3


def test_cracks_have_a_line_on_either_side() -> None:
    around = 2 * (20 + 10)
    for state, cracks in ((intact(SCENE), 0), (split(SCENE), 2 * 10)):
        ((_, lines),) = panels(printed.montage([state], SCENE, n=1))
        assert len(lines.get_segments()) == around + cracks


def test_the_window_has_the_scale_of_the_bar() -> None:
    figure = printed.montage(RUN, SCENE, n=4)
    panel = figure.axes[0]
    width = figure.get_figwidth() * 25.4 * panel.get_position().width
    scale = width / np.ptp(panel.get_xlim())  # mm per m
    (bar,) = [axis for axis in figure.axes if any(t.get_text() == "20 cm" for t in axis.texts)]
    on_page = figure.get_figwidth() * 25.4 * bar.get_position().width / np.ptp(bar.get_xlim())
    length = np.ptp(np.asarray(bar.lines[0].get_xdata())) * on_page
    assert length == pytest.approx(0.20 * scale)


@pytest.mark.parametrize(("columns", "rows", "images"), [(60, 40, 0), (120, 60, 1)])
def test_many_cells_become_an_image_and_text_stays_text(
    columns: int, rows: int, images: int, tmp_path: Path
) -> None:
    scene = scene_of(columns, rows)
    states = [dented(scene, 0.01 * k, time=0.01 * k) for k in range(2)]
    pdf = pdf_of(printed.montage(states, scene, n=2), tmp_path)
    assert (b"/Subtype /Image" in pdf) == bool(images)
    assert any(re.search(rb"\bT[jJ]\b", stream) for stream in streams(pdf))
    assert len(pdf) < 400_000


def test_curves_are_drawn_in_the_units_of_their_axes() -> None:
    figure = printed.curves(HISTORY, SCENE)
    check_motion(figure, HISTORY)
    assert figure.axes[3].get_ylabel() == "energy (J)"


@pytest.mark.parametrize("column", printed.COLUMNS)
def test_without_an_impactor_there_are_only_energies(column: str) -> None:
    figure = printed.curves(HISTORY, load_scene("gallery/shear-patch"), column=column)
    assert [axis.get_ylabel() for axis in figure.axes] == ["energy (J)"]
    check_texts(figure)


@pytest.mark.parametrize(("dip", "line"), [(0.0, False), (0.005, False), (0.02, True)])
def test_a_line_at_zero_stands_only_where_a_curve_goes_below_it(dip: float, line: bool) -> None:
    values = np.abs(HISTORY["deceleration_smoothed_m_s2"])
    values[1] = -dip * values.max()
    axis = printed.curves({**HISTORY, "deceleration_smoothed_m_s2": values}, SCENE).axes[0]
    assert len(axis.lines) == 1 + line
    assert (axis.get_ylim()[0] < 0) == line


def test_print_is_on_white_whatever_the_screen_shows() -> None:
    dark = SCENE.with_values(output__theme="dark")
    one, other = (printed.montage(RUN, scene, n=1) for scene in (SCENE, dark))
    for figure in (one, other):
        figure.draw_without_rendering()
    assert one.axes[0].patch.get_facecolor() == other.axes[0].patch.get_facecolor() == (1, 1, 1, 1)
    tones = [panels(f)[0][1].get_edgecolor() for f in (one, other)]
    np.testing.assert_array_equal(*tones)


def test_what_cannot_be_is_refused() -> None:
    with pytest.raises(UserError, match="column = 'wide': must be one of single, double"):
        printed.montage(RUN, SCENE, column="wide")
    with pytest.raises(UserError, match="no snapshots"):
        printed.montage([], SCENE)
    with pytest.raises(UserError, match="fewer than two rows"):
        printed.curves({name: values[:1] for name, values in HISTORY.items()}, SCENE)
